"""The FMUs of FMI 3.0 describe all that those of 2.0 do, and compute the same bits."""

import re
import shutil
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.fmi1 import FMICallException
from fmu_support import (
    DRIVER,
    ESTIMATOR,
    MODELS,
    VEHICLE,
    Instance,
    Instance3,
    Unit,
    find_headers,
    list_exports,
    load_unit,
    read_connections,
)

if not find_headers("3").is_dir():
    pytest.skip("scripts/setup.sh has not put the FMI 3.0 headers into .venv/share", allow_module_level=True)

TYPES = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean", "Enumeration": "Enumeration"}
STIFFNESS = ("cx_front", "cy_front", "cy_rear")


def load_fmi3(model: str) -> Unit:
    return load_unit(f"{model}-fmi3")


@pytest.fixture(params=MODELS)
def name(request: pytest.FixtureRequest) -> str:
    return request.param


# ---- what they say


@pytest.mark.slow
def test_every_variable_of_2_is_there_with_name_reference_and_all_that_is_said_of_it(name: str) -> None:
    two, new = load_unit(name), load_fmi3(name)
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
    root = ElementTree.parse(load_fmi3(name).folder / "modelDescription.xml")
    outputs = [v.get("valueReference") for v in root.find("ModelVariables") if v.get("causality") == "output"]
    for element, dependencies in (("Output", ""), ("InitialUnknown", None)):
        unknowns = root.findall(f"ModelStructure/{element}")
        assert [u.get("valueReference") for u in unknowns] == outputs
        assert {u.get("dependencies") for u in unknowns} == {dependencies}


def read_terminals(model: str) -> dict[str, dict[str, str]]:
    """Return the members and their variables of each kind of terminal."""
    root = ElementTree.parse(load_fmi3(model).folder / "terminalsAndIcons" / "terminalsAndIcons.xml")
    return {
        t.get("terminalKind"): {
            m.get("memberName"): m.get("variableName") for m in t.findall("TerminalMemberVariable")
        }
        for t in root.findall("Terminals/Terminal")
    }


def test_the_terminals_of_both_connect_what_the_system_connects(name: str) -> None:
    out, into = read_terminals(VEHICLE)["_tse_sensors"], read_terminals(ESTIMATOR)["_tse_sensors"]
    assert {
        (out[member], variable) for member, variable in into.items()
    } == read_connections() and out.keys() == into.keys()
    for members in read_terminals(name).values():
        assert members and set(members.values()) <= set(load_fmi3(name).variables)
    assert set(read_terminals(VEHICLE)["_tse_driver"]) == set(DRIVER)
    assert (
        set(STIFFNESS)
        <= read_terminals(VEHICLE)["_tse_truth"].keys() & read_terminals(ESTIMATOR)["_tse_estimate"].keys()
    )


@pytest.mark.skipif(not shutil.which("nm"), reason="nm is not installed")
def test_the_functions_of_fmi_3_are_exported_and_nothing_else(name: str) -> None:
    declared = re.findall(
        r"^FMI3_Export \w+\s+(fmi3\w+);", (find_headers("3") / "fmi3Functions.h").read_text(), flags=re.M
    )
    assert list_exports(load_fmi3(name).binary) == set(declared) and len(declared) > 70


def test_the_page_speaks_of_this_version(name: str) -> None:
    text = (load_fmi3(name).folder / "documentation" / "index.html").read_text(encoding="utf-8")
    assert "FMI 3.0" in text and "fmi3DoStep" in text and "fmi2" not in text and load_fmi3(name).guid in text
    assert not re.search(r"@\w+@|<!--/?[23]-->", text)
    listed = re.findall(
        r"<tr><td><code>([\w.<>]+)</code></td><td>(?:Float64|Int32|Boolean|Enumeration)", text
    )
    assert {n.replace("<wbr>", "") for n in listed} == set(load_fmi3(name).variables)


# ---- what they compute


def test_fmpy_simulates_both_versions_to_the_same_result(name: str) -> None:
    wanted = [n for n in load_unit(name).outputs if not n.endswith("_reason")]
    how = {"stop_time": 1.0, "step_size": 0.01, "output_interval": 0.01, "output": wanted}
    results = [simulate_fmu(str(of.fmu), **how) for of in (load_unit(name), load_fmi3(name))]
    for n in wanted:
        assert np.array_equal(results[0][n], results[1][n]), n


# ---- what they refuse


def test_states_are_refused_by_the_other_version(name: str) -> None:
    """They hold the same, but the sources are not the same, and so nobody has tried."""
    with Instance(load_unit(name)) as a, Instance3(load_fmi3(name)) as b:
        a.start()
        b.start()
        with pytest.raises(FMICallException):
            b.slave.deserializeFMUState(a.state())
        assert "the state of another FMU" in b.log[-1][2]
