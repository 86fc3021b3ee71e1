"""The house's docstrings as Markdown, for the Python reference: what stands below `Given:` becomes a list, Refused and
Returned paragraphs."""

from __future__ import annotations

import re
from typing import Any

import griffe

WORD = re.compile(r"^(Given|Returned|Refused|Updated|Times)\b(?: \(([\w, ]+)\))?:", flags=re.M)
ROW = re.compile(r"(\w[\w, \[\]/]*?(?: \([^)]*\))?(?:, \w[^ ]*(?: \[[^\]]*\])?(?: \([^)]*\))?)*?) {2,}(\S.*)")


def markdown(text: str) -> str:
    """A docstring, with its indented tables of arguments as lists."""
    lines, made, inside = text.splitlines(), [], False
    for line in lines:
        if re.fullmatch(r"Given:", line.strip()):
            made += ["", "**Given**", ""]
            inside = True
            continue
        if inside:
            body = line.removeprefix("    ")
            row = ROW.fullmatch(body)
            if line.startswith("    ") and row and not body.startswith(" "):
                made.append(f"- `{row[1].strip()}`: {row[2]}")
                continue
            if line.startswith("    ") and body.strip():
                text = body.strip()
                made.append(f"    {text}" if body.startswith(" ") else f"- {text}")
                continue
            inside = bool(line.strip()) and line.startswith("    ")
        if WORD.match(line):
            made.append("")
        made.append(WORD.sub(lambda m: f"**{m[1]}**" + (f" ({m[2]})" if m[2] else "") + ":", line))
    return "\n".join(made)


class House(griffe.Extension):
    """Rewrites every docstring that has one of these words."""

    def on_object(self, *, obj: Any, **_: Any) -> None:
        if obj.docstring is not None and WORD.search(obj.docstring.value):
            obj.docstring.value = markdown(obj.docstring.value)
