"""src/ flows in one direction: no file includes one that stands later in src/CMakeLists.txt."""

import re
from pathlib import Path

SRC = Path(__file__).resolve().parents[1] / "src"
LIST = re.search(r"add_library\(tse\s([^)]*)\)", (SRC / "CMakeLists.txt").read_text()).group(1)
INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.M)
ORDER = re.sub(r"#.*", "", LIST).split()


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


if __name__ == "__main__":
    test_no_file_includes_a_later_one()
    test_every_source_file_stands_in_the_list_once()
    print("in order:", " -> ".join(ORDER))
