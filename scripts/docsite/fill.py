"""Write the generated blocks of the Markdown pages: tables and code.

    .venv/bin/python -m docsite.fill             write
    .venv/bin/python -m docsite.fill --check     write nothing; fail if a block is stale

A block begins with the comment `<!-- table: X -->` or `<!-- code: X -->` and ends with
the comment `<!-- end -->`. The text between both comments is replaced by text that
depends on X:
    path of a file   the content of the file
    symptom/CASE     the description of the case CASE, a key of docsite.symptoms.CASES
    any other name   the text that the function make_X() of this module or of
                     docsite.tables returns
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
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "scripts" / "dev")]

import prose  # noqa: E402
from docsite import links, symptoms, tables  # noqa: E402

PAGE_BLOCK = re.compile(r"^<!-- (table|code): (\S+) -->\n(.*?)^<!-- end -->$", flags=re.M | re.S)
LANGUAGES = {".c": "c", ".py": "python", ".toml": "toml"}  # language of a code block, by suffix


def make_effects() -> str:
    """Return a table of all effects, and a section on each effect."""
    known = tables.library().effects
    anchors = {e.id: links.make_slug(f"{e.id}: {e.title}") for e in known.values()}
    rows = [
        [
            f"[{e.id}](#{anchors[e.id]})",
            tables.escape_cell(e.title),
            ", ".join(e.entry_points),
            tables.escape_cell(e.channels),
        ]
        for e in known.values()
    ]
    text = [tables.format_table(["effect", "description", "part of the model", "shows in"], rows)]
    for e in known.values():
        alike = ", ".join(
            f"[{i}](#{anchors[i]})" if i in known else tables.escape_cell(i) for i in e.look_alikes
        )
        parameters = [
            [
                tables.format_code(p.name),
                "strength" if p.strength else "given" if p.given else "shape",
                tables.escape_cell(p.unit),
                tables.format_number(p.default),
                f"{p.low:g} .. {p.high:g}",
                "{:g} .. {:g}".format(*p.typical),
                tables.escape_cell(p.text),
            ]
            for p in e.parameters
        ]
        facts = [
            f"Model: {tables.find_equation(e.id)}\n",
            f"- acts on: {tables.HOOKS[e.hook]};",
            f"- shows in: {tables.escape_cell(e.channels)};",
            f"- looks like: {alike};",
            f"- estimate: {tables.escape_cell(e.estimator)}.\n",
        ]
        text += [
            f"\n## {e.id}: {e.title}\n",
            prose.wrap_prose("\n".join(facts)),
            tables.format_table(
                ["parameter", "role", "unit", "default", "range", "typical", "meaning"],
                parameters,
                right=(3,),
            ),
        ]
    return "\n".join(text)


def format_signature(name: str, thing: Any) -> str:
    """Return the signature of a function or class; for enums, exceptions and dicts, only
    the name.

    If there are three or more parameters, each is written on a line of its own."""
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


def make_python_api() -> str:
    """Return the signature and the docstring of each public function and class of tse,
    and of each public method and property of these classes."""
    import tse

    text = []

    def add(name: str, thing: Any, level: str) -> None:
        # the function behind a property (fget) or a cached property (func); None for any
        # other object
        inner = getattr(thing, "fget", None) or getattr(thing, "func", None)
        head = name if inner else format_signature(name, thing)
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


def strip_title(text: str) -> str:
    """Return a page without the comments and the title at its start."""
    return re.sub(r"\A(?:<!--[\s\S]*?-->\s*)*(?:# .*\n)?\s*", "", text)


def make_block(kind: str, what: str) -> str:
    """Return the content of the block `<!-- kind: what -->`."""
    if kind == "code":
        text = (ROOT / what).read_text(encoding="utf-8").rstrip()
        note = f"<!-- not run: a test of its own runs the file {what} -->"
        return f"{note}\n```{LANGUAGES[Path(what).suffix]}\n{text}\n```\n"
    if what.endswith(".md"):
        return "\n" + strip_title((ROOT / "scripts" / what).read_text(encoding="utf-8")).rstrip() + "\n\n"
    of, _, name = what.rpartition("/")
    if of == "symptom":
        text = symptoms.show_case(name)
    else:
        make = globals().get(f"make_{what}") or getattr(tables, f"make_{what}")
        text = make()
    lines = [line.rstrip() for line in strip_title(text).splitlines()]
    return "\n" + re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).rstrip() + "\n\n"


def fill_page(text: str) -> str:
    """Return the page `text`, in which the content of every block is generated again."""
    return PAGE_BLOCK.sub(lambda m: f"<!-- {m[1]}: {m[2]} -->\n{make_block(m[1], m[2])}<!-- end -->", text)


def main() -> int:
    """Write the pages whose blocks have changed, and print their names. With --check,
    only print the names. Return 1 if --check has found a page, otherwise 0."""
    stale = []
    for path in links.list_files("*.md"):
        text = path.read_text(encoding="utf-8")
        if (now := fill_page(text)) != text:
            stale.append(path.relative_to(ROOT).as_posix())
            if "--check" not in sys.argv:
                path.write_text(now, encoding="utf-8")
    for name in stale:
        print(name)
    return 1 if stale and "--check" in sys.argv else 0


if __name__ == "__main__":
    sys.exit(main())
