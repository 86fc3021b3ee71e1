"""Format tables for the user as text: the settings of filter and simulator, the columns
of a log and of EST.csv (the estimates), the status codes. Make example vehicle files."""

import textwrap
from collections.abc import Iterable

from tse.car.vehicle import (
    REQUIRED,
    get_unknown_car,
    list_latency_settings,
    list_sensor_settings,
    list_uncertainty_settings,
    list_vehicle_settings,
)
from tse.estimation.estimate import list_est_columns, list_est_fields
from tse.library.core import CONFIG, GRIP, REASON, SIM_CONFIG, STATUS, STIFFNESS, Config, Field, library

MAX_TABLE_WIDTH = 108  # [characters] of a line of text; longer texts go on in the next line
MIN_TEXT = 40  # [characters] min width of the last column; a line may exceed MAX_TABLE_WIDTH for it


def text_table(rows: Iterable[Iterable[str]], right: tuple[int, ...] = ()) -> str:
    """Return a table as text, with each column padded to its widest cell. `right` has the
    indices of the columns that are aligned on the right. If a line would be longer than
    MAX_TABLE_WIDTH, the text in the last column goes on in the next line."""
    rows = [list(r) for r in rows]
    widths = [max(len(r[i]) for r in rows) for i in range(len(rows[0]))]
    lines = []
    for r in rows:
        cells = [
            c.rjust(w) if i in right else c.ljust(w) for i, (c, w) in enumerate(zip(r, widths, strict=True))
        ]
        first = "".join(f"{c}  " for c in cells[:-1])
        lines += _wrap_text(cells[-1].rstrip(), first)
    return "\n".join(lines)


def _wrap_text(text: str, first: str, then: str | None = None) -> list[str]:
    """Return `first` + `text`, wrapped to lines of MAX_TABLE_WIDTH. All lines after the
    first begin with `then`. None: with spaces, as many as `first` has characters."""
    width = max(MAX_TABLE_WIDTH, len(first) + MIN_TEXT)
    if len(first) + len(text) <= width:
        return [f"{first}{text}".rstrip()]
    return textwrap.wrap(
        text,
        width,
        initial_indent=first,
        subsequent_indent=" " * len(first) if then is None else then,
        break_long_words=False,
        break_on_hyphens=False,
    )


def format_markdown_table(head: Iterable[str], rows: Iterable[Iterable[str]], left: int = 1) -> list[str]:
    """Return the lines of a Markdown table. The first `left` columns are aligned on the
    left, the others on the right."""
    head = list(head)
    lines = ["|" + "|".join(f" {c} " if c else " " for c in cells) + "|" for cells in (head, *rows)]
    return [lines[0], "|" + "---|" * left + "---:|" * (len(head) - left), *lines[1:]]


def settings_table(which: int = CONFIG) -> str:
    """Return a table of all settings with name, default, range, unit and meaning. `which`
    is the struct of the library: CONFIG for the filter, SIM_CONFIG for the simulator."""
    rows = [["setting", "default", "range", "unit", "meaning"]]
    rows += [
        [f.name, f"{f.default:.6g}", f"{f.low:g} .. {f.high:g}", f.unit, f.text]
        for f in library().fields(which)
    ]
    return text_table(rows, right=(1,))


def list_log_columns() -> list[list[str]]:
    """Return name, unit, range and meaning of each column of a log."""
    rows = [["time", "s", "increasing", "time of the row"]]
    return rows + [[f.name, f.unit, f"{f.low:g} .. {f.high:g}", f.text] for f in library().channels]


def log_columns_table() -> str:
    """Return a table of the columns of a log: name, unit, range, meaning."""
    return text_table(list_log_columns())


def list_estimate_columns() -> list[list[str]]:
    """Return name, unit and meaning of each column of EST.csv, the table of estimates,
    except `time`."""
    rows = {f"{s}_reason": [f"{s}_reason", "", "valid, or why it is not valid"] for s in (*STIFFNESS, GRIP)}
    for f in list_est_fields():
        rows[f.name] = [f.name, _find_unit(f), "1 valid, 0 not" if f.name.endswith("_valid") else f.text]
    return [rows[name] for name in list_est_columns() if name != "time"]


def est_columns_table() -> str:
    """Return a table of the columns of EST.csv: name, unit, meaning."""
    return text_table(list_estimate_columns())


def codes_table() -> str:
    """Return as text, with explanations, the codes of the column status and the reasons
    why an estimate is not valid."""
    lines = ["status"]
    for code, f in sorted(library().codes(STATUS).items()):
        lines += _wrap_text(f.text, f"{code:3d}  ") if code >= 0 else []
    lines += ["", "reason"]
    for f in library().fields(REASON):
        lines += _wrap_text(f"{f.name}: {f.text}", "  ", "    ")
    return "\n".join(lines)


def sim_settings_table() -> str:
    """Return a table of all settings of the simulator."""
    return settings_table(SIM_CONFIG)


