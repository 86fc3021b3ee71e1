"""README states what scripts/results holds, and every path and command it names exists."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text()


def test_the_tables_are_those_of_scripts_results():
    subprocess.run([sys.executable, ROOT / "scripts" / "facts.py", "--check"], check=True)


def test_every_link_leads_somewhere():
    links = [x for x in re.findall(r"\]\(([^)#]+)\)", README) if "://" not in x]
    assert links
    assert [x for x in links if not (ROOT / x).exists()] == []


def test_every_ctest_it_names_exists():
    named = set(re.findall(r"`((?:test_)?[a-z_]+)`", "".join(re.findall(r"ctest (.+?)\|", README))))
    cmake = (ROOT / "tests" / "CMakeLists.txt").read_text()
    assert named >= {"symbols", "test_replay"}
    for name in named - {"release"}:
        assert name in cmake or any((ROOT / "tests" / "unit").rglob(f"{name}.c")), name
