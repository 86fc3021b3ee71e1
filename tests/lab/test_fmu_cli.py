"""tselab fmu: what is built is reproducible and loads elsewhere; validators find what is broken; a run gives what tselab gives."""

from __future__ import annotations

import importlib.util
import shutil
import struct
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from conftest import Drive, tselab, tselab_here
from log_formats import FORMATS, messages
from tse.impl.errors import UserError

if importlib.util.find_spec("fmpy") is None or shutil.which("cmake") is None:
    pytest.skip("FMPy or cmake is not installed", allow_module_level=True)

from tse.impl.formula import Number, parse, write_formula
from tselab.fmu import archive, build, checks, clients, platforms, validate

FMUS = ("SingleTrackVehicle", "TireStiffnessEstimator")
PLATFORMS3 = ("win64", "darwin64")
FMUS3 = tuple(f"{name}-fmi3" for name in FMUS)


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with both FMUs, for FMI 2.0 and 3.0, and the system, with the binary of this machine."""
    folder = tmp_path_factory.mktemp("fmus")
    done = tselab("fmu", "build", "--out", folder)
    assert done.code == 0, done.err
    assert [line.split(":")[0] for line in done.out.splitlines()] == [
        str(folder / name) for name in (*(f"{n}{v}.fmu" for n in FMUS for v in ("", "-fmi3")), "StiffnessStudy.ssp")
    ]
    return folder


@pytest.fixture(scope="session")
def everywhere(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with binaries of all platforms; those of FMI 3.0, which cost as long again, of two besides this one."""
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip("ziglang, which compiles for other platforms, is not installed (scripts/setup.sh platforms)")
    folder = tmp_path_factory.mktemp("everywhere")
    build.build(folder, tuple(platforms.PLATFORMS), None, lambda _: None, fmi=("2",))
    build.build(folder, PLATFORMS3, None, lambda _: None, fmi=("3",))
    return folder


def refused(done, words: list[str]) -> None:
    assert done.code == 2, done.out + done.err
    assert "Traceback" not in done.err
    for word in words:
        assert word in done.err


@pytest.mark.parametrize("command", ["build", "validate", "run"])
def test_help_teaches(command):
    done = tselab_here("fmu", command, "--help")
    assert done.code == 0 and f"tselab fmu {command} " in done.out.split("Usage", 1)[1].split("\n", 1)[1]


# ---- build


def test_the_same_sources_give_the_same_files(built, tmp_path):
    assert tselab("fmu", "build", "--out", tmp_path).code == 0
    names = sorted(p.name for p in built.iterdir())
    assert names == sorted(p.name for p in tmp_path.iterdir())
    for name in names:
        assert (tmp_path / name).read_bytes() == (built / name).read_bytes()
        with zipfile.ZipFile(built / name) as file:
            inside = file.infolist()
        assert [i.filename for i in inside] == sorted(i.filename for i in inside)
        assert {i.date_time for i in inside} == {archive.EPOCH}


def test_the_system_holds_the_fmus_that_lie_beside_it(built):
    with zipfile.ZipFile(built / "StiffnessStudy.ssp") as file:
        for name in FMUS:
            assert file.read(f"resources/{name}.fmu") == (built / f"{name}.fmu").read_bytes()


def test_one_version_of_fmi_can_be_asked_for(built, tmp_path):
    assert tselab("fmu", "build", "--fmi", "3", "--out", tmp_path).code == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == [f"{name}.fmu" for name in FMUS3]
    for name in FMUS3:
        assert (tmp_path / f"{name}.fmu").read_bytes() == (built / f"{name}.fmu").read_bytes()


def test_headers_that_are_not_there_are_named(tmp_path, monkeypatch):
    for name in FMUS:
        (tmp_path / "stage" / name).mkdir(parents=True)
        (tmp_path / "stage" / name / "modelDescription.xml").write_text("")
    monkeypatch.setattr(build, "build_native", lambda *_: tmp_path / "stage")
    with pytest.raises(UserError, match=r"FMI 3\.0 headers are not in .*scripts/setup\.sh"):
        build.build(tmp_path / "out", (), None, lambda _: None)
    assert not (tmp_path / "out").exists()


