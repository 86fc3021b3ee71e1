"""What tselab gap writes and draws: residuals, gain of the estimator, figures, tables."""

import html
import json
import re
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pandas as pd
import pytest

from gap_logs import CAR
from tse.car.vehicle import read_vehicle
from tse.gaps.catalogue import Own, load_catalogue
from tse.gaps.drives import Candidate, prepare_candidate
from tse.gaps.fit import ChannelChange
from tse.gaps.infer.detect import Detectable
from tse.gaps.infer.naming import Named
from tse.gaps.infer.where import Condition
from tse.gaps.problem import Problem
from tse.gaps.run import output, pictures, report
from tse.identify.data import average_blocks
from tse.library.core import STIFFNESS, Config
from tse.log.rows import MEASURES
from tse.roads.road import Road, read_road


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    path = tmp_path_factory.mktemp("car") / "car.toml"
    path.write_text(CAR, encoding="utf-8")
    return Config.exact(read_vehicle(path).values)


def make_logs(config: Config, *names: str):
    """Return logs of a slalom of 4 s; accel_y is 0.5, and missing in one block."""
    t = 0.01 * np.arange(401)
    piece = (0.03 * np.sin(2 * np.pi * t), np.full(len(t), 15.0))
    logs = prepare_candidate(Candidate("slalom", (piece,) * len(names)), config)
    for log, name in zip(logs, names, strict=True):
        log.path = Path(f"{name}.csv")
        log.measured["accel_y"] = np.where((t[: len(log.time)] > 2) & (t[: len(log.time)] < 2.1), np.nan, 0.5)
    return logs


# ---- table of the residuals


