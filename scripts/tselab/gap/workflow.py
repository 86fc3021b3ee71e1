"""`tselab gap`: where, name, add, show. Each stage is a file of its own; this one runs them, keeps what is done, and says what came
of it.

A run leaves its stages in DIR/stages; one that was interrupted goes on from there when nothing it depends on has changed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tselab import __version__
from tselab.core import Config, library_path
from tselab.errors import UserError
from tselab.formula import Formula
from tselab.gap import optional
from tselab.gap.catalogue import Key, catalogue
from tselab.gap.data import Prepared, prepare_all
from tselab.gap.fit import Fit, fit, gap
from tselab.gap.infer import detect, show
from tselab.gap.infer import naming as name
from tselab.gap.infer.excerpt import HELD_SHARE, excerpt, is_long
from tselab.gap.infer.formula import search
from tselab.gap.infer.formula.search import NOISE_LIMIT, Discovery
from tselab.gap.infer.hypotheses import NAME_AT
from tselab.gap.infer.naming import Named
from tselab.gap.infer.rivals import explained
from tselab.gap.localise import remainder, where
from tselab.gap.problem import STIFFNESS, Problem
from tselab.gap.stages import stage
from tselab.log import MEASURES, Log, Reading, files_of, read_log
from tselab.units import check_units
from tselab.vehicle import Vehicle, fill_sensors, latency_settings, read_vehicle

EXIT = {"none": 0, "named": 10, "below 90 %, or look-alikes": 11, "not_in_catalogue": 20}


@dataclass
class Result:
    """Everything that a run found."""

    verdict: str  # none, named, not_in_catalogue
    exit_code: int
    words: list[str]
    naming: name.Naming
    conditions: list[where.Condition]
    entries: list[where.Entry]
    remainders: list[remainder.Remainder]
    fit_before: dict[str, float]
    fit_after: dict[str, float]
    held_out: dict[str, show.Change]
    undetectable: list[detect.Detectable]
    detectable: list[detect.Detectable]
    notes: list[str] = field(default_factory=list)
    discovery: Discovery | None = None  # a formula for what the names leave; None: nothing is left, or nobody asked
    rivals: list[dict[str, Any]] = field(default_factory=list)  # names, formulas, both: how likely
    problem: Problem | None = None  # what was fitted
    held: Problem | None = None  # what was not
    read: list[tuple[str, Log]] = field(default_factory=list)  # part (table.py), log

    @property
    def formula(self) -> Formula | None:
        """The one that is proposed."""
        return self.discovery.formula if self.discovery else None

    @property
    def final(self) -> Fit:
        """What stands in the end: names and the formula."""
        if self.discovery and self.discovery.fit:
            return self.discovery.fit
        return self.naming.final

    @property
    def after(self) -> dict[str, float]:
        """The same as what a simulation takes."""
        return dict(self.final.values) | (self.formula.settings() if self.formula else {})

    def as_json(self) -> dict[str, Any]:
        """DIR/verdict.json."""
        asserted = self.verdict == "named"
        return {
            "verdict": self.verdict,
            "effects": [_as_json(n) for n in self.naming.named if asserted and not n.message],
            "sensors": sensors(self.problem, self.naming),
            "besides": [_as_json(n) for n in self.naming.besides],
            "possible": self.naming.possible,
            "sets": self.naming.sets,
            "formula": self._formula_as_json(),
            "rivals": self.rivals,
            "where": [
                {
                    "channel": c.channel,
                    "condition": c.condition,
                    "entry_point": self._entry(c.channel),
                    "strength": c.strength,
                }
                for c in self.conditions
            ],
            "entry_points": [asdict(e) for e in self.entries],
            "gap": {
                "fit": {"before": self.fit_before, "after": self.fit_after},
                "held_out": {
                    "before": {k: c.before for k, c in self.held_out.items()},
                    "after": {k: c.after for k, c in self.held_out.items()},
                    "change_ci95": {k: list(c.ci95) for k, c in self.held_out.items()},
                },
            },
            "closed": self.naming.closed,
            "remainder": [asdict(r) for r in self.remainders],
            "undetectable": [
                {
                    "id": d.id,
                    "parameter": d.parameter,
                    "smallest_detectable": d.smallest,
                    "typical": d.typical,
                    "unit": d.unit,
                }
                for d in self.undetectable
            ],
            "stiffness": {p.name: self.final.values[p.name] for p in STIFFNESS},
            "words": self.words,
            "notes": self.notes,
            "version": __version__,
        }

    def _formula_as_json(self) -> dict[str, Any] | None:
        if self.discovery is None:
            return None
        f, d, proposed = self.formula, self.discovery, None
        if f is not None:
            numbers = {n.name: {"value": n.value, "sd": n.sd, "unit": n.unit} for n in f.numbers}
            proposed = {
                "id": f.id,
                "place": f.place,
                "formula": f.text,
                "numbers": numbers,
                "share": d.share,
                "nats": d.nats,
            }
        return {"proposed": proposed, "tried": d.tried}

    def _entry(self, channel: str) -> str:
        if channel == "accel_x":
            return "longitudinal"
        return self.entries[0].place if self.entries and self.entries[0].nats > 0 else "unknown"


def read_logs_of(paths: Sequence[Path], notes: list[str], reading: Reading | None = None) -> list[Log]:
    """The logs that can be read; of several, one that cannot is left out, and a note says why. A sensor that a log does not have is
    not asked. UserError: there is none."""
    found: list[Log] = []
    refused: list[UserError] = []
    for path in paths:
        try:
            found.append(read_log(path, MEASURES, reading))
        except UserError as error:
            refused.append(error)
            notes.append(f"{path.name} is left out: {str(error).splitlines()[0]}")
    if refused and not found:
        raise refused[0]
    return found


def read(paths: Sequence[Path], vehicle: Vehicle, reading: Reading | None = None) -> tuple[list[Log], Config]:
    """Logs, and the settings of the vehicle with sensors filled in from the first."""
    reading = replace(reading or Reading(), car=vehicle)
    logs = [read_log(p, MEASURES, reading) for p in paths]
    fill_sensors(vehicle, logs[0])
    return logs, Config(vehicle.values)


def fingerprint(paths: Sequence[Path], config: Config, reading: Reading | None = None) -> str:
    """Of everything that a result depends on: logs, settings, this code, the library."""
    h = hashlib.sha256(__version__.encode())
    here = Path(__file__).parent
    engine = sorted((here.parent / "identify").glob("*.py"))
    for code in (*sorted(here.rglob("*.py")), *engine, here.parent / "formula.py", library_path()):
        h.update(code.read_bytes())
    reading = reading or Reading()
    h.update(repr(reading.rate).encode())
    for p in dict.fromkeys(f for log in paths for f in (*files_of(log), *reading.files(log))):
        h.update(p.read_bytes())
    h.update(json.dumps(config.as_dict(), sort_keys=True).encode())
    return h.hexdigest()


@dataclass
class Run:
    """What the steps of a run share: who it is of, what was read, where it keeps what is done, what it notes besides."""

    vehicle: Vehicle
    config: Config
    logs: list[Log]  # fitted
    held: list[Log]
    folder: Path  # of the stages
    key: str
    jobs: int
    say: Callable[[str], None]
    notes: list[str]
    prepared: list[Prepared] = field(default_factory=list)  # fitted and held out, in the order in which they were

    @classmethod
    def begin(
        cls,
        logs: Sequence[Path],
        vehicle_path: Path,
        out: Path,
        hold_out: Sequence[Path],
        jobs: int,
        say: Callable[[str], None],
        reading: Reading | None = None,
    ) -> Run:
        """Everything is read, nothing is computed."""
        vehicle = read_vehicle(vehicle_path)
        say("reading the logs")
        notes: list[str] = []
        reading = replace(reading or Reading(), car=vehicle)
        read_logs = read_logs_of(logs, notes, reading)
        held = read_logs_of(hold_out, notes, reading) if hold_out else []
        fill_sensors(vehicle, read_logs[0])
        config = Config(vehicle.values)
        key = fingerprint([*logs, *hold_out], config, reading)
        return cls(vehicle, config, read_logs, held, out / "stages", key, jobs, say, notes)

    def stage(self, title: str, compute: Callable[[], Any]) -> Any:
        """What an earlier run has kept of the same things, or what is computed now."""
        return stage(self.folder, self.key, title, compute)

    def problem(self, title: str, logs: Sequence[Log]) -> Problem:
        """Logs, smoothed and against the model. `title`: of the stage."""
        found: list[Prepared] = self.stage(title, lambda: prepare_all(logs, self.config))
        self.prepared += found
        return Problem(found, self.config, self.jobs)


@dataclass
class Searched:
    """What sets of effects and formulas are searched in: all logs, or of long ones the part that says most."""

    problem: Problem
    baseline: Fit
    held: Problem | None

    @property
    def together(self) -> Problem | None:
        """Fitted and held-out logs as one."""
        return self.problem.of([*self.problem.logs, *self.held.logs]) if self.held is not None else None


@dataclass
class Weighed:
    """Names beside formulas."""

    naming: name.Naming
    discovery: Discovery | None = None
    rivals: list[dict[str, Any]] = field(default_factory=list)

    @property
    def last(self) -> Fit:
        """Names and the formula, fitted."""
        return self.discovery.fit if self.discovery and self.discovery.fit else self.naming.final

    @property
    def values(self) -> dict[Key, float]:
        """The same as what a simulation takes."""
        if self.discovery and self.discovery.formula:
            return self.discovery.fit.values | self.discovery.formula.settings()
        return self.naming.final.values


def run(
    logs: Sequence[Path],
    vehicle_path: Path,
    out: Path,
    hold_out: Sequence[Path] = (),
    jobs: int = 1,
    say: Callable[[str], None] = lambda _: None,
    formula: bool = False,
    reading: Reading | None = None,
) -> Result:
    """All stages. Without held-out logs nothing is shown beyond the logs that were fitted. `formula`: one is sought even when the
    names leave nothing; else where they leave something."""
    this = Run.begin(logs, vehicle_path, out, hold_out, jobs, say, reading)
    problem = this.problem("prepared", this.logs)
    if not problem.logs:
        raise UserError("; ".join(n for p in this.prepared for n in p.notes) or "no log can be compared")
    say("fitting stiffness and biases")
    baseline: Fit = this.stage("baseline", lambda: fit(problem, STIFFNESS, {}))
    held = this.problem("held_out", this.held) if this.held else None
    held = held if held is not None and held.logs else None

    part = _searched(this, problem, baseline, held)
    say("where do they disagree?")
    conditions, entries = this.stage(
        "where",
        lambda: (
            where.conditions(problem, baseline.residuals, baseline.values),
            where.entries(part.problem, part.baseline),
        ),
    )
    naming = _named(this, part)
    say("what is left?")
    noisier = remainder.noisier(part.problem, naming.final.residuals, NOISE_LIMIT)
    this.notes += [
        f"{c}: its noise is {f:.2f} times that of its differences from row to row" for c, f in noisier.items()
    ]
    weighed = _weighed(this, part, naming, noisier, formula)
    seen = _detectable(part, weighed.naming)
    if part.problem is not problem:
        weighed = _on_all(this, problem, baseline, weighed)

    left = what_is_left(problem, weighed.last.values, weighed.last.residuals, noisier)
    changes: dict[str, show.Change] = {}
    elsewhere: list[remainder.Remainder] = []
    if held is not None:
        say("held-out logs")
        values = show.of_the_car(held, weighed.values)
        after = held.residuals(values)
        changes = show.compare(held, held.residuals(weighed.naming.baseline.values), after)
        elsewhere = more_than_noise(what_is_left(held, values, after, noisier))
    this.notes += optional.words(problem.readings(weighed.naming.final.values))
    if not weighed.naming.converged:
        this.notes.append("the last fit has not converged: sizes may still move")
    result = judge(
        problem,
        weighed.naming,
        conditions,
        entries,
        left,
        seen,
        changes,
        this.notes,
        weighed.discovery,
        elsewhere,
    )
    result.problem, result.held, result.rivals = problem, held, weighed.rivals
    result.read = [("fit", x) for x in this.logs] + [("held_out", x) for x in this.held]
    return result


# ---- the steps of a run


def _searched(this: Run, problem: Problem, baseline: Fit, held: Problem | None) -> Searched:
    """Of long logs the part that says most: what is found there is fitted to all."""
    few, few_baseline, few_held = problem, baseline, held
    if is_long(problem):
        this.say("which stretches say most?")
        few = problem.of(this.stage("excerpt", lambda: excerpt(problem, baseline).logs))
        few_baseline = this.stage("baseline_excerpt", lambda: fit(few, STIFFNESS, {}))
        this.notes.append(
            f"effects are searched in the {_seconds(few):.0f} s of {_seconds(problem):.0f} s that say most"
        )
    if held is not None and is_long(held, HELD_SHARE):
        few_held = held.of(
            this.stage("excerpt_held_out", lambda: excerpt(held, fit(held, STIFFNESS, {}), HELD_SHARE).logs)
        )
    return Searched(few, few_baseline, few_held)


def _named(this: Run, part: Searched) -> name.Naming:
    """Names, and what is to be noted of the logs they are from."""
    effects, together = list(catalogue().values()), part.together
    naming = this.stage("naming", lambda: name.name(part.problem, effects, this.say, part.baseline, together))
    this.notes += [n for p in this.prepared for n in p.notes]
    this.notes += [
        f"{log.path.name}: {w}" for log in (*this.logs, *this.held) for w in disagreements(log, this.vehicle)
    ]
    return naming


def _weighed(this: Run, part: Searched, naming: name.Naming, noisier: dict[str, float], formula: bool) -> Weighed:
    """Names against formulas, where the names leave something or one is asked for."""
    own = this.vehicle.formula
    if own is not None:
        this.notes.append(f"the vehicle file has a formula ({own.id}), which was kept: no other is sought")
        return Weighed(naming)
    remains = more_than_noise(what_is_left(part.problem, naming.final.values, naming.final.residuals, noisier))
    if remains or formula or leaves_something(part.held, naming):
        discovery, naming, rivals = this.stage("formula", lambda: explained(part.problem, part.held, naming, this.say))
        return Weighed(naming, discovery, rivals)
    return Weighed(naming)


def _detectable(part: Searched, naming: name.Naming) -> list[detect.Detectable]:
    """What these logs would show of the effects that have no name. Of an excerpt: more of the same shows no less."""
    named = {n.effect.id for n in naming.named}
    return detect.detectable(part.problem, naming.final, [e for e in catalogue().values() if e.id not in named])


def _on_all(this: Run, problem: Problem, baseline: Fit, found: Weighed) -> Weighed:
    """What was found in an excerpt, fitted to all logs."""
    this.say("all logs")
    discovery, naming = this.stage("all", lambda: on_all(problem, baseline, found.naming, found.discovery))
    return Weighed(naming, discovery, found.rivals)


def leaves_something(held: Problem | None, naming: name.Naming) -> bool:
    """Whether names that explain the fitted logs leave more than noise of those that were held out: a patchwork may."""
    if held is None or not naming.named:
        return False
    return max(gap(held, held.residuals(show.of_the_car(held, naming.final.values))).values()) > NOISE_LIMIT


def on_all(
    problem: Problem, baseline: Fit, naming: name.Naming, discovery: Discovery | None
) -> tuple[Discovery | None, name.Naming]:
    """What was found in an excerpt, fitted to all logs."""
    naming = name.on_all(problem, baseline, naming)
    return (search.on_all(problem, naming.final, discovery) if discovery else None), naming


def _seconds(problem: Problem) -> float:
    return sum(log.seconds for log in problem.logs)


def what_is_left(
    problem: Problem, values: Mapping[Key, float], residuals: np.ndarray, noisier: Mapping[str, float]
) -> list[remainder.Remainder]:
    """Of every channel, after a fit."""
    features = {k: x for k, x in where.features(problem, values).items() if k != "time"}
    return [
        r
        if r.channel not in noisier
        else remainder.Remainder(r.channel, r.gap, "noise", 0.0, (), None, f"{r.channel}: noise only")
        for r in remainder.remainder(problem, residuals, features, NOISE_LIMIT)
    ]


def more_than_noise(left: list[remainder.Remainder]) -> list[remainder.Remainder]:
    """Of what is left what is more than the sensors' own."""
    return [r for r in left if r.kind != "noise"]


