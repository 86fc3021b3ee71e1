"""The command `tselab signals`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tselab.options import DATABASE, FILE, JSON, Written

if TYPE_CHECKING:
    from tse.channels.proposal import Line, Proposal
    from tse.readers.recording import Recording

MOST_ROWS = 80  # signals that are listed in the terminal, unless --all


@click.command()
@click.argument("log_path", metavar="LOG", type=FILE)
@click.option(
    "--write",
    "out",
    metavar="SIGNALS.toml",
    type=Written(".toml"),
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

    Guesses are by names (makers', ISO 8855, openpilot, ROS; English, German, French, Spanish, Italian), units, and physics: lateral
    acceleration against speed times yaw rate, wheels against each other and the yaw rate, acceleration against the change of the
    wheels' speed, steering angle against curvature. Each comes with the figure that speaks for it: look through the file and edit
    it. A file that is there is not overwritten without being asked: remove it first.

    Formats: VBOX, CSV of any dialect, Parquet, Feather, MF4 and MDF 3 (extra mf4), BLF, ASC, TRC, candump, BUSMASTER and CSV with
    a frame per row (CANedge, Cabana, SavvyCAN, python-can), each with a database (extra can), MCAP and ROS bags (extra ros), MAT
    (7.3: extra mat), openpilot's rlog (extra openpilot). Any of them may be packed by gzip.

    Of a channel that is not found the signals that come nearest are listed, each with what is against it.

    A channel is read at a time, frames of a bus and rows of a CSV in pieces; tselab estimate keeps the channels that it needs in
    memory. As a whole are read: of MAT 5 a variable (of a struct all of it), a CSV with the names of tse, of openpilot the file.

    Exit code: 0 all channels found, 3 some are missing, 2 bad input.
    """
    from tse.car.vehicle import read_vehicle
    from tse.channels.proposal import format_signals, list_signals, propose
    from tse.channels.signals import find_signals
    from tse.library.errors import UserError
    from tse.library.files import check_writable, write_atomically
    from tse.readers.readers import read_recording
    from tse.report.results import say_json

    if out is not None and out == Path(out.name):
        out = log_path.parent / out
    check_writable(out)
    if out is not None and out.exists():
        raise UserError(f"{out}: is there already: remove it first, or name another file")
    car = read_vehicle(vehicle_path) if vehicle_path is not None else None
    _, how = find_signals(log_path, None, databases)
    recording = read_recording(log_path, how)
    proposal = propose(recording, car)
    lines = list_signals(recording, proposal)
    if as_json:
        say_json(_as_json(recording, proposal, lines))
    else:
        click.echo(_text(recording, proposal, lines, every))
    if out is not None:
        if not proposal.guesses:
            raise UserError(
                f"{log_path}: nothing could be guessed, so {out} is not written: write it by hand, see 'tselab estimate --help'"
            )
        with write_atomically(out) as file:
            file.write(format_signals(recording, proposal, how, out.parent))
        click.echo(f"Written to {out}", err=as_json)
    return 3 if proposal.missing else 0


def _text(recording: Recording, proposal: Proposal, lines: list[Line], every: bool) -> str:
    from tse.channels.proposal import format_headline
    from tse.report.tables import text_table

    rows = [["signal", "unit", "Hz", "least", "most", "missing", "proposed for"]]
    shown = (
        lines
        if every or len(lines) <= MOST_ROWS
        else [x for x in lines if x.used] + [x for x in lines if not x.used][:MOST_ROWS]
    )
    rows += [
        [x.name, x.unit, f"{x.rate:.3g}", f"{x.low:.4g}", f"{x.high:.4g}", f"{100 * x.missing:.0f} %", x.used]
        for x in shown
    ]
    parts = [
        f"{recording.path}: {recording.format}, {len(lines)} signals",
        "",
        text_table(rows, right=(2, 3, 4, 5)),
    ]
    if len(shown) < len(lines):
        parts.append(f"and {len(lines) - len(shown)} more, which --all lists")
    parts.append("")
    for g in proposal.guesses:
        parts += [format_headline(g), *(f"  {f}" for f in g.figures)]
    if proposal.missing:
        parts.append(f"not found: {', '.join(proposal.missing)}")
        parts += [
            f"  {channel}: {why}" for channel in proposal.missing for why in proposal.nearest.get(channel, ())
        ]
    parts += [f"warning: {w}" for w in proposal.warnings]
    parts += [f"note: {n}" for n in recording.notes]
    return "\n".join(parts)


def _as_json(recording: Recording, proposal: Proposal, lines: list[Line]) -> dict[str, Any]:
    return {
        "log": recording.path,
        "format": recording.format,
        "signals": [vars(x) for x in lines],
        "proposal": {
            g.channel: {k: v for k, v in vars(g).items() if k != "channel"} for g in proposal.guesses
        },
        "missing": proposal.missing,
        "nearest": proposal.nearest,
        "warnings": proposal.warnings,
        "notes": recording.notes,
    }
