"""src/ flows in one direction: no file includes one that stands later in src/CMakeLists.txt, or in a folder that its own must not
know. fmu/glue knows nothing of tyres. The rooms of tselab.gap are kept apart in the same way."""

import ast
import re
from pathlib import Path

SRC = Path(__file__).resolve().parents[1] / "src"
LIST = re.search(r"add_library\(tse\s([^)]*)\)", (SRC / "CMakeLists.txt").read_text()).group(1)
INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.M)
EFFECTS = [
    x for own in ("constant", "acting") for x in INCLUDE.findall((SRC / "model" / f"effects_{own}.h").read_text())
]
ORDER = re.sub(r"#.*", "", LIST).replace("${effect_files}", " ".join(EFFECTS)).split()
EVERYWHERE = "tables"  # folder of what scripts/tables.py writes, which any file may include
KNOWS = {  # which folders' files those of a folder may include; in order
    "tables": {"tables"},
    "number": {"number"},
    "model": {"number", "model"},
    "estimator": {"number", "model", "estimator"},
    "filter": {"number", "model", "estimator", "filter"},
    "paper": {"number", "model", "estimator", "paper"},
    "host": {"number", "model", "estimator", "filter", "host"},
}
DOOR = "estimator/filter.c"  # which opens to the form that is set: it alone of its folder knows both filters
WRITTEN = {"tse_formula.h"}  # by tselab, for a build that has a formula of the user compiled in
GLUE = SRC.parent / "fmu" / "glue"
GAP = SRC.parent / "scripts" / "tselab" / "gap"
ROOMS = {  # which rooms' modules those of a room may import; "": what all of them share
    "": {""},
    "localise": {"", "localise"},
    "infer": {"", "infer"},
    "export": {"", "localise", "infer", "export", "workflow"},
}
THROUGH = {"workflow", "commands", "check", "plan", "selftest"}  # modules that lead through the rooms
OF_THE_GLUE = {"fmi2Functions.h", "fmi3Functions.h", "fmu_guid.h", "fmu_model.h", "glue.h", "model.h"}
OF_THE_GLUE |= {"tse/convert.h", "tse/version.h"}
NAME = re.compile(
    r"\b(?:tse|TSE)_(?!VERSION\b|(?:real|setting)(?:_of)?\b|double_of(?:_setting)?\b)\w+"
)  # but version, numbers


def folder(path):
    return path.partition("/")[0]


def test_no_file_includes_one_of_a_folder_that_its_own_must_not_know():
    wrong = []
    for name in ORDER:
        for included in set(INCLUDE.findall((SRC / name).read_text())) - WRITTEN:
            if not included.startswith(("tse/", f"{EVERYWHERE}/")) and folder(included) not in (
                KNOWS["filter"] | KNOWS["paper"] if name == DOOR else KNOWS[folder(name)]
            ):
                wrong.append(f"{name} includes {included}, which {folder(name)} must not know")
    assert not wrong, "\n".join(wrong)


def test_files_are_included_by_their_path_in_src():
    """A path relative to the file's own folder would pass the other tests unseen."""
    for name in ORDER:
        own = [x for x in INCLUDE.findall((SRC / name).read_text()) if not x.startswith("tse/")]
        assert set(own) - WRITTEN <= set(ORDER), f"{name} includes {set(own) - set(ORDER)}"


def test_the_folders_stand_in_order():
    """But for the door, which stands behind the filters that it opens to."""
    places = [list(KNOWS).index(folder(name)) for name in ORDER if name != DOOR]
    assert places == sorted(places)


def test_no_file_includes_a_later_one():
    late = []
    for place, name in enumerate(ORDER):
        for included in INCLUDE.findall((SRC / name).read_text()):
            if included in ORDER and ORDER.index(included) >= place:
                late.append(f"{name} includes {included}, which stands later in src/CMakeLists.txt")
    assert not late, "\n".join(late)


def test_every_source_file_stands_in_the_list_once():
    there = sorted(p.relative_to(SRC).as_posix() for p in SRC.rglob("*") if p.suffix in {".c", ".h"})
    assert sorted(ORDER) == there


def test_the_glue_of_the_fmus_knows_no_model():
    for path in sorted(p for p in GLUE.iterdir() if p.suffix in {".c", ".h"}):
        foreign = set(INCLUDE.findall(path.read_text())) - OF_THE_GLUE
        assert not foreign, f"{path.name} includes {foreign}"
        names = set(NAME.findall(re.sub(r"/\*.*?\*/", "", path.read_text(), flags=re.S)))
        assert not names, f"{path.name} names {names}"


def room(parts):
    """Of a module, by its name below tselab.gap."""
    return parts[0] if parts and parts[0] in ROOMS.keys() | THROUGH else ""


def imported(path):
    """Names below tselab.gap that a file imports anywhere, in functions and for types, too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [a.name for a in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{path.name} has a relative import"
            names = [f"{node.module}.{a.name}" for a in node.names]
        else:
            continue
        yield from (n.split(".")[2:] for n in names if n.startswith("tselab.gap."))


def test_the_rooms_of_the_gap_workflow_do_not_know_what_they_need_not():
    wrong = []
    for path in sorted(GAP.rglob("*.py")):
        own = room(path.relative_to(GAP).with_suffix("").parts)
        for parts in imported(path):
            if own not in THROUGH and room(parts) not in ROOMS[own]:
                wrong.append(
                    f"{path.relative_to(GAP)} imports {'.'.join(parts)}, which {own or 'what is shared'} must not know"
                )
    assert not wrong, "\n".join(wrong)


if __name__ == "__main__":
    test_no_file_includes_one_of_a_folder_that_its_own_must_not_know()
    test_files_are_included_by_their_path_in_src()
    test_the_folders_stand_in_order()
    test_no_file_includes_a_later_one()
    test_every_source_file_stands_in_the_list_once()
    test_the_glue_of_the_fmus_knows_no_model()
    test_the_rooms_of_the_gap_workflow_do_not_know_what_they_need_not()
    print("in order:", " -> ".join(ORDER))
