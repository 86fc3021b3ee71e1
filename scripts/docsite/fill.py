"""Write tables and code into the Markdown that git holds, so that a reader of the repository sees them.

    .venv/bin/python -m docsite.fill             write
    .venv/bin/python -m docsite.fill --check     write nothing; fail where a block is not current

A block begins with `<!-- table: X -->` or `<!-- code: X -->` and ends with `<!-- end -->`. X is a file of the repository, a
function of docsite.tables or of this module, or symptom/CASE of docsite.symptoms. Text between the two comments is replaced.
"""

import enum
import functools
import inspect
import re
import sys
from pathlib import Path
from types import FunctionType
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts")]

from docsite import links, symptoms, tables  # noqa: E402

BLOCK = re.compile(r"^<!-- (table|code): (\S+) -->\n(.*?)^<!-- end -->$", flags=re.M | re.S)
LANGUAGES = {".c": "c", ".py": "python", ".toml": "toml"}


def effects() -> str:
    """Return a table of all effects and a section for each."""
    known = tables.library().effects
    anchors = {e.id: links.slug(f"{e.id}: {e.title}") for e in known.values()}
    rows = [
        [
            f"[{e.id}](#{anchors[e.id]})",
            tables.cell(e.title),
            ", ".join(e.entry_points),
            tables.cell(e.channels),
        ]
        for e in known.values()
    ]
    text = [tables.table(["effect", "what", "enters at", "shows in"], rows)]
    for e in known.values():
        alike = ", ".join(f"[{i}](#{anchors[i]})" if i in known else tables.cell(i) for i in e.look_alikes)
        parameters = [
            [
                tables.code(p.name),
                "strength" if p.strength else "given" if p.given else "shape",
                tables.cell(p.unit),
                tables.number(p.default),
                f"{p.low:g} .. {p.high:g}",
                "{:g} .. {:g}".format(*p.typical),
                tables.cell(p.text),
            ]
            for p in e.parameters
        ]
        text += [
            f"\n## {e.id}: {e.title}\n\n{tables.cell(tables.equation_of(e.id))}\n",
            f"Acts on {tables.HOOKS.get(e.hook, e.hook)}. Shows in {tables.cell(e.channels)}. Looks like {alike}. "
            f"In an estimator that has it: {tables.cell(e.estimator)}.\n",
            tables.table(
                ["parameter", "role", "unit", "default", "range", "typical", "meaning"],
                parameters,
                right=(3,),
            ),
        ]
    return "\n".join(text)


def signature(name: str, thing: Any) -> str:
    """Return the call of a function or class, one parameter a line."""
    if inspect.isclass(thing) and issubclass(thing, (enum.Enum, Exception, dict)):
        return name
    found = inspect.signature(thing)
    rows = [str(p).replace("'", "") for p in found.parameters.values() if p.name != "self"]
    back = "" if found.return_annotation is inspect.Signature.empty else f" -> {found.return_annotation}"
    return (
        f"{name}({', '.join(rows)}){back}"
        if len(rows) < 3
        else f"{name}(\n    " + ",\n    ".join(rows) + f",\n){back}"
    )


def python_api() -> str:
    """Return signature and docstring of every public name of the package tse, and of its public members."""
    import tse

    text = []

    def add(name: str, thing: Any, level: str) -> None:
        inner = getattr(thing, "fget", None) or getattr(thing, "func", None)  # of a property, a cached one
        head = name if inner else signature(name, thing)
        text.append(f"{level} {name}\n\n```text\n{head}\n\n{inspect.getdoc(inner or thing) or ''}\n```\n")

    names = list(tse.__all__)
    for module in ("files", "tables"):
        names += [f"{module}.{name}" for name in getattr(tse, module).__all__]
    for name in sorted(names, key=str.lower):
        thing = functools.reduce(getattr, name.split("."), tse)
        if not (inspect.isclass(thing) or inspect.isfunction(thing)):
            continue
        add(f"tse.{name}", thing, "##")
        for member, value in vars(thing).items() if inspect.isclass(thing) else ():
            if not member.startswith("_") and isinstance(
                value, (FunctionType, property, functools.cached_property)
            ):
                add(f"tse.{name}.{member}", value, "###")
    return "\n".join(text)


def untitled(text: str) -> str:
    return re.sub(r"\A(?:<!--[\s\S]*?-->\s*)*(?:# .*\n)?\s*", "", text)


def made(kind: str, what: str) -> str:
    """Return what stands in a block."""
    if kind == "code":
        text = (ROOT / what).read_text(encoding="utf-8").rstrip()
        return f"<!-- not run: the file {what}, which a test of its own runs -->\n```{LANGUAGES[Path(what).suffix]}\n{text}\n```\n"
    if what.endswith(".md"):
        return "\n" + untitled((ROOT / "scripts" / what).read_text(encoding="utf-8")).rstrip() + "\n\n"
    of, _, name = what.rpartition("/")
    text = symptoms.shown(name) if of == "symptom" else (globals().get(what) or getattr(tables, what))()
    lines = [line.rstrip() for line in untitled(text).splitlines()]
    return "\n" + re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).rstrip() + "\n\n"


def filled(text: str) -> str:
    """Return a page with every block current."""
    return BLOCK.sub(lambda m: f"<!-- {m[1]}: {m[2]} -->\n{made(m[1], m[2])}<!-- end -->", text)


def main() -> int:
    stale = []
    for path in links.files("*.md"):
        text = path.read_text(encoding="utf-8")
        if (now := filled(text)) != text:
            stale.append(path.relative_to(ROOT).as_posix())
            if "--check" not in sys.argv:
                path.write_text(now, encoding="utf-8")
    for name in stale:
        print(name)
    return 1 if stale and "--check" in sys.argv else 0


if __name__ == "__main__":
    sys.exit(main())
