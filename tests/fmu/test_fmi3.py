"""The FMUs of FMI 3.0: what they say is what those of 2.0 say, and more; what they compute has the same bits, everywhere."""

from __future__ import annotations

import re
import shutil
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.fmi1 import FMICallException
from fmu_support import (
    CHANNELS,
    DRIVER,
    ESTIMATOR,
    MODELS,
    RUNNERS,
    VEHICLE,
    Instance,
    Instance3,
    Unit,
    bits,
    client_for,
    client_input,
    expect_same_rows,
    exported,
    headers,
    library_for,
    recorded_drive,
    run_client,
    same,
    unavailable,
    unit,
)

if not headers("3").is_dir():
    pytest.skip("scripts/setup.sh has not put the FMI 3.0 headers into .venv/share", allow_module_level=True)

TYPES = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean", "Enumeration": "Enumeration"}
STIFFNESS = ("cx_front", "cy_front", "cy_rear")


def three(model: str) -> Unit:
    return unit(f"{model}-fmi3")


@pytest.fixture(params=MODELS)
def name(request: pytest.FixtureRequest) -> str:
    return request.param


# ---- what they say


def test_every_variable_of_2_is_there_with_name_reference_and_all_that_is_said_of_it(name: str) -> None:
    two, new = unit(name), three(name)
    for old in two.description.modelVariables:
        v = new.variables[old.name]
        said = (
            "valueReference",
            "description",
            "causality",
            "variability",
            "unit",
            "displayUnit",
            "min",
            "max",
            "start",
        )
        assert {a: getattr(v, a) for a in said} == {a: getattr(old, a) for a in said}
        assert v.type == TYPES[old.type] and not v.dimensions
        assert (v.declaredType and v.declaredType.name) == (old.declaredType and old.declaredType.name)
    more = [v for n, v in new.variables.items() if n not in two.variables]
    assert [v.valueReference for v in new.description.modelVariables] == list(range(len(new.variables)))
    assert more[-1].name == "time" and more[-1].causality == "independent" and more[-1].unit == "s"
    assert more[:-1] and all(v.dimensions and v.causality == "output" and v.description for v in more[:-1])
    assert new.description.guid != two.description.guid and new.description.fmiVersion == "3.0"
    cs = new.description.coSimulation
    assert cs.canGetAndSetFMUstate and cs.canSerializeFMUstate and cs.canHandleVariableCommunicationStepSize
    assert not (cs.hasEventMode or cs.providesIntermediateUpdate or cs.canReturnEarlyAfterIntermediateUpdate)


def test_structure_names_every_output_once_and_what_it_depends_on(name: str) -> None:
    root = ElementTree.parse(three(name).folder / "modelDescription.xml")
    outputs = [v.get("valueReference") for v in root.find("ModelVariables") if v.get("causality") == "output"]
    for element, dependencies in (("Output", ""), ("InitialUnknown", None)):
        unknowns = root.findall(f"ModelStructure/{element}")
        assert [u.get("valueReference") for u in unknowns] == outputs
        assert {u.get("dependencies") for u in unknowns} == {dependencies}


def terminals(model: str) -> dict[str, dict[str, str]]:
    """Per kind of terminal its members and their variables."""
    root = ElementTree.parse(three(model).folder / "terminalsAndIcons" / "terminalsAndIcons.xml")
    return {
        t.get("terminalKind"): {m.get("memberName"): m.get("variableName") for m in t.findall("TerminalMemberVariable")}
        for t in root.findall("Terminals/Terminal")
    }


def test_the_terminals_of_both_connect_what_the_system_connects(name: str) -> None:
    ssd = ElementTree.parse(Path(__file__).parents[2] / "fmu" / "StiffnessStudy.ssd")
    wanted = {
        (c.get("startConnector"), c.get("endConnector"))
        for c in ssd.iter("{http://ssp-standard.org/SSP1/SystemStructureDescription}Connection")
        if (c.get("startElement"), c.get("endElement")) == ("vehicle", "estimator")
    }
    out, into = terminals(VEHICLE)["_tse_sensors"], terminals(ESTIMATOR)["_tse_sensors"]
    assert {(out[member], variable) for member, variable in into.items()} == wanted and out.keys() == into.keys()
    for members in terminals(name).values():
        assert members and set(members.values()) <= set(three(name).variables)
    assert set(terminals(VEHICLE)["_tse_driver"]) == set(DRIVER)
    assert set(STIFFNESS) <= terminals(VEHICLE)["_tse_truth"].keys() & terminals(ESTIMATOR)["_tse_estimate"].keys()


