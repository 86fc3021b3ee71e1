"""Functions of the binding, of files and of processes, each alone."""

import copy
import ctypes
import errno
import os
import signal
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from conftest import simulated
from tse.library import core, files, processes
from tse.library.core import (
    CONFIG,
    INPUT,
    OUTPUT,
    SIM_CONFIG,
    Config,
    Field,
    LearntError,
    Library,
    NativeFilter,
    Replay,
    SettingError,
    SimConfig,
    Simulator,
    UnknownSetting,
    library,
)
from tse.library.errors import NoFile, UserError, suggest_names
from tse.library.processes import InProcess, check_workers, run_in_processes

TABLES = Path(__file__).parents[2] / "src" / "tables"
ROLES = ("STRENGTH", "SHAPE", "GIVEN")

# ---- tables of the library


@pytest.mark.parametrize(
    ("kind", "low", "high", "unit", "text"),
    [
        ("s", 0.5, 2.0, "m/s", "0.5 .. 2 m/s"),
        ("s", 0.0, 1.0, "1", "0 .. 1"),
        ("i", 1.0, 4096.0, "", "1 .. 4096"),
        ("s", 3.0, 3.0, "s", "3 .. 3 s"),
        ("r", 0.0, -1.0, "m", "any"),
    ],
)
def test_a_range_is_written_with_its_unit(kind, low, high, unit, text):
    field = Field("x", kind, 0, 0.0, low, high, unit, "")
    assert field.range_text == text and field.has_range == (text != "any")
    assert field.is_integer == (kind == "i")


def test_effects_are_the_rows_of_their_table():
    table, lib = files.read_toml(TABLES / "effects.toml"), library()
    assert list(lib.effects) == list(table)
    for effect in lib.effects.values():
        row = table[effect.id]
        assert (effect.title, effect.hook, effect.occurrence) == (
            row["title"],
            row["hook"],
            row["occurrence"],
        )
        assert (
            ", ".join(effect.entry_points) == row["entry"] and ", ".join(effect.look_alikes) == row["alike"]
        )
        assert effect.channels == row["channels"] and effect.filter == row["filter"]
        assert [p.name for p in effect.parameters] == list(row["parameter"])
        of = {role: [n for n, p in row["parameter"].items() if p["role"] == role] for role in ROLES}
        assert [p.name for p in effect.strengths] == of["STRENGTH"]
        assert {p.name for p in effect.shapes} == {*of["SHAPE"], *of["GIVEN"]}
        assert [p.name for p in effect.parameters if p.given] == of["GIVEN"]
        for p in effect.parameters:
            wanted = row["parameter"][p.name]
            assert (p.effect, p.setting, p.unit) == (effect.id, f"{effect.id}_{p.name}", wanted["unit"])
            numbers = (p.default, p.low, p.high, *p.typical, p.negligible)
            asked = (wanted[n] for n in ("default", "least", "most"))
            more = (*wanted.get("typical", p.typical), wanted.get("negligible", p.negligible))
            assert numbers == pytest.approx((*asked, *more)) and p.sign == wanted.get("sign", p.sign), (
                p.setting
            )
    assert len({e.bit for e in lib.effects.values()}) == len(table)


def test_settings_of_tables_are_in_the_order_of_the_struct():
    lib = library()
    names = [f.name for f in lib.fields(CONFIG)]
    assert lib.settings_in("uncertainty") == lib.uncertainties and "mass_sd" in lib.uncertainties
    both = lib.settings_in("uncertainty", "vehicle")
    assert both == tuple(n for n in names if n in both) and {"mass", "mass_sd"} <= set(both)
    assert list(lib.settings) == names and lib.settings_in("nothing") == ()


def test_channels_stand_between_the_time_step_and_the_masks():
    lib = library()
    names = [f.name for f in lib.fields(INPUT)]
    required, optional = ([f.name for f in x] for x in (lib.channels, lib.optional))
    assert names == [
        "dt",
        *required,
        "missing",
        *names[len(required) + 2 : names.index("given") + 1],
        *optional,
    ]
    assert required[0] == "steer_angle" and "yaw_rate" in required
    assert lib.status("TSE_W_IMPLAUSIBLE") == 10
    assert (
        lib.codes(core.STATUS)[10].name == "TSE_W_IMPLAUSIBLE" and lib.codes(core.REASON)[0].name == "valid"
    )


