"""The FMUs' documentation/index.html is complete and self-contained; its examples, and those of the guide, run and say what the
text says."""

from __future__ import annotations

import html
import importlib.util
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmu_support import build

from tse.impl.core import Config

ROOT = Path(__file__).resolve().parents[2]
MODELS = ("TireStiffnessEstimator", "SingleTrackVehicle")


@pytest.fixture(scope="session")
def built() -> Path:
    """Folder with both .fmu, and beside each its content."""
    return build()


def page(built: Path, model: str) -> str:
    return (built / model / "documentation" / "index.html").read_text(encoding="utf-8")


def examples(text: str, kind: str) -> list[str]:
    return [html.unescape(code) for code in re.findall(rf'<pre class="{kind}">\n(.*?)</pre>', text, flags=re.S)]


def run(code: str, folder: Path, *fmus: Path) -> str:
    """What the example prints, with these FMUs in the current directory."""
    for fmu in fmus:
        shutil.copy(fmu, folder)
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_estimators_example_finds_the_soft_front_tyres(built, tmp_path):
    (code,) = examples(page(built, "TireStiffnessEstimator"), "example")
    said = run(code, tmp_path, built / "TireStiffnessEstimator.fmu")
    found = re.search(r"front cornering stiffness ([\d.]+) \+- ([\d.]+) kN/rad, valid: True", said)
    assert found, said
    assert abs(float(found[1]) - 84.0) < 1.5 * float(found[2]) < 18  # 95 %: 1.5 times that is 3 sd; it began at 120
    assert "front longitudinal stiffness: reason 3" in said


def test_the_vehicles_example_scatters_as_its_parameters_say(built, tmp_path):
    (code,) = examples(page(built, "SingleTrackVehicle"), "example")
    said = run(code, tmp_path, built / "SingleTrackVehicle.fmu")
    noise = float(re.search(r"noise of the gyro ([\d.]+) rad/s", said)[1])
    mean, spread = map(float, re.search(r"front cornering stiffness ([\d.]+) \+- ([\d.]+) kN/rad", said).groups())
    assert noise == pytest.approx(0.0035, rel=0.1)
    assert mean == pytest.approx(120.0, rel=0.01)
    assert spread == pytest.approx(6.0, rel=0.1)


def test_the_loop_that_connects_both_finds_the_stiffness(built, tmp_path):
    (code,), (same,) = (examples(page(built, model), "connected") for model in MODELS)
    assert code == same
    said = run(code, tmp_path, *(built / f"{model}.fmu" for model in MODELS))
    found, true = map(float, re.search(r"front cornering stiffness ([\d.]+), true ([\d.]+) kN/rad", said).groups())
    assert found == pytest.approx(true, rel=0.05)  # it began at 0.7 times that


@pytest.mark.parametrize("model", MODELS)
def test_the_table_of_connections_is_that_of_the_ssp(built, model):
    table = re.search(r'<table class="connections">.*?</table>', page(built, model), flags=re.S)[0]
    said = set(re.findall(r"<td><code>([\w.]+)</code></td><td><code>(\w+)</code></td>", table))
    ssd = ET.parse(ROOT / "fmu" / "StiffnessStudy.ssd")
    made = {
        (c.get("startConnector"), c.get("endConnector"))
        for c in ssd.iter("{http://ssp-standard.org/SSP1/SystemStructureDescription}Connection")
        if c.get("startElement") == "vehicle" and c.get("endElement") == "estimator"
    }
    assert said == made


def variables(built: Path, model: str) -> set[str]:
    return {v.get("name") for v in ET.parse(built / model / "modelDescription.xml").iter("ScalarVariable")}


@pytest.mark.parametrize("model", MODELS)
def test_every_variable_is_listed_and_what_the_text_names_exists(built, model):
    text = page(built, model)
    listed = re.findall(r"<tr><td><code>([\w.<>]+)</code></td><td>(?:Real|Integer|Boolean|Enumeration)</td>", text)
    assert {name.replace("<wbr>", "") for name in listed} == variables(built, model)
    names = set().union(*(variables(built, m) for m in MODELS))
    groups = "vehicle|uncertainty|sensors|latency|filter|simulation|estimate|sensor|true|drawn"
    for name in re.findall(rf"<code>((?:{groups})\.[\w.]+)</code>", text):
        pattern = re.sub(r"\.{3,}", ".*", name) + r"(\..*)?"  # sensors..._walk; and groups: true.relative
        assert any(re.fullmatch(pattern, n) for n in names), name
    for anchor in re.findall(r'href="#(\w+)"', text):
        assert f'id="{anchor}"' in text


@pytest.mark.parametrize("model", MODELS)
def test_the_page_needs_neither_network_nor_script_and_nothing_is_left_to_fill_in(built, model):
    text = page(built, model)
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


def guide_examples() -> list[str]:
    guide = (ROOT / "docs" / "pages" / "use" / "fmu.md").read_text(encoding="utf-8")
    return re.findall(r"```python\n(.*?)```", guide, flags=re.S)


def test_the_guides_example_estimates_from_a_log(built, tmp_path):
    names = ["steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate"]
    time = np.arange(0.0, 10.0, 0.01)
    driver = np.rec.fromarrays([time, np.where(time % 4 < 2, 0.02, -0.02)], names=["time", "steer_angle"])
    outputs = [f"sensor.{name}" for name in names]
    car = simulate_fmu(
        str(built / "SingleTrackVehicle.fmu"), input=driver, output=outputs, stop_time=10.0, output_interval=0.01,
        start_values={"vehicle.mass": 1650.0, "simulation.true_cy_front": 0.8},
    )  # fmt: skip
    columns = [car["time"], *(car[name] for name in outputs)]
    header = ",".join(["time", *names])
    np.savetxt(tmp_path / "log.csv", np.column_stack(columns), delimiter=",", header=header, comments="")
    code = guide_examples()[0]
    said = run(code, tmp_path, built / "TireStiffnessEstimator.fmu").split()
    car = Config({"mass": 1650.0})
    if "calibrated" not in code:
        car.fill("tse_config_uncalibrated")
    assert float(said[-2]) * car.cornering_stiffness_front == pytest.approx(0.8 * 1.2e5, rel=0.15)
    assert said[-1] in ("True", "False", "1.0", "0.0")


def test_the_guides_system_runs(built, tmp_path):
    """FMPy does not apply the parameters that a system sets; a guide that hands them over may expect more."""
    code = guide_examples()[1]
    said = run(code, tmp_path, built / "StiffnessStudy.ssp").split()
    assert float(said[-2]) == pytest.approx(float(said[-1]), rel=0.05 if "calibrated" in code else 0.3)


def test_the_table_for_readers_is_that_of_the_variables(built):
    spec = importlib.util.spec_from_file_location("facts", ROOT / "scripts" / "facts.py")
    facts = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(facts)
    table = "\n\n".join(facts.fmu_variables(model, built) for model in MODELS) + "\n"
    assert (ROOT / "scripts/results/fmu_variables.md").read_text() == table, "run scripts/facts.py --fmu"
