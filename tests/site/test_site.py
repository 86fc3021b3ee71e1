"""The site builds without a warning and without a network, and its references are
complete.

Code on the pages runs, compiles, or states why not. The Markdown that git holds is
complete as a forge shows it. README, pages, messages, help, comments and names use words
of the field.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest

import tse
from tse.library.core import CONFIG, INPUT, OUTPUT, REASON, SIM_CONFIG, STATUS, library
from tselab.cli import CONTEXT, cli

ROOT = Path(__file__).resolve().parents[2]
sys.path += [str(ROOT / "scripts"), str(ROOT / "scripts" / "dev")]
from docsite import fill, links, tables  # noqa: E402

if not (shutil.which("git") and (ROOT / ".git").exists()):
    pytest.skip("git is not installed, or this is no checkout", allow_module_level=True)
PAGES = ROOT / "docs" / "pages"

FENCE = re.compile(
    r"(?:^<!-- (?P<why>not [^>]+?) -->\n)?^```(?P<kind>\w*)\n(?P<body>.*?)^```$", flags=re.M | re.S
)
RUN = {"python", "c", "console", "sh", "toml", "cmake", "sql", "text", ""}
NEEDED = ("material", "latex2mathml")
ABSENT = "scripts/setup.sh docs installs what builds the site"
PRELUDE = """#include <stdint.h>
#include <stddef.h>
#include "tse/tse.h"
int complain_about(const char *wrong);
int next_row(tse_input *u);
void use(tse_real mean, tse_real sd);
void write_to_non_volatile_memory(const uint8_t *bytes, size_t n);
void start_as_the_settings_say(void);
"""


def read_pages() -> dict[str, str]:
    """Return README and the pages by path."""
    paths = [ROOT / "README.md", *sorted(PAGES.rglob("*.md"))]
    return {p.relative_to(ROOT).as_posix(): p.read_text(encoding="utf-8") for p in paths}


def find_blocks(kind: str) -> list[pytest.param]:
    """Return the code blocks of some languages as test parameters."""
    found = []
    for name, text in read_pages().items():
        for i, m in enumerate(FENCE.finditer(text)):
            if m["kind"] in kind.split() and not m["why"]:
                found.append(pytest.param(m["body"], id=f"{name}-{i}"))
    assert found, kind
    return found


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Build the site in a process that cannot reach any other machine."""
    for module in NEEDED:
        pytest.importorskip(module, reason=ABSENT)
    out = tmp_path_factory.mktemp("site")
    offline = out / "sitecustomize.py"
    offline.write_text(
        "import socket\ndef no(*_a, **_k):\n    raise OSError('the site is built offline')\n"
        "socket.socket.connect = socket.create_connection = socket.getaddrinfo = no\n"
    )
    env = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(out), str(ROOT / "scripts"), os.environ.get("PYTHONPATH", "")]),
        "NO_MKDOCS_2_WARNING": "1",
    }
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "mkdocs",
            "build",
            "--quiet",
            "--strict",
            "-f",
            ROOT / "docs" / "mkdocs.yml",
            "-d",
            out / "site",
        ],
        capture_output=True,
        text=True,
        env=env,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert not done.stderr.strip(), done.stderr
    return out / "site"


def test_nothing_comes_from_the_net_and_equations_are_mathml(site):
    html = {p: p.read_text(encoding="utf-8") for p in site.rglob("*.html")}
    assert len(html) > 50
    assert [
        x for text in html.values() for x in re.findall(r'(?:src|srcset)="(?:https?:)?//[^"]+"', text)
    ] == []
    assert "fonts.googleapis" not in html[site / "index.html"] + (site / "site.css").read_text()
    model = html[site / "docs" / "pages" / "method" / "model.html"]
    assert (
        model.count("<math") > 30
        and "arithmatex" not in model
        and "\\frac" not in model.replace("annotation", "")
    )


def test_every_result_is_on_the_page_of_results():
    home = (PAGES / "results" / "index.md").read_text(encoding="utf-8")
    results = {p.name for p in (ROOT / "scripts" / "results").glob("*.md")}
    assert [r for r in results if f"/{r})" not in home] == []