def test_the_library_is_that_of_the_variable_or_beside_the_module(monkeypatch, tmp_path):
    monkeypatch.setenv("TSELAB_LIBRARY", str(tmp_path / "mine.so"))
    assert core.find_library() == tmp_path / "mine.so"
    monkeypatch.delenv("TSELAB_LIBRARY")
    for platform, name in {"linux": "libtse.so", "darwin": "libtse.dylib", "win32": "libtse.dll"}.items():
        monkeypatch.setattr(core.sys, "platform", platform)
        assert core.find_library() == Path(core.__file__).parent / "lib" / name


def test_a_file_that_is_no_library_says_so(tmp_path):
    with pytest.raises(UserError, match=r"there is no tse library at .*none.so: run scripts/setup.sh"):
        Library(tmp_path / "none.so")
    (tmp_path / "text.so").write_text("text")
    with pytest.raises(UserError, match=r"text\.so: cannot be loaded as a library: "):
        Library(tmp_path / "text.so")
    import _ctypes

    with pytest.raises(UserError, match="is not a tse library: it has no function tse_step_f64"):
        Library(Path(_ctypes.__file__))


# ---- fixed point


def test_numbers_become_fixed_point_and_back():
    raw = core._to_fixed(np.array([0.0, 1.0, -1.5, 1 / 1024, 0.6 / 256, -0.6 / 256, np.nan]), 8)
    assert raw.tolist() == [0, 256, -384, 0, 1, -1, core.FIXED_NAN] and raw.dtype == np.int64
    assert core._to_fixed(np.array([1e300, -np.inf, np.inf]), 8).tolist() == [2**60, -(2**60), 2**60]
    np.testing.assert_array_equal(core._from_fixed(raw, 8), [0, 1, -1.5, 0, 1 / 256, -1 / 256, np.nan])


def test_records_of_a_fixed_point_library_keep_integers_and_round_settings():
    lib = copy.copy(library())
    if lib.real != np.float64:
        pytest.skip("the library of this run has no doubles")
    assert lib.native(values := np.array([1.5])) is values  # floating point: as it is
    lib.fraction_bits = 20
    back = np.zeros(2)
    lib.from_native(lib.native(np.array([1.5, np.nan])), back)
    np.testing.assert_array_equal(back, [1.5, np.nan])
    record = np.zeros(1, lib.dtype(CONFIG))
    record["mass"], record["particles"], record["valid_sd"] = 1600.1, 77, 0.1
    native = lib.native(record, CONFIG)
    assert native is not record and record["mass"][0] == 1600.1
    assert native["particles"][0] == 77
    assert native["mass"].view(np.int64)[0] == round(float(np.float32(1600.1)) * 2**20)
    made = np.zeros(1, lib.dtype(CONFIG))
    lib.from_native(native, made, CONFIG)
    assert (made["mass"][0], made["particles"][0]) == (1600.1, 77)
    assert made["valid_sd"][0] == pytest.approx(0.1, abs=2**-20)
    output = np.zeros(3, lib.dtype(OUTPUT))
    output["vel_x"], output["status"] = [1.25, np.nan, -3.0], [0, -3, 4]
    again = np.zeros(3, lib.dtype(OUTPUT))
    lib.from_native(lib.native(output, OUTPUT), again, OUTPUT)
    np.testing.assert_array_equal(again["vel_x"], [1.25, np.nan, -3])
    assert again["status"].tolist() == [0, -3, 4]


