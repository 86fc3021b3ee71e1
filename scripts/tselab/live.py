"""The command `tselab live`."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import click

from tse.errors import Error
from tselab.options import (
    DATABASE,
    FILE,
    add_program_options,
    check_range,
    check_table,
    convert_age,
    print_json,
    read_settings,
)

if TYPE_CHECKING:
    from tse import Live

EACH = 0.25  # [s] time between two updates of the printed lines
MAX_LIVE_DURATION = 86400.0  # [s] max value of --duration
MIN_RATE, MAX_RATE = 2.0, 1000.0  # [Hz] range of --rate, and of the key `rate` in signals.toml


@click.command()
@click.option(
    "--interface",
    required=True,
    metavar="NAME",
    help="Interface of python-can: socketcan, vector, pcan, kvaser, ixxat, slcan, udp_multicast ...",
)
@click.option("--channel", metavar="NAME", help="Channel of the interface: can0, PCAN_USBBUS1, 0 ...")
@DATABASE
@click.option(
    "--vehicle",
    "vehicle_path",
    metavar="CAR.toml",
    type=FILE,
    required=True,
    help="Vehicle file, as for 'tselab estimate'.",
)
@click.option(
    "--signals",
    "signals_path",
    metavar="SIGNALS.toml",
    type=FILE,
    help="File that assigns signals to channels; default: signals.toml in the folder of the database or, "
    "without it, a proposal made from the received frames.",
)
@click.option(
    "--out",
    metavar="DIR",
    type=FILE,
    help="Folder in which the drive is recorded; default: live-DATE-TIME in the current directory.",
)
@click.option(
    "--browser", is_flag=True, help="Also show plots in a browser. Only this machine can open the page."
)
@click.option(
    "--load-learnt", metavar="FILE", type=FILE, help="Start from the learnt state of an earlier drive."
)
@click.option(
    "--age", metavar="DAYS", type=float, help="Age of the learnt state; default: the age of its file."
)
@click.option(
    "--save-learnt",
    metavar="FILE",
    type=FILE,
    help="Write the learnt state at the end of the drive; may be the file of --load-learnt.",
)
@click.option(
    "--rate",
    metavar="HZ",
    type=float,
    help="Rows per second; default: the rate of the fastest channel, at most 100.",
)
@click.option(
    "--config",
    "config_path",
    metavar="FILTER.toml",
    type=FILE,
    help="Filter settings; 'tselab settings' lists them.",
)
@click.option(
    "--set", "pairs", metavar="KEY=VALUE", multiple=True, help="Any other setting; may be repeated."
)
@click.option(
    "--bus",
    "bus_pairs",
    metavar="KEY=VALUE",
    multiple=True,
    help="An option of the interface, such as bitrate=500000, fd=true, "
    "receive_own_messages=true; may be repeated.",
)
@click.option(
    "--duration", metavar="SECONDS", type=float, help="End after this time; default: end at Ctrl-C."
)
@add_program_options
def live(
    interface: str,
    channel: str | None,
    databases: tuple[Path, ...],
    vehicle_path: Path,
    signals_path: Path | None,
    out: Path | None,
    browser: bool,
    load_learnt: Path | None,
    age: float | None,
    save_learnt: Path | None,
    rate: float | None,
    config_path: Path | None,
    pairs: tuple[str, ...],
    bus_pairs: tuple[str, ...],
    duration: float | None,
    as_json: bool,
    table: Path | None,
) -> int:
    """Estimate tyre stiffness while driving, from a CAN bus.

    \b
    tselab live --interface socketcan --channel can0 --database car.dbc --vehicle car.toml
    tselab live --interface pcan --bus bitrate=500000 --database car.dbc \\
      --vehicle car.toml --browser
    tselab live --interface socketcan --channel can0 --database car.dbc \\
      --vehicle car.toml --load-learnt car.tse --save-learnt car.tse

    Three lines show the stiffnesses, and whether each is usable. Events, such as a change
    of the road, a sensor fault or a silent bus, are printed above these lines. Ctrl-C
    ends the drive. The command needs the extra 'can' of the package.

    signals.toml names the signal of each channel, as for 'tselab estimate'. Without
    signals.toml the command receives frames for 20 s, and searches them for the signals
    of steering angle, wheel speeds, and yaw rate or lateral acceleration. Until all of
    these are found, the search is repeated every 20 s with more frames. The command
    prints and records the signals that it uses.

    A row is the set of all channels at one time t. Each channel is interpolated between
    its values before and after t. So the row is complete, and the filter makes its step,
    when a value after t has arrived for every channel. The channel that arrives last thus
    determines the delay of the estimates. For a channel with no value after t, the row
    waits at most until t + latency of the channel + 1.5 periods of the channel + 0.02 s.
    Then the row has the last value of the channel if this value is at most half a period
    old, or if the signal has hold = true. Otherwise the channel is missing in the row.

    If the bus fails, the command tries to open it again every second. The command reports
    a bus that is silent or off, a message that is no longer received, a database of a
    different bus, and channels that contradict each other. None of these faults ends the
    drive.

    \b
    Files of the record in DIR:
      frames.blf            all frames
      frames.signals.toml   the signals that were used; the databases are copied, too
      rows.csv              the rows that the filter received
      rows.est.csv          the estimates, with the columns of 'tselab estimate'
      filter.toml           the settings
      before.tse            a copy of the file of --load-learnt
      events.txt            the events

    \b
    tselab estimate DIR/rows.csv --config DIR/filter.toml --vehicle CAR.toml \\
      --no-calibrate
    tselab estimate DIR/frames.blf --vehicle CAR.toml --no-calibrate

    The first command repeats the estimates of the drive bit by bit. The estimates of the
    second command differ in the last digits: its rows are interpolated from all frames,
    also from frames that arrived too late for their row during the drive. If the vehicle
    file has no calibrated stiffness, the filter starts from the stiffness of an ordinary
    car with the same mass, lf and lr. 'tselab calibrate' can later calibrate the car on
    the record.

    Exit code: 0 usable: every stiffness is valid; 3 usable in part: only some are; 4
    nothing usable: no stiffness is valid; 2 bad input. Ctrl-C ends the drive as usual and
    does not change the exit code.
    """
    import tse
    from tse.files import check_distinct, check_writable

    check_range("rate", rate, MIN_RATE, MAX_RATE, "Hz")
    check_range("duration", duration, 0.1, MAX_LIVE_DURATION, "s")
    age_s = convert_age(age, load_learnt)
    if not databases:
        raise Error("option --database: is missing: give the database that defines the frames of the bus")
    check_table(table)
    check_distinct(
        {"--save-learnt": save_learnt, "--table": table},
        {"--vehicle": vehicle_path, "--config": config_path, "--signals": signals_path},
    )
    check_distinct({"--table": table}, {"--load-learnt": load_learnt})
    check_writable(save_learnt, table)
    settings = read_settings(pairs)
    folder = out or Path(time.strftime("live-%Y%m%d-%H%M%S"))
    bus_options = _read_bus_options(bus_pairs)
    with _catch_interrupt() as stopped, _Lines(as_json) as lines:
        drive = tse.live(
            vehicle_path,
            database=databases,
            interface=interface,
            channel=channel,
            signals=signals_path,
            out=folder,
            settings=settings,
            config=config_path,
            learnt=load_learnt,
            age=age_s,
            rate=rate,
            duration=duration,
            say=lines.say,
            **bus_options,
        )
        try:
            for line in (*drive.notes, f"the drive is recorded in {folder}; Ctrl-C ends it"):
                lines.say(line)
            if browser:
                url = drive.serve()
                lines.say(f"plots: {url}")
                click.launch(url)
            _follow(drive, lines, stopped)
        finally:
            drive.close()
    if table is not None and drive.rows:
        drive.write_table(table)
    learnt = drive.learnt
    if save_learnt is not None and learnt is not None:
        drive.save_learnt(save_learnt)
    if as_json:
        print_json({**drive.to_dict(), "learnt": save_learnt if learnt else None})
        return drive.exit_code
    for line in drive.answer:
        click.echo(line)
    if not drive.rows:
        click.echo("no row was made from the received frames, so nothing was estimated")
    click.echo(drive.numbers, err=True)
    if save_learnt is not None and learnt is not None:
        click.echo(f"Learnt state written to {save_learnt}")
    elif save_learnt is not None:
        click.echo(f"nothing was learnt, so {save_learnt} is not written", err=True)
    click.echo(f"Drive recorded in {folder}")
    return drive.exit_code


def _follow(drive: Live, lines: _Lines, stopped: Callable[[], bool]) -> None:
    """Process frames until the drive ends, and update the three printed
    lines every EACH seconds."""
    before = 0.0
    while not stopped() and not drive.ended:
        drive.poll()
        if time.monotonic() > before + EACH:
            before = time.monotonic()
            lines.show(drive.answer)


def _read_bus_options(pairs: tuple[str, ...]) -> dict[str, Any]:
    """Parse the values of --bus, each KEY=VALUE. Numbers, true and false are converted;
    other values stay strings."""
    found: dict[str, Any] = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        if not equals or not key.strip().isidentifier():
            raise Error(f"option --bus: {pair!r} is not KEY=VALUE, for instance bitrate=500000")
        value: Any = {"true": True, "false": False}.get(text.lower(), text)
        for kind in (int, float):
            try:
                value = kind(text)
                break
            except ValueError:
                pass
        found[key.strip()] = value
    return found


class _Lines:
    """Output of the drive. On a terminal, the lines of the estimates are at the bottom
    and are updated in place. Sentences about events are printed above these lines.

    If standard output is not a terminal, or if `quiet` is True, only the sentences are
    printed, on standard error."""

    def __init__(self, quiet: bool) -> None:
        self._terminal = sys.stdout.isatty() and not quiet
        self._shown = 0
        self._lock = threading.Lock()

    def __enter__(self) -> _Lines:
        return self

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._clear()

    def _clear(self) -> None:
        if self._shown:
            click.echo(f"\033[{self._shown}A\033[J", nl=False)
            self._shown = 0

    def say(self, text: str) -> None:
        """Print a sentence above the lines."""
        with self._lock:
            self._clear()
            click.echo(text, err=not self._terminal)

    def show(self, lines: Sequence[str]) -> None:
        """Print `lines` at the bottom of the terminal. They replace the lines of the
        previous call."""
        if not self._terminal or not lines:
            return
        with self._lock:
            self._clear()
            click.echo("\n".join(lines))
            self._shown = len(lines)


@contextmanager
def _catch_interrupt() -> Iterator[Callable[[], bool]]:
    """Let Ctrl-C, SIGTERM and SIGHUP only set a flag inside the context. Yield a function
    that returns the flag. A second Ctrl-C raises KeyboardInterrupt."""
    seen = threading.Event()

    def on_signal(_signal: int, _frame: FrameType | None) -> None:
        seen.set()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    names = [n for n in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, n)]
    before = {n: signal.signal(getattr(signal, n), on_signal) for n in names}
    interval = sys.getswitchinterval()
    # Let Python switch between threads every 0.001 s (by default every 0.005 s). The
    # thread of the filter then waits less for threads that write files or draw plots
    sys.setswitchinterval(0.001)
    try:
        yield seen.is_set
    finally:
        sys.setswitchinterval(interval)
        for n, handler in before.items():
            signal.signal(getattr(signal, n), handler)
