"""What a calibration leaves: what it found, number by number, in words."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np

from tse.car.vehicle import Vehicle
from tse.identify.advice import Offer
from tse.identify.advice import describe_offers as offer_words
from tse.identify.fit import CarFit, compute_covariance
from tse.identify.problem import CarProblem
from tse.identify.slip import describe_slip
from tse.identify.unknowns import (
    CHANNEL_UNIT,
    LATENCIES,
    MEASURED,
    OF_VELOCITY,
    UNKNOWNS,
    VELOCITY,
    Unknown,
    get_unit,
)
from tse.library.core import Config

MIN_RELIABLE_SECONDS = (
    20.0  # of all logs together: of fewer the search converges, near its prior, on what happens to fit
)
SHOWN = 0.7  # posterior over prior sd below which the logs have said something of a number
SURE = 3.0  # sd from nothing at which a size is called one
MAX_WORSE_RATIO = 1.05  # of the rms before: what a calibration makes of no log of its car
MAX_STATED_SD = 4.0  # prior sd: where one of STATED comes out so far off, the file says another car; right cars 2.4, a ratio 30 % wrong 5.8
STATED = {
    "steering_ratio_change": "the steering ratio or lf + lr",
    "imu_misalignment_angle": "the direction of the IMU",
    "wheel_radius_front": "wheel_radius_front",
    "wheel_radius_rear": "wheel_radius_rear",
    "gyro_scale_error": "the scale of yaw_rate",
}
CHANNEL_WORDS = {
    "steer_angle": "steering angle", "wheel_speed_front": "front wheel speed", "wheel_speed_rear": "rear wheel speed",
    "accel_x": "accel_x", "accel_y": "accel_y",
}  # fmt: skip
AXLES = {"cy_front": "front", "cy_rear": "rear"}
REAR_STIFFNESS = "longitudinal_stiffness_rear"
NOT_ZERO = f", less than {SURE:g} sd from 0, or too small to matter"


@dataclass(frozen=True)
class NumberFinding:
    """One number of the car."""

    name: str
    group: str
    unit: str
    before: float  # as the vehicle file had it
    prior: float
    prior_sd: float
    value: float
    sd: float
    shown: bool  # the logs reduced its sd
    words: str
    shape: bool = False  # of an effect: nothing where that is off

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def describe_misstated(found: Sequence[NumberFinding]) -> str:
    """Return what the vehicle file says and the logs contradict, in words; empty: nothing."""
    for f in found:
        if f.name in STATED and f.prior_sd > 0 and (off := abs(f.value - f.prior) / f.prior_sd) > MAX_STATED_SD:
            return f"{STATED[f.name]} seems wrong: {f.name} is {f.value:.3g} and not {f.prior:.3g}, {off:.0f} sd of what cars have"
    return ""


@dataclass(frozen=True)
class FindingGroup:
    """What belongs together, and what speaks for it."""

    name: str
    nats: float  # by which the logs speak against what the vehicle file had
    members: tuple[NumberFinding, ...]


def list_findings(problem: CarProblem, fit: CarFit, before: Mapping[str, float]) -> list[NumberFinding]:
    """All unknowns of the car but its stiffness. `before`: by name, what the vehicle file had."""
    known, found = np.sqrt(np.diag(fit.covariance)), fit.x
    times = compute_rear_factor(problem, fit)
    rows = []
    known_names = list(problem.prior.names)
    for u in (*UNKNOWNS, *OF_VELOCITY):
        if u.name not in known_names:
            continue
        k = known_names.index(u.name)
        shown = bool(known[k] < SHOWN * problem.sd[k])
        by = float(getattr(problem.config, u.name)) if u.relative else 1.0
        follows = times if u.name == REAR_STIFFNESS else 1.0
        value, sd, prior, prior_sd = (float(x[k]) * follows for x in (found, known, problem.mean, problem.sd))
        rows.append(
            NumberFinding(
                u.name, u.group, get_unit(u.name), before[u.name], prior, prior_sd, value, sd, shown,
                _describe_finding(u, value, sd, shown, before[u.name], by), u.worth == 0.0,
            )
        )  # fmt: skip
    return rows


def compute_rear_factor(problem: CarProblem, fit: CarFit) -> float:
    """Return by how much the rear's longitudinal stiffness is more than its unknown says, as it follows the front's."""
    follows = problem.config.rear_longitudinal_follows_front
    return float(1.0 + follows * (np.exp(fit.x[problem.names.index("cx_front")]) - 1.0))


def _describe_finding(u: Unknown, value: float, sd: float, shown: bool, before: float, by: float) -> str:
    if u.name in LATENCIES:
        what = CHANNEL_WORDS[LATENCIES[u.name]]
        if not shown:
            return f"{what}: these logs do not show how late it is behind the gyro"
        low, high = (1000 * (value + side * 1.96 * sd) for side in (-1, 1))
        text = f"{what}: {1000 * value:.1f} ms behind the gyro, 95 % interval {low:.1f} .. {high:.1f}"
        return text + (NOT_ZERO if abs(value) < max(SURE * sd, u.worth) else "")
    title = u.name.replace("_", " ")
    unit = "" if get_unit(u.name) == "1" else " " + get_unit(u.name)
    if not shown:
        return f"{title}: these logs do not show it"
    text = f"{title}: {value:.4g}{unit}, 95 % interval {value - 1.96 * sd:.4g} .. {value + 1.96 * sd:.4g}"
    if u.worth and abs(value - before) < max(SURE * sd, u.worth * by):
        return text + (
            f", less than {SURE:g} sd from {before:.4g} of the vehicle file, or too near to matter"
            if before
            else NOT_ZERO
        )
    return text


def group_findings(problem: CarProblem, fit: CarFit, rows: Sequence[NumberFinding]) -> list[FindingGroup]:
    """Findings that belong together, that with most evidence first. The evidence is that of a quadratic: half the square of how far
    the numbers are from what the vehicle file had, in their joint covariance."""
    found = []
    for name in dict.fromkeys(r.group for r in rows):
        sizes = [
            k for k, r in enumerate(rows) if r.group == name and r.shown and not r.shape
        ]  # else the prior would speak
        off = np.array([(rows[k].value - rows[k].before) / rows[k].sd for k in sizes])
        sd = np.sqrt(np.diag(fit.covariance)[sizes])
        inverse = np.linalg.pinv(fit.covariance[np.ix_(sizes, sizes)] / np.outer(sd, sd))
        found.append(FindingGroup(name, 0.5 * float(off @ inverse @ off), tuple(r for r in rows if r.group == name)))
    return sorted(found, key=lambda g: -g.nats)


def list_stated(config: Config) -> dict[str, float]:
    """What the settings say of each unknown; a latency that they do not know is 0."""
    values = config.as_dict()
    return {u.name: float(values.get(u.name, 0.0)) for u in (*UNKNOWNS, *OF_VELOCITY)}


# ---- the result as a whole


@dataclass(frozen=True)
class ProofChannel:
    """A channel of a log, in its unit, as means over 40 ms: rms of what was measured, and
    of measured less simulated before and after, each about its mean; and the sensor's
    noise."""

    signal: float
    before: float
    after: float
    noise: float

    @property
    def explained(self) -> tuple[float, float]:
        """Share of the signal's square that the simulation explains, before and after."""
        return tuple(1.0 - (x / max(self.signal, 1e-12)) ** 2 for x in (self.before, self.after))