@pytest.mark.parametrize(("page", "which"), [("config", CONFIG), ("rows", INPUT), ("simulator", SIM_CONFIG)])
def test_every_field_is_in_the_c_reference_with_range_and_unit(page, which):
    text = (PAGES / "reference" / f"{page}.md").read_text(encoding="utf-8")
    for f in library().fields(which):
        anchor = rf'<span id="{f.name}"></span>' if which == CONFIG else ""
        row = re.search(rf"^\| {anchor}`{f.name}` \|.*$", text, flags=re.M)
        assert row, f.name
        if f.has_range:
            assert f"{f.low:g} .. {f.high:g}" in row[0], f.name
        if which == CONFIG:
            assert tables.format_number(f.default) in row[0], f.name


def test_every_output_status_reason_and_effect_is_in_the_reference():
    text = (PAGES / "reference" / "rows.md").read_text(encoding="utf-8")
    members = tables.list_output_members()
    for f in library().fields(OUTPUT):
        assert f"`{members[f.name]}`" in text and f"`{f.name}`" in text, f.name
    for which in (STATUS, REASON):
        assert all(f"`{f.name}`" in text for f in library().fields(which))
    text = (PAGES / "gap" / "effects.md").read_text(encoding="utf-8")
    assert all(f"\n## {e}: " in text for e in library().effects)


def test_every_public_function_of_the_headers_has_its_comment():
    headers = ("tse.h", "learnt.h", "simulate.h", "replay.h", "describe.h")
    names = [
        re.findall(r"^#define (tse_\w+) +TSE_NAME", (tables.TSE / h).read_text(), flags=re.M) for h in headers
    ]
    assert {n for of in names for n in of} == {n for h in headers for n, _, _ in tables.list_functions(h)}


def test_the_python_reference_has_every_name():
    text = (PAGES / "reference" / "python.md").read_text(encoding="utf-8")
    for name in ("estimate", "Filter", "Filter.step", "Result.stiffness_sd", "simulate", "InputError"):
        assert re.search(rf"^##+ tse\.{re.escape(name)}$", text, flags=re.M), name


# ---- code


