"""Directives of the pages in docs/pages, and the pages that are made.

<!-- include: scripts/results/stress.md -->                        a Markdown file of the repository, without its title
<!-- include: CONTRIBUTING.md section=Add an effect -->            the part below one of its headings
<!-- include: scripts/results/peers.md columns=1: case; bias -->   some columns of its first table
<!-- code: scripts/examples/stream.py python -->                   a file as a block of code
<!-- table: config -->                                             a function of docsite.tables
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Callable
from pathlib import Path

from docsite import tables

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "docs" / "pages"
RESULTS = ROOT / "scripts" / "results"
DIRECTIVE = re.compile(r"^<!-- (include|code|table): (.+?) -->$", flags=re.M)
SOURCES = {  # where a file of the repository is on the site: a link to it leads there
    "src/EQUATIONS.md": "method/ledger.md",
    "include/tse/constants.def": "method/constants.md",
    "include/tse/tse.h": "reference/c.md",
    "include/tse/learnt.h": "reference/c.md",
    "include/tse/config.def": "reference/config.md",
    "include/tse/latency.def": "reference/config.md",
    "include/tse/input.def": "reference/input.md",
    "include/tse/output.def": "reference/output.md",
    "include/tse/status.h": "reference/status.md",
    "include/tse/effects.def": "gap/effects.md",
    "include/tse/formula.def": "gap/formula.md",
    "scripts/dropin/README.md": "use/packages.md",
    "CONTRIBUTING.md": "help/contributing.md",
    "CHANGELOG.md": "help/changelog.md",
    **{f"scripts/results/{p.name}": f"results/{p.name}" for p in RESULTS.glob("*.md")},
}
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)\s]+)\)")


def relink(text: str, source: str, page: str) -> str:
    """Links of a file of the repository, as of the page on which it stands: to the page that has the target, or, where none has
    it, only its name."""

    def link(match: re.Match[str]) -> str:
        words, target = match[1], match[2]
        if "://" in target or target.startswith("#"):
            return match[0]
        path, _, anchor = target.partition("#")
        there = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
        if there in SOURCES:
            at = posixpath.relpath(SOURCES[there], posixpath.dirname(page) or ".")
            return f"[{words}]({at}{'#' + anchor if anchor else ''})"
        if not (ROOT / there).exists():
            raise ValueError(f"{source}: a link leads to {target}, which does not exist")
        return f"{words} (`{there}`)" if words.strip("`") != there else f"`{there}`"

    parts = re.split(r"(^```.*?^```$)", text, flags=re.M | re.S)  # not in code
    return "".join(part if part.startswith("```") else LINK.sub(link, part) for part in parts)


def section(text: str, heading: str, source: str) -> str:
    """What stands below a heading, up to the next of its level."""
    found = re.search(rf"^(#+) {re.escape(heading)}\n(.*?)(?=^#{{1,6}} |\Z)", text, flags=re.M | re.S)
    if not found:
        raise ValueError(f"{source}: there is no heading {heading!r}")
    level = len(found[1])
    rest = text[found.start(2) :]
    end = re.search(rf"^#{{1,{level}}} ", rest, flags=re.M)
    return rest[: end.start()] if end else rest


def columns(text: str, which: int, names: list[str], source: str) -> str:
    """Some columns of the which-th table."""
    found = re.findall(r"(?:^\|.*\n)+", text + "\n", flags=re.M)
    rows = [[c.strip() for c in line.strip("| ").split("|")] for line in found[which - 1].splitlines()]
    if absent := [name for name in names if name not in rows[0]]:
        raise ValueError(f"{source}: table {which} has no column {', '.join(absent)}")
    at = [rows[0].index(name) for name in names]
    return "\n".join("| " + " | ".join(row[i] for i in at) + " |" for row in rows)


def loose(text: str) -> str:
    """An empty line before lists and tables, which Python's Markdown asks for and others do not; code stays."""
    lines: list[str] = []
    inside = False
    for line in text.splitlines():
        fence = line.lstrip().startswith("```")
        before = lines[-1] if lines else ""
        if not inside and before.strip():
            item = re.match(r"(?:[-*] |\d+\. )", line) and not re.match(r"(?:\s*[-*] |\s*\d+\. |  )", before)
            row = line.startswith("|") and not before.startswith("|")
            if item or row or (fence and not line.startswith(" ")):
                lines.append("")
        lines.append(line)
        inside ^= fence
    return "\n".join(lines) + "\n"


def untitled(text: str) -> str:
    text = re.sub(r"\A(?:<!--.*?-->\s*)*", "", text, flags=re.S)
    return re.sub(r"\A# .*\n", "", text)


def include(words: str, page: str) -> str:
    source, _, option = words.partition(" ")
    text = (ROOT / source).read_text(encoding="utf-8")
    name, _, value = option.partition("=")
    if name == "section":
        text = section(text, value, source)
    elif name == "columns":
        which, _, wanted = value.partition(":")
        text = columns(text, int(which), [w.strip() for w in wanted.split(";")], source)
    else:
        text = untitled(text)
    return loose(relink(text, source, page))


def code(words: str) -> str:
    source, _, language = words.partition(" ")
    text = (ROOT / source).read_text(encoding="utf-8").rstrip()
    return f"<!-- not run: the file {source}, which a test of its own runs -->\n```{language}\n{text}\n```"


def expanded(text: str, page: str) -> str:
    """A page with its directives carried out."""

    def carry_out(match: re.Match[str]) -> str:
        kind, words = match[1], match[2].strip()
        if kind == "include":
            return include(words, page)
        if kind == "code":
            return code(words)
        name, *arguments = words.split()
        made: Callable[..., str] = getattr(tables, name)
        return made(*arguments)

    return DIRECTIVE.sub(carry_out, text)


def made_pages() -> dict[str, str]:
    """Pages that nobody writes: address -> Markdown."""
    pages = {
        "reference/config.md": tables.config_page(),
        "reference/c.md": tables.c_page(),
        "reference/cli.md": tables.cli_page(),
        "gap/effects.md": tables.effects_page(),
        "help/changelog.md": "# Changes\n\n<!-- include: CHANGELOG.md -->\n",
        "help/contributing.md": "# Contributing\n\n<!-- include: CONTRIBUTING.md -->\n",
        "method/ledger.md": "# Ledger of equations\n\n<!-- include: src/EQUATIONS.md -->\n",
        "use/packages.md": "# Packages for other builds\n\n<!-- include: scripts/dropin/README.md -->\n",
    }
    for e in tables.library().effects.values():
        pages[f"gap/effects/{e.id}.md"] = tables.effect_page(e)
    for path in sorted(RESULTS.glob("*.md")):
        if not (PAGES / "results" / path.name).exists():
            head = re.search(r"^# (.*)$", path.read_text(encoding="utf-8"), flags=re.M)
            if head is None:
                raise ValueError(
                    f"{path.name} has no title, and docs/pages/results/{path.name}, which would say what it is, is missing"
                )
            pages[f"results/{path.name}"] = (
                f"# {head[1]}\n\n<!-- include: scripts/results/{path.name} -->\n\n*This page is `scripts/results/{path.name}`.*\n"
            )
    return pages
