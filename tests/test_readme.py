"""README states the numbers of scripts/results, and its programs run on its log."""

import re
import shutil
import subprocess
import sys
from datetime import date
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import tse

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text()


RESULTS = ROOT / "scripts" / "results"


def read_cells(name: str, row: str) -> list[str]:
    """Return the first row of a table of scripts/results that begins so."""
    return [
        c.strip()
        for c in re.search(rf"^\| {re.escape(row)}(.*)\|$", (RESULTS / name).read_text(), re.M)[1].split("|")
    ]


def test_its_numbers_are_those_of_scripts_results():
    facts = README.split("## How good it is")[1].split("## Next step")[0]
    runs, _, _, *rms = read_cells("accuracy.md", "accuracy: square waves, start at 70 % |")
    assert f"RMS error {', '.join(x.split()[0] for x in rms[:3])} %, {runs} runs" in facts
    error, valid, off = (
        [x.strip() for x in c.split("/")][1:] for c in read_cells("cars-fresh.md", "all | calibrated |")[:3]
    )
    cars = "median error {}, {} %; usable in {}, {} % of the rows; {}, {} % of the usable rows are more"
    assert cars.format(*error, *valid, *off) in facts
    error, valid, off = (
        [x.strip() for x in c.split("/")][1:] for c in read_cells("own.md", "all | on the log itself |")[:3]
    )
    assert cars.format(*error, *valid, *off) in facts
    error, valid, off = (
        c.partition("/")[0].strip() for c in read_cells("cars-fresh.md", "all | calibrated |")[:3]
    )
    assert (
        f"median error {error} %; usable in {valid} % of the rows; {off} % of the usable rows are more"
        in facts
    )
    half, tenth = (c.split("/")[1].strip() for c in read_cells("cars-events.md", "ice |")[4].split(";")[:2])
    assert f"(more than 20 % off) for {half} s in the median drive, {tenth} s in one of ten" in facts
    delay, longest = re.match(
        r"([\d.]+) \(([\d.]+)\)", read_cells("regimes-road.md", "road-0.7 | tse | 30 s |")[0]
    ).groups()
    assert f"detected after {delay} s (longest {longest} s)" in facts
    time, memory = (
        read_cells("bench.md", "default |")[0],
        read_cells("bench.md", "`tse_filter`: the default form |")[0],
    )
    us, kilobytes = int(time.split()[0]) / 1000, int(memory.split()[0].replace(",", "")) / 1000
    assert f"a PC in double | {us:.0f} us a row, filter of {kilobytes:.0f} kB" in facts
    *_, front, valid = read_cells("real.md", "stanford_250lm_a | the log itself |")[:5]
    assert (
        f"{front} kN/rad, usable in {valid} % of the rows with bends. Reference, a regression with "
        "measured sideslip: 82 (78 .. 92) kN/rad" in facts
    )
    assert "front 82 [78 92]" in (RESULTS / "real.md").read_text()
    whole = read_cells("real.md", "genesis_cpg_fast | the log itself |")[3]
    assert f"{whole} kN/rad, marked not usable" in facts
    assert read_cells("real.md", "genesis_cpg_fast | the log itself |")[4] == "0"
    quiet = read_cells("real.md", "rav4_comma2k19 | as in the file |")[3]
    assert f"{quiet} kN/rad, marked not usable" in facts and f"gives {quiet} kN/rad in front" in README
    cost = read_cells("budgets.md", "Cortex-M4F, float |")
    row, flash, ram = (int(cost[i].split()[0].strip("*").replace(",", "")) for i in (0, 3, 5))
    assert (
        f"Cortex-M4F in float | {row:,} instructions a row, {flash / 1000:.0f} kB flash, "
        f"{ram / 1000:.1f} kB RAM" in facts
    )
    state = int(read_cells("bench.md", "`tse_filter`: the default form |")[1].split()[0].replace(",", ""))
    assert f"the filter of the default build has {state / 1000:.1f} kB" in facts
    lines = (RESULTS / "gap-loop.md").read_text().split("| hidden |")[1].split("\n\n")[0].splitlines()
    loop = lines[2:]
    over = sorted(line.split("|")[4].strip() for line in loop)
    hidden = sum(not line.startswith("| clean |") for line in loop)
    assert f"`tselab gap`, {len(over)} simulated cars, {hidden} with a hidden effect" in facts
    assert f"unseen drives is {over[0]} .. {over[-1]} of the error before" in facts