def test_a_single_row_of_a_fixed_point_library_is_converted():
    """A fixed-point filter must not read the bits of doubles."""
    lib = copy.copy(library())
    if lib.real != np.float64:
        pytest.skip("the library of this run has no doubles")
    lib.fraction_bits = 20
    filter_ = core.NativeFilter(Config.exact({"particles": 50}))
    filter_.lib = lib
    rows, outputs = filter_.inputs(1), filter_.outputs(1)
    rows["steer_angle"] = 1.5
    status = 0

    def step(params, state, row, output):
        def read(address, dtype, field):
            return ctypes.c_int64.from_address(address + dtype.fields[field][1])

        assert read(row, rows.dtype, "steer_angle").value == 3 << 19
        read(output, outputs.dtype, "vel_x").value = 5 << 18
        return status

    filter_._step = step
    assert filter_.step_one(rows, outputs) == 0 and outputs["vel_x"] == 1.25
    status, outputs["vel_x"] = -3, 7
    assert filter_.step_one(rows, outputs) == -3 and outputs["vel_x"] == 7


# ---- settings


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("mass", True, "mass = True is not a number; allowed: 50 .. 50000 kg"),
        ("mass", "heavy", "mass = 'heavy' is not a number"),
        ("mass", float("inf"), "mass = inf is not a number"),
        ("particles", 1.5, "particles = 1.5 is not a whole number"),
        ("particles", float("nan"), "particles = nan is not a whole number"),
        ("mass", 49.9, "mass = 49.9 is outside its range 50 .. 50000 kg ("),
        ("mass", 50001, "mass = 50001 is outside its range"),
    ],
)
def test_a_setting_that_cannot_be_is_refused_and_stays(name, value, said):
    config = Config()
    before = config.as_dict()
    with pytest.raises(SettingError) as error:
        config.set(name, value)
    assert said in str(error.value)
    with pytest.raises(SettingError, match=r"^here: "):
        config.set(name, value, source="here")
    assert config.as_dict() == before


def test_settings_may_reach_their_limits_and_be_numbers_of_numpy():
    config = Config({"mass": 50, "particles": 64.0})
    assert (config.mass, config.particles) == (50, 64) and isinstance(config.particles, int)
    config.mass = np.float32(50000)
    config.particles = np.int64(32)
    assert (config.mass, config.particles) == (50000, 32)
    config.mass = config.fields["mass"].default  # 0: not set, and outside its range
    assert config.changed() == {"particles": 32}


def test_a_setting_that_is_not_there_has_a_hint():
    config = Config()
    with pytest.raises(UnknownSetting, match=r"^there is no setting 'mas' \(did you mean mass"):
        config.set("mas", 1)
    with pytest.raises(UnknownSetting, match=r"^x: there is no setting 'qqqq'; 'tselab settings' lists all"):
        config.set("qqqq", 1, source="x")
    with pytest.raises(AttributeError, match="qqqq"):
        _ = config.qqqq
    assert "mass" in config and "qqqq" not in config
    assert isinstance(UnknownSetting("x"), KeyError) and str(UnknownSetting("a b")) == "a b"


def test_settings_are_those_of_their_struct():
    sim = SimConfig({"seed": 7})
    assert sim.changed() == {"seed": 7} and set(sim.as_dict()) == {
        f.name for f in library().fields(SIM_CONFIG)
    }
    assert Config.settings_of("exact")["mass"] == 1900 and Config.settings_of("default") == {}
    exact = Config.exact({"mass": 1500.0})
    assert (exact.mass, exact.mass_sd) == (1500, 0) and exact.complete().mass == 1500
    told = Config({"mass": 1500.0, "valid_sd": 0.2})
    assert told.complete().valid_sd == 0.2 and told.yaw_inertia == 0 < told.complete().yaw_inertia


