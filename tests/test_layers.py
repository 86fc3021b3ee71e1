"""src/ flows in one direction: no file includes one that stands later in src/CMakeLists.txt. fmu/glue knows nothing of tyres."""

import re
from pathlib import Path

SRC = Path(__file__).resolve().parents[1] / "src"
LIST = re.search(r"add_library\(tse\s([^)]*)\)", (SRC / "CMakeLists.txt").read_text()).group(1)
INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.M)
ORDER = re.sub(r"#.*", "", LIST).split()
GLUE = SRC.parent / "fmu" / "glue"
OF_THE_GLUE = {"fmi2Functions.h", "fmu_guid.h", "fmu_model.h", "model.h", "tse/version.h"}


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
        names = set(re.findall(r"\b(?:tse|TSE)_(?!VERSION\b)\w+", re.sub(r"/\*.*?\*/", "", path.read_text(), flags=re.S)))
        assert not names, f"{path.name} names {names}"


if __name__ == "__main__":
    test_no_file_includes_a_later_one()
    test_every_source_file_stands_in_the_list_once()
    test_the_glue_of_the_fmus_knows_no_model()
    print("in order:", " -> ".join(ORDER))