PROGRAMS: dict[str, Path] = {}  # source, and its program; compiled once in a run of the tests


def compile_program(source: str, folder: Path) -> Path:
    """Compile a program of scripts/examples with the options of README."""
    if source in PROGRAMS:
        return PROGRAMS[source]
    cc = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    assert cc, "a C compiler is needed"
    how = re.search(
        r"^cc (-O2 -Itwo) scripts/examples/first.c (two/tse/tse.c -lm) -o first && ./first < log.csv$",
        README,
        re.M,
    )
    two = [sys.executable, ROOT / "scripts" / "dev" / "amalgamate.py", "--out", "two/tse"]
    subprocess.run(two, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    options = [
        *how[1].split(),
        "-Wall",
        "-Wextra",
        "-Werror",
        ROOT / "scripts" / "examples" / source,
        *how[2].split(),
    ]
    subprocess.run([cc, *options, "-o", "program"], cwd=folder, check=True)
    PROGRAMS[source] = folder / "program"
    return PROGRAMS[source]


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Return the log of README's second command."""
    from tselab.cli import cli

    words = re.search(r"^\.venv/bin/tselab (simulate .*?--out) log\.csv", README, re.M)[1].split()
    path = tmp_path_factory.mktemp("readme") / "log.csv"
    done = CliRunner().invoke(
        cli, [*words, str(path), "--truth", str(path.with_name("truth.csv"))], standalone_mode=False
    )
    assert done.exception is None, done.exception
    return path


def test_its_c_program_reaches_valid_on_the_log_and_its_interval_holds(log, tmp_path):
    done = subprocess.run(
        [compile_program("first.c", tmp_path)],
        input=log.read_text(),
        capture_output=True,
        text=True,
        check=True,
    )
    said = re.fullmatch(r"front cornering stiffness (\d+) \+- (\d+) N/rad \(95 %\), usable\n", done.stdout)
    assert said, done.stdout
    printed = f"{int(said[1]) / 1000:.0f} +- {int(said[2]) / 1000:.0f} kN/rad"
    assert f"the estimate is {printed} (95 % interval). The true stiffness is" in README
    truth = pd.read_csv(log.with_name("truth.csv"))["true_cy_front"].iloc[-1]
    assert abs(int(said[1]) - truth) < int(said[2]) < 0.25 * truth


@pytest.mark.parametrize(
    ("cells", "says"),
    [
        ({5: ""}, "row 101, cell 6: empty, or no number"),
        ({1: "x"}, "row 101, cell 2: empty, or no number"),
        ({2: "1e9"}, "row 101: "),
    ],
)
def test_its_c_program_refuses_a_bad_cell_with_its_row(cells, says, log, tmp_path):
    lines = log.read_text().splitlines()[:300]
    row = lines[100].split(",")
    for i, text in cells.items():
        row[i] = text
    lines[100] = ",".join(row)
    done = subprocess.run(
        [compile_program("first.c", tmp_path)],
        input="\n".join(lines),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1 and done.stdout == "" and done.stderr.startswith(says), done.stderr


@pytest.mark.parametrize("layout", ["tse", ".", "include"])
def test_one_include_serves_in_all_layouts_and_so_does_the_header_of_a_car(layout, tmp_path):
    """Two files in a folder tse, two files beside the program, and the headers of the
    repository.

    car.h is included alone or behind the header of the library.
    """
    from tselab.cli import cli

    car = tmp_path / "car.toml"
    car.write_text(CliRunner().invoke(cli, ["vehicle", "--example"]).output)
    assert CliRunner().invoke(cli, ["vehicle", str(car), "--c", str(tmp_path / "car.h")]).exit_code == 0
    folder, name = (
        (ROOT / "include", "tse/tse.h")
        if layout == "include"
        else (tmp_path, f"{layout}/tse.h".removeprefix("./"))
    )
    if layout != "include":
        made = [sys.executable, ROOT / "scripts" / "dev" / "amalgamate.py", "--out", tmp_path / layout]
        subprocess.run(made, check=True, stdout=subprocess.DEVNULL)
    body = ("int it(void);\nint it(void) { tse_config c; uint8_t learnt[TSE_LEARNT_BYTES];\n"
            "  tse_config_default(&c); tse_config_car(&c); return (int)sizeof learnt; }\n")  # fmt: skip
    for head in (f'#include "{name}"\n#include "car.h"\n', '#include "car.h"\n'):
        (tmp_path / "it.c").write_text(head + body)
        cc = [
            "cc",
            "-std=c99",
            "-Wall",
            "-Wextra",
            "-Wpedantic",
            "-Werror",
            "-DTSE_REAL_DOUBLE",
            "-fsyntax-only",
        ]
        done = subprocess.run(
            [*cc, "-I", folder, "-I", tmp_path, tmp_path / "it.c"],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr


def test_its_python_program_prints_what_stands_below_it(log, monkeypatch, capsys):
    monkeypatch.chdir(log.parent)
    body = re.search(r"```python\n(.*?)```", README, re.S)[1]
    exec(compile(body, "README", "exec"), {"__name__": "README"})
    said = capsys.readouterr().out
    assert said == re.search(r"```text\n(.*?)```", README, re.S)[1]
    truth = pd.read_csv("truth.csv").iloc[-1][["true_cy_front", "true_cy_rear", "true_cx_front"]] / 1000
    assert "The true values are {:.0f} kN/rad, {:.0f} kN/rad and {:.0f} kN.".format(*truth) in README
    found = [tuple(map(int, x)) for x in re.findall(r"(\d+) ± (\d+) kN.* usable, valid", said)]
    assert all(abs(mean - true) < half for (mean, half), true in zip(found, truth, strict=True))
    mean, half = found[0]
    comment = " ".join(README.replace(" * ", " ").split())
    assert f"The true stiffness is {truth.iloc[0]:.0f} kN/rad. tse.estimate() in Python" in comment
    assert f"calibrates the car on this log, and then estimates {mean} +- {half} kN/rad. */" in comment


@pytest.mark.parametrize(
    "flags",
    [
        pytest.param([], id="double"),
        pytest.param(["-DTSE_REAL_FLOAT"], id="float", marks=pytest.mark.slow),
        pytest.param(["-DTSE_REAL_FIXED"], id="fixed", marks=pytest.mark.slow),
    ],
)
def test_the_settings_of_a_vehicle_file_give_in_c_what_they_give_in_python(log, tmp_path, flags):
    """The bits are equal in double; float and fixed point come near without a warning."""
    from tselab.cli import cli

    car, header = tmp_path / "car.toml", tmp_path / "car.h"
    car.write_text(
        CliRunner().invoke(cli, ["vehicle", "--example"]).output.replace("mass = 1900.0", "mass = 1872.3")
    )
    assert CliRunner().invoke(cli, ["vehicle", str(car), "--c", str(header)]).exit_code == 0
    rows = pd.read_csv(log).head(1500).iloc[:, :7]
    subprocess.run(
        [sys.executable, ROOT / "scripts" / "dev" / "amalgamate.py", "--out", tmp_path / "tse"],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    numbers = ",\n".join(
        "{" + ", ".join(f"TSE_S({x!r})" for x in row) + "}" for row in rows.iloc[:, 1:].to_numpy().tolist()
    )
    (tmp_path / "it.c").write_text(
        '#include <stdio.h>\n#include "car.h"\n'
        "static tse_filter f;\nstatic const tse_setting rows[][6] = {\n" + numbers + "};\n"
        "int main(void)\n{\n  tse_config c; tse_params p; tse_input u; tse_output y = { 0 };\n"
        "  tse_config_default(&c); tse_config_car(&c); tse_input_default(&u);\n"
        "  if (tse_prepare(&c, &p, NULL) < 0 || tse_reset(&p, &f, sizeof f) < 0) return 1;\n"
        "  for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {\n"
        "    u.steer_angle = rows[i][0]; u.wheel_speed_front = rows[i][1]; u.wheel_speed_rear = rows[i][2];\n"
        "    u.accel_x = rows[i][3]; u.accel_y = rows[i][4]; u.yaw_rate = rows[i][5];\n"
        "    if (tse_step(&p, &f, &u, &y) < 0) return 2;\n  }\n"
        "  const double one = (double)TSE_R(1.0);\n"
        '  printf("%.17g %.17g\\n", (double)y.stiffness[TSE_CY_FRONT] / one,\n'
        "         (double)y.stiffness_sd[TSE_CY_FRONT] / one);\n}\n"
    )
    cc = ["cc", "-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-ffp-contract=off", *flags]
    subprocess.run([*cc, "-I.", "-o", "it", "it.c", "tse/tse.c", "-lm"], cwd=tmp_path, check=True)
    said = [
        float(x)
        for x in subprocess.run([tmp_path / "it"], capture_output=True, text=True, check=True).stdout.split()
    ]
    found = tse.estimate(rows, car, calibrate=False)
    nominal = found.vehicle.values["cornering_stiffness_front"]
    in_python = [found.stiffness[-1, 1] / nominal, found.stiffness_sd[-1, 1] / nominal]
    np.testing.assert_allclose(said, in_python, rtol=1e-3 if flags else 1e-15)


def test_its_c_program_does_not_call_usable_what_is_not(log, tmp_path):
    """The first rows are the start, in which no estimate is valid."""
    rows = "".join(log.read_text().splitlines(True)[:100])
    done = subprocess.run(
        [compile_program("first.c", tmp_path)], input=rows, capture_output=True, text=True, check=True
    )
    assert done.stdout.endswith("(95 %), do not use: too little data since the start\n")


def test_its_c_program_does_not_end_well_at_a_cell_that_it_cannot_read(log, tmp_path):
    rows = log.read_text().splitlines(True)[:100]
    rows[50] = rows[50].replace(",", ",,", 1)
    done = subprocess.run(
        [compile_program("first.c", tmp_path)], input="".join(rows), capture_output=True, text=True
    )
    assert done.returncode == 1 and not done.stdout


@pytest.mark.slow
def test_the_csv_reader_takes_missing_cells_and_rows(tmp_path):
    program = compile_program("csv.c", tmp_path)
    log, truth = tse.simulate("double-lane-change", duration=40)
    log.loc[100:110, "accel_y"] = np.nan  # empty cells are missing values; the header does not count as a row
    log = log.drop(index=range(500, 505))  # nor is the step always the same
    rows = log.to_csv(index=False)
    done = subprocess.run([program], input=rows, capture_output=True, text=True, check=True)
    mean, half = map(float, re.match(r"(\d+) \+- (\d+) N/rad: ", done.stdout).groups())
    assert abs(mean - truth["true_cy_front"].iloc[-1]) < half < 0.5 * mean and not done.stderr
    nothing = subprocess.run(
        [program], input="time,steer_angle\n", capture_output=True, text=True, check=False
    )
    assert (nothing.returncode, nothing.stdout, nothing.stderr) == (2, "", "no row was used\n")


# ---- CITATION.cff states this version and has the required keys
# (Citation File Format 1.2.0).


REFERENCE_TYPES = {
    "article",
    "book",
    "conference",
    "conference-paper",
    "generic",
    "proceedings",
    "report",
    "software",
}


@pytest.fixture(scope="module")
def said():
    yaml = pytest.importorskip("yaml")
    return yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))


def check_people(of):
    for who in of["authors"]:
        assert ("name" in who) != ({"family-names", "given-names"} <= set(who)), who


def test_it_has_what_the_format_requires(said):
    assert said["cff-version"] == "1.2.0" and said["type"] in ("software", "dataset")
    assert all(isinstance(said[key], str) and said[key] for key in ("message", "title", "version", "license"))
    assert isinstance(said["date-released"], date)
    check_people(said)
    for reference in said["references"]:
        assert reference["type"] in REFERENCE_TYPES and reference["title"]
        assert isinstance(reference["year"], int)
        check_people(reference)


def test_it_is_of_this_version_and_the_changelogs_day(said):
    assert said["version"] == tse.__version__
    day = re.search(
        rf"^## \[{re.escape(tse.__version__)}\] - (\S+)$", (ROOT / "CHANGELOG.md").read_text(), re.M
    )[1]
    assert said["date-released"].isoformat() == day
    licence = (ROOT / "LICENSE").read_text()
    assert said["license"] == "Apache-2.0" and "Apache License" in licence and "Version 2.0" in licence


def test_its_prose_and_commands_fit_a_terminal():
    """Tables, pictures and the program in C are exceptions."""
    text = re.sub(r"```c\n.*?```", "", README, flags=re.S)
    assert [line for line in text.splitlines() if len(line) > 90 and not line.startswith(("|", "!["))] == []
