"""The report of a drive on which something happened, from made-up tables."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from test_plots import made_up
from test_what_happened import CALM, ROAD, table_of

from tse.impl import plots
from tse.impl.core import Config
from tse.impl.regimes import REGIMES, changes, spells


def drive(told, seconds: float = 200.0):
    """Log and estimates with all columns that the report draws."""
    table = table_of(told, seconds)
    log, other = made_up(len(table))
    rest = other[[c for c in other if c not in table]]
    return log, pd.concat(
        [table, rest.assign(**{f"discrepancy_{c}": 0.1 for c in ("accel_x", "accel_y", "yaw_rate")})], axis=1
    )


def test_the_strip_shows_the_least_usual_row_and_its_probabilities_add_up():
    log, table = drive(ROAD)
    table.loc[12345, ["p_steady", "p_fault"]] = [0.1, 0.9]
    data = plots.Data(log)
    data.add(table)
    p = np.array([data.line(name) for name in REGIMES])
    assert data.stride == 8 and p.shape[1] == len(data.time) and np.allclose(p.sum(axis=0), 1)
    assert data.line("p_fault").max() == pytest.approx(0.9)
    parts = plots.Data(log)
    for start in range(0, len(table), 2048):
        parts.add(table.iloc[start : start + 2048])
    assert all(np.array_equal(parts.line(name), data.line(name)) for name in REGIMES)


def test_the_plot_names_what_happened_and_plotly_takes_it():
    import plotly.graph_objects as go

    log, table = drive(ROAD)
    table.loc[2000:2200, ["p_steady", "p_fault", "fault_channel"]] = [0.05, 0.95, 6]
    data = plots.Data(log)
    data.add(table)
    figure = plots.stiffness_figure(data, table, Config(), changes(table), spells(table))
    go.Figure(figure.as_dict())
    texts = [a["text"] for a in figure.layout["annotations"]]
    assert "road changed at 36.03 s, 97 %" in texts and "yaw_rate at fault 20.00 .. 22.00 s, 95 %" in texts
    assert set(REGIMES.values()) <= {t["name"] for t in figure.data}
    lines = [s for s in figure.layout["shapes"] if s["type"] == "line"]
    assert [s["x0"] for s in lines] == [pytest.approx(36.03)]
    health = plots.health_figure(data)
    go.Figure(health.as_dict())
    assert {"discrepancy_accel_x", "discrepancy_yaw_rate"} <= {t["name"] for t in health.data}


def test_the_report_speaks_of_every_stretch_and_lists_what_happened(tmp_path):
    from tse.impl.estimate import Estimate
    from tse.impl.report import write_report
    from tse.impl.vehicle import default_vehicle

    log, table = drive([(0, 36.1, None), (36.1, 120, (36.03, 1, 0.97, 0.7)), (120, 200, (119.9, 2, 0.93, 1.2))])
    write_report(tmp_path / "r.html", Estimate(table, False), log, default_vehicle(), Config(), [])
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    for text in ("What happened", "<td>road changed</td>", "36.03 s", "97 %", "front cornering x 0.70", "From 0.0 .. 36.0 s",
                 "From 36.0 .. 119.9 s", "From 119.9 .. 200.0 s", "<td>front axle changed</td>"):  # fmt: skip
        assert text in page, text
    assert "<h3>Grip</h3>" not in page  # a setting, no estimate
    calm = drive(CALM)[1]
    write_report(tmp_path / "calm.html", Estimate(calm, False), log, default_vehicle(), Config({"grip_sd": 0.2}), [])
    page = (tmp_path / "calm.html").read_text(encoding="utf-8")
    assert "<h3>Grip</h3>" in page and "<h3>Sideslip angle</h3>" in page
    assert "What happened</h2>" not in page and "<th>Stretch</th>" not in page
