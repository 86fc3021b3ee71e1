"""Common methods of the results of the API: sentences, a table, a figure, a page."""

from __future__ import annotations

import html
import os
from pathlib import Path
from typing import Any

import pandas as pd

from tse.library.files import write_atomically

MAX_ROWS = 20  # of a table in a notebook


class Shown:
    """A result. Its classes give `words`, `to_frame()` and `plot()`."""

    @property
    def words(self) -> tuple[str, ...]:
        """The result in sentences, as the command ends."""
        raise NotImplementedError

    def to_frame(self) -> pd.DataFrame:
        """Return the result as a table."""
        raise NotImplementedError

    def plot(self) -> Any:
        """Return a figure of plotly."""
        raise NotImplementedError

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write a page that needs nothing else and can be read offline.

        Parameters
        ----------
        path
            The HTML file; one that is there is replaced.

        Returns
        -------
        Path
            The file.
        """
        page = (
            '<!doctype html><html lang="en"><meta charset="utf-8"><title>tse</title>'
            f"<body>{self._repr_html_()}"
            f"{self.plot().to_html(full_html=False, include_plotlyjs=True)}</body></html>"
        )
        with write_atomically(Path(path)) as file:
            file.write(page)
        return Path(path)

    def _repr_html_(self) -> str:
        lines = "".join(f"<li>{html.escape(line)}</li>" for line in self.words)
        return f"<ul>{lines}</ul>{self._shown_rows().to_html(max_rows=MAX_ROWS, border=0)}"

    def _shown_rows(self) -> pd.DataFrame:
        """Return the table that a notebook shows."""
        return self.to_frame()


def make_figure(figure: Any) -> Any:
    """Return a figure of tse.report.plots as a figure of plotly."""
    import plotly.graph_objects as go  # takes half a second: only for figures

    return go.Figure(figure.as_dict())
