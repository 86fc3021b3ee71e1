"""Measure the share of small faults in the core that unit tests and golden replay find.

    scripts/dev/proof.sh mutation

A fault changes one token, or omits one statement (KINDS), in a file of FOLDERS. Each is
compiled, and the tests run until one fails: those of the file first, then the others, the
quickest first. Faults that do not compile are not counted, nor those that compile to the
same bytes as the original (Papadakis et al., ICSE 2015). If no test fails, the tests of
the file run with sanitizers, as in preset dev, because nothing else finds a loop that
runs one iteration too far. The report lists surviving faults by file and line.
faults.toml lists faults that no test can find, with the reason.
"""

import argparse
import math
import os
import random
import re
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import tomllib
from scipy.stats import binomtest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
SRC = ROOT / "src"
REPORT = ROOT / "scripts" / "results" / "mutation.md"
EQUIVALENT = HERE / "faults.toml"
UNITY = Path(os.environ.get("TSE_UNITY", ROOT / ".venv" / "share" / "unity")) / "src"
FOLDERS = ("estimator", "filter", "model", "number")
FLAGS = [
    "-std=c99",
    "-O1",
    "-w",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-DTSE_MAX_PARTICLES=512",
]
SANITIZERS = [
    "-fsanitize=address,undefined",
    "-fno-sanitize-recover=all",
    "-fno-omit-frame-pointer",
]  # of CMakePresets.json
# A test that takes longer, and ten times longer than without the fault, does not end, s.
MIN_TIME = 10.0

SWAPS = {  # operator: replacements
    "relation": {
        "<": ["<=", ">="],
        ">": [">=", "<="],
        "<=": ["<", ">"],
        ">=": [">", "<"],
        "==": ["!="],
        "!=": ["=="],
    },
    "logic": {"&&": ["||"], "||": ["&&"]},
    "arithmetic": {
        "+": ["-"],
        "-": ["+"],
        "*": ["/"],
        "/": ["*"],
        "%": ["*"],
        "<<": [">>"],
        ">>": ["<<"],
        "&": ["|"],
        "|": ["&"],
        "^": ["|"],
    },
    "assignment": {
        "+=": ["-="],
        "-=": ["+="],
        "++": ["--"],
        "--": ["++"],
        "|=": ["&="],
        "&=": ["|="],
        "^=": ["|="],
        "*=": ["/="],
    },
    "call": {
        "r_mul": ["r_div"],
        "r_div": ["r_mul"],
        "r_min": ["r_max"],
        "r_max": ["r_min"],
        "r_add_sat": ["r_max"],
        "r_abs": [""],
        "r_sqrt": [""],
        "r_sqr": [""],
        "r_exp2": ["r_log2"],
        "r_log2": ["r_exp2"],
    },
}
KINDS = [*SWAPS, "number", "negation", "condition", "statement"]
TOKEN = re.compile(
    r"(?P<skip>/\*.*?\*/|//[^\n]*|\"(?:\\.|[^\"\\])*\"|'(?:\\.|[^'\\])*'|\s+)"
    r"|(?P<number>0[xX][0-9a-fA-F]+[uUlL]*|(?:\d+\.\d*|\.\d+|\d+)(?:[eE][-+]?\d+)?[uUlLfF]*)"
    r"|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<op><<=|>>=|\+\+|--|->|<=|>=|==|!=|&&|\|\||<<|>>|[-+*/%&|^]=|.)",
    re.S,
)


@dataclass(frozen=True)
class Fault:
    file: str  # below src
    at: int  # first character that is replaced
    end: int
    new: str
    kind: str
    line: int
    old: str

    @property
    def text(self) -> str:
        return f"`{' '.join(self.old.split())}` becomes `{' '.join(self.new.split()) or 'nothing'}`"


def blank_directives(text: str) -> str:
    """Replace preprocessor lines by blanks, because a fault there changes the program
    itself.

    One-line constants stay.
    """
    out, more = [], False
    for line in text.splitlines(keepends=True):
        constant = re.match(r"#define [A-Z_0-9]+ +(TSE_R\([-0-9.e]+\)|[0-9]+)\s", line)
        directive = more or (re.match(r"\s*#", line) and not constant)
        more = bool(directive) and line.rstrip().endswith("\\")
        out.append(
            re.sub(r"[^\n]", " ", line)
            if directive
            else re.sub(r"^#define \w+", lambda m: " " * len(m.group()), line)
        )
    return "".join(out)