@dataclass(frozen=True)
class Proof:
    """A log against the car of its file, and as calibrated. Of a fitted log the road is
    known; of a held-out one nothing is fitted but biases and how far its road leans into
    its curves."""

    log: str
    held_out: bool
    channels: dict[str, ProofChannel]


@dataclass
class CalibrationResult:
    """What a calibration leaves."""

    vehicle: Vehicle
    config: Config
    problem: CarProblem
    fit: CarFit
    findings: list[NumberFinding]
    groups: list[FindingGroup]
    proofs: list[Proof]
    sensors: dict[str, float]
    steps: dict[str, float]  # quantisation of each channel as logged; 0: none that shows
    notes: list[str] = field(default_factory=list)
    offers: list[Offer] = field(default_factory=list)  # what would make the axles surer
    own: bool = False  # on the logs that are estimated: their rows count once

    @property
    def seconds(self) -> float:
        return sum(log.seconds for log in self.problem.logs)

    @property
    def along(self) -> list[str]:
        """What the straight rows show and do not show, in words."""
        return describe_slip(self.problem, self.fit)

    @property
    def surer(self) -> list[str]:
        """What to drive or to find out next, a line each."""
        sd = np.sqrt(np.diag(self.fit.covariance))
        return offer_words({k: float(sd[self.problem.names.index(k)]) for k in AXLES}, self.offers)

    @property
    def misstated(self) -> str:
        """What the vehicle file says and the logs contradict, in words; empty: nothing."""
        return describe_misstated(self.findings)


def describe_velocity_gain(result: CalibrationResult) -> list[str]:
    """Return what a measured velocity brings: the 95 % intervals of the axles without and with it."""
    if not any(c in result.problem.channels for c in VELOCITY):
        return []
    without = np.sqrt(np.diag(compute_covariance(result.problem, result.fit, MEASURED)))
    found = np.sqrt(np.diag(result.fit.covariance))
    parts = []
    for key, axle in AXLES.items():
        k = result.problem.names.index(key)
        parts.append(f"{axle} +- {196 * without[k]:.0f} -> +- {196 * found[k]:.1f} %")
    return [f"The measured velocity makes the stiffness surer: {', '.join(parts)}."]


