"""The site of docs/: it builds without a warning and without the net, its links lead somewhere, its tables are whole, and what it
shows as code runs, compiles, or says why not."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import click
import pytest

import tse
from tselab.cli import cli
from tselab.core import CONFIG, INPUT, OUTPUT, REASON, SIM_CONFIG, STATUS, library

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "scripts"))
from docsite import check, look, pages, tables  # noqa: E402

FENCE = re.compile(r"(?:^<!-- (?P<why>not [^>]+?) -->\n)?^```(?P<kind>\w*)\n(?P<body>.*?)^```$", flags=re.M | re.S)
RUN = {"python", "c", "console", "sh", "toml", "cmake", "sql", "text", ""}
NEEDED = ("material", "mkdocstrings_handlers.python", "latex2mathml")
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


def written() -> dict[str, str]:
    return {
        p.relative_to(pages.PAGES).as_posix(): p.read_text(encoding="utf-8") for p in sorted(pages.PAGES.rglob("*.md"))
    }


def blocks(kind: str) -> list[pytest.param]:
    found = []
    for name, text in {**written(), **pages.made_pages()}.items():
        if name.startswith(("help/changelog", "help/contributing", "method/ledger", "use/packages")):
            continue  # files of the repository with tests of their own
        for i, m in enumerate(FENCE.finditer(text)):
            if m["kind"] in kind.split() and not m["why"]:
                found.append(pytest.param(m["body"], id=f"{name}-{i}"))
    assert found, kind
    return found


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Built in a process that cannot reach any other machine."""
    for module in NEEDED:
        pytest.importorskip(module, reason=ABSENT)
    out = tmp_path_factory.mktemp("site")
    parts = out / "parts"
    for name in ("sketch", "slope", "quiet", "bank", "fault"):  # pictures have a test of their own
        for scheme in ("light", "dark"):
            (parts / "assets").mkdir(parents=True, exist_ok=True)
            (parts / "assets" / f"{name}-{scheme}.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    (parts / "examples").mkdir()
    (parts / "examples" / "report.html").write_text("<p>")
    (parts / "try.html").write_text("<p>")  # tests/page has those of the page
    offline = out / "sitecustomize.py"
    offline.write_text(
        "import socket\ndef no(*_a, **_k):\n    raise OSError('the site is built offline')\n"
        "socket.socket.connect = socket.create_connection = socket.getaddrinfo = no\n"
    )
    env = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(out), str(ROOT / "scripts"), os.environ.get("PYTHONPATH", "")]),
        "TSE_SITE_PARTS": str(parts),
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


def test_the_process_that_builds_it_is_offline(tmp_path):
    """What the fixture above relies on."""
    (tmp_path / "sitecustomize.py").write_text(
        "import socket\ndef no(*_a, **_k):\n    raise OSError('offline')\nsocket.create_connection = no\n"
    )
    code = "import socket; socket.create_connection(('127.0.0.1', 9))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(tmp_path)}
    )
    assert "OSError: offline" in done.stderr and socket.create_connection is not None


def test_every_link_leads_somewhere_and_nothing_comes_from_the_net(site):
    assert check.wrong(site) == []
    scripts = [
        x
        for p in site.rglob("*.html")
        for x in re.findall(r'(?:src|srcset)="(?:https?:)?//[^"]+"', p.read_text(encoding="utf-8"))
    ]
    assert scripts == []
    assert "fonts.googleapis" not in (site / "index.html").read_text() + (site / "assets" / "site.css").read_text()


def test_what_is_wrong_is_found(tmp_path):
    (tmp_path / "index.html").write_text(
        '<h1 id="a"></h1><a href="#b"></a><a href="no.html"></a><img src="no.png">'
        '<script src="https://cdn.example/x.js"></script><a href="#a"></a>'
    )
    said = "\n".join(check.wrong(tmp_path))
    assert len(said.splitlines()) == 4
    for part in ("#b: there is no such anchor", "no.html leads nowhere", "no.png does not exist", "x.js from the net"):
        assert part in said