def test_a_refusal_of_the_library_names_the_setting_of_any_struct():
    def wrong(name: bytes | None) -> SimpleNamespace:
        return SimpleNamespace(value=name)

    config, sim = Config({"mass": 1500.0}), SimConfig({"speed": 12.0})
    core._raise_refusal(0, wrong(b"mass"), (config,))
    core._raise_refusal(3, wrong(None), (config,))
    with pytest.raises(SettingError, match=r"^mass = 1500 is refused; allowed: 50 .. 50000 kg"):
        core._raise_refusal(-1, wrong(b"mass"), (sim, config))
    with pytest.raises(SettingError, match=r"^speed = 12 is refused; allowed: "):
        core._raise_refusal(-1, wrong(b"speed"), (sim, config))
    with pytest.raises(
        SettingError, match=r"^yaw_inertia follows from mass, lf and lr, and is outside its range"
    ):
        core._raise_refusal(-1, wrong(b"yaw_inertia"), (sim, config))
    (status, row), *_ = ((s, r) for s, r in library().codes(core.STATUS).items() if s < 0)
    with pytest.raises(SettingError) as error:
        core._raise_refusal(status, wrong(None), (config,))
    assert str(error.value) == f"settings refused: {row.text}"
    with pytest.raises(SettingError, match=r"^settings refused: -999 \(odd\)$"):
        core._raise_refusal(-999, wrong(b"odd"), (config,))


@pytest.mark.parametrize(("size", "words"), [(0, 0), (1, 1), (8, 1), (9, 2), (16, 2)])
def test_memory_is_large_enough_and_zero(size, words):
    memory = core._allocate(size)
    assert memory.nbytes == 8 * words and not memory.any() and memory.ctypes.data % 8 == 0


# ---- filters


def make_rows(filter_: NativeFilter, n: int = 5) -> np.ndarray:
    rows = filter_.inputs(n)
    rows["dt"], rows["steer_angle"] = 0.01, 0.001 * np.arange(n)
    rows["wheel_speed_front"] = rows["wheel_speed_rear"] = 60.0
    return rows


def test_rows_of_a_part_write_the_outputs_of_that_part():
    filter_ = NativeFilter(Config.exact())
    rows, out = make_rows(filter_), filter_.outputs(5)
    assert np.isnan(out["vel_x"]).all() and (out["status"] == 0).all() and not filter_.inputs(2)["dt"].any()
    whole = NativeFilter(Config.exact()).estimate_rows(rows)
    filter_.step_into(rows, out, 0, 2)
    assert np.isnan(out["vel_x"][2:]).all()
    filter_.step_into(rows, out, 2)
    assert out.tobytes() == whole.tobytes()
    filter_.reset()
    assert filter_.estimate_rows(rows).tobytes() == whole.tobytes()


def test_one_row_returns_its_status_and_a_refused_one_writes_nothing():
    filter_ = NativeFilter(Config.exact())
    rows, out = make_rows(filter_), filter_.outputs(2)
    assert filter_.step_one(rows[:1], out[:1]) == out["status"][0] >= 0 and np.isfinite(out["vel_x"][0])
    rows["dt"][1] = -1.0
    assert filter_.step_one(rows[1:2], out[1:]) < 0 and np.isnan(out["vel_x"][1])
    filter_.step_into(rows, out, 1, 2)
    assert out["status"][1] < 0 and np.isnan(out["vel_x"][1])


def test_what_was_learnt_is_refused_by_its_age_and_kind():
    filter_ = NativeFilter(Config.exact())
    assert filter_.save_learnt() is None  # before the first row
    t = 0.01 * np.arange(600)
    drive = simulated({}, {"seed": 3, "speed": 20.0}, 0.01, steer_angle=0.03 * np.sin(4 * t))
    rows = filter_.inputs(len(t))
    for name in set(rows.dtype.names) & set(drive.dtype.names):
        rows[name] = drive[name]
    rows["dt"] = 0.01
    filter_.estimate_rows(rows)
    learnt = filter_.save_learnt()
    assert len(learnt) == library().learnt_bytes
    day, sd = 86400.0, []
    for age in (-5.0, 0.0, 10 * day, 40 * day, 1e300):
        other = NativeFilter(Config.exact())
        other.load_learnt(learnt, age)
        out = other.estimate_rows(make_rows(other, 1))
        sd.append(float(out["cy_front_sd"][0] / out["cy_front"][0]))
    assert sd[0] == sd[1] and sd[3] < sd[4] < 0.4
    assert sd[2] ** 2 - sd[1] ** 2 == pytest.approx(0.02**2 * 10, rel=0.02)  # 2 % in a day
    assert sd[3] ** 2 - sd[1] ** 2 == pytest.approx(0.02**2 * 40, rel=0.02)
    with pytest.raises(LearntError, match="age is NaN; allowed: 0 s or more"):
        NativeFilter(Config.exact()).load_learnt(learnt, float("nan"))
    with pytest.raises(TypeError, match=r"learnt: bytes are needed, .* not str"):
        NativeFilter(Config.exact()).load_learnt("text", 0.0)
    for wrong in (b"", learnt[:-1], learnt + b"x"):
        with pytest.raises(LearntError, match="not a learnt state"):
            NativeFilter(Config.exact()).load_learnt(wrong, 0.0)
    with pytest.raises(LearntError, match=r"belongs to another vehicle.* \(its vehicle\)"):
        NativeFilter(Config.exact({"mass": 1500.0})).load_learnt(learnt, 0.0)


