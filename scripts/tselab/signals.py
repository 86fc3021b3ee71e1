"""The command `tselab signals`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from tse.errors import Error
from tselab.options import DATABASE, FILE, JSON, OutputPath, print_json

if TYPE_CHECKING:
    from tse import Signals

# Signals that are proposed for a channel are always printed. Of the remaining signals, at
# most this many are printed. With --all, all signals are printed
MAX_LISTED_SIGNALS = 80


@click.command()
@click.argument("log_path", metavar="LOG", type=FILE)
@click.option(
    "--write",
    "out",
    metavar="SIGNALS.toml",
    type=OutputPath(".toml"),
    help="Write the proposal. A name without a folder is written to the folder of the log, where 'tselab "
    "estimate' looks for signals.toml.",
)
@click.option(
    "--vehicle",
    "vehicle_path",
    metavar="CAR.toml",
    type=FILE,
    help="Vehicle file. Its wheel radii, wheelbase and steering ratio make the proposal more reliable.",
)
@DATABASE
@JSON
@click.option("--all", "every", is_flag=True, help="List all signals, even if there are many.")
def signals(
    log_path: Path,
    out: Path | None,
    vehicle_path: Path | None,
    databases: tuple[Path, ...],
    as_json: bool,
    every: bool,
) -> int:
    """List the signals of a log, and propose which signal is which channel.

    A channel is an input of the estimator, such as yaw_rate in rad/s.

    \b
    tselab signals drive.mf4
    tselab signals drive.blf --database car.dbc --vehicle car.toml --write signals.toml
    tselab estimate drive.blf --vehicle car.toml

    The proposal is based on names (of car makers, ISO 8855, openpilot and ROS; in
    English, German, French, Spanish and Italian), on units, and on physics: lateral
    acceleration is compared with speed times yaw rate, wheel speeds with each other and
    with the yaw rate, longitudinal acceleration with the change of the wheel speeds,
    steering angle with curvature. Each proposed signal is printed with the numbers that
    support it. --write saves the proposal to a file: check this file and correct it. An
    existing file is not overwritten; remove it first.

    For a channel without a proposed signal, the most similar signals are listed, each
    with the reason why it was not proposed.

    Formats with signals: VBOX, CSV of any dialect, Parquet, Feather, MF4 and MDF 3 (extra
    mf4), MCAP and ROS bags (extra ros), MAT (7.3: extra mat), openpilot's rlog (extra
    openpilot). Formats with the frames of a bus, which need --database (extra can): BLF,
    ASC, TRC, candump, BUSMASTER, and CSV with a frame per row (CANedge, Cabana, SavvyCAN,
    python-can). A file of any format may be compressed with gzip.

    Memory: only a part of a log is in memory at a time: one channel, or a block of frames
    or CSV rows. 'tselab estimate' keeps the channels that it needs. Read as a whole are a
    CSV with the column names of tse, a file of openpilot, and each variable of a MAT 5
    file (a struct is one variable).

    Exit code: 0 a signal was found for every channel; 3 some channels
    are missing; 2 bad input.
    """
    import tse
    from tse.files import check_writable

    if out is not None and out == Path(out.name):
        out = log_path.parent / out
    check_writable(out)
    if out is not None and out.exists():
        raise Error(f"{out}: exists already: remove it first, or give a different name")
    found = tse.signals(log_path, vehicle_path, databases=databases)
    if as_json:
        print_json(found.to_dict())
    else:
        click.echo(_format_signals(found, log_path, every))
    if out is not None:
        if not found.guesses:
            raise Error(
                f"{log_path}: no signal could be proposed for any channel, so {out} is not written: write "
                "this file by hand; 'tselab estimate --help' shows its keys"
            )
        found.write(out)
        click.echo(f"Written to {out}", err=as_json)
    return 3 if found.missing else 0


def _format_signals(found: Signals, log_path: Path, every: bool) -> str:
    """Return the text that the command prints: a table of the signals, the proposed
    signals with the numbers that support them, missing channels, warnings and notes.

    `every`: True: list all signals. False: list the signals that are proposed for a
    channel, and the first MAX_LISTED_SIGNALS of the remaining signals."""
    from tse.tables import text_table

    rows = [["signal", "unit", "Hz", "min", "max", "missing", "proposed for"]]
    lines = list(found.to_frame().itertuples())
    shown = lines
    if not every and len(lines) > MAX_LISTED_SIGNALS:
        shown = [x for x in lines if x.used] + [x for x in lines if not x.used][:MAX_LISTED_SIGNALS]
    rows += [
        [x.name, x.unit, f"{x.rate:.3g}", f"{x.low:.4g}", f"{x.high:.4g}", f"{100 * x.missing:.0f} %", x.used]
        for x in shown
    ]
    parts = [f"{log_path}: {found.format}, {len(lines)} signals", "", text_table(rows, right=(2, 3, 4, 5))]
    if len(shown) < len(lines):
        parts.append(f"and {len(lines) - len(shown)} more, which --all lists")
    parts.append("")
    for sentence, figures in found.guesses:
        parts += [sentence, *(f"  {f}" for f in figures)]
    if found.missing:
        parts.append(f"not found: {', '.join(found.missing)}")
        parts += [
            f"  {channel}: {why}" for channel in found.missing for why in found.nearest.get(channel, ())
        ]
    parts += [f"warning: {w}" for w in found.warnings]
    parts += [f"note: {n}" for n in found.notes]
    return "\n".join(parts)