def test_what_is_interrupted_leaves_nothing(tmp_path, monkeypatch):
    def interrupted(*_: object) -> bytes:
        raise KeyboardInterrupt

    monkeypatch.setattr(platforms, "check_compiler", lambda: None)
    monkeypatch.setattr(platforms, "compile_for", interrupted)
    with pytest.raises(KeyboardInterrupt):
        build.build(tmp_path / "out", ("win64",), None, lambda _: None)
    assert not (tmp_path / "out").exists()


def test_a_missing_compiler_is_said_before_anything_is_built(tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(build, "build_native", lambda *_: pytest.fail("was built"))
    with pytest.raises(UserError, match=r"ziglang.*not installed.*scripts/setup\.sh platforms"):
        build.build(tmp_path, ("linux64",), None, lambda _: None)


def test_build_refuses_a_file_and_a_platform_that_nobody_knows(tmp_path):
    (tmp_path / "taken").write_text("")
    refused(tselab_here("fmu", "build", "--out", tmp_path / "taken"), ["taken", "a directory is needed"])
    refused(tselab_here("fmu", "build", "--platform", "vax"), ["vax", "linux64"])


def test_slices_are_joined_as_the_loader_of_macos_wants_them():
    x86 = struct.pack("<III", 0xFEEDFACF, 0x01000007, 3) + b"x" * 5000
    arm = struct.pack("<III", 0xFEEDFACF, 0x0100000C, 0) + b"a" * 777
    joined = platforms.universal([x86, arm])
    assert struct.unpack_from(">II", joined) == (0xCAFEBABE, 2)
    for i, (piece, bits) in enumerate(((x86, 12), (arm, 14))):
        cpu, subtype, offset, size, align = struct.unpack_from(">5I", joined, 8 + 20 * i)
        assert (cpu, subtype) == struct.unpack_from("<II", piece, 4) and align == bits
        assert offset % (1 << bits) == 0 and joined[offset : offset + size] == piece
    assert platforms.universal([arm]) == arm


def test_binaries_of_all_platforms_export_fmi_and_need_nothing_new(everywhere):
    from tselab.fmu.platforms import read_binary

    machines = {
        "linux64": ("linux", ("x86_64",)),
        "win64": ("windows", ("x86_64",)),
        "darwin64": ("darwin", ("x86_64", "aarch64")),
        "aarch64-linux": ("linux", ("aarch64",)),
        "aarch64-darwin": ("darwin", ("aarch64",)),
    }
    required = {*checks.COMMON.split(), *checks.CO_SIMULATION.split()}
    for name in FMUS:
        fmu = archive.open_archive(everywhere / f"{name}.fmu")
        assert set(fmu.binaries) == set(machines)
        for platform, expected in machines.items():
            data = fmu.read(f"binaries/{platform}/{name}{platforms.PLATFORMS[platform].suffix}")
            binary = read_binary(data)
            assert (binary.system, binary.machines) == expected
            assert binary.exports == required
            assert not binary.executable_stack and binary.signed
            assert binary.glibc <= {"linux64": (2, 2, 5), "aarch64-linux": (2, 17)}.get(platform, ())
            assert b"/tmp/" not in data and str(build.checkout()).encode() not in data
        assert checks.check(fmu) == []


def test_binaries_of_fmi_3_stand_in_folders_of_one_processor(everywhere):
    from tselab.fmu.platforms import read_binary

    for name in FMUS3:
        fmu = archive.open_archive(everywhere / f"{name}.fmu")
        assert set(fmu.binaries) == {platforms.native("3"), *(platforms.PLATFORMS[p].tuple3 for p in PLATFORMS3)}
        for folder, (path,) in fmu.binaries.items():
            binary = read_binary(fmu.read(path))
            assert f"{'-'.join(binary.machines)}-{binary.system}" == folder
            assert binary.exports == set(checks.FMI3.split())
        assert checks.check(fmu) == []


def test_binaries_of_all_platforms_compute_the_same_bits(everywhere):
    ran = [r for name in (*FMUS, *FMUS3) for r in clients.compare(everywhere / f"{name}.fmu") if not r.skipped]
    assert len([r for r in ran if r.is_reference]) == 4
    assert [r for r in ran if not r.same_bits] == []


# ---- validate


def test_validators_have_no_findings(built):
    done = tselab("fmu", "validate", *(built / f"{name}.fmu" for name in FMUS))
    assert done.code == 0, done.out + done.err
    rows = [
        line.split() for line in done.out.splitlines() if line.startswith(("  FMPy", "  fmutool", "  XML", "  tselab"))
    ]
    assert len(rows) == 8 and {row[-1] for row in rows} == {"0"}


def test_findings_are_exit_1_and_no_fmu_is_exit_2(built, tmp_path, monkeypatch):
    """Without VDMCheck, which takes longest and has tests of its own."""
    monkeypatch.setattr(validate, "_vdmcheck", lambda *_: validate.Verdict("VDMCheck", "", skipped="here"))
    broken = changed(built / "SingleTrackVehicle.fmu", tmp_path / "broken.fmu",
                     edit("modelDescription.xml", 'name="steer_angle"', 'name="ramp"'))  # fmt: skip
    done = tselab_here("fmu", "validate", broken)
    assert done.code == 1, done.out + done.err
    assert 'FMPy validate_fmu: The variable name "ramp"' in done.out and "fmutool -check: " in done.out
    (tmp_path / "text.fmu").write_text("no zip file")
    refused(tselab_here("fmu", "validate", tmp_path / "text.fmu"), ["text.fmu", "is not an FMU"])
    refused(tselab_here("fmu", "validate", tmp_path / "none.fmu"), ["none.fmu", "no such file"])
    refused(tselab_here("fmu", "validate", built / "StiffnessStudy.ssp"), ["there is no modelDescription.xml in it"])


Files = dict[str, bytes]
Edit = Callable[[Files], None]


def edit(name: str, old: str, new: str) -> Edit:
    def change(files: Files) -> None:
        text = files[name].decode()
        assert old in text
        files[name] = text.replace(old, new, 1).encode()

    return change


def without(prefix: str) -> Edit:
    def change(files: Files) -> None:
        for name in [n for n in files if n.startswith(prefix)]:
            del files[name]

    return change


def changed(fmu: Path, out: Path, *edits: Edit) -> Path:
    with zipfile.ZipFile(fmu) as file:
        files = {n: file.read(n) for n in file.namelist()}
    for change in edits:
        change(files)
    archive.pack(out, files)
    return out


HERE = platforms.native()
OURS = f"binaries/{HERE}/SingleTrackVehicle{platforms.PLATFORMS[HERE].suffix if HERE in platforms.PLATFORMS else '.so'}"
BROKEN: dict[str, tuple[Edit, str]] = {
    "no unit": (edit("modelDescription.xml", 'declaredType="Mass" unit="kg"', ""), "vehicle.mass has no unit"),
    "no description": (edit("modelDescription.xml", ' description="yaw rate"', ""), "true.yaw_rate has no description"),
    "no step size": (edit("modelDescription.xml", ' stepSize="0.01"', ""), "DefaultExperiment has no stepSize"),
    "no documentation": (without("documentation/index"), "there is no documentation/index.html"),
    "no licence": (without("documentation/licenses"), "there is no licence in documentation/licenses"),
    "no picture": (without("model.png"), "there is no model.png"),
    "no binary": (without("binaries"), "there is no binary"),
    "a source that is not there": (without("sources/paper/learn.c"), "sources/ does not compile"),
    "an unknown platform": (lambda f: f.update({"binaries/vax/SingleTrackVehicle.so": b""}), "knows no such platform"),
    "another name": (
        lambda f: f.update({OURS.replace("Single", "Double"): f.pop(OURS)}),
        "there is no SingleTrackVehicle",
    ),
    "no library": (lambda f: f.update({OURS: b"#!/bin/sh"}), "is no shared library"),
    "another system's": (lambda f: f.update({"binaries/win64/SingleTrackVehicle.dll": f[OURS]}), "is for linux on"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_importers_complain_about_is_found(name, built, tmp_path):
    if name == "another system's" and not HERE.endswith(("linux", "linux64")):
        pytest.skip("says linux")
    change, words = BROKEN[name]
    edits = [change] if "source" in name else [change, without("sources/")]  # to compile them takes a second
    found = checks.check(archive.open_archive(changed(built / "SingleTrackVehicle.fmu", tmp_path / "x.fmu", *edits)))
    assert len(found) == 1 and words in found[0]


@pytest.mark.skipif(
    HERE != "linux64" or shutil.which("gcc") is None, reason="makes faulty binaries with gcc for linux64"
)
def test_faulty_binaries_are_found(built, tmp_path):
    source = "double cos(double); double helper(double x) { return cos(x); } int fmi2DoStep(void) { return 0; }"
    gcc = ["gcc", "-shared", "-fPIC", "-Wl,--no-as-needed", "-x", "c", "-"]
    other, binary = tmp_path / "libother.so", tmp_path / "faulty.so"
    subprocess.run([*gcc, "-o", other], input="int other(void) { return 1; }", text=True, check=True)
    options = ["-z", "execstack", "-o", binary, "-L", tmp_path, "-lother", "-lm"]
    subprocess.run([*gcc, *options], input=source, text=True, check=True)
    fmu = changed(built / "SingleTrackVehicle.fmu", tmp_path / "x.fmu", lambda f: f.update({OURS: binary.read_bytes()}))
    found = "\n".join(checks.check(archive.open_archive(fmu)))
    assert "does not export fmi2CancelStep" in found and "fmi2DoStep" not in found
    assert "exports 1 names that are not of FMI, which may clash with others': helper" in found
    assert "needs libother.so" in found and "libm" not in found
    assert "asks for an executable stack" in found


def test_vdmcheck_finds_what_others_do_not(built, tmp_path):
    if shutil.which("java") is None or not (validate.vdmcheck_folder() / "vdmcheck2.jar").is_file():
        pytest.skip("VDMCheck is not here: it needs Java, and Maven that fetches it ('tselab fmu validate')")
    fmu = changed(built / "SingleTrackVehicle.fmu", tmp_path / "x.fmu",
                  edit("sources/buildDescription.xml", ' compiler="gcc"', ""))  # fmt: skip
    verdicts = {v.validator: v.findings for v in validate.validate(archive.open_archive(fmu))}
    assert len(verdicts["VDMCheck"]) == 1 and "Compiler options set without compiler" in verdicts["VDMCheck"][0]
    assert not any(findings for name, findings in verdicts.items() if name != "VDMCheck")


def test_what_cannot_run_is_said_and_no_finding(built, tmp_path, monkeypatch):
    fmu = archive.open_archive(built / "SingleTrackVehicle.fmu")
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert validate._vdmcheck(fmu, print).skipped == "Java is not installed"
    monkeypatch.setattr(shutil, "which", lambda name: None if name == "mvn" else f"/bin/{name}")
    monkeypatch.setattr(validate, "vdmcheck_folder", lambda: tmp_path / "none")
    verdict = validate._vdmcheck(fmu, print)
    assert verdict.skipped == "not fetched: Maven (mvn) is not installed" and verdict.findings == []
    for foreign in clients.FOREIGN:
        reason = clients._foreign_reason(foreign, clients.make_plan(fmu.path))
        assert reason == f"the FMU has no binary for {foreign.platform}" or foreign.platform == HERE


def test_clients_agree_to_the_last_bit(built):
    rows = {r.client: r for r in clients.compare(built / "TireStiffnessEstimator.fmu")}
    assert rows["FMPy"].is_reference
    ran = [r for r in rows.values() if not r.skipped and not r.is_reference]
    if not ran:
        pytest.skip("no other client is installed (scripts/setup.sh clients)")
    assert [(r.client, r.text) for r in ran] == [(r.client, "same bits") for r in ran]


def test_a_difference_is_measured_against_the_size_of_an_output():
    reference = np.array([[1.0, 200.0, np.nan], [2.0, -400.0, np.nan]])
    other = reference + np.array([[0.0, 0.0, 0.0], [0.0, 1e-6, 0.0]])
    assert clients.same_bits(reference, reference.copy()) and clients.difference(reference, reference) == 0.0
    assert not clients.same_bits(other, reference)
    assert clients.difference(other, reference) == pytest.approx(1e-6 / 400, rel=1e-3)
    assert clients.difference(np.nan_to_num(reference), reference) == np.inf
    assert clients.Row("x", "y", "", "", 1e-6).is_finding and not clients.Row("x", "y", "", "", 1e-12).is_finding


def test_a_client_that_fails_is_a_finding(built, monkeypatch):
    def process(name: str, plan: clients.Plan) -> np.ndarray:
        if name == "ecos":
            raise clients.ClientError("it crashed")
        return np.zeros((plan.steps - (name == "libcosim"), len(plan.outputs)))

    monkeypatch.setattr(clients, "find_spec", lambda name: name)  # all are here
    monkeypatch.setattr(clients, "_in_process", process)
    rows = {r.client: r for r in clients.compare(built / "SingleTrackVehicle.fmu")}
    assert rows["ecos"].is_finding and rows["ecos"].text == "failed: it crashed"
    assert rows["libcosim"].is_finding and rows["libcosim"].text == "failed: 99 steps instead of 100"


# ---- run


@pytest.fixture(scope="session")
def odd_log(drive: Drive) -> Path:
    """Cells that are missing singly and for long, values out of range, irregular rows, rows that are not there, gaps."""
    random = np.random.default_rng(20)
    table = pd.read_csv(drive.log)
    table = table[[c for c in table if not c.startswith("ref_")]]
    n = len(table)
    table["time"] += random.uniform(-0.002, 0.002, n)
    values = table.columns[1:]
    table[values] = table[values].mask(random.random((n, len(values))) < 0.02)
    table.loc[500:560, "yaw_rate"] = np.nan
    table.loc[600:640, "wheel_speed_front"] = np.nan
    table.loc[700:704, ["accel_x", "accel_y", "yaw_rate", "steer_angle", "wheel_speed_front", "wheel_speed_rear"]] = (
        np.nan
    )
    table.loc[40:42, "accel_x"] = 99.0
    keep = random.random(n) > 0.05
    keep[300:330] = keep[900:1000] = False
    path = drive.folder / "odd.csv"
    table[keep].to_csv(path, index=False)
    return path


@pytest.mark.parametrize(
    "options",
    [
        [],
        [
            "--particles",
            64,
            "--seed",
            5,
            "--forgetting",
            0.98,
            "--set",
            "max_gap=0.3",
            "--set",
            "cornering_stiffness_front=9e4",
        ],
        ["--form", "paper", "--particles", 100],
        ["--average", 0.04],
    ],
    ids=lambda options: " ".join(map(str, options[:2])) or "default",
)
def test_the_estimator_fmu_writes_the_bytes_of_tselab_estimate(options, built, odd_log, drive, tmp_path):
    same = [odd_log, "--vehicle", drive.vehicle, *options, "--out"]
    assert tselab("estimate", *same, tmp_path / "est.csv").code == 0
    done = tselab("fmu", "run", built / "TireStiffnessEstimator.fmu", *same, tmp_path / "fmu.csv")
    assert done.code == 0, done.err
    assert (tmp_path / "fmu.csv").read_bytes() == (tmp_path / "est.csv").read_bytes()
    assert len(pd.read_csv(tmp_path / "fmu.csv")) > 400


def test_the_estimator_of_fmi_3_writes_the_bytes_of_tselab_estimate(built, odd_log, drive, tmp_path):
    same = [odd_log, "--vehicle", drive.vehicle, "--seed", 5, "--set", "max_gap=0.3", "--out"]
    assert tselab("estimate", *same, tmp_path / "est.csv").code == 0
    done = tselab("fmu", "run", built / "TireStiffnessEstimator-fmi3.fmu", *same, tmp_path / "fmu.csv")
    assert done.code == 0, done.err
    assert (tmp_path / "fmu.csv").read_bytes() == (tmp_path / "est.csv").read_bytes()


def test_the_estimator_fmu_reads_any_log_as_tselab_estimate_does(built, drive, tmp_path):
    path = FORMATS["Parquet"][1](tmp_path, messages(pd.read_csv(drive.log)))
    same = [path, "--vehicle", drive.vehicle, "--rate", 50, "--out"]
    assert tselab("estimate", *same, tmp_path / "est.csv").code == 0
    done = tselab("fmu", "run", built / "TireStiffnessEstimator.fmu", *same, tmp_path / "fmu.csv")
    assert done.code == 0 and "signals by" in done.err, done.err
    assert (tmp_path / "fmu.csv").read_bytes() == (tmp_path / "est.csv").read_bytes()
    assert len(pd.read_csv(tmp_path / "fmu.csv")) == pytest.approx(1000, abs=10)


def test_a_formula_is_not_in_the_filter_and_said_so(built, drive, tmp_path):
    write_formula(tmp_path / "play.toml", parse("play", "play", "front_angle", "play(steer_angle, w) - steer_angle",
                                                [Number("w", 0.004, "rad")]))  # fmt: skip
    vehicle = tmp_path / "car.toml"
    vehicle.write_text(drive.vehicle.read_text() + '\n[formula]\nfile = "play.toml"\n')
    said = tselab("estimate", drive.log, "--vehicle", vehicle, "--out", tmp_path / "est.csv")
    assert said.code == 0 and "formula: not in the filter's model, not used" in said.err
    assert tselab("estimate", drive.log, "--vehicle", drive.vehicle, "--out", tmp_path / "plain.csv").code == 0
    fmu = built / "TireStiffnessEstimator.fmu"
    done = tselab("fmu", "run", fmu, drive.log, "--vehicle", vehicle, "--out", tmp_path / "fmu.csv")
    assert done.code == 0, done.err
    assert (
        (tmp_path / "fmu.csv").read_bytes()
        == (tmp_path / "est.csv").read_bytes()
        == (tmp_path / "plain.csv").read_bytes()
    )


def test_a_setting_that_the_fmu_does_not_have_is_said(built, drive, tmp_path):
    fmu = changed(built / "TireStiffnessEstimator.fmu", tmp_path / "older.fmu",
                  edit("modelDescription.xml", 'name="filter.spread_kernel"', 'name="filter.another"'))  # fmt: skip
    run = ["fmu", "run", fmu, drive.log, "--vehicle", drive.vehicle, "--out", tmp_path / "est.csv"]
    done = tselab(*run)
    assert done.code == 0 and "has no parameter" not in done.err
    done = tselab(*run, "--set", "spread_kernel=0.3")
    assert done.code == 0 and "the FMU has no parameter for spread_kernel: what was set is not used" in done.err


@pytest.fixture(scope="session")
def bad(built: Path, drive: Drive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """FMUs that are refused."""
    folder = tmp_path_factory.mktemp("bad")
    (folder / "text.fmu").write_text("no zip file")
    shutil.copy(drive.log, folder / "log.csv")
    shutil.copy(drive.vehicle, folder / "car.toml")
    shutil.copy(built / "SingleTrackVehicle.fmu", folder / "car.fmu")
    shutil.copy(built / "TireStiffnessEstimator.fmu", folder / "estimator.fmu")
    changed(folder / "car.fmu", folder / "elsewhere.fmu",
            lambda f: f.update({"binaries/vax/SingleTrackVehicle.so": f.pop(OURS)}))  # fmt: skip
    changed(folder / "car.fmu", folder / "exchange.fmu", edit("modelDescription.xml", "<CoSimulation", "<ModelExchange"),
            edit("modelDescription.xml", "</CoSimulation", "</ModelExchange"))  # fmt: skip
    changed(folder / "car.fmu", folder / "guid.fmu", edit("modelDescription.xml", 'guid="{', 'guid="{0'))
    changed(folder / "car.fmu", folder / "broken.fmu", lambda f: f.update({OURS: b"no library"}))
    return folder


REFUSED: dict[str, tuple[list[str], list[str]]] = {
    "not an FMU": (["text.fmu"], ["text.fmu", "is not an FMU"]),
    "no FMU": (["none.fmu"], ["none.fmu", "no such file"]),
    "not the estimator": (["car.fmu"], ["is not the estimator"]),
    "no binary for this machine": (["elsewhere.fmu"], [f"no binary for this machine, {HERE}", "it has: vax"]),
    "model exchange": (["exchange.fmu"], ["FMI 2.0 or 3.0 for co-simulation is needed"]),
    "another version's description": (["guid.fmu"], ["the FMU refuses", "GUID"]),
    "a binary that is none": (["broken.fmu"], ["cannot be loaded"]),
    "too many particles": (["estimator.fmu", "--particles", "600"], ["filter.particles = 600", "16 .. 512"]),
    "overwrites its input": (["estimator.fmu", "--out", "log.csv"], ["--out is the same file as the log"]),
}


@pytest.mark.parametrize("name", REFUSED)
def test_run_refuses_with_a_reason(name, bad):
    (fmu, *options), words = REFUSED[name]
    before = {p.name: p.stat().st_mtime_ns for p in bad.iterdir()}
    refused(tselab_here("fmu", "run", fmu, "log.csv", "--vehicle", "car.toml", *options, cwd=bad), words)
    assert {p.name: p.stat().st_mtime_ns for p in bad.iterdir()} == before
