"""A replay has the same bits on linux64, aarch64-linux (qemu) and win64 (wine).

FMI 2.0 and 3.0 agree, too, and each platform goes on from the states of the others.
"""

from pathlib import Path

import pytest
from fmu_support import (
    CHANNELS,
    DRIVER,
    ESTIMATOR,
    RUNNERS,
    VEHICLE,
    Unit,
    build_library,
    explain_unavailable,
    format_bits,
    load_unit,
    make_client_command,
    read_recorded_drive,
    run_client,
    write_client_input,
)

pytestmark = pytest.mark.slow

ROWS, MIDDLE, SETTINGS = 260, 150, {ESTIMATOR: {"filter.particles": 100}, VEHICLE: {"simulation.seed": 4}}


def write_inputs(of: Unit, path: Path) -> Path:
    if of.identifier == ESTIMATOR:
        return write_client_input(
            read_recorded_drive(900).part(900 - ROWS, 900), of, path
        )  # moving, with lost channels
    lines = ["time," + ",".join(of.code(n) for n in DRIVER)]
    for k in range(ROWS):
        row = [
            0.01 * k,
            0.02 * (-1) ** (k // 50),
            700.0 * (-1) ** (k // 70),
            20.0 * (k % 5),
            100.0 * (k % 3),
            0.0,
            1.0 - 0.001 * k,
            0.3 * (k % 4),
            0.01 * (k % 5),
            -0.02 * (k % 3),
        ]
        assert len(row) == 1 + len(DRIVER)
        lines.append(",".join(format_bits(x) for x in row))
    path.write_text("\n".join(lines) + "\n")
    return path


def make_options(of: Unit, outputs: list[str] | None = None) -> list[str]:
    return ["--outputs", ",".join(of.code(n) for n in outputs or of.outputs)]


@pytest.fixture(scope="module", params=[ESTIMATOR, VEHICLE])
def reference(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict:
    """Return the drive on this machine, by the library that CMake built.

    A state is saved in the middle.
    """
    if why := explain_unavailable("linux64"):
        pytest.skip(why)
    of, folder = load_unit(request.param), tmp_path_factory.mktemp(request.param)
    settings = [
        x for name, value in SETTINGS[of.identifier].items() for x in ("--set", f"{of.code(name)}={value}")
    ]
    input_ = write_inputs(of, folder / "in.csv")
    text = run_client(
        make_client_command("linux64"),
        of.binary,
        of,
        input_,
        folder / "out.csv",
        *make_options(of),
        *settings,
        "--save",
        f"{folder / 'state'}@{MIDDLE}",
    )
    assert len(text.splitlines()) == ROWS + 1
    return {"unit": of, "input": input_, "text": text, "state": folder / "state", "settings": settings}


def run_on(target: str, reference: dict, tmp_path: Path, *more: str, version: str = "") -> str:
    """Return the client's output on the target for the same inputs; `version`: of FMI."""
    if why := explain_unavailable(target):
        pytest.skip(why)
    old = reference["unit"]
    of = load_unit(f"{old.identifier}{version}")
    return run_client(
        make_client_command(target),
        build_library(target, of),
        of,
        reference["input"],
        tmp_path / "out.csv",
        *make_options(of, old.outputs),
        *more,
    )


@pytest.mark.parametrize("target", RUNNERS)
def test_every_output_has_the_same_bits(reference: dict, target: str, tmp_path: Path) -> None:
    text = run_on(
        target, reference, tmp_path, *reference["settings"], "--save", f"{tmp_path / 'state'}@{MIDDLE}"
    )
    wrong = [
        i
        for i, (a, b) in enumerate(zip(text.splitlines(), reference["text"].splitlines(), strict=True))
        if a != b
    ]
    assert not wrong, f"{target} differs from row {wrong[0]} on"
    assert (tmp_path / "state").read_bytes() == reference["state"].read_bytes()


@pytest.mark.parametrize("target", RUNNERS)
def test_fmi_3_has_the_bits_of_fmi_2_there_and_its_state_goes_on(
    reference: dict, target: str, tmp_path: Path
) -> None:
    here, rows = (reference, tmp_path), reference["text"].splitlines()[1:]
    at = f"{tmp_path / 'state'}@{MIDDLE}"
    assert (
        run_on(target, *here, *reference["settings"], "--save", at, version="-fmi3").splitlines()[1:] == rows
    )
    if target != "win64":  # wine takes seconds
        assert run_on(target, *here, "--restore", at, version="-fmi3").splitlines()[1:] == rows[MIDDLE:]


@pytest.mark.parametrize("target", RUNNERS)
def test_a_state_saved_here_goes_on_there(reference: dict, target: str, tmp_path: Path) -> None:
    text = run_on(target, reference, tmp_path, "--restore", f"{reference['state']}@{MIDDLE}")
    assert text.splitlines()[1:] == reference["text"].splitlines()[1 + MIDDLE :]


@pytest.mark.parametrize("reference", [ESTIMATOR], indirect=True)  # wine takes 3 s: one of them is enough
@pytest.mark.parametrize("target", ["aarch64-linux", "win64"])
def test_a_damaged_state_is_refused_there(reference: dict, target: str, tmp_path: Path) -> None:
    damaged, state = tmp_path / "state", bytearray(reference["state"].read_bytes())
    state[len(state) // 2] ^= 1
    damaged.write_bytes(state)
    with pytest.raises(RuntimeError, match="checksum"):
        run_on(target, reference, tmp_path, "--restore", f"{damaged}@{MIDDLE}")


def test_channels_are_those_of_the_estimator() -> None:
    """So that write_inputs() sets all there are."""
    names = [v.name for v in load_unit(ESTIMATOR).description.modelVariables if v.causality == "input"]
    velocities = [
        "given",
        "ins_vel_x",
        "ins_vel_y",
        "gnss_speed",
        "gnss_course",
    ]  # at rest unless one is given
    pedals = ["given", "brake", "wheel_torque_front", "wheel_torque_rear"]
    assert names == [
        *CHANNELS,
        "missing",
        *(f"velocity.{v}" for v in velocities),
        *(f"pedals.{v}" for v in pedals),
        *(f"road.{v}" for v in ("given", "bank", "grade")),
    ]
    assert [v.name for v in load_unit(VEHICLE).description.modelVariables if v.causality == "input"] == DRIVER
