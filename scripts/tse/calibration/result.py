"""The result of a calibration, and lines of text that describe each number and the whole
result."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np

from tse.car.vehicle import Vehicle
from tse.identify.advice import Offer, describe_offers
from tse.identify.fit import CarFit, compute_covariance
from tse.identify.problem import CarProblem
from tse.identify.slip import describe_slip
from tse.identify.unknowns import (
    CHANNEL_UNIT,
    CORNERING_AXLES,
    LATENCIES,
    MAX_SHOWN_RATIO,
    MEASURED,
    OF_VELOCITY,
    SIGNIFICANT_SD,
    UNKNOWNS,
    VELOCITY,
    Unknown,
    get_unit,
)
from tse.library.core import Config

# [s] Min total length of the logs. With shorter logs, the search converges near the
# prior, and the differences from the prior are due to chance.
MIN_RELIABLE_SECONDS = 20.0
# [1] Max ratio of the rms residual of a log with the calibrated car to that with the car
# of the vehicle file. If the ratio is larger, the log is probably of a different car.
MAX_WORSE_RATIO = 1.05
# Max |posterior mean - prior mean| of a parameter in STATED, in prior sds. A larger
# difference means that the vehicle file is wrong. With correct files it was at most 2.4.
# With a steering ratio that was wrong by 30 % it was 5.8.
MAX_STATED_SD = 4.0
# parameter -> entry of the vehicle file that is wrong if the posterior mean of this
# parameter differs from its prior mean by more than MAX_STATED_SD prior sds
STATED = {
    "steering_ratio_change": "the steering ratio or lf + lr",
    "imu_misalignment_angle": "the direction of the IMU",
    "wheel_radius_front": "wheel_radius_front",
    "wheel_radius_rear": "wheel_radius_rear",
    "gyro_scale_error": "the scale of yaw_rate",
}
CHANNEL_WORDS = {
    "steer_angle": "steering angle",
    "wheel_speed_front": "front wheel speed",
    "wheel_speed_rear": "rear wheel speed",
    "accel_x": "accel_x",
    "accel_y": "accel_y",
}
REAR_STIFFNESS = "longitudinal_stiffness_rear"
NOT_ZERO = f", less than {SIGNIFICANT_SD:g} sd from 0, or too small to matter"


@dataclass(frozen=True)
class NumberFinding:
    """One fitted parameter of the car, before and after the calibration."""

    name: str
    group: str
    unit: str
    before: float  # value in the vehicle file
    prior: float  # prior mean
    prior_sd: float
    value: float  # posterior mean
    sd: float  # posterior sd
    # True if the logs determine the number: posterior sd < MAX_SHOWN_RATIO * prior sd
    shown: bool
    words: str  # line for the user
    # True for a parameter that gives the shape of an effect, such as a time constant, and
    # not its size. At size 0, the shape has no influence, so group_findings() does not
    # count it as evidence
    shape: bool = False

    def as_json(self) -> dict[str, Any]:
        """Return the fields as a dictionary."""
        return asdict(self)


def describe_misstated(found: Sequence[NumberFinding]) -> str:
    """Return a sentence about the first number of the vehicle file that the logs
    contradict (MAX_STATED_SD); an empty string if there is no such number."""
    for f in found:
        if f.name not in STATED or f.prior_sd <= 0:
            continue
        if (off := abs(f.value - f.prior) / f.prior_sd) > MAX_STATED_SD:
            return (
                f"{STATED[f.name]} seems wrong: from the logs, {f.name} is {f.value:.3g}, expected is "
                f"{f.prior:.3g}, a difference of {off:.0f} prior sd"
            )
    return ""


@dataclass(frozen=True)
class FindingGroup:
    """Fitted parameters of one group, such as all latencies, and the evidence that they
    differ from the vehicle file."""

    name: str
    # [nat] ln likelihood of the values found minus ln likelihood of the values in the
    # vehicle file, approximated (group_findings())
    nats: float
    members: tuple[NumberFinding, ...]


def list_findings(problem: CarProblem, fit: CarFit, before: Mapping[str, float]) -> list[NumberFinding]:
    """Return a NumberFinding for each parameter that was fitted, except the stiffnesses.
    `before` has the values of the vehicle file."""
    known, found = np.sqrt(np.diag(fit.covariance)), fit.x
    times = compute_rear_factor(problem, fit)
    rows = []
    known_names = list(problem.prior.names)
    for u in (*UNKNOWNS, *OF_VELOCITY):
        if u.name not in known_names:
            continue
        k = known_names.index(u.name)
        shown = bool(known[k] < MAX_SHOWN_RATIO * problem.sd[k])
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
    """Return the factor of the rear longitudinal stiffness: fitted value / vehicle file.

    The rear longitudinal stiffness is not fitted on its own. Its relative change is that
    of the front one, times the setting rear_longitudinal_follows_front (0 .. 1)."""
    follows = problem.config.rear_longitudinal_follows_front
    return float(1.0 + follows * (np.exp(fit.x[problem.names.index("cx_front")]) - 1.0))


def _describe_finding(u: Unknown, value: float, sd: float, shown: bool, before: float, by: float) -> str:
    """Return a line for the user: the number `value` and its 95 % interval. If `shown` is
    False, the line says instead that the logs do not show the number.

    `before`: value in the vehicle file. The line also says if |`value` - `before`| (of a
    latency: |`value`|) is negligible, i.e. below the larger of SIGNIFICANT_SD x `sd` and
    u.worth x `by`. `by`: value in the vehicle file if u.worth is relative, otherwise 1.
    If u.worth is 0, the difference is never called negligible.
    """
    if u.name in LATENCIES:
        what = CHANNEL_WORDS[LATENCIES[u.name]]
        if not shown:
            return f"{what}: these logs do not show its delay behind the gyro"
        low, high = (1000 * (value + side * 1.96 * sd) for side in (-1, 1))
        text = f"{what}: {1000 * value:.1f} ms behind the gyro, 95 % interval {low:.1f} .. {high:.1f}"
        return text + (NOT_ZERO if abs(value) < max(SIGNIFICANT_SD * sd, u.worth) else "")
    title = u.name.replace("_", " ")
    unit = "" if get_unit(u.name) == "1" else " " + get_unit(u.name)
    if not shown:
        return f"{title}: these logs do not show it"
    text = f"{title}: {value:.4g}{unit}, 95 % interval {value - 1.96 * sd:.4g} .. {value + 1.96 * sd:.4g}"
    if not u.worth or abs(value - before) >= max(SIGNIFICANT_SD * sd, u.worth * by):
        return text
    if not before:
        return text + NOT_ZERO
    return (
        f"{text}, less than {SIGNIFICANT_SD:g} sd from {before:.4g} of the vehicle file, "
        "or too near to matter"
    )


def group_findings(problem: CarProblem, fit: CarFit, rows: Sequence[NumberFinding]) -> list[FindingGroup]:
    """Return the findings in groups, the group with the most evidence first.

    The evidence is computed from a quadratic approximation of the log likelihood. It is
    (x - x0)' P^-1 (x - x0) / 2 with the values found x, the values in the vehicle file
    x0, and the posterior covariance P of x.
    """
    found = []
    for name in dict.fromkeys(r.group for r in rows):
        # Numbers that the logs do not determine are left out: they differ from the
        # vehicle file only because of their prior.
        sizes = [k for k, r in enumerate(rows) if r.group == name and r.shown and not r.shape]
        off = np.array([(rows[k].value - rows[k].before) / rows[k].sd for k in sizes])
        sd = np.sqrt(np.diag(fit.covariance)[sizes])
        inverse = np.linalg.pinv(fit.covariance[np.ix_(sizes, sizes)] / np.outer(sd, sd))
        found.append(
            FindingGroup(name, 0.5 * float(off @ inverse @ off), tuple(r for r in rows if r.group == name))
        )
    return sorted(found, key=lambda g: -g.nats)


def list_stated(config: Config) -> dict[str, float]:
    """Return a dict. Key: name of each parameter that a calibration fits. Value: the
    value of the setting with this name; 0 if there is no such setting."""
    values = config.as_dict()
    return {u.name: float(values.get(u.name, 0.0)) for u in (*UNKNOWNS, *OF_VELOCITY)}


# ---- the result as a whole


@dataclass(frozen=True)
class ProofChannel:
    """Sds of one channel of a log, in the unit of the channel. They are the sds of means
    over blocks of 40 ms."""

    signal: float  # sd of the measured channel
    before: float  # sd of measured minus simulated, with the car of the vehicle file
    after: float  # sd of measured minus simulated, with the calibrated car
    noise: float  # sd of the sensor noise

    @property
    def explained(self) -> tuple[float, float]:
        """Share of the variance of the measured channel that the simulation explains, as
        a pair: with the car of the vehicle file, and with the calibrated car."""
        return tuple(1.0 - (x / max(self.signal, 1e-12)) ** 2 for x in (self.before, self.after))


@dataclass(frozen=True)
class Proof:
    """Misfit of a log with the car of the vehicle file and with the calibrated car.

    A log that was used for the fit is simulated on the road that was fitted to it. To a
    held-out log, only biases and the superelevation of its road are fitted.
    """

    log: str
    held_out: bool
    channels: dict[str, ProofChannel]


@dataclass
class CalibrationResult:
    """Result of a calibration."""

    vehicle: Vehicle
    config: Config
    problem: CarProblem
    fit: CarFit
    findings: list[NumberFinding]
    groups: list[FindingGroup]
    proofs: list[Proof]
    sensors: dict[str, float]
    steps: dict[str, float]  # channel -> largest quantisation step in the logs; 0: not quantised
    notes: list[str] = field(default_factory=list)
    # drives and measurements that are proposed because they would narrow the intervals
    offers: list[Offer] = field(default_factory=list)
    # True if the filter later estimates the stiffness in the same logs (own.py)
    own: bool = False

    @property
    def seconds(self) -> float:
        """[s] Total length of the parts of the logs that are compared with the
        simulation.
        """
        return sum(log.seconds for log in self.problem.logs)

    @property
    def slip_lines(self) -> list[str]:
        """Lines on longitudinal stiffness and wheel radii, which are estimated from the
        slip in straight driving."""
        return describe_slip(self.problem, self.fit)

    @property
    def advice(self) -> list[str]:
        """Lines that propose the next drive or measurement."""
        sd = np.sqrt(np.diag(self.fit.covariance))
        now = {k: float(sd[self.problem.names.index(k)]) for k in CORNERING_AXLES}
        return describe_offers(now, self.offers)

    @property
    def misstated(self) -> str:
        """A sentence about a number of the vehicle file that the logs contradict; an
        empty string if there is no such number."""
        return describe_misstated(self.findings)


def describe_velocity_gain(result: CalibrationResult) -> list[str]:
    """Return a list of one line that compares the 95 % intervals of the cornering
    stiffnesses without and with the measured velocity. The list is empty if no velocity
    is measured."""
    if not any(c in result.problem.channels for c in VELOCITY):
        return []
    without = np.sqrt(np.diag(compute_covariance(result.problem, result.fit, MEASURED)))
    found = np.sqrt(np.diag(result.fit.covariance))
    parts = []
    for key, axle in CORNERING_AXLES.items():
        k = result.problem.names.index(key)
        parts.append(f"{axle} +- {196 * without[k]:.0f} -> +- {196 * found[k]:.1f} %")
    return [f"The measured velocity narrows the intervals of the stiffness: {', '.join(parts)}."]


def list_contradicting(proofs: Sequence[Proof]) -> list[str]:
    """Return a sentence for each log that contradicts the calibration: the residual rms
    of accel_y or yaw_rate with the calibrated car is more than MAX_WORSE_RATIO times the
    rms with the car of the vehicle file."""
    found = []
    for p in proofs:
        more = {
            c: p.channels[c].after / p.channels[c].before for c in ("accel_y", "yaw_rate") if c in p.channels
        }
        if max(more.values(), default=0.0) > MAX_WORSE_RATIO:
            parts = ", ".join(f"{c} {100 * (x - 1):+.0f} %" for c, x in more.items())
            found.append(
                f"{p.log} contradicts the calibration (residuals: {parts}): a different car, tyres or load?"
            )
    return found


def merge_channels(proofs: Sequence[Proof], channel: str) -> ProofChannel:
    """Return a ProofChannel that summarises a channel over all logs. Each of its sds is
    the rms of the sds of the logs, in which all logs have the same weight."""
    mine = [p.channels[channel] for p in proofs if channel in p.channels]
    names = (f.name for f in fields(ProofChannel))
    return ProofChannel(*(float(np.sqrt(np.mean([getattr(x, n) ** 2 for x in mine]))) for n in names))


def describe_proofs(proofs: Sequence[Proof]) -> list[str]:
    """Return a sentence on the misfit of each channel, separately for fitted and held-out
    logs."""
    lines = []
    for held, title in ((False, "fitted"), (True, "held-out")):
        mine = [p for p in proofs if p.held_out == held]
        for c in dict.fromkeys(c for p in mine for c in p.channels):
            x = merge_channels(mine, c)
            was, now = (100 * e for e in x.explained)
            lines.append(
                f"{c} of {title} logs: rms error {x.before:.3g} {CHANNEL_UNIT[c]} before, {x.after:.3g} "
                f"after, sensor noise {x.noise:.2g} ({was:.0f} % of the signal explained before, "
                f"{now:.0f} % after)."
            )
    return lines


def describe_result(result: CalibrationResult) -> list[str]:
    """Return the whole result as lines of text: search, misfit, checks, proposals."""
    n = len(result.problem.logs)
    logs = f"{n} log{'s' if n > 1 else ''}, {result.seconds / 60:.1f} minutes"
    if result.fit.converged:
        lines = [f"From {logs}: converged after {result.fit.steps} steps."]
    else:
        lines = [
            f"From {logs}: NOT converged after {result.fit.steps} steps "
            f"(last step {result.fit.moved:.2g} sd); --steps allows more."
        ]
    lines += describe_proofs(result.proofs)
    lines += describe_velocity_gain(result)
    lines += list_contradicting(result.proofs)
    if wrong := result.misstated:
        lines.append(f"Check the vehicle file: {wrong}.")
    if result.seconds < MIN_RELIABLE_SECONDS:
        lines.append(
            f"Not reliable: {result.seconds:.0f} s can be compared with a simulation, "
            f"{MIN_RELIABLE_SECONDS:g} s are needed."
        )
    hidden = [f.name for f in result.findings if not f.shown]
    if hidden:
        lines.append(f"Not shown by these logs: {', '.join(hidden)}.")
    return lines + result.advice


def summarise_result(result: CalibrationResult, stiffness: str) -> list[str]:
    """Return the result in a few lines for the user. The first line is `stiffness`."""
    found = [
        g.name
        for g in result.groups
        if any(f.shown and abs(f.value - f.before) > SIGNIFICANT_SD * f.sd for f in g.members)
    ]
    hidden = sum(not f.shown for f in result.findings)
    held = any(p.held_out for p in result.proofs)
    of = [p for p in result.proofs if p.held_out == held]
    lines = [stiffness]
    lines.append(
        f"Also found: {', '.join(found) if found else 'nothing that differs from the vehicle file'}."
    )
    lines.append(f"Not shown by these logs: {hidden} of {len(result.findings)} numbers.")
    for c in ("accel_y", "yaw_rate"):
        if any(c in p.channels for p in of):
            x = merge_channels(of, c)
            lines.append(
                f"{c} of {'held-out' if held else 'the fitted'} logs: rms error of the simulation "
                f"{x.after:.2g} {CHANNEL_UNIT[c]}, before {x.before:.2g}; sensor noise {x.noise:.2g}."
            )
    if not result.fit.converged:
        lines += [line for line in describe_result(result) if "NOT converged" in line]
    lines += list_contradicting(result.proofs)
    if wrong := result.misstated:
        lines.append(f"Check the vehicle file: {wrong}.")
    return lines + result.advice[:2]
