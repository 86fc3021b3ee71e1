"""Which signal of a log is which channel."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from tse._log import PathLike
from tse._shown import Shown, lines
from tse._vehicle import VehicleLike, read_vehicle
from tse.impl.errors import UserError
from tse.impl.files import atomic
from tse.impl.logs.propose import Proposal, propose
from tse.impl.logs.propose.text import Line, headline, listing, toml_text
from tse.impl.logs.readers import read_recording
from tse.impl.logs.readers.recording import How, Recording


class Signals(Shown):
    """Which signal of a log is proposed for which channel."""

    def __init__(self, recording: Recording, proposal: Proposal):
        self._recording, self._proposal = recording, proposal
        self.missing = tuple(proposal.missing)
        """Channels for which nothing was found."""
        self.warnings = tuple(proposal.warnings)
        """What is doubtful, in words."""

    @property
    def _lines(self) -> list[Line]:
        return listing(self._recording, self._proposal)

    @property
    def words(self) -> tuple[str, ...]:
        """A sentence for each guess, and what was not found."""
        missing = [f"not found: {', '.join(self.missing)}"] if self.missing else []
        return (*map(headline, self._proposal.guesses), *missing, *(f"warning: {w}" for w in self.warnings))

    @property
    def toml(self) -> str:
        """The text of signals.toml, with what speaks for each guess as comments."""
        return toml_text(self._recording, self._proposal)

    def write(self, path: PathLike) -> Path:
        """Write signals.toml, for read_log() and the commands; one that is there is replaced."""
        if not self._proposal.guesses:
            raise UserError(f"{self._recording.path}: nothing could be guessed, so {path} is not written")
        with atomic(Path(path)) as file:
            file.write(self.toml)
        return Path(path)

    def to_frame(self) -> pd.DataFrame:
        """Return a row per signal: name, unit, rate [Hz], low, high, missing (share), used (the channel it is proposed for)."""
        return pd.DataFrame([vars(line) for line in self._lines])

    def _shown_rows(self) -> pd.DataFrame:
        rows = self.to_frame()
        return rows[rows["used"] != ""]

    def plot(self) -> Any:
        """Return a figure of plotly: the signals that are proposed, each in the unit that it is logged in."""
        there = {c.name: c for c in self._recording}
        return lines([
            (f"{g.channel} [{g.unit}]", [(n, there[n].time, there[n].value) for n in g.name if n in there])
            for g in self._proposal.guesses
        ])  # fmt: skip


def signals(log: PathLike, vehicle: VehicleLike | None = None, *, databases: Sequence[PathLike] = ()) -> Signals:
    """Propose which signal of a log is which channel, by names, units and physics, as `tselab signals` does.

    Parameters
    ----------
    log
        A file of any format.
    vehicle
        As in estimate(); makes the figures sharper.
    databases
        DBC files of the bus.

    Returns
    -------
    Signals
        Look through `words`, `write()` it beside the log, and correct what is wrong.
    """
    recording = read_recording(Path(log), How(databases=tuple(map(Path, databases))))
    return Signals(recording, propose(recording, None if vehicle is None else read_vehicle(vehicle)))
