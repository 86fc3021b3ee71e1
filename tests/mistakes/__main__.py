"""Make scripts/results/mistakes.md:   .venv/bin/python -m tests.mistakes"""

import sys

import numpy as np

from tests.mistakes.drives import MISTAKES, SECONDS, STEP, drives
from tests.mistakes.front_ends import FRONT_ENDS, ROOT, Said

PAGE = ROOT / "scripts" / "results" / "mistakes.md"

HEAD = """# Mistakes that logs are made with

`python -m tests.mistakes`: {mistakes} mistakes in two simulated drives of {seconds:.0f} s that turn, gain speed and brake, through
six front ends. A cell is *valid and silent* where a stiffness is valid in the last half minute and nothing is said against the log.

**Valid and silent: {silent} of {cells}.** Without a mistake something is said against the log in {wrong} of {clean}{which}

Of the first drive the car is known exactly, so that much is valid within two seconds: how long something was valid before the
mistake showed is in brackets. `tselab` refuses a log that is often out of range. *named*: `fault_channel` and `fault_factor` of
the last implausible row in C."""


def cell(said: Said) -> str:
    """When something was said against the log, and what."""
    if said.silent:
        return "**valid and silent**"
    rows = np.flatnonzero(said.against)
    if not len(rows):
        return "a warning" if said.words else "never valid"
    first = int(rows[0])
    if said.status[0] < 0 and (said.status < 0).all():
        return "refused"
    before = int(said.valid[:first].any(axis=1).sum())
    how = "refused" if said.status[first] < 0 else "implausible"
    return f"{how}, {first * STEP:.0f} s" + (f" (valid for {before * STEP:.0f} s)" if before else "")


def named(said: Said) -> str:
    """What C says at the end."""
    rows = np.flatnonzero(said.status == 10)
    if not len(rows):
        return ""
    at = int(rows[-1])
    return f"{said.channel[at]} x {said.factor[at]:.3g}" if said.factor[at] else f"{said.channel[at]}"


def main() -> int:
    silent, lines, wrong = 0, [], []
    for drive in drives():
        lines += [
            "",
            f"## {drive.name}",
            "",
            f"| mistake | {' | '.join(FRONT_ENDS)} | named |",
            f"|---|{'---|' * len(FRONT_ENDS)}---|",
        ]
        for mistake, make in MISTAKES.items():
            log, found = make(drive), []
            for front_end in FRONT_ENDS.values():
                found.append(front_end(drive, log))
                silent += found[-1].silent
            lines.append(f"| {mistake} | {' | '.join(map(cell, found))} | {named(found[0])} |")
            print(lines[-1], flush=True)
        for name, front_end in FRONT_ENDS.items():
            said = front_end(drive, drive.log)
            if said.against.any() or said.words:
                wrong.append(f"{name}, {drive.name}")
    cells = len(FRONT_ENDS) * len(MISTAKES) * 2
    head = HEAD.format(
        mistakes=len(MISTAKES), seconds=SECONDS, silent=silent, cells=cells, wrong=len(wrong), clean=2 * len(FRONT_ENDS),
        which=f": {'; '.join(wrong)}." if wrong else ".",
    )  # fmt: skip
    PAGE.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
    return 1 if silent or wrong else 0


if __name__ == "__main__":
    sys.exit(main())