def find_closing(tokens: list, start: int) -> int:
    depth = 0
    for i in range(start, len(tokens)):
        depth += (tokens[i][1] == "(") - (tokens[i][1] == ")")
        if not depth:
            return i
    return -1


def find_faults(name: str) -> list[Fault]:
    """Return all faults of a file."""
    whole = (SRC / name).read_text()
    text = blank_directives(whole)
    tokens = [
        (m.lastgroup, m.group(), m.start(), m.end()) for m in TOKEN.finditer(text) if m.lastgroup != "skip"
    ]
    found: list[Fault] = []

    def add(kind: str, at: int, end: int, new: str) -> None:
        found.append(Fault(name, at, end, new, kind, whole.count("\n", 0, at) + 1, whole[at:end]))

    depth = 0
    for i, (group, token, at, end) in enumerate(tokens):
        before = tokens[i - 1] if i else ("op", ";", 0, 0)
        depth += (token == "{") - (token == "}")
        operand = (
            before[0] in ("number", "name") and before[1] not in ("return", "const", "case")
        ) or before[1] in (")", "]")
        for kind, swaps in SWAPS.items():
            if token in swaps and (kind in ("call", "logic") or group == "op"):
                if (kind in ("relation", "arithmetic") and not operand) or not depth:
                    continue
                if kind == "call" and not (i + 1 < len(tokens) and tokens[i + 1][1] == "("):
                    continue
                for new in swaps[token]:
                    add(kind, at, end, new)
        if group == "number" and before[1] != "[" and not re.match(r"0[xX]", token):
            value = re.match(r"[0-9.]+(?:[eE][-+]?\d+)?", token).group()
            rest = token[len(value) :]
            if re.fullmatch(r"\d+", value):
                add("number", at, end, f"{int(value) + 1}{rest}")
                if int(value) > 0:
                    add("number", at, end, f"{int(value) - 1}{rest}")
            else:
                add("number", at, end, f"{float(value) * 1.25:.17g}{rest}")
        if token == "!" and depth:
            add("negation", at, end, "")
        if group == "name" and token in ("if", "while") and depth and tokens[i + 1][1] == "(":
            close = find_closing(tokens, i + 1)
            inner = whole[tokens[i + 1][3] : tokens[close][2]]
            add("condition", tokens[i + 1][3], tokens[close][2], f"!({inner})")
            if token == "if":
                add("condition", tokens[i + 1][3], tokens[close][2], "0")
                add("condition", tokens[i + 1][3], tokens[close][2], "1")
        # A statement that is an expression begins after ; { } ) else, declares nothing,
        # and ends with ;
        if depth and (group == "name" or token in ("++", "--")) and before[1] in (";", "{", "}", ")", "else"):
            found.extend(find_statement(name, whole, tokens, i))
    return found


WORDS = {
    "if",
    "for",
    "while",
    "do",
    "switch",
    "case",
    "default",
    "return",
    "break",
    "continue",
    "const",
    "static",
    "enum",
    "struct",
    "typedef",
    "int",
    "int32_t",
    "uint32_t",
    "uint64_t",
    "uint8_t",
    "tse_real",
    "tse_acc",
    "tse_setting",
    "else",
    "char",
    "double",
    "float",
}


def find_statement(name: str, whole: str, tokens: list, start: int) -> list[Fault]:
    """Return the fault that omits a statement, if there is one."""
    if tokens[start][1] in WORDS or (tokens[start][0] == "name" and tokens[start + 1][0] == "name"):
        return []
    depth = 0
    for i in range(start, len(tokens)):
        token = tokens[i][1]
        depth += (token in "([") - (token in ")]")
        if depth < 0 or token in ("{", "}", "?"):
            return []
        if token == ";" and not depth:
            old = whole[tokens[start][2] : tokens[i][2]]
            if not re.search(r"[^=!<>]=[^=]|\(|\+\+|--", old) or (tokens[start + 1][1] == "*"):
                return []
            return [
                Fault(
                    name,
                    tokens[start][2],
                    tokens[i][2],
                    "",
                    "statement",
                    whole.count("\n", 0, tokens[start][2]) + 1,
                    old,
                )
            ]
    return []


def list_sources() -> list[str]:
    listed = re.search(r"add_library\(tse\s([^)]*)\)", (SRC / "CMakeLists.txt").read_text()).group(1)
    return [x for x in re.sub(r"#.*", "", listed).split() if x.endswith(".c")]