def disagreements(log: Log, vehicle: Vehicle) -> list[str]:
    """Wrong units and signs, which no effect of a car explains."""
    v = vehicle.values
    return check_units(log, v["lf"] + v["lr"], v["wheel_radius_front"], v["wheel_radius_rear"], vehicle.steering_ratio,
                       mass=v["mass"])  # fmt: skip


def judge(
    problem: Problem,
    naming: name.Naming,
    conditions: list[where.Condition],
    entries: list[where.Entry],
    left: list[remainder.Remainder],
    seen: list[detect.Detectable],
    changes: dict[str, show.Change],
    notes: list[str],
    discovery: Discovery | None = None,
    elsewhere: Sequence[remainder.Remainder] = (),
) -> Result:
    """From what was found to a verdict. `left`: after names and formula; `elsewhere`: the same of the held-out logs."""
    formula = discovery.formula if discovery else None
    last = discovery.fit if discovery and discovery.fit else naming.final
    before, after = gap(problem, naming.baseline.residuals), gap(problem, last.residuals)
    remains = more_than_noise(left)
    words: list[str] = []
    if naming.named:
        verdict = "named"
        words += [_sentence(n) for n in naming.named]
        if remains or formula:
            closed = f"{100 * naming.closed:.0f} % of the gap"
            words.append(f"All names together close {closed}; something else is missing that is not in the catalogue.")
    elif elsewhere and not (remains or formula):
        verdict = "not_in_catalogue"
        words.append(
            "Something is missing: the model explains the fitted logs down to the sensors' noise, and not the held-out ones."
        )
    elif remains or formula:
        verdict = "not_in_catalogue"
        words.append("Something is missing, and none of the effects of the catalogue explains it.")
        if naming.possible and not formula:
            best = naming.possible[0]
            words.append(
                f"Possible is {best['id']}, {_percent(best['probability'])}, without a name because {best['why']}."
            )
        if entries and entries[0].nats > 0:
            words.append(f"It acts like a disturbance at: {entries[0].place}.")
    else:
        verdict = "none"
        words.append(
            "The model explains these logs down to the sensors' noise: nothing is missing that they could show."
        )
    words += discovery.words if discovery else []
    words += [f"{'Still left: ' if formula else ''}{r.words}" for r in remains]
    more = [
        f"{r.channel} {r.gap:.2f} times the noise" for r in elsewhere if r.channel not in {x.channel for x in remains}
    ]
    if more:
        words.append(f"The held-out logs are not explained: {', '.join(more)}.")
    for n in naming.besides:
        words.append(f"The held-out logs show besides, what the fitted ones do not: {_sentence(n)} It is not added.")
    exit_code = EXIT[verdict]
    unsure = [n for n in naming.named if n.probability < NAME_AT]
    if verdict == "named" and (unsure or all(n.look_alikes for n in naming.named)):
        exit_code = EXIT["below 90 %, or look-alikes"]
    alike = {i for n in naming.named for i in n.look_alikes}  # of these the logs show one, and do not say which
    undetectable = [d for d in seen if not d.visible and d.id not in alike]
    return Result(
        verdict, exit_code, words, naming, conditions, entries, left, before, after, changes, undetectable, seen, notes,
        discovery,
    )  # fmt: skip


