"""The system that connects both FMUs: its description, and its results in an importer.

The results are those of two FMUs stepped by hand.
"""

import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fmu_support import ESTIMATOR, VEHICLE, Instance, load_unit

from tse.library.errors import UserError
from tselab.cli import cli
from tselab.fmu import format_parameter_set, read_parameters

fmpy_ssp = pytest.importorskip("fmpy.ssp.simulation", reason="FMPy is not installed")
ROOT = Path(__file__).resolve().parents[2]
STEP, STEPS = 1 / 128, 512  # s


@pytest.fixture(scope="module")
def ssp(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As `tselab fmu build` packs it."""
    from tselab.fmu_build import build

    out = tmp_path_factory.mktemp("system")
    build(out, (), None, lambda _: None)
    return out / "StiffnessStudy.ssp"


def get_steering(time: float) -> float:
    return 0.02 if time % 2 < 1 else -0.02


def get_torque(time: float) -> float:
    return 300.0 if time % 1 < 0.5 else -300.0


def test_the_description_is_valid_and_every_connector_is_a_variable_of_its_fmu(ssp, tmp_path):
    from fmpy import read_model_description
    from fmpy.ssp.ssd import read_ssd

    system = read_ssd(str(ssp), validate=True)  # against the XML schema of SSP 1.0
    with zipfile.ZipFile(ssp) as file:
        file.extractall(tmp_path)
    units = {u.name for u in system.units}
    text = (tmp_path / "SystemStructure.ssd").read_text(encoding="utf-8")
    assert {part.split('"')[0] for part in text.split('unit="')[1:]} == units
    for component in system.system.elements:
        description = read_model_description(str(tmp_path / component.source))
        variables = {v.name: v for v in description.modelVariables}
        for connector in component.connectors:
            assert variables[connector.name].causality == connector.kind
    inputs = {c.name for c in system.system.elements[1].connectors if c.kind == "input"}
    assert {c.endConnector for c in system.system.connections if c.endElement == "estimator"} == inputs


def read_known_car(ssp):
    """Return the system's parameters of the estimator in the form FMPy takes.

    FMPy reads the parameters of a system and does not apply them.
    """
    from fmpy.ssp.ssd import Parameter, ParameterSet, read_ssd

    vehicle, estimator = read_ssd(str(ssp)).system.elements
    assert vehicle.parameterBindings == []
    (binding,) = estimator.parameterBindings
    (values,) = binding.parameterValues
    assert (binding.source, values.name) == ("resources/vehicle.ssv", "the car of the paper's study")
    of_estimator = [
        Parameter(name=f"estimator.{p.name}", type=p.type, value=p.value) for p in values.parameters
    ]
    return ParameterSet(name=values.name, parameters=of_estimator)


def test_the_vehicle_of_the_system_is_that_of_the_study_and_current(ssp):
    from tse.library.core import Config

    parameters = read_parameters(ssp.with_name("TireStiffnessEstimator.fmu"))
    text = format_parameter_set(parameters, Config.exact().as_dict(), "the car of the paper's study")
    assert (ROOT / "fmu" / "vehicle.ssv").read_text(encoding="utf-8") == text


@pytest.mark.parametrize("of", ["TireStiffnessEstimator.fmu", "TireStiffnessEstimator-fmi3.fmu"])
def test_a_vehicle_file_becomes_the_parameters_of_its_settings(of, ssp, tmp_path):
    """What is left out of the set is at its start."""
    from fmpy.ssp.ssd import read_ssv

    from tse.car.config import make_config
    from tse.car.vehicle import read_vehicle
    from tse.report.tables import example_vehicle

    (tmp_path / "car.toml").write_text(example_vehicle(), encoding="utf-8")
    command = ["fmu", "parameters", str(ssp.with_name(of)), "--vehicle", str(tmp_path / "car.toml")]
    done = CliRunner().invoke(cli, [*command, "--out", str(tmp_path / "car.ssv")], standalone_mode=False)
    assert done.exception is None, done.exception
    given = {p.name: p for p in read_ssv(str(tmp_path / "car.ssv")).parameters}  # against the XML schema
    config, _ = make_config(read_vehicle(tmp_path / "car.toml"), None)
    parameters = {p.name: p for p in read_parameters(ssp.with_name(of)) if p.name != "vehicle.exact"}
    assert "vehicle.exact" not in given and len(given) >= 11  # of an ordinary car
    assert {name.partition(".")[2].replace(".", "_") for name in parameters} == set(config.as_dict())
    for name, p in parameters.items():
        value = config.as_dict()[name.partition(".")[2].replace(".", "_")]
        assert float(given[name].value if name in given else p.start) == value, name


def test_what_is_not_the_estimator_is_refused(ssp, tmp_path):
    (tmp_path / "text.fmu").write_text("no zip file")
    for path, words in (
        (ssp.with_name("SingleTrackVehicle.fmu"), "is not the FMU of the estimator"),
        (ssp, "is not an FMU"),
        (tmp_path / "text.fmu", "is not an FMU"),
        (tmp_path / "none.fmu", "no such file"),
    ):
        with pytest.raises(UserError, match=words):
            read_parameters(path)


def test_fmpy_simulates_the_system_as_two_fmus_stepped_by_hand(ssp):
    drive = {
        "steer_angle": get_steering,
        "wheel_torque_front": get_torque,
        "wheel_torque_rear": lambda _: 0.0,
    }
    result = fmpy_ssp.simulate_ssp(
        str(ssp), stop_time=STEP * STEPS, step_size=STEP, parameter_set=read_known_car(ssp), input=drive
    )
    assert len(result) == STEPS
    by_hand = step_by_hand()
    for name in by_hand.dtype.names:
        assert np.array_equal(result[name], by_hand[name]), name
    # the connection carries something
    assert len(set(result["estimator.estimate.cy_front"])) > STEPS / 2


def test_the_example_of_the_guide_comes_to_the_truth_and_says_why_it_restarts(ssp, monkeypatch, capfd):
    text = (ROOT / "docs" / "pages" / "use" / "fmu.md").read_text(encoding="utf-8")
    body = re.search(r"### FMPy, both connected.*?```python\n(.*?)```", text, re.S)[1]
    monkeypatch.chdir(ssp.parent)
    exec(compile(body, "fmu.md", "exec"), {})
    said = capfd.readouterr()
    numbers = [float(x) / 1000 for x in said.out.splitlines()[-1].split()]
    assert "{:.0f} and {:.0f} kN/rad".format(*numbers) in body
    assert "jump of the wheel speeds" in said.out + said.err


def step_by_hand() -> np.ndarray:
    """Step all FMUs with their present inputs, then copy outputs to inputs (as FMPy)."""
    sensors = ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate")
    stiffness = ("cx_front", "cy_front", "cy_rear")
    truth, estimate = [f"true.{s}" for s in stiffness], [f"estimate.{s}" for s in stiffness]
    rows = []
    with Instance(load_unit(VEHICLE)) as vehicle, Instance(load_unit(ESTIMATOR)) as estimator:
        vehicle.start()
        estimator.start({"vehicle.exact": True})
        driver, measured = (
            {"steer_angle": 0.0, "wheel_torque_front": 0.0, "wheel_torque_rear": 0.0},
            dict.fromkeys(sensors, 0.0),
        )
        for i in range(STEPS):
            time = i * STEP
            vehicle.set(driver)
            vehicle.step(time, STEP)
            estimator.set(measured)
            estimator.step(time, STEP)
            values = vehicle.get([*truth, *(f"sensor.{s}" for s in sensors)])
            rows.append((*(values[n] for n in truth), *estimator.get(estimate).values()))
            measured = {s: values[f"sensor.{s}"] for s in sensors}
            driver = {
                "steer_angle": get_steering(time),
                "wheel_torque_front": get_torque(time),
                "wheel_torque_rear": 0.0,
            }
    names = [*(f"vehicle.{n}" for n in truth), *(f"estimator.{n}" for n in estimate)]
    return np.array(rows, dtype=[(n, float) for n in names])