def test_every_page_is_in_the_navigation_and_every_result_is_a_page(site):
    results = {p.stem for p in pages.RESULTS.glob("*.md")}
    assert results <= {p.stem for p in (site / "results").glob("*.html")}
    home = (site / "results" / "index.html").read_text(encoding="utf-8")
    assert [r for r in results if f'href="{r}.html"' not in home] == []
    for name in results:
        own = pages.PAGES / "results" / f"{name}.md"
        if own.exists():
            assert f"<!-- include: scripts/results/{name}.md -->" in own.read_text(encoding="utf-8")


@pytest.mark.parametrize(("page", "which"), [("config", CONFIG), ("input", INPUT), ("simulator", SIM_CONFIG)])
def test_every_field_is_in_the_c_reference_with_range_and_unit(site, page, which):
    text = (site / "reference" / f"{page}.html").read_text(encoding="utf-8")
    for f in library().fields(which):
        row = re.search(
            rf"<tr>\s*<td>(?:<span id=\"{f.name}\"></span>)?<code>{f.name}</code></td>\s*<td><code>.*?</tr>",
            text,
            flags=re.S,
        )
        assert row, f.name
        if f.has_range:
            assert f"{f.low:g} .. {f.high:g}" in row[0], f.name
        if which == CONFIG:
            assert tables.number(f.default) in row[0], f.name


def test_every_output_status_and_reason_is_in_the_c_reference(site):
    text = (site / "reference" / "output.html").read_text(encoding="utf-8")
    members = tables.output_members()
    for f in library().fields(OUTPUT):
        assert f"<code>{members[f.name]}</code>" in text and f"<code>{f.name}</code>" in text, f.name
    text = (site / "reference" / "status.html").read_text(encoding="utf-8")
    for which in (STATUS, REASON):
        assert all(f"<code>{f.name}</code>" in text for f in library().fields(which))


def test_every_public_function_of_the_headers_has_its_comment():
    declared = {
        n
        for h in ("tse.h", "learnt.h", "simulate.h", "replay.h", "describe.h")
        for n in re.findall(r"^#define (tse_\w+) +TSE_NAME", (tables.TSE / h).read_text(), flags=re.M)
    }
    found = {
        n: c for h in ("tse.h", "learnt.h", "simulate.h", "replay.h", "describe.h") for n, _, c in tables.functions(h)
    }
    assert declared == set(found)


def test_equations_are_mathml_and_the_ledger_and_effects_are_there(site):
    text = (site / "method" / "model.html").read_text(encoding="utf-8")
    assert text.count("<math") > 30 and "arithmatex" not in text and "\\frac" not in text.replace("annotation", "")
    for e in library().effects:
        assert (site / "gap" / "effects" / f"{e}.html").is_file(), e
    ledger = (site / "method" / "ledger.html").read_text(encoding="utf-8")
    assert ledger.count("<tr>") > 100


def test_the_python_reference_has_signatures_and_lists(site):
    text = (site / "reference" / "python.html").read_text(encoding="utf-8")
    for name in ("estimate", "Filter", "Filter.step", "Result.stiffness_sd", "simulate", "InputError"):
        assert f'id="tse.{name}"' in text, name
    assert "<strong>Given</strong>" in text


def test_docstrings_of_the_house_become_lists():
    pytest.importorskip("griffe", reason=ABSENT)
    from docsite import docstrings

    said = docstrings.markdown(
        "Do.\n\nGiven:\n    a     first\n          goes on\n    b, c  two\nRefused (Error): never."
    )
    assert (
        "**Given**" in said
        and "- `a`: first\n    goes on" in said
        and "- `b, c`: two" in said
        and "**Refused** (Error): never." in said
    )


def test_tables_that_are_included_have_no_column_that_is_not_there():
    with pytest.raises(ValueError, match="has no column nothing"):
        pages.columns("| a | b |\n|---|---|\n| 1 | 2 |\n", 1, ["nothing"], "x.md")
    with pytest.raises(ValueError, match="does not exist"):
        pages.relink("[x](nowhere.md)", "README.md", "index.md")


# ---- code


