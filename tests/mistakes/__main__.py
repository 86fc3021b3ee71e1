"""Make scripts/results/mistakes.md:   .venv/bin/python -m tests.mistakes"""

import sys

import numpy as np

from tests.mistakes.drives import MISTAKES, SECONDS, STEP, make_drives
from tests.mistakes.front_ends import FRONT_ENDS, ROOT, Response

PAGE = ROOT / "scripts" / "results" / "mistakes.md"

HEAD = """# Mistakes in logs

`python -m tests.mistakes`: {mistakes} mistakes in two simulated drives of {seconds:.0f} s with bends,
acceleration and braking, through six front ends. *Valid and silent*: a stiffness is valid
in the last 30 s, and there is no warning.

**Valid and silent: {silent} of {cells}.** Without a mistake there is a warning in {wrong} of {clean}{which}

Cells: the first reaction, and its time from the start of the log. The car of the first drive
is known exactly, so its stiffness is valid within two seconds. The time for which it was
valid before the mistake was detected is in brackets. `tselab` refuses a log that is often
out of range. *named*: `fault_channel` and `fault_factor` of the last implausible row in C."""


def format_cell(said: Response) -> str:
    """Return the kind of the first warning about a log, and its time."""
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


def format_fault(said: Response) -> str:
    """Return fault_channel and fault_factor of the last implausible row."""
    rows = np.flatnonzero(said.status == 10)
    if not len(rows):
        return ""
    at = int(rows[-1])
    return f"{said.channel[at]} x {said.factor[at]:.3g}" if said.factor[at] else f"{said.channel[at]}"


def main() -> int:
    """Write the page; return 1 if a mistake was missed, or a correct log has a
    warning."""
    silent, lines, wrong = 0, [], []
    for drive in make_drives():
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
            lines.append(f"| {mistake} | {' | '.join(map(format_cell, found))} | {format_fault(found[0])} |")
            print(lines[-1], flush=True)
        for name, front_end in FRONT_ENDS.items():
            said = front_end(drive, drive.log)
            if said.against.any() or said.words:
                wrong.append(f"{name}, {drive.name}")
    cells = len(FRONT_ENDS) * len(MISTAKES) * 2
    head = HEAD.format(
        mistakes=len(MISTAKES),
        seconds=SECONDS,
        silent=silent,
        cells=cells,
        wrong=len(wrong),
        clean=2 * len(FRONT_ENDS),
        which=f": {'; '.join(wrong)}." if wrong else ".",
    )
    PAGE.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
    return 1 if silent or wrong else 0


if __name__ == "__main__":
    sys.exit(main())
