#!/usr/bin/env python3
"""tse as two files, tse.h and tse.c; in which builds: scripts/dropin/README.md.

    python3 scripts/dev/amalgamate.py --out FOLDER                              tse.h, tse.c, LICENSE, NOTICE
    python3 scripts/dev/amalgamate.py --out FOLDER --real float --no-effects    what both files have as default

The files and the order in which they stand are those of src/CMakeLists.txt. What another file of the library calls, and no user,
becomes static: only the public API is visible. The options of
CMakeLists.txt are macros: TSE_REAL_FLOAT, TSE_REAL_FIXED, TSE_MAX_PARTICLES, TSE_LATENCY_ROWS, TSE_NO_EFFECTS,
TSE_NO_PARTICLES, TSE_FORMULA; and TSE_NO_DESCRIBE, because in one file no linker leaves out what nobody asks for.
The same sources and options give the same bytes. Needs Python only.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FORMATS = ("double", "float", "fixed")
INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]+"([^"]+)"[^\n]*\n', re.M)
C_PLUS_PLUS = re.compile(r'^#ifdef __cplusplus\n(?:extern "C" \{|\})\n#endif\n', re.M)
FORMATTER = re.compile(r"^ *// clang-format o(?:n|ff).*\n", re.M)  # marks of tables
ALIAS = re.compile(r"^#define (\w+) +TSE_NAME\(\w+\)\n", re.M)
TOKEN = re.compile(
    r"""(?P<space>\s+|/\*.*?\*/|//[^\n]*|\\\n)
    |(?P<directive>(?:(?<=\n)|\A)[ \t]*\#(?:/\*.*?\*/|\\\n|[^\n])*)
    |(?P<text>"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*')
    |(?P<word>[A-Za-z_]\w*)
    |(?P<number>\.?\d(?:[eEpP][+-]|[\w.])*)
    |(?P<mark>->|.)""",
    re.S | re.X,
)


class Wrong(Exception):
    """What the sources have and this script does not know."""


# ---- what the build says of the sources


@dataclass
class Sources:
    """src/CMakeLists.txt: files in order of dependency, and which of them a build without effects leaves out."""

    files: list[str]
    with_effects: set[str]
    version: str

    @staticmethod
    def read() -> Sources:
        cmake = (ROOT / "src" / "CMakeLists.txt").read_text()
        listed = re.search(r"add_library\(tse\s([^)]*)\)", cmake)
        left_out = re.search(r"set_source_files_properties\(([^)]*) PROPERTIES HEADER_FILE_ONLY ON\)", cmake)
        version = re.search(r'TSE_VERSION "([^"]+)"', (ROOT / "include/tse/version.h").read_text())
        if not (listed and left_out and version):
            raise Wrong("src/CMakeLists.txt or include/tse/version.h: not of the form that is read here")
        return Sources(re.sub(r"#.*", "", listed[1]).split(), set(left_out[1].split()), version[1])


# ---- C, as far as it has to be understood


@dataclass
class Token:
    kind: str
    text: str
    at: int


def tokens(text: str) -> Iterator[Token]:
    for m in TOKEN.finditer(text):
        yield Token(str(m.lastgroup), m[0], m.start())


@dataclass
class Declaration:
    """At file scope. names: what it makes known; function: its name, when it is one; shared: a variable that is not static."""

    at: int
    static: bool
    function: str = ""
    shared: bool = False
    names: list[str] = field(default_factory=list)


def declarations(text: str) -> Iterator[Declaration]:
    row: list[Token] = []
    depth = 0
    body = False
    for t in tokens(text):
        if t.kind in ("space", "directive"):
            continue
        if t.text == "{" and depth == 0:
            body = bool(row) and row[-1].text == ")"
        row.append(t)
        depth += (t.text in "([{") - (t.text in ")]}") if t.kind == "mark" else 0
        if depth == 0 and (t.text == ";" or (t.text == "}" and body)):
            yield declared(row)
            row, body = [], False
    if row:
        raise Wrong(f"no end of the declaration at '{' '.join(t.text for t in row[:8])}'")


def declared(row: list[Token]) -> Declaration:
    words = [t.text for t in row if t.text != "__extension__"]
    static = words[0] in ("static", "TSE_INLINE")
    d = Declaration(row[0].at, static)
    if words[0] == "typedef" or "enum" in words[:2] or ("{" in words[:4] and words[0] in ("struct", "union")):
        if words[1] in ("struct", "union", "enum") and row[2].kind == "word":
            d.names.append(words[2])
        if words[0] == "typedef":
            d.names.append(words[words.index("[") - 1] if words[-2] == "]" else words[-2])
        if "enum" in words[:2]:
            d.names += [w.text for before, w in pairwise(row) if before.text in "{," and w.kind == "word"]
        return d
    until = next(
        i for i, w in enumerate(words) if w in ("(", "=", "[", ";") and words[i - 1] != "__attribute__"
    )
    if words[until] == "(":
        d.function = words[until - 1]
    d.shared = not static and not d.function
    d.names.append(words[until - 1])
    return d


def defined_macros(text: str) -> list[str]:
    """Names that are still macros at the end of this text, as far as it says so; in the order of their definition."""
    left: dict[str, None] = {}
    for what, name in re.findall(r"^[ \t]*#[ \t]*(define|undef)[ \t]+(\w+)", text, re.M):
        if what == "define":
            left[name] = None
        else:
            left.pop(name, None)
    return list(left)


def renamed(text: str, names: dict[str, str]) -> str:
    """text with other names for some identifiers; members of structs keep theirs."""
    out: list[str] = []
    before = ""
    for t in tokens(text):
        if t.kind == "directive":
            out.append(re.sub(r"(?<![\w.>\"])[A-Za-z_]\w*", lambda m: names.get(m[0], m[0]), t.text))
            continue
        out.append(names.get(t.text, t.text) if t.kind == "word" and before not in (".", "->") else t.text)
        if t.kind != "space":
            before = t.text
    return "".join(out)


def made_static(text: str, public: set[str]) -> str:
    """Functions that are not public, declared and defined, and variables become static. The file that defines a variable
    stands before those that use it: its declaration goes, which C++ would take for a second definition."""
    found = list(declarations(text))
    places = [d.at for d in found if d.shared or (d.function and not d.static and d.function not in public)]
    for at in reversed(places):
        if text.startswith("extern ", at):
            text = text[:at] + text[text.index(";", at) + 1 :].lstrip(" ")
        else:
            text = text[:at] + "static " + text[at:]
    return text


# ---- the two files


class Amalgamation:
    def __init__(self, defaults: dict[str, str]) -> None:
        self.sources = Sources.read()
        self.defaults = defaults
        self.header_done: set[str] = set()

    # -- tse.h

    def public_header(self, name: str) -> str:
        """A header of include/tse with what it includes, once; its own guard stays, for programs that include tse/tse.h, too."""
        if name in self.header_done:
            return ""
        self.header_done.add(name)
        text = FORMATTER.sub("", (ROOT / "include" / name).read_text())

        def put(m: re.Match[str]) -> str:
            if not m[1].startswith("tse/"):  # a test's own number type, which takes the place of tse_real
                return '#error "TSE_REAL_STRONG is for the tests of the library\'s own sources"\n'
            return self.public_header(m[1])

        return f"\n{INCLUDE.sub(put, text)}"

    def header(self) -> str:
        only_with_effects = {f"tse/{Path(x).stem}.h" for x in self.sources.with_effects}
        there = sorted(f"tse/{p.name}" for p in (ROOT / "include/tse").glob("*.h"))
        text = self.public_header("tse/tse.h")
        for name in there:
            if name not in only_with_effects:
                text += self.public_header(name)
        text += "\n#if !defined(TSE_NO_EFFECTS)\n"
        text += "".join(self.public_header(name) for name in there if name in only_with_effects)
        text += "\n#endif /* TSE_NO_EFFECTS */\n"
        return self.about("tse.h", HOW_TO_USE) + self.chosen() + text

    def chosen(self) -> str:
        """What --real and its like make the default; a macro of the user's has precedence."""
        lines = []
        if "real" in self.defaults:
            formats = " && ".join(f"!defined(TSE_REAL_{x.upper()})" for x in FORMATS)
            lines += [f"#if {formats}", f"#define TSE_REAL_{self.defaults['real'].upper()} 1", "#endif"]
        for name, value in self.defaults.items():
            if name.startswith("TSE_"):
                lines += [f"#if !defined({name})", f"#define {name} {value}", "#endif"]
        return "".join(
            f"{x}\n" for x in (["", "/* How amalgamate.py was called. */", *lines] if lines else [])
        )

    # -- tse.c

    def source(self) -> str:
        headers = [without_c_plus_plus(p) for p in (ROOT / "include/tse").glob("*.h")]
        public = {d.function for text in headers for d in declarations(text) if d.function}
        parts = self.parts()
        new_names = clashes(parts)
        text = ""
        for name, whole in parts.items():
            own = made_static(renamed(whole, new_names[name]), public)
            whole = self.part(name, own)
            if name.endswith(".c"):
                whole += "".join(f"#undef {macro}\n" for macro in defined_macros(own))
            if name in self.sources.with_effects:
                whole = f"\n#if !defined(TSE_NO_EFFECTS)\n{whole}\n#endif /* TSE_NO_EFFECTS */\n"
            if re.fullmatch(r"paper/.*\.c", name):
                whole = f"\n#if !defined(TSE_NO_PARTICLES)\n{whole}\n#endif /* TSE_NO_PARTICLES */\n"
            if name == "host/describe.c":  # in one file with the rest no linker can drop its texts
                whole = f"\n#if !defined(TSE_NO_DESCRIBE)\n{whole}\n#endif /* TSE_NO_DESCRIBE */\n"
            text += whole
        return self.about("tse.c", "") + PROLOGUE + text

    def parts(self) -> dict[str, str]:
        """The files of src in their order. What has no guard is part of the file that includes it: what it needs stands above that
        place only. A static function needs neither extern "C" nor a name that tells the number format."""
        texts = {name: without_c_plus_plus(ROOT / "src" / name) for name in self.sources.files}
        fragments = {
            name: text for name, text in texts.items() if name.endswith(".h") and "#ifndef" not in text
        }

        def put(m: re.Match[str]) -> str:
            return INCLUDE.sub(put, fragments[m[1]]) if m[1] in fragments else m[0]

        return {
            name: INCLUDE.sub(put, ALIAS.sub("", text))
            for name, text in texts.items()
            if name not in fragments
        }

    def part(self, name: str, text: str) -> str:
        """One file. Headers stand above it in any case."""

        def put(m: re.Match[str]) -> str:
            return m[0] if m[1] == "tse_formula.h" else ""  # which the user has tselab write

        return f"\n/* ======== {name} */\n\n{INCLUDE.sub(put, text)}"

    def about(self, name: str, more: str) -> str:
        return ABOUT.format(name=name, version=self.sources.version) + more + " */\n"


def clashes(parts: dict[str, str]) -> dict[str, dict[str, str]]:
    """Of each file: names that two files have for different things, and what they become in it: factor of host/simulate.c is
    simulate_factor. Another file means the one that it includes, over however many headers."""
    owners: dict[str, set[str]] = {}
    for name, text in parts.items():
        own = {
            x
            for d in declarations(text)
            for x in d.names
            if d.static or not (d.function or d.shared) or name.endswith(".h")
        }
        for x in own | (set(defined_macros(text)) if name.endswith(".h") else set()):
            owners.setdefault(x, set()).add(name)
    included = {name: [x for x in INCLUDE.findall(text) if x in parts] for name, text in parts.items()}
    seen: dict[str, set[str]] = {}
    for name in parts:  # a file includes only what stands before it
        seen[name] = {name}.union(*(seen[x] for x in included[name]))
    new: dict[str, dict[str, str]] = {name: {} for name in parts}
    for x, of in sorted(owners.items()):
        for name in parts if len(of) > 1 else ():
            meant = sorted(of & seen[name])
            if len(meant) > 1:
                raise Wrong(f"{name}: {x} is of {' and '.join(meant)}")
            for path in map(Path, meant):
                folders = {Path(n).parent for n in parts if Path(n).stem == path.stem}
                new[name][x] = (
                    f"{path.stem}_{x}" if len(folders) == 1 else f"{path.parent.name}_{path.stem}_{x}"
                )
    return new


def without_c_plus_plus(path: Path) -> str:
    """Static functions need no extern "C", and public ones have it from tse.h."""
    return FORMATTER.sub("", C_PLUS_PLUS.sub("", path.read_text()))


ABOUT = """\
/* {name} - tse {version}, a tyre-stiffness estimator, in two files: tse.h and tse.c. Written by scripts/dev/amalgamate.py, not by hand.
 *
 * Copyright the tse authors. Licensed under the Apache License, Version 2.0: see LICENSE and NOTICE, which belong to these files.
 * SPDX-License-Identifier: Apache-2.0
"""

HOW_TO_USE = """\
 *
 * Compile tse.c as C99 along with your program, with optimisation, and link sqrt (-lm). Options are macros; tse.c and whoever
 * includes tse.h need the same ones, because they change the layout of the structs:
 *   TSE_REAL_DOUBLE (default), TSE_REAL_FLOAT, TSE_REAL_FIXED   number format; names of another format do not link
 *   TSE_MAX_PARTICLES=512, TSE_LATENCY_ROWS=32   capacities; RAM grows with each
 *   TSE_NO_EFFECTS                                            without effects beyond the plain model, simulator and replay
 *   TSE_NO_VELOCITY                                           without measured velocities, 1.9 kB of RAM in float
 *   TSE_NO_PARTICLES                                          without the paper's form, 12 kB of flash
 *   TSE_SMALL                                                 with both of these: lateral motion alone, 14 states for 23
 *   TSE_NO_DESCRIBE                                           without tse_describe(): names, units and texts, 36 kB of flash
 *   TSE_FORMULA                                               tse.c includes tse_formula.h, which `tselab formula` writes
 * Not with -ffast-math: what is missing is NaN.
"""

PROLOGUE = """
#if defined(TSE_STATE_H)
#error "tse.c is compiled by itself: nothing includes tse.h before it"
#endif
#define TSE_INTERNALS
#include "tse.h"

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "compile tse.c without -ffast-math and -ffinite-math-only: a missing channel is NaN, and sums have one order"
#endif

/* a*b + c rounds twice on every machine, whatever the flags: the same bits with and without a fused multiply-add. gcc fuses unless
 * it is given a standard (-std=c99), clang where both stand in one expression. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__) && !defined(__STRICT_ANSI__)
#pragma GCC optimize("fp-contract=off")
#endif

/* Which of the small functions are called depends on the number format. */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-function"
#endif
"""


# ---- files


def make(out: Path, defaults: dict[str, str]) -> None:
    """Write tse.h and tse.c into the folder `out`, which is made where it is missing. What else is in it stays."""
    amalgamation = Amalgamation(defaults)
    texts = {"tse.h": amalgamation.header(), "tse.c": amalgamation.source()}
    texts |= {name: (ROOT / name).read_text(encoding="utf-8") for name in ("LICENSE", "NOTICE")}
    out.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (out / name).write_text(text, encoding="utf-8", newline="\n")


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    parser.add_argument("--real", choices=FORMATS, help="number format where no macro says another (double)")
    parser.add_argument("--max-particles", type=int, help="16 .. 65535 (512)")
    parser.add_argument("--latency-rows", type=int, help="8 .. 1024 (32), or 0: no channel is late")
    parser.add_argument(
        "--no-effects", action="store_true", help="no effects beyond the plain model, no simulator, no replay"
    )
    a = parser.parse_args()
    for name, lo, hi in (("max_particles", 16, 65535), ("latency_rows", 8, 1024)):
        value = getattr(a, name)
        if value is not None and not lo <= value <= hi and not (name == "latency_rows" and value == 0):
            parser.error(f"--{name.replace('_', '-')} must lie in {lo} .. {hi}")
    capacities = {"TSE_MAX_PARTICLES": a.max_particles, "TSE_LATENCY_ROWS": a.latency_rows}
    defaults = {"real": a.real, **capacities}
    defaults = {name: str(value) for name, value in defaults.items() if value is not None}
    if a.no_effects:
        defaults["TSE_NO_EFFECTS"] = "1"
    try:
        make(a.out, defaults)
    except Wrong as wrong:
        print(f"amalgamate.py: {wrong}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