def test_residuals_are_measured_minus_predicted_over_the_noise_before_and_after(config):
    fitted, held = Problem(make_logs(config, "a", "b"), config), Problem(make_logs(config, "a"), config)
    before, size = {"cy_front": 1.1}, {"body_roll_gain": 0.01}
    after = size | {Own("bank", 0, 0): 0.05, Own("bank", 0, 1): -0.05}
    level = fitted.holding({"cy_rear": 0.9})  # to be told from the problem of the fit
    table = output.make_table({"fit": (level, fitted), "held_out": (held, held)}, before, after)
    assert tuple(table.columns) == output.RESIDUAL_COLUMNS
    n = len(fitted.weight)
    fit, other = table.iloc[:n], table.iloc[n:]
    assert set(fit["part"]) == {"fit"} and set(other["part"]) == {"held_out"}
    assert fit["log"].tolist()[:: n // 2] == ["a", "b"] and set(fit["channel"]) == set(MEASURES)
    np.testing.assert_allclose(
        fit["residual_before"], np.where(level.weight > 0, level.compute_residuals(before), np.nan), atol=1e-9
    )
    np.testing.assert_allclose(
        fit["residual_after"], np.where(level.weight > 0, fitted.compute_residuals(after), np.nan), atol=1e-9
    )
    np.testing.assert_allclose(  # the held-out logs do not have the roads of the fitted ones
        other["residual_after"], np.where(held.weight > 0, held.compute_residuals(size), np.nan), atol=1e-9
    )
    assert np.abs(fit["residual_after"] - fit["residual_before"]).max() > 1
    hole = fit["residual_before"].isna()
    assert 0 < hole.sum() < 20 and hole.equals(fit["noise"].isna()) and fit["measured"].isna().equals(hole)
    noise = dict(zip(fit["channel"], fit["noise"], strict=True))
    assert noise["yaw_rate"] == pytest.approx(0.001) and noise["accel_x"] == pytest.approx(0.03)
    good = fit[~hole]
    np.testing.assert_allclose(
        (good["measured"] - good["predicted_before"]) / good["noise"], good["residual_before"], atol=1e-9
    )
    mean, _ = average_blocks(fitted.logs[0], fitted.logs[0].time)
    assert fit["time"].tolist()[: len(mean)] == pytest.approx(mean) and fit["block"].iloc[1] == 1


def test_logs_of_one_name_are_numbered(config):
    problem = Problem(make_logs(config, "a", "b", "a", "a"), config)
    assert output.list_log_names(problem) == ["a", "b", "a (2)", "a (3)"]


# ---- gain of the estimator


def make_estimate(evidence: list[float], valid: list[int]) -> pd.DataFrame:
    table = {"log_evidence": evidence, "cx_front_valid": valid, "cy_front_valid": [1] * len(valid)}
    return pd.DataFrame(table | {"cy_rear_valid": [2] * len(valid)})  # 2: a reason


def test_the_gain_is_that_of_rows_which_both_used_and_of_logs_by_their_length(monkeypatch):
    tables = {
        ("one", "old"): make_estimate([1.0, 2.0, 0.0, np.nan, 5.0], [1, 0, 0, 0, 0]),
        ("one", "new"): make_estimate([3.0, 4.0, 9.0, 9.0, 0.0], [1, 1, 1, 0, 2]),
        ("two", "old"): make_estimate([-1.0], [0]),
        ("two", "new"): make_estimate([1.0], [1]),
    }
    monkeypatch.setattr(output, "make_config", lambda vehicle, log: (vehicle, None))
    monkeypatch.setattr(output, "estimate", lambda log, car: SimpleNamespace(table=tables[log[0], car]))
    logs = [("fit", "one", ["one"] * 5), ("held_out", "two", ["two"])]
    said = []
    found = output.compute_gain(logs, "old", "new", 1, said.append)
    one, two = found["logs"]
    assert (one["log"], one["part"], two["part"]) == ("one", "fit", "held_out")
    assert one["evidence"] == {"before": 1.5, "after": 3.5}
    assert one["valid"]["before"]["cx_front"] == 0.2 and one["valid"]["after"]["cx_front"] == 0.6
    assert found["log_evidence_per_row"] == pytest.approx(
        {"before": (5 * 1.5 - 1) / 6, "after": (5 * 3.5 + 1) / 6}
    )
    assert found["valid"]["after"] == pytest.approx({"cx_front": 4 / 6, "cy_front": 1, "cy_rear": 0})
    assert said == ["estimating one", "estimating one", "estimating two", "estimating two"]
    lines = output.describe_gain(found)
    assert lines[0] == "The estimator's front longitudinal stiffness: valid 17 -> 67 % of the time."
    assert output.compute_gain(logs, "old", "new", 3) == found


def test_gains_are_rows_of_quantity_before_and_after():
    gain = {
        "log_evidence_per_row": {"before": 1.2345, "after": 2.5},
        "valid": {"before": dict.fromkeys(STIFFNESS, 0.126), "after": dict.fromkeys(STIFFNESS, 0.5)},
        "logs": [
            {"log": "a", "part": "fit", "evidence": {"before": 1.0, "after": 3.0}},
            {"log": "b", "part": "held_out", "evidence": {"before": 1.0, "after": 4.0}},
        ],
    }
    rows = report.make_gain_rows(gain)
    assert rows[0] == ("log evidence per row [nat], mean over all logs", "1.234", "2.500")
    assert rows[2] == ("Front cornering stiffness: valid", "13 % of the time", "50 % of the time")
    assert rows[4:] == [
        ("a: log evidence per row [nat]", "1.000", "3.000"),
        ("b (held out): log evidence per row [nat]", "1.000", "4.000"),
    ]


# ---- files and titles


def make_road(bank: float) -> Road:
    s = np.arange(3.0)
    level = np.full(3, 0.001)
    return Road(s, np.full(3, bank), 0 * s, level, level, curvature=0 * s)


def test_roads_are_numbered_and_those_of_an_earlier_run_are_removed(tmp_path):
    for name in ("road.csv", "road_2.csv", "road_3.csv"):
        (tmp_path / name).write_text("of an earlier run", encoding="utf-8")
    roads = SimpleNamespace(list_roads=lambda: [make_road(0.01), make_road(0.02)])
    files = output.write_road_files(tmp_path, SimpleNamespace(roads=roads))
    assert [f.name for f in files] == ["road.csv", "road_2.csv"] == sorted(p.name for p in tmp_path.iterdir())
    assert [read_road(f).bank[0] for f in files] == [0.01, 0.02]
    assert output.write_road_files(tmp_path, SimpleNamespace(roads=None)) == []
    assert not list(tmp_path.iterdir())


def make_result(verdict: str, *ids: str, formula=None, possible=()) -> SimpleNamespace:
    named = [SimpleNamespace(effect=load_catalogue()[i]) for i in ids]
    return SimpleNamespace(
        verdict=verdict, formula=formula, naming=SimpleNamespace(named=named, possible=list(possible))
    )


@pytest.mark.parametrize(
    ("result", "title"),
    [
        (make_result("none"), "Nothing is missing that these logs could show"),
        (make_result("named", "body_roll", "mass"), "Missing: body_roll + mass"),
        (make_result("possible", possible=[{"id": "mass"}, {"id": "cg_shift"}]), "Possible: mass"),
        (make_result("not_in_catalogue", "mass"), "Not in the catalogue"),
        (
            make_result("not_in_catalogue", formula=SimpleNamespace(text="k * vel_y", place="yaw_moment")),
            "Not in the catalogue: k * vel_y at yaw_moment",
        ),
    ],
)
def test_the_title_of_the_picture_is_the_verdict(result, title):
    assert output.make_headline(result) == title


# ---- figures


def make_table(**logs: tuple[str, float, float]) -> pd.DataFrame:
    """Return residuals of 30 s for each log: part, size before, size after.

    The sizes are those from 8 to 16 s; a tenth of them at other times."""
    frames = []
    for log, (part, before, after) in logs.items():
        for channel, factor in (("accel_y", 1.0), ("yaw_rate", 1.5)):
            t = 0.04 * np.arange(750)
            shape = np.where((t >= 8) & (t < 16), 1.0, 0.1) * factor
            frame = {"part": part, "log": log, "channel": channel, "time": t, "measured": 1.0}
            frame |= {"predicted_before": 2.0, "predicted_after": 3.0}
            frames.append(
                pd.DataFrame(frame | {"residual_before": before * shape, "residual_after": after * shape})
            )
    table = pd.concat(frames, ignore_index=True)
    for name in ("part", "log"):
        table[name] = table[name].astype("category")
    table["channel"] = pd.Categorical(table["channel"], list(MEASURES))
    return table


def test_the_best_moment_is_where_adding_helped_most_in_a_held_out_log():
    table = make_table(a=("fit", 9.0, 1.0), b=("fit", 20.0, 19.5), c=("held_out", 5.0, 1.0))
    moment, channel, where = pictures.find_best_moment(table.sample(frac=1, random_state=1))
    assert (channel, where) == ("yaw_rate", "c, held out")
    assert moment["time"].is_monotonic_increasing
    assert (moment["time"].iloc[0], len(moment)) == (pytest.approx(8.0), 200)
    assert set(moment["log"]) == {"c"} and set(moment["channel"]) == {"yaw_rate"}
    fitted = make_table(a=("fit", 9.0, 1.0), b=("fit", 20.0, 15.0))
    fitted.loc[600, "residual_before"] = 60.0  # one row
    assert pictures.find_best_moment(fitted)[2] == "b"  # 175 is more than 80
    same = make_table(a=("fit", 2.0, 2.0), b=("fit", 3.0, 3.0))
    same.loc[same["time"] < 1, "residual_before"] = np.nan
    same["residual_after"] = same["residual_before"]
    assert pictures.find_best_moment(same)[1:] == ("yaw_rate", "b")  # nothing was added


def test_logs_with_the_largest_residuals_are_drawn_in_their_order(monkeypatch):
    table = make_table(
        a=("fit", 1.0, 1.0), b=("fit", 3.0, 1.0), c=("fit", 2.0, 9.0), d=("held_out", 4.0, 1.0)
    )
    assert [log for _, log in pictures._list_logs(table)] == ["a", "b", "c", "d"]
    monkeypatch.setattr(pictures, "MAX_DRAWN_LOGS", 3)
    assert pictures._list_logs(table) == [("fit", "b"), ("fit", "c"), ("held_out", "d")]


def test_the_overlay_has_lines_of_each_source_and_a_button_for_each_log():
    table = make_table(a=("fit", 1.0, 1.0), b=("held_out", 3.0, 1.0))
    table = table.drop(table[(table["log"] == "a") & (table["time"] > 4) & (table["time"] < 10)].index)
    figure = pictures.draw_overlay(table.sample(frac=1, random_state=1))
    assert [(t.name, t.yaxis) for t in figure.data[:6]] == [
        (name, axis) for axis in ("y", "y2") for name in ("measured", "before", "after")
    ]
    assert [np.nanmax(t.y) for t in figure.data[:3]] == [1, 2, 3]
    assert [t.visible for t in figure.data] == [True] * 6 + [False] * 6
    assert [t.showlegend for t in figure.data[:6]] == [True] * 3 + [False] * 3
    assert [a.text for a in figure.layout.annotations] == ["accel_y [m/s2]", "yaw_rate [rad/s]"]
    assert (figure.layout.xaxis.title.text, figure.layout.xaxis2.title.text) == (None, "time [s]")
    one, two = figure.layout.updatemenus[0].buttons
    assert (one.label, two.label) == ("a", "b (held out)")
    assert list(two.args[0]["visible"]) == [False] * 6 + [True] * 6
    line = figure.data[0]
    assert np.isnan(np.asarray(line.y, float)).sum() == 1 and np.all(np.diff(line.x) >= 0)
    assert line.x[-1] == pytest.approx(29.96)


def test_bars_have_the_interval_of_the_change_from_before_to_after():
    changes = {
        "accel_y": ChannelChange(2.0, 1.5, -0.25, (-0.3, -0.15)),
        "yaw_rate": ChannelChange(4.0, 1.0, -0.75, (-0.7, -0.6)),
    }
    figure = pictures.draw_gap_bars({"fit": changes, "held_out": {"yaw_rate": changes["yaw_rate"]}})
    before, after, *_ = figure.data
    assert (before.name, list(before.x), list(before.y)) == ("before", ["accel_y", "yaw_rate"], [2.0, 4.0])
    assert (after.name, list(after.y)) == ("after", [1.5, 1.0])
    assert list(after.error_y.array) == pytest.approx([2 * 0.85 - 1.5, 0.6])
    assert list(after.error_y.arrayminus) == pytest.approx([1.5 - 2 * 0.7, 0.0])  # 4 (1 - 0.7) is above 1
    assert [a.text for a in figure.layout.annotations] == ["fitted logs", "held-out logs"]
    assert [s.y0 for s in figure.layout.shapes] == [1.0, 1.0]
    assert [t.showlegend for t in figure.data] == [True, True, False, False]


def test_the_picture_has_lines_of_measured_before_and_after(monkeypatch):
    """Drawn on axes that record what they are asked for."""
    figure, above, below = MagicMock(), MagicMock(), MagicMock()
    above.get_ylim.return_value = (0.0, 1.0)

    @contextmanager
    def open_picture(path):
        assert path == "gap.png"
        yield SimpleNamespace(subplots=lambda *_, **__: (figure, (above, below)))

    monkeypatch.setattr(pictures, "open_picture", open_picture)
    pictures.draw_picture("gap.png", make_table(a=("fit", 5.0, 2.0)), "a title")
    drawn = [(set(c.args[1]), c.kwargs["label"]) for c in above.plot.call_args_list]
    assert drawn == [({1.0}, "measured"), ({2.0}, "simulated before"), ({3.0}, "simulated after")]
    assert [set(c.args[1]) for c in below.plot.call_args_list] == [{7.5}, {3.0}]
    colours, again = ([c.kwargs["color"] for c in axis.plot.call_args_list] for axis in (above, below))
    assert again == colours[1:] and len(set(colours)) == 3
    assert above.set_title.call_args.args == ("yaw_rate in a",)
    above.set_ylabel.assert_called_once_with("rad/s")
    assert figure.suptitle.call_args.args == ("a title",)


# ---- numbers and facts of the report


@pytest.mark.parametrize(
    ("x", "text"),
    [(0.123, "12 %"), (0.99, "99 %"), (0.991, "> 99 %"), (1.0, "> 99 %"), (1.2, "120 %"), (-0.3, "0 %")],
)
def test_a_share_is_in_percent_and_not_below_0(x, text):
    assert report.format_percent(x) == text


@pytest.mark.parametrize(
    ("args", "text"),
    [
        ((0.01234,), "0.0123"),
        ((12.0, "m"), "12 m"),
        ((2.5, "1"), "2.5"),
        ((np.inf, "m"), "never"),
        ((0.123456, "s", 4), "0.1235 s"),
    ],
)
def test_a_size_has_its_unit(args, text):
    assert report.format_size(*args) == text


def test_effects_are_sorted_by_how_visible_they_are():
    found = [
        SimpleNamespace(id=i, smallest=s, typical=t) for i, s, t in (("a", 1, 1), ("b", 3, 10), ("c", 0.5, 1))
    ]
    assert [d.id for d in report.sort_by_size(found)] == ["b", "c", "a"]


def test_the_facts_are_logs_noise_and_stiffness_before_and_after(config):
    logs = make_logs(config, "a", "b", "c")
    for log, sd in zip(logs, (0.01, 0.05, 0.02), strict=True):
        log.noise["yaw_rate"] = sd
    del logs[1].noise["accel_x"]
    problem = SimpleNamespace(logs=logs)
    baseline = SimpleNamespace(values=dict.fromkeys(STIFFNESS, 0.9))
    result = SimpleNamespace(problem=problem, held=None, naming=SimpleNamespace(baseline=baseline))
    shown = report.ReportInput(result, "car", pd.DataFrame(), {}, {}, dict.fromkeys(STIFFNESS, 1.25))
    facts = dict(report.list_facts(shown))
    assert facts["Logs fitted"] == "a (3 s); b (3 s); c (3 s)" and "Logs held out" not in facts
    noise = facts["Sensor noise of one row, from the logs"]
    assert noise == "accel_x 0.06 m/s2, accel_y 0.06 m/s2, yaw_rate 0.02 rad/s"
    assert facts["Rear cornering stiffness, ratio to the vehicle file"] == "0.900 before, 1.250 after"
    result.held = SimpleNamespace(logs=logs[:1])
    assert dict(report.list_facts(shown))["Logs held out"] == "a (3 s)"


def test_the_page_says_verdict_remainder_and_whether_something_was_added(monkeypatch, tmp_path):
    """The templates are tested by whole runs; here is what the code says beside them."""
    made = {}
    monkeypatch.setattr(report, "list_facts", lambda _: [])
    monkeypatch.setattr(report.pictures, "draw_overlay", lambda _: None)
    monkeypatch.setattr(
        report, "write_page", lambda path, template, sections, **words: made.update(words, sections=sections)
    )
    gain = {
        "log_evidence_per_row": {"before": 1, "after": 2},
        "valid": {w: dict.fromkeys(STIFFNESS, 1) for w in output.BOTH},
    }
    changes = {"yaw_rate": ChannelChange(2.0, 1.0, -0.5, (-0.6, -0.4))}

    def write(result: SimpleNamespace) -> dict:
        shown = report.ReportInput(
            result, "car", make_table(a=("fit", 1.0, 1.0)), {"fit": changes}, gain | {"logs": []}, {}
        )
        report.write_report(tmp_path / "r.html", shown)
        return made

    claim = "Nothing was added, so after is the same as before."
    words = write(make_result("none"))
    assert (
        words["title"] == "Nothing is missing" and words["place"] == "" and claim in words["sections"][0][1]
    )
    assert claim not in write(make_result("named", "mass"))["sections"][0][1]
    formula = SimpleNamespace(text="x", place="yaw_moment")
    words = write(make_result("not_in_catalogue", formula=formula))
    assert claim not in words["sections"][0][1] and words["title"] == "Not in the catalogue"
    assert "yaw" in words["place"]


def test_all_files_are_of_the_improved_car_and_of_the_logs_before_and_after(monkeypatch, config, tmp_path):
    """The car is told without sensors, which are those of the first log for both cars."""
    bare = CAR.split("[sensors]")[0]
    vehicle, improved = tmp_path / "mine.toml", tmp_path / "vehicle_improved.toml"
    vehicle.write_text(bare, encoding="utf-8")
    improved.write_text(bare.replace("rear = 130000.0", "rear = 117000.0"), encoding="utf-8")
    problem, held = Problem(make_logs(config, "a"), config), Problem(make_logs(config, "b"), config)
    level, held_level = problem.holding({"cy_rear": 1.0}), held.holding({"cy_rear": 1.0})
    n = len(problem.weight)

    def make_fit(size):
        return SimpleNamespace(values={"cy_front": size}, residuals=np.full(n, size))

    logs = [
        ("fit", SimpleNamespace(path=Path("one.csv"))),
        ("held_out", SimpleNamespace(path=Path("two.csv"))),
    ]
    result = SimpleNamespace(
        problem=problem, level=level, held=held, held_level=held_level, read=logs, words=["w"], roads=None,
        naming=SimpleNamespace(baseline=make_fit(4.0), final=make_fit(3.0)), final=make_fit(1.0),
        after={"cy_front": 0.9}, held_out={"yaw_rate": "changes"}, verdict="none",
        as_json=lambda: {"verdict": "none", "words": result.words},
    )  # fmt: skip
    seen = {}

    def record(key, result):
        return lambda *given: seen.setdefault(key, []).append(given) or result

    for module, key, value in (
        (output.add, "write_vehicle", (improved, tmp_path / "effects.h")),
        (output, "make_table", pd.DataFrame({"x": [1.0]})),
        (output, "compute_gain", {"gain": 2.0}),
        (output, "fill_sensors", None),
        (output.report, "write_report", None),
        (output.pictures, "draw_picture", None),
    ):
        monkeypatch.setattr(module, key, record(key, value))
    monkeypatch.setattr(output, "describe_stiffness", lambda car: f"stiffness of {car.path.name}")
    written = output.write_all(tmp_path, result, vehicle, 3)
    assert seen["write_vehicle"] == [(tmp_path, vehicle, problem, result)]
    ((parts, before, after),) = seen["make_table"]
    assert parts == {"fit": (level, problem), "held_out": (held_level, held)}
    assert (before, after) == ({"cy_front": 4.0}, {"cy_front": 0.9})
    change = written.changes["fit"]["yaw_rate"]
    assert (change.before, change.after) == (4.0, 1.0)
    assert written.changes["held_out"] == {"yaw_rate": "changes"} and written.gain == {"gain": 2.0}
    ((read, old, new, jobs, _),) = seen["compute_gain"]
    assert read == [("fit", "one", logs[0][1]), ("held_out", "two", logs[1][1])] and jobs == 3
    assert [c.values["cornering_stiffness_rear"] for c in (old, new)] == [130e3, 117e3]
    assert [(c is old, log) for c, log in seen["fill_sensors"]] == [(True, logs[0][1]), (False, logs[0][1])]
    stiffness = {"cx_front": 1.0, "cy_front": 1.0, "cy_rear": pytest.approx(0.9)}
    ((path, shown),) = seen["write_report"]
    assert path == tmp_path / "report.html" and shown.stiffness == stiffness
    assert shown.vehicle == "small case (mine.toml)" and shown.parts is written.changes
    document = json.loads((tmp_path / "verdict.json").read_text(encoding="utf-8"))
    assert document["stiffness"] == stiffness and document["estimator"] == {"gain": 2.0}
    assert document["words"] == ["stiffness of vehicle_improved.toml", "w"]
    names = [f.name for f in written.files if f.name != "gap.png"]
    assert names == [
        "verdict.json", "vehicle_improved.toml", "effects.h", "report.html", "residuals.parquet",
    ]  # fmt: skip
    result.held, result.held_out, seen["make_table"] = None, {}, []
    vehicle.rename(tmp_path / "small case.toml")
    alone = output.write_all(tmp_path, result, tmp_path / "small case.toml")
    assert seen["make_table"][0][0] == {"fit": (level, problem)} and list(alone.changes) == ["fit"]
    assert seen["write_report"][1][1].vehicle == "small case.toml"


# ---- the page itself


def read_cells(page: str, heading: str) -> list[list[str]]:
    """Return the cells of the first table below a heading, without tags."""
    table = page.split(heading, 1)[1].split("<table>", 1)[1].split("</table>", 1)[0]
    rows = [re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", r, re.DOTALL) for r in table.split("</tr>")]
    return [
        [" ".join(html.unescape(re.sub(r"<[^>]+>", " ", c)).split()) for c in cells]
        for cells in rows
        if cells
    ]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """The page of a made-up run."""
    roll, mass = load_catalogue()["body_roll"], load_catalogue()["mass"]
    named = Named(
        roll, {"body_roll_gain": 0.02}, {"body_roll_gain": (0.018, 0.022)}, 0.6, 40.4, 0.95, ["mass"]
    )
    other = Named(mass, {"mass_change": -0.15}, {"mass_change": (-0.16, -0.14)}, 0.1, 9.0, 0.999)
    possible = [{"id": "relaxation", "probability": 0.4, "why": "below 90 %"}]
    sets = [{"ids": ["body_roll", "mass"], "probability": 0.8}, {"ids": [], "probability": 0.2}]
    naming = SimpleNamespace(named=[named, other], possible=possible, sets=sets, baseline=None)
    number = SimpleNamespace(name="k", text="factor", value=2.0, unit="rad/s/m", sd=None)
    formula = SimpleNamespace(
        text="k * vel_y",
        place="yaw_moment",
        numbers=[number],
        found={"driven_vel_y": [-1.0, 2.5], "nats": [3, 4]},
    )
    tried = [{"place": "yaw_moment", "formula": "k * vel_y", "nats": 12.3, "share": 0.3, "held_out": True},
             {"place": "front_angle", "formula": "k", "nats": 2, "share": 0.1, "held_out": 0}]  # fmt: skip
    result = SimpleNamespace(
        verdict="not_in_catalogue", words=["Words of the <run>."], notes=["a note"], naming=naming,
        formula=formula, discovery=SimpleNamespace(tried=tried),
        conditions=[Condition("yaw_rate", f"c{k}", 0.5 - 0.1 * k) for k in range(14)],
        remainders=[SimpleNamespace(words="yaw_rate is left")],
        elsewhere=[SimpleNamespace(words="accel_y there")],
        undetectable=[make_detectable("relaxation", 1.4), make_detectable("mass", np.inf)],
        detectable=[make_detectable("relaxation", 1.4), make_detectable("bank", 0.01)],
        rivals=[{"ids": [], "formula": "k", "probability": 0.3},
                {"ids": ["mass"], "formula": None, "probability": 0.7}],
    )  # fmt: skip
    path = tmp_path_factory.mktemp("page") / "r.html"
    gain = {"log_evidence_per_row": {"before": 1, "after": 2},
            "valid": {w: dict.fromkeys(STIFFNESS, 1) for w in output.BOTH}, "logs": []}  # fmt: skip
    changes = {"fit": {"yaw_rate": ChannelChange(2.0, 1.0, -0.5, (-0.6, -0.4))}}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report, "list_facts", lambda _: [("Logs fitted", "a (3 s)")])
        patch.setattr(report.pictures, "draw_overlay", lambda _: None)
        shown = report.ReportInput(
            result, "car.toml", make_table(a=("fit", 1.0, 1.0)), changes, gain, {}, ["of car"]
        )
        report.write_report(path, shown)
    return path.read_text(encoding="utf-8")


def make_detectable(i: str, smallest: float) -> Detectable:
    p = load_catalogue()[i].strengths[0]
    return Detectable(i, p.name, p.unit, smallest, 0.5, 0.25)


def test_a_named_effect_is_in_the_page_with_interval_typical_size_and_look_alikes(page):
    head, roll, mass = read_cells(page, "<h2>Named effects</h2>")
    assert head[:4] == ["Effect", "Parameter", "Value", "95 %"]
    assert roll[0].startswith("body_roll") and roll[1].startswith("gain")
    assert roll[2:] == [
        "0.02 rad s2/m", "0.018 .. 0.022", "0.0053 .. 0.0107 not typical", "95 %", "60 %", "40", "mass",
    ]  # fmt: skip
    assert mass[5:] == ["> 99 %", "10 %", "9", "none"] and "not typical" not in mass[4]


def test_a_formula_is_in_the_page_with_place_numbers_and_range(page):
    assert "<code>k * vel_y</code><br>added at <b>yaw_moment</b>: " in page
    assert read_cells(page, "A formula for what is not in the catalogue")[1] == ["k factor", "2 rad/s/m", "-"]
    assert "99 % of the time: vel_y -1 .. 2.5. Outside this range" in page
    tried = read_cells(page, "2 formulas that were simulated")[1:]
    assert tried == [
        ["yaw_moment", "k * vel_y", "12", "30 %", "yes"], ["front_angle", "k", "2", "10 %", "no"],
    ]  # fmt: skip


def test_the_page_has_words_notes_conditions_and_what_is_left(page):
    assert "<p>Words of the &lt;run&gt;.</p>" in page and "<li>a note</li><li>of car</li>" in page
    conditions = read_cells(page, "Under which conditions")
    assert len(conditions) == 13 and conditions[1] == ["yaw_rate", "c0", "+0.50"] and "And 2 weaker;" in page
    assert conditions[7][2] == "-0.10"
    assert "<li>yaw_rate is left</li>" in page and "<li>Held-out logs: accel_y there</li>" in page
    assert read_cells(page, "What the estimator gains")[1][1:] == ["1.000", "2.000"]
    assert read_cells(page, "<h2>The run</h2>") == [["Logs fitted", "a (3 s)"]]


def test_the_page_has_effects_that_could_not_be_seen_and_those_that_were_not_found(page):
    hidden = read_cells(page, "What these logs could not have shown")
    assert hidden[1] == [
        "relaxation",
        "length",
        "1.4 m",
        "0.5 m",
        "25 %",
        load_catalogue()["relaxation"].channels,
    ]
    assert hidden[2][:3] == ["mass", "change", "never"]
    assert "1 effects that would have been visible" in page
    assert read_cells(page, "1 effects that would have been visible")[1][:3] == ["bank", "angle", "0.01 rad"]
    assert read_cells(page, "Combinations of named effects and formulas")[1:] == [
        ["none", "k", "30 %"],
        ["mass", "-", "70 %"],
    ]
    assert read_cells(page, "Probability of each set")[1:] == [
        ["body_roll + mass", "80 %"],
        ["no effect", "20 %"],
    ]
    assert "relaxation (40 %: below 90 %)" in page
