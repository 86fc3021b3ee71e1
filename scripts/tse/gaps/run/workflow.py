"""`tselab gap`: find where simulation and logs disagree, name the effects that the
vehicle file lacks, and describe the result. If residuals above the sensor noise remain,
search for a formula that explains them. The formula is added to a quantity of the model,
such as the yaw moment.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tse.car.formula import Formula
from tse.car.vehicle import GRAVITY, Vehicle, fill_sensors, list_latency_settings, read_vehicle
from tse.channels.agree import read_agreeing
from tse.gaps.catalogue import Key, drop_log_values, list_signed_delays, load_catalogue
from tse.gaps.fit import NOISE_LIMIT, ChannelChange, Fit, compare_models, compute_excess, compute_gap
from tse.gaps.infer import detect, remainder, where
from tse.gaps.infer import formula_search as search
from tse.gaps.infer import naming as name
from tse.gaps.infer.excerpt import choose_excerpt, is_long
from tse.gaps.infer.formula_search import Discovery
from tse.gaps.infer.hypotheses import NAME_AT, apply_priors
from tse.gaps.infer.naming import Named
from tse.gaps.infer.rivals import explain_remainder
from tse.gaps.infer.roads import Roads, find_roads
from tse.gaps.problem import Problem
from tse.gaps.run.stages import Stage, calibrate_every_car, compute_stages
from tse.identify.data import PreparedLog, prepare, remove_latencies
from tse.identify.knots import PROFILES
from tse.library import __version__
from tse.library.core import Config
from tse.library.errors import UserError
from tse.log.rows import CheckedLog, Reading
from tse.roads.road import Road
from tse.roads.road_match import add_road, match_log

# Key of EXIT for the verdict "possible", and for the verdict "named" if a named effect
# has a probability below NAME_AT or each named effect has look-alikes (effects that the
# logs cannot distinguish from the named one).
DOUBTFUL = "below 90 %, or look-alikes"
EXIT = {"none": 0, "named": 10, DOUBTFUL: 11, "not_in_catalogue": 20}  # verdict -> exit code
# If no effect is named and no error above the noise remains: the verdict is "possible" if
# at least one effect has at least this probability, otherwise "none".
MIN_UNNAMED_PROBABILITY = 0.5
FIT, HELD_OUT = "fit", "held_out"  # the two parts of the logs: fitted, and held out


@dataclass
class Found:
    """The named effects, and the formula for the residuals that these effects leave."""

    naming: name.Naming
    # result of the search for a formula; None if there was no search
    discovery: Discovery | None = None
    # the combinations of named effects and a formula that were compared, with their
    # probabilities
    rivals: list[dict[str, Any]] = field(default_factory=list)
    # part (FIT or HELD_OUT) and data of each log
    read: list[tuple[str, CheckedLog]] = field(default_factory=list)
    roads: Roads | None = None  # the roads of the fitted logs

    @property
    def most_laps(self) -> int:
        """The largest number of fitted logs that are laps of the same road."""
        laps = self.roads.laps if self.roads is not None else None
        return max(map(laps.count, range(len(laps.path)))) if laps is not None else 1

    @property
    def formula(self) -> Formula | None:
        """The proposed formula; None if no formula is proposed."""
        return self.discovery.formula if self.discovery else None

    @property
    def final(self) -> Fit:
        """The fit with the named effects and, if a formula is proposed, the formula."""
        return self.discovery.fit if self.discovery and self.discovery.fit else self.naming.final

    @property
    def after(self) -> dict[Key, float]:
        """Fitted values for a simulation with named effects and, if any, the formula."""
        return dict(self.final.values) | (self.formula.settings() if self.formula else {})


@dataclass(kw_only=True)
class GapResult(Found):
    """Result of a run."""

    verdict: str  # none, named, possible, not_in_catalogue
    exit_code: int
    words: list[str]  # sentences that describe the result
    # the fitted logs with bank and grade: given by the user, or estimated from the logs
    problem: Problem
    level: Problem  # the fitted logs on level roads
    # part of the logs (FIT or HELD_OUT) -> channel -> rms of the residuals with three
    # models of the car (stages.py), in the unit of the channel
    stages: dict[str, dict[str, Stage]]
    conditions: list[where.Condition]  # conditions of driving with large residuals
    # places at which a disturbance may act in the model, such as the front axle
    # (where.PLACES), with the evidence for it; the most likely place comes first
    entries: list[where.Entry]
    remainders: list[remainder.Remainder]  # remaining errors of the fitted logs
    elsewhere: list[remainder.Remainder]  # remaining errors of the held-out logs above the noise
    # channel -> ratio of residual rms to sensor noise in the fitted logs, before and
    # after effects were added
    fit_before: dict[str, float]
    fit_after: dict[str, float]
    held_out: dict[str, ChannelChange]  # channel -> change of the residuals of the held-out logs
    # Effects that would not be visible in the logs at their typical size. Look-alikes of
    # named effects are left out, because the logs cannot distinguish them from the named
    # effects.
    undetectable: list[detect.Detectable]
    # the smallest visible size of every effect of the catalogue that is not named
    detectable: list[detect.Detectable]
    notes: list[str] = field(default_factory=list)
    # the held-out logs. If a held-out log was driven on a road of the fitted logs, it has
    # bank and grade of this road
    held: Problem | None = None
    held_level: Problem | None = None  # the held-out logs on level roads

    def as_json(self) -> dict[str, Any]:
        """Return the content of DIR/verdict.json."""
        return {
            "verdict": self.verdict,
            "effects": [_convert_name(n) for n in self.naming.named if not n.message],
            "sensors": list_sensor_corrections(self.problem, self.naming),
            "possible": self.naming.possible,
            "sets": self.naming.sets,
            "formula": self._convert_formula(),
            "rivals": self.rivals,
            "where": [
                asdict(c) | {"entry_point": self._find_entry_point(c.channel)} for c in self.conditions
            ],
            "entry_points": [asdict(e) for e in self.entries],
            "gap": {
                "fit": {"before": self.fit_before, "after": self.fit_after},
                "held_out": {
                    w: {k: getattr(c, of) for k, c in self.held_out.items()}
                    for w, of in (("before", "before"), ("after", "after"), ("change_ci95", "ci95"))
                },
            },
            "stages": {
                part: {c: asdict(s) for c, s in channels.items()} for part, channels in self.stages.items()
            },
            "closed": self.naming.closed,
            "remainder": [asdict(r) for r in self.remainders],
            "undetectable": [asdict(d) for d in self.undetectable],
            "words": self.words,
            "notes": self.notes,
            "version": __version__,
        }

    def _convert_formula(self) -> dict[str, Any] | None:
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

    def _find_entry_point(self, channel: str) -> str:
        if channel == "accel_x":
            return "longitudinal"
        return self.entries[0].place if self.entries and self.entries[0].nats > 0 else "unknown"


def read_logs(
    paths: Sequence[Path | CheckedLog],
    vehicle: Vehicle,
    reading: Reading | None = None,
    notes: list[str] | None = None,
) -> tuple[list[CheckedLog], Config]:
    """Read the logs, and return them and the settings of the car. Sensor settings that
    the vehicle file leaves out are estimated from the first log.
    """
    if not paths:
        raise UserError("no logs to fit: at least one is needed")
    logs = read_agreeing(paths, [] if notes is None else notes, replace(reading or Reading(), car=vehicle))
    fill_sensors(vehicle, logs[0])
    return logs, Config.exact(vehicle.values)


def run_workflow(
    logs: Sequence[Path | CheckedLog],
    vehicle_path: Path,
    hold_out: Sequence[Path | CheckedLog] = (),
    jobs: int = 1,
    say: Callable[[str], None] = lambda _: None,
    formula: bool = False,
    reading: Reading | None = None,
    road: Road | None = None,
) -> GapResult:
    """Find the effects that the vehicle file lacks.

    `logs` are fitted. The logs `hold_out` are not fitted, but test whether the result
    also holds for them. `road` is the road of all logs, if it is known. None: bank and
    grade are estimated, and laps of the same road get one common profile. A formula is
    searched for if `formula` is True, or if residuals above the sensor noise remain with
    the named effects. If the vehicle file already has a formula, none is searched for.
    `say` is called with the name of each step.
    """
    say("reading the logs")
    vehicle, notes = read_vehicle(vehicle_path), []
    reading = replace(reading or Reading(), car=vehicle)
    fitted, config = read_logs(logs, vehicle, reading, notes)
    others = read_agreeing(hold_out, notes, reading)
    if road is not None:
        fitted, others = ([add_road(log, road, config)[0] for log in part] for part in (fitted, others))
    ready = [prepare(log, config) for log in fitted]
    level = Problem([remove_latencies(log, config) for log in ready], config, jobs)
    ready_held = [prepare(log, config) for log in others]
    held = Problem([remove_latencies(log, config) for log in ready_held], config, jobs) if others else None
    said = [n for p in (level, held) if p is not None for n in p.notes]
    if not level.logs:
        raise UserError(
            "; ".join(said)
            or "no log can be compared with a simulation: give one with at least 3 s of driving above 3 m/s"
        )
    held = held if held is not None and held.logs else None
    say("fitting the parameters of the car and the profiles of the roads")
    roads = find_roads(ready, config, vehicle, jobs, say, fitted)
    say("fitting stiffness and sensor biases")
    baseline = few_baseline = name.fit_plain_car(level)
    problem = level.of([remove_latencies(log, config) for log in roads.logs])
    if not closes_part(problem, level, baseline):
        roads, problem = Roads(ready), level
    held_level = held
    if held is not None:
        held = place_on_roads(roads.list_roads(), held, ready_held, others, config, notes)
    few, few_held = problem, held
    if is_long(problem):
        say("choosing the most informative stretches of the logs")
        few = choose_excerpt(problem, name.fit_plain_car(problem))
        few_baseline = name.fit_plain_car(few.of([replace(log, road={}) for log in few.logs]))
        notes.append(
            f"the search for effects uses the most informative {_count_seconds(few):.0f} s of "
            f"{_count_seconds(problem):.0f} s"
        )
    if held is not None and is_long(held):
        few_held = choose_excerpt(held, name.fit_plain_car(held))
    say("finding where simulation and logs disagree")
    conditions = where.find_conditions(level, baseline.residuals, baseline.values)
    entries = where.find_entries(few, few_baseline)

    naming = name.name_effects(few, apply_priors(vehicle), say, few_baseline, roads.found)
    notes += said
    say("checking the residuals that the named effects leave")
    found = Found(naming)
    if vehicle.formula is not None:
        notes.append(
            f"the formula {vehicle.formula.id} of the vehicle file is kept, so no formula is searched for"
        )
    elif formula or leaves_something(few_held, naming) or find_excess_remainders(few, naming.final):
        discovery, naming, rivals = explain_remainder(few, few_held, naming, say)
        found = Found(naming, discovery, rivals)
    named = {n.effect.id for n in found.naming.named}
    seen = detect.compute_detectable(
        few, found.naming.final, [e for e in load_catalogue().values() if e.id not in named]
    )
    if few is not problem:
        say("fitting all logs")
        naming = name.refit_on_all(problem, found.naming, baseline)
        found = replace(
            found,
            naming=naming,
            discovery=found.discovery and search.refit_on_all(problem, naming.final, found.discovery),
        )

    if found.formula:  # report the effect sizes from the fit with the formula
        found.naming = replace(found.naming, named=[n.at(found.final.values) for n in found.naming.named])

    changes: dict[str, ChannelChange] = {}
    elsewhere: list[remainder.Remainder] = []
    if held is not None:
        say("checking the held-out logs")
        values = drop_log_values(found.after)
        after = held.compute_residuals(values)
        changes = compare_models(held, held_level.compute_residuals(found.naming.baseline.values), after)
        elsewhere = find_excess_remainders(held, Fit([], values, after, np.zeros((len(after), 0))))
    say("computing residuals with vehicle file, calibrated car and named effects")
    every_car = calibrate_every_car(ready, config, vehicle, jobs)
    in_stages = {FIT: compute_stages(level, ready, every_car, (problem, found.after))}
    if held is not None:
        in_stages[HELD_OUT] = compute_stages(
            held_level, ready_held, every_car, (held, drop_log_values(found.after))
        )
    if not found.naming.converged:
        notes.append("the last fit has not converged: the sizes of the effects are preliminary")
    left = remainder.find_remainders(problem, found.final.residuals, found.final.values, NOISE_LIMIT)
    found.roads = roads
    found.read = [(FIT, x) for x in fitted] + [(HELD_OUT, x) for x in others]
    verdict, exit_code, words = judge_run(found, entries, left, elsewhere)
    # effects that the logs cannot distinguish from a named effect
    alike = {i for n in found.naming.named for i in n.look_alikes}
    return GapResult(
        **vars(found),
        verdict=verdict,
        exit_code=exit_code,
        words=words,
        problem=problem,
        level=level,
        stages=in_stages,
        conditions=conditions,
        entries=entries,
        remainders=left,
        elsewhere=elsewhere,
        fit_before=compute_gap(level, found.naming.baseline.residuals),
        fit_after=compute_gap(problem, found.final.residuals),
        held_out=changes,
        undetectable=[d for d in seen if not d.visible and d.id not in alike],
        detectable=seen,
        notes=notes,
        held=held,
        held_level=held_level,
    )


# ---- the steps of a run


def closes_part(problem: Problem, level: Problem, baseline: Fit) -> bool:
    """Return whether the gap is smaller on the estimated roads than on level roads.

    The gap is the sum of squared residuals minus the sum expected from sensor noise. Both
    gaps are those of a car with fitted stiffness and without effects. `problem` has the
    estimated roads, `level` the level roads. `baseline` is the fit of `level`.
    """
    return compute_excess(problem, name.fit_plain_car(problem).residuals) < compute_excess(
        level, baseline.residuals
    )


def place_on_roads(
    roads: Sequence[Road],
    held: Problem,
    ready: list[PreparedLog],
    logs: Sequence[CheckedLog],
    config: Config,
    notes: list[str],
) -> Problem:
    """Return the held-out logs on the roads of the fitted logs.

    A held-out log that is on one of these roads gets bank and grade of this road. A log
    that is on none of them keeps a level road. `ready` are the prepared logs, `logs` the
    same logs as they were read.
    """
    placed = []
    for log, one in zip(logs, ready, strict=True):
        for road in roads:
            try:
                found = match_log(road, log, config)
            except UserError:  # the log is not on this road
                continue
            notes.append(f"{log.path.name} is on the same road as fitted logs: {found.describe()}")
            placed.append(replace(one, road={n: np.nan_to_num(getattr(found, n)) for n in ("bank", "grade")}))
            break
        else:
            placed.append(one)
    return held.of([remove_latencies(log, config) for log in placed])


def leaves_something(held: Problem | None, naming: name.Naming) -> bool:
    """Return whether the named effects leave an error above the noise in the held-out
    logs: in at least one channel, the ratio of residual rms to sensor noise exceeds
    NOISE_LIMIT. False if there are no held-out logs or no named effects.

    For example, several named effects together may imitate an effect that is not in the
    catalogue. Then they explain the fitted logs, but not the held-out logs.
    """
    if held is None or not naming.named:
        return False
    return (
        max(compute_gap(held, held.compute_residuals(drop_log_values(naming.final.values))).values())
        > NOISE_LIMIT
    )


def _count_seconds(problem: Problem) -> float:
    """Return the total length [s] of the logs."""
    return sum(log.seconds for log in problem.logs)


def find_excess_remainders(problem: Problem, last: Fit) -> list[remainder.Remainder]:
    """Return those remaining errors of a fit that exceed the sensor noise."""
    return drop_noise(remainder.find_remainders(problem, last.residuals, last.values, NOISE_LIMIT))


def drop_noise(left: list[remainder.Remainder]) -> list[remainder.Remainder]:
    """Return the remaining errors whose kind is not "noise"."""
    return [r for r in left if r.kind != "noise"]


def judge_run(
    found: Found,
    entries: Sequence[where.Entry],
    left: list[remainder.Remainder],
    elsewhere: Sequence[remainder.Remainder] = (),
) -> tuple[str, int, list[str]]:
    """Return the verdict, the exit code, and sentences that describe the result.

    `left` has the remaining errors of the fitted logs, with named effects and formula.
    `elsewhere` has the remaining errors of the held-out logs.
    """
    naming, formula = found.naming, found.formula
    remains = drop_noise(left)
    words = [_describe_name(n, found.most_laps) for n in naming.named]
    likely = [p for p in naming.possible if p["probability"] >= MIN_UNNAMED_PROBABILITY]
    if naming.named and (naming.closes_most or not (remains or formula)) and not (formula and elsewhere):
        verdict = "named"
    elif remains or formula or elsewhere:
        verdict = "not_in_catalogue"
    else:
        verdict = "possible" if likely else "none"
    if naming.named and (remains or formula):
        rest = (
            "no effect of the catalogue explains the remainder"
            if verdict == "named"
            else "a further effect is missing that is not in the catalogue"
        )
        words.append(f"Together the named effects close {100 * naming.closed:.0f} % of the gap; {rest}.")
    elif verdict == "not_in_catalogue" and not (remains or formula):
        words.append(
            "Something is missing: the residuals of the fitted logs are sensor noise, but the residuals "
            "of the held-out logs are larger."
        )
    elif verdict == "not_in_catalogue":
        words.append("Something is missing that no effect of the catalogue explains.")
    elif verdict == "none":
        words.append("Nothing is missing that these logs could show: the residuals are sensor noise.")
    if verdict in ("possible", "not_in_catalogue") and naming.possible and not formula:
        best = naming.possible[0]
        probability = _format_percent(best["probability"])
        words.append(f"Possible, but not named: {best['id']}, probability {probability} ({best['why']}).")
    if verdict == "not_in_catalogue" and entries and entries[0].nats > 0:
        words.append(f"The missing effect acts like a disturbance at: {entries[0].place}.")
    words += found.discovery.words if found.discovery else []
    words += [f"{'Still left: ' if formula else ''}{r.words}" for r in remains]
    more = [
        f"{r.channel} {r.gap:.2f} times the sensor noise"
        for r in elsewhere
        if r.channel not in {x.channel for x in remains}
    ]
    if more:
        words.append(f"The model does not explain the held-out logs: {', '.join(more)}.")
    unsure = any(n.probability < NAME_AT for n in naming.named) or all(n.look_alikes for n in naming.named)
    return (
        verdict,
        EXIT[DOUBTFUL if verdict == "possible" or (verdict == "named" and unsure) else verdict],
        words,
    )


def _convert_name(n: Named) -> dict[str, Any]:
    units = {p.name: p for p in n.effect.parameters}
    return {
        "id": n.effect.id,
        "probability": n.probability,
        "parameters": {
            units[k].key: {"value": v, "ci95": list(n.ci95[k]), "unit": units[k].unit}
            for k, v in n.values.items()
        },
        "share_of_gap_closed": n.share,
        "evidence": n.evidence,
        "look_alikes": n.look_alikes,
    }


def list_sensor_corrections(problem: Problem, naming: name.Naming) -> list[dict[str, Any]]:
    """Return latencies [s] that differ from the vehicle file, and time constants [s] of
    low-pass filters of the IMU.

    They come from named effects that are caused by late messages or by a low-pass filter
    of the IMU, not by the car (Named.message). Without such effects the list is empty.
    """
    late = [n for n in naming.named if n.message]
    if not late:
        return []
    found, given = name.convert_to_settings(problem, naming.final.values), problem.config
    settings = [k for k in list_latency_settings().values() if k in found and found[k] != getattr(given, k)]
    half = _compute_half_widths(problem, naming, settings)
    return [
        {"id": k, "value": found[k], "ci95": [found[k] - half[k], found[k] + half[k]], "unit": "s"}
        for k in settings
    ] + [
        {"id": "low_pass", "value": n.values[p.name], "ci95": list(n.ci95[p.name]), "unit": "s"}
        for n in late
        if n.effect.early
        for p in n.effect.strengths[:1]
        if p.name not in list_signed_delays()
    ]


def _compute_half_widths(problem: Problem, naming: name.Naming, settings: Sequence[str]) -> dict[str, float]:
    """Return half the width of the 95 % interval of each latency in `settings`.

    A latency may depend on several named effects, such as the delays of the IMU and of
    the steering. Their half widths are propagated linearly, and added in quadrature as if
    the effects were independent. Linear propagation is valid: a latency is linear in a
    delay that keeps its sign, and the intervals of named delays do not contain 0.
    """
    values, squares = naming.final.values, dict.fromkeys(settings, 0.0)
    step = 1e-6  # [s] step of the finite differences
    for n in naming.named:
        for key, (low, high) in ((k, c) for k, c in n.ci95.items() if k in values):
            more, less = (
                name.convert_to_settings(problem, dict(values) | {key: values[key] + by})
                for by in (step, -step)
            )
            for k in settings:
                given = getattr(problem.config, k)
                slope = (more.get(k, given) - less.get(k, given)) / (2.0 * step)
                squares[k] += (0.5 * slope * (high - low)) ** 2
    return {k: float(np.sqrt(x)) for k, x in squares.items()}


ROAD_WORDS = {"bank": "The road banks", "grade": "The road climbs and falls"}


def _describe_road(n: Named, laps: int) -> str:
    """Return the sentence about a road profile: size, number of laps, probability, and
    the share of the gap that the profile closes. The gap is the sum of squared residuals
    minus the sum expected from sensor noise.
    """
    ((size, (low, high)),) = ((v, n.ci95[k]) for k, v in n.values.items())
    degrees = " .. ".join(f"{np.degrees(x):.2g}" for x in (low, high))
    same = f", the same on {laps} laps" if laps > 1 else ""
    other = ""
    if n.effect.id == "grade" and laps == 1:
        # The speed comes from the wheels, so a grade changes only accel_x, as a bias of
        # accel_x does. A grade repeats in every lap, a varying bias does not. One lap
        # alone cannot distinguish the two.
        other = f" One lap cannot exclude that the accel_x bias varies by {GRAVITY * size:.2g} m/s2."
    return (
        f"{ROAD_WORDS[n.effect.id]} by {np.degrees(size):.2g} degrees rms (95 %: {degrees}){same} "
        f"({n.effect.id}); probability {_format_percent(n.probability)}, it closes "
        f"{100 * n.share:.0f} % of the gap.{other}"
    )


def _describe_name(n: Named, laps: int = 1) -> str:
    """Return the sentence about a named effect: size, probability, share of the gap (see
    closes_part()) that the effect closes, and look-alikes. Look-alikes are effects that
    could explain the logs instead of the named effect.
    """
    if n.effect.id in PROFILES:
        return _describe_road(n, laps)
    units = {p.name: p for p in n.effect.parameters}
    sizes = ", ".join(
        f"{units[k].key} {v:.3g}{'' if units[k].unit == '1' else ' ' + units[k].unit} "
        f"({n.ci95[k][0]:.3g} .. {n.ci95[k][1]:.3g})"
        for k, v in n.values.items()
        if units[k].strength
    )
    possibly = "possibly " if n.probability < NAME_AT else ""
    text = f"{possibly}{n.title} ({n.effect.id}): {sizes}{_describe_axle_friction(n)}"
    text += f"; probability {_format_percent(n.probability)}"
    if n.share >= 0.005:
        text += f", it closes {100 * n.share:.0f} % of the gap."
    elif n.alone < 1.0:  # the share of the whole gap would be shown as 0 %
        text += f", it closes {100 * n.alone:.0f} % of the gap that the other named effects leave."
    else:
        text += "."
    if n.look_alikes:
        text += f" These logs cannot exclude {', '.join(n.look_alikes)} in its place."
    return text


def _describe_axle_friction(n: Named) -> str:
    """Return the friction of each axle as part of a sentence; an empty string if both
    axles have the same friction, or if the effect does not limit the friction.
    """
    inverse, balance = (n.values.get(f"tyre_saturation_{k}", 0.0) for k in ("inverse_friction", "balance"))
    if not inverse or not balance:
        return ""
    return (
        f", friction {1.0 / (inverse * (1.0 + balance)):.2f} in front and "
        f"{1.0 / (inverse * (1.0 - balance)):.2f} in the rear"
    )


def _format_percent(p: float) -> str:
    return "above 99 %" if p > 0.99 else f"{100 * p:.0f} %"
