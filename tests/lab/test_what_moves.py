"""One truth about settings and effects: the columns `filter` and `replaced_by` of
src/tables, the notes of a run and the pages say what the estimate does. Every setting
and every parameter of an effect is set to its typical size, and the estimate is
compared with the one without it.
"""

import functools
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tse.car.config import check_effect, make_config, unused_notes
from tse.car.vehicle import read_vehicle
from tse.library.core import (
    Config,
    EffectParameter,
    NativeFilter,
    SettingError,
    SimConfig,
    Simulator,
    library,
)
from tse.library.files import read_toml
from tse.log.rows import OPTIONAL_COLUMNS, ROAD_COLUMNS, TORQUE_COLUMNS, VELOCITY_COLUMNS

ROOT = Path(__file__).resolve().parents[2]
PAGES, TABLES = ROOT / "docs" / "pages", ROOT / "src" / "tables"
ROWS, DT = 2400, 0.01
HALF, DAY = 1600, 86400  # the drive goes on a day later, with what the filter has learnt
CAR = """mass = 1900.0
lf = 1.25
lr = 1.5
wheel_radius_front = 0.33
wheel_radius_rear = 0.33
"""
FORMS = {"default": "default", "paper": "robust"}  # filter: a form of it
PARTICLES = {"default": {}, "paper": {"particles": 32}}
# Settings that are needed for another one to have an effect.
WITH = {
    "sample_time": {"accel_y_latency": 0.013},  # rows wait for a late channel
    "learnt_floor": {"valid_sd": 1.0},  # only a valid stiffness is learnt
    "learnt_walk_day": {"valid_sd": 1.0},
    "initial_vel_x": {"initial_vel_x_from_wheels": 0},
    "formula_place": {"formula_gain": 1.0, "formula_code_1": 16},
}


@functools.cache
def simulate_drive() -> tuple[np.ndarray, np.ndarray]:
    """Return what a driver does and what the car logs: sweeps, braking until wheels lock,
    a wet road.
    """
    t = DT * np.arange(ROWS)
    simulator = Simulator(Config.exact({"wheel_noise_sd": 0.04}), SimConfig({"seed": 3, "noise": 2.0}))
    driver, log = simulator.inputs(ROWS), simulator.outputs(ROWS)
    driver["dt"] = DT
    driver["road_level"] = np.where(t > 8.0, 0.5, 1.0)
    driver["steer_angle"] = 0.04 * np.sin(np.pi * t + 3 * np.sin(0.25 * t))
    driver["steer_angle"][(t > 12.0) & (t < 12.3)] = 0.8
    driver["wheel_torque_front"] = np.maximum(1000 * np.tanh(6 * np.sin(1.3 * t)), 0.0)
    driver["brake_torque_front"] = np.where(t % 5 > 3.5, 800.0, 0.0) + np.where(
        (t > 10) & (t < 10.6), 1200.0, 0.0
    )
    driver["brake_torque_rear"] = np.where(t % 5 > 3.5, 400.0, 0.0)
    for i in range(ROWS):
        simulator.step_into(driver, log, i)
    return driver, log


@functools.cache
def get_rows(name: str) -> np.ndarray:
    """Return the rows of the drive for a filter: for the default one with velocity,
    pedals and a road.
    """
    driver, log = simulate_drive()
    made = NativeFilter(Config.exact()).inputs(ROWS)
    for channel in library().channels:
        made[channel.name] = log[channel.name]
    made["dt"] = DT
    made["dt"][500] = 0.6  # a gap
    if name == "paper":
        return made
    course = np.cumsum(log["true_yaw_rate"]) * DT + np.arctan2(log["true_vel_y"], log["true_vel_x"])
    optional = {
        "ins_vel_x": log["true_vel_x"],
        "ins_vel_y": log["true_vel_y"],
        "gnss_speed": np.hypot(log["true_vel_x"], log["true_vel_y"]),
        "gnss_course": np.arctan2(np.sin(course), np.cos(course)),
        "brake": (driver["brake_torque_front"] > 0) * 1.0,
        "wheel_torque_front": driver["wheel_torque_front"] - driver["brake_torque_front"],
        "wheel_torque_rear": -driver["brake_torque_rear"],
        "bank": np.full(ROWS, 0.01),
        "grade": np.full(ROWS, 0.01),
    }
    for bit, channel in enumerate(library().optional):
        made[channel.name] = optional[channel.name]
        first = ROWS // 2 if channel.name in ("bank", "grade") else ROWS // 3
        made["given"][first:] |= 1 << bit
    return made