def list_contradicting(proofs: Sequence[Proof]) -> list[str]:
    """Return which logs turn less as the calibrated car does than as that of the file."""
    found = []
    for p in proofs:
        more = {
            c: p.channels[c].after / p.channels[c].before for c in ("accel_y", "yaw_rate") if c in p.channels
        }
        if max(more.values(), default=0.0) > MAX_WORSE_RATIO:
            parts = ", ".join(f"{c} {100 * (x - 1):+.0f} %" for c, x in more.items())
            found.append(f"{p.log} contradicts the calibration ({parts}): another car, tyres, load?")
    return found


def merge_channels(proofs: Sequence[Proof], channel: str) -> ProofChannel:
    """Return a channel of several logs as one: rms over the logs."""
    mine = [p.channels[channel] for p in proofs if channel in p.channels]
    return ProofChannel(
        *(float(np.sqrt(np.mean([getattr(x, f.name) ** 2 for x in mine]))) for f in fields(ProofChannel))
    )


def describe_proofs(proofs: Sequence[Proof]) -> list[str]:
    """Return a line for each channel, of the fitted logs and of those held out."""
    lines = []
    for held, title in ((False, "fitted"), (True, "held-out")):
        mine = [p for p in proofs if p.held_out == held]
        for c in dict.fromkeys(c for p in mine for c in p.channels):
            x = merge_channels(mine, c)
            was, now = (100 * e for e in x.explained)
            lines.append(
                f"{c} of {title} logs: {x.before:.3g} {CHANNEL_UNIT[c]} off before, {x.after:.3g} after, {x.noise:.2g} is noise"
                f" ({was:.0f} % of the signal explained before, {now:.0f} % after)."
            )
    return lines


def describe_result(result: CalibrationResult) -> list[str]:
    """Return how the search ended, and what it shows."""
    n = len(result.problem.logs)
    logs = f"{n} log{'s' if n > 1 else ''}, {result.seconds / 60:.1f} minutes"
    if result.fit.converged:
        lines = [f"From {logs}: converged after {result.fit.steps} steps."]
    else:
        lines = [
            f"From {logs}: NOT converged after {result.fit.steps} steps (last step {result.fit.moved:.2g} sd); --steps allows more."
        ]
    lines += describe_proofs(result.proofs)
    lines += describe_velocity_gain(result)
    lines += list_contradicting(result.proofs)
    if wrong := result.misstated:
        lines.append(f"Check the vehicle file: {wrong}.")
    if result.seconds < MIN_RELIABLE_SECONDS:
        lines.append(
            f"Not to be relied on: {result.seconds:.0f} s can be compared with a simulation, {MIN_RELIABLE_SECONDS:g} s are needed."
        )
    hidden = [f.name for f in result.findings if not f.shown]
    if hidden:
        lines.append(f"Not shown by these logs: {', '.join(hidden)}.")
    return lines + result.surer


def summarise_result(result: CalibrationResult, stiffness: str) -> list[str]:
    """Return the result in a few lines: the stiffness, what was found beside it, what is
    unchanged, what it is worth, and what makes it surer. words() says all."""
    found = [
        g.name
        for g in result.groups
        if any(f.shown and abs(f.value - f.before) > SURE * f.sd for f in g.members)
    ]
    hidden = sum(not f.shown for f in result.findings)
    held = any(p.held_out for p in result.proofs)
    of = [p for p in result.proofs if p.held_out == held]
    lines = [stiffness]
    lines.append(
        f"Found beside it: {', '.join(found) if found else 'nothing that differs from the vehicle file'}."
    )
    lines.append(f"Unchanged: {hidden} of {len(result.findings)} numbers, which these logs do not show.")
    for c in ("accel_y", "yaw_rate"):
        if any(c in p.channels for p in of):
            x = merge_channels(of, c)
            lines.append(
                f"{c} of {'held-out' if held else 'the fitted'} logs is {x.after:.2g} {CHANNEL_UNIT[c]} off the simulation, "
                f"before {x.before:.2g}; {x.noise:.2g} is noise."
            )
    if not result.fit.converged:
        lines += [line for line in describe_result(result) if "NOT converged" in line]
    lines += list_contradicting(result.proofs)
    if wrong := result.misstated:
        lines.append(f"Check the vehicle file: {wrong}.")
    return lines + result.surer[:2]
