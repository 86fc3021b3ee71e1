"""The overview of a fleet: one HTML file that links to the report of each log."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tse.impl.core import STIFFNESS
from tse.impl.fleet.keep import TABLE, Done
from tse.impl.fleet.run import each
from tse.impl.plots import BLUE, GREEN, ORANGE, Figure
from tse.impl.report import write_page
from tse.impl.results import CODES
from tse.impl.verdict import NAMES

COLOURS = dict(zip(STIFFNESS, (ORANGE, BLUE, GREEN), strict=True))
MOST_TRENDS = 12  # cars whose trend is drawn: the worst
MOST_LOGS = 2000  # that the page lists; the table has all


@dataclass(frozen=True)
class Last:
    """What is known of a stiffness of a car now: relative to nominal, of the last stretch that tells it."""

    ratio: float
    band: float  # 95 %
    when: pd.Timestamp


@dataclass(frozen=True)
class Car:
    """A car and its drives."""

    name: str
    done: list[Done]
    last: dict[str, Last]  # by stiffness, those that are known

    @property
    def worst(self) -> float:
        """How far below nominal the softest axle is; nothing is known: below all others."""
        return min((v.ratio for v in self.last.values()), default=np.inf)

    @property
    def errors(self) -> int:
        return sum(bool(d.outcome.error) for d in self.done)

    @property
    def hours(self) -> float:
        return sum(d.outcome.seconds for d in self.done) / 3600


def cars(done: Sequence[Done], table: pd.DataFrame) -> list[Car]:
    """All cars, the worst first."""
    known = table[table["usable"].isin(["yes", "in part"]) & table["value"].notna()]
    last = known.groupby(["car", "stiffness"], sort=False).tail(1)
    of: dict[str, dict[str, Last]] = {}
    for r in last.itertuples():
        when = r.start_time + pd.Timedelta(seconds=float(r.end))
        of.setdefault(r.car, {})[r.stiffness] = Last(r.value / r.nominal, 1.96 * r.sd / r.nominal, when)
    return sorted((Car(name, mine, of.get(name, {})) for name, mine in each(done)), key=lambda c: (c.worst, c.name))


def write(path: Path, done: Sequence[Done], table: pd.DataFrame, title: str) -> None:
    """Write the page."""
    all_cars = cars(done, table)
    sections = []
    if any(c.last for c in all_cars):
        sections.append(("Cars", "Last estimate of each car, over nominal, with its 95 % interval; the softest first. A line: "
                         "as nominal.", distribution(all_cars)))  # fmt: skip
    drawn = [c for c in all_cars if len(c.done) > 1 and c.last][:MOST_TRENDS]
    for c in drawn:
        sections.append((f"Trend: {c.name}", "Each stretch of road that tells a stiffness, over nominal.", trend(c, table)))
    codes = [d.outcome.code if not d.outcome.error else None for d in done]
    write_page(path, "fleet.html.j2", sections, title=title, cars=all_cars, errors=[d for d in done if d.outcome.error],
               counts={word: codes.count(code) for code, word in CODES.items()},
               done=done, most=MOST_LOGS, usable=CODES, names=NAMES, table=TABLE,
               moment=lambda s: pd.Timestamp(s, unit="s").strftime("%Y-%m-%d %H:%M"),
               said=_said(table))  # fmt: skip


def _said(table: pd.DataFrame) -> dict[str, dict[str, list[Any]]]:
    """By log: changes of the road, warnings."""
    found: dict[str, dict[str, list[Any]]] = {}
    for r in table[table["change"].notna() | table["warnings"].notna()].itertuples():
        mine = found.setdefault(r.log, {"changes": [], "warnings": []})
        if isinstance(r.change, str) and (text := f"{r.change} at {r.start:.0f} s") not in mine["changes"]:
            mine["changes"].append(text)
        if isinstance(r.warnings, str):
            mine["warnings"] = r.warnings.split("\n")
    return found


def distribution(all_cars: Sequence[Car]) -> Figure:
    """The last of every car beside each other."""
    figure = Figure(["last known stiffness over nominal"], [320])
    for key in STIFFNESS:
        mine = [(c.name, c.last[key]) for c in all_cars if key in c.last]
        _points(figure, key, [n for n, _ in mine], [v.ratio for _, v in mine], [v.band for _, v in mine])
    _as_nominal(figure)
    figure.layout["xaxis"] |= {"type": "category", "title": {"text": "car"}, "categoryorder": "array",
                               "categoryarray": [c.name for c in all_cars]}  # fmt: skip
    return figure


def trend(car: Car, table: pd.DataFrame) -> Figure:
    """All stretches of a car over time."""
    figure = Figure(["stiffness over nominal"], [240])
    mine = table[(table["car"] == car.name) & table["usable"].isin(["yes", "in part"]) & table["value"].notna()]
    for key in STIFFNESS:
        t = mine[mine["stiffness"] == key]
        when = t["start_time"] + pd.to_timedelta(t["end"].astype(float), unit="s")
        stamps = when.dt.strftime("%Y-%m-%dT%H:%M:%S").tolist()
        ratio, band = t["value"] / t["nominal"], 1.96 * t["sd"] / t["nominal"]
        _points(figure, key, stamps, ratio.astype(float).tolist(), band.astype(float).tolist(), "lines+markers")
    _as_nominal(figure)
    figure.layout["xaxis"] |= {"type": "date", "title": {"text": "UTC"}}
    return figure


def _points(figure: Figure, key: str, x: Sequence[Any], y: Sequence[float], band: Sequence[float], mode: str = "markers") -> None:
    figure.add(1, x=list(x), y=list(y), mode=mode, name=NAMES[key], marker={"color": COLOURS[key], "size": 7},
               line={"color": COLOURS[key], "width": 1}, error_y={"type": "data", "array": list(band), "thickness": 1})  # fmt: skip


def _as_nominal(figure: Figure) -> None:
    figure.layout["hovermode"] = "closest"
    line = {"color": "#8a94a0", "width": 1, "dash": "dot"}
    figure.layout["shapes"].append({"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 1, "y1": 1, "line": line})
