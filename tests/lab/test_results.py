"""Results of a run as exit code, table, document and text; tables of the library."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import tomllib

from tse.car.vehicle import get_unknown_car, make_default_vehicle, read_vehicle
from tse.estimation.answer import compute_held_stiffness, describe_rest
from tse.estimation.estimate import Estimates
from tse.estimation.regimes import Change, Spell, Stretch
from tse.estimation.verdict import Finding, Quantity, Verdict
from tse.library.core import CONFIG, GRIP, REASON, SIM_CONFIG, STATUS, STIFFNESS, Config, library
from tse.log.rows import CheckedLog, list_columns
from tse.report import report, results, tables


def make_verdict(key: str = "cy_front", level: str = "good", **more) -> Verdict:
    """Return a verdict of 100 +- 9.8 kN/rad, smoothed 110 +- 4.9."""
    known = {"value": 100.0, "band": 9.8, "spread": 0.05, "nominal": 120.0, "valid": 0.6}
    known |= {"reason": "uncertain", "reason_share": 0.3, "text": f"text of {key}"}
    known |= {"smoothed": 110.0, "smoothed_band": 4.9, "smoothed_reason": "valid"}
    return Verdict(key, key, level, "kN/rad", **(known | more))


def make_finding(*levels: str, stretch: Stretch | None = None, others=()) -> Finding:
    return Finding(
        stretch, [make_verdict(k, level) for k, level in zip(STIFFNESS, levels, strict=False)], others
    )


def make_table(n: int = 101, **columns: object) -> pd.DataFrame:
    return pd.DataFrame({"time": 2.0 + 0.1 * np.arange(n), "status": np.zeros(n, int)} | columns)


GOOD, PARTLY, NONE = ("good",) * 3, ("partly",) * 3, ("none",) * 3


@pytest.mark.parametrize(
    ("found", "code"),
    [
        ([], 4),
        ([GOOD], 0),
        ([NONE], 4),
        ([PARTLY], 3),
        ([("good", "good", "partly")], 3),
        ([("good", "good", "none")], 3),
        ([("good", "none", "none")], 3),
        ([GOOD, NONE], 0),  # the best stretch of road counts, not the worst or the last
        ([NONE, GOOD], 0),
        ([PARTLY, NONE], 3),
        ([NONE, PARTLY, NONE], 3),
        ([("good", "none", "none"), ("none", "good", "good")], 0),  # each stiffness on its own stretch
        ([("good", "none", "none"), ("none", "good", "none")], 3),
        ([NONE, NONE], 4),
    ],
)
def test_each_stiffness_is_as_usable_as_on_its_best_stretch(found, code):
    assert results.choose_exit_code([make_finding(*levels) for levels in found]) == code


def test_a_verdict_is_a_row_in_newton_with_sd_and_interval():
    row = results._convert_verdict(make_verdict(level="partly"))
    expected = {
        "value": 100e3, "sd": 5e3, "low": 90.2e3, "high": 109.8e3,
        "smoothed": 110e3, "smoothed_sd": 2.5e3, "smoothed_low": 105.1e3, "smoothed_high": 114.9e3,
        "spread": 0.05, "nominal": 120e3, "valid": 0.6,
    }  # fmt: skip
    assert {k: row[k] for k in expected} == pytest.approx(expected)
    words = ("stiffness", "usable", "reason", "smoothed_reason")
    assert [row[k] for k in words] == ["cy_front", "in part", "uncertain", "valid"]
    for level, usable, reason in (("good", "yes", None), ("none", "no", "uncertain")):
        row = results._convert_verdict(make_verdict(level=level, smoothed_reason=""))
        assert (row["usable"], row["reason"], row["smoothed_reason"]) == (usable, reason, None)
    assert results._convert_verdict(make_verdict(level="none", reason=""))["reason"] is None


def make_two_stretches() -> tuple[list[Finding], list[Change]]:
    found = [
        make_finding("good", "good", "partly", stretch=Stretch(2.0, 6.0, slice(0, 40))),
        make_finding("none", "good", "good", stretch=Stretch(6.0, 12.0, slice(40, 101))),
    ]
    changes = [
        Change(2.0, 1, 0.91, {"cy_front": (0.5, 0.01)}),
        Change(6.0, 2, 0.97, {"cy_front": (0.7, 0.02)}),
        Change(9.0, 3, 0.99, {"cy_front": (0.9, 0.03)}),
    ]
    return found, changes


def test_rows_have_their_stretch_and_the_change_that_begins_it():
    found, changes = make_two_stretches()
    rows = results.make_rows(
        Path("a/log.csv"), Estimates(make_table(), False), found, changes, ["one", "two"]
    )
    assert [(r["stretch"], r["start"], r["end"]) for r in rows] == [(1, 2, 6)] * 3 + [(2, 6, 12)] * 3
    assert [r["stiffness"] for r in rows] == [*STIFFNESS] * 2
    assert [r["change"] for r in rows] == [None] * 3 + ["front axle changed"] * 3
    front = rows[4]
    assert (front["ratio"], front["ratio_sd"], front["change_probability"]) == (0.7, 0.02, 0.97)
    for row in (rows[1], rows[3], rows[5]):  # nothing before the first, and no ratio of the others
        assert np.isnan([row["ratio"], row["ratio_sd"]]).all()
    assert np.isnan(rows[0]["change_probability"]) and rows[3]["change_probability"] == 0.97
    assert rows[0]["warnings"] == "one\ntwo" and rows[0]["text"] == "text of cx_front"
    assert rows[0]["log"] == str(Path("a/log.csv")) and set(rows[0]) == set(results.ESTIMATE_COLUMNS)


def test_a_whole_log_goes_from_its_first_to_its_last_estimate():
    est = Estimates(make_table(estimate_age=0.5), False)
    (row, *_) = results.make_rows(Path("x"), est, [make_finding(*GOOD)], [Change(1.5, 1, 0.9, {})], ())
    assert (row["stretch"], row["start"], row["end"]) == (1, 1.5, 11.5)
    assert row["warnings"] is None and row["change"] is None
    (row, *_) = results.make_rows(Path("x"), Estimates(make_table(0), False), [make_finding(*NONE)], [], ())
    assert np.isnan([row["start"], row["end"]]).all()


def test_grip_and_sideslip_have_value_sd_and_interval():
    q = Quantity("sideslip", "Sideslip angle", "deg", 3.0, 0.98, np.nan, "", 4.5, "the largest")
    found = results._convert_quantity(q)
    assert np.isnan(found.pop("valid"))
    assert found == {
        "value": 3.0, "sd": pytest.approx(0.5), "low": pytest.approx(2.02), "high": pytest.approx(3.98),
        "unit": "deg", "time": 4.5, "reason": None,
        "text": "Sideslip angle: 3.00 ± 0.98 deg (95 %), the largest",
    }  # fmt: skip
    assert results._convert_quantity(replace(q, reason="held"))["reason"] == "held"


def test_a_document_has_each_stretch_with_its_own_stiffnesses():
    found, _ = make_two_stretches()
    grip = Quantity(GRIP, "Grip", "1", 0.9, 0.1, 1.0, "", 4.5, "valid")
    found[1] = replace(found[1], others=[grip])
    est = Estimates(make_table(p_sliding=np.where(np.arange(101) == 50, 0.95, 0.0)), False)
    made = results.make_document(
        Path("log.csv"), est, found, Config.exact({"mass": 1500.0}), {"notes": ["n"], "vehicle": "v"}
    )
    assert (made["log"], made["notes"], made["vehicle"]) == ("log.csv", ["n"], "v")
    assert (made["rows"], made["seconds"]) == (101, pytest.approx(10.0))
    assert (made["usable"], made["exit_code"]) == ("yes", 0) and made["settings"]["mass"] == 1500
    one, two = made["stretches"]
    assert (one["start"], one["end"], two["stretch"]) == (2.0, 6.0, 2) and set(one["stiffness"]) == {
        *STIFFNESS
    }
    assert (one["stiffness"]["cy_rear"]["usable"], two["stiffness"]["cy_rear"]["usable"]) == (
        "in part",
        "yes",
    )
    assert two["stiffness"]["cx_front"]["usable"] == "no"
    left = {"log", "warnings", "stiffness", "start"}
    assert not left & set(one["stiffness"]["cy_rear"]) and "sd" in one["stiffness"]["cy_rear"]
    assert GRIP not in one and two[GRIP]["value"] == 0.9
    (spell,) = made["spells"]
    assert (spell["what"], spell["start"]) == ("sliding", pytest.approx(7.0)) and made["changes"] == []
    empty = results.make_document(
        Path("x"), Estimates(make_table(0), False), [make_finding(*NONE)], Config.exact(), {}
    )
    assert (empty["rows"], empty["seconds"], empty["usable"]) == (0, 0.0, "no")


def test_a_document_names_each_change():
    n = 101
    at = 2.0 + 0.1 * np.arange(n)
    after = at >= 7.0
    columns = {
        "change_age": np.where(after, at - 7.0, 0.0),
        "change_kind": np.where(after, 2, 0),
        "change_probability": np.where(after, 0.95, 0.0),
        "change_cy_front": np.where(after, 0.7, 1.0),
    }
    est = Estimates(make_table(n, **columns), False)
    (change,) = results.make_document(Path("x"), est, [make_finding(*GOOD)], Config.exact(), {})["changes"]
    assert (change["what"], change["kind"], change["time"]) == ("front axle changed", 2, pytest.approx(7.0))
    assert change["ratio"]["cy_front"][0] == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("given", "plain"),
    [
        (np.float32(0.5), 0.5),
        (np.float64(np.nan), None),
        (-np.inf, None),
        (np.int64(3), 3),
        (np.bool_(True), True),
        (Path("a"), "a"),
        ({1: (np.nan, 2.0)}, {"1": [None, 2.0]}),
        ([{"x": np.inf}, None, "t"], [{"x": None}, None, "t"]),
    ],
)
def test_data_become_what_json_has(given, plain):
    made = results.convert_to_plain(given)
    assert made == plain and type(made) is type(plain) and json.loads(json.dumps(made)) == plain


def test_a_table_is_written_as_its_name_ends_with_its_columns_in_order(tmp_path):
    columns = {"b": "Float64", "n": "Int64", "a": "string"}
    rows = [{"a": "x", "b": np.nan, "n": 3}, {"a": None, "b": 0.25, "n": None}]
    results.write_rows(tmp_path / "t.csv", rows, columns)
    assert (tmp_path / "t.csv").read_bytes() == b"b,n,a\n,3,x\n0.25,,\n"
    results.write_rows(tmp_path / "t.parquet", rows, columns)
    found = pd.read_parquet(tmp_path / "t.parquet")
    assert (
        list(found) == ["b", "n", "a"] and found["n"][0] == 3 and found["b"].isna().tolist() == [True, False]
    )
    results.write_rows(tmp_path / "free.csv", rows)
    assert pd.read_csv(tmp_path / "free.csv").columns.tolist() == ["a", "b", "n"]
    results.write_rows(tmp_path / "none.csv", [], columns)
    assert (tmp_path / "none.csv").read_text() == "b,n,a\n"
    assert results.make_frame([{"c": 1}], {"b": "Float64"}).columns.tolist() == ["b"]


def make_log(n: int = 101, **more) -> CheckedLog:
    data = pd.DataFrame({c: np.zeros(n) for c in list_columns()[1:]})
    return CheckedLog(
        Path("d/drive.csv"), 0.1 * np.arange(n), data, pd.DataFrame(), np.arange(n), 0.1, **more
    )


def test_the_facts_of_a_run_are_those_of_its_log_and_its_end():
    vehicle = make_default_vehicle()
    est = Estimates(make_table(), False)
    plain = dict(results.list_run_facts(est, make_log(), vehicle, Config.exact()))
    assert plain["Log"] == "drive.csv: 101 rows, 10.0 s, every 100 ms"
    assert set(plain) == {"Log", "Vehicle", "Filter"} and plain["Vehicle"] == vehicle.name
    late = Config.exact({"accel_y_latency": 0.03, "steer_angle_latency": -0.02})
    est = Estimates(
        make_table(60, estimate_age=np.linspace(0.05, 0.03, 60)), True, statuses={0: 50, 7: 3, 1: 7}
    )
    vehicle.path = Path("e/car.toml")
    facts = dict(results.list_run_facts(est, make_log(averaged=5), vehicle, late, 8))
    assert facts["Log"] == "drive.csv: 101 rows, 5.9 s, every 100 ms (means of 5 rows)"
    assert facts["Vehicle"] == f"{vehicle.name} (car.toml)"
    assert set(facts["Latency"].partition(" behind")[0].split(", ")) == {
        "steer_angle -20 ms",
        "accel_y 30 ms",
    }
    assert facts["Latency"].endswith("behind yaw_rate; estimates refer to 30 ms before their row")
    assert facts["Stopped"] == "by Ctrl-C after 60 of 101 rows"
    assert facts["Recoveries"].startswith("3 (") and facts["Plots"] == "min and max of every 8 rows"
    none = dict(results.list_run_facts(Estimates(make_table(0), True), make_log(), vehicle, late))
    assert ", 0.0 s," in none["Log"] and "estimates refer to 0 ms" in none["Latency"]
    assert "Plots" not in none


# ---- what happened, in the report


def test_events_are_in_order_of_time_and_only_spells_have_a_probability():
    changes = [Change(30.0, 1, 0.97, {"cy_front": (0.7, 0.02)}), Change(12.5, 3, 0.95, {})]
    spells = [Spell("sliding", 20.0, 31.5, 0.993), Spell("fault", 5.0, 6.0, 0.92, "yaw_rate")]
    assert report.list_events(changes, spells) == [
        ("5.00 .. 6.00 s", "yaw_rate at fault", "92 %", ""),
        ("12.50 s", "rear axle changed", "", ""),
        ("20.00 .. 31.50 s", "sliding", "99 %", ""),
        ("30.00 s", "road changed", "", "front cornering x 0.70 ± 0.02"),
    ]


def test_of_too_many_events_the_likeliest_are_listed(monkeypatch):
    monkeypatch.setattr(report, "MAX_TABLE_EVENTS", 3)
    changes = [Change(float(t), 1, p, {}) for t, p in ((1, 0.91), (2, 0.99), (3, 0.92))]
    spells = [Spell("sliding", 0.5, 0.7, 0.98), Spell("sliding", 9.0, 9.5, 0.97)]
    assert [e[0] for e in report.list_events(changes, spells)] == [
        "0.50 .. 0.70 s",
        "2.00 s",
        "9.00 .. 9.50 s",
    ]


def test_a_page_has_its_figures_in_order_and_none_for_a_section_without_one(tmp_path):
    def figure(name: str, height: int) -> SimpleNamespace:
        return SimpleNamespace(height=height, as_dict=lambda: {"data": [name], "layout": {}})

    sections = [
        ("First", "a <b>", figure("x", 310)),
        ("Left out", "c", None),
        ("Third", "d", figure("y", 205)),
    ]
    words = {
        "title": "T",
        "facts": [],
        "converged": True,
        "vehicle": "",
        "words": [],
        "notes": [],
        "groups": [],
    }
    report.write_page(tmp_path / "p.html", "calibrate.html.j2", sections, **words)
    page = (tmp_path / "p.html").read_text(encoding="utf-8")
    assert [f["data"] for f in report.read_figures(page)] == [["x"], ["y"]]
    assert "Left out" not in page and "a &lt;b&gt;" in page
    for number, height in ((0, 310), (1, 205)):
        assert f'id="plot{number}" class="plot" style="min-height: {height}px"' in page
    report.write_page(tmp_path / "p.html", "calibrate.html.j2", [("Left out", "c", None)], **words)
    page = (tmp_path / "p.html").read_text(encoding="utf-8")
    assert 'class="plot"' not in page and len(page) < 100_000  # no library of plots


def write_findings(path: Path, found: list[Finding], **more) -> str:
    """Return the report of findings without figures."""
    vehicle = make_default_vehicle()
    vehicle.filled, vehicle.found = ["a value"], ["a cause"]
    words = {"title": "log", "vehicle": vehicle, "findings": found, "spread": False, "most": 1, "events": []}
    words |= {"facts": [("Log", "f")], "changed": [], "notes": ["a <note>"]}
    filters = {"held": compute_held_stiffness, "beside": describe_rest}
    report.write_page(path, "report.html.j2", [], filters=filters, **(words | more))
    return path.read_text(encoding="utf-8")


def read_rows(page: str, heading: str) -> list[list[str]]:
    """Return the cells of the first table below a heading, without tags."""
    table = page.split(heading, 1)[1].split("<table>", 1)[1].split("</table>", 1)[0]
    rows = [re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", r, re.DOTALL) for r in table.split("</tr>")]
    return [[" ".join(re.sub(r"<[^>]+>", " ", c).split()) for c in cells] for cells in rows if cells]


@pytest.mark.parametrize(("form", "grip_sd", "grip"), [(0, 0.2, True), (0, 0.0, False), (1, 0.2, False)])
def test_a_report_draws_and_lists_what_belongs_to_its_run(form, grip_sd, grip, monkeypatch):
    drawn, pages, judged = {}, [], []
    for name in ("stiffness", "states", "inputs", "health", "other_references"):
        monkeypatch.setattr(
            report.plots, f"draw_{name}", lambda *given, name=name: drawn.setdefault(name, given)
        )
    monkeypatch.setattr(report.regimes, "find_changes", lambda table: ["change"])
    monkeypatch.setattr(report.regimes, "find_spells", lambda table: ["spell"])
    monkeypatch.setattr(report, "make_findings", lambda *given: judged.append(given) or ["found"])
    monkeypatch.setattr(report, "list_events", lambda *given: given)
    monkeypatch.setattr(report, "list_run_facts", lambda *given: given)
    monkeypatch.setattr(report, "write_page", lambda *given, **words: pages.append(words))
    config = Config.exact({"form": form, "grip_sd": grip_sd})
    est, data = (
        Estimates(make_table(), False, uncertainty_sd={"mass_sd": np.ones(3)}),
        SimpleNamespace(stride=4),
    )
    log = SimpleNamespace(path=Path("x.csv"))
    report.write_report(Path("r"), est, log, "car", config, ["a note"], data, ["a sign"])
    assert judged == [(est.table, config, ["change"], ["a sign"], est.uncertainty_sd)]
    assert drawn["stiffness"] == (data, est.table, config, ["change"], ["spell"])
    assert drawn["states"] == (data, grip)
    (words,) = pages
    assert words["spread"] is (form == 1) and words["events"] == (["change"], ["spell"])
    assert words["facts"] == (est, log, "car", config, 4) and words["notes"] == ["a note"]
    assert words["findings"] == ["found"] and words["title"] == "x.csv"
    report.write_report(Path("r"), est, log, "car", config, [], data, judged=(["other"], ["known"]))
    assert len(judged) == 1 and pages[1]["findings"] == ["known"]
    assert pages[1]["events"] == (["other"], ["spell"])


def test_the_report_has_a_card_and_a_line_of_each_stiffness(tmp_path):
    slip = Quantity("sideslip", "Sideslip angle", "deg", 3.0, 0.98, np.nan, "", 4.5, "the largest")
    grip = Quantity(GRIP, "Grip", "1", 0.9, 0.1, 0.7, "", 4.5, "of grip")
    found = make_finding("good", "partly", "none", others=(grip, slip))
    found.verdicts[1] = replace(found.verdicts[1], smoothed=np.nan, smoothed_reason="", reason="")
    found.verdicts[2] = replace(found.verdicts[2], smoothed_reason="uncertain", value=np.nan)
    page = write_findings(tmp_path / "r.html", [found])
    cards = [" ".join(re.sub(r"<[^>]+>", " ", c).split()) for c in page.split('<div class="verdict ')[1:]]
    assert cards[0].startswith('good"> usable cx_front 110 ± 5 kN/rad (95 %)')
    assert cards[1].startswith('partly"> usable in part cy_front 100 ± 10 kN/rad (95 %)')
    assert cards[2].startswith('none"> not valid cy_rear 110 ± 5 kN/rad (95 %)')
    assert cards[3].startswith('good"> Grip 0.90 ± 0.10 (95 %) of grip')
    assert cards[4].startswith('partly"> Sideslip angle 3.00 ± 0.98 deg (95 %) the largest')
    head, front, steer, rear, third, angle = read_rows(page, "<h2>Summary</h2>")
    assert head[2] == "Smoothed over the log, with 95 % interval" and len(head) == len(front) == 6
    assert front == [
        "cx_front", "60.0 %", "110.0 ± 4.9 kN/rad, valid", "100.0 ± 9.8 kN/rad", "120.0 kN/rad",
        "uncertain (30 % of the log)",
    ]  # fmt: skip
    assert (steer[2], steer[5]) == ("-", "-")
    assert rear[2:4] == ["110.0 ± 4.9 kN/rad, not valid: uncertain", "-"]
    assert third[:3] == ["Grip", "70.0 %", "0.90 ± 0.10"] and angle[1:3] == ["-", "3.00 ± 0.98 deg"]
    for text in ("<li>a value</li>", "<li>a cause</li>", "<li>a &lt;note&gt;</li>"):
        assert text in page
    assert "What happened</h2>" not in page and read_rows(page, "<h2>The run</h2>") == [["Log", "f"]]


def test_the_report_of_stretches_has_spread_events_and_what_was_changed(tmp_path):
    found, _ = make_two_stretches()
    found[0].verdicts[1] = replace(found[0].verdicts[1], spread=np.nan)
    events = [("1.00 s", "road changed", "", "x 0.7"), ("2.00 s", "sliding", "95 %", "")]
    mass = Config.exact().fields["mass"]
    page = write_findings(
        tmp_path / "r.html", found, spread=True, events=events, changed=[(mass, 1234.5)], notes=[]
    )
    assert page.count('<div class="verdict ') == 3  # cards of the first stretch only
    assert page.count("From 2.0 .. 6.0 s") == 1 and "From 6.0" not in page
    rows = read_rows(page, "<h2>Summary</h2>")
    assert [r[0] for r in rows[1:]] == ["2.0 .. 6.0 s", "", "", "6.0 .. 12.0 s", "", ""]
    assert rows[0][3] == "Smoothed over the stretch, with 95 % interval"
    assert (rows[1][5], rows[2][5]) == ("5 %", "too small for this drive to measure")
    assert rows[1][7] == "uncertain (30 % of the stretch)"
    assert read_rows(page, "What happened")[1:] == [
        ["1.00 s", "road changed", "-", "x 0.7"], ["2.00 s", "sliding", "95 %", "-"],
    ]  # fmt: skip
    changed = read_rows(page, "1 settings that differ from the defaults")[1]
    assert changed[:2] == ["mass", "1234.5"] and changed[3:] == ["kg", mass.text]


# ---- tables as text


def test_a_table_is_as_wide_as_its_widest_cells_with_numbers_on_the_right():
    rows = [["name", "n", "x"], ["a", "10", "long"], ["longer", "2", ""]]
    assert tables.text_table(rows, right=(1,)) == "name     n  x\na       10  long\nlonger   2"
    assert tables.text_table(iter([("a", "b")])) == "a  b"


def test_a_long_text_in_the_last_column_goes_on_in_the_next_line():
    words = ["word"] * 60
    lines = tables.text_table([["name", "1", " ".join(words)], ["b", "22", "short"]], right=(1,)).split("\n")
    assert lines[0].startswith("name   1  word word") and lines[-1] == "b     22  short"
    assert len(lines) == 5 and all(x.startswith(10 * " " + "word") for x in lines[1:-1])
    assert " ".join(lines[:-1]).split() == ["name", "1", *words]
    assert max(map(len, lines)) <= tables.MAX_TABLE_WIDTH
    wide = tables.text_table([["x" * 100, " ".join(words)]]).split("\n")
    assert max(map(len, wide)) <= 102 + tables.MIN_TEXT


def test_a_markdown_table_has_its_numbers_on_the_right():
    assert tables.format_markdown_table(["", "a", "b"], [["x", "1", "2"]], 2) == [
        "| | a | b |",
        "|---|---|---:|",
        "| x | 1 | 2 |",
    ]
    assert tables.format_markdown_table(iter("ab"), [])[1] == "|---|---:|"


@pytest.mark.parametrize("which", [CONFIG, SIM_CONFIG])
def test_settings_are_listed_with_default_range_unit_and_meaning(which):
    fields = library().fields(which)
    text = tables.settings_table() if which == CONFIG else tables.sim_settings_table()
    lines = re.sub(r"\n +", " ", text).splitlines()  # long texts go on in the next line
    assert len(lines) == 1 + len(fields) and lines[0].split() == [
        "setting",
        "default",
        "range",
        "unit",
        "meaning",
    ]
    for line, f in zip(lines[1:], fields, strict=True):
        name, default, rest = line.split(None, 2)
        assert name == f.name and float(default) == pytest.approx(f.default, rel=1e-5)
        assert rest.startswith(f"{f.low:g} .. {f.high:g}") and rest.endswith(f.text[-30:].rstrip())


def test_columns_of_a_log_and_of_estimates_have_their_units():
    time, *channels = tables.list_log_columns()
    assert time[:2] == ["time", "s"] and [c[0] for c in channels] == list_columns()[1:]
    yaw = next(f for f in library().channels if f.name == "yaw_rate")
    assert channels[-1] == ["yaw_rate", "rad/s", f"{yaw.low:g} .. {yaw.high:g}", yaw.text]
    assert tables.log_columns_table().splitlines()[0].startswith("time")
    rows = {r[0]: r for r in tables.list_estimate_columns()}
    units = {
        "cx_front": "N", "cx_front_sd": "N", "cy_rear": "N/rad", "cy_rear_spread": "N/rad",
        "vel_x": "m/s", "sideslip": "rad", "cy_front_reason": "", "grip": "1",
    }  # fmt: skip
    assert {k: rows[k][1] for k in units} == units and "time" not in rows
    assert rows["cy_rear_valid"][2] == rows["grip_valid"][2] == "1 valid, 0 not"
    assert rows["grip_reason"][2] == "valid, or why it is not valid" != rows["vel_x"][2]
    names = [x.split()[0] for x in tables.est_columns_table().splitlines() if x[0] != " "]
    assert names == list(rows)


def test_codes_are_in_order_with_their_sentences_and_without_refusals():
    status, reasons = tables.codes_table().split("\n\nreason\n")
    whole = status.replace("\n     ", " ")  # texts that go on in the next line
    codes = {int(line[:3]): line[5:] for line in whole.splitlines()[1:]}
    known = {code: f.text for code, f in library().codes(STATUS).items() if code >= 0}
    assert codes == known and list(codes) == sorted(codes)
    reasons = reasons.replace("\n    ", " ")
    assert reasons.split("\n") == [f"  {f.name}: {f.text}" for f in library().fields(REASON)]
    assert max(map(len, status.splitlines() + reasons.splitlines())) > tables.MAX_TABLE_WIDTH
    assert max(map(len, tables.codes_table().splitlines())) <= tables.MAX_TABLE_WIDTH


# ---- vehicle files to start from


def test_the_example_sets_what_is_required_and_has_the_rest_as_comments(tmp_path):
    text = tables.example_vehicle()
    given = tomllib.loads(text)
    car = Config.exact()
    assert given == {"name": "my car"} | {
        k: getattr(car, k) for k in ("mass", "lf", "lr", "wheel_radius_front", "wheel_radius_rear")
    }
    active = tomllib.loads(
        "\n".join(x.removeprefix("# ") for x in text.splitlines() if " = " in x or "# [" in x)
    )
    assert active["wheelbase"] == pytest.approx(car.lf + car.lr)
    assert active["uncertainty"]["mass_sd"] == get_unknown_car()["mass_sd"] > 0
    assert active["sensors"]["accel_x_sd"] == car.accel_x_sd and "yaw_inertia" in active
    (tmp_path / "car.toml").write_text(text, encoding="utf-8")
    assert read_vehicle(tmp_path / "car.toml").filled  # by values of an ordinary car


def test_the_file_of_the_simulated_car_is_the_simulated_car(tmp_path):
    path = tmp_path / "car.toml"
    path.write_text(tables.simulated_vehicle(), encoding="utf-8")
    vehicle, car = read_vehicle(path), Config.exact()
    assert not vehicle.filled
    assert vehicle.values == {k: getattr(car, k) for k in vehicle.values} and vehicle.values["mass_sd"] == 0
    assert {"accel_y_latency", "accel_y_sd", "cornering_stiffness_rear", "yaw_inertia"} <= set(vehicle.values)


def test_a_line_of_a_vehicle_file_has_unit_range_and_what_0_means_only_where_0_is_allowed():
    fields = Config.exact().fields
    lines = {k: tables._format_line(fields[k], 0.5) for k in fields}
    assert all(x.split("#")[0].isspace() for line in lines.values() for x in line.split("\n")[1:])
    assert max(len(x) for line in lines.values() for x in line.split("\n")) <= tables.MAX_TABLE_WIDTH
    lines = {k: re.sub(r"\n +# ", " ", line) for k, line in lines.items()}
    assert lines["lf"].startswith("lf = 0.5  # m, ")
    for k, f in fields.items():
        before, _, about = f.text.partition("; 0: ")
        assert lines[k].endswith(before if f.low > 0 else f.text), k
        assert f"# {f.unit}, {f.low:g} .. {f.high:g}: " in lines[k] and bool(about) >= ("; 0: " in lines[k])
    assert any("; 0: " in f.text and f.low > 0 for f in fields.values())
    assert tables._format_line(fields["accel_y_latency"], 0.01, "accel_y").startswith("accel_y = 0.01  # s")


def test_figures_are_packed_without_a_character_that_html_has_for_itself():
    packed = report.pack_text('{"a": "<&>"}' * 50)
    assert not set("<>&'\"") & set(str(packed)) and packed == report.pack_text(b'{"a": "<&>"}' * 50)
    assert report.read_figures(f'<x id="figures">{report.pack_text("[1, 2]")}</x>') == [1, 2]