def list_core_files() -> list[str]:
    files = sorted(
        p.relative_to(SRC).as_posix()
        for d in FOLDERS
        for p in (SRC / d).rglob("*")
        if p.suffix in {".c", ".h"}
    )
    return [f for f in files if not f.startswith("host/")]


class Bench:
    """Objects and tests, compiled once. A fault recompiles the files that it touches."""

    def __init__(self, work: Path, compiler: str, more: list[str] | None = None) -> None:
        self.work, self.cc, self.more = work, compiler, more or []
        for part in ("obj", "test", "run", "over"):
            (work / part).mkdir(parents=True, exist_ok=True)
        self.include = [f"-I{ROOT}/include", f"-I{SRC}"]
        self.for_tests = [f"-I{ROOT}/tests/{d}" for d in ("unit", "replay")] + [
            f"-I{UNITY}",
            "-DUNITY_INCLUDE_DOUBLE",
        ]
        self.tests, self.includes = {}, {}
        for path in sorted((ROOT / "tests" / "unit").rglob("test_*.c")):
            if path.stem in ("test_ekf", "test_small"):
                continue  # of the tests' own filter, and of another build
            name = path.stem.replace("test_", "test_filter_") if path.parent.name == "filter" else path.stem
            self.includes[name] = set(re.findall(r'#include "([^"]+\.c)"', path.read_text()))
            self.tests[name] = work / "test" / f"{name}.c"
            writer = ROOT / "tests" / "unit" / "runner.cmake"
            subprocess.run(
                ["cmake", f"-DSOURCE={path}", f"-DRUNNER={self.tests[name]}", "-P", writer], check=True
            )
        self.seconds: dict[str, float] = {}
        self.library = work / "obj" / "libtse.a"

    def compile(self, source: Path, out: Path, over: Path | None = None, test: bool = False) -> bool:
        first = [f"-I{over}"] if over else []
        more = self.for_tests if test else []
        command = [self.cc, *FLAGS, *self.more, *first, *self.include, *more, "-c", source, "-o", out]
        return subprocess.run(command, capture_output=True).returncode == 0

    def compile_objects(self) -> dict[str, Path]:
        return {s: self.work / "obj" / (s.replace("/", "_") + ".o") for s in list_sources()}

    def prepare(self, quick: bool = False) -> None:
        """Compile objects and tests; run the tests without a fault to measure their time.

        `quick`: compile tests on demand and do not run them, because another bench has
        run them.
        """
        for source, out in self.compile_objects().items():
            if not self.compile(SRC / source, out):
                raise SystemExit(f"mutation: {source} does not compile")
        self.archive(self.library, list(self.compile_objects().values()))
        if not self.compile(UNITY / "unity.c", self.work / "test" / "unity.o", test=True):
            raise SystemExit(f"mutation: no Unity in {UNITY}: run scripts/setup.sh")
        for name, path in ({} if quick else self.tests).items():
            if not self.compile(path, self.work / "test" / f"{name}.o", test=True):
                raise SystemExit(f"mutation: {name} does not compile")
            began = time.monotonic()
            if self.run(name, self.library, self.work / "test" / f"{name}.o") != "passed":
                raise SystemExit(f"mutation: {name} fails without any fault")
            self.seconds[name] = time.monotonic() - began

    def archive(self, out: Path, objects: list[Path]) -> None:
        """Write a library: a test that includes a source must not link its object."""
        subprocess.run(["ar", "rcsD", str(out), *map(str, objects)], check=True)

    def run(self, name: str, library: Path, test: Path) -> str:
        program = self.work / "run" / name
        link = [
            self.cc,
            *self.more,
            str(test),
            str(self.work / "test" / "unity.o"),
            str(library),
            "-lm",
            "-o",
            str(program),
        ]
        if subprocess.run(link, capture_output=True).returncode:
            return "failed"
        limit = max(MIN_TIME, 10 * self.seconds.get(name, 30.0))
        try:
            done = subprocess.run([str(program)], cwd=ROOT / "tests", capture_output=True, timeout=limit)
        except subprocess.TimeoutExpired:
            return "failed"
        return "failed" if done.returncode else "passed"

    def find_own_tests(self, name: str) -> set[str]:
        stem, of_filter = Path(name).stem, Path(name).parent.name == "filter"
        own = {f"test_{'filter_' if of_filter else ''}{stem}", f"test_{stem}"}
        if stem in ("effects", "effects_constant", "catalogue", "integrator"):
            own |= {"test_effect_forces", "test_effect_linear"}
        return own & set(self.tests)

    def order_tests(self, name: str) -> list[str]:
        own = self.find_own_tests(name)
        return sorted(self.tests, key=lambda t: (t not in own, t != "test_replay" and self.seconds.get(t, 0)))

    def find_users(self, header: str) -> list[str]:
        """Return the sources that include a header, directly or indirectly."""
        wanted, grown = {header}, True
        texts = {
            p.relative_to(SRC).as_posix(): p.read_text() for p in SRC.rglob("*") if p.suffix in {".c", ".h"}
        }
        while grown:
            more = {n for n, t in texts.items() if n not in wanted and any(f'"{w}"' in t for w in wanted)}
            grown, wanted = bool(more), wanted | more
        return [s for s in list_sources() if s in wanted]

    def judge(self, fault: Fault, own_only: bool = False) -> str:
        """Return stillborn, same (equal bytes), found, or survived."""
        over = self.work / "over"
        changed = over / fault.file
        changed.parent.mkdir(parents=True, exist_ok=True)
        text = (SRC / fault.file).read_text()
        changed.write_text(text[: fault.at] + fault.new + text[fault.end :])
        objects, header, others = self.compile_objects(), fault.file.endswith(".h"), []
        users = self.find_users(fault.file) if header else [fault.file]
        library = over / "libtse.a"
        shutil.copy(self.library, library)
        try:
            for source in users:
                out = over / objects[source].name
                if not self.compile(SRC / source if header else changed, out, over):
                    return "stillborn"
                if out.read_bytes() != objects[source].read_bytes():
                    others.append(out)
            if others:
                self.archive(library, others)
            differs = bool(others)
            for name in sorted(self.find_own_tests(fault.file)) if own_only else self.order_tests(fault.file):
                test = self.work / "test" / f"{name}.o"
                if not test.exists():
                    self.compile(self.tests[name], test, test=True)
                if header or self.includes[name] & set(users):
                    again = over / f"{name}.o"
                    if not self.compile(self.tests[name], again, over, test=True):
                        return "stillborn"
                    if again.read_bytes() == test.read_bytes() and not others:
                        continue  # this test does not use the file
                    differs, test = True, again
                elif not others:
                    continue
                if self.run(name, library, test) == "failed":
                    return "found"
            return "survived" if differs else "same"
        finally:
            changed.unlink()