@pytest.mark.skipif(not shutil.which("nm"), reason="nm is not installed")
def test_the_functions_of_fmi_3_are_exported_and_nothing_else(name: str) -> None:
    declared = re.findall(r"^FMI3_Export \w+\s+(fmi3\w+);", (headers("3") / "fmi3Functions.h").read_text(), flags=re.M)
    assert exported(three(name).binary) == set(declared) and len(declared) > 70


def test_the_page_speaks_of_this_version(name: str) -> None:
    text = (three(name).folder / "documentation" / "index.html").read_text(encoding="utf-8")
    assert "FMI 3.0" in text and "fmi3DoStep" in text and "fmi2" not in text and three(name).guid in text
    assert not re.search(r"@\w+@|<!--/?[23]-->", text)
    listed = re.findall(r"<tr><td><code>([\w.<>]+)</code></td><td>(?:Float64|Int32|Boolean|Enumeration)", text)
    assert {n.replace("<wbr>", "") for n in listed} == set(three(name).variables)


# ---- what they compute


def rows_of_vehicle(n: int) -> Iterator[dict[str, float]]:
    for k in range(n):
        yield {"steer_angle": 0.02 * (-1) ** (k // 50), "wheel_torque_front": 700.0 * (-1) ** (k // 70),
               "brake_torque_rear": 20.0 * (k % 5), "road_level": 1.0 - 0.001 * k, "road_friction": 1.0}  # fmt: skip


def test_the_estimator_has_the_bits_of_2_over_a_drive_with_lost_channels() -> None:
    old, new, log = unit(ESTIMATOR), three(ESTIMATOR), recorded_drive(900).part(600, 900)
    with Instance(old) as a, Instance3(new) as b:
        a.start({"filter.seed": 7}, time=float(log.time[0]))
        b.set({"filter.seed": 7})
        b.slave.enterInitializationMode(startTime=float(log.time[0]))
        b.slave.exitInitializationMode()
        seen = []
        for i in range(len(log)):
            channels = dict(zip(CHANNELS, log.channels[i], strict=True))
            a.set(channels)
            b.set(channels)
            a.step(float(log.time[i]), log.step(i))
            b.slave.doStep(float(log.time[i]), log.step(i))
            seen.append(b.get(old.outputs))
            expect_same_rows([seen[-1]], [a.get()])
            arrays = b.get(
                ["estimate.relative.stiffness", "estimate.stiffness_valid", "estimate.stiffness_reason", "time"]
            )
            row = seen[-1]
            for x, s in zip(arrays["estimate.relative.stiffness"], STIFFNESS, strict=True):
                assert same(x, row[f"estimate.relative.{s}"])
            assert arrays["estimate.stiffness_valid"] == [row[f"estimate.{s}_valid"] for s in STIFFNESS]
            assert arrays["estimate.stiffness_reason"] == [row[f"estimate.{s}_reason"] for s in STIFFNESS]
            assert arrays["time"] == float(log.time[i]) + log.step(i)
    assert np.isnan(log.channels).any() and len({r["estimate.cy_front"] for r in seen}) > 100


def test_the_vehicle_has_the_bits_of_2() -> None:
    old, new = unit(VEHICLE), three(VEHICLE)
    with Instance(old) as a, Instance3(new) as b:
        a.start({"simulation.seed": 3})
        b.start({"simulation.seed": 3})
        for k, inputs in enumerate(rows_of_vehicle(200)):
            for instance in (a, b):
                instance.set(inputs)
            a.step(k * 0.01, 0.01)
            b.slave.doStep(k * 0.01, 0.01)
            expect_same_rows([b.get(old.outputs)], [a.get()])


def test_fmpy_simulates_both_versions_to_the_same_result(name: str) -> None:
    wanted = [n for n in unit(name).outputs if not n.endswith("_reason")]
    how = {"stop_time": 1.0, "step_size": 0.01, "output_interval": 0.01, "output": wanted}
    results = [simulate_fmu(str(of.fmu), **how) for of in (unit(name), three(name))]
    for n in wanted:
        assert np.array_equal(results[0][n], results[1][n]), n


# ---- what they refuse


def test_a_refused_call_says_why_and_the_instance_goes_on(name: str) -> None:
    of = three(name)
    with pytest.raises(Exception, match="Failed to instantiate"):
        Instance3(of, token="{other}")
    with pytest.raises(Exception, match="Failed to instantiate"):
        Instance3(of, events=True)
    array = next(v for v in of.description.modelVariables if v.dimensions and v.type == "Float64")
    with Instance3(of) as instance:
        instance.start()
        with pytest.raises(FMICallException):
            instance.slave.getFloat64([array.valueReference])  # room for one value
        assert instance.log[-1][:2] == (3, "logStatusError") and "the variables have 3 values" in instance.log[-1][2]
        with pytest.raises(FMICallException):
            instance.slave.doStep(0.5, 0.01)
        assert "currentCommunicationPoint = 0.5" in instance.log[-1][2]
        instance.slave.doStep(0.0, 0.01)
        assert instance.get(["time"])["time"] == 0.01


def test_states_are_refused_by_the_other_version(name: str) -> None:
    """They hold the same, but the sources are not the same, and so nobody has tried."""
    with Instance(unit(name)) as a, Instance3(three(name)) as b:
        a.start()
        b.start()
        with pytest.raises(FMICallException):
            b.slave.deserializeFMUState(a.state())
        assert "the state of another FMU" in b.log[-1][2]


# ---- on other platforms

ROWS, MIDDLE = 120, 70


@pytest.fixture(scope="module", params=MODELS)
def reference(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict:
    """The drive on this machine, by the binary of FMI 2.0."""
    if why := unavailable("linux64"):
        pytest.skip(why)
    old, folder = unit(request.param), tmp_path_factory.mktemp(request.param)
    if request.param == ESTIMATOR:
        input_ = client_input(recorded_drive(900).part(900 - ROWS, 900), old, folder / "in.csv")
    else:
        lines = ["time," + ",".join(old.code(n) for n in next(rows_of_vehicle(1)))]
        lines += [",".join(bits(x) for x in (0.01 * k, *row.values())) for k, row in enumerate(rows_of_vehicle(ROWS))]
        input_ = folder / "in.csv"
        input_.write_text("\n".join(lines) + "\n")
    outputs, now = [["--outputs", ",".join(u.code(n) for n in old.outputs)] for u in (old, three(request.param))]
    text = run_client(client_for("linux64"), old.binary, old, input_, folder / "out.csv", *outputs)
    text = text.replace(outputs[1], now[1], 1)  # the header: Enumerations are read as Integers there
    assert len(text.splitlines()) == ROWS + 1
    return {"unit": three(request.param), "input": input_, "text": text, "outputs": now}


@pytest.mark.parametrize("target", RUNNERS)
def test_every_output_has_the_bits_of_fmi_2_there_and_a_state_goes_on(
    reference: dict, target: str, tmp_path: Path
) -> None:
    if why := unavailable(target):
        pytest.skip(why)
    of, state = reference["unit"], tmp_path / "state"
    run = [
        client_for(target),
        library_for(target, of),
        of,
        reference["input"],
        tmp_path / "out.csv",
        *reference["outputs"],
    ]
    assert run_client(*run, "--save", f"{state}@{MIDDLE}") == reference["text"]
    if target == "win64":
        return  # wine takes seconds
    assert (
        run_client(*run, "--restore", f"{state}@{MIDDLE}").splitlines()[1:]
        == reference["text"].splitlines()[1 + MIDDLE :]
    )