def test_the_part_of_each_uncertainty_has_its_name():
    filter_ = NativeFilter(Config.exact({"mass_sd": 0.05}))
    filter_.estimate_rows(make_rows(filter_, 50))
    parts = filter_.uncertainty_sd()
    placed = [n for n, row in files.read_toml(TABLES / "uncertainty.toml").items() if "place" in row]
    assert list(parts) == placed and all(x.shape == (3,) for x in parts.values())
    assert parts["mass_sd"][1] > 0 and not parts["cg_sd"].any()
    assert NativeFilter(Config.exact({"form": 1, "particles": 16})).uncertainty_sd() == {}


# ---- simulator and replay


def test_a_row_that_the_simulator_refuses_is_counted_from_1():
    simulator = Simulator(Config.exact(), SimConfig({"speed": 20.0}))
    rows, out = simulator.inputs(3), simulator.outputs(3)
    rows["dt"], rows["road_level"], rows["steer_angle"] = 0.01, 1.0, [0.0, 0.0, np.nan]
    simulator.step_into(rows, out, 0)
    simulator.step_into(rows, out, 1)
    assert not out["wheel_speed_front"][2] and (out["wheel_speed_front"][:2] > 0).all()
    with pytest.raises(UserError, match="the simulator refused row 3: "):
        simulator.step_into(rows, out, 2)


def make_replay(n: int = 40, **more) -> Replay:
    log = {"dt": np.full(n, 0.01), "steer_angle": np.full(n, 0.01)}
    log |= dict.fromkeys(("wheel_speed_front", "wheel_speed_rear"), np.full(n, 60.0))
    return Replay(("accel_y", "yaw_rate"), **(log | more))


def test_a_replay_asks_for_its_columns_by_name_and_length():
    with pytest.raises(ValueError, match="steer_angle is needed: "):
        make_replay(steer_angle=None)
    with pytest.raises(ValueError, match=r"bank has shape \(3,\); needed: \(40,\), one value for each row"):
        make_replay(bank=np.zeros(3))
    with pytest.raises(UserError, match="replay refused row 8: "):
        make_replay(steer_angle=np.where(np.arange(40) == 7, np.nan, 0.01)).run(Config.exact())
    with pytest.raises(SettingError, match="follows from mass"):
        make_replay().run(Config({"mass": 50.0, "lf": 0.1, "lr": 10.0}))


def test_a_column_that_is_removed_has_no_effect_and_a_start_lasts_for_one_run():
    replay = make_replay()
    plain = {n: x.copy() for n, x in replay.run(Config.exact()).items()}
    assert set(plain) == {"accel_y", "yaw_rate"} and plain["yaw_rate"][-1] > 0
    replay.set("bank", np.full(40, 0.05))
    assert np.abs(replay.run(Config.exact())["accel_y"] - plain["accel_y"]).max() > 0.1
    replay.set("bank", None)
    np.testing.assert_array_equal(replay.run(Config.exact())["accel_y"], plain["accel_y"])
    names = [f.name for f in library().fields(core.REPLAY_START)]
    moved = replay.run(Config.exact(), yaw_rate=0.5) if "yaw_rate" in names else replay.run(Config.exact())
    assert "yaw_rate" not in names or moved["yaw_rate"][0] > plain["yaw_rate"][0] + 0.3
    np.testing.assert_array_equal(replay.run(Config.exact())["yaw_rate"], plain["yaw_rate"])