class Court:
    """A bench, and one with sanitizers that judges survivors by the tests of the file."""

    def __init__(self, work: Path, compiler: str) -> None:
        self.bench, self.second = Bench(work, compiler), Bench(work / "sanitized", compiler, SANITIZERS)
        self.bench.prepare()
        self.second.library.unlink(missing_ok=True)

    def judge(self, fault: Fault) -> str:
        """Return the verdict of Bench.judge(), or found by sanitizers."""
        verdict = self.bench.judge(fault)
        if verdict == "survived":
            if not self.second.library.exists():
                self.second.prepare(quick=True)
            verdict = "found by sanitizers" if self.second.judge(fault, own_only=True) == "found" else verdict
        return verdict


def draw_sample(faults: list[Fault], count: int, seed: int) -> list[Fault]:
    """Draw faults, each with the same probability, so that the interval holds for all."""
    return random.Random(seed).sample(faults, min(count, len(faults)))


def compute_wilson_interval(k: int, n: int) -> tuple[float, float]:
    """Return the 95 % interval of a share."""
    if not n:
        return 0.0, 1.0
    found = binomtest(k, n).proportion_ci(method="wilson")
    return float(found.low), float(found.high)


def make_key(fault: Fault) -> str:
    """Return a key of a fault that does not depend on its line number."""
    line = (SRC / fault.file).read_text().splitlines()[fault.line - 1].strip()
    return f"{fault.file} | {line} | {fault.old} -> {fault.new}"


def read_equivalent() -> dict[str, str]:
    """Return the reasons of faults.toml by fault."""
    return (
        {row["fault"]: row["why"] for row in tomllib.loads(EQUIVALENT.read_text()).get("equivalent", [])}
        if EQUIVALENT.exists()
        else {}
    )


