"""Base class of the results that the API returns. A result can be shown as sentences, as
a table, as a figure and as an HTML page."""

from __future__ import annotations

import html
import os
from pathlib import Path
from typing import Any

import pandas as pd

from tse.library.files import write_atomically

MAX_SHOWN_ROWS = 20  # max number of rows of a table that a notebook shows


class Shown:
    """Base class of a result. Subclasses define `words`, `to_frame()` and `plot()`."""

    @property
    def words(self) -> tuple[str, ...]:
        """The result in sentences."""
        raise NotImplementedError

    def to_frame(self) -> pd.DataFrame:
        """Return the result as a table."""
        raise NotImplementedError

    def plot(self) -> Any:
        """Return the result as a plotly figure."""
        raise NotImplementedError

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the result as an HTML page, which needs no other file and no network.

        Parameters
        ----------
        path
            The HTML file. An existing file is replaced.

        Returns
        -------
        Path
            `path`.
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
        return f"<ul>{lines}</ul>{self._shown_rows().to_html(max_rows=MAX_SHOWN_ROWS, border=0)}"

    def _shown_rows(self) -> pd.DataFrame:
        """Return the table that a notebook shows."""
        return self.to_frame()


def make_figure(figure: Any) -> Any:
    """Convert a figure of tse.report.plots to a plotly figure."""
    import plotly.graph_objects as go  # not at the top: the import takes half a second

    return go.Figure(figure.as_dict())
