"""The Markdown that git holds is whole as a forge shows it: links, anchors and pictures are there, tables are current."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "scripts"))
from docsite import fill, links  # noqa: E402

FILES = links.files("*.md")
HELD = set(links.files())
RAW = re.compile(r"^(?:!!!|\?\?\?|:::|--8<--|\{[%!])|\)\{ ?[.:]|^<!-- (?:include|api):|\{\{", flags=re.M)
MOST = 100_000  # bytes of a picture


def wrong_links(path: Path) -> list[str]:
    """Return the links of a page that lead to no file of git, or to no anchor of one."""
    found = []
    for target, anchor in links.local(path):
        if target not in HELD:
            found.append(f"{target}: git holds no such file")
        elif anchor and target.suffix == ".md" and anchor not in links.anchors(target.read_text(encoding="utf-8")):
            found.append(f"{target}#{anchor}: no such anchor")
    return found


def raw_markers(text: str) -> list[str]:
    """Return what a builder would expand and a forge shows as it is, or as nothing."""
    prose = links.CODE.sub("", text)
    lone = [f"<!-- {k}: {x} -->" for k, x in re.findall(r"^<!-- (table|code): (\S+) -->$", fill.BLOCK.sub("", text), re.M)]
    empty = [m[2] for m in fill.BLOCK.finditer(text) if not m[3].strip()]
    return [m[0] for m in RAW.finditer(prose)] + lone + empty


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_a_page_is_whole(path):
    assert wrong_links(path) == []
    assert raw_markers(path.read_text(encoding="utf-8")) == []


def test_what_is_wrong_is_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"[a](no.md) ![b](no.png) [c]({ROOT}/README.md#no) `[d](code.md)` [e](#own)\n\n# Own\n")
    assert len(wrong_links(page)) == 4  # the page itself is not in git
    for text in (
        "!!! note\n",
        "::: tse.estimate\n",
        "<!-- table: x -->\n",
        "![a](b.png){ .light }\n",
        "<!-- table: x -->\n<!-- end -->\n",
    ):
        assert raw_markers(text), text
    assert not raw_markers("`!!!`\n\n<!-- table: x -->\nsomething\n<!-- end -->\n")


def test_anchors_are_those_of_a_forge():
    text = '# `a_b` and [c](d.md), e - f\n```sh\n# no heading\n```\n## Twice\n## Twice\n<span id="own"></span>\n'
    assert links.anchors(text) == {"a_b-and-c-e---f", "twice", "twice-1", "own"}


BLOCKS = sorted({(m[1], m[2]) for p in FILES for m in fill.BLOCK.finditer(p.read_text(encoding="utf-8"))})


@pytest.mark.parametrize("block", BLOCKS, ids=lambda b: b[1])
def test_a_table_that_is_written_in_is_current(block):
    """`.venv/bin/python -m docsite.fill` writes them anew."""
    kind, what = block
    now = fill.made(kind, what)
    for path in FILES:
        for m in fill.BLOCK.finditer(path.read_text(encoding="utf-8")):
            if (m[1], m[2]) == block:
                assert m[3] == now, path


def test_pictures_are_small():
    shown = {t for p in FILES for t, _ in links.local(p) if t.suffix in (".png", ".svg")}
    assert shown and [p.name for p in shown if p.stat().st_size > MOST] == []