def estimate(settings: Mapping[str, float], name: str) -> np.ndarray:
    """Return the outputs of the drive in two parts, the second one with what the first
    has taught.
    """
    config, log = Config(settings).complete(), get_rows(name)
    first, second = NativeFilter(config), NativeFilter(config)
    out = first.outputs(ROWS)
    first.step_into(log, out, 0, HALF)
    learnt = first.save_learnt()
    assert learnt is not None
    second.load_learnt(learnt, DAY)
    second.step_into(log, out, HALF, ROWS)
    return out


@functools.cache
def estimate_of(settings: tuple[tuple[str, float], ...], name: str) -> bytes:
    return estimate(dict(settings), name).tobytes()


def make_key(settings: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    return tuple(sorted(settings.items()))


def make_base(name: str) -> dict[str, float]:
    """Return the settings of an ordinary car with a known mass, for a filter."""
    form = {} if name == "default" else Config.settings_of(FORMS[name])
    return {"mass": 1900.0} | form | PARTICLES[name]


def find_parameter(setting: str) -> EffectParameter | None:
    """Return the parameter of an effect that a setting is."""
    found = (p for e in library().effects.values() for p in e.parameters if p.setting == setting)
    return next(found, None)


def find_company(setting: str) -> dict[str, float]:
    """Return settings with which another one has an effect: strengths beside a shape, and
    nothing in its place.
    """
    found = dict(WITH.get(setting, {}))
    if (p := find_parameter(setting)) and not p.strength:
        found |= {s.setting: s.typical[1] for s in library().effects[p.effect].strengths}
    if other := library().settings[setting].replaced_by:
        found[other] = 0
    return found


def list_values(setting: str, now: float) -> list[float]:
    """Return values to try: the typical size of a parameter of an effect, else the ends
    of the range.
    """
    field, p = Config().fields[setting], find_parameter(setting)
    ends = p.typical if p else (field.low, field.high)
    if p and p.typical[0] == p.typical[1]:
        ends = (p.low, p.high)
    if setting == "particles":
        ends = (field.low, field.low + 8)
    return [int(x) if field.is_integer else x for x in ends if x != now]


def does_move(setting: str, name: str) -> bool | None:
    """Return whether a setting moves any output of a filter; None: every value that was
    tried is refused.
    """
    around = make_base(name) | find_company(setting)
    now, moved = getattr(Config(around).complete(), setting), None
    for value in list_values(setting, now):
        try:
            out = estimate_of(make_key(around | {setting: value}), name)
        except SettingError:
            continue
        moved = bool(moved) or out != estimate_of(make_key(around), name)
    return moved


@functools.cache
def find_moved(setting: str) -> dict[str, bool | None]:
    return {name: does_move(setting, name) for name in FORMS}


def has_filter(filter_: str, name: str) -> bool:
    """Return whether a column `filter` says that a filter uses the setting."""
    return filter_ in ("both", name)


SETTINGS = [s for s in library().settings if s != "form"]
EFFECTS = list(library().effects)
PARAMETERS = [p.setting for e in library().effects.values() for p in e.parameters]


@pytest.mark.parametrize("setting", SETTINGS)
def test_a_setting_moves_the_estimate_of_the_filters_of_its_column(setting):
    use = library().settings[setting]
    for name, moved in find_moved(setting).items():
        if moved is None:
            assert use.table == "formula"  # a program that ends with no value is refused
        else:
            assert moved == has_filter(use.filter, name), (setting, name, use)


@pytest.mark.parametrize("setting", [s for s in SETTINGS if library().settings[s].replaced_by])
def test_a_setting_that_is_replaced_moves_nothing(setting):
    use = library().settings[setting]
    name = "paper" if use.filter == "paper" else "default"
    around = make_base(name) | find_company(setting)
    around[use.replaced_by] = getattr(Config(make_base(name)).complete(), use.replaced_by)
    assert around[use.replaced_by] != 0
    for value in list_values(setting, getattr(Config(around), setting)):
        assert estimate_of(make_key(around | {setting: value}), name) == estimate_of(make_key(around), name)


@pytest.mark.parametrize("setting", [s for s in SETTINGS if library().settings[s].table != "formula"])
def test_a_run_refuses_or_notes_a_setting_without_effect(setting):
    p = find_parameter(setting)
    for name, moved in find_moved(setting).items():
        if p and not p.strength and not moved:
            continue  # a shape: its effect has the note
        around = make_base(name) | find_company(setting)
        asked = list_values(setting, getattr(Config(around).complete(), setting))[-1]
        config = Config(around | {setting: asked})
        stated = {setting: getattr(config, setting)}
        if setting not in config.changed():
            continue
        try:
            check_effect([setting], config)
            told = bool(unused_notes(config, stated))
        except SettingError:
            told = True
        assert told == (not moved), (setting, name)


# ---- vehicle files: the notes of a run


def write_vehicle(folder: Path, stated: Mapping[str, float]) -> Path:
    """Write a vehicle file that states settings of effects."""
    lines = [CAR]
    for effect in library().effects.values():
        given = [p for p in effect.parameters if p.setting in stated]
        lines += (
            [f"[effects.{effect.id}]", *(f"{p.name} = {stated[p.setting]!r}" for p in given)] if given else []
        )
    path = folder / "car.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


@pytest.mark.parametrize("setting", PARAMETERS)
def test_a_parameter_of_a_vehicle_file_moves_the_estimate_or_there_is_a_note(setting, tmp_path):
    p = find_parameter(setting)
    effect = library().effects[p.effect]
    around = {s.setting: s.typical[1] for s in effect.strengths if not p.strength}
    for name, form in FORMS.items():
        moved, noted = False, False
        plain, notes_without = make_config(read_vehicle(write_vehicle(tmp_path, around)), None, form=form)
        for value in (p.low, *p.typical, p.high) if p.typical[0] == p.typical[1] else p.typical:
            config, notes = make_config(
                read_vehicle(write_vehicle(tmp_path, around | {setting: value})), None, form=form
            )
            out = [estimate_of(make_key(c.as_dict() | PARTICLES[name]), name) for c in (config, plain)]
            moved |= out[0] != out[1]
            noted |= any(re.search(rf"effects\.{p.effect}(\.{p.name})?(?![.\w])", n) for n in notes)
        assert moved != noted, (setting, name, notes, notes_without)


# ---- pages


def read_section(effect: str) -> str:
    """Return the section of an effect of docs/pages/gap/effects.md."""
    text = (PAGES / "gap" / "effects.md").read_text(encoding="utf-8")
    found = re.search(rf"^## {effect}: .*?(?=^## |\Z)", text, flags=re.M | re.S)
    assert found, effect
    return found[0]


@pytest.mark.parametrize("effect", EFFECTS)
def test_the_page_says_of_an_effect_what_the_estimate_does(effect):
    moved = {n: any(find_moved(p.setting)[n] for p in library().effects[effect].parameters) for n in FORMS}
    said = re.findall(r"^- estimate: ([^.;]*)[.;]", read_section(effect), flags=re.M)
    expected = {
        (True, True): "both filters use it",
        (True, False): "the default filter uses it, the paper's does not",
        (False, False): "no filter uses it, simulator and replay do",
    }
    assert said == [expected[moved["default"], moved["paper"]]]


@pytest.mark.parametrize("setting", SETTINGS)
def test_the_page_of_settings_says_whose_they_are(setting):
    text = (PAGES / "reference" / "config.md").read_text(encoding="utf-8")
    row = re.search(rf'^\| <span id="{setting}"></span>.*$', text, flags=re.M)
    assert row, setting
    stated, meaning = (cell.strip() for cell in row[0].strip("|").split(" | ")[-2:])
    moved = {name for name, m in find_moved(setting).items() if m}
    assert stated == {0: "none", 1: "".join(moved), 2: "both"}[len(moved)]
    if found := re.search("; (default|paper's) filter$", meaning):
        assert moved == {found[1].removesuffix("'s")}


# ---- what Python repeats of a table, for its hints


def test_optional_channels_of_a_log_are_those_of_the_table():
    table = read_toml(TABLES / "input.toml")
    assert tuple(r["name"] for r in table["velocity"]) == VELOCITY_COLUMNS
    assert tuple(r["name"] for r in table["road"]) == tuple(ROAD_COLUMNS)
    assert {r["name"] for r in table["pedal"]} == {"brake", *TORQUE_COLUMNS}
    for field in library().optional:
        unit, low, high, text, _ = OPTIONAL_COLUMNS[field.name]
        assert (unit, low, high) == (field.unit, field.low, field.high)
        first = re.split("[,;(]| positive", text)[0].strip()
        assert first == re.split("[,;(]| positive", field.text)[0].strip()


# ---- a column that is wrong


@pytest.mark.parametrize(
    ("setting", "wrong"),
    [("crosswind_speed", "default"), ("steering_delay_time", "none"), ("grip", "both"), ("seed", "default")],
)
def test_a_wrong_column_is_found(setting, wrong, monkeypatch):
    use = library().settings[setting]
    monkeypatch.setitem(library().settings, setting, replace(use, filter=wrong))
    with pytest.raises(AssertionError):
        test_a_setting_moves_the_estimate_of_the_filters_of_its_column(setting)
