"""The FMUs in importers: simulate_fmu() as a user calls it, validators and other clients.

FMPy also compiles the content of sources/.
"""

import functools
import os
import pickle
import shutil
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import importers
import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.build import build_platform_binary
from fmu_support import (
    CHANNELS,
    ESTIMATOR,
    MODELS,
    ROOT,
    VEHICLE,
    Instance,
    Unit,
    build,
    expect_same_rows,
    find_headers,
    load_unit,
    make_parameters,
    make_scratch_folder,
    read_recorded_drive,
    run,
    run_client,
    write_client_input,
)

from tse.library.files import lock_file
from tselab.fmu_build import get_lock

STOP = 2.0


@pytest.mark.parametrize("step_size", [0.005, 0.01, 0.02])
@pytest.mark.parametrize(
    "every", [1, 4]
)  # FMPy steps from output to output; 0.1 s would be as long as max_gap
def test_simulation_at_defaults(
    model: Unit, step_size: float, every: int, capfd: pytest.CaptureFixture
) -> None:
    """A run with nothing set reaches the stop time without a message.

    Outputs are numbers, and a second run gives the same ones. Messages are read where
    FMPy prints them, since with several `logger=` in one process FMPy calls the last,
    also after it is gone.
    """
    results = [
        simulate_fmu(str(model.fmu), stop_time=STOP, step_size=step_size, output_interval=every * step_size,
                     output=model.outputs)
        for _ in range(2)
    ]  # fmt: skip
    assert "".join(capfd.readouterr()) == ""
    assert np.array_equal(*results)
    assert len(results[0]) == round(STOP / (every * step_size)) + 1
    assert results[0]["time"][-1] == pytest.approx(STOP)
    for name in results[0].dtype.names:
        assert np.isfinite(results[0][name]).all(), name


def make_drive_table(rows: int) -> np.ndarray:
    """Return the recorded drive as FMPy takes inputs.

    A channel that is missing in some rows is interpolated between its neighbours.
    """
    log = read_recorded_drive(rows)
    table = np.zeros(rows, [(n, float) for n in ("time", *CHANNELS)])
    table["time"] = np.arange(rows) * 0.01
    for i, name in enumerate(CHANNELS):
        there = np.isfinite(log.channels[:, i])
        table[name] = (
            np.interp(np.arange(rows), np.flatnonzero(there), log.channels[there, i]) if there.any() else 0.0
        )
    return table


def test_an_importer_that_sets_all_start_values_gets_the_same(estimator: Unit) -> None:
    """FMPy can set all start values.

    A car of which only the mass is known stays an ordinary one; it does not become
    exactly known.
    """
    table = make_drive_table(600)
    how = {
        "stop_time": 5.9,
        "step_size": 0.01,
        "output_interval": 0.01,
        "input": table,
        "output": estimator.outputs,
    }
    plain, all_set, known = (
        simulate_fmu(
            str(estimator.fmu),
            start_values={"vehicle.mass": 1650.0, **known},
            apply_default_start_values=all_,
            **how,
        )
        for all_, known in ((False, {}), (True, {}), (True, {"vehicle.exact": True}))
    )
    assert np.array_equal(plain, all_set)
    nominal = "estimate.nominal.cy_front"
    assert known[nominal][-1] == 1.2e5 != plain[nominal][-1]
    assert known["estimate.cy_front_sd"][0] != plain["estimate.cy_front_sd"][0]


def test_default_experiment(model: Unit) -> None:
    result = simulate_fmu(str(model.fmu))
    assert result["time"][-1] == pytest.approx(10.0) and len(result) > 500


def test_inputs_of_a_table_reach_the_estimator(estimator: Unit) -> None:
    """FMPy interpolates between rows; at the rows' own times it sets what they hold."""
    table = make_drive_table(400)
    result = simulate_fmu(
        str(estimator.fmu),
        stop_time=3.9,
        step_size=0.01,
        output_interval=0.01,
        input=table,
        output=["estimate.vel_x"],
    )
    speed = 0.33 * np.interp(result["time"], table["time"], table["wheel_speed_front"])
    assert np.abs(result["estimate.vel_x"][1:] - speed[:-1]).max() < 0.3 and speed.max() > 1


