"""Make the verdicts on stiffness, grip and sideslip. A verdict is a sentence for terminal
and report. It states the value, its 95 % interval, and whether the value is valid or why
it is not. Also make remarks on the sensors of the log."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from tse.estimation import regimes
from tse.estimation.regimes import (
    MIN_EVENT_PROBABILITY,
    Change,
    Stretch,
    estimate_times,
    find_channel_name,
    find_spans,
    find_stretches,
    format_percent,
)
from tse.estimation.smooth import compute_fixed_parts, smooth_stretch
from tse.library.core import GRIP, NOMINAL, STIFFNESS, Config, library
from tse.log.rows import MEASURES

NAMES = {
    "cx_front": "Front longitudinal stiffness",
    "cy_front": "Front cornering stiffness",
    "cy_rear": "Rear cornering stiffness",
}
UNITS = {"cx_front": "kN", "cy_front": "kN/rad", "cy_rear": "kN/rad"}
# stiffness or grip -> explanation if the excitation was too weak
TOO_QUIET = {
    "cx_front": "driving and braking were too weak or too steady",
    "cy_front": "too little steering excitation",
    "cy_rear": "too little steering excitation",
    GRIP: "the tyres were not driven near their limit",
}
CONTRADICTED = "contradicted"  # reason that applies to a whole log, not to single rows
# reason why a stiffness is not valid -> explanation
WHY = {
    "starting": "too little excitation since the start",
    "sensor fault": "a sensor was probably at fault",
    "held": "standstill, low speed, reverse, large steering angle or sliding wheels",
    "input invalid": "inputs or measurements were missing",
    "parameters uncertain": "the car's parameters are too uncertain: calibrate, or enter smaller sds "
    "in [uncertainty] if the parameters are known better",
    "does not fit": "the model does not explain the measurements: calibrate, or look for what is "
    "missing (tselab gap)",
    "implausible": "the channels contradict each other: a wrong unit, sign or axle (fault_channel, "
    "fault_factor)",
    "row refused": "the rows were refused",
    CONTRADICTED: "channels or vehicle file are wrong (see the warning); correct them and run again",
}
# If the last row of a whole log has one of these reasons, Verdict.level is not "good"
AT_FAULT = ("sensor fault", "implausible")
# If a stiffness is not valid for one of these reasons, the text of the verdict states its
# sd, and the limit that the sd exceeds
LIMITED = ("uncertain", "parameters uncertain")
# If the filter finds at least MANY_CHANGES changes of the stiffness in a log, and their
# mean interval is below CHANGE_INTERVAL [s], a remark says that they are implausible.
# Road and tyres do not change so often, so probably a channel or the vehicle file is
# wrong.
MANY_CHANGES, CHANGE_INTERVAL = 3, 60.0
# A remark names a channel if the estimated sd of its noise is more than NOISY times the
# sd in the settings
NOISY = 1.25
# Reasons (columns *_reason of EST.csv) of the rows in which the filter does not check
# whether the channels agree
STILL = ("starting", "held", "input invalid", "row refused")
# [s] If the channels first contradict each other after more than this driving time, a
# channel has failed during the drive, and only the implausible rows are not valid. If
# they contradict each other earlier, a channel was wrong from the start, and no row is
# valid. describe_implausible() has the exceptions.
AGREED = 20.0
# The channels of a whole log contradict each other only if the rows with the reason
# "implausible" are more than this share of the driven rows. Driven rows are the rows
# without a reason of STILL. describe_implausible() has the further conditions.
MIN_IMPLAUSIBLE = 0.5
# [s] A stiffness counts as valid at the end of the log if its last valid row is at most
# this time before the end
RECENT = 1.0
# A message says that the interval of a stiffness is wide because of uncertain parameters
# of the car. Condition: they cause more than UNCERTAIN_SHARE of the variance of the
# stiffness, and an sd of more than MIN_UNCERTAIN times the stiffness
UNCERTAIN_SHARE = 0.5
MIN_UNCERTAIN = 0.02
# Max plausible |lag_steer - prior mean| / prior sd (steer_lag_sd). lag_steer is the
# estimated time from the logged steering angle to its effect in the IMU, after correction
# by the latencies of the vehicle file. Beyond the max, these latencies do not apply to
# the log, probably because it has a different logger or steering signal.
UNLIKELY = 3.0
# A stiffness counts as valid on a log or stretch if at least this share of its rows is
# valid
MIN_VALID = 0.005
DEG_PER_RAD = 180 / np.pi  # [deg/rad]


@dataclass(frozen=True)
class Verdict:
    """The verdict on one stiffness. Values are in `unit`; NaN: no value."""

    key: str
    name: str
    # "none": the share of valid rows is below MIN_VALID, or the reason is CONTRADICTED.
    # "good": at least 30 % of the rows are valid, and the last row of a whole log has no
    # reason of AT_FAULT. "partly": all other cases
    level: str
    unit: str
    # Estimate in the last valid row of the log or stretch, with exceptions for particle
    # filters and for too few valid rows (_make_verdict())
    value: float
    band: float  # half of the 95 % interval
    # Sd of the random change of the stiffness from sample to sample, divided by `value`.
    # Only particle filters estimate it. NaN if less than half of the valid rows have an
    # estimate, or if the share of valid rows is below MIN_VALID
    spread: float
    nominal: float  # value in the vehicle file
    valid: float  # share of the rows that are valid
    reason: str  # most frequent reason of the rows that are not valid; "" if all are valid
    reason_share: float  # number of rows with this reason / number of all rows
    text: str
    smoothed: float = float("nan")  # smoothed stiffness over the stretch or log (smooth.py)
    smoothed_band: float = float("nan")  # half of the 95 % interval of `smoothed`
    # "valid", or the reason why `smoothed` is not valid; empty if there is no smoothed
    # value
    smoothed_reason: str = ""

    @property
    def low(self) -> float:
        return self.value - self.band

    @property
    def high(self) -> float:
        return self.value + self.band

    @property
    def detail(self) -> str:
        """The part of `text` after the value."""
        return self.text.split(" (95 %), ", 1)[-1]


@dataclass(frozen=True)
class Quantity:
    """The verdict on grip or sideslip. Values are in `unit`."""

    key: str
    name: str
    unit: str
    value: float
    band: float  # half of the 95 % interval
    valid: float  # share of the rows that are valid; NaN for the sideslip, which has no validity
    reason: str  # the most frequent reason of the rows that are not valid
    time: float  # [s] time to which the value refers
    text: str

    @property
    def shown(self) -> str:
        """The value and its 95 % interval, as a string."""
        return f"{self.value:.2f} ± {max(self.band, 0.005):.2f}"

    def line(self) -> str:
        unit = f" {self.unit}" if self.unit != "1" else ""
        return f"{self.name}: {self.shown}{unit} (95 %), {self.text}"


def make_verdicts(
    table: pd.DataFrame, config: Config, whole: bool = True, parts: Mapping[str, float] | None = None
) -> list[Verdict]:
    """Return the verdict on each stiffness. `whole` is True if the table is the whole
    log, False if it is one stretch of road.

    `parts` has, for each stiffness, the relative variance that smoothing does not reduce,
    from smooth.compute_fixed_parts(). If it is None or empty, the verdicts have no
    smoothed values."""
    found = [_make_verdict(table, config, key, whole) for key in STIFFNESS]
    return [
        _add_smoothed(v, table, config, parts[v.key], "the log" if whole else "the stretch") if parts else v
        for v in found
    ]


def _add_smoothed(v: Verdict, rows: pd.DataFrame, config: Config, part: float, of: str) -> Verdict:
    """Return the verdict with the smoothed value added to members and text.

    The smoothed value is valid if the share of valid rows is at least MIN_VALID and the
    relative sd of the smoothed value is at most the setting valid_sd. `part` is the
    relative variance that smoothing does not reduce, from compute_fixed_parts(). `of` is
    "the log" or "the stretch"."""
    value, sd = smooth_stretch(rows, v.key, config, part)
    if not value > 0:
        return v
    if sd > config.valid_sd * value:
        limited = rows[f"{v.key}_reason"].value_counts().reindex(LIMITED, fill_value=0)
        reason = str(limited.idxmax()) if limited.any() or not v.reason else v.reason
    else:
        reason = "valid" if v.level != "none" else v.reason
    value, band, act = (
        value / 1000,
        1.96 * sd / 1000,
        "valid" if reason == "valid" else f"not valid: {reason}",
    )
    text = f"{v.text}; smoothed over {of} {value:.0f} ± {max(band, 0.5):.0f}, {act}"
    return replace(v, text=text, smoothed=value, smoothed_band=band, smoothed_reason=reason)


@dataclass(frozen=True)
class Finding:
    """The verdicts on one stretch of road, or on the whole log if `stretch` is None.
    `others` are the verdicts on grip and sideslip."""

    stretch: Stretch | None
    verdicts: list[Verdict]
    others: Sequence[Quantity] = ()

    @property
    def title(self) -> str:
        return f"From {self.stretch.title}" if self.stretch else ""

    @property
    def nothing(self) -> str:
        """The reason why no stiffness is valid. Empty if at least one is valid."""
        if any(v.level != "none" for v in self.verdicts):
            return ""
        reasons = dict.fromkeys(v.reason for v in self.verdicts if v.reason)
        return "no stiffness is valid" + (f", mostly {' or '.join(reasons)}" if reasons else "")

    def lines(self) -> list[str]:
        """Return the verdicts as lines for the terminal."""
        found = [*(f"{v.name}: {v.text}" for v in self.verdicts), *(q.line() for q in self.others)]
        if not self.stretch:
            return found
        return [f"{self.title}:{' ' if self.nothing else ''}{self.nothing}", *(f"  {line}" for line in found)]


def make_findings(
    table: pd.DataFrame,
    config: Config,
    found: Sequence[Change],
    contradictions: Sequence[str] = (),
    uncertainty_sd: Mapping[str, np.ndarray] | None = None,
) -> list[Finding]:
    """Return a finding for each stretch of road between changes; one for the whole log if
    nothing changed.

    Stretches are judged separately, because a mean over two roads describes neither. The
    default filter's value at the end of a stretch uses all rows of the stretch. So it is
    reported even if no row is valid, next to the smoothed value.

    `uncertainty_sd`: result of Filter.uncertainty_sd() after the last row.
    `contradictions`: warnings that channels contradict each other or the vehicle file. If
    there is one, no stiffness is valid: to the filter, a channel that is wrong all the
    time looks like a different car."""
    if contradictions:
        return [Finding(None, [_mark_contradicted(v) for v in make_verdicts(table, config)])]
    pieces, parts = find_stretches(table, found), compute_fixed_parts(table, config, uncertainty_sd or {})
    if len(pieces) < 2:
        return [
            Finding(None, make_verdicts(table, config, parts=parts), list_other_quantities(table, config))
        ]
    each = [(s, table.iloc[s.rows]) for s in pieces]
    return [
        Finding(s, make_verdicts(rows, config, False, parts), list_other_quantities(rows, config))
        for s, rows in each
    ]


def describe_implausible(table: pd.DataFrame) -> str:
    """Return a sentence if the channels contradict each other in the log as a whole, ""
    if they do not.

    They do if more than the share MIN_IMPLAUSIBLE of the driven rows (rows without a
    reason of STILL) is implausible, and the last driven row is implausible, too: a wrong
    unit, sign or axle persists to the end. Not all driven rows are implausible even then,
    because the filter needs some bends, accelerations and decelerations before it marks
    rows (src/filter/plausible.c).

    Exception: a channel failed during the drive. This is assumed if the first implausible
    row comes after the driving time AGREED, the channel is not a wheel speed, and the
    error is not a constant factor. Then only the implausible rows are not valid, and ""
    is returned."""
    reasons = [table[f"{key}_reason"] for key in STIFFNESS]
    drives = ~np.any([r.isin(STILL) for r in reasons], axis=0)
    against = np.flatnonzero(drives & np.any([r == "implausible" for r in reasons], axis=0))
    if (
        not drives.any()
        or len(against) <= MIN_IMPLAUSIBLE * drives.sum()
        or against[-1] != np.flatnonzero(drives)[-1]
    ):
        return ""
    share, last = format_percent(len(against) / float(drives.sum())), table.iloc[against[-1]]
    wheels = find_channel_name(int(last["fault_channel"])).startswith("wheel_speed")
    if not wheels and last["fault_factor"] == 0 and _sum_driven(table, drives)[against[0]] > AGREED:
        return ""
    return (
        f"check units, signs and axles: the channels contradict each other in {share} of the rows that "
        f"drive: {_name_contradiction(last)}"
    )


def _name_contradiction(row: pd.Series) -> str:
    """Return a description of the contradiction that an implausible row reports."""
    channel, factor = find_channel_name(int(row["fault_channel"])), float(row["fault_factor"])
    wheels = channel.startswith("wheel_speed")
    if wheels and factor == 0:
        return "front and rear wheel speeds seem to be exchanged, or driven_axle names the wrong axle"
    if factor == 0:
        return f"{channel} does not agree with the other channels"
    if factor < 0:
        return f"{channel} seems to have the other sign (factor {factor:.3g}, about 1 is expected)"
    named = "the wheel speeds seem" if wheels else f"{channel} seems"
    also = f", or the time steps {factor:.3g} times the true steps" if channel == "accel_x" else ""
    return f"{named} to be {factor:.3g} times the true value{also}"


def list_contradictions(table: pd.DataFrame) -> list[str]:
    """Return a list with a single sentence. It says how often the channels contradict
    each other, and describes the first such interval. The list is empty if the channels
    never contradict each other."""
    rows = np.any([table[f"{key}_reason"] == "implausible" for key in STIFFNESS], axis=0)
    time, said = estimate_times(table), []
    for first, after in find_spans(time, rows):
        last = table.iloc[np.flatnonzero(rows[first:after])[-1] + first]
        said.append(
            f"from {time[first]:.1f} to {time[after - 1]:.1f} s: {_name_contradiction(last)}: not valid there"
        )
    if not said:
        return []
    often = "" if len(said) == 1 else f"{len(said)} times, first "
    return [f"the channels contradict each other {often}{said[0]}"]


def _sum_driven(table: pd.DataFrame, drives: np.ndarray) -> np.ndarray:
    """Return the driving time [s] from the start of the log to each row. `drives` is True
    for driven rows: rows without a reason of STILL."""
    return np.cumsum(np.diff(table["time"].to_numpy(float), prepend=float(table["time"].iloc[0])) * drives)


def _mark_contradicted(v: Verdict) -> Verdict:
    """Return the verdict with the value removed and the reason CONTRADICTED."""
    nan = float("nan")
    text = f"{CONTRADICTED}: {WHY[CONTRADICTED]}"
    return replace(
        v,
        level="none",
        value=nan,
        band=nan,
        spread=nan,
        reason=CONTRADICTED,
        reason_share=1.0,
        text=text,
        smoothed_reason=CONTRADICTED,
    )


def list_remarks(table: pd.DataFrame) -> list[str]:
    """Return sentences about the sensors: channels that are noisier than their settings,
    implausibly many changes of road or tyres, and faults."""
    found = []
    learnt = table["status"].between(0, library().status("TSE_W_MISSING_CHANNEL"))
    for channel in MEASURES:
        ratio = float(table.loc[learnt, f"noise_{channel}"].median()) if learnt.any() else 1.0
        if ratio > NOISY:
            found.append(f"{channel}: the estimated noise sd is {ratio:.1f} times its setting")
    off = np.any([table[f"{key}_reason"] == "sensor fault" for key in STIFFNESS], axis=0)
    if "p_fault" in table:  # at standstill the reason is "held", even if a fault persists
        off |= table["p_fault"].to_numpy() >= MIN_EVENT_PROBABILITY
    changes = regimes.find_changes(table)
    if len(changes) >= MANY_CHANGES and len(changes) * CHANGE_INTERVAL > (
        seconds := float(table["time"].iloc[-1] - table["time"].iloc[0])
    ):
        found.append(
            f"{len(changes)} changes of road or tyres in {seconds:.0f} s are implausibly many. More "
            "probably a channel or the vehicle file is wrong: check latencies, offsets, the steering "
            "ratio and whether the file describes this car"
        )
    times = len(find_spans(estimate_times(table), off))
    if times:
        often = "once" if times == 1 else f"{times} times"
        found.append(
            f"a sensor was probably at fault {often}, in {format_percent(float(off.mean()))} of the log: not "
            "valid there"
        )
    return found


def check_steering_lag(table: pd.DataFrame, config: Config) -> list[str]:
    """Return a list with one sentence if lag_steer differs from its prior mean by more
    than UNLIKELY prior sds. Otherwise return an empty list.

    lag_steer is the estimated time from the logged steering angle to its effect in the
    IMU, after correction by the latencies of the vehicle file. Its prior mean is the sum
    of steering delay and IMU delay in the vehicle file. If the angle is logged later than
    the file states, this time is shorter, so lag_steer is below its prior mean."""
    sd = config.steer_lag_sd
    if "lag_steer" not in table or not len(table) or not sd > 0:
        return []
    expected = config.steering_delay_time + config.imu_delay_time
    off = float(table["lag_steer"].iloc[-1]) - expected
    if abs(off) <= UNLIKELY * sd:
        return []
    return [
        f"steer_angle is logged {abs(off) * 1e3:.0f} ms {'later' if off < 0 else 'earlier'} than the vehicle "
        f"file states (sd {sd * 1e3:.0f} ms): is the logger or the signal a different one? The estimated "
        "stiffness is therefore wrong: calibrate again"
    ]


def list_uncertain_parameters(
    table: pd.DataFrame, config: Config, uncertainty_sd: Mapping[str, np.ndarray]
) -> list[str]:
    """Return a sentence for each stiffness whose interval is caused mostly by uncertain
    parameters of the car. The sentence names the three parameters that contribute most.

    `uncertainty_sd` has for each parameter the sd that it causes in each stiffness, as a
    ratio to the nominal stiffness."""
    found = []
    for a, key in enumerate(STIFFNESS):
        last = table[[key, f"{key}_sd"]].iloc[-1] / getattr(config, NOMINAL[key]) if len(table) else None
        parts = {name: float(sd[a]) for name, sd in uncertainty_sd.items()}
        whole = np.sqrt(sum(sd**2 for sd in parts.values()))
        if (
            last is None
            or not whole**2 > UNCERTAIN_SHARE * float(last.iloc[1]) ** 2
            or not whole > MIN_UNCERTAIN * float(last.iloc[0])
        ):
            continue
        most = sorted(parts, key=parts.__getitem__, reverse=True)[:3]
        mean, sd = (float(x) for x in last)
        names = ", ".join(f"{name} {format_percent(1.96 * parts[name] / mean)}" for name in most)
        half = format_percent(1.96 * sd / mean)
        found.append(
            f"{NAMES[key].lower()}: most of its 95 % interval at the end, ± {half}, is parameter uncertainty"
            f": {names} (enter better values in [uncertainty]; a calibration finds all but mass_sd)"
        )
    return found


def _make_verdict(table: pd.DataFrame, config: Config, key: str, whole: bool = True) -> Verdict:
    """Return the verdict on one stiffness.

    The value is the estimate in the last valid row. If the share of valid rows is below
    MIN_VALID, the value is the estimate in the last row that was not refused.

    A particle filter gives a row less weight the older it is, so its estimate in a single
    row does not represent the log. With a particle filter, the value for a whole log is
    therefore the median over the valid rows. But if the stiffness changed between the
    first and the last valid row, a median would mix the old and the new stiffness. Then
    the value is again the estimate in the last valid row."""
    of = "the log" if whole else "the stretch"
    valid = table[f"{key}_valid"].to_numpy() == 1
    share = float(valid.mean()) if len(valid) else 0.0
    nominal, unit, name = getattr(config, NOMINAL[key]) / 1000, UNITS[key], NAMES[key]
    reason, reason_share = _find_commonest(table, key, valid)
    known = share >= MIN_VALID
    rows = valid if known else _is_used(table)
    mean, sd = (table.loc[rows, c].to_numpy(float) / 1000 for c in (key, f"{key}_sd"))
    if not len(mean):
        nan, why = float("nan"), _explain_reason(reason, key)
        text = f"no value: {reason or 'no rows'}{f', {why}' if why else ''}"
        return Verdict(key, name, "none", unit, nan, nan, nan, nominal, share, reason, reason_share, text)
    changed = known and abs(mean[-1] - mean[0]) > 3 * 1.96 * sd[0]
    medians = whole and config.form and known and not changed
    at = (lambda x: float(np.median(x))) if medians else (lambda x: float(x[-1]))
    value, band = at(mean), 1.96 * at(sd)
    parts = [f"{value:.0f} {unit} ± {max(band, 0.5):.0f} (95 %)"]
    if known:
        parts[0] += f", valid {format_percent(share)} of the time"
    else:
        limit = (
            f", its sd {format_percent(band / 1.96 / value)}, limit {format_percent(config.valid_sd)}"
            if reason in LIMITED
            else ""
        )
        why = _explain_reason(reason, key)
        parts[0] += f", not valid: {reason}{limit}{f': {why}' if why else ''}"
    relative = value / nominal - 1
    parts.append(
        f"{100 * abs(relative):.0f} % {'above' if relative > 0 else 'below'} nominal"
        if abs(relative) >= 0.02
        else "as nominal"
    )
    if changed:
        parts.append(f"it changed during {of}, from {mean[0]:.0f} to {mean[-1]:.0f}")
    if known and not medians and (end := _find_last_valid(estimate_times(table), valid)) is not None:
        parts.append(f"last valid at {end:.1f} s")
    if known and reason and share < 0.8:
        why = _explain_reason(reason, key)
        parts.append(f"otherwise mostly {reason}{f': {why}' if why else ''}")
    spread = float("nan")
    if known and table.loc[valid, f"{key}_spread_seen"].mean() >= 0.5:
        spread = float(np.median(table.loc[valid, f"{key}_spread"].to_numpy() / 1000) / value)
        parts.append(f"spread {100 * spread:.0f} % from sample to sample")
    ends = table[f"{key}_reason"].to_numpy(object)[-1] in AT_FAULT if len(table) else False
    level = "none" if not known else "good" if share >= 0.3 and not (whole and ends) else "partly"
    return Verdict(
        key, name, level, unit, value, band, spread, nominal, share, reason, reason_share, "; ".join(parts)
    )


def _explain_reason(reason: str, key: str) -> str:
    """Return the explanation of a reason; an empty string if it needs none."""
    return TOO_QUIET[key] if reason in ("not excited", "uncertain") else WHY.get(reason, "")


def _find_commonest(table: pd.DataFrame, key: str, valid: np.ndarray) -> tuple[str, float]:
    """Return the most frequent reason of the rows that are not valid, and the share of
    all rows that have this reason."""
    others = table.loc[~valid, f"{key}_reason"].value_counts()  # includes categories with count 0
    others = others[others > 0]
    return (str(others.index[0]), float(others.iloc[0] / len(valid))) if len(others) else ("", 0.0)


def _is_used(table: pd.DataFrame) -> np.ndarray:
    """Return a mask that is True for used rows and False for refused rows."""
    return table["status"].to_numpy() >= 0


def _find_last_valid(time: np.ndarray, valid: np.ndarray) -> float | None:
    """Return the time [s] of the last valid row. Return None if this row is at most
    RECENT before the end, so that the stiffness counts as valid at the end."""
    last = float(time[np.flatnonzero(valid)[-1]])
    return last if time[-1] - last > RECENT else None


def list_other_quantities(table: pd.DataFrame, config: Config) -> list[Quantity]:
    """Return the verdicts on the grip, if it is estimated, and on the largest sideslip
    angle. Particle filters have neither."""
    if config.form or f"{GRIP}_sd" not in table:
        return []
    return [q for q in (_find_grip(table, config), _find_largest_sideslip(table)) if q is not None]


def _find_grip(table: pd.DataFrame, config: Config) -> Quantity | None:
    """Return the verdict on the grip: the estimate in the last valid row, or in the last
    used row if no row is valid. Return None if the grip is not estimated (grip_sd is 0),
    or if all rows were refused."""
    valid = table[f"{GRIP}_valid"].to_numpy() == 1
    rows = np.flatnonzero(valid if valid.any() else _is_used(table))
    if not config.grip_sd > 0 or not len(rows):
        return None
    share, (reason, _) = float(valid.mean()), _find_commonest(table, GRIP, valid)
    at = int(rows[-1])
    value, sd = (float(table[c].iloc[at]) for c in (GRIP, f"{GRIP}_sd"))
    why = _explain_reason(reason, GRIP)
    text = (
        f"valid {format_percent(share)} of the time"
        if share > 0
        else f"not valid: {reason}{f', {why}' if why else ''}"
    )
    return Quantity(
        GRIP, "Grip", "1", value, 1.96 * sd, share, reason, float(estimate_times(table)[at]), text
    )


def _find_largest_sideslip(table: pd.DataFrame) -> Quantity | None:
    """Return the verdict on the largest sideslip angle: the one whose 95 % interval is
    farthest from 0. Rows without an estimate of the motion of the car are not used."""
    rows = np.flatnonzero(table["status"].between(0, library().status("TSE_W_MISSING_CHANNEL")).to_numpy())
    if not len(rows):
        return None
    angle, sd = (DEG_PER_RAD * table[c].to_numpy(float)[rows] for c in ("sideslip", "sideslip_sd"))
    at = int(np.argmax(np.abs(angle) - 1.96 * sd))
    time = float(estimate_times(table)[rows[at]])
    text = f"the largest, at {time:.1f} s; median interval ± {max(1.96 * float(np.median(sd)), 0.005):.2f}"
    return Quantity(
        "sideslip",
        "Sideslip angle",
        "deg",
        float(angle[at]),
        1.96 * float(sd[at]),
        float("nan"),
        "",
        time,
        text,
    )
