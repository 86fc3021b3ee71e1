"""modelDescription.xml against the golden copy and against the tables of the core."""

from __future__ import annotations

import difflib
import hashlib
import math
import re
import uuid
import xml.etree.ElementTree as ElementTree

import pytest
from fmpy.validation import validate_fmu
from fmu_support import ESTIMATOR, GOLDEN, VEHICLE, Unit, build, unit

from tse.impl.core import CONFIG, OUTPUT, REASON, SIM_CONFIG, SIM_INPUT, SIM_OUTPUT, STATUS, Field, library

NAMESPACE = uuid.UUID("7d1b2f04-6f52-4e0b-9d0d-2f1b1d6c0e57")  # of fmu/stage.cmake
UNITS = {
    "kg m2": "kg.m2",
    "Nm": "N.m",
    "rad s2/m": "rad.s2/m",
    "rad/(N m)": "rad/(N.m)",
}  # the core's spelling -> FMI's
GROUPS = {
    VEHICLE: ("vehicle", "sensors", "effects", "simulation"),
    ESTIMATOR: ("vehicle", "uncertainty", "sensors", "latency", "velocity", "pedals", "effects", "filter"),
}


def xml_of(model: str) -> str:
    return (unit(model).folder / "modelDescription.xml").read_text(encoding="utf-8")


def test_description_is_the_golden_one(model: Unit) -> None:
    golden = (GOLDEN / f"{model.identifier}.xml").read_text(encoding="utf-8")
    built = xml_of(model.identifier)
    diff = "".join(difflib.unified_diff(golden.splitlines(True), built.splitlines(True), "golden", "built", n=0))
    assert golden == built, f"{diff}\nIf this is meant: python3 tests/fmu/update.py, and say why in the commit message."


def test_guid_is_a_function_of_every_character_of_the_description(model: Unit) -> None:
    """So it changes when anything changes, and is equal in every build of the same description."""
    text = xml_of(model.identifier)
    assert text.count(model.guid) == 1
    assert model.guid == "{" + str(uuid.uuid5(NAMESPACE, text.replace(model.guid, "@GUID@"))) + "}"
    assert f'"{model.guid}"' in (model.folder / "sources" / "fmu_guid.h").read_text()
    assert model.guid in (build() / f"{model.identifier}.dir" / "fmu_guid.h").read_text()


def test_saved_states_belong_to_the_sources(model: Unit) -> None:
    """The frame of a state holds a hash of this: another version with the same description refuses it."""
    folder = model.folder / "sources"
    files = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.suffix in (".c", ".h"))
    files.remove("fmu_guid.h")
    hashes = "".join(f"{hashlib.sha1((folder / f).read_bytes()).hexdigest()} {f}\n" for f in files)
    text = (folder / "fmu_guid.h").read_text()
    assert f'#define FMU_SOURCES "{hashlib.sha1(hashes.encode()).hexdigest()}"' in text


def test_names_and_references_are_unique_and_structured(model: Unit) -> None:
    variables = model.description.modelVariables
    assert len({v.name for v in variables}) == len(variables)
    assert [v.valueReference for v in variables] == list(range(len(variables)))
    for v in variables:
        assert re.fullmatch(r"[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)*", v.name), v.name
        assert v.description and v.causality in ("input", "output", "parameter"), v.name


def agree(v, row: Field, *, start: bool, text: bool = True) -> None:
    """A variable says what its row says: unit, range, start, text."""
    if v.type == "Real":
        assert v.unit == UNITS.get(row.unit, row.unit), v.name
    if row.has_range:
        assert (float(v.min), float(v.max)) == (row.low, row.high), v.name
    if start:
        assert float(v.start) == row.default, v.name
    if text:
        assert row.text in v.description, v.name


