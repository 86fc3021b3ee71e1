"""The short parts of scripts/dev/proof.sh; skipped where a tool is not installed."""

import shutil
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


def test_every_fault_of_the_table_can_be_put_in_and_is_of_the_filter_or_its_model():
    """The run itself takes half an hour."""
    found = faults.read_faults()
    assert len(found) == 30 and len({what for what, _ in found}) == 30
    assert {f.file.split("/")[0] for _, f in found} == {"filter", "model"}
    assert all(f.old != f.new for _, f in found)


def test_the_table_names_every_fault():
    text = faults.REPORT.read_text(encoding="utf-8")
    assert all(f"| {what} |" in text for what, _ in faults.read_faults())


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


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("frama-c"), reason="frama-c is not installed (scripts/setup.sh proof)")
@pytest.mark.parametrize("target", eva.SHORT)
def test_no_alarm_without_an_explanation(target):
    _, found, _ = eva.find_alarms(target, "double")
    rows = eva.read_explanations()
    assert not [a for a in found if eva.find_explanation(target, a, rows) is None]
