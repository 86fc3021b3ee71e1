"""Check the references of the static library: no heap, no stdio, no mutable globals.

    check_symbols.py --nm NM [--objdump OBJDUMP] --real double|float|fixed libtse.a

Of libm it may use the sqrt of its number format only. Undefined symbols are compared with
a list of allowed ones, so new ones show up. On x86-64 the instructions are checked, too.
A float library must not compute in double, a fixed-point one not in floating point.
Elsewhere the helper functions of the compiler, such as __aeabi_dmul, show up as symbols.
No function may multiply and add in one instruction, which rounds once: gcc 12 creates
some in spite of -ffp-contract=off.
"""

import argparse
import re
import subprocess
import sys

# The compiler may call the first five without being asked: clang replaces a memcmp for
# equality by bcmp if the system has it. Some distributions switch on stack protection.
ALLOWED = {"memcpy", "memmove", "memset", "memcmp", "bcmp", "__stack_chk_fail", "_GLOBAL_OFFSET_TABLE_"}
LIBM = {"double": {"sqrt"}, "float": {"sqrtf"}, "fixed": set()}
# How nm and objdump introduce an object file: 'a.c.o:', 'libtse.a[a.c.o]:',
# 'libtse.a(a.c.o):'
MEMBER = re.compile(r"([^\s/()\[\]]+\.o(?:bj)?)[)\]]?:(?:$|\s+file format)")
READ_ONLY = (".text", ".rodata", ".data.rel.ro", "__TEXT")
ARITHMETIC = "add|sub|mul|div|sqrt|min|max|fn?m\\w+|u?comi|cmp\\w*"
DOUBLE = re.compile(rf"\bv?(({ARITHMETIC}|cvt\w*2)(sd|pd)|cvt[sp]d2\w+)\b")
FUSED = re.compile(r"\bvfn?m(add|sub)\w+\b")
FLOATING = re.compile(rf"\bv?(({ARITHMETIC})(ss|sd|ps|pd)|cvt\w+)\b")


def run_command(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def read_symbols(nm, library):
    """Yield (object file, name, class, section) of each symbol."""
    where = ""
    for line in run_command(nm, "--format=sysv", library).splitlines():
        if m := MEMBER.search(line):
            where = m.group(1)
        cells = [c.strip() for c in line.split("|")]
        if len(cells) >= 7 and cells[0] != "Name":
            yield where, cells[0], cells[2], cells[6]


def find_wrong_symbols(rows, real):
    """Yield a message for each symbol that is not allowed."""
    rows = list(rows)
    defined = {name for _, name, kind, _ in rows if kind not in "UwN"}
    for where, name, kind, section in rows:
        plain = name.removeprefix("_") if name.removeprefix("_") in LIBM[real] else name
        allowed = ALLOWED | LIBM[real]
        if kind == "U" and name not in defined and plain not in allowed:
            yield f"{where}: refers to {name}"
        if kind in "dDbBCsSgGcu" and not section.startswith(READ_ONLY):
            yield f"{where}: mutable object {name} in {section or 'common'}"


def find_wrong_instructions(objdump, library, real):
    """Yield a message for each function with an instruction that is not allowed."""
    another = {"float": DOUBLE, "fixed": FLOATING}.get(real)
    where = function = ""
    seen = set()
    for line in run_command(objdump, "-d", "--no-show-raw-insn", library).splitlines():
        if m := MEMBER.search(line):
            where = m.group(1)
        elif m := re.match(r"[0-9a-f]+ <(.+)>:", line):
            function = m.group(1)
        elif (where, function) in seen:
            continue
        elif m := FUSED.search(line):
            seen.add((where, function))
            yield f"{where}: {function} rounds once where it should twice ({m.group(0)})"
        elif another and (m := another.search(line)):
            seen.add((where, function))
            yield f"{where}: {function} computes in another format ({m.group(0)})"


def main():
    """Check the library; exit with the messages."""
    parser = argparse.ArgumentParser()
    parser.add_argument("library")
    parser.add_argument("--nm", required=True)
    parser.add_argument("--objdump", default="")
    parser.add_argument("--real", choices=list(LIBM), required=True)
    a = parser.parse_args()

    rows = list(read_symbols(a.nm, a.library))
    if not any(name.startswith("tse_") for _, name, _, _ in rows):
        sys.exit(f"no tse_ symbol found in the output of {a.nm}")
    wrong = list(find_wrong_symbols(rows, a.real))
    looked = ""
    if a.objdump and "x86-64" in run_command(a.objdump, "-f", a.library):
        wrong += find_wrong_instructions(a.objdump, a.library, a.real)
        looked = " and its instructions"
    defined = {name for _, name, kind, _ in rows if kind != "U"}
    outside = sorted({name for _, name, kind, _ in rows if kind == "U"} - defined)
    print(f"{a.library}: {len(rows)} symbols{looked}; from outside: {' '.join(outside) or 'nothing'}")
    sys.exit("\n".join(wrong) if wrong else 0)


if __name__ == "__main__":
    main()
