"""Pack and unpack the inputs that the fuzz targets keep: one file a target, inputs/TARGET.hex, a line each.

    python3 tests/fuzz/inputs.py unpack TARGET FOLDER    write each input into a file of FOLDER
    python3 tests/fuzz/inputs.py pack TARGET FOLDER      make the files of FOLDER the corpus of TARGET

A line is a name, a space, the bytes in hexadecimal. The name is `corpus` for what a search starts from; any other says what
once broke something, and `pack` leaves it."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

INPUTS = Path(__file__).resolve().parent / "inputs"
CORPUS = "corpus"


def read(target: str) -> list[tuple[str, bytes]]:
    """Return name and bytes of each input that is kept of a target."""
    path = INPUTS / f"{target}.hex"
    lines = path.read_text(encoding="ascii").splitlines() if path.exists() else []
    return [(name, bytes.fromhex(data)) for name, _, data in (line.partition(" ") for line in lines)]


def found(target: str) -> list[tuple[str, bytes]]:
    """Return name and bytes of each input that once broke a target."""
    return [(name, data) for name, data in read(target) if name != CORPUS]


def unpack(target: str, folder: Path) -> None:
    """Write each input into a file, named as libFuzzer names it."""
    folder.mkdir(parents=True, exist_ok=True)
    for _, data in read(target):
        (folder / hashlib.sha1(data).hexdigest()).write_bytes(data)


def pack(target: str, folder: Path) -> None:
    """Write the files of a folder as the corpus of a target; keep what once broke it."""
    given = [(CORPUS, p.read_bytes()) for p in sorted(folder.iterdir())]
    lines = [f"{name} {data.hex()}\n" for name, data in given + found(target)]
    (INPUTS / f"{target}.hex").write_text("".join(lines), encoding="ascii")


if __name__ == "__main__":
    {"unpack": unpack, "pack": pack}[sys.argv[1]](sys.argv[2], Path(sys.argv[3]))
