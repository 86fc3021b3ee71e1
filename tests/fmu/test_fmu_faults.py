"""Every fault as an importer sees it: FMPy raises, and the log names what was wrong."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import fmi2LastSuccessfulTime
from fmu_support import ESTIMATOR, VEHICLE, Instance, Unit, run, unit

from tselab.fmu.platforms import read_build

NAN = math.nan


def refused(instance: Instance, call: Callable[[], object], *words: str) -> None:
    """The call raises fmi2Error, and one line with these words was logged."""
    lines = len(instance.log)
    with pytest.raises(FMICallException) as error:
        call()
    assert error.value.status == 3
    assert len(instance.log) == lines + 1
    name, status, category, text = instance.log[-1]
    assert (name, status, category) == ("one", 3, "logStatusError")
    assert not [w for w in words if w not in text], text


def test_wrong_call_order(model: Unit) -> None:
    with Instance(model) as i:
        refused(i, lambda: i.step(0.0, 0.01), "fmi2DoStep", "before initialization")
        refused(i, i.slave.terminate, "fmi2Terminate", "before initialization")
        refused(i, i.slave.exitInitializationMode, "fmi2ExitInitializationMode")
        i.start()
        refused(i, i.slave.enterInitializationMode, "fmi2EnterInitializationMode", "while stepping")
        refused(i, i.slave.setupExperiment, "fmi2SetupExperiment", "while stepping")
        i.slave.terminate()
        refused(i, lambda: i.step(0.0, 0.01), "after fmi2Terminate")


def test_unknown_reference_and_wrong_type(model: Unit) -> None:
    with Instance(model) as i:
        refused(i, lambda: i.slave.getReal([99999]), "fmi2GetReal", "unknown value reference 99999")
        refused(i, lambda: i.slave.setReal([99999], [1.0]), "fmi2SetReal", "unknown value reference 99999")
        refused(i, lambda: i.slave.setInteger([0], [1]), "is of type Real, not Integer")
        refused(i, lambda: i.slave.getString([0]), "is of type Real, not String")


def test_null_argument(model: Unit) -> None:
    with Instance(model) as i:
        refused(i, lambda: i.slave.fmi2GetReal(i.slave.component, None, 1, None), "the argument vr is NULL")
        with pytest.raises(FMICallException):
            i.slave.fmi2DoStep(None, 0.0, 0.01, 1)


def test_wrong_guid_and_empty_name(model: Unit, capfd: pytest.CaptureFixture) -> None:
    for options in ({"guid": "{other}"}, {"name": ""}):
        with pytest.raises(Exception, match="Failed to instantiate"):
            Instance(model, **options)
    with Instance(model) as i:  # and the pool has not suffered
        i.start()


@pytest.mark.parametrize(("name", "parameter", "value", "words"), [
    (ESTIMATOR, "filter.forgetting", 1.5, "filter.forgetting = 1.5 is outside its range 0.9 .. 0.9999"),
    (ESTIMATOR, "filter.particles", 513, "filter.particles = 513 is outside its range 16 .. 512"),
    (ESTIMATOR, "vehicle.mass", NAN, "vehicle.mass = nan is outside its range 50 .. 50000 kg"),
    (VEHICLE, "simulation.speed", -1.0, "simulation.speed = -1 is outside its range 0 .. 70 m/s"),
    (VEHICLE, "vehicle.mass", math.inf, "vehicle.mass = inf is outside its range 50 .. 50000 kg"),
])  # fmt: skip
def test_parameter_out_of_range(name: str, parameter: str, value: float, words: str) -> None:
    with Instance(unit(name)) as i:
        before = i.get([parameter])
        refused(i, lambda: i.set({parameter: value}), words)
        assert i.get([parameter]) == before


def test_set_of_an_output_and_of_a_parameter_while_stepping(model: Unit) -> None:
    with Instance(model) as i:
        refused(i, lambda: i.slave.setReal([model.variables[model.outputs[0]].valueReference], [0.0]), "is an output")
        i.start()
        refused(i, lambda: i.set({"vehicle.mass": 1500.0}), "vehicle.mass is a fixed parameter", "while stepping")


def test_missing_sensor_is_a_warning_said_once(estimator: Unit) -> None:
    with Instance(estimator) as i:
        i.start({"filter.particles": 60}, {"wheel_speed_front": 60.0, "wheel_speed_rear": 60.0})
        assert [i.step(k * 0.01, 0.01) for k in range(3)] == [0, 0, 0]
        i.set({"steer_angle": NAN})
        assert [i.step(k * 0.01, 0.01) for k in range(3, 40)] == [1] * 37  # longer than max_gap
        held = i.get(["estimate.cx_front"])
        assert [i.step(k * 0.01, 0.01) for k in range(40, 45)] == [1] * 5
        assert i.get(["estimate.cx_front"]) == held
        assert i.get(["estimate.cx_front_reason", "estimate.valid"]) == {
            "estimate.cx_front_reason": 6,
            "estimate.valid": False,
        }
        assert len(i.log) == 1 and i.log[0][1:3] == (1, "logStatusWarning")
        assert "steer_angle is missing or outside its range" in i.texts()[0]


def test_wrong_input_of_the_vehicle_changes_nothing(vehicle: Unit) -> None:
    with Instance(vehicle) as i:
        i.start()
        i.step(0.0, 0.01)
        i.set({"road_level": NAN})
        before = i.state()
        refused(i, lambda: i.step(0.01, 0.01), "road_level is not a number, or outside its range 0.02 .. 10")
        assert i.state() == before
        i.set({"road_level": 1.0})
        i.step(0.01, 0.01)


def test_wrong_communication_points(model: Unit) -> None:
    with Instance(model) as i:
        i.start()
        i.step(0.0, 0.01)
        for time in (0.0, 0.02, NAN, math.inf):
            refused(i, lambda time=time: i.step(time, 0.01), "currentCommunicationPoint", "0.01")
        for size in (0.0, -0.01, NAN, math.inf):
            refused(i, lambda size=size: i.step(0.01, size), "communicationStepSize")
        assert i.slave.getRealStatus(fmi2LastSuccessfulTime) == 0.01


def test_damaged_truncated_and_foreign_states(estimator: Unit, vehicle: Unit) -> None:
    with Instance(estimator) as i, Instance(vehicle) as other:
        i.start()
        other.start()
        state = i.state()
        refused(i, lambda: i.restore(other.state()), "another FMU")
        refused(i, lambda: i.restore(state[:-1]), "size")
        refused(i, lambda: i.restore(state[:10]), "too short")
        refused(i, lambda: i.restore(state[:5000] + bytes([state[5000] ^ 4]) + state[5001:]), "checksum")
        refused(i, lambda: i.slave.setFMUstate(other.slave.getFMUstate()), "not a state that this FMU has saved")
        i.restore(state)


@pytest.mark.skipif(not shutil.which("cc"), reason="there is no compiler cc")
def test_a_state_of_other_sources_is_refused_though_the_description_is_the_same(vehicle: Unit, tmp_path: Path) -> None:
    folder = tmp_path / "other"
    shutil.copytree(vehicle.folder, folder)
    header = folder / "sources" / "fmu_guid.h"
    header.write_text(re.sub(r'(FMU_SOURCES ")\w', r"\1x", header.read_text()))
    files = [folder / "sources" / f for f in vehicle.description.buildConfigurations[0].sourceFileSets[0].sourceFiles]
    other = Unit.__new__(Unit)
    other.__dict__.update({**vehicle.__dict__, "folder": folder})
    run(
        "cc",
        *read_build(header.parent).flags,
        "-O0",
        "-fPIC",
        "-shared",
        "-I",
        header.parent,
        *files,
        "-o",
        other.binary,
        "-lm",
    )
    with Instance(vehicle) as i, Instance(other) as o:
        state = i.start().state()
        refused(o, lambda: o.restore(state), "the state of another FMU, or of another version of this one")
        i.restore(state)


def test_pools_of_instances_and_states(estimator: Unit, capfd: pytest.CaptureFixture) -> None:
    """32 instances and 64 states at once, as fmu/CMakeLists.txt says; whole again after freeing."""
    for _ in range(2):
        instances = [Instance(estimator, f"car {k}") for k in range(32)]
        with pytest.raises(Exception, match="Failed to instantiate"):
            Instance(estimator, "one too many")
        states = [i.slave.getFMUstate() for i in instances for _ in range(2)]
        with pytest.raises(FMICallException):
            instances[0].slave.getFMUstate()
        assert "all 64 saved states are in use" in instances[0].texts()[-1]
        assert len({s.value for s in states}) == 64
        for i in instances:
            i.free()


def test_log_categories(model: Unit) -> None:
    names = [c.name for c in model.description.logCategories]
    assert names == ["logStatusError", "logStatusWarning", "logEvents"]
    with Instance(model, logging=True) as i:
        i.start()
        i.slave.terminate()
        assert [(c, t) for _, _, c, t in i.log] == [
            ("logEvents", t) for t in ("instantiated", "initialized", "terminated")
        ]
    with Instance(model) as i:
        i.start()
        assert i.log == []
        i.slave.setDebugLogging(False, ["logStatusError"])
        with pytest.raises(FMICallException):
            i.step(5.0, 0.01)
        assert i.log == []
