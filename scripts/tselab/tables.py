"""The library's tables as text for people."""

from __future__ import annotations

from collections.abc import Iterable

from tselab.core import CONFIG, REASON, SIM_CONFIG, STATUS, STIFFNESS, Field, library
from tselab.estimate import est_columns, est_fields
from tselab.vehicle import latency_settings, sensor_settings, uncertainty_settings, vehicle_settings


def text_table(rows: Iterable[Iterable[str]], right: tuple[int, ...] = ()) -> str:
    """Columns padded to their widest cell; those in `right` are right-aligned."""
    rows = [list(r) for r in rows]
    widths = [max(len(r[i]) for r in rows) for i in range(len(rows[0]))]
    lines = []
    for r in rows:
        cells = (c.rjust(w) if i in right else c.ljust(w) for i, (c, w) in enumerate(zip(r, widths, strict=True)))
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)


def settings_table(which: int = CONFIG) -> str:
    """All settings: name, default, range, unit, meaning."""
    rows = [["setting", "default", "range", "unit", "meaning"]]
    rows += [[f.name, f"{f.default:.6g}", f"{f.low:g} .. {f.high:g}", f.unit, f.text] for f in library().fields(which)]
    return text_table(rows, right=(1,))


def log_columns_table() -> str:
    rows = [["time", "s", "increasing", "time of the row"]]
    rows += [[f.name, f.unit, f"{f.low:g} .. {f.high:g}", f.text] for f in library().channels]
    return text_table(rows)


def est_columns_table() -> str:
    rows = {f"{s}_reason": [f"{s}_reason", "", "valid, or in words why not"] for s in STIFFNESS}
    for f in est_fields():
        rows[f.name] = [f.name, _si(f), "1 valid, 0 not" if f.name.endswith("_valid") else f.text]
    return text_table(rows[name] for name in est_columns() if name != "time")


def codes_table() -> str:
    lines = [f"{code:3d}  {f.text}" for code, f in sorted(library().codes(STATUS).items()) if code >= 0]
    reasons = [f"{f.name}: {f.text}" for f in library().fields(REASON)]
    return "status\n" + "\n".join(lines) + "\n\nreason\n  " + "\n  ".join(reasons)


def sim_settings_table() -> str:
    return settings_table(SIM_CONFIG)


def example_vehicle() -> str:
    """A commented vehicle file of the default car."""
    fields = {f.name: f for f in library().fields(CONFIG)}
    lines = [
        "# A vehicle for tselab: the built-in car. SI units; stiffness per axle (both wheels).",
        "# Required: mass, lf, lr, wheel_radius_front, wheel_radius_rear. What else is left out is filled in by a rule,",
        "# and the run says so.",
        'name = "mid-size car"',
        f"wheelbase = {fields['lf'].default + fields['lr'].default:g}  # m, checked against lf + lr",
        'driven_axle = "front"  # front, rear or both; used by tselab simulate',
        "# steering_ratio = 16.0  # only for hints: steer_angle in the log is the road-wheel angle",
        "",
        *(_toml_line(fields[name]) for name in vehicle_settings()),
        "",
        "# How uncertain that is: sd of each, 0 for what is known exactly, as here.",
        "# Left out: as of a car that nobody has calibrated.",
        "[uncertainty]",
        *(_toml_line(fields[name]) for name in uncertainty_settings()),
        "",
        "[sensors]",
        *(_toml_line(fields[name]) for name in sensor_settings()),
        "",
        "# How much later than the gyro each channel is logged, as far as it is known; negative: earlier.",
        "[latency]",
        *(_toml_line(fields[name], key) for key, name in latency_settings().items()),
        "",
        "# What the single-track model leaves out, as far as it is known of this car: [effects.<id>] with the parameters of",
        "# include/tse/effects.def ('tselab settings' has them as <id>_<parameter>). Left out: none.",
        "# [effects.body_roll]",
        "# gain = 0.008  # rad s2/m",
    ]
    return "\n".join(lines) + "\n"


def _toml_line(f: Field, key: str = "") -> str:
    value = repr(float(f.default))
    return f"{key or f.name} = {value}  # {f.unit}, {f.low:g} .. {f.high:g}: {f.text}"


def _si(f: Field) -> str:
    """Unit in EST.csv, where stiffness is absolute."""
    if f.name.startswith("cx_") and f.unit == "1":
        return "N"
    return "N/rad" if f.name.startswith("cy_") and f.unit == "1" else f.unit