def example_vehicle() -> str:
    """Return an example of a vehicle file, with a comment on each key, for users to edit.

    The required keys have the values of the built-in car. All other keys are commented
    out, because their values do not hold for the user's car. For these keys, a run takes
    the values of an ordinary car, and sds that allow for their errors."""
    car = Config.exact()
    fields = car.fields
    required = [n for n in list_vehicle_settings() if n in REQUIRED]
    others = [n for n in list_vehicle_settings() if n not in REQUIRED]
    lines = [
        "# A vehicle for tselab, to edit. SI units; stiffness per axle (both wheels). Values: a mid-size "
        "car's.",
        'name = "my car"',
        *(_format_line(fields[name], getattr(car, name)) for name in required),
        "",
        "# All keys below are optional. Remove the # of a key to set it. For keys left out the run takes the",
        "# values of an ordinary car of this mass and these axle positions, and lists them.",
        f"# wheelbase = {fields['lf'].default + fields['lr'].default:g}  # m, checked against lf + lr",
        '# driven_axle = "front"  # front, rear or both; the filter assumes that the other axle rolls freely',
        "# steering_ratio = 16.0  # only for hints: steer_angle in the log is the road-wheel angle",
        *(_comment_out(_format_line(fields[name], getattr(car, name))) for name in others),
        "",
        "# Uncertainty of the values above: the sd of each. 0: known exactly. Left out: the values below, of",
        "# a car that has not been calibrated.",
        "# [uncertainty]",
        *(
            _comment_out(_format_line(fields[name], get_unknown_car()[name]))
            for name in list_uncertainty_settings()
        ),
        "",
        "# Noise and bias of the sensors. Left out: those of ordinary sensors, then estimated while driving.",
        "# [sensors]",
        *(_comment_out(_format_line(fields[name], getattr(car, name))) for name in list_sensor_settings()),
        "",
        "# Delay of each channel behind the gyro, as far as it is known. Negative: earlier than the gyro.",
        "# [latency]",
        *(
            _comment_out(_format_line(fields[name], getattr(car, name), key))
            for key, name in list_latency_settings().items()
        ),
        *_EFFECTS,
    ]
    return "\n".join(lines) + "\n"


def simulated_vehicle() -> str:
    """Return the vehicle file of the car that `tselab simulate` simulates. It states that
    all parameters are known exactly, so the file is only for simulated logs."""
    car = Config.exact()
    fields = car.fields
    lines = [
        "# The car of 'tselab simulate', whose parameters are known exactly. For a real car start from",
        "# 'tselab vehicle --example'.",
        "# SI units; stiffness per axle (both wheels).",
        'name = "mid-size car"',
        f"wheelbase = {fields['lf'].default + fields['lr'].default:g}  # m, checked against lf + lr",
        'driven_axle = "front"  # front, rear or both; used by tselab simulate',
        "",
        *(_format_line(fields[name], getattr(car, name)) for name in list_vehicle_settings()),
        "",
        "# Uncertainty of the values above: the sd of each. 0: known exactly, as here.",
        "[uncertainty]",
        *(_format_line(fields[name], getattr(car, name)) for name in list_uncertainty_settings()),
        "",
        "[sensors]",
        *(_format_line(fields[name], getattr(car, name)) for name in list_sensor_settings()),
        "",
        "[latency]",
        *(
            _format_line(fields[name], getattr(car, name), key)
            for key, name in list_latency_settings().items()
        ),
        *_EFFECTS,
    ]
    return "\n".join(lines) + "\n"


_EFFECTS = (
    "",
    "# Effects that the single-track model leaves out, if known of this car: [effects.<id>] with the",
    "# parameters of src/tables/effects.toml ('tselab settings' lists them as <id>_<parameter>).",
    "# Left out: no such effect.",
    "# [effects.body_roll]",
    "# gain = 0.008  # rad s2/m",
)


def _format_line(f: Field, value: float, key: str = "") -> str:
    """Return the line of a vehicle file that sets a key to `value`, with unit, range and
    meaning as a comment, which may go on in further lines. `key`: name of the key in the
    vehicle file; "": the name of the setting `f`."""
    # If 0 is outside the range, a vehicle file cannot set the key to 0. Then remove the
    # part of the text that says what 0 means.
    about = f.text.partition("; 0: ")[0] if f.low > 0 else f.text
    setting = f"{key or f.name} = {float(value)!r}  # "
    comment = f"{f.unit}, {f.low:g} .. {f.high:g}: {about}"
    return "\n".join(_wrap_text(comment, setting, "# ".rjust(len(setting))))


def _comment_out(lines: str) -> str:
    """Return lines of a vehicle file as comments."""
    return "\n".join(f"# {line}" for line in lines.split("\n"))


def _find_unit(f: Field) -> str:
    """Return the unit of an output in EST.csv. The library returns a stiffness as a ratio
    to the nominal value, but EST.csv has it in N or N/rad."""
    if f.name.startswith("cx_") and f.unit == "1":
        return "N"
    return "N/rad" if f.name.startswith("cy_") and f.unit == "1" else f.unit
