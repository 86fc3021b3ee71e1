"""Layers of the C sources and of the Python packages.

No file of src/ includes one that stands later in src/CMakeLists.txt, or one of a folder
that its own must not use. fmu/glue has no model of tyres. The rooms of tse import in one
order. No Python module imports itself through others, commands import the public API
only, and imports stand at the head. No constant has two values, and no two classes have
one name.
"""

import ast
import re
from pathlib import Path

SRC = Path(__file__).resolve().parents[1] / "src"
LIST = re.search(r"add_library\(tse\s([^)]*)\)", (SRC / "CMakeLists.txt").read_text()).group(1)
INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.M)
ORDER = re.sub(r"#.*", "", LIST).split()
EVERYWHERE = "tables"  # any file may include these files of scripts/dev/tables.py
KNOWS = {  # folder: folders that its files may include, in order
    "tables": {"tables"},
    "number": {"number"},
    "model": {"number", "model"},
    "estimator": {"number", "model", "estimator"},
    "filter": {"number", "model", "estimator", "filter"},
    "paper": {"number", "model", "estimator", "paper"},
    "host": {"number", "model", "estimator", "filter", "host"},
}
DOOR = "estimator/filter.c"  # calls the filter that is set: the only file that includes both
WRITTEN = {"tse_formula.h"}  # by tselab, for a build with a formula of the user
GLUE = SRC.parent / "fmu" / "glue"
OF_THE_GLUE = {"fmi2Functions.h", "fmi3Functions.h", "fmu_guid.h", "fmu_model.h", "glue.h", "model.h"}
OF_THE_GLUE |= {"tse/convert.h", "tse/version.h"}
NAME = re.compile(
    r"\b(?:tse|TSE)_(?!VERSION\b|(?:real|setting)(?:_of)?\b|double_of(?:_setting)?\b)\w+"
)  # but version, numbers


def find_folder(path):
    """Return the folder of a file."""
    return path.partition("/")[0]


def test_no_file_includes_one_of_a_folder_that_its_own_must_not_know():
    wrong = []
    for name in ORDER:
        for included in set(INCLUDE.findall((SRC / name).read_text())) - WRITTEN:
            if not included.startswith(("tse/", f"{EVERYWHERE}/")) and find_folder(included) not in (
                KNOWS["filter"] | KNOWS["paper"] if name == DOOR else KNOWS[find_folder(name)]
            ):
                wrong.append(f"{name} includes {included}, which {find_folder(name)} must not know")
    assert not wrong, "\n".join(wrong)


def test_files_are_included_by_their_path_in_src():
    """A path relative to the folder of the file would escape the other tests."""
    for name in ORDER:
        own = [x for x in INCLUDE.findall((SRC / name).read_text()) if not x.startswith("tse/")]
        assert set(own) - WRITTEN <= set(ORDER), f"{name} includes {set(own) - set(ORDER)}"


def test_the_folders_stand_in_order():
    """The door is an exception: it stands behind the filters that it calls."""
    places = [list(KNOWS).index(find_folder(name)) for name in ORDER if name != DOOR]
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


# ---- modules of tse and tselab

SCRIPTS = SRC.parent / "scripts"
FLOORS = [  # rooms of tse; each imports from earlier ones only
    "library",
    "log",
    "car",
    "roads",
    "readers",
    "channels",
    "estimation",
    "report",
    "simulation",
    "identify",
    "calibration",
    "gaps",
    "gaps.infer",
    "gaps.run",
    "runs",
    "streaming",
    "",  # errors, files, tables
    "api",
]
COMMANDS = re.compile(r"tselab\.(?!montecarlo|fmu_)\w+")  # options in, messages out
PUBLIC = {"tse", "tse.errors", "tse.files", "tse.tables"}  # modules that the command may import
# The studies run simulator, filter and rivals row by row. They are part of the package,
# not of the command layer: `pip install` brings `tselab paper` and `tselab montecarlo`,
# which need no checkout.
STUDIES = "tselab.montecarlo"
CONSTANT = re.compile("_?[A-Z][A-Z0-9_]*")
LATE = {  # imports within functions of modules that few users need, to save a second
    ("tse.api.estimate", "tse.report.report"),
    ("tse.api.simulate", "tse.report.report"),
    ("tse.errors", "tse.library.core"),  # numpy, which --help of the command does without
    ("tse.library.processes", "tse.library"),  # in a function that is sent to the workers as code
    ("tse.runs.single", "tse.report.plots"),
    ("tse.runs.single", "tse.report.report"),
    ("tse.runs.single", "tse.roads.road_match"),
    ("tse.api.simulate", "tse.roads.road_match"),
    ("tse.calibration.own", "tse.calibration.output"),
    ("tse.calibration.own", "tse.calibration.workflow"),
}


def read_modules():
    """Return the syntax tree of each module by name."""
    paths = [p for package in ("tse", "tselab") for p in (SCRIPTS / package).rglob("*.py")]
    dotted = {
        ".".join(p.relative_to(SCRIPTS).with_suffix("").parts).removesuffix(".__init__"): p for p in paths
    }
    return {name: ast.parse(p.read_text(encoding="utf-8")) for name, p in dotted.items()}


