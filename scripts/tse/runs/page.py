"""Write the page of a fleet: an HTML file with all cars, and links to
the reports of their logs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tse.estimation.answer import WHERE, explain_reason
from tse.estimation.verdict import NAMES
from tse.library.core import STIFFNESS
from tse.report.plots import BLUE, GREEN, ORANGE, Figure
from tse.report.report import write_page
from tse.report.results import CODES, KILO
from tse.runs.keep import TABLE, Done
from tse.runs.run import group_by_car

COLOURS = dict(zip(STIFFNESS, (ORANGE, BLUE, GREEN), strict=True))
CORNERING = ("cy_front", "cy_rear")
PANELS = ("cornering stiffness [kN/rad]", "longitudinal stiffness [kN]")
# Max number of cars whose trend (stiffness over time, for cars with several logs) is
# drawn. If more cars have a trend, the first ones in the order of Car.place are drawn
MAX_TRENDS = 12
MAX_LISTED_LOGS = 2000  # max number of logs that the page lists; fleet.parquet has all logs


@dataclass(frozen=True)
class Last:
    """The latest usable estimate of a stiffness of a car."""

    value: float  # [N/rad] or, for the longitudinal stiffness, [N]
    band: float  # half the width of the 95 % interval, in the unit of `value`
    of_nominal: float  # ratio of value to the nominal stiffness of the vehicle file
    # end of the part of the drive to which the estimate applies, i.e. time of the next
    # detected change of the stiffness or end of the drive
    when: pd.Timestamp

    @property
    def shown(self) -> str:
        """Value with 95 % interval in kN/rad or kN, as a string."""
        return f"{self.value / KILO:.0f} ± {max(self.band / KILO, 0.5):.0f}"


@dataclass(frozen=True)
class Car:
    """A car and its drives."""

    name: str
    done: list[Done]
    # A stiffness is known if at least one drive gives a usable estimate of it
    last: dict[str, Last]  # key: a known stiffness; value: its latest estimate
    why: dict[str, str]  # key: an unknown stiffness; value: why it is unknown

    @property
    def softest(self) -> str:
        """Key of the smallest known cornering stiffness. If no cornering stiffness is
        known, key of the longitudinal stiffness. Empty: no stiffness is known."""
        known = [k for k in CORNERING if k in self.last] or list(self.last)
        return min(known, key=lambda k: self.last[k].value, default="")

    @property
    def place(self) -> tuple[bool, bool, float]:
        """Key that sorts the cars into the order of the page: cars with a known cornering
        stiffness, sorted by the smaller of the front and the rear cornering stiffness;
        then cars of which only the longitudinal stiffness is known, sorted by this
        stiffness; then cars without a known stiffness."""
        return (
            not self.softest,
            self.softest not in CORNERING,
            self.last[self.softest].value if self.softest else np.inf,
        )

    @property
    def reason(self) -> str:
        """Sentence with the smallest stiffness, or why no stiffness is known."""
        if not self.softest:
            return (
                "no stiffness is known: " + "; ".join(dict.fromkeys(self.why.values()))
                if self.why
                else "no log was read"
            )
        unit = "kN/rad" if self.softest in CORNERING else "kN"
        return f"{WHERE[self.softest]} {self.last[self.softest].shown} {unit}"

    @property
    def errors(self) -> int:
        """Number of logs that could not be estimated."""
        return sum(bool(d.outcome.error) for d in self.done)

    @property
    def hours(self) -> float:
        """[h] Total duration of the logs."""
        return sum(d.outcome.seconds for d in self.done) / 3600


def list_cars(done: Sequence[Done], table: pd.DataFrame) -> list[Car]:
    """Return all cars with their latest usable stiffnesses, sorted by Car.place.

    `done`: all logs. `table`: result of keep.make_table()."""
    known = table[table["usable"].isin(["yes", "in part"]) & table["value"].notna()]
    last = known.groupby(["car", "stiffness"], sort=False).tail(1)
    of: dict[str, dict[str, Last]] = {}
    for r in last.itertuples():
        when = r.start_time + pd.Timedelta(seconds=float(r.end))
        of.setdefault(r.car, {})[r.stiffness] = Last(r.value, 1.96 * r.sd, r.value / r.nominal, when)
    why: dict[str, dict[str, str]] = {}
    for r in table[table["stiffness"].notna()].groupby(["car", "stiffness"], sort=False).tail(1).itertuples():
        if r.stiffness not in of.get(r.car, {}):
            why.setdefault(r.car, {})[r.stiffness] = explain_reason(
                r.stiffness, r.reason if isinstance(r.reason, str) else ""
            )
    found = (Car(name, mine, of.get(name, {}), why.get(name, {})) for name, mine in group_by_car(done))
    return sorted(found, key=lambda c: (c.place, c.name))


def write_fleet_page(path: Path, done: Sequence[Done], table: pd.DataFrame, title: str) -> None:
    """Write the page of a fleet.

    `done`: all logs. `table`: result of keep.make_table()."""
    all_cars = list_cars(done, table)
    sections = []
    if any(c.last for c in all_cars):
        text = "The latest estimate of each car with its 95 % interval, the softest car first."
        sections.append(("Cars", text, draw_distribution(all_cars)))
    drawn = [c for c in all_cars if len(c.done) > 1 and c.last][:MAX_TRENDS]
    for c in drawn:
        sections.append(
            (f"Trend: {c.name}", "Each stretch of road with a usable stiffness.", draw_trend(c, table))
        )
    codes = [d.outcome.code if not d.outcome.error else None for d in done]
    write_page(
        path,
        "fleet.html.j2",
        sections,
        title=title,
        cars=all_cars,
        errors=[d for d in done if d.outcome.error],
        counts={word: codes.count(code) for code, word in CODES.items()},
        done=done,
        most=MAX_LISTED_LOGS,
        usable=CODES,
        names=NAMES,
        table=TABLE,
        moment=lambda s: pd.Timestamp(s, unit="s").strftime("%Y-%m-%d %H:%M"),
        said=_collect_remarks(table),
    )


def _collect_remarks(table: pd.DataFrame) -> dict[str, dict[str, list[Any]]]:
    """Return remarks on logs. Key: path of a log that has warnings or detected changes of
    the stiffness. Value: the lists "changes" and "warnings" of this log, as texts."""
    found: dict[str, dict[str, list[Any]]] = {}
    for r in table[table["change"].notna() | table["warnings"].notna()].itertuples():
        mine = found.setdefault(r.log, {"changes": [], "warnings": []})
        if isinstance(r.change, str) and (text := f"{r.change} at {r.start:.0f} s") not in mine["changes"]:
            mine["changes"].append(text)
        if isinstance(r.warnings, str):
            mine["warnings"] = r.warnings.split("\n")
    return found


def draw_distribution(all_cars: Sequence[Car]) -> Figure:
    """Return a figure of the latest stiffnesses of every car."""
    figure = Figure(PANELS, [260, 180])
    for key in STIFFNESS:
        mine = [(c.name, c.last[key]) for c in all_cars if key in c.last]
        _draw_points(
            figure,
            key,
            [n for n, _ in mine],
            [v.value / KILO for _, v in mine],
            [v.band / KILO for _, v in mine],
        )
    order = {"type": "category", "categoryorder": "array", "categoryarray": [c.name for c in all_cars]}
    for axis in ("xaxis", "xaxis2"):
        figure.layout[axis] |= order
    figure.layout["xaxis2"] |= {"title": {"text": "car"}}
    figure.layout["hovermode"] = "closest"
    return figure


def draw_trend(car: Car, table: pd.DataFrame) -> Figure:
    """Return a figure of the usable stiffnesses of a car over time. Each point is the
    estimate for one stretch of road, drawn at the time when the stretch ends. A stretch
    is a part of a drive. Its limits are the detected changes of the stiffness, and the
    start and end of the drive.

    `table`: rows of all cars, with the columns FLEET_COLUMNS."""
    figure = Figure(PANELS, [220, 160])
    mine = table[
        (table["car"] == car.name) & table["usable"].isin(["yes", "in part"]) & table["value"].notna()
    ]
    for key in STIFFNESS:
        t = mine[mine["stiffness"] == key]
        when = t["start_time"] + pd.to_timedelta(t["end"].astype(float), unit="s")
        stamps = when.dt.strftime("%Y-%m-%dT%H:%M:%S").tolist()
        value, band = t["value"] / KILO, 1.96 * t["sd"] / KILO
        _draw_points(
            figure, key, stamps, value.astype(float).tolist(), band.astype(float).tolist(), "lines+markers"
        )
    for axis in ("xaxis", "xaxis2"):
        figure.layout[axis] |= {"type": "date"}
    figure.layout["xaxis2"] |= {"title": {"text": "UTC"}}
    figure.layout["hovermode"] = "closest"
    return figure


def _draw_points(
    figure: Figure,
    key: str,
    x: Sequence[Any],
    y: Sequence[float],
    band: Sequence[float],
    mode: str = "markers",
) -> None:
    row = 1 if key in CORNERING else 2
    figure.add(
        row,
        x=list(x),
        y=list(y),
        mode=mode,
        name=NAMES[key],
        marker={"color": COLOURS[key], "size": 7},
        line={"color": COLOURS[key], "width": 1},
        error_y={"type": "data", "array": list(band), "thickness": 1},
    )
