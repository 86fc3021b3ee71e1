"""Wrap the paragraphs and list items of Markdown files at 90 columns.

    .venv/bin/python scripts/dev/prose.py
        change the files
    .venv/bin/python scripts/dev/prose.py --check
        change nothing; fail if a file would change, and name it

Tables, headings, code, HTML, front matter and the blocks that scripts/docsite/fill.py
writes are not changed.
"""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WIDTH = 90
LEFT_ALONE = ("scripts/results/", "docs/pages/results/")  # files in these folders are generated
ITEM = re.compile(r"(\s*)([-*+]|\d+[.)])(\s+)(?=\S)")  # start of a list item
ATOM = re.compile(r"`[^`]*`|!?\[[^\]]*\]\([^)\s]*\)|\$[^$]+\$|\S")  # code, link or formula, or a character
# Words that must not begin a line, because Markdown would read them as markup there: "-"
# begins a list, "#" a heading. No line is broken before such a word.
MARKUP = re.compile(r"(?:[-+*]|#{1,6}|\d+[.)]|=+|!!!|\?{3}|:::)$|[>|]|~~~|```")
WHOLE = re.compile(
    r"\s*(\||#|<|>|!!!|\?\?\?|:::|\[[^\]]+\]:|---|===|\$\$)"
)  # start of a line that is not prose


def split_words(text: str) -> list[str]:
    """Split a text at spaces, but not within code, links and formulas."""
    words, last = [], 0
    for atom in ATOM.finditer(text):
        if words and atom.start() == last:
            words[-1] += atom.group()
        else:
            words.append(atom.group())
        last = atom.end()
    return words


def wrap(text: str, first: str, rest: str) -> list[str]:
    """Return a text in lines of at most WIDTH columns.

    `first`: indent of the first line, with the mark of a list item ("- ") if it has one.
    `rest`: indent of the following lines."""
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
    """If this line starts a part that is not prose, return the mark that ends the part.

    For example, a line "```c" starts a code block, which ends with "```". If the line
    does not start such a part, return "". `is_first`: True if it is line 1 of the
    file."""
    stripped = line.strip()
    if stripped.startswith(("```", "~~~")):
        return stripped[:3]
    if re.match(r"<!-- (table|code): ", stripped):
        return "<!-- end -->"
    if stripped.startswith("$$") and not stripped.endswith("$$", 2):
        return "$$"
    return "---" if is_first and stripped == "---" else ""


def read_blocks(lines: list[str]) -> Iterator[tuple[bool, list[str]]]:
    """Yield the parts of a page as pairs (is_prose, lines).

    A part is a paragraph, a list item, or a line that is not prose."""
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
    """Return a Markdown text with its paragraphs and list items wrapped at WIDTH."""
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
    """Return the Markdown files in git, except generated ones (LEFT_ALONE).

    Without git, or outside a checkout, return an empty list and print why."""
    command = ["git", "-c", "safe.directory=*", "ls-files", "*.md"]
    try:
        names = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        print("prose: skipped: git is not installed, or this is not a checkout")
        return []
    return [ROOT / n for n in names.stdout.split() if not n.startswith(LEFT_ALONE)]


def main() -> int:
    """Wrap all pages, or check that they are wrapped."""
    wrong = []
    for page in find_pages():
        before = page.read_text(encoding="utf-8")
        after = wrap_prose(before)
        if after != before:
            wrong.append(page.relative_to(ROOT).as_posix())
            if "--check" not in sys.argv:
                page.write_text(after, encoding="utf-8")
    if wrong and "--check" in sys.argv:
        print("not wrapped at 90 columns; run scripts/dev/format.sh:", *wrong, sep="\n  ", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