def find_imports(trees):
    """Return importer, imported module, and whether a function imports it.

    Imports for types only are left out.
    """

    def names(node):
        if isinstance(node, ast.Import):
            return [a.name for a in node.names]
        assert not node.level, f"a relative import: {ast.unparse(node)}"
        return [f"{node.module}.{a.name}" for a in node.names]

    def walk(name, node, late):
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
                continue
            if isinstance(child, ast.Import | ast.ImportFrom):
                for found in names(child):
                    whole = found if found in trees else found.rpartition(".")[0]
                    if whole in trees and whole != name:
                        yield name, whole, late
            yield from walk(name, child, late or isinstance(child, ast.FunctionDef))

    return {found for name, tree in trees.items() for found in walk(name, tree, False)}


TREES = read_modules()
ARROWS = find_imports(TREES)


def find_reached(start, known):
    """Return all modules that a module imports, directly or indirectly."""
    seen, todo = set(), [start]
    while todo:
        for other in known.get(todo.pop(), ()):
            if other not in seen:
                seen.add(other)
                todo.append(other)
    return seen


def test_no_module_needs_itself_by_a_detour():
    known = {}
    for name, other, _ in ARROWS:
        known.setdefault(name, set()).add(other)
    assert len(TREES) > 100 and len(ARROWS) > 500
    assert not {name for name in TREES if name in find_reached(name, known)}


def find_room(name):
    """Return the room of a module of tse; "" has the modules errors, files and tables."""
    package = name if SCRIPTS.joinpath(*name.split(".")).is_dir() else name.rpartition(".")[0]
    return package.removeprefix("tse").removeprefix(".")


def test_rooms_stand_in_order_and_none_imports_from_a_later_one():
    tse = [name for name in TREES if name == "tse" or name.startswith("tse.")]
    assert {find_room(name) for name in tse} == set(FLOORS)
    public = {"tse.errors"}
    wrong = {
        (name, other)
        for name, other, _ in ARROWS
        if name in tse
        and other in tse
        and FLOORS.index(find_room(name)) < FLOORS.index(find_room(other))
        and other not in public
    }
    assert not wrong, "\n".join(f"{name} imports {other}" for name, other in sorted(wrong))


def test_tse_does_not_know_the_command_nor_what_is_called_one():
    assert {(a, b) for a, b, _ in ARROWS if a.startswith("tse.") and b.startswith("tselab")} == set()
    assert {(a, b) for a, b, _ in ARROWS if COMMANDS.fullmatch(b) and not COMMANDS.fullmatch(a)} == set()


def test_commands_import_the_public_api_alone():
    """Types as well: tse offers to all users what a command needs."""
    wrong = set()
    for name, tree in TREES.items():
        if name.partition(".")[0] != "tselab" or name.startswith(STUDIES):
            continue
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                found = {a.name for a in node.names}
            elif isinstance(node, ast.ImportFrom):
                modules = {f"{node.module}.{a.name}" for a in node.names}
                found = {node.module, *(m for m in modules if m in TREES)}
            else:
                continue
            wrong |= {(name, m) for m in found if m.partition(".")[0] == "tse" and m not in PUBLIC}
    assert not wrong, "\n".join(f"{name} imports {other}" for name, other in sorted(wrong))


def test_imports_stand_at_the_head_but_for_commands_and_what_few_need():
    late = {(a, b) for a, b, inside in ARROWS if inside and not COMMANDS.fullmatch(a)}
    assert late <= LATE, sorted(late - LATE)


def list_constants(tree):
    """Yield the name and, as text, the value of each constant of a module."""
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                names = target.elts if isinstance(target, ast.Tuple) else [target]
                one_each = isinstance(node.value, ast.Tuple) and isinstance(target, ast.Tuple)
                for k, name in enumerate(names):
                    value = ast.unparse(node.value.elts[k] if one_each else node.value)
                    if isinstance(name, ast.Name) and CONSTANT.fullmatch(name.id):
                        yield name.id, value


def test_no_constant_has_two_values_in_two_modules():
    """Who searches for a name finds one meaning. The same value may stand twice."""
    values = {}
    for module, tree in TREES.items():
        for name, value in list_constants(tree):
            values.setdefault(name, {}).setdefault(value, set()).add(module)
    assert len(values) > 500
    wrong = {name: found for name, found in values.items() if len(found) > 1}
    assert not wrong, "\n".join(
        f"{name}: {sorted(set().union(*f.values()))}" for name, f in sorted(wrong.items())
    )


def test_no_class_has_the_name_of_another():
    places = {}
    for module, tree in TREES.items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name, []).append(module)
    assert len(places) > 150
    wrong = {name: found for name, found in places.items() if len(found) > 1}
    assert not wrong, "\n".join(f"{name}: {found}" for name, found in sorted(wrong.items()))


if __name__ == "__main__":
    for name, test in [*globals().items()]:
        if name.startswith("test_"):
            test()
    print("in order:", " -> ".join(ORDER))