def _as_json(n: Named) -> dict[str, Any]:
    units = {p.name: p for p in n.effect.parameters}
    return {
        "id": n.effect.id,
        "probability": n.probability,
        "parameters": {
            units[k].key: {"value": v, "ci95": list(n.ci95[k]), "unit": units[k].unit} for k, v in n.values.items()
        },
        "share_of_gap_closed": n.share,
        "evidence": n.evidence,
        "look_alikes": n.look_alikes,
        "remarks": n.remarks,
    }


def sensors(problem: Problem | None, naming: name.Naming) -> list[dict[str, Any]]:
    """How late channels are logged beyond what the vehicle file says, and a low pass that is none of the steering's: of names that
    are no effects of the catalogue."""
    late = [n for n in naming.named if n.message]
    if problem is None or not late:
        return []
    found, given = name.settings(problem, naming.final.values), problem.config
    settings = [k for k in latency_settings().values() if k in found and found[k] != getattr(given, k)]
    half = _half_widths(problem, naming, settings)
    return [
        {"id": k, "value": found[k], "ci95": [found[k] - half[k], found[k] + half[k]], "unit": "s"} for k in settings
    ] + [
        {"id": "low_pass", "value": n.values[p.name], "ci95": list(n.ci95[p.name]), "unit": "s"}
        for n in late
        if n.effect.id == name.LOW_PASS
        for p in n.effect.strengths[:1]
    ]


