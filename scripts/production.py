#!/usr/bin/env python3
"""The page for the production engineer: what is measured and proven of the library, what it does with every fault, and how versions
and states are read, from the tables of the library and of scripts/results.

    python3 scripts/production.py [--check]     writes scripts/results/production.md; --check: exit code 1 if it is not current
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

import tables

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "scripts" / "results"
PAGE = RESULTS / "production.md"

# file of scripts/results, its heading on the page, what makes it
TABLES = (
    ("budgets.md", "Time, flash, RAM and stack on microcontrollers", "scripts/budgets.py"),
    ("sizes.md", "Memory that a caller provides", "scripts/facts.py"),
    ("platforms.md", "The same bits elsewhere", "scripts/platforms.py"),
    ("fixed.md", "Fixed point beside double", "scripts/fixed.py"),
    ("fuzz.md", "Hostile inputs", "scripts/fuzz.sh"),
    ("soak.md", "Millions of rows with faults", "scripts/soak.sh"),
    ("proof.md", "What is proven", "scripts/eva.sh"),
    ("mutation.md", "Faults that the tests find", "scripts/mutation.sh"),
)
LONG = (
    ("coverage.md", "What the unit tests run", "scripts/coverage.sh"),
    ("misra.md", "MISRA C:2012", "scripts/misra.sh"),
)


def rows_of(table: str) -> list[tuple[str, str, str]]:
    """Name, code and sentence of each row: status, reason."""
    return [(name, str(row["code"]), row["text"]) for name, row in tables.read("status")[table].items()]


def comment_before(function: str, header: str) -> str:
    """The comment of a public function, as it is written."""
    text = (ROOT / "include" / "tse" / header).read_text(encoding="utf-8")
    head = text.split(f"\ntse_status {function}(", 1)[0]
    return plain(head[head.rindex("/*") :])


def plain(comment: str) -> str:
    """A comment of C without its stars."""
    lines = comment.strip().removesuffix("*/").splitlines()
    return "\n".join(line.removeprefix("/*").removeprefix(" *").rstrip() for line in lines).rstrip()


def shifted(text: str) -> str:
    """Headings of a table's file below those of the page; its own title is left out."""
    kept = [line for line in text.strip().splitlines() if not line.startswith("# ")]
    return re.sub(r"^(#+) ", r"##\1 ", "\n".join(kept).strip(), flags=re.M)


def page() -> str:
    """The whole page, Markdown."""
    parts = ["<!-- Written by `python3 scripts/production.py`. -->\n\n# For who takes the library into production"]
    parts.append(
        "Each table names the command that makes it. What a command could not measure is not in its table. Of tools that are not\n"
        "installed: `scripts/setup.sh machines proof`."
    )
    parts.append("## What happens with a fault\n\n```\n" + comment_before("tse_step", "tse.h") + "\n```")
    for table, title in (
        ("status", "What a call says"),
        ("reason", "Why a stiffness is not valid"),
    ):
        lines = [f"| {name} | {code} | {text} |" for name, code, text in rows_of(table)]
        parts.append(f"## {title}\n\n| name | code | meaning |\n|---|---:|---|\n" + "\n".join(lines))
    head = (ROOT / "include" / "tse" / "learnt.h").read_text(encoding="utf-8").split("#ifndef", 1)[0]
    parts.append("## States and versions\n\n```\n" + plain(head) + "\n```")
    parts.append("```\n" + comment_before("tse_learnt_load", "learnt.h") + "\n```")
    for name, title, command in (*TABLES, *LONG):
        text = f"Not run yet: `{command}`."
        if (RESULTS / name).exists():
            own = (name, title, command) in TABLES
            text = (
                shifted((RESULTS / name).read_text(encoding="utf-8")) if own else f"[{name}]({name}), by `{command}`."
            )
        parts.append(f"## {title}\n\n{text}")
    return "\n\n".join(parts) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing")
    text = page()
    if not parser.parse_args().check:
        PAGE.write_text(text, encoding="utf-8")
        return 0
    if PAGE.exists() and PAGE.read_text(encoding="utf-8") == text:
        return 0
    print(f"{PAGE.relative_to(ROOT)} is not what its tables say: run scripts/production.py", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
