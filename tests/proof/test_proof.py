"""The short parts of scripts/dev/proof.sh; skipped where a tool is not installed."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))

import coverage
import eva
import faults
import misra
import mutation

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("cppcheck"), reason="cppcheck is not installed (scripts/setup.sh proof)")
def test_no_required_misra_rule_is_broken_outside_the_deviations():
    """Check a file of each folder; scripts/dev/proof.sh misra checks all."""
    without, _, _, found = misra.judge_hits(misra.SHORT)
    assert len(found) > 100
    assert not misra.list_failures(without)


@pytest.mark.skipif(not shutil.which("cppcheck"), reason="cppcheck is not installed (scripts/setup.sh proof)")
def test_a_new_misra_hit_is_seen(tmp_path):
    broken = tmp_path / "broken.c"
    broken.write_text("extern int octal;\nint octal = 017;\n")
    hit = {h for h in misra.find_hits([str(broken)]) if h[0] == "7.1"}
    assert len(hit) == 1 and misra.find_category("7.1") == "required"
    rule, _, line = hit.pop()
    assert misra.list_failures([(rule, "src/broken.c", line)])


def test_deviations_explanations_and_reasons_say_why():
    said = [row["why"] for row in (*misra.read_deviations(), *eva.read_explanations())]
    said += [*coverage.read_reasons().values(), *mutation.read_equivalent().values()]
    assert said and all(len(why) > 20 for why in said)


def test_what_cannot_be_covered_is_still_in_the_source():
    """A reason must belong to a condition of the source."""
    for file, function, condition, _ in coverage.read_reasons():
        text = " ".join((ROOT / file).read_text().replace("\\\n", " ").split())
        header = (ROOT / file).with_suffix(".h")  # may hold the name of the symbol
        named = text + (header.read_text() if header.exists() else "")
        assert function.removeprefix("tse_") in named, (file, function)
        assert " ".join(condition.split()) in text or condition.startswith("condition "), (file, condition)


def test_faults_without_a_test_are_still_in_the_source():
    for fault in mutation.read_equivalent():
        file, rest = fault.split(" | ", 1)
        line = rest.rsplit(" | ", 1)[0]
        assert line in (mutation.SRC / file).read_text(), fault


@pytest.mark.parametrize("listed", faults.LISTS, ids=lambda listed: listed.file.stem)
def test_every_fault_of_a_list_can_be_put_in_and_names_its_tests(listed):
    """The run itself takes an hour."""
    found = faults.read_faults(listed.file)
    assert len({f.what for f in found}) == len(found) >= listed.min_found
    assert all(f.old != f.new for f in found)
    for f in found:
        assert bool(f.tests) != f.file.startswith("src/"), f.what
        assert all((ROOT / t).is_file() for t in f.tests), f.what


def test_the_lists_are_of_the_filter_and_of_the_whole_project():
    first, *others = ([f.file.split("/") for f in faults.read_faults(x.file)] for x in faults.LISTS)
    assert {"/".join(f[:2]) for f in first} == {"src/filter", "src/model"} and len(first) == 30
    for whole in others:
        rooms = {f[2] for f in whole if f[:2] == ["scripts", "tse"]}
        assert rooms >= {"identify", "calibration", "gaps", "readers", "channels"}
        assert {f[0] for f in whole} == {"src", "fmu", "scripts"} and len(whole) == 40


def test_a_list_is_written_into_the_report_beside_the_others(tmp_path, monkeypatch):
    report = tmp_path / "faults.md"
    monkeypatch.setattr(faults, "REPORT", report)
    faults.write_report({"faults_whole.toml": "## faults_whole.toml\n\nold\n"})
    faults.write_report({"faults.toml": "## faults.toml\n\nfirst\n"})
    faults.write_report({"faults_whole.toml": "## faults_whole.toml\n\nnew\n"})
    text = report.read_text(encoding="utf-8")
    assert text.index("## faults.toml\n\nfirst\n") < text.index("## faults_whole.toml\n\nnew\n")
    assert "old" not in text and text.startswith("# Faults chosen by hand\n")


def test_the_table_names_every_fault():
    text = faults.REPORT.read_text(encoding="utf-8")
    assert all(f"| {f.what} |" in text for x in faults.LISTS for f in faults.read_faults(x.file))


def test_a_test_that_was_written_for_a_survivor_is_there():
    for f in (f for x in faults.LISTS for f in faults.read_faults(x.file) if f.since):
        file, name = f.since.split("::")
        assert f" {name}(" in (ROOT / file).read_text(encoding="utf-8"), f.since


@pytest.mark.slow
@pytest.mark.skipif(
    not shutil.which("gcc") or not (mutation.UNITY / "unity.c").exists(),
    reason="no gcc, or no Unity (scripts/setup.sh)",
)
def test_a_fault_is_found_and_one_that_changes_nothing_is_not(tmp_path):
    """The judge of the mutation score, on one small file."""
    bench = mutation.Bench(tmp_path, "gcc")
    bench.tests = {"test_start": bench.tests["test_start"]}
    bench.prepare()
    file = "paper/start.c"
    text = (mutation.SRC / file).read_text()
    at = text.index("TSE_R(0.5)")
    wrong = mutation.Fault(file, at, at + len("TSE_R(0.5)"), "TSE_R(0.25)", "number", 0, "TSE_R(0.5)")
    same = mutation.Fault(file, at, at + len("TSE_R(0.5)"), "TSE_R(0.50)", "number", 0, "TSE_R(0.5)")
    stillborn = mutation.Fault(file, at, at + len("TSE_R(0.5)"), "nonsense", "number", 0, "TSE_R(0.5)")
    assert [bench.judge(f) for f in (wrong, same, stillborn)] == ["found", "same", "stillborn"]


def make_tree_court(tmp_path, monkeypatch, tests):
    """Return a court on a tree of one module and its tests."""
    root = tmp_path / "root"
    (root / "scripts").mkdir(parents=True)
    (root / "scripts" / "pyproject.toml").write_text("[tool.pytest.ini_options]\n")
    (root / "scripts" / "double.py").write_text("def double(x):\n    return x * 2\n")
    (root / "test_double.py").write_text(f"from double import double\n\ndef test_it():\n    {tests}\n")
    (root / ".venv").symlink_to(ROOT / ".venv")
    subprocess.run(["git", "init", "-q"], cwd=root, check=True)
    monkeypatch.setattr(faults, "ROOT", root)
    return faults.TreeCourt(tmp_path / "tree")


@pytest.mark.skipif(not shutil.which("git"), reason="git is not installed")
def test_a_fault_of_python_is_judged_in_a_copy(tmp_path, monkeypatch):
    court = make_tree_court(tmp_path, monkeypatch, "assert double(0) == 0 and double(3) == 6")

    def make(new):
        return faults.HandFault("", "scripts/double.py", "x * 2", new, 2, ("test_double.py",), "", "")

    found = [court.judge(make(new))[0] for new in ("x + 2", "2 * x", "x *")]
    assert found == ["found", "survived", "stillborn"]
    assert court.judge(make("x + 2"))[1] == "test_double.py::test_it"
    for folder in ("root", "tree"):  # nothing of it is left
        assert (tmp_path / folder / "scripts" / "double.py").read_text().endswith("return x * 2\n")


@pytest.mark.skipif(not shutil.which("git"), reason="git is not installed")
def test_tests_that_fail_without_a_fault_judge_nothing(tmp_path, monkeypatch):
    court = make_tree_court(tmp_path, monkeypatch, "assert double(3) == 7")
    wrong = faults.HandFault("", "scripts/double.py", "x * 2", "x + 2", 2, ("test_double.py",), "", "")
    with pytest.raises(SystemExit, match="fails without any fault"):
        court.judge(wrong)


@pytest.mark.skipif(not shutil.which("git"), reason="git is not installed")
def test_a_copy_that_an_interrupted_run_left_is_mended(tmp_path, monkeypatch):
    make_tree_court(tmp_path, monkeypatch, "pass")
    (tmp_path / "tree" / "scripts" / "double.py").write_text("def double(x):\n    return x + 2\n")
    (tmp_path / "tree" / "stray.py").write_text("")
    faults.TreeCourt(tmp_path / "tree")
    assert (tmp_path / "tree" / "scripts" / "double.py").read_text().endswith("return x * 2\n")
    assert not (tmp_path / "tree" / "stray.py").exists()


def test_a_verdict_is_kept_until_the_file_or_a_test_changes(tmp_path, monkeypatch):
    monkeypatch.setattr(faults, "ROOT", tmp_path)
    for name in ("module.py", "test_module.py"):
        (tmp_path / name).write_text("x = 1\n")
    fault = faults.HandFault("", "module.py", "1", "2", 1, ("test_module.py",), "", "")
    kept, found = tmp_path / "kept.json", ("found", "test_module.py::test_x")
    key = faults.Verdicts.make_key(fault)
    faults.Verdicts(kept, again=False).keep(key, *found)
    assert faults.Verdicts(kept, again=False).get(key) == found
    assert faults.Verdicts(kept, again=True).get(key) is None
    (tmp_path / "test_module.py").write_text("x = 2\n")
    assert faults.Verdicts.make_key(fault) != key


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("frama-c"), reason="frama-c is not installed (scripts/setup.sh proof)")
@pytest.mark.parametrize("target", eva.SHORT)
def test_no_alarm_without_an_explanation(target):
    _, found, _ = eva.find_alarms(target, "double")
    rows = eva.read_explanations()
    assert not [a for a in found if eva.find_explanation(target, a, rows) is None]
