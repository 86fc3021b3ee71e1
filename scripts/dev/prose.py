"""Wrap the prose of Markdown files at 90 columns: paragraphs and list items.

    .venv/bin/python scripts/dev/prose.py
        change the files
    .venv/bin/python scripts/dev/prose.py --check
        change nothing; fail and name the files that would change

Tables, headings, code, HTML, front matter and text written by scripts/docsite/fill.py
stay.
"""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WIDTH = 90
LEFT_ALONE = ("scripts/results/", "docs/pages/results/")  # written by studies
ITEM = re.compile(r"(\s*)([-*+]|\d+[.)])(\s+)(?=\S)")
ATOM = re.compile(r"`[^`]*`|!?\[[^\]]*\]\([^)\s]*\)|\$[^$]+\$|\S")
MARKUP = re.compile(r"(?:[-+*]|#{1,6}|\d+[.)]|=+|!!!|\?{3}|:::)$|[>|]|~~~|```")  # not at the head of a line
WHOLE = re.compile(r"\s*(\||#|<|>|!!!|\?\?\?|:::|\[[^\]]+\]:|---|===|\$\$)")  # lines without prose


def split_words(text: str) -> list[str]:
    """Split at spaces, but not within code, links and formulas."""
    words, last = [], 0
    for atom in ATOM.finditer(text):
        if words and atom.start() == last:
            words[-1] += atom.group()
        else:
            words.append(atom.group())
        last = atom.end()
    return words


def wrap(text: str, first: str, rest: str) -> list[str]:
    """Fill lines of at most WIDTH columns; `first` and `rest` are the indents."""
    lines, line = [], first
    for word in split_words(text):
        begins = line in (first, rest)
        if begins:
            line += word
        elif len(line) + 1 + len(word) > WIDTH and not MARKUP.match(word):
            lines.append(line)
            line = rest + word
        else:
            line += " " + word
    return [*lines, line]


def find_end(line: str, is_first: bool) -> str:
    """Return the last line of a part that stays and starts here, or ""."""
    stripped = line.strip()
    if stripped.startswith(("```", "~~~")):
        return stripped[:3]
    if re.match(r"<!-- (table|code): ", stripped):
        return "<!-- end -->"
    if stripped.startswith("$$") and not stripped.endswith("$$", 2):
        return "$$"
    return "---" if is_first and stripped == "---" else ""


def read_blocks(lines: list[str]) -> Iterator[tuple[bool, list[str]]]:
    """Yield (is_prose, lines) of a paragraph, a list item, or a line that stays."""
    end = ""
    block: list[str] = []
    for i, line in enumerate(lines):
        if end:
            yield False, [line]
            if line.strip().endswith(end):
                end = ""
            continue
        end = find_end(line, is_first=not i)
        is_code = not block and line.startswith("    ") and not ITEM.match(line)
        stays = bool(end) or not line.strip() or bool(WHOLE.match(line)) or is_code
        if block and (stays or ITEM.match(line)):
            yield True, block
            block = []
        if stays:
            yield False, [line]
        else:
            block.append(line)
    if block:
        yield True, block


def wrap_prose(text: str) -> str:
    """Return a Markdown text whose paragraphs and list items are filled to WIDTH."""
    made: list[str] = []
    for prose, block in read_blocks(text.split("\n")):
        if not prose or any(line.endswith(("  ", "\\")) for line in block):
            made += block
            continue
        item = ITEM.match(block[0])
        first = item.group() if item else block[0][: len(block[0]) - len(block[0].lstrip())]
        rest = " " * len(first) if item else first
        if item and len(block) > 1:
            rest = block[1][: len(block[1]) - len(block[1].lstrip())]
        body = " ".join([block[0][len(first) :].strip(), *(line.strip() for line in block[1:])])
        made += wrap(body, first, rest)
    return "\n".join(made)


def find_pages() -> list[Path]:
    """Return the Markdown files of the repository that people write."""
    names = subprocess.run(["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True)
    return [ROOT / n for n in names.stdout.split() if not n.startswith(LEFT_ALONE)]


def main() -> int:
    """Wrap the pages, or check them."""
    wrong = []
    for page in find_pages():
        before = page.read_text(encoding="utf-8")
        after = wrap_prose(before)
        if after != before:
            wrong.append(page.relative_to(ROOT).as_posix())
            if "--check" not in sys.argv:
                page.write_text(after, encoding="utf-8")
    if wrong and "--check" in sys.argv:
        print("prose that is not wrapped (scripts/dev/format.sh):", *wrong, sep="\n  ", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
