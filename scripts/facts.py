#!/usr/bin/env python3
"""Measure what README states, write the tables to scripts/results, and put them into README between their markers.

    .venv/bin/python scripts/facts.py            everything: about a minute and a half
    .venv/bin/python scripts/facts.py --check    measure nothing; fail when README differs from scripts/results
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "scripts" / "results"
README = ROOT / "README.md"


def output(*command: str | Path) -> str:
    return subprocess.run([str(c) for c in command], cwd=ROOT, check=True, capture_output=True, text=True).stdout


def sizes() -> str:
    """Bytes that a caller provides, from tests/sizes.c compiled per format and capacity."""
    found: dict[int, dict[str, int]] = {}
    for preset, real in (("release", "double"), ("float", "float"), ("q20", "q20")):
        output("cmake", "--preset", preset, f"-DFETCHCONTENT_SOURCE_DIR_UNITY={ROOT / '.venv/share/unity'}")
        text = output("cmake", "--build", "--preset", preset, "--target", "sizes")
        for capacity, size in re.findall(r"(\d+) particles: tse_filter +(\d+)", text):
            found.setdefault(int(capacity), {})[real] = int(size)
    lines = ["| `sizeof(tse_filter)`, capacity | double | float | q20 |", "|---:|---:|---:|---:|"]
    lines += [f"| {n} | {' | '.join(f'{s[r]:,} B' for r in ('double', 'float', 'q20'))} |" for n, s in sorted(found.items())]
    return "\n".join(lines) + "\n"


def measure() -> None:
    RESULTS.mkdir(exist_ok=True)
    tselab = ROOT / ".venv" / "bin" / "tselab"
    print("sizes ...", flush=True)
    (RESULTS / "sizes.md").write_text(sizes())
    print("accuracy ...", flush=True)
    output(tselab, "accuracy", "--runs", "24", "--out", RESULTS)
    print("time ...", flush=True)
    (RESULTS / "bench.md").write_text(output(ROOT / "scripts" / "bench.sh"))
    print("picture ...", flush=True)
    output(tselab, "demo", "--out", ROOT / "demo-output")
    (RESULTS / "demo.png").write_bytes((ROOT / "demo-output" / "demo.png").read_bytes())


def columns(text: str, which: int, names: list[str]) -> str:
    """Some columns of the which-th table of a Markdown text."""
    tables = re.findall(r"(?:^\|.*\n)+", text + "\n", flags=re.M)
    rows = [[cell.strip() for cell in line.strip("| ").split("|")] for line in tables[which - 1].splitlines()]
    at = [rows[0].index(name) for name in names]
    return "\n".join("| " + " | ".join(row[i] for i in at) + " |" for row in rows)


def updated(text: str) -> str:
    """README with every block holding scripts/results/NAME.md, or some columns of a table in it:
    `<!-- facts: NAME -->`, `<!-- facts: NAME 2: column, column -->` ... `<!-- end -->`."""

    def block(match: re.Match[str]) -> str:
        content = (RESULTS / f"{match[1]}.md").read_text().strip()
        if match[2]:
            content = columns(content, int(match[2]), match[3].split("; "))
        return f"{match[0].splitlines()[0]}\n{content}\n<!-- end -->"

    return re.sub(r"<!-- facts: ([\w-]+)(?: (\d+): ([^>\n]*?))? -->\n.*?<!-- end -->", block, text, flags=re.S)


def main() -> int:
    check = "--check" in sys.argv[1:]
    if not check:
        measure()
    text = README.read_text()
    if check:
        if updated(text) != text:
            print("README.md differs from scripts/results: run scripts/facts.py", file=sys.stderr)
            return 1
        return 0
    README.write_text(updated(text))
    return 0


if __name__ == "__main__":
    sys.exit(main())
