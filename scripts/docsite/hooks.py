"""Hooks of MkDocs (docs/mkdocs.yml): directives, pages that are made, equations as MathML, tables that scroll."""

from __future__ import annotations

import html
import os
import re
import sys
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts")]

from docsite import pages, tables  # noqa: E402

MATH = re.compile(r'<(span|div) class="arithmatex">(?:\\\(|\\\[)(.*?)(?:\\\)|\\\])</\1>', flags=re.S)
BUILT = Path(
    os.environ.get("TSE_SITE_PARTS", ROOT / "build" / "site-parts")
)  # pictures and examples that scripts/docs.sh has made


def on_config(config: Any) -> Any:
    """A page per effect: below the list of effects."""
    effects = [f"gap/effects/{e}.md" for e in tables.library().effects]
    gap = next(item["Gap"] for item in config.nav if "Gap" in item)
    if not any(isinstance(item, dict) for item in gap):
        gap.append({"Each effect": effects})
    return config


def on_files(files: Files, config: Any) -> Files:
    for address, text in pages.made_pages().items():
        files.append(File.generated(config, address, content=text))
    parts = [p for p in sorted(BUILT.rglob("*")) if p.is_file()] if BUILT.is_dir() else []
    for path in parts:
        files.append(File.generated(config, path.relative_to(BUILT).as_posix(), abs_src_path=str(path)))
    for name in ("demo.png", "fmu.png", "gap.png", "paper.png"):
        files.append(File.generated(config, f"assets/{name}", abs_src_path=str(pages.RESULTS / name)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    return pages.expanded(markdown, page.file.src_uri)


def on_page_content(content: str, **_: Any) -> str:
    from latex2mathml.converter import convert

    def mathml(match: re.Match[str]) -> str:
        made = convert(html.unescape(match[2]), display="block" if match[1] == "div" else "inline")
        return f'<div class="equation">{made}</div>' if match[1] == "div" else made

    content = MATH.sub(mathml, content)
    if "arithmatex" in content:
        raise ValueError("an equation was not made into MathML")
    # wide tables scroll by themselves, by keyboard, too; the page does not
    content = re.sub(r"<table>", '<div class="wide" tabindex="0" role="region" aria-label="table"><table>', content)
    return content.replace("</table>", "</table></div>")
