"""`tselab gap`: where, name, add, show. Each stage is a file of its own; this one runs them, keeps what is done, and judges.

A run leaves its stages in DIR/stages; one that was interrupted goes on from there when nothing it depends on has changed.
"""

from __future__ import annotations

import hashlib
import json
import pickle
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from tselab import __version__
from tselab.core import Config, library_path
from tselab.errors import UserError
from tselab.files import atomic
from tselab.gap import constancy, detect, name, optional, remainder, show, where
from tselab.gap.catalogue import catalogue
from tselab.gap.data import Prepared
from tselab.gap.fit import Fit, fit, gap
from tselab.gap.problem import PROFILES, STIFFNESS, Problem
from tselab.gap.workers import Workers
from tselab.log import Log, read_log
from tselab.units import check_units
from tselab.vehicle import Vehicle, fill_sensors, read_vehicle

NOISE_LIMIT = 1.2  # rms over noise up to which nothing is left to explain: noise is known to some percent, inputs are smoothed
MOST_HELD_OUT = 1.3  # rms over noise in held-out logs above which names must close as much there as where they were fitted
EXIT = {"none": 0, "named": 10, "look-alikes": 11, "not_in_catalogue": 20}


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
    variations: list[constancy.Variation]  # that contradict the names
    undetectable: list[detect.Detectable]
    detectable: list[detect.Detectable]
    notes: list[str] = field(default_factory=list)
    problem: Problem | None = None  # what was fitted
    held: Problem | None = None  # what was not

    def as_json(self) -> dict[str, Any]:
        """DIR/verdict.json."""
        units = {p.name: p for e in catalogue().values() for p in e.parameters}
        fitted = [
            {
                "id": n.effect.id,
                "parameters": {
                    units[k].key: {"value": v, "ci95": list(n.ci95[k]), "unit": units[k].unit} for k, v in n.values.items()
                },
                "share_of_gap_closed": n.share,
                "evidence": n.evidence,
                "look_alikes": n.look_alikes,
                "remarks": n.remarks,
            }
            for n in self.naming.named
        ]
        asserted = self.verdict == "named"
        return {
            "verdict": self.verdict,
            "effects": fitted if asserted else [],
            "closest": [] if asserted or self.verdict == "none" else fitted or _closest(self.naming),
            "where": [
                {"channel": c.channel, "condition": c.condition, "entry_point": self._entry(c.channel), "strength": c.strength}
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
            "varies": [asdict(v) for v in self.variations],
            "remainder": [asdict(r) for r in self.remainders],
            "undetectable": [
                {"id": d.id, "parameter": d.parameter, "smallest_detectable": d.smallest, "typical": d.typical, "unit": d.unit}
                for d in self.undetectable
            ],
            "stiffness": {p.name: self.naming.final.values[p.name] for p in STIFFNESS},
            "words": self.words,
            "notes": self.notes,
            "version": __version__,
        }

    def _entry(self, channel: str) -> str:
        if channel == "accel_x":
            return "longitudinal"
        return self.entries[0].place if self.entries and self.entries[0].nats > 0 else "unknown"


def read(paths: Sequence[Path], vehicle: Vehicle) -> tuple[list[Log], Config]:
    """Logs, and the settings of the vehicle with sensors filled in from the first."""
    logs = [read_log(p) for p in paths]
    fill_sensors(vehicle, logs[0])
    return logs, Config(vehicle.values)


def stage(folder: Path, key: str, title: str, compute: Callable[[], Any]) -> Any:
    """What was computed before from the same things, or now."""
    path = folder / f"{title}.pickle"
    if path.exists():
        try:
            with open(path, "rb") as file:
                saved, value = pickle.load(file)
            if saved == key:
                return value
        except Exception:  # damaged, or of another version: made again
            pass
    value = compute()
    folder.mkdir(parents=True, exist_ok=True)
    with atomic(path, "wb") as file:
        pickle.dump((key, value), file)
    return value


def fingerprint(paths: Sequence[Path], config: Config) -> str:
    """Of everything that a result depends on: logs, settings, this code, the library."""
    h = hashlib.sha256(__version__.encode())
    for code in (*sorted(Path(__file__).parent.glob("*.py")), library_path()):
        h.update(code.read_bytes())
    for p in paths:
        h.update(p.read_bytes())
    h.update(json.dumps(config.as_dict(), sort_keys=True).encode())
    return h.hexdigest()


def run(
    logs: Sequence[Path],
    vehicle_path: Path,
    out: Path,
    hold_out: Sequence[Path] = (),
    jobs: int = 1,
    say: Callable[[str], None] = lambda _: None,
    workers: Workers | None = None,
) -> Result:
    """All stages. Without held-out logs nothing is shown beyond the logs that were fitted."""
    workers = workers or Workers(jobs)
    vehicle = read_vehicle(vehicle_path)
    say("reading the logs")
    read_logs, config = read(logs, vehicle)
    held = [read_log(p) for p in hold_out]
    key = fingerprint([*logs, *hold_out], config)
    folder = out / "stages"
    prepared: list[Prepared] = stage(folder, key, "prepared", lambda: workers.prepare(read_logs, config))
    problem = workers.problem(prepared, config)
    if not problem.logs:
        raise UserError("; ".join(n for p in prepared for n in p.notes) or "no log can be compared")
    effects = list(catalogue().values())

    def look(title: str) -> tuple[list[where.Condition], list[where.Entry], name.Naming]:
        say("fitting stiffness and biases")
        baseline: Fit = stage(folder, key, f"baseline{title}", lambda: fit(problem, STIFFNESS, {}))
        say("where do they disagree?")
        conditions, entries = stage(
            folder, key, f"where{title}",
            lambda: (
                where.conditions(problem, baseline.residuals, baseline.values),
                where.entries(problem, baseline),
            ),
        )  # fmt: skip
        return conditions, entries, stage(folder, key, f"naming{title}", lambda: name.name(problem, effects, say, baseline))

    conditions, entries, naming = look("")
    notes = [n for p in prepared for n in p.notes]
    notes += [f"{log.path.name}: {w}" for log in (*read_logs, *held) for w in disagreements(log, vehicle)]
    louder = remainder.louder(problem, naming.final.residuals, NOISE_LIMIT)
    if louder:  # what names close is a share of what is not noise, so it counts: once more
        notes += [f"{c}: its noise is {f:.2f} times what its differences from row to row say" for c, f in louder.items()]
        problem = workers.problem([p.louder(louder) for p in prepared], config)
        conditions, entries, naming = look("_louder")
    say("what is left?")
    features = {k: x for k, x in where.features(problem, naming.final.values).items() if k != "time"}
    left = remainder.remainder(problem, naming.final.residuals, features, NOISE_LIMIT)
    seen = detect.detectable(problem, naming.final, [e for e in effects if e.id not in {n.effect.id for n in naming.named}])
    varying = constancy.variations(problem, naming.final, [n.effect for n in naming.named])
    changes: dict[str, show.Change] = {}
    other: Problem | None = None
    if held:
        say("held-out logs")
        prepared_held = stage(folder, key, "held_out", lambda: workers.prepare(held, config))
        other = workers.problem([p.louder(louder) for p in prepared_held], config)
        if other.logs:
            changes = show.held_out(other, naming.baseline.values, naming.final.values)
    notes += optional.words(problem.readings(naming.final.values))
    result = judge(problem, naming, conditions, entries, left, varying, seen, changes, notes)
    result.problem, result.held = problem, other if other is not None and other.logs else None
    return result


def disagreements(log: Log, vehicle: Vehicle) -> list[str]:
    """Wrong units and signs, which no effect of a car explains."""
    v = vehicle.values
    return check_units(log, v["lf"] + v["lr"], v["wheel_radius_front"], v["wheel_radius_rear"], vehicle.steering_ratio)


def judge(
    problem: Problem,
    naming: name.Naming,
    conditions: list[where.Condition],
    entries: list[where.Entry],
    left: list[remainder.Remainder],
    varying: list[constancy.Variation],
    seen: list[detect.Detectable],
    changes: dict[str, show.Change],
    notes: list[str],
) -> Result:
    """From what was found to a verdict."""
    before, after = gap(problem, naming.baseline.residuals), gap(problem, naming.final.residuals)
    remains = [r for r in left if r.kind != "noise"]
    contradicting = [v for v in varying if v.contradicts] if remains else []
    enough = naming.closed >= (name.LEAST_CLOSED if len(naming.named) < name.PATCHWORK else name.LEAST_CLOSED_PATCHWORK)
    words: list[str] = []
    if not naming.named and not remains:
        verdict = "none"
        words.append("The model explains these logs down to the sensors' noise: nothing is missing that they could show.")
    elif naming.named and (enough or not remains) and not (contradicting or _only_fits(changes) or _cancels(naming.named)):
        verdict = "named"
        for n in naming.named:
            words.append(_sentence(n))
    else:
        verdict = "not_in_catalogue"
        words.append("Something is missing, and it is none of the effects of the catalogue.")
        if contradicting:
            words.append(f"What comes closest is not one number: {contradicting[0].words()}.")
        if naming.named and _only_fits(changes):
            words.append("What fits the logs best does not hold on the held-out ones.")
        if _cancels(naming.named):
            words.append("What fits the logs best is a patchwork of effects, some of a size that no car has.")
        if naming.named:
            most = max(naming.named, key=lambda n: n.share)
            words.append(f"Closest is {most.effect.title} ({most.effect.id}), which closes {100 * most.share:.0f} % of the gap.")
        elif closest := _closest(naming):
            best = closest[0]
            words.append(f"Closest, and not close enough: {best['id']}, which closes {100 * best['share']:.0f} % of the gap.")
        else:
            words.append("No effect of the catalogue closes any of the gap to speak of.")
        if entries and entries[0].nats > 0:
            words.append(f"It acts like a disturbance at: {entries[0].place}.")
    words += [r.words for r in remains]
    if len(naming.named) >= name.PATCHWORK:
        notes = [*notes, f"{len(naming.named)} effects together are more likely a patchwork than the truth"]
    exit_code = EXIT[verdict]
    if verdict == "named" and all(n.look_alikes for n in naming.named):
        exit_code = EXIT["look-alikes"]
    alike = {i for n in naming.named for i in n.look_alikes}  # of these the logs show one, and do not say which
    undetectable = [d for d in seen if not d.visible and d.id not in alike]
    return Result(
        verdict, exit_code, words, naming, conditions, entries, left, before, after, changes, contradicting, undetectable, seen,
        notes,
    )  # fmt: skip


def _closest(naming: name.Naming) -> list[dict[str, Any]]:
    """Where nothing came near a name: the first of the ranking, if it closes anything."""
    return [r for r in naming.ranking[:1] if r.get("share", 0.0) > name.LEAST_SHARE]


def _only_fits(changes: dict[str, show.Change]) -> bool:
    """Held-out logs, of which the names explain too little."""
    return bool(changes) and max(c.after for c in changes.values()) > MOST_HELD_OUT and show.closed(changes) < name.LEAST_CLOSED


def _cancels(named: Sequence[name.Named]) -> bool:
    """Many effects, and one far beyond what is typical: they undo what of each other does not fit."""
    return len(named) >= name.PATCHWORK and any(
        abs(n.values[p.name]) > 2.0 * p.typical_high for n in named for p in n.effect.strengths if n.effect.id not in PROFILES
    )


def _sentence(n: name.Named) -> str:
    units = {p.name: p for p in n.effect.parameters}
    sizes = ", ".join(
        f"{units[k].key} {v:.3g}{'' if units[k].unit == '1' else ' ' + units[k].unit} ({n.ci95[k][0]:.3g} .. {n.ci95[k][1]:.3g})"
        for k, v in n.values.items()
        if units[k].strength
    )
    text = f"{n.effect.title} ({n.effect.id}): {sizes}; it closes {100 * n.share:.0f} % of the gap."
    if n.look_alikes:
        text += f" These logs cannot exclude {', '.join(n.look_alikes)} in its place."
    return text
