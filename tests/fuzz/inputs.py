"""Pack and unpack the inputs that the fuzz targets keep: inputs.hex, one per line.

    python3 tests/fuzz/inputs.py unpack TARGET FOLDER
        write each input into a file of FOLDER
    python3 tests/fuzz/inputs.py pack TARGET FOLDER
        make the files of FOLDER the corpus of TARGET

A line has target, name, and the bytes in hexadecimal, separated by spaces. The name
`corpus` marks the inputs that a search starts from. Another name states what an input
once broke, and `pack` keeps these inputs.
"""

import hashlib
import sys
from pathlib import Path

INPUTS = Path(__file__).resolve().parent / "inputs.hex"
CORPUS = "corpus"


def read_lines() -> list[list[str]]:
    """Return target, name and digits of each input."""
    return [line.split(" ") for line in INPUTS.read_text(encoding="ascii").splitlines()]


def read(target: str) -> list[tuple[str, bytes]]:
    """Return name and bytes of each input that is kept of a target."""
    return [(name, bytes.fromhex(data)) for of, name, data in read_lines() if of == target]


def read_found(target: str) -> list[tuple[str, bytes]]:
    """Return name and bytes of each input that once broke a target."""
    return [(name, data) for name, data in read(target) if name != CORPUS]


def unpack(target: str, folder: Path) -> None:
    """Write each input into a file, named as libFuzzer names it."""
    folder.mkdir(parents=True, exist_ok=True)
    for _, data in read(target):
        (folder / hashlib.sha1(data).hexdigest()).write_bytes(data)


def pack(target: str, folder: Path) -> None:
    """Write the files of a folder as the corpus of a target; keep what once broke it."""
    kept = [line for line in read_lines() if line[:2] != [target, CORPUS]]
    given = [[target, CORPUS, p.read_bytes().hex()] for p in sorted(folder.iterdir())]
    rows = sorted(given + kept, key=lambda line: (line[0], line[1] != CORPUS))
    INPUTS.write_text("".join(" ".join(row) + "\n" for row in rows), encoding="ascii")


if __name__ == "__main__":
    {"unpack": unpack, "pack": pack}[sys.argv[1]](sys.argv[2], Path(sys.argv[3]))
