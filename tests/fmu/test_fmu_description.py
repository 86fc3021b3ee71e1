"""modelDescription.xml agrees with the tables of the core.

scripts/results/fmu_variables.md has the GUID, which is a hash of the whole description.
"""

import hashlib
import html
import importlib.util
import math
import re
import shutil
import subprocess
import sys
import uuid
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.fmi1 import FMICallException
from fmu_support import ESTIMATOR, MODELS, ROOT, VEHICLE, Instance, Unit, build, load_unit, read_connections
from fmu_support import run as command

from tse.library.core import (
    CONFIG,
    INPUT,
    NOMINAL,
    OUTPUT,
    SIM_CONFIG,
    SIM_INPUT,
    SIM_OUTPUT,
    Config,
    Field,
    library,
)
from tselab.fmu_build import read_build

NAMESPACE = uuid.UUID("7d1b2f04-6f52-4e0b-9d0d-2f1b1d6c0e57")  # of fmu/stage.cmake
GROUPS = {
    VEHICLE: ("vehicle", "sensors", "effects", "simulation"),
    ESTIMATOR: (
        "vehicle",
        "uncertainty",
        "sensors",
        "latency",
        "velocity",
        "pedals",
        "road",
        "effects",
        "filter",
    ),
}


def read_xml(model: str) -> str:
    return (load_unit(model).folder / "modelDescription.xml").read_text(encoding="utf-8")


def test_guid_is_a_function_of_every_character_of_the_description(model: Unit) -> None:
    """Every change changes the GUID; every build of a description has the same one."""
    text = read_xml(model.identifier)
    assert text.count(model.guid) == 1
    assert model.guid == "{" + str(uuid.uuid5(NAMESPACE, text.replace(model.guid, "@GUID@"))) + "}"
    assert f'"{model.guid}"' in (model.folder / "sources" / "fmu_guid.h").read_text()
    assert model.guid in (build() / f"{model.identifier}.dir" / "fmu_guid.h").read_text()


def test_saved_states_belong_to_the_sources(model: Unit) -> None:
    """The frame of a state holds this hash.

    A version with the same description and other sources refuses the state.
    """
    folder = model.folder / "sources"
    files = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.suffix in (".c", ".h"))
    files.remove("fmu_guid.h")
    hashes = "".join(f"{hashlib.sha1((folder / f).read_bytes()).hexdigest()} {f}\n" for f in files)
    text = (folder / "fmu_guid.h").read_text()
    assert f'#define FMU_SOURCES "{hashlib.sha1(hashes.encode()).hexdigest()}"' in text