@pytest.mark.parametrize("name", GROUPS)
def test_every_setting_is_a_parameter_with_its_unit_range_and_start(name: str) -> None:
    parameters = {v.name: v for v in unit(name).description.modelVariables if v.causality == "parameter"}
    rows = {f.name: f for f in library().fields(CONFIG)}
    simulation = {f.name: f for f in library().fields(SIM_CONFIG)}
    met = set()
    for full, v in parameters.items():
        group, _, short = full.partition(".")
        if full in ("ramp", "vehicle.calibrated"):  # no settings, but how the FMU takes them
            assert (v.type, v.start) == ("Boolean", {"ramp": "true", "vehicle.calibrated": "false"}[full])
            continue
        assert group in GROUPS[name], full
        short = short.replace(".", "_")  # effects.body_roll.gain is the setting body_roll_gain
        row = simulation[short] if group == "simulation" else rows[short]
        if short == "particles":  # the range ends where this build's memory does
            assert (int(v.min), int(v.max), int(v.start)) == (16, 512, 500)
            met.add(short)
            continue
        agree(v, row, start=True)
        assert (
            v.type == ("Integer" if row.is_integer else "Real") and v.variability == "fixed" and v.initial == "exact"
        ), full
        met.add((group == "simulation", short))
    if name == ESTIMATOR:
        assert {s if isinstance(s, str) else s[1] for s in met} == set(rows)
    else:
        assert {s[1] for s in met if s[0]} == set(simulation)
        assert {s[1] for s in met if not s[0]} == {
            n.partition(".")[2].replace(".", "_")
            for n in unit(ESTIMATOR).variables
            if n.startswith(("vehicle.", "sensors.", "effects.")) and n != "vehicle.calibrated"
        }


def test_inputs_of_the_estimator_are_the_channels(estimator: Unit) -> None:
    inputs = {v.name: v for v in estimator.description.modelVariables if v.causality == "input"}
    optional = {"velocity": library().optional[:4], "pedals": library().optional[4:]}
    names = {f"{group}.{f.name}" for group, fields in optional.items() for f in fields}
    assert set(inputs) == {f.name for f in library().channels} | {"missing", "velocity.given", "pedals.given", *names}
    for group, fields in optional.items():
        bits = inputs[f"{group}.given"]
        for k, f in enumerate(fields):
            agree(inputs[f"{group}.{f.name}"], f, start=False)
            assert f"{1 << k} {f.name}" in bits.description
        assert (int(bits.min), int(bits.max), int(bits.start)) == (0, 2 ** len(fields) - 1, 0)
    for f in library().channels:
        agree(inputs[f.name], f, start=False)
        assert float(inputs[f.name].start) == 0 and inputs[f.name].variability == "continuous"
    for k, f in enumerate(library().channels):
        assert f"{1 << k} {f.name}" in inputs["missing"].description
    assert (int(inputs["missing"].min), int(inputs["missing"].max)) == (0, 63)


def test_inputs_of_the_vehicle_are_those_of_the_simulator(vehicle: Unit) -> None:
    inputs = {v.name: v for v in vehicle.description.modelVariables if v.causality == "input"}
    rows = {f.name: f for f in library().fields(SIM_INPUT) if f.name != "dt"}
    assert set(inputs) == set(rows)
    for name, v in inputs.items():
        agree(v, rows[name], start=True)


def test_codes_are_enumerations_with_the_names_and_meanings_of_the_library(estimator: Unit) -> None:
    """Of FMI 2.0; test_fmi3.py compares the types of 3.0 with these."""
    types = {
        t.name: {int(i.value): (i.name, i.description) for i in t.items} for t in estimator.description.typeDefinitions
    }
    reasons, statuses = library().codes(REASON), library().codes(STATUS)
    assert types["Reason"] == {code: (f.name, f.text) for code, f in reasons.items()}
    assert types["Status"] == {code: (f.name, f.text) for code, f in statuses.items() if code >= 0}
    faults = [*library().channels, *(f for f in library().optional if not f.name.startswith(("brake", "wheel_torque")))]
    assert types["FaultChannel"] == {
        0: types["FaultChannel"][0],
        **{i: (f.name, f.text) for i, f in enumerate(faults, 1)},
    }
    assert [name for name, _ in types["ChangeKind"].values()] == [
        "none",
        "road",
        "front axle",
        "rear axle",
        "started over",
    ]
    coded = {v.name: v.declaredType.name for v in estimator.description.modelVariables if v.type == "Enumeration"}
    reasoned = {f"estimate.{q}_reason": "Reason" for q in ("cx_front", "cy_front", "cy_rear", "grip")}
    rest = {"estimate.status": "Status", "estimate.change_kind": "ChangeKind", "estimate.fault_channel": "FaultChannel"}
    assert coded == reasoned | rest