def test_every_block_says_what_it_is():
    for name, text in read_pages().items():
        for m in FENCE.finditer(text):
            assert m["kind"] in RUN, f"{name}: a block of {m['kind']!r}"
            assert m["kind"] != "sql" or m["why"], f"{name}: sql without a reason"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a small log and a vehicle file for the code blocks."""
    from tse.report.tables import simulated_vehicle

    out = tmp_path_factory.mktemp("blocks")
    tse.simulate("square-waves", duration=8).log.to_csv(out / "log.csv", index=False)
    (out / "car.toml").write_text(simulated_vehicle())
    return out


@pytest.mark.parametrize("body", find_blocks("python"))
def test_python_runs(body, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    exec(compile(body, "page", "exec"), {"__name__": "page"})
    assert capsys.readouterr().out


@pytest.mark.parametrize("body", find_blocks("c"))
def test_c_compiles(body, tmp_path):
    if (cc := shutil.which("cc")) is None:
        pytest.skip("no C compiler")
    (tmp_path / "page.c").write_text(PRELUDE + body)
    done = subprocess.run(
        [
            cc,
            "-std=c99",
            "-Wall",
            "-Wextra",
            "-Werror",
            "-Wno-unused-variable",
            "-fsyntax-only",
            "-I",
            ROOT / "include",
            "-DTSE_REAL_DOUBLE",
            tmp_path / "page.c",
        ],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr


def parse_command(words: list[str]) -> None:
    """Parse a command line by click without running it or opening its files."""
    command: click.Command = cli
    path = "tselab"
    while isinstance(command, click.Group):
        ctx = click.Context(command, info_name=path, **CONTEXT)
        if not words or command.get_command(ctx, words[0]) is None:
            break
        path = words.pop(0)
        command = command.get_command(ctx, path)
    if isinstance(command, click.Group):
        if path != "gap":  # `tselab gap` runs a command without a name
            raise AssertionError(f"{path}: no such command as {words[:1]}")
        command = command.get_command(click.Context(command, **CONTEXT), "run")
    try:
        given, rest, _ = command.make_parser(click.Context(command, info_name=path, **CONTEXT)).parse_args(
            list(words)
        )
    except click.UsageError as error:
        raise AssertionError(f"tselab {path}: {error.format_message()}") from None
    missing = [
        p.opts[-1]
        for p in command.params
        if isinstance(p, click.Option) and p.required and p.name not in given
    ]
    assert not missing and not rest, f"tselab {path} {' '.join(words)}: {missing} {rest}"


@pytest.mark.parametrize("body", find_blocks("console sh"))
def test_commands_are_those_of_the_tools(body):
    import shlex

    for line in body.splitlines():
        words = shlex.split(line.removeprefix("$ "), comments=True)
        if not words:
            continue
        if words[0] in ("tselab", ".venv/bin/tselab"):
            words = words[1 : words.index(">")] if ">" in words else words[1:]
            parse_command(words)
        elif words[0] not in ("git", "cc"):
            assert (ROOT / words[0]).is_file() and os.access(ROOT / words[0], os.X_OK), words[0]


def test_a_command_that_is_not_there_is_found():
    for words in (
        ["estimat"],
        ["estimate", "log.csv", "--vehicle", "car.toml", "--repot", "x"],
        ["estimate", "log.csv"],
        ["fmu", "buil"],
    ):
        with pytest.raises(AssertionError):
            parse_command(list(words))


@pytest.mark.parametrize("body", find_blocks("toml"))
def test_toml_is_read_by_the_tools(body, folder):
    from tse.car.formula import read_formula
    from tse.car.vehicle import read_vehicle
    from tse.channels.signals import read_signals
    from tse.library.files import read_toml

    path = folder / "page.toml"
    path.write_text(body)
    data = read_toml(path)
    if "signals" in data:
        read_signals(path)
    elif "formula" in data and "place" in data:
        read_formula(path)
    else:
        path.write_text(
            (folder / "car.toml").read_text().partition("[uncertainty]")[0] + body
            if "mass" not in data
            else body
        )
        read_vehicle(path)


def test_a_picture_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    from docsite import pictures

    (made,) = pictures.draw(["fault"], tmp_path)
    assert made.read_bytes().startswith(b"\x89PNG") and made.stat().st_size < pictures.MAX_PICTURE_BYTES


FILES = links.list_files("*.md")
HELD = set(links.list_files())
RAW = re.compile(r"^(?:!!!|\?\?\?|:::|--8<--|\{[%!])|\)\{ ?[.:]|^<!-- (?:include|api):|\{\{", flags=re.M)
MAX_PICTURE_BYTES = 100_000


def find_wrong_links(path: Path) -> list[str]:
    """Return the links of a page that lead to no file of git, or to no anchor of one."""
    found = []
    for target, anchor in links.list_local_links(path):
        if target not in HELD:
            found.append(f"{target}: git holds no such file")
        elif (
            anchor
            and target.suffix == ".md"
            and anchor not in links.list_anchors(target.read_text(encoding="utf-8"))
        ):
            found.append(f"{target}#{anchor}: no such anchor")
    return found


def find_raw_markers(text: str) -> list[str]:
    """Return markers that a builder expands and a forge shows as they are."""
    prose = links.CODE_BLOCK.sub("", text)
    lone = [
        f"<!-- {k}: {x} -->"
        for k, x in re.findall(r"^<!-- (table|code): (\S+) -->$", fill.PAGE_BLOCK.sub("", text), re.M)
    ]
    empty = [m[2] for m in fill.PAGE_BLOCK.finditer(text) if not m[3].strip()]
    return [m[0] for m in RAW.finditer(prose)] + lone + empty


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_a_page_is_whole(path):
    assert find_wrong_links(path) == []
    assert find_raw_markers(path.read_text(encoding="utf-8")) == []


def test_what_is_wrong_is_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"[a](no.md) ![b](no.png) [c]({ROOT}/README.md#no) `[d](code.md)` [e](#own)\n\n# Own\n")
    assert len(find_wrong_links(page)) == 4  # the page itself is not in git
    for text in (
        "!!! note\n",
        "::: tse.estimate\n",
        "<!-- table: x -->\n",
        "![a](b.png){ .light }\n",
        "<!-- table: x -->\n<!-- end -->\n",
    ):
        assert find_raw_markers(text), text
    assert not find_raw_markers("`!!!`\n\n<!-- table: x -->\nsomething\n<!-- end -->\n")


def test_anchors_are_those_of_a_forge():
    text = (
        '# `a_b` and [c](d.md), e - f\n```sh\n# no heading\n```\n## Twice\n## Twice\n<span id="own"></span>\n'
    )
    assert links.list_anchors(text) == {"a_b-and-c-e---f", "twice", "twice-1", "own"}


BLOCKS = sorted(
    {(m[1], m[2]) for p in FILES for m in fill.PAGE_BLOCK.finditer(p.read_text(encoding="utf-8"))}
)


@pytest.mark.parametrize("block", BLOCKS, ids=lambda b: b[1])
def test_a_table_that_is_written_in_is_current(block):
    """`.venv/bin/python -m docsite.fill` updates them."""
    kind, what = block
    now = fill.make_block(kind, what)
    for path in FILES:
        for m in fill.PAGE_BLOCK.finditer(path.read_text(encoding="utf-8")):
            if (m[1], m[2]) == block:
                assert m[3] == now, path


def test_pictures_are_small():
    shown = {t for p in FILES for t, _ in links.list_local_links(p) if t.suffix in (".png", ".svg")}
    assert shown and [p.name for p in shown if p.stat().st_size > MAX_PICTURE_BYTES] == []


INSTEAD = {  # word -> word of a textbook
    r"(?:un)?told": "known, assumed, set; observable; separable from",
    r"foret(?:ell|old)\w*": "predict",
    r"noticed": "detected",
    r"nod(?:s|ding)?": "pitch, low-pass",
    r"loud(?:er|ly)?": "noisy",
    r"mothers?|births?|youth": "parent, spawn, age",
    r"dustbin": "the hypothesis that none fits",
    r"bears?": "spawn; confirm",
    r"(?<!await )(?<!new )promis(?:e|es|ed)": "expected gain",
    r"of late": "recent",
    r"says? nothing (?:of|about|to|against)": "does not show",
    r"95 % bands?": "95 % interval",
}
BAD = re.compile("|".join(rf"\b(?:{word})\b" for word in INSTEAD), flags=re.I)
WHERE = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "src/", "include/", "fmu/", "scripts/", "docs/")
KINDS = {".md", ".py", ".c", ".h", ".js", ".html", ".j2", ".toml", ".sh", ".yml"}
NOT = (
    "docs/assets/",
    "docs/try.html",
    "scripts/lock",
    "scripts/results/",
)  # others' code; tables are as their command wrote them
WORDED = [
    p
    for p in links.list_files()
    if (name := p.relative_to(ROOT).as_posix()).startswith(WHERE)
    and p.suffix in KINDS
    and not name.startswith(NOT)
]


def find_house_words(text: str) -> list[str]:
    """Return the lines with such a word, alone or between underscores."""
    return [line.strip() for line in text.splitlines() if BAD.search(line.replace("_", " "))]


def test_files_are_in_the_words_of_the_field():
    found = {p.relative_to(ROOT).as_posix(): find_house_words(p.read_text(encoding="utf-8")) for p in WORDED}
    assert len(WORDED) > 300 and {name: lines for name, lines in found.items() if lines} == {}


@pytest.mark.parametrize(
    ("line", "bad"),
    [
        ("what it is told", True),
        ("told_before = 1", True),
        ("A road is noticed", True),
        ("await new Promise(go)", False),
        ("it says nothing of slip", True),
        ("where the file says nothing", False),
        ("the node", False),
    ],
)
def test_the_words_are_found(line, bad):
    assert bool(find_house_words(line)) is bad


def test_a_picture_that_is_made_small_keeps_the_colour_of_its_large_areas(tmp_path):
    pytest.importorskip("matplotlib", reason=ABSENT)
    np = pytest.importorskip("numpy")
    image = pytest.importorskip("PIL.Image")
    from docsite import pictures

    pixels = np.full((200, 300, 3), 255, np.uint8)
    pixels[20:180, 20:120] = (236, 237, 239)  # where nothing is valid
    for i in range(200):  # lines with many shades
        pixels[i, 150:] = (i, 255 - i, 128 + i // 2)
    image.fromarray(pixels).save(tmp_path / "it.png")
    pictures.shrink_picture(tmp_path / "it.png")
    small = image.open(tmp_path / "it.png").convert("RGB")
    assert small.getpixel((60, 100)) == (236, 237, 239) and small.getpixel((5, 5)) == (255, 255, 255)