# ---- files


def test_errors_that_a_user_can_mend_have_the_text_of_the_system():
    for name in ("ENOSPC", "EIO", "EROFS", "EFBIG"):
        code = getattr(errno, name)
        assert files.explain_write_error(OSError(code, os.strerror(code))) == os.strerror(code)
    assert files.explain_write_error(OSError(errno.EPIPE, "x")) == ""
    assert files.explain_write_error(ValueError("x")) == ""


def test_a_folder_for_results_is_made_with_its_parents(tmp_path):
    files.make_directory(tmp_path / "a" / "b")
    files.make_directory(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="file: is a file, a directory is needed"):
        files.make_directory(tmp_path / "file")
    with pytest.raises(UserError, match=r"file/c: cannot be created: Not a directory"):
        files.make_directory(tmp_path / "file" / "c")


def test_a_loop_of_links_has_a_path(tmp_path):
    (tmp_path / "loop").symlink_to("loop")
    assert files.resolve_path(tmp_path / "loop").name == "loop"
    (tmp_path / "link").symlink_to("target")
    assert files.resolve_path(tmp_path / "link") == tmp_path / "target"


def test_a_file_is_written_as_text_or_bytes_with_the_rights_of_its_umask(tmp_path):
    before = os.umask(0o027)
    try:
        with files.write_atomically(tmp_path / "text") as file:
            file.write("ä\r\n\n")
        with files.write_atomically(tmp_path / "bytes", "wb") as file:
            file.write(b"\0\r\n")
    finally:
        os.umask(before)
    assert (tmp_path / "text").read_bytes() == "ä\r\n\n".encode() and (
        tmp_path / "bytes"
    ).read_bytes() == b"\0\r\n"
    assert (tmp_path / "text").stat().st_mode & 0o777 == 0o640
    with files.write_atomically(Path("/dev/null")) as file:
        file.write("x")
    assert Path("/dev/null").is_char_device()


@pytest.mark.parametrize(
    ("error", "kind", "said"),
    [
        (
            OSError(errno.ENOSPC, "No space left"),
            UserError,
            "x: cannot be written: No space left; the unfinished",
        ),
        (
            OSError("encoder error"),
            UserError,
            "x: cannot be written: encoder error; the unfinished file is deleted",
        ),
        (OSError(errno.EPIPE, "Broken pipe"), BrokenPipeError, "Broken pipe"),
        (UserError("of ours"), UserError, "^of ours$"),
        (NoFile("gone"), NoFile, "^gone$"),
    ],
)
def test_an_error_while_writing_is_explained_if_it_is_one_of_writing(error, kind, said, tmp_path):
    (tmp_path / "x").write_text("before")
    with pytest.raises(kind, match=said), files.write_atomically(tmp_path / "x"):
        raise error
    assert [p.name for p in tmp_path.iterdir()] == ["x"] and (tmp_path / "x").read_text() == "before"


@pytest.mark.parametrize(("age", "stays"), [(55.0, True), (65.0, False)])
def test_an_unfinished_file_is_deleted_after_a_minute(age, stays, tmp_path):
    import time

    left = tmp_path / ".x.abcdefgh.part"
    left.write_text("")
    os.utime(left, (time.time() - age,) * 2)
    files._remove_stale_parts(tmp_path / "x")
    assert left.exists() == stays


def test_where_nothing_can_be_written_is_said_before_the_work(tmp_path, monkeypatch):
    files.check_writable(None, tmp_path / "new", None)
    with pytest.raises(UserError, match="is a directory, a file name is needed"):
        files.check_writable(None, tmp_path)
    with pytest.raises(UserError, match=r"gone/x: the directory .*gone does not exist"):
        files.check_writable(tmp_path / "y", tmp_path / "gone" / "x")
    monkeypatch.setattr(files.os, "access", lambda path, mode: mode != os.W_OK)
    with pytest.raises(UserError, match="is not writable"):
        files.check_writable(tmp_path / "x")


