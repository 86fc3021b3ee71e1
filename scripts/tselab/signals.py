"""The command `tselab signals`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from tse.errors import Error
from tselab.options import DATABASE, FILE, JSON, OutputPath, print_json

if TYPE_CHECKING:
    from tse import Signals

MAX_ROWS = 80  # signals that are listed in the terminal, unless --all


@click.command()
@click.argument("log_path", metavar="LOG", type=FILE)
@click.option(
    "--write",
    "out",
    metavar="SIGNALS.toml",
    type=OutputPath(".toml"),
    help="Write the proposal: a bare name beside the log, where 'tselab estimate' looks for signals.toml.",
)
@click.option(
    "--vehicle",
    "vehicle_path",
    metavar="CAR.toml",
    type=FILE,
    help="Radii, wheelbase and steering ratio make the guesses sharper.",
)
@DATABASE
@JSON
@click.option("--all", "every", is_flag=True, help="List all signals, however many.")
def signals(
    log_path: Path,
    out: Path | None,
    vehicle_path: Path | None,
    databases: tuple[Path, ...],
    as_json: bool,
    every: bool,
) -> int:
    """What a log holds, and which signal is probably which channel.

    \b
    tselab signals drive.mf4
    tselab signals drive.blf --database car.dbc --vehicle car.toml --write signals.toml
    tselab estimate drive.blf --vehicle car.toml

    Guesses are by names (makers', ISO 8855, openpilot, ROS; English, German, French,
    Spanish, Italian), units, and physics: lateral acceleration against speed times yaw
    rate, wheels against each other and the yaw rate, acceleration against the change of
    the wheels' speed, steering angle against curvature. Each comes with the figure that
    speaks for it: look through the file and edit it. A file that is there is not
    overwritten without being asked: remove it first.

    Formats: VBOX, CSV of any dialect, Parquet, Feather, MF4 and MDF 3 (extra mf4), BLF,
    ASC, TRC, candump, BUSMASTER and CSV with a frame per row (CANedge, Cabana, SavvyCAN,
    python-can), each with a database (extra can), MCAP and ROS bags (extra ros), MAT
    (7.3: extra mat), openpilot's rlog (extra openpilot). Any of them may be packed by
    gzip.

    Of a channel that is not found the signals that come nearest are listed, each with
    what is against it.

    A channel is read at a time, frames of a bus and rows of a CSV in pieces; tselab
    estimate keeps the channels that it needs in memory. As a whole are read: of MAT 5 a
    variable (of a struct all of it), a CSV with the names of tse, of openpilot the file.

    Exit code: 0 all channels found, 3 some are missing, 2 bad input.
    """
    import tse
    from tse.files import check_writable

    if out is not None and out == Path(out.name):
        out = log_path.parent / out
    check_writable(out)
    if out is not None and out.exists():
        raise Error(f"{out}: is there already: remove it first, or name another file")
    found = tse.signals(log_path, vehicle_path, databases=databases)
    if as_json:
        print_json(found.to_dict())
    else:
        click.echo(_format_signals(found, log_path, every))
    if out is not None:
        if not found.guesses:
            raise Error(
                f"{log_path}: nothing could be guessed, so {out} is not written: write it by hand, "
                "see 'tselab estimate --help'"
            )
        found.write(out)
        click.echo(f"Written to {out}", err=as_json)
    return 3 if found.missing else 0


def _format_signals(found: Signals, log_path: Path, every: bool) -> str:
    """Return the signals as a table, and the guesses with their figures."""
    from tse.tables import text_table

    rows = [["signal", "unit", "Hz", "least", "most", "missing", "proposed for"]]
    lines = list(found.to_frame().itertuples())
    shown = lines
    if not every and len(lines) > MAX_ROWS:
        shown = [x for x in lines if x.used] + [x for x in lines if not x.used][:MAX_ROWS]
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
