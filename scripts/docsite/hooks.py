"""Hooks that MkDocs calls when it builds the site (docs/mkdocs.yml).

The site consists of README, docs/pages and the files to which they link. Files have the
same paths on the site as in git, so that links work on the site and in git.
"""

import html
import re
import sys
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "scripts" / "dev")]

from docsite import links  # noqa: E402

MATH = re.compile(r'<(span|div) class="arithmatex">(?:\\\(|\\\[)(.*?)(?:\\\)|\\\])</\1>', flags=re.S)
LIST = re.compile(r"(?:[-*] |\d+\. )")
IN_LIST = re.compile(r"\s*(?:[-*] |\d+\. )|  ")


def on_files(files: Files, config: Any) -> Files:
    """Add README, the pages, and all files to which they link, directly or through other
    pages."""
    found, waiting = set(), [ROOT / "README.md", *(ROOT / "docs" / "pages").rglob("*.md")]
    while waiting:
        path = waiting.pop()
        if path in found or not path.is_file():
            continue
        found.add(path)
        files.append(
            File(path.relative_to(ROOT).as_posix(), str(ROOT), config.site_dir, use_directory_urls=False)
        )
        if path.suffix == ".md":
            waiting += [target for target, _ in links.list_local_links(path)]
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Insert an empty line before a list, table or code block if there is none before it.

    Without this line, MkDocs does not recognise the list, table or code block, although
    code hosting sites do."""
    lines: list[str] = []
    inside = False
    for line in markdown.splitlines():
        fence = line.lstrip().startswith("```")
        before = lines[-1] if lines else ""
        if not inside and before.strip():
            item = LIST.match(line) and not IN_LIST.match(before)
            if (
                item
                or (line.startswith("|") and not before.startswith("|"))
                or (fence and not line.startswith(" "))
            ):
                lines.append("")
        lines.append(line)
        inside ^= fence
    return "\n".join(lines) + "\n"


def on_page_content(content: str, **_: Any) -> str:
    """Convert equations to MathML, which browsers show without scripts and network."""
    from latex2mathml.converter import convert

    def convert_equation(match: re.Match[str]) -> str:
        made = convert(html.unescape(match[2]), display="block" if match[1] == "div" else "inline")
        return f'<div class="equation">{made}</div>' if match[1] == "div" else made

    content = MATH.sub(convert_equation, content)
    if "arithmatex" in content:
        raise ValueError(
            'an equation, or the word "arithmatex", is left on this page: write an equation as $...$ or '
            "$$...$$, so that it can be converted to MathML"
        )
    return content