def test_an_output_is_no_input_and_no_other_output(tmp_path):
    log, link = tmp_path / "log", tmp_path / "link"
    log.write_text("")
    os.link(log, link)
    files.check_distinct(
        {"--out": tmp_path / "a", "--table": tmp_path / "b", "--c": None}, {"the log": log, "x": None}
    )
    with pytest.raises(UserError, match="link: --out is the same file as the log"):
        files.check_distinct({"--out": link}, {"the log": log})
    with pytest.raises(UserError, match="new: --table is the same file as --out"):
        files.check_distinct({"--out": tmp_path / "new", "--table": tmp_path / "." / "new"}, {})
    files.check_distinct({}, {"one": log, "other": log})  # inputs may be the same


@pytest.mark.parametrize(
    ("name", "parquet"),
    [("a.parquet", True), ("a.PQ", True), ("a.csv", False), ("parquet", False), ("a.pq.gz", False)],
)
def test_a_table_is_parquet_by_its_suffix(name, parquet):
    assert files.is_parquet(Path(name)) == parquet and not files.is_parquet(None)


def test_a_seal_holds_for_its_content_in_any_order(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "load_secret", lambda: b"s" * 32)
    path = tmp_path / "x.json"
    files.write_sealed(path, {"b": [1, 2.5], "a": "ä"})
    assert files.read_sealed(path) == {"a": "ä", "b": [1, 2.5]}
    assert files.compute_seal({"a": 1, "b": 2}) == files.compute_seal({"b": 2, "a": 1})
    assert files.compute_seal({"a": 1}) != files.compute_seal({"a": 2})
    text = path.read_text()
    for wrong in (text.replace("2.5", "2.6"), text.replace('"seal"', '"sea"'), text[:-3], "[]", "1", ""):
        path.write_text(wrong)
        assert files.read_sealed(path) is None
    assert files.read_sealed(tmp_path / "gone") is None
    path.write_text(text)
    monkeypatch.setattr(files, "load_secret", lambda: b"t" * 32)
    assert files.read_sealed(path) is None


def test_a_file_of_at_most_its_size_is_read(tmp_path):
    path = tmp_path / "x"
    path.write_bytes(bytes(3 << 20))
    files.check_regular(path, 3 << 20, "a table")
    with pytest.raises(UserError, match="x: is too large: 3 MB; a table has at most 2 MB"):
        files.check_regular(path, (3 << 20) - 1, "a table")
    files.check_regular(tmp_path, 0, "a table")  # opening it is the error
    files.check_regular(tmp_path / "gone", 0, "a table")
    with pytest.raises(UserError, match="/dev/null: is a device or a pipe, a table is needed"):
        files.check_regular(Path("/dev/null"), 1, "a table")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"a = 9223372036854775808", "key a: an integer has at most 64 bits"),
        (b"[t]\na = [1, [-9223372036854775809]]", r"key t\.a\.1\.0: an integer has at most 64 bits"),
        (b"a = " + b"[" * 65 + b"]" * 65, "tables are nested more than 64 deep"),
        (b"\xff = 1", "is not a text file in UTF-8; a TOML file is needed"),
        (b"a = = 1", "is not valid TOML: "),
        (b"a,b,c,d\n1,2,3,4\n", r"its first line has 4 columns: is it a log instead of a TOML file\?"),
        (b"a\tb\tc\td\te\n", r"its first line has 5 columns"),
    ],
)
def test_a_toml_file_that_is_wrong_says_what_is_wrong(content, said, tmp_path):
    path = tmp_path / "x.toml"
    path.write_bytes(content)
    with pytest.raises(UserError, match=rf"(?s)x\.toml: .*{said}") as error:
        files.read_toml(path)
    assert ("columns" in str(error.value)) == ("columns" in said)


