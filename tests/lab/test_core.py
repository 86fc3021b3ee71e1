"""The binding: layouts from the library's own tables, settings checked, filter state copied."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import tselab
from tse.impl.core import INPUT, NOMINAL, OUTPUT, STATUS, STIFFNESS, Config, Filter, SettingError, library, stiffness_si
from tse.impl.files import read_toml

HEADERS = Path(__file__).parents[2] / "include" / "tse"
TABLES = Path(__file__).parents[2] / "src" / "tables"


def row(**values):
    rows = np.zeros(1, library().dtype(INPUT))
    for name, value in ({"dt": 0.01, "wheel_speed_front": 60.0, "wheel_speed_rear": 60.0} | values).items():
        rows[name] = value
    return rows


def test_version_is_that_of_the_header():
    header = (HEADERS / "version.h").read_text()
    assert re.search(r'#define TSE_VERSION "(.+)"', header)[1] == tselab.__version__ == library().version


def test_settings_are_the_rows_of_the_table():
    names = []
    for file in ("vehicle", "uncertainty", "sensors", "effects", "formula", "filter"):
        table = read_toml(TABLES / f"{file}.toml")
        if file == "sensors":  # in four parts
            table = [name for part in table.values() for name in part]
        names += effect_settings() if file == "effects" else table["setting"] if file == "formula" else table
    assert list(Config().fields) == names


def effect_settings():
    return [f"{i}_{p}" for i, row in read_toml(TABLES / "effects.toml").items() for p in row["parameter"]]


def test_defaults_lie_inside_their_ranges():
    for name, f in Config().fields.items():
        assert f.low <= f.default <= f.high, name
        assert getattr(Config(), name) == pytest.approx(f.default)


def test_setting_outside_its_range_is_refused_with_name_value_and_range():
    config = Config()
    with pytest.raises(SettingError, match=r"forgetting = 2 is outside its range [0-9.]+ .. 0.9999"):
        config.forgetting = 2
    with pytest.raises(SettingError, match="whole number"):
        config.particles = 99.5
    with pytest.raises(SettingError, match="not a number"):
        config.mass = float("nan")
    assert config.changed() == {}


def test_snapshot_restores_the_filter_bit_for_bit():
    filter_ = Filter(Config({"particles": 50}))
    rng = np.random.default_rng(1)
    rows = np.concatenate(
        [row(steer_angle=0.02 * rng.standard_normal(), accel_y=rng.standard_normal()) for _ in range(60)]
    )
    list(filter_.run(rows[:30]))
    saved = filter_.snapshot()
    first = [y.item() for y in filter_.run(rows[30:])]
    filter_.restore(saved)
    assert [y.item() for y in filter_.run(rows[30:])] == first
    with pytest.raises(ValueError, match="bytes"):
        filter_.restore(saved[:-8])


def test_refused_row_leaves_the_filter_as_it_was():
    filter_ = Filter(Config({"particles": 50}))
    filter_.step(row())
    before = filter_.snapshot()
    out = filter_.outputs(1)
    filter_.step_into(row(steer_angle=5.0), out)
    assert library().codes(STATUS)[int(out["status"][0])].name == "TSE_E_INPUT"
    assert np.isnan(out["cx_front"][0])
    assert filter_.snapshot() == before


def test_table_converts_to_newton_as_the_library_does():
    from tse.impl.estimate import _block

    config = Config({"particles": 50, "longitudinal_stiffness_front": 2.1e5})
    output = Filter(config).step(row())
    mean, sd, spread = stiffness_si(config, output)
    table = _block(np.zeros(1), np.array([output], library().dtype(OUTPUT)), config)
    for i, s in enumerate(STIFFNESS):
        assert NOMINAL[s] in Config()
        assert table[s][0] == pytest.approx(float(mean[i]), rel=1e-6)
        assert table[f"{s}_sd"][0] == pytest.approx(float(sd[i]), rel=1e-6)
        assert table[f"{s}_spread"][0] == pytest.approx(float(spread[i]), rel=1e-6)
