"""Measure the coverage of src/ by unit tests: lines, branches, MC/DC.

    scripts/dev/proof.sh coverage

clang 19 or later (-fcoverage-mcdc) measures in double, with the whole library and as
TSE_SMALL, and runs every test program. Code is covered if either build runs it, a
function of a header if any program runs it. A condition in a macro counts once for each
use of the macro. coverage.toml must list uncovered code: as unreachable, with the reason,
or as open, which counts as not covered. An unlisted gap is a failure, and so is an entry
that is covered by now.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from collections import Counter, defaultdict
from pathlib import Path

import tomllib

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
BUILD = ROOT / "build"
BUILDS = {"coverage": [], "coverage-small": ["-DTSE_SMALL=ON", "-DTSE_PARTICLES=OFF", "-DTSE_VELOCITY=OFF"]}
REPORT = ROOT / "scripts" / "results" / "coverage.md"
REASONS = HERE / "coverage.toml"
SHARE = ROOT / ".venv" / "share"
FLAGS = "-O1 -g0 -fprofile-instr-generate -fcoverage-mapping -fcoverage-mcdc"


def find_compiler() -> str | None:
    """Return a clang that measures MC/DC: CLANG, clang-19 and later, or clang."""
    names = [os.environ.get("CLANG", ""), *(f"clang-{v}" for v in range(19, 30)), "clang"]
    for name in filter(None, names):
        if not shutil.which(name):
            continue
        version = re.search(
            r"version (\d+)", subprocess.run([name, "--version"], capture_output=True, text=True).stdout
        )
        if version and int(version.group(1)) >= 19 and shutil.which(find_tool(name, "llvm-profdata")):
            return name
    return None


def find_tool(clang: str, name: str) -> str:
    """Return the tool of LLVM with the version of clang."""
    suffix = re.search(r"-\d+$", clang)
    return name + (suffix.group() if suffix else "")


def run_command(*command: object, **more: object) -> subprocess.CompletedProcess:
    """Run a command; return the result."""
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, **more)
    if done.returncode:
        raise SystemExit(f"coverage: {command[0]} failed\n{(done.stdout + done.stderr)[-4000:]}")
    return done


def read_lines(tracefile: str) -> dict[str, dict[int, bool]]:
    """Return by file and line whether the line was run."""
    lines: dict[str, dict[int, bool]] = defaultdict(dict)
    file = None
    for row in tracefile.splitlines():
        what, _, rest = row.partition(":")
        if what == "SF":
            file = shorten_path(rest)
        elif what == "DA" and file:
            line, count = rest.split(",")[:2]
            lines[file][int(line)] = int(count) > 0
    return lines


def measure(clang: str, name: str) -> tuple[list[dict], dict[str, dict[int, bool]], int, list[str]]:
    """Build and run the tests with coverage.

    Returns functions as llvm-cov exports them, read_lines(), the number of programs, and
    the decisions whose MC/DC is not measured.
    """
    build = BUILD / name
    run_command(
        "cmake",
        "-S",
        ROOT,
        "-B",
        build,
        f"-DCMAKE_C_COMPILER={clang}",
        "-DCMAKE_BUILD_TYPE=None",
        f"-DCMAKE_C_FLAGS={FLAGS}",
        "-DTSE_BUILD_TESTS=ON",
        "-DTSE_BUILD_FMU=OFF",
        "-DTSE_TEST_COMPILES=OFF",
        "-DTSE_TEST_EVERY_WAY=OFF",
        *BUILDS[name],
        f"-DFETCHCONTENT_SOURCE_DIR_UNITY={SHARE / 'unity'}",
        f"-DPython3_EXECUTABLE={sys.executable}",
    )
    said = run_command(
        "cmake", "--build", build, "--clean-first"
    )  # warnings of what is not measured come with each object
    unmeasured = set(
        re.findall(r"^(\S+:\d+):\d+: warning: unsupported MC/DC", said.stdout + said.stderr, re.M)
    )
    programs = sorted(p for p in (build / "tests").glob("test_*") if p.is_file() and os.access(p, os.X_OK))
    profiles = build / "profiles"
    shutil.rmtree(profiles, ignore_errors=True)
    profiles.mkdir()
    for program in programs:
        environment = os.environ | {"LLVM_PROFILE_FILE": str(profiles / f"{program.name}.profraw")}
        run_command(program, cwd=ROOT / "tests", env=environment)
    merged = build / "all.profdata"
    run_command(find_tool(clang, "llvm-profdata"), "merge", "-o", merged, *sorted(profiles.glob("*.profraw")))
    export = [find_tool(clang, "llvm-cov"), "export", programs[0], f"-instr-profile={merged}"]
    export += [x for p in programs[1:] for x in ("-object", p)]
    functions = json.loads(run_command(*export).stdout)["data"][0]["functions"]
    lines = read_lines(run_command(*export, "-format=lcov").stdout)
    return functions, lines, len(programs), sorted(u.removeprefix(f"{ROOT}/") for u in unmeasured)


class Source:
    def __init__(self, path: Path) -> None:
        self.lines = path.read_text().splitlines()

    def text(self, place: tuple[int, int, int, int]) -> str:
        l0, c0, l1, c1 = place
        if l0 == l1:
            return self.lines[l0 - 1][c0 - 1 : c1 - 1]
        part = [self.lines[l0 - 1][c0 - 1 :], *self.lines[l0 : l1 - 1], self.lines[l1 - 1][: c1 - 1]]
        return " ".join(" ".join(p.rstrip("\\").split()) for p in part)


def shorten_path(name: str) -> str | None:
    path = Path(name)
    return path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT / "src") else None


def collect_outcomes(functions: list[dict]) -> tuple[dict, dict]:
    """Return (branches, decisions) by file, function, place and use of the function.

    The values state which outcomes of a branch and which pairs of a condition were seen.
    """
    branches: dict[tuple, list[bool]] = {}
    decisions: dict[tuple, list[bool]] = {}
    for function in functions:
        names = function["filenames"]
        own = shorten_path(names[0])
        if not own:
            continue
        name = function["name"].rpartition(":")[2]
        seen: Counter = Counter()
        for *place, true, false, file_id, _, _ in function["branches"]:
            file = shorten_path(names[file_id]) or own
            use = seen[(file, *place)]
            seen[(file, *place)] += 1
            was = branches.setdefault((file, name, tuple(place), use), [False, False])
            was[0] |= true > 0
            was[1] |= false > 0
        seen = Counter()
        for record in function["mcdc_records"]:
            place, conditions = tuple(record[:4]), record[-1]
            use = seen[place]
            seen[place] += 1
            was = decisions.setdefault((own, name, place, use), [False] * len(conditions))
            for k, independent in enumerate(conditions):
                was[k] |= independent
    return branches, decisions


def strip_suffix(function: str) -> str:
    return re.sub(r"_f64$", "", function)


def find_gaps(branches: dict, decisions: dict) -> dict[tuple, int]:
    """Return the number of uses by (file, function, condition, unseen outcome)."""
    sources: dict[str, Source] = {}
    found: Counter = Counter()
    inside: dict[tuple, list] = defaultdict(list)
    for file, function, place, use in branches:
        inside[(file, function, use)].append(place)
    for (file, function, place, _), (true, false) in branches.items():
        source = sources.setdefault(file, Source(ROOT / file))
        for was, what in ((true, "never true"), (false, "never false")):
            if not was:
                found[(file, strip_suffix(function), source.text(place), what)] += 1
    for (file, function, place, use), seen in decisions.items():
        source = sources.setdefault(file, Source(ROOT / file))
        own = sorted(
            p for p in set(inside[(file, function, use)]) if place[:2] <= p[:2] and p[2:] <= place[2:]
        )
        for k, independent in enumerate(seen):
            if not independent:
                text = (
                    source.text(own[k])
                    if len(own) == len(seen)
                    else f"condition {k + 1} of {source.text(place)}"
                )
                found[(file, strip_suffix(function), text, "never decides alone")] += 1
    return dict(found)


def read_entries(table: str) -> dict[tuple, tuple[int, str]]:
    """Return (number of uses, reason) by (file, function, condition, unseen outcome).

    Entries of `open` have neither a test nor a reason yet.
    """
    rows = tomllib.loads(REASONS.read_text()).get(table, [])
    return {
        (r["file"], *at, what): (n, r.get("why", ""))
        for r in rows
        for at in r["at"]
        for what, n in r["never"].items()
    }


def read_reasons() -> dict[tuple, str]:
    """Return the reasons of unreachable code."""
    return {key: why for key, (_, why) in read_entries("unreachable").items()}


def format_page(
    lines: dict,
    branches: dict,
    decisions: dict,
    found: dict,
    known: dict,
    clang: str,
    programs: int,
    unmeasured: list[str],
) -> str:
    """Return the page with its tables."""
    rows, total = [], Counter()

    def share(part: int, of: int) -> str:
        return f"{100 * part / of:.1f} %" if of else "-"

    for file in sorted(lines):
        outcomes = [o for (f, *_), pair in branches.items() if f == file for o in pair]
        pairs = [o for (f, *_), seen in decisions.items() if f == file for o in seen]
        excused = [(k, n) for k, n in found.items() if k[0] == file and k in known]
        row = Counter(
            lines=len(lines[file]),
            covered=sum(lines[file].values()),
            outcomes=len(outcomes),
            taken=sum(outcomes),
            pairs=len(pairs),
            independent=sum(pairs),
        )
        row["no_branch"] = sum(n for k, n in excused if k[3] != "never decides alone")
        row["no_pair"] = sum(n for k, n in excused if k[3] == "never decides alone")
        total.update(row)
        rows.append((file, row))
    rows.append(("**all**", total))
    version = run_command(clang, "--version").stdout.splitlines()[0]
    out = [
        "# Coverage of the core by the unit tests",
        "",
        f"`scripts/dev/proof.sh coverage --write`; {version}, `{FLAGS}`, double; {programs} test programs.",
        "",
        "Two builds are measured: the whole library, and `TSE_SMALL`. A line, an outcome or a condition is",
        "covered if either build covers it. A condition in a macro counts once for each use of the macro.",
        "",
        "- Branches: both outcomes of every condition.",
        "- MC/DC: conditions of decisions with several conditions. A condition is covered if the tests show",
        "  that it decides alone.",
        "- Share of reachable: without the code that tests/proof/coverage.toml lists as unreachable (last",
        "  table).",
        "",
        "| file | lines | share | branches | share | share of reachable | MC/DC | share | "
        "share of reachable |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for file, r in rows:
        cells = [file.removeprefix("src/"), f"{r['covered']}/{r['lines']}", share(r["covered"], r["lines"])]
        for part, of, excused in ("taken", "outcomes", "no_branch"), ("independent", "pairs", "no_pair"):
            cells += [f"{r[part]}/{r[of]}", share(r[part], r[of]), share(r[part], r[of] - r[excused])]
        out.append(f"| {' | '.join(cells)} |")
    if unmeasured:
        out += ["", f"Of these decisions clang does not measure MC/DC: {', '.join(unmeasured)}."]
    unlisted = sorted(k for k in found if k not in known)
    if unlisted:
        out += ["", "## Not covered, without a reason", ""] + [
            f"- {f}, {fn}: `{c}` {w}" for f, fn, c, w in unlisted
        ]
    out += [
        "",
        "## Unreachable code",
        "",
        "| file | function | condition | never | reason |",
        "|---|---|---|---|---|",
    ]
    grouped: dict[tuple, list] = defaultdict(list)
    for k in sorted(found):
        if k in known:
            grouped[(*k[:3], known[k])].append(
                k[3].removeprefix("never ") + (f" ({found[k]} uses)" if found[k] > 1 else "")
            )
    for (file, function, condition, why), never in grouped.items():
        shown = condition.replace("|", "\\|")
        out.append(f"| {file.removeprefix('src/')} | {function} | `{shown}` | {', '.join(never)} | {why} |")
    return "\n".join(out) + "\n"


def main() -> int:
    """Measure, compare with coverage.toml, write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--write", action="store_true", help=f"make {REPORT.relative_to(ROOT)} anew")
    parser.add_argument("--toml", action="store_true", help="print what is missing as rows for coverage.toml")
    given = parser.parse_args()
    clang = find_compiler()
    if not clang:
        print(
            "coverage: skipped, no clang of 19 or later with its llvm-profdata is installed "
            "(scripts/setup.sh proof)"
        )
        return 0
    functions: list[dict] = []
    lines: dict[str, dict[int, bool]] = defaultdict(dict)
    programs, not_measured = 0, set()
    for name in BUILDS:
        of_build, run_lines, count, without = measure(clang, name)
        functions += of_build
        programs += count
        not_measured.update(without)
        for file, rows in run_lines.items():
            for line, covered in rows.items():
                lines[file][line] = lines[file].get(line, False) or covered
    unmeasured = sorted(not_measured)
    branches, decisions = collect_outcomes(functions)
    found, known = find_gaps(branches, decisions), read_reasons()
    expected = {k: n for table in ("unreachable", "open") for k, (n, _) in read_entries(table).items()}
    unlisted = sorted(k for k in found if found[k] > expected.get(k, 0))
    gone = sorted(k for k in expected if found.get(k, 0) < expected[k])
    text = format_page(lines, branches, decisions, found, known, clang, programs, unmeasured)
    if given.write:
        REPORT.write_text(text)
    if given.toml:
        missing: dict[tuple, list[str]] = defaultdict(list)
        for key in unlisted:
            missing[key[:3]].append(f"{json.dumps(key[3])} = {found[key]}")
        for (file, function, condition), never in missing.items():
            print(
                f"[[open]]\nfile = {json.dumps(file)}\nat = [[{json.dumps(function)}, "
                f"{json.dumps(condition)}]]"
            )
            print(f"never = {{ {', '.join(never)} }}\n")
    else:
        print(next(line for line in text.splitlines() if line.startswith("| **all**")))
    for file, function, condition, what in [] if given.toml else unlisted:
        print(
            f"coverage: {file}: {function}: `{condition}` {what}: write a test, or the "
            "reason into tests/proof/coverage.toml",
            file=sys.stderr,
        )
    for file, function, condition, what in gone:
        print(
            f"coverage: {file}: {function}: `{condition}` {what} stands in "
            "tests/proof/coverage.toml and is not so",
            file=sys.stderr,
        )
    return 1 if unlisted or gone else 0


if __name__ == "__main__":
    sys.exit(main())