def test_a_toml_file_is_read_up_to_its_limits(tmp_path):
    path = tmp_path / "x.toml"
    text = f"a = 9223372036854775807\nb = -9223372036854775808\nc = {'[' * 64}{']' * 64}\nd = true\n"
    path.write_text("\ufeff" + text, encoding="utf-8")
    assert files.read_toml(path)["a"] == 2**63 - 1 and files.read_toml(path)["d"] is True
    with pytest.raises(NoFile, match=r"gone\.toml: no such file"):
        files.read_toml(tmp_path / "gone.toml")
    with pytest.raises(UserError, match="is a directory, a TOML file is needed"):
        files.read_toml(tmp_path)
    path.write_text("a,b,c = = 1\n")
    with pytest.raises(UserError) as error:
        files.read_toml(path)
    assert "columns" not in str(error.value)  # three cells, and an equals sign


def test_similar_names_are_offered_and_no_others():
    known = ["yaw_rate", "yaw_ratio", "yaw_rates", "mass"]
    assert suggest_names("yaw_rat", known) == " (did you mean yaw_rate or yaw_ratio?)"
    assert suggest_names("yaw_rat", known, 1) == " (did you mean yaw_rate?)"
    assert suggest_names("qqq", known, other="; none") == "; none" and suggest_names("qqq", known) == ""
    assert str(NoFile("a b")) == "a b" and isinstance(NoFile("x"), FileNotFoundError)


# ---- processes


def test_tasks_in_this_process_run_in_their_order_when_their_result_is_asked():
    seen = []

    def do(task: int) -> int:
        seen.append(task)
        if task == 2:
            raise ZeroDivisionError
        return 10 * task

    results = run_in_processes(do, [3, 2, 1], 1)
    task, result = next(results)
    assert task == 3 and not seen and result() == 30
    task, result = next(results)
    with pytest.raises(ZeroDivisionError):
        result()
    assert [(t, r()) for t, r in results] == [(1, 10)] and seen == [3, 2, 1]
    assert list(run_in_processes(do, [], 4)) == [] and isinstance(InProcess(do).__enter__(), InProcess)


def test_a_kill_is_an_interrupt_within_the_block_only():
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), processes.treat_kill_as_interrupt():
        signal.raise_signal(signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is before


def test_interrupts_are_ignored_within_the_block_only():
    before = signal.getsignal(signal.SIGINT)
    with processes.ignore_interrupts():
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_another_thread_changes_no_signal():
    seen = []

    def run() -> None:
        with processes.treat_kill_as_interrupt(), processes.ignore_interrupts():
            seen.extend(signal.getsignal(s) for s in (signal.SIGTERM, signal.SIGINT))

    thread = threading.Thread(target=run)
    before = [signal.getsignal(s) for s in (signal.SIGTERM, signal.SIGINT)]
    thread.start()
    thread.join()
    assert seen == before


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (
            ("none", ""),
            "worker b of the Dask cluster at there has no tselab, but this process has tselab VERSION",
        ),
        (("0.0", "x"), r"worker b .* has tselab 0\.0, but this process"),
        (("VERSION", "other"), "worker b .* has tselab VERSION with other code, but this process"),
        (None, ""),
    ],
)
def test_a_worker_with_other_code_is_named(found, said):
    from tse.library import __version__

    class Client:
        def run(self, read):
            mine = read()
            assert mine[0] == __version__
            other = mine if found is None else tuple(x.replace("VERSION", __version__) for x in found)
            return {"b": other, "a": mine}

    if found is None:
        check_workers(Client(), "there")
        return
    with pytest.raises(UserError, match=said.replace("VERSION", __version__.replace(".", r"\."))):
        check_workers(Client(), "there")


def test_a_cluster_is_waited_for_until_its_first_worker(monkeypatch):
    monkeypatch.setattr(processes.time, "sleep", lambda _: None)
    answers = iter([{}, {}])

    class Client:
        def run(self, read):
            return next(answers, {"a": read()})

    check_workers(Client(), "there")
    monkeypatch.setattr(processes, "WORKERS_TIMEOUT", 0)
    with pytest.raises(UserError, match="the Dask cluster at there has no workers; start at least one"):
        check_workers(SimpleNamespace(run=lambda _: {}), "there")
