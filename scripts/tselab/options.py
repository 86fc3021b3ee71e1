"""What options of several commands share."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from tselab.errors import UserError

FILE = click.Path(path_type=Path)
FORMS = ("default", "sampled", "paper")  # tse_config_default() and its like


def key_values(pairs: tuple[str, ...]) -> dict[str, float]:
    values: dict[str, float] = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        try:
            number = float(text)
        except ValueError:
            equals = ""
        if not equals:
            raise UserError(f"option --set: {pair!r} is not KEY=NUMBER, for instance forgetting=0.995")
        values[key.strip()] = int(number) if number.is_integer() else number
    return values


def show_progress(progress: bool | None) -> bool:
    return sys.stderr.isatty() if progress is None else progress


FORM = click.option(
    "--form",
    type=click.Choice(FORMS),
    default="default",
    show_default=True,
    help="sampled: particles sample states and mean stiffness, too; with limits, less accurate, not as safe. "
    "paper: the same without limits, the filter as printed.",
)
PROGRESS = click.option(
    "--progress/--no-progress", default=None, help="Progress bar; default: when stderr is a terminal."
)