def test_every_output_of_the_core_is_an_output_with_its_unit(estimator: Unit, vehicle: Unit) -> None:
    for f in library().fields(OUTPUT):
        if f.name.endswith("_valid"):
            for name, kind in ((f.name, "Boolean"), (f.name.removesuffix("_valid") + "_reason", "Enumeration")):
                assert estimator.variables[f"estimate.{name}"].type == kind
        elif f.name.endswith("spread_seen"):
            assert estimator.variables[f"estimate.{f.name}"].type == "Boolean"
        elif re.match(r"c[xy]_", f.name):
            assert estimator.variables[f"estimate.{f.name}"].unit == ("N" if f.name.startswith("cx") else "N/rad")
            agree(estimator.variables[f"estimate.relative.{f.name}"], f, start=False, text=False)
        else:
            agree(estimator.variables[f"estimate.{f.name}"], f, start=False)
    channels = {f.name for f in library().channels}
    for f in library().fields(SIM_OUTPUT):
        if f.name in channels:
            agree(vehicle.variables[f"sensor.{f.name}"], f, start=False)
        elif re.match(r"(true|drawn)_c[xy]_", f.name):
            group, short = f.name.split("_", 1)
            agree(vehicle.variables[f"{group}.relative.{short}"], f, start=False, text=False)
            assert vehicle.variables[f"{group}.{short}"].unit == ("N" if short.startswith("cx") else "N/rad")
        else:
            agree(vehicle.variables[f.name.replace("_", ".", 1)], f, start=False)


def test_structure_names_every_output_once_and_says_what_it_depends_on(model: Unit) -> None:
    root = ElementTree.fromstring(xml_of(model.identifier))
    variables = root.findall("./ModelVariables/ScalarVariable")
    outputs = [i + 1 for i, v in enumerate(variables) if v.get("causality") == "output"]
    for element, dependencies in (("Outputs", ""), ("InitialUnknowns", None)):
        unknowns = root.findall(f"./ModelStructure/{element}/Unknown")
        assert [int(u.get("index")) for u in unknowns] == outputs
        assert {u.get("dependencies") for u in unknowns} == {dependencies}
    assert root.find("./ModelStructure/Derivatives") is None


def test_units_have_definitions_that_their_display_units_follow(model: Unit) -> None:
    root = ElementTree.fromstring(xml_of(model.identifier))
    defined = {u.get("name"): u for u in root.findall("./UnitDefinitions/Unit")}
    used = {v.find("Real").get("unit") for v in root.iter("ScalarVariable") if v.find("Real") is not None}
    assert used == set(defined)
    displayed = {d.get("name"): float(d.get("factor")) for d in root.iter("DisplayUnit")}
    degree = math.degrees(1)
    wanted = {"deg": degree, "deg/s": degree, "km/h": 3.6, "kN": 1e-3, "kN/deg": 1e-3 / degree,
              "deg.s2/m": degree, "deg/(N.m)": degree}  # fmt: skip
    assert displayed == pytest.approx({k: v for k, v in wanted.items() if k in displayed}, rel=1e-12)
    assert {"deg", "deg/s", "kN", "kN/deg"} <= set(displayed)


def test_fmpy_finds_nothing_wrong(model: Unit) -> None:
    assert validate_fmu(str(model.fmu)) == []


def test_archive_holds_what_a_user_looks_for(model: Unit) -> None:
    for name in ("model.png", "documentation/index.html", "documentation/licenses/license.txt", "sources/buildDescription.xml",
                 "sources/fmi2.c", "sources/tse/tse.h"):  # fmt: skip
        assert (model.folder / name).is_file(), name