def test_every_block_says_what_it_is():
    for name, text in written().items():
        for m in FENCE.finditer(text):
            assert m["kind"] in RUN, f"{name}: a block of {m['kind']!r}"
            assert m["kind"] != "sql" or m["why"], f"{name}: sql without a reason"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A small log and a vehicle file, as the blocks name them."""
    from tselab.tables import simulated_vehicle

    out = tmp_path_factory.mktemp("blocks")
    tse.simulate("square-waves", duration=8).log.to_csv(out / "log.csv", index=False)
    (out / "car.toml").write_text(simulated_vehicle())
    return out


@pytest.mark.parametrize("body", blocks("python"))
def test_python_runs(body, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    exec(compile(body, "page", "exec"), {"__name__": "page"})
    assert capsys.readouterr().out


@pytest.mark.parametrize("body", blocks("c"))
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


def parsed(words: list[str]) -> None:
    """Options and arguments of a command line, by click, without running it or opening its files."""
    command: click.Command = cli
    path = "tselab"
    while isinstance(command, click.Group):
        ctx = click.Context(command, info_name=path, resilient_parsing=False)
        if not words or command.get_command(ctx, words[0]) is None:
            break
        path = words.pop(0)
        command = command.get_command(ctx, path)
    if isinstance(command, click.Group):
        if path != "gap":  # whose command without a name is run
            raise AssertionError(f"{path}: no such command as {words[:1]}")
        command = command.get_command(click.Context(command), "run")
    try:
        given, rest, _ = command.make_parser(click.Context(command, info_name=path)).parse_args(list(words))
    except click.UsageError as error:
        raise AssertionError(f"tselab {path}: {error.format_message()}") from None
    missing = [p.opts[-1] for p in command.params if isinstance(p, click.Option) and p.required and p.name not in given]
    assert not missing and not rest, f"tselab {path} {' '.join(words)}: {missing} {rest}"


@pytest.mark.parametrize("body", blocks("console sh"))
def test_commands_are_those_of_the_tools(body):
    import shlex

    for line in body.splitlines():
        words = shlex.split(line.removeprefix("$ "), comments=True)
        if not words:
            continue
        if words[0] == "tselab":
            words = words[1 : words.index(">")] if ">" in words else words[1:]
            parsed(words)
        else:
            assert (ROOT / words[0]).is_file() and os.access(ROOT / words[0], os.X_OK), words[0]


def test_a_command_that_is_not_there_is_found():
    for words in (
        ["estimat"],
        ["estimate", "log.csv", "--vehicle", "car.toml", "--repot", "x"],
        ["estimate", "log.csv"],
        ["fmu", "buil"],
    ):
        with pytest.raises(AssertionError):
            parsed(list(words))


@pytest.mark.parametrize("body", blocks("toml"))
def test_toml_is_read_by_the_tools(body, folder):
    from tselab.formula import read_formula
    from tselab.logs.signals import read_signals
    from tselab.toml import read_toml
    from tselab.vehicle import read_vehicle

    path = folder / "page.toml"
    path.write_text(body)
    data = read_toml(path)
    if "signals" in data:
        read_signals(path)
    elif "formula" in data and "place" in data:
        read_formula(path)
    else:
        path.write_text(
            (folder / "car.toml").read_text().partition("[uncertainty]")[0] + body if "mass" not in data else body
        )
        read_vehicle(path)


def test_the_pictures_are_drawn_for_light_and_dark(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    from docsite import pictures

    monkeypatch.setattr(pictures, "PICTURES", {"sketch": pictures.sketch, "fault": pictures.fault})
    made = pictures.draw(tmp_path)
    assert [p.name for p in made] == ["sketch-light.svg", "sketch-dark.svg", "fault-light.svg", "fault-dark.svg"]
    assert all(p.read_text().startswith("<?xml") for p in made)
    assert made[2].read_text() != made[3].read_text()


@pytest.mark.skipif(look.browser() is None, reason="no chromium: pages are not looked at")
def test_a_browser_shows_the_start_page_on_a_phone_and_in_the_dark(site, tmp_path):
    from matplotlib.image import imread

    made = {p.stem.rpartition("-")[2]: p for p in look.take(site / "results" / "peers.html", tmp_path, "peers")}
    light, dark, phone = (imread(made[k])[..., :3] for k in ("light", "dark", "phone"))
    assert light[-200:].mean() > 0.9 > 0.3 > dark[-200:].mean()  # below the header, mostly paper
    assert (phone[300:, look.PHONE + 5 :] > 0.99).all() and made["print"].stat().st_size > 10_000
