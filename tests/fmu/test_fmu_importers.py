"""FMPy's own ways: simulate_fmu() as a user calls it, and compiling what is in sources/."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.build import build_platform_binary
from fmu_support import CHANNELS, Instance, Unit, client_input, expect_same_rows, recorded_drive, run_client

STOP = 2.0


@pytest.mark.parametrize("step_size", [0.005, 0.01, 0.02])
@pytest.mark.parametrize("every", [1, 4])  # FMPy steps from output to output; 0.1 s would be as long as max_gap
def test_simulation_at_defaults(model: Unit, step_size: float, every: int, capfd: pytest.CaptureFixture) -> None:
    """Nothing set, nothing said, to the stop time; outputs are numbers, and a second run gives the same ones. (What is said
    is read where FMPy prints it: of several `logger=` in one process it calls the last, also after it is gone.)"""
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


def test_an_importer_that_sets_all_start_values_gets_the_same(estimator: Unit) -> None:
    """FMPy can; a car of which only the mass is known stays an ordinary one, and is not one that is known exactly."""
    log = recorded_drive(600)
    table = np.zeros(600, [(n, float) for n in ("time", *CHANNELS)])
    table["time"] = np.arange(600) * 0.01
    for i, name in enumerate(CHANNELS):
        table[name] = np.nan_to_num(log.channels[:, i])
    how = {"stop_time": 5.9, "step_size": 0.01, "output_interval": 0.01, "input": table, "output": estimator.outputs}
    plain, all_set, known = (
        simulate_fmu(
            str(estimator.fmu), start_values={"vehicle.mass": 1650.0, **known}, apply_default_start_values=all_, **how
        )
        for all_, known in ((False, {}), (True, {}), (True, {"vehicle.calibrated": True}))
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
    log = recorded_drive(400)
    table = np.zeros(400, [(n, float) for n in ("time", *CHANNELS)])
    table["time"] = np.arange(400) * 0.01
    for i, name in enumerate(CHANNELS):  # a channel that is not there in a row keeps what it said
        there = np.isfinite(log.channels[:, i])
        table[name] = np.interp(np.arange(400), np.flatnonzero(there), log.channels[there, i]) if there.any() else 0.0
    result = simulate_fmu(str(estimator.fmu), stop_time=3.9, step_size=0.01, output_interval=0.01, input=table,
                          output=["estimate.vel_x"])  # fmt: skip
    speed = 0.33 * np.interp(result["time"], table["time"], table["wheel_speed_front"])
    assert np.abs(result["estimate.vel_x"][1:] - speed[:-1]).max() < 0.3 and speed.max() > 1


def test_input_derivatives_of_the_vehicle(vehicle: Unit) -> None:
    """An importer that gives them has a linear input met at the end of each step. (Not through simulate_fmu(): FMPy 0.3.32
    takes derivatives for exactly nine inputs.)"""
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


@pytest.mark.skipif(not shutil.which("make"), reason="make, which FMPy's CMake build takes, is not installed")
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
                values = {"wheel_speed_front": 50 + np.sin(0.3 * k), "wheel_speed_rear": 50.0, "accel_x": np.sin(k)}
                i.set({"steer_angle": 0.02 * np.sin(0.1 * k), **values})
                i.step(k * 0.01, 0.01)
            expect_same_rows([a.get()], [b.get()])
        assert a.state() == b.state()


def test_the_small_client_agrees_with_fmpy(estimator: Unit, tmp_path: Path) -> None:
    """tests/fmu/client.c, compiled by the machine's own compiler: what other platforms are compared with."""
    from fmu_support import headers, run

    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    client = tmp_path / "client"
    run(compiler, "-std=c99", "-I", headers(), Path(__file__).with_name("client.c"), "-o", client, "-ldl")
    log = recorded_drive(300)
    text = run_client([str(client)], estimator.binary, estimator, client_input(log, estimator, tmp_path / "in.csv"),
                      tmp_path / "out.csv", "--set", f"{estimator.code('filter.particles')}=100")  # fmt: skip
    lines = [line.split(",") for line in text.splitlines()]
    at = {name: lines[0].index(estimator.code(name)) for name in estimator.outputs}
    assert len(lines[0]) == 2 + len(estimator.variables)  # all there are, found by trying
    got = [{n: _value(line[k]) for n, k in at.items()} for line in lines[1:]]
    with Instance(estimator) as instance:
        instance.start({"filter.particles": 100})
        expect_same_rows(got, log.through_fmu(instance))


def _value(cell: str) -> float:
    import struct

    return struct.unpack(">d", bytes.fromhex(cell[1:]))[0] if cell.startswith("x") else int(cell)