def test_input_derivatives_of_the_vehicle(vehicle: Unit) -> None:
    """With input derivatives, a linear input is met at the end of each step.

    simulate_fmu() is not used, because FMPy 0.3.32 takes derivatives for exactly nine
    inputs.
    """
    assert vehicle.description.coSimulation.canInterpolateInputs
    reference = [vehicle.variables["steer_angle"].valueReference]
    with Instance(vehicle) as instance:
        instance.start({"ramp": False})
        for k in range(100):
            instance.slave.setReal(reference, [0.0002 * k])
            instance.slave.setRealInputDerivatives(reference, [1], [0.02])
            instance.step(k * 0.01, 0.01)
            assert instance.get(["sensor.steer_angle"])["sensor.steer_angle"] == pytest.approx(
                0.0002 * (k + 1), rel=1e-12
            )


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("make"), reason="make, which FMPy's CMake build takes, is not installed")
@pytest.mark.skipif(
    not shutil.which("c++"), reason="a C++ compiler, which FMPy's CMake build takes, is not installed"
)
def test_fmpy_compiles_the_sources_and_gets_the_same_bits(estimator: Unit, tmp_path: Path) -> None:
    """The longer one; the other's sources are compiled by test_fmu_platforms.py."""
    model = estimator
    folder, build = tmp_path / "with space ü", tmp_path / "build"
    shutil.copytree(model.folder, folder)
    shutil.rmtree(folder / "binaries")
    build.mkdir()
    build_platform_binary(folder, build)
    compiled = Unit.__new__(Unit)
    compiled.__dict__.update({**model.__dict__, "folder": folder})
    assert compiled.binary.is_file()
    with Instance(model) as a, Instance(compiled) as b:
        for i in (a, b):
            i.start({"vehicle.mass": 1600.0})
        for k in range(200):
            for i in (a, b):
                values = {
                    "wheel_speed_front": 50 + np.sin(0.3 * k),
                    "wheel_speed_rear": 50.0,
                    "accel_x": np.sin(k),
                }
                i.set({"steer_angle": 0.02 * np.sin(0.1 * k), **values})
                i.step(k * 0.01, 0.01)
            expect_same_rows([a.get()], [b.get()])
        assert a.state() == b.state()