@pytest.mark.skipif(not shutil.which("cc"), reason="there is no compiler cc")
def test_a_state_of_other_sources_is_refused_though_the_description_is_the_same(
    vehicle: Unit, tmp_path: Path
) -> None:
    folder = tmp_path / "other"
    shutil.copytree(vehicle.folder, folder)
    header = folder / "sources" / "fmu_guid.h"
    header.write_text(re.sub(r'(FMU_SOURCES ")\w', r"\1x", header.read_text()))
    files = [
        folder / "sources" / f
        for f in vehicle.description.buildConfigurations[0].sourceFileSets[0].sourceFiles
    ]
    other = Unit.__new__(Unit)
    other.__dict__.update({**vehicle.__dict__, "folder": folder})
    command(
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
        with pytest.raises(FMICallException):
            o.restore(state)
        said = "the state of another FMU, or of another version of this one"
        assert o.log[-1][:3] == ("one", 3, "logStatusError") and said in o.log[-1][3]
        i.restore(state)


def test_names_and_references_are_unique_and_structured(model: Unit) -> None:
    variables = model.description.modelVariables
    assert len({v.name for v in variables}) == len(variables)
    assert [v.valueReference for v in variables] == list(range(len(variables)))
    for v in variables:
        assert re.fullmatch(r"[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)*", v.name), v.name
        assert v.description and v.causality in ("input", "output", "parameter"), v.name


def test_parameters_are_the_settings_of_the_library() -> None:
    settings, simulator = ({f.name for f in library().fields(which)} for which in (CONFIG, SIM_CONFIG))
    found = {
        name: {v.name for v in load_unit(name).description.modelVariables if v.causality == "parameter"}
        for name in GROUPS
    }
    assert all(
        full in ("ramp", "vehicle.exact") or full.partition(".")[0] in GROUPS[n]
        for n in found
        for full in found[n]
    )
    of_estimator = {full.partition(".")[2].replace(".", "_") for full in found[ESTIMATOR] - {"vehicle.exact"}}
    assert of_estimator == settings
    assert {x.partition(".")[2] for x in found[VEHICLE] if x.startswith("simulation.")} == simulator


OF_THE_FMU = {
    VEHICLE: {"ramp"},
    ESTIMATOR: {
        "vehicle.exact",
        "velocity.given",
        "pedals.given",
        "road.given",
        "estimate.valid",
        "estimate.grip_reason",
    }
    | {f"estimate.{k}_reason" for k in NOMINAL}
    | {f"estimate.nominal.{k}" for k in NOMINAL},
}


def find_in_library(name: str, causality: str, model: str) -> tuple[Field | None, str]:
    """Return a variable's row of the library's tables and its unit there.

    Return None for a variable of the FMU alone.
    """
    if model == ESTIMATOR:
        columns, prefix = (
            library().fields(INPUT if causality == "input" else OUTPUT),
            r"(estimate|velocity|pedals|road)\.",
        )
    else:
        columns, prefix = library().fields(SIM_INPUT if causality == "input" else SIM_OUTPUT), r"sensor\."
    table = {f.name: f for f in columns}
    if causality == "parameter":
        table = {
            f.name: f for f in library().fields(SIM_CONFIG if name.startswith("simulation.") else CONFIG)
        }
        field = table.get(name.partition(".")[2].replace(".", "_"))
    else:
        field = table.get(re.sub(r"relative\.", "", re.sub(f"^{prefix}", "", name)).replace(".", "_"))
    if field is None:
        return None, ""
    stiffness = re.search(r"c[xy]_(front|rear)(_sd|_spread|_secant)?$", name)
    if causality == "output" and stiffness and not re.search(r"relative|change", name):
        return field, library().field(CONFIG, NOMINAL[stiffness[0][:8].rstrip("_")]).unit
    return field, field.unit


def test_variables_are_those_of_the_tables(model: Unit) -> None:
    """Name, type, unit, range, start and text agree.

    The order is that of the tables, since value references follow it.
    """
    own, order, known = set(), {}, Config.exact()
    for v in model.description.modelVariables:
        field, unit_there = find_in_library(v.name, v.causality, model.identifier)
        if field is None or v.name.endswith("given"):
            own.add(v.name)
            continue
        assert (v.type == "Real") == (field.kind in "rs"), v.name
        if v.type == "Real":
            assert v.unit.replace(".", "") == unit_there.replace(" ", ""), v.name  # FMI: N.m
        if v.causality != "output" and field.has_range:
            high = 512 if field.name == "particles" else field.high  # where this build's memory ends
            assert (float(v.min), float(v.max)) == (min(field.low, float(v.start)), high), v.name
        if v.causality == "parameter":
            exact = model.identifier == VEHICLE and field.name in known
            assert (float(v.start), v.description) == (
                getattr(known, field.name) if exact else field.default,
                field.text,
            ), v.name
        order.setdefault((v.causality, v.name.partition(".")[0], "relative" in v.name), []).append(
            field.offset
        )
    assert all(
        offsets == sorted(offsets) for (causality, *_), offsets in order.items() if causality != "output"
    )
    assert own == OF_THE_FMU[model.identifier]


def test_structure_names_every_output_once_and_says_what_it_depends_on(model: Unit) -> None:
    root = ET.fromstring(read_xml(model.identifier))
    variables = root.findall("./ModelVariables/ScalarVariable")
    outputs = [i + 1 for i, v in enumerate(variables) if v.get("causality") == "output"]
    for element, dependencies in (("Outputs", ""), ("InitialUnknowns", None)):
        unknowns = root.findall(f"./ModelStructure/{element}/Unknown")
        assert [int(u.get("index")) for u in unknowns] == outputs
        assert {u.get("dependencies") for u in unknowns} == {dependencies}
    assert root.find("./ModelStructure/Derivatives") is None


def test_units_have_definitions_that_their_display_units_follow(model: Unit) -> None:
    root = ET.fromstring(read_xml(model.identifier))
    defined = {u.get("name"): u for u in root.findall("./UnitDefinitions/Unit")}
    used = {v.find("Real").get("unit") for v in root.iter("ScalarVariable") if v.find("Real") is not None}
    assert used == set(defined)
    displayed = {d.get("name"): float(d.get("factor")) for d in root.iter("DisplayUnit")}
    degree = math.degrees(1)
    wanted = {"deg": degree, "deg/s": degree, "km/h": 3.6, "kN": 1e-3, "kN/deg": 1e-3 / degree,
              "deg.s2/m": degree, "deg/(N.m)": degree}  # fmt: skip
    assert displayed == pytest.approx({k: v for k, v in wanted.items() if k in displayed}, rel=1e-12)
    assert {"deg", "deg/s", "kN", "kN/deg"} <= set(displayed)


def test_archive_holds_what_a_user_looks_for(model: Unit) -> None:
    for name in (
        "model.png",
        "documentation/index.html",
        "documentation/licenses/license.txt",
        "sources/buildDescription.xml",
        "sources/fmi2.c",
        "sources/tse/tse.h",
    ):
        assert (model.folder / name).is_file(), name


# ---- The FMUs' documentation/index.html is complete and self-contained. Its examples and
# those of the guide run and print what the text claims.


@pytest.fixture(scope="session")
def built() -> Path:
    """Folder with both .fmu, and beside each its content."""
    return build()


def read_page(built: Path, model: str) -> str:
    return (built / model / "documentation" / "index.html").read_text(encoding="utf-8")


def find_examples(text: str, kind: str) -> list[str]:
    return [
        html.unescape(code) for code in re.findall(rf'<pre class="{kind}">\n(.*?)</pre>', text, flags=re.S)
    ]


def run(code: str, folder: Path, *fmus: Path) -> str:
    """Run an example with these FMUs in the current directory; return its output."""
    for fmu in fmus:
        shutil.copy(fmu, folder)
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_estimators_example_finds_the_soft_front_tyres(built, tmp_path):
    (code,) = find_examples(read_page(built, "TireStiffnessEstimator"), "example")
    said = run(code, tmp_path, built / "TireStiffnessEstimator.fmu")
    found = re.search(r"front cornering stiffness ([\d.]+) \+- ([\d.]+) kN/rad, valid: True", said)
    assert found, said
    assert (
        abs(float(found[1]) - 84.0) < 1.5 * float(found[2]) < 18
    )  # 95 %: 1.5 times that is 3 sd; it began at 120
    assert "front longitudinal stiffness: reason 2" in said  # both wheel speeds are one signal


def test_the_vehicles_example_scatters_as_its_parameters_say(built, tmp_path):
    (code,) = find_examples(read_page(built, "SingleTrackVehicle"), "example")
    said = run(code, tmp_path, built / "SingleTrackVehicle.fmu")
    noise = float(re.search(r"noise of the gyro ([\d.]+) rad/s", said)[1])
    mean, spread = map(
        float, re.search(r"front cornering stiffness ([\d.]+) \+- ([\d.]+) kN/rad", said).groups()
    )
    assert noise == pytest.approx(0.0035, rel=0.1)
    assert mean == pytest.approx(120.0, rel=0.01)
    assert spread == pytest.approx(6.0, rel=0.1)


def test_the_loop_that_connects_both_finds_the_stiffness(built, tmp_path):
    (code,), (same,) = (find_examples(read_page(built, model), "connected") for model in MODELS)
    assert code == same
    said = run(code, tmp_path, *(built / f"{model}.fmu" for model in MODELS))
    found, true = map(
        float, re.search(r"front cornering stiffness ([\d.]+), true ([\d.]+) kN/rad", said).groups()
    )
    assert found == pytest.approx(true, rel=0.05)  # it began at 0.7 times that


@pytest.mark.parametrize("model", MODELS)
def test_the_table_of_connections_is_that_of_the_ssp(built, model):
    table = re.search(r'<table class="connections">.*?</table>', read_page(built, model), flags=re.S)[0]
    said = set(re.findall(r"<td><code>([\w.]+)</code></td><td><code>(\w+)</code></td>", table))
    assert said == read_connections()


def list_variables(built: Path, model: str) -> set[str]:
    return {v.get("name") for v in ET.parse(built / model / "modelDescription.xml").iter("ScalarVariable")}


@pytest.mark.parametrize("model", MODELS)
def test_every_variable_is_listed_and_what_the_text_names_exists(built, model):
    text = read_page(built, model)
    listed = re.findall(
        r"<tr><td><code>([\w.<>]+)</code></td><td>(?:Real|Integer|Boolean|Enumeration)</td>", text
    )
    assert {name.replace("<wbr>", "") for name in listed} == list_variables(built, model)
    names = set().union(*(list_variables(built, m) for m in MODELS))
    groups = "vehicle|uncertainty|sensors|latency|filter|simulation|estimate|sensor|true|drawn"
    for name in re.findall(rf"<code>((?:{groups})\.[\w.]+)</code>", text):
        pattern = re.sub(r"\.{3,}", ".*", name) + r"(\..*)?"  # sensors..._walk; and groups: true.relative
        assert any(re.fullmatch(pattern, n) for n in names), name
    for anchor in re.findall(r'href="#(\w+)"', text):
        assert f'id="{anchor}"' in text


@pytest.mark.parametrize("model", MODELS)
def test_the_page_needs_neither_network_nor_script_and_nothing_is_left_to_fill_in(built, model):
    text = read_page(built, model)
    assert re.findall(r"@\w+@", text) == []
    assert not re.search(r"<script|<link|<img|@import|url\((?!#)", text)
    links = re.findall(r'(?:href|src)="([^"#]+)"', text)
    assert all((built / model / "documentation" / x).is_file() for x in links), links
    void = {"meta", "br", "wbr"}
    open_tags: list[str] = []
    body = re.sub(r"<style>.*?</style>|<!DOCTYPE.*?>", "", text, flags=re.S)
    for slash, tag, own in re.findall(r"<(/?)([a-zA-Z]\w*)[^<>]*?(/?)>", body):
        if own or tag in void:
            continue
        if slash:
            assert open_tags.pop() == tag
        else:
            open_tags.append(tag)
    assert open_tags == []


def find_guide_examples() -> list[str]:
    guide = (ROOT / "docs" / "pages" / "use" / "fmu.md").read_text(encoding="utf-8")
    return re.findall(r"```python\n(.*?)```", guide, flags=re.S)


def test_the_guides_example_estimates_from_a_log(built, tmp_path):
    names = ["steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate"]
    time = np.arange(0.0, 10.0, 0.01)
    driver = np.rec.fromarrays([time, np.where(time % 4 < 2, 0.02, -0.02)], names=["time", "steer_angle"])
    outputs = [f"sensor.{name}" for name in names]
    car = simulate_fmu(
        str(built / "SingleTrackVehicle.fmu"),
        input=driver,
        output=outputs,
        stop_time=10.0,
        output_interval=0.01,
        start_values={"vehicle.mass": 1650.0, "simulation.true_cy_front": 0.8},
    )
    columns = [car["time"], *(car[name] for name in outputs)]
    header = ",".join(["time", *names])
    np.savetxt(tmp_path / "log.csv", np.column_stack(columns), delimiter=",", header=header, comments="")
    code = find_guide_examples()[0]
    said = run(code, tmp_path, built / "TireStiffnessEstimator.fmu").split()
    car = Config.exact({"mass": 1650.0}) if "vehicle.exact" in code else Config({"mass": 1650.0}).complete()
    assert float(said[-2]) * car.cornering_stiffness_front == pytest.approx(0.8 * 1.2e5, rel=0.15)
    assert said[-1] in ("True", "False", "1.0", "0.0")


def test_the_guides_system_runs(built, tmp_path):
    """FMPy ignores a system's parameters, so the guide must hand them over."""
    code = find_guide_examples()[1]
    said = run(code, tmp_path, built / "StiffnessStudy.ssp").split()
    assert float(said[-2]) == pytest.approx(float(said[-1]), rel=0.05 if "calibrated" in code else 0.3)


def test_the_table_for_readers_is_that_of_the_variables(built):
    spec = importlib.util.spec_from_file_location("facts", ROOT / "scripts" / "dev" / "facts.py")
    facts = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(facts)
    table = "\n\n".join(facts.list_fmu_variables(model, built) for model in MODELS) + "\n"
    assert (ROOT / "scripts/results/fmu_variables.md").read_text() == table, (
        "if this is meant: scripts/dev/facts.py --fmu, and say why in the commit message"
    )
