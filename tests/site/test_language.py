"""The words of the field, not of the house: README, pages, messages, help, comments and names of code."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "scripts"))
from docsite import links  # noqa: E402

INSTEAD = {  # what is written -> what a textbook writes
    r"(?:un)?told": "known, assumed, set; observable; separable from",
    r"foret(?:ell|old)\w*": "predict",
    r"noticed": "detected",
    r"nod(?:s|ding)?": "pitch, low-pass",
    r"loud(?:er|ly)?": "noisy",
    r"mothers?|births?|youth": "parent, spawn, age",
    r"dustbin": "the hypothesis that none fits",
    r"bears?": "spawn; confirm",
    r"(?<!await )(?<!new )promis(?:e|es|ed)": "expected gain",
    r"of late": "recent",
    r"says? nothing (?:of|about|to|against)": "does not show",
    r"95 % bands?": "95 % interval",
}
BAD = re.compile("|".join(rf"\b(?:{word})\b" for word in INSTEAD), flags=re.I)
WHERE = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "src/", "include/", "fmu/", "scripts/", "docs/")
KINDS = {".md", ".py", ".c", ".h", ".js", ".html", ".j2", ".toml", ".sh", ".yml"}
NOT = ("docs/assets/", "scripts/lock", "scripts/results/")  # others' code; tables are as their command wrote them
FILES = [
    p
    for p in links.files()
    if (name := p.relative_to(ROOT).as_posix()).startswith(WHERE) and p.suffix in KINDS and not name.startswith(NOT)
]


def house_words(text: str) -> list[str]:
    """Return each line that has such a word; names with underscores are words, too."""
    return [line.strip() for line in text.splitlines() if BAD.search(line.replace("_", " "))]


def test_files_are_in_the_words_of_the_field():
    found = {p.relative_to(ROOT).as_posix(): house_words(p.read_text(encoding="utf-8")) for p in FILES}
    assert len(FILES) > 300 and {name: lines for name, lines in found.items() if lines} == {}


@pytest.mark.parametrize(
    ("line", "bad"),
    [("what it is told", True), ("told_before = 1", True), ("A road is noticed", True), ("await new Promise(go)", False),
     ("it says nothing of slip", True), ("where the file says nothing", False), ("the node", False)],
)  # fmt: skip
def test_the_words_are_found(line, bad):
    assert bool(house_words(line)) is bad