def _half_widths(problem: Problem, naming: name.Naming, settings: Sequence[str]) -> dict[str, float]:
    """Of the 95 % intervals of latencies, from those of the names that they are sums of, as if these were independent: a latency of
    the steering may be that of the IMU and its own. Linear: a delay is far from changing its sign."""
    values, squares = naming.final.values, dict.fromkeys(settings, 0.0)
    step = 1e-6  # s
    for n in naming.named:
        for key, (low, high) in ((k, c) for k, c in n.ci95.items() if k in values):
            more, less = (name.settings(problem, dict(values) | {key: values[key] + by}) for by in (step, -step))
            for k in settings:
                given = getattr(problem.config, k)
                slope = (more.get(k, given) - less.get(k, given)) / (2.0 * step)
                squares[k] += (0.5 * slope * (high - low)) ** 2
    return {k: float(np.sqrt(x)) for k, x in squares.items()}


def _sentence(n: Named) -> str:
    units = {p.name: p for p in n.effect.parameters}
    sizes = ", ".join(
        f"{units[k].key} {v:.3g}{'' if units[k].unit == '1' else ' ' + units[k].unit} ({n.ci95[k][0]:.3g} .. {n.ci95[k][1]:.3g})"
        for k, v in n.values.items()
        if units[k].strength
    )
    possibly = "possibly " if n.probability < NAME_AT else ""
    text = f"{possibly}{n.title} ({n.effect.id}): {sizes}; probability {_percent(n.probability)}"
    text += f", it closes {100 * n.share:.0f} % of the gap." if n.share else "."
    if n.look_alikes:
        text += f" These logs cannot exclude {', '.join(n.look_alikes)} in its place."
    return text


def _percent(p: float) -> str:
    return "above 99 %" if p > 0.99 else f"{100 * p:.0f} %"