def test_the_small_client_agrees_with_fmpy(estimator: Unit, tmp_path: Path) -> None:
    """tests/fmu/client.c on this machine is the reference of the other platforms."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    client = tmp_path / "client"
    run(
        compiler, "-std=c99", "-I", find_headers(), Path(__file__).with_name("client.c"), "-o", client, "-ldl"
    )
    log = read_recorded_drive(300)
    text = run_client(
        [str(client)],
        estimator.binary,
        estimator,
        write_client_input(log, estimator, tmp_path / "in.csv"),
        tmp_path / "out.csv",
        "--set",
        f"{estimator.code('filter.particles')}=100",
    )
    lines = [line.split(",") for line in text.splitlines()]
    at = {name: lines[0].index(estimator.code(name)) for name in estimator.outputs}
    assert len(lines[0]) == 2 + len(estimator.variables)  # all there are, found by trying
    got = [{n: parse_value(line[k]) for n, k in at.items()} for line in lines[1:]]
    with Instance(estimator) as instance:
        instance.start({"filter.particles": 100})
        expect_same_rows(got, log.through_fmu(instance))


def parse_value(cell: str) -> float:
    return struct.unpack(">d", bytes.fromhex(cell[1:]))[0] if cell.startswith("x") else int(cell)


# ---- validators and other clients


FMUS = [*MODELS, *(f"{m}-fmi3" for m in MODELS)]


@pytest.mark.parametrize("name", FMUS)
def test_validators_find_nothing(name: str) -> None:
    verdicts = [v for v in importers.validate(load_unit(name).fmu) if not v.skipped]
    assert {"FMPy validate_fmu", "fmutool -check", "XML schema"} <= {v.validator for v in verdicts}
    assert [text for v in verdicts for text in v.findings] == []


@functools.cache
def run_reference(name: str) -> np.ndarray:
    return importers.in_process("FMPy", load_unit(name))


@pytest.mark.parametrize("name", FMUS)
@pytest.mark.parametrize("client", importers.CLIENTS)
def test_a_client_gets_the_same_bits(client: str, name: str) -> None:
    row = importers.compare_one(client, load_unit(name), run_reference(name))
    if not row.ran:
        pytest.skip(f"{row.client}: {row.says.removeprefix('skipped: ')}")
    assert row.says == "same bits"


def test_a_description_that_is_wrong_is_found_by_each_validator(vehicle: Unit, tmp_path: Path) -> None:
    broken = tmp_path / "broken.fmu"
    with zipfile.ZipFile(vehicle.fmu) as old, zipfile.ZipFile(broken, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "modelDescription.xml":  # a name twice, and an attribute that nobody knows
                assert b'name="steer_angle"' in data
                data = data.replace(b'name="steer_angle"', b'name="ramp" odd="1"', 1)
            new.writestr(name, data)
    found = {v.validator: v.findings for v in importers.validate(broken) if not v.skipped}
    assert all(found.values()), found


def test_a_difference_is_measured_against_the_size_of_an_output() -> None:
    reference = np.array([[1.0, 200.0, np.nan], [2.0, -400.0, np.nan]])
    other = reference + np.array([[0.0, 0.0, 0.0], [0.0, 1e-6, 0.0]])

    def crash() -> np.ndarray:
        raise importers.Failed("it crashed")

    for values, says in (
        (reference.copy(), "same bits"),
        (other, "2.5e-09"),
        (reference[1:], "failed: 1 steps instead of 2"),
    ):
        assert importers.describe_difference(lambda v=values: v, reference) == says
    assert importers.describe_difference(lambda: np.nan_to_num(reference), reference).startswith(
        "failed: no number"
    )
    assert importers.describe_difference(crash, reference) == "failed: it crashed"


# ---- The estimator as an FMU in the numbers of a controller: TSE_REAL=fixed and float,
# beside a vehicle in double.


PARTICLES = 64


def build_format(real: str) -> Path:
    """Build the FMUs quickly, which changes no bit; return their folder."""
    return build(
        f"fmu-{real}-test",
        f"-DTSE_REAL={real}",
        f"-DTSE_MAX_PARTICLES={PARTICLES}",
        "-DCMAKE_BUILD_TYPE=Debug",
    )


@functools.cache  # a binary that is loaded is not to be written again
def load_estimator(real: str) -> Unit:
    return Unit(build_format(real) / f"{ESTIMATOR}.fmu", make_scratch_folder() / real)


@functools.cache
def find_library(real: str) -> Path:
    """Return the shared library of this format, built likewise."""
    where = ROOT / "build" / f"lab-{real}-test"
    with lock_file(get_lock(where)):
        options = [f"-DTSE_REAL={real}", f"-DTSE_MAX_PARTICLES={PARTICLES}", "-DCMAKE_BUILD_TYPE=Debug"]
        generator = (
            [] if (where / "CMakeCache.txt").is_file() or not shutil.which("ninja") else ["-G", "Ninja"]
        )
        run("cmake", "--preset", "lab", "-B", where, *generator, *options, cwd=ROOT)
        run("cmake", "--build", where, cwd=ROOT)
    return next(p for p in (where / "src").glob("libtse.*") if p.suffix in (".so", ".dylib"))


IN_THE_LIBRARY = """
import pickle, sys
from fmu_support import compute_expected_outputs, read_recorded_drive
from tse.library.core import Config
settings, ordinary = pickle.loads(sys.stdin.buffer.read())
config = Config(settings).complete() if ordinary else Config.exact(settings)
rows = read_recorded_drive().through_library(config)
sys.stdout.buffer.write(pickle.dumps([compute_expected_outputs(row, config) for row in rows]))
"""


# An ordinary car is computed in the numbers of the format. Python hands the settings of a
# fixed-point library over in single precision.
@pytest.mark.slow
@pytest.mark.parametrize(("real", "exact"), [("fixed", True), ("float", True), ("float", False)])
def test_the_recorded_drive_as_the_library_of_that_format_has_it(real: str, exact: bool) -> None:
    unit, settings = load_estimator(real), {"mass": 1650.0, "lf": 1.2, "driven_axle": 1}
    assert f"computes in {real}" in unit.description.description
    done = subprocess.run(
        [sys.executable, "-c", IN_THE_LIBRARY],
        input=pickle.dumps((settings, not exact)),
        capture_output=True,
        cwd=Path(__file__).parent,
        timeout=300,
        env={**os.environ, "TSELAB_LIBRARY": str(find_library(real))},
    )
    assert done.returncode == 0, done.stderr.decode()
    log = read_recorded_drive()
    with Instance(unit) as instance:
        instance.start({**make_parameters(settings, unit), "vehicle.exact": exact}, time=float(log.time[0]))
        expect_same_rows(log.through_fmu(instance), pickle.loads(done.stdout))


@pytest.mark.slow
def test_parameters_are_kept_to_the_edges_of_their_ranges() -> None:
    """Both ends of a range are accepted, also where the format cannot hold them.

    They read back within the resolution of the format.
    """
    unit = load_estimator("fixed")
    for name in ("filter.hold_speed", "vehicle.mass", "sensors.accel_x_sd"):
        v = unit.variables[name]
        for edge in (float(v.min), float(v.max)):
            with Instance(unit) as instance:
                instance.set({name: edge})
                assert instance.get([name])[name] == pytest.approx(edge, rel=2**-24, abs=2**-32)


@pytest.mark.slow
def test_the_capacity_that_was_asked_for_is_that_of_the_binary() -> None:
    unit = load_estimator("fixed")
    assert int(unit.variables["filter.particles"].max) == PARTICLES
    with Instance(unit) as instance, pytest.raises(Exception, match="fmi2SetInteger failed"):
        instance.set({"filter.particles": PARTICLES + 1})


@pytest.mark.slow
def test_the_vehicle_beside_it_is_the_one_of_the_double_build(vehicle: Unit) -> None:
    beside = Unit(build_format("fixed") / f"{VEHICLE}.fmu", make_scratch_folder() / "vehicle-beside-fixed")
    assert beside.guid == vehicle.guid
    how = [(u.folder / "sources" / "buildDescription.xml").read_text() for u in (beside, vehicle)]
    assert (
        how[0].replace(f'TSE_MAX_PARTICLES" value="{PARTICLES}"', 'TSE_MAX_PARTICLES" value="512"') == how[1]
    )
    assert 'TSE_REAL_DOUBLE" value="1"' in how[1]
