"""Draw random comments, docstrings and messages for a reader who does not know the code.

    .venv/bin/python scripts/dev/read_once.py [--count N] [--seed N] [--screen]
        [--skip SEED ...]

Prints N places of the sources, each with the lines of code around it: a few lines, or
with --screen about as many as a screen shows. The reader says in one sentence what each
text means, and whether it had to be read twice. --skip leaves out the places that earlier
calls with these seeds have drawn. To find them, the script draws them again, so --count
and the sources must be the same as in the earlier calls.
"""

import argparse
import ast
import random
import re
import subprocess
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("include", "src", "fmu", "scripts")  # folders from which texts are drawn
SHORTEST = 40  # min number of characters of a text; shorter texts are too easy
AROUND = 6  # number of lines of code that are shown after a text
SCREEN = 25  # number of lines that --screen shows before and after a text
# A call is a message if the name of the called function ends in one of these words
ERRORS = re.compile(r"(Error|note|warn|print|say)$")


@dataclass(frozen=True)
class Place:
    """The place of a text in the sources."""

    file: str
    line: int  # first line
    last: int  # last line
    kind: str  # comment, docstring or message


def list_files(*suffixes: str) -> list[Path]:
    """Return the files in git with one of these suffixes."""
    done = subprocess.run(["git", "ls-files", *ROOMS], cwd=ROOT, check=True, capture_output=True, text=True)
    return [ROOT / name for name in done.stdout.split() if name.endswith(suffixes)]


def find_c_comments(path: Path, text: str) -> Iterator[Place]:
    """Yield the block comments of a C file."""
    name = str(path.relative_to(ROOT))
    for found in re.finditer(r"/\*.*?\*/", text, flags=re.S):
        if len(found[0]) >= SHORTEST:
            line = text.count("\n", 0, found.start()) + 1
            yield Place(name, line, line + found[0].count("\n"), "comment")


def find_hash_comments(path: Path, text: str) -> Iterator[Place]:
    """Yield the comments of a Python file.

    A line that has only a comment belongs to the comment on the line above it, if any."""
    name = str(path.relative_to(ROOT))
    lines = text.splitlines()
    starts: list[tuple[int, int, int]] = []
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            if token.type != tokenize.COMMENT:
                continue
            row, column = token.start
            if starts and starts[-1][1] == row - 1 and not lines[row - 1][:column].strip():
                starts[-1] = (starts[-1][0], row, starts[-1][2] + len(token.string))
            else:
                starts.append((row, row, len(token.string)))
    for first, last, length in starts:
        if length >= SHORTEST:
            yield Place(name, first, last, "comment")


def find_docstrings_and_messages(path: Path, text: str) -> Iterator[Place]:
    """Yield the docstrings of a Python file, and the calls that make a message."""
    name = str(path.relative_to(ROOT))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef, ast.Module)):
            said = node.body[0] if node.body and ast.get_docstring(node) else None
            if said is not None:
                yield Place(name, said.lineno, said.end_lineno or said.lineno, "docstring")
        elif isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            if ERRORS.search(called) and len(ast.unparse(node)) >= len(called) + SHORTEST:
                yield Place(name, node.lineno, node.end_lineno or node.lineno, "message")


def find_places() -> list[Place]:
    """Return every comment, docstring and message of all files.

    C files come first, then Python files, both in alphabetical order."""
    found: list[Place] = []
    for path in list_files(".c", ".h"):
        found += find_c_comments(path, path.read_text(encoding="utf-8"))
    for path in list_files(".py"):
        text = path.read_text(encoding="utf-8")
        found += find_hash_comments(path, text)
        found += find_docstrings_and_messages(path, text)
    return found


def draw_places(places: list[Place], count: int, seed: int) -> list[Place]:
    """Return `count` random places."""
    return random.Random(seed).sample(places, count)


def format_place(number: int, place: Place, screen: bool = False) -> str:
    """Return the text at a place, with some lines before and after it, in Markdown."""
    lines = (ROOT / place.file).read_text(encoding="utf-8").splitlines()
    before, after = (3 if place.kind == "docstring" else 1), AROUND
    if screen:
        before = after = SCREEN
    shown = lines[max(place.line - 1 - before, 0) : place.last + after]
    head = f"## {number}. {place.kind}, {place.file}, lines {place.line} to {place.last}"
    return "\n".join([head, "", *("    " + line for line in shown), ""])


def main() -> None:
    """Draw and print the places."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=40, help="number of places (40)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the random numbers (1)")
    parser.add_argument(
        "--skip", type=int, nargs="*", default=[], metavar="SEED", help="leave out the places of these seeds"
    )
    parser.add_argument("--screen", action="store_true", help=f"show {SCREEN} lines before and after")
    args = parser.parse_args()
    places = find_places()
    known = {p for seed in args.skip for p in draw_places(places, args.count, seed)}
    drawn = draw_places([p for p in places if p not in known], args.count, args.seed)
    print(f"{len(drawn)} of {len(places)} places, seed {args.seed}\n")
    for number, place in enumerate(drawn, 1):
        print(format_place(number, place, args.screen))


if __name__ == "__main__":
    main()
