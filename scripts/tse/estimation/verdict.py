"""The verdict on each stiffness, in one plain sentence for terminal and report."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from tse.estimation import regimes
from tse.estimation.regimes import (
    LIKELY,
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
TOO_QUIET = {
    "cx_front": "driving and braking were too weak or too steady",
    "cy_front": "too little steering excitation",
    "cy_rear": "too little steering excitation",
    GRIP: "the tyres were not driven near their limit",
}
CONTRADICTED = "contradicted"  # the reason of a log, not of a row
WHY = {
    "starting": "too little was seen since the start",
    "sensor fault": "a sensor was probably at fault",
    "held": "standstill, low speed, reverse, large steering angle or sliding wheels",
    "input invalid": "inputs or measurements were missing",
    "parameters uncertain": "too uncertain parameters of the car: calibrate, or state what is known "
    "better in [uncertainty]",
    "does not fit": "the sensors read what the model does not explain: calibrate, or look for what is "
    "missing (tselab gap)",
    "implausible": "the channels contradict each other: a wrong unit, sign or axle (fault_channel, "
    "fault_factor)",
    "row refused": "the rows were refused",
    CONTRADICTED: "channels or vehicle file are wrong (see the warning); with that put right the log may "
    "show it",
}
# Reasons of the last row by which a stiffness is not valid to the end of the log.
AT_FAULT = ("sensor fault", "implausible")
LIMITED = ("uncertain", "parameters uncertain")  # reasons beside which sd and limit are given
# Changes, and s from one to the next: so many, so near to each other, mean a wrong model.
MANY_CHANGES, CHANGE_INTERVAL = 3, 60.0
NOISY = 1.25  # min ratio of estimated noise over its setting that is reported
# Reasons of rows that show nothing of the agreement of the channels.
STILL = ("starting", "held", "input invalid", "row refused")
AGREED = 20.0  # s of driving without contradiction, after which a channel failed late
MIN_IMPLAUSIBLE = 0.5  # min share of the driven rows that makes a log implausible
RECENT = 1.0  # s: valid within this time before the end counts as valid at the end
# Min share of the variance from which an interval is attributed to uncertain parameters
# ...
UNCERTAIN_SHARE = 0.5
MIN_UNCERTAIN = 0.02  # ... and min sd, relative
# Prior sd: a larger difference in the lag of the steering angle means another logger. No
# cornering stiffness is valid then.
UNLIKELY = 3.0
MIN_VALID = 0.005  # share of valid rows: a stiffness with fewer is not valid
DEGREE = 180 / np.pi


@dataclass(frozen=True)
class Verdict:
    """The verdict on one stiffness. Values in `unit`; NaN: no value."""

    key: str
    name: str
    level: str  # good, partly, none
    unit: str
    # At the end of the stretch; of a particle filter the median of the valid rows
    value: float
    band: float  # half of the 95 % interval
    spread: float  # sample to sample, share of the mean; NaN: not observed, or not estimated by this filter
    nominal: float
    valid: float  # share of the rows
    reason: str  # the commonest reason for not being valid
    reason_share: float
    text: str
    smoothed: float = float("nan")  # over the stretch (smooth.py)
    smoothed_band: float = float("nan")  # half of its 95 % interval
    smoothed_reason: str = ""  # "valid", or the reason why not; empty: not smoothed

    @property
    def low(self) -> float:
        return self.value - self.band

    @property
    def high(self) -> float:
        return self.value + self.band

    @property
    def detail(self) -> str:
        """The text without the value at its begin."""
        return self.text.split(" (95 %), ", 1)[-1]


@dataclass(frozen=True)
class Quantity:
    """The verdict on grip or sideslip. Values in `unit`."""

    key: str
    name: str
    unit: str
    value: float
    band: float  # half of the 95 % interval
    valid: float  # share of the rows; NaN: not judged
    reason: str  # the commonest reason for not being valid
    time: float  # s, of the value
    text: str

    @property
    def shown(self) -> str:
        """Value and 95 % interval."""
        return f"{self.value:.2f} ± {max(self.band, 0.005):.2f}"

    def line(self) -> str:
        unit = f" {self.unit}" if self.unit != "1" else ""
        return f"{self.name}: {self.shown}{unit} (95 %), {self.text}"


def make_verdicts(
    table: pd.DataFrame, config: Config, whole: bool = True, parts: Mapping[str, float] | None = None
) -> list[Verdict]:
    """Return the verdict on each stiffness, of the whole log or of a stretch.

    `parts`: smooth.compute_fixed_parts(); with it the smoothed values are added."""
    found = [_make_verdict(table, config, key, whole) for key in STIFFNESS]
    return [
        _add_smoothed(v, table, config, parts[v.key], "the log" if whole else "the stretch") if parts else v
        for v in found
    ]


def _add_smoothed(v: Verdict, rows: pd.DataFrame, config: Config, part: float, of: str) -> Verdict:
    """Add the smoothed value. It is valid if rows are valid and its sd is within
    valid_sd."""
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
    """Verdicts on a stretch of road; without a stretch on the whole log. `others`: grip,
    sideslip."""

    stretch: Stretch | None
    verdicts: list[Verdict]
    others: Sequence[Quantity] = ()

    @property
    def title(self) -> str:
        return f"From {self.stretch.title}" if self.stretch else ""

    @property
    def nothing(self) -> str:
        """Reason why no stiffness is valid; empty if one is."""
        if any(v.level != "none" for v in self.verdicts):
            return ""
        reasons = dict.fromkeys(v.reason for v in self.verdicts if v.reason)
        return "no stiffness is valid" + (f", mostly {' or '.join(reasons)}" if reasons else "")

    def lines(self) -> list[str]:
        """Return the lines for the terminal."""
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
    """Return the verdicts on each stretch of road between changes; one finding on the
    whole log if nothing changed.

    A mean over two roads is true of neither. On a stretch the filter does not forget, so
    its value at the end is its best one. It is given with its interval then, also where
    no row is valid, and beside it the smoothed value over the stretch.

    `uncertainty_sd`: Filter.uncertainty_sd() at the end. `contradictions`: sentences of
    check_car(). The filter cannot distinguish a permanently wrong channel from a
    different car, so no stiffness of such a log is valid."""
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
    """Return the contradiction of the channels that the filter finds, in words; empty if
    most driven rows and the last one are not implausible.

    The check of a row (src/filter/plausible.c) begins after some bends, gains and losses
    of speed. A wrong unit, sign or axle lasts. A channel that fails late contradicts
    fewer rows, or has no constant factor: it costs these rows only, and the rows before
    stay valid."""
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
    """Return the contradiction of an implausible row, in words."""
    channel, factor = find_channel_name(int(row["fault_channel"])), float(row["fault_factor"])
    wheels = channel.startswith("wheel_speed")
    if wheels and factor == 0:
        return "front and rear wheel speeds seem to be exchanged, or driven_axle names the other axle"
    if factor == 0:
        return f"{channel} does not go with the others"
    if factor < 0:
        return f"{channel} seems to have the other sign (factor {factor:.3g}, about 1 is expected)"
    named = "the wheel speeds seem" if wheels else f"{channel} seems"
    also = f", or the steps of time {factor:.3g} times" if channel == "accel_x" else ""
    return f"{named} to be {factor:.3g} times the true value{also}"


def list_contradictions(table: pd.DataFrame) -> list[str]:
    """Return where the channels contradict each other in part of a log, in words."""
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
    """Return the time that the car has driven up to each row, s."""
    return np.cumsum(np.diff(table["time"].to_numpy(float), prepend=float(table["time"].iloc[0])) * drives)


def _mark_contradicted(v: Verdict) -> Verdict:
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
    """Return what the filter has found about the sensors, in words."""
    found = []
    learnt = table["status"].between(0, library().status("TSE_W_MISSING_CHANNEL"))
    for channel in MEASURES:
        ratio = float(table.loc[learnt, f"noise_{channel}"].median()) if learnt.any() else 1.0
        if ratio > NOISY:
            found.append(f"{channel} is noisier than the settings say: x{ratio:.1f}")
    off = np.any([table[f"{key}_reason"] == "sensor fault" for key in STIFFNESS], axis=0)
    if "p_fault" in table:  # of a standing car the reason is "held", although the fault lasts
        off |= table["p_fault"].to_numpy() >= LIKELY
    changes = regimes.find_changes(table)
    if len(changes) >= MANY_CHANGES and len(changes) * CHANGE_INTERVAL > (
        seconds := float(table["time"].iloc[-1] - table["time"].iloc[0])
    ):
        found.append(
            f"{len(changes)} changes of road or tyres in {seconds:.0f} s are more than roads have: rather "
            "a channel or the vehicle "
            "file is wrong (latency, offset, steering ratio, another car)"
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
    """Return a sentence if the lag of the steering angle contradicts the vehicle file."""
    sd = config.steer_lag_sd
    if "lag_steer" not in table or not len(table) or not sd > 0:
        return []
    off = float(table["lag_steer"].iloc[-1])
    if abs(off) <= UNLIKELY * sd:
        return []
    return [
        f"steer_angle comes {abs(off) * 1e3:.0f} ms {'later' if off < 0 else 'earlier'} than the vehicle "
        "file says, where an sd of "
        f"{sd * 1e3:.0f} ms was expected: another logger or signal? Stiffness is wrong by it: calibrate anew"
    ]


def list_uncertain_parameters(
    table: pd.DataFrame, config: Config, uncertainty_sd: Mapping[str, np.ndarray]
) -> list[str]:
    """Return a sentence for each interval that comes mostly from uncertain parameters,
    with the three largest."""
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
    """Return the verdict with the value of the last valid row, or of the last row if
    hardly any is valid.

    A particle filter forgets: if nothing changed, its values are medians over the valid
    rows of the whole log."""
    of = "the log" if whole else "the stretch"
    valid = table[f"{key}_valid"].to_numpy() == 1
    share = float(valid.mean()) if len(valid) else 0.0
    nominal, unit, name = getattr(config, NOMINAL[key]) / 1000, UNITS[key], NAMES[key]
    reason, reason_share = _find_commonest(table, key, valid)
    known = share >= MIN_VALID
    rows = valid if known else _is_used(table)
    mean, sd = (table.loc[rows, c].to_numpy(float) / 1000 for c in (key, f"{key}_sd"))
    if not len(mean):
        nan, why = float("nan"), _explain(reason, key)
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
        why = _explain(reason, key)
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
        why = _explain(reason, key)
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


def _explain(reason: str, key: str) -> str:
    """Return the reason in more words."""
    return TOO_QUIET[key] if reason in ("not excited", "uncertain") else WHY.get(reason, "")


def _find_commonest(table: pd.DataFrame, key: str, valid: np.ndarray) -> tuple[str, float]:
    """Return the commonest reason of the rows that are not valid, and its share of all
    rows."""
    others = table.loc[~valid, f"{key}_reason"].value_counts()  # counts unused categories, too
    others = others[others > 0]
    return (str(others.index[0]), float(others.iloc[0] / len(valid))) if len(others) else ("", 0.0)


def _is_used(table: pd.DataFrame) -> np.ndarray:
    """Return whether each row was used, not refused."""
    return table["status"].to_numpy() >= 0


def _find_last_valid(time: np.ndarray, valid: np.ndarray) -> float | None:
    """Return the time of the last valid row; None if it is within RECENT of the end."""
    last = float(time[np.flatnonzero(valid)[-1]])
    return last if time[-1] - last > RECENT else None


def list_other_quantities(table: pd.DataFrame, config: Config) -> list[Quantity]:
    """Return the verdicts on grip, if estimated, and on the largest sideslip angle."""
    if config.form or f"{GRIP}_sd" not in table:
        return []
    return [q for q in (_find_grip(table, config), _find_largest_sideslip(table)) if q is not None]


def _find_grip(table: pd.DataFrame, config: Config) -> Quantity | None:
    """Return the grip of the last valid row, or of the last row."""
    valid = table[f"{GRIP}_valid"].to_numpy() == 1
    rows = np.flatnonzero(valid if valid.any() else _is_used(table))
    if not config.grip_sd > 0 or not len(rows):
        return None
    share, (reason, _) = float(valid.mean()), _find_commonest(table, GRIP, valid)
    at = int(rows[-1])
    value, sd = (float(table[c].iloc[at]) for c in (GRIP, f"{GRIP}_sd"))
    why = _explain(reason, GRIP)
    text = (
        f"valid {format_percent(share)} of the time"
        if share > 0
        else f"not valid: {reason}{f', {why}' if why else ''}"
    )
    return Quantity(
        GRIP, "Grip", "1", value, 1.96 * sd, share, reason, float(estimate_times(table)[at]), text
    )


def _find_largest_sideslip(table: pd.DataFrame) -> Quantity | None:
    """Return the sideslip angle that exceeds its own interval by most, of rows with a
    valid motion."""
    rows = np.flatnonzero(table["status"].between(0, library().status("TSE_W_MISSING_CHANNEL")).to_numpy())
    if not len(rows):
        return None
    angle, sd = (DEGREE * table[c].to_numpy(float)[rows] for c in ("sideslip", "sideslip_sd"))
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
