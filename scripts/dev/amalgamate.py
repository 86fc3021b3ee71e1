#!/usr/bin/env python3
"""Write the C library as two files, tse.h and tse.c, for users without CMake.

    python3 scripts/dev/amalgamate.py --out FOLDER
        write tse.h, tse.c, LICENSE, NOTICE
    python3 scripts/dev/amalgamate.py --out FOLDER --real float --no-effects
        write the same files, but tse.h selects float unless the user defines another
        number format, and leaves out effects (deviations of a car from the plain model),
        simulator and replay

scripts/dropin/README.md describes how to compile the two files. tse.c contains the files
of src, in the order of src/CMakeLists.txt. In tse.c, each function or variable that is
not part of the public API is static.

Users of the two files select the options of the library by macros: TSE_REAL_FLOAT,
TSE_REAL_FIXED, TSE_MAX_PARTICLES, TSE_LATENCY_ROWS, TSE_NO_EFFECTS, TSE_NO_VELOCITY,
TSE_NO_PARTICLES, TSE_SMALL, TSE_FORMULA. CMake has an option for each of these. Only the
macro TSE_NO_DESCRIBE has none: it removes the tables of names and texts. With CMake,
these tables are an object file, which the linker leaves out if no table is used.

The same sources and options give the same bytes. The script needs Python only.
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
FORMATTER = re.compile(r"^ *// clang-format o(?:n|ff).*\n", re.M)  # comments to clang-format
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
    """The script cannot read a source. The message names the file or declaration."""


# ---- sources, as listed by the build


@dataclass
class Sources:
    """Source files and version of the library."""

    files: list[str]  # files of src, each after the files that it needs
    with_effects: set[str]  # files that CMake compiles only with TSE_EFFECTS=ON
    version: str

    @staticmethod
    def read() -> Sources:
        """Read the lists of files in src/CMakeLists.txt, and the version."""
        cmake = (ROOT / "src" / "CMakeLists.txt").read_text()
        listed = re.search(r"add_library\(tse\s([^)]*)\)", cmake)
        left_out = re.search(r"set_source_files_properties\(([^)]*) PROPERTIES HEADER_FILE_ONLY ON\)", cmake)
        version = re.search(r'TSE_VERSION "([^"]+)"', (ROOT / "include/tse/version.h").read_text())
        if not (listed and left_out and version):
            raise Wrong(
                "src/CMakeLists.txt or include/tse/version.h: a list of files or the version is not found"
            )
        return Sources(re.sub(r"#.*", "", listed[1]).split(), set(left_out[1].split()), version[1])


# ---- a minimal reader of C


@dataclass
class Token:
    """A token of C."""

    kind: str  # name of a group in TOKEN
    text: str
    at: int  # index of the token's first character in the source


def read_tokens(text: str) -> Iterator[Token]:
    """Yield the tokens of a C source. Spaces, comments and directives are tokens, too."""
    for m in TOKEN.finditer(text):
        yield Token(str(m.lastgroup), m[0], m.start())


@dataclass
class Declaration:
    """A declaration at file scope."""

    at: int  # index of its first character in the source
    static: bool
    function: str = ""  # name of the function that it declares; "": it declares no function
    shared: bool = False  # True: it declares a variable that is not static
    names: list[str] = field(default_factory=list)  # all names that it declares


def find_declarations(text: str) -> Iterator[Declaration]:
    """Yield the declarations at file scope of a C source."""
    row: list[Token] = []
    depth = 0
    body = False
    for t in read_tokens(text):
        if t.kind in ("space", "directive"):
            continue
        if t.text == "{" and depth == 0:
            body = bool(row) and row[-1].text == ")"
        row.append(t)
        depth += (t.text in "([{") - (t.text in ")]}") if t.kind == "mark" else 0
        if depth == 0 and (t.text == ";" or (t.text == "}" and body)):
            yield parse_declaration(row)
            row, body = [], False
    if row:
        raise Wrong(f"the declaration that begins with '{' '.join(t.text for t in row[:8])}' does not end")


def parse_declaration(row: list[Token]) -> Declaration:
    """Return the declaration that consists of these tokens."""
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


def find_macros(text: str) -> list[str]:
    """Return the macros that a source defines and does not undefine later.

    The macros are in the order of their definitions. #if and #else are ignored: each
    #define and each #undef counts, even in a branch that is not compiled.
    """
    left: dict[str, None] = {}
    for what, name in re.findall(r"^[ \t]*#[ \t]*(define|undef)[ \t]+(\w+)", text, re.M):
        if what == "define":
            left[name] = None
        else:
            left.pop(name, None)
    return list(left)


def rename_words(text: str, names: dict[str, str]) -> str:
    """Rename identifiers of a source. Members of structs keep their names.

    `names`: new name of each identifier."""
    out: list[str] = []
    before = ""
    for t in read_tokens(text):
        if t.kind == "directive":
            out.append(re.sub(r"(?<![\w.>\"])[A-Za-z_]\w*", lambda m: names.get(m[0], m[0]), t.text))
            continue
        out.append(names.get(t.text, t.text) if t.kind == "word" and before not in (".", "->") else t.text)
        if t.kind != "space":
            before = t.text
    return "".join(out)


def make_static(text: str, public: set[str]) -> str:
    """Make all variables static, and all functions except `public`. Return the source.

    `extern` declarations of variables are removed. They are not needed, because in tse.c
    the definition of a variable stands above its uses. With `static` instead of `extern`,
    a declaration would be a second definition, which C++ does not allow.
    """
    found = list(find_declarations(text))
    places = [d.at for d in found if d.shared or (d.function and not d.static and d.function not in public)]
    for at in reversed(places):
        if text.startswith("extern ", at):
            text = text[:at] + text[text.index(";", at) + 1 :].lstrip(" ")
        else:
            text = text[:at] + "static " + text[at:]
    return text


# ---- the two files


class Amalgamation:
    """Makes the texts of tse.h and tse.c.

    `defaults`: values of macros that tse.h defines if the user does not. Key: name of the
    macro, or "real" for the number format."""

    def __init__(self, defaults: dict[str, str]) -> None:
        self.sources = Sources.read()
        self.defaults = defaults
        self.header_done: set[str] = set()

    # -- tse.h

    def copy_public_header(self, name: str) -> str:
        """Return a header of include/tse, with the headers that it includes inserted.

        A header that is already part of tse.h is not inserted again. The include guards
        are kept. If a program includes tse.h and then tse/tse.h of the library, the
        guards prevent a second declaration of the same names.
        """
        if name in self.header_done:
            return ""
        self.header_done.add(name)
        text = FORMATTER.sub("", (ROOT / "include" / name).read_text())

        def put(m: re.Match[str]) -> str:
            if not m[1].startswith("tse/"):  # strong_real.hpp: a number type for tests only
                return '#error "TSE_REAL_STRONG is for the tests of the library\'s own sources"\n'
            return self.copy_public_header(m[1])

        return f"\n{INCLUDE.sub(put, text)}"

    def make_header(self) -> str:
        """Return the text of tse.h."""
        only_with_effects = {f"tse/{Path(x).stem}.h" for x in self.sources.with_effects}
        there = sorted(f"tse/{p.name}" for p in (ROOT / "include/tse").glob("*.h"))
        text = self.copy_public_header("tse/tse.h")
        for name in there:
            if name not in only_with_effects:
                text += self.copy_public_header(name)
        text += "\n#if !defined(TSE_NO_EFFECTS)\n"
        text += "".join(self.copy_public_header(name) for name in there if name in only_with_effects)
        text += "\n#endif /* TSE_NO_EFFECTS */\n"
        return self.format_head("tse.h", HOW_TO_USE) + self.define_defaults() + text

    def define_defaults(self) -> str:
        """Return C code that defines the macros in `defaults`.

        The code defines a macro only if it is not yet defined, for example by -D."""
        lines = []
        if "real" in self.defaults:
            formats = " && ".join(f"!defined(TSE_REAL_{x.upper()})" for x in FORMATS)
            lines += [f"#if {formats}", f"#define TSE_REAL_{self.defaults['real'].upper()} 1", "#endif"]
        for name, value in self.defaults.items():
            if name.startswith("TSE_"):
                lines += [f"#if !defined({name})", f"#define {name} {value}", "#endif"]
        return "".join(
            f"{x}\n"
            for x in (["", "/* Options with which amalgamate.py was called. */", *lines] if lines else [])
        )

    # -- tse.c

    def make_source(self) -> str:
        """Return the text of tse.c."""
        headers = [remove_c_plus_plus(p) for p in (ROOT / "include/tse").glob("*.h")]
        public = {d.function for text in headers for d in find_declarations(text) if d.function}
        parts = self.read_parts()
        new_names = resolve_clashes(parts)
        text = ""
        for name, whole in parts.items():
            own = make_static(rename_words(whole, new_names[name]), public)
            whole = self.format_part(name, own)
            if name.endswith(".c"):
                whole += "".join(f"#undef {macro}\n" for macro in find_macros(own))
            if name in self.sources.with_effects:
                whole = f"\n#if !defined(TSE_NO_EFFECTS)\n{whole}\n#endif /* TSE_NO_EFFECTS */\n"
            if re.fullmatch(r"paper/.*\.c", name):
                whole = f"\n#if !defined(TSE_NO_PARTICLES)\n{whole}\n#endif /* TSE_NO_PARTICLES */\n"
            if name == "host/describe.c":  # TSE_NO_DESCRIBE leaves out its tables
                whole = f"\n#if !defined(TSE_NO_DESCRIBE)\n{whole}\n#endif /* TSE_NO_DESCRIBE */\n"
            text += whole
        return self.format_head("tse.c", "") + PROLOGUE + text

    def read_parts(self) -> dict[str, str]:
        """Return the text of each file of src, in the order of the build.

        A header without an include guard is inserted at its #include line, because it
        uses names that the including file has defined above this line. Macros that add
        the number format to the name of a function (TSE_NAME) are removed: a static
        function cannot clash with the same function in another number format.
        """
        texts = {name: remove_c_plus_plus(ROOT / "src" / name) for name in self.sources.files}
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

    def format_part(self, name: str, text: str) -> str:
        """Return a source file as part of tse.c, below a comment with the file's name.

        Lines #include "..." are left out, because the headers are in tse.h, or further up
        in tse.c."""

        def put(m: re.Match[str]) -> str:
            # tse_formula.h is included: it is a file that 'tselab formula' writes
            return m[0] if m[1] == "tse_formula.h" else ""

        return f"\n/* ======== {name} */\n\n{INCLUDE.sub(put, text)}"

    def format_head(self, name: str, more: str) -> str:
        """Return the comment at the top of a file. It ends with the text `more`."""
        return ABOUT.format(name=name, version=self.sources.version) + more + " */\n"


def resolve_clashes(parts: dict[str, str]) -> dict[str, dict[str, str]]:
    """Find names that several files define. Return for each file: old name -> new name.

    For example, `factor` of host/simulate.c becomes `simulate_factor`. In each file, a
    name means the definition in the file itself or in a header that the file includes,
    directly or through other headers.
    """
    owners: dict[str, set[str]] = {}
    for name, text in parts.items():
        own = {
            x
            for d in find_declarations(text)
            for x in d.names
            if d.static or not (d.function or d.shared) or name.endswith(".h")
        }
        for x in own | (set(find_macros(text)) if name.endswith(".h") else set()):
            owners.setdefault(x, set()).add(name)
    included = {name: [x for x in INCLUDE.findall(text) if x in parts] for name, text in parts.items()}
    seen: dict[str, set[str]] = {}
    for name in parts:  # files include earlier files only
        seen[name] = {name}.union(*(seen[x] for x in included[name]))
    new: dict[str, dict[str, str]] = {name: {} for name in parts}
    for x, of in sorted(owners.items()):
        for name in parts if len(of) > 1 else ():
            meant = sorted(of & seen[name])
            if len(meant) > 1:
                raise Wrong(f"{name}: the name {x} is ambiguous: it is defined in {' and '.join(meant)}")
            for path in map(Path, meant):
                folders = {Path(n).parent for n in parts if Path(n).stem == path.stem}
                new[name][x] = (
                    f"{path.stem}_{x}" if len(folders) == 1 else f"{path.parent.name}_{path.stem}_{x}"
                )
    return new


def remove_c_plus_plus(path: Path) -> str:
    """Return the text of a file without extern "C" and without comments to clang-format.

    tse.c needs no extern "C", because tse.h declares the public functions with it. The
    comments have no use, because tse.c is generated and not formatted."""
    return FORMATTER.sub("", C_PLUS_PLUS.sub("", path.read_text()))


ABOUT = """\
/* {name} - tse {version}, a tyre-stiffness estimator, in two files: tse.h and tse.c.
 * Generated by scripts/dev/amalgamate.py: do not edit.
 *
 * Copyright the tse authors. Licensed under the Apache License, Version 2.0: see LICENSE
 * and NOTICE, which belong to these files.
 * SPDX-License-Identifier: Apache-2.0
"""

HOW_TO_USE = """\
 *
 * Compile tse.c as C99 along with your program, with optimisation, and link sqrt (-lm).
 * Options are macros. Define the same ones for tse.c and for each file that includes
 * tse.h, because they change the layout of the structs:
 *   TSE_REAL_DOUBLE     numbers are double (default)
 *   TSE_REAL_FLOAT      numbers are float; a program that uses another format does not link
 *   TSE_REAL_FIXED      numbers are 64-bit fixed point; no floating point is used
 *   TSE_MAX_PARTICLES   max number of particles, default 512; RAM grows with it
 *   TSE_LATENCY_ROWS    max number of rows kept for late channels, default 32; RAM grows
 *                       with it
 *   TSE_NO_EFFECTS      no effects beyond the plain model, no simulator, no replay
 *   TSE_NO_VELOCITY     no measured velocities: saves 1.9 kB of RAM in float
 *   TSE_NO_PARTICLES    no particle filter of the paper: saves 12 kB of flash
 *   TSE_SMALL           lateral motion alone, 14 states instead of 23; without velocities
 *                       and particles
 *   TSE_NO_DESCRIBE     no tse_describe() (names, units, texts): saves 36 kB of flash
 *   TSE_FORMULA         tse.c includes tse_formula.h, which `tselab formula` writes
 * Do not use -ffast-math: missing values are NaN.
"""

PROLOGUE = """
#if defined(TSE_STATE_H)
#error "compile tse.c by itself, without tse.h or a header of the library before it"
#endif
#define TSE_INTERNALS
#include "tse.h"

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "compile tse.c without -ffast-math and -ffinite-math-only: a missing channel is NaN"
#endif

/* Compute a*b + c with two roundings on every machine, so that results are equal in all bits
 * with and without a fused multiply-add instruction. By default, gcc uses this instruction
 * unless a standard is selected (-std=c99), and clang uses it within an expression. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__) && !defined(__STRICT_ANSI__)
#pragma GCC optimize("fp-contract=off")
#endif

/* Some inline functions are not called in every number format. */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-function"
#endif
"""


# ---- files


def write_files(out: Path, defaults: dict[str, str]) -> None:
    """Write tse.h, tse.c, LICENSE and NOTICE into the folder `out`. Keep other files."""
    amalgamation = Amalgamation(defaults)
    texts = {"tse.h": amalgamation.make_header(), "tse.c": amalgamation.make_source()}
    texts |= {name: (ROOT / name).read_text(encoding="utf-8") for name in ("LICENSE", "NOTICE")}
    out.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (out / name).write_text(text, encoding="utf-8", newline="\n")


def main() -> int:
    """Parse the options and write the files."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    parser.add_argument("--real", choices=FORMATS, help="number format if the user defines no macro (double)")
    parser.add_argument("--max-particles", type=int, help="max number of particles, 16 .. 65535 (512)")
    parser.add_argument(
        "--latency-rows",
        type=int,
        help="rows kept for late channels, 8 .. 1024 (32), or 0: no channel is late",
    )
    parser.add_argument(
        "--no-effects", action="store_true", help="no effects beyond the plain model, no simulator, no replay"
    )
    a = parser.parse_args()
    for name, lo, hi in (("max_particles", 16, 65535), ("latency_rows", 8, 1024)):
        value = getattr(a, name)
        if value is not None and not lo <= value <= hi and not (name == "latency_rows" and value == 0):
            parser.error(f"--{name.replace('_', '-')} = {value} is outside its range {lo} .. {hi}")
    capacities = {"TSE_MAX_PARTICLES": a.max_particles, "TSE_LATENCY_ROWS": a.latency_rows}
    defaults = {"real": a.real, **capacities}
    defaults = {name: str(value) for name, value in defaults.items() if value is not None}
    if a.no_effects:
        defaults["TSE_NO_EFFECTS"] = "1"
    try:
        write_files(a.out, defaults)
    except Wrong as wrong:
        print(f"amalgamate.py: {wrong}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