def main() -> int:
    """Judge a sample of the faults and write the report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--all", action="store_true", help="every fault there is (hours)")
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=14)
    parser.add_argument("--only", help="files of which the path contains this")
    parser.add_argument("--compiler", default="gcc")
    parser.add_argument("--write", action="store_true", help=f"make {REPORT.relative_to(ROOT)} anew")
    parser.add_argument("--list", action="store_true", help="say the faults and stop")
    parser.add_argument(
        "--seconds",
        type=float,
        default=math.inf,
        help="stop after so long; the report says how many were judged",
    )
    given = parser.parse_args()

    faults = [
        f for name in list_core_files() if not given.only or given.only in name for f in find_faults(name)
    ]
    chosen = faults if given.all else draw_sample(faults, given.count, given.seed)
    if given.list:
        for f in chosen:
            print(f"{f.file}:{f.line}: {f.kind}: {f.text}")
        print(f"{len(chosen)} of {len(faults)}")
        return 0
    court = Court(ROOT / "build" / "mutation", given.compiler)
    print(
        f"mutation: {len(chosen)} of {len(faults)} faults; all tests take "
        f"{sum(court.bench.seconds.values()):.0f} s",
        flush=True,
    )
    known, began, verdicts = read_equivalent(), time.monotonic(), []
    for fault in chosen:
        if time.monotonic() - began > given.seconds:
            break
        verdict = "known" if make_key(fault) in known else court.judge(fault)
        verdicts.append((fault, verdict))
        if verdict == "survived":
            print(f"survived: {fault.file}:{fault.line}: {fault.kind}: {fault.text}", flush=True)
    page, share = format_report(given, len(faults), verdicts, known, court.bench)
    print(page)
    if given.write:
        REPORT.write_text(page)
    return 0 if share >= 0.9 else 1


def format_report(
    given, total: int, verdicts: list[tuple[Fault, str]], known: dict[str, str], bench: Bench
) -> tuple[str, float]:
    """Return the report and the share found."""

    def count(verdict: str, chosen=verdicts) -> int:
        return sum(v == verdict for _, v in chosen)

    found, survived = count("found") + count("found by sanitizers"), count("survived")
    low, high = compute_wilson_interval(found, found + survived)
    share = found / max(1, found + survived)
    version = subprocess.run(
        [given.compiler, "--version"], capture_output=True, text=True
    ).stdout.splitlines()[0]
    command = "scripts/dev/proof.sh mutation --write" + (
        " --all" if given.all else f" --count {given.count} --seed {given.seed}"
    )
    if len(verdicts) < min(given.count, total) and not given.all:
        command += f" --seconds {given.seconds:.0f}"
    lines = [
        "# Mutation score of the core",
        "",
        f"`{command}`; {version}, -O1, double.",
        f"{len(verdicts)} of {total} possible faults in src/{', src/'.join(FOLDERS)}, drawn at random.",
        f"{len(bench.tests)} test programs, including the golden replay.",
        "",
        f"**{found} of {found + survived} found: {100 * share:.1f} %, 95 % interval "
        f"{100 * low:.1f} .. {100 * high:.1f} %.**",
        f"{count('found by sanitizers')} of these only with the sanitizers of preset dev, by the tests of "
        "the file.",
        f"Not counted: {count('stillborn')} faults that do not compile, {count('same')} that compile to the "
        "same bytes,",
        f"{count('known')} that no test can find (last table).",
        "",
        "| kind | found | survived |",
        "|---|---|---|",
    ]
    for kind in KINDS:
        own = [x for x in verdicts if x[0].kind == kind]
        lines.append(
            f"| {kind} | {count('found', own) + count('found by sanitizers', own)} | "
            f"{count('survived', own)} |"
        )
    lines += ["", "## Faults that no test found", "", "| file and line | kind | fault |", "|---|---|---|"]
    lines += [
        f"| src/{f.file}:{f.line} | {f.kind} | {f.text.replace('|', chr(92) + '|')} |"
        for f, v in sorted(verdicts, key=lambda x: (x[0].file, x[0].at))
        if v == "survived"
    ]
    lines += [
        "",
        "## Faults that no test can find (tests/proof/faults.toml)",
        "",
        "| file and line | fault | reason |",
        "|---|---|---|",
    ]
    lines += [
        f"| src/{f.file}:{f.line} | {f.text.replace('|', chr(92) + '|')} | {known[make_key(f)]} |"
        for f, v in sorted(verdicts, key=lambda x: (x[0].file, x[0].at))
        if v == "known"
    ]
    return "\n".join(lines) + "\n", share


if __name__ == "__main__":
    sys.exit(main())
