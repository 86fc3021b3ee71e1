"""The page of scripts/dev/page.py in a browser, from a file and without a network.

Its estimates are the same bytes as those of `tselab estimate`. Other log formats, error
messages, simulator and filter are tested, too. Screenshots are written to
build/site/shots.
"""

import io
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts" / "dev"))
import page  # noqa: E402

from tse.car.vehicle import make_filter_values, read_vehicle  # noqa: E402
from tse.estimation.estimate import write_table  # noqa: E402
from tse.library.core import Config, SimConfig  # noqa: E402
from tse.library.errors import UserError  # noqa: E402
from tse.runs import single  # noqa: E402
from tse.runs.single import prepare_run  # noqa: E402
from tse.simulation import maneuvers  # noqa: E402
from tse.simulation.simulate import simulate  # noqa: E402

SHOTS = ROOT / "build" / "site" / "shots"
RATIO = 15.0
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
CHANNELS = ["steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate"]


@pytest.fixture(scope="module")
def built():
    """Build the page; return its path."""
    for program in ("node", "npm"):
        if not shutil.which(program):
            pytest.skip(f"{program} is not installed: it controls the browser of this test")
    try:
        page.find_compilers()
        page.install_modules()
    except page.Failed as error:
        pytest.skip(f"the page cannot be built here: {str(error)[:200]}")
    page.build(page.PAGE)
    return page.PAGE


def test_the_page_that_git_holds_is_of_these_sources():
    """The test needs no compiler. Build the page anew by scripts/dev/page.py --ship."""
    assert page.read_shipped_digest() == page.compute_digest(), "scripts/dev/page.py --ship"


@pytest.fixture(scope="module")
def browser():
    """Return the path of a browser."""
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip(f"no browser is installed (looked for {', '.join(BROWSERS)})")
    return found


@pytest.fixture(scope="module")
def drive():
    """Return a log of 20 s with noise."""
    config = Config.exact()
    plan = maneuvers.build("double-lane-change", config, sample_time=0.01, duration=20.0, seed=3)
    return simulate(plan, config, SimConfig({"seed": 3, "wheel_speed_sd": 0.02, "steer_angle_sd": 2e-4})).log


@pytest.fixture(scope="module")
def slow():
    """Return a log of 30 s at about 40 km/h."""
    config = Config.exact()
    plan = maneuvers.build(
        "double-lane-change", config, sample_time=0.01, duration=30.0, speed=9.0, amplitude=0.06, seed=4
    )
    return simulate(plan, config, SimConfig({"seed": 4})).log


@pytest.fixture(scope="module")
def logs(drive, slow, tmp_path_factory):
    """Return the log files for the page, by name."""
    folder = tmp_path_factory.mktemp("logs")
    rng = np.random.default_rng(1)
    rough = drive.copy()  # missing cells, lost rows, an impossible value, a gap
    for name in CHANNELS:
        rough.loc[rng.random(len(rough)) < 0.02, name] = np.nan
    rough.loc[700, "accel_y"] = 999.0
    rough.loc[400:420, CHANNELS] = np.nan  # rows with a time and nothing else
    rough = rough.drop(index=[*range(300, 306), *range(900, 960)])
    rough["time"] += 1.7e9  # a clock that counts from 1970
    write_table(drive, folder / "plain.csv")
    write_table(rough, folder / "rough.csv")
    clock = drive.copy()  # late and double rows; a clock that is set back and forward
    clock.loc[100, "time"] -= 0.035
    clock.loc[200, "time"] = clock.loc[201, "time"]
    clock.loc[500:, "time"] -= 3.0
    clock.loc[1500:, "time"] += 9000.0
    side = clock["yaw_rate"] * 0.8 / 0.33  # left and right wheels, some of them missing
    for axle in ("front", "rear"):
        for place, sign in (("left", -1), ("right", 1)):
            clock[f"wheel_speed_{axle}_{place}"] = clock[f"wheel_speed_{axle}"] + sign * side
        clock.loc[rng.random(len(clock)) < 0.05, f"wheel_speed_{axle}_left"] = np.nan
    write_table(clock.drop(columns=["wheel_speed_front", "wheel_speed_rear"]), folder / "clock.csv")
    coarse = drive.assign(time=np.floor(drive["time"] / 0.015) * 0.015)  # a third of the entries share a tick
    write_table(coarse, folder / "coarse.csv")
    drive.to_parquet(folder / "parquet.parquet", compression="zstd")
    corners = (("VL", "front", -1), ("VR", "front", 1), ("HL", "rear", -1), ("HR", "rear", 1))
    turn = 0.8 * slow["yaw_rate"]
    wheels = {
        f"v_{p} [km/h]": (slow[f"wheel_speed_{axle}"] * 0.33 + side * turn) * 3.6 for p, axle, side in corners
    }
    german = pd.DataFrame(
        {
            "Zeit [s]": slow["time"],
            "LW_Lenkradwinkel [°]": -np.degrees(slow["steer_angle"]) * RATIO,
            **wheels,
            "Gierrate [°/s]": np.degrees(slow["yaw_rate"]),
            "Querbeschleunigung [g]": slow["accel_y"] / 9.80665,
            "Laengsbeschleunigung [g]": slow["accel_x"] / 9.80665,
        }
    )
    german.to_csv(folder / "german.csv", sep=";", decimal=",", index=False, encoding="cp1252")
    text = (folder / "plain.csv").read_text().splitlines()
    (folder / "word.csv").write_text(
        "\n".join([text[0], *(",".join(["x", *line.split(",")[1:]]) for line in text[1:50])]) + "\n"
    )
    (folder / "empty.csv").write_text("")
    (folder / "broken.csv").write_text("\n".join(text[:40]) + "\n1,2,3,4,5,6,7,8,9,10\n")
    degrees = drive.assign(steer_angle=np.degrees(drive["steer_angle"]) * RATIO)
    write_table(degrees, folder / "degrees.csv")
    (folder / "binary.mf4").write_bytes(b"MDF     4.10\0\0\0\0" + bytes(200))
    return {p.stem: str(p) for p in sorted(folder.iterdir(), key=lambda p: p.stem)}


def list_mistakes():
    """Return mistakes by name, each as a function of the log."""
    deg, g = 180 / np.pi, 9.80665

    def of(**factors):
        return lambda log: log.assign(**{name: log[name] * factor for name, factor in factors.items()})

    wheels = lambda factor: of(wheel_speed_front=factor, wheel_speed_rear=factor)  # noqa: E731
    radius = Config.exact().wheel_radius_front
    return {
        "right": lambda log: log,
        "yaw sign": of(yaw_rate=-1),
        "accel sign": of(accel_y=-1),
        "steer sign": of(steer_angle=-1),
        "along sign": of(accel_x=-1),
        "yaw deg": of(yaw_rate=deg),
        "accel g": of(accel_y=1 / g),
        "both g": of(accel_y=1 / g, accel_x=1 / g),
        "steering wheel": of(steer_angle=15.0),
        "wheels m/s": wheels(radius),
        "wheels rpm": wheels(60 / (2 * np.pi)),
        "g and sign": of(accel_y=-1 / g),
        "swapped": lambda log: log.assign(accel_x=log["accel_y"], accel_y=log["accel_x"]),
        "turned imu": lambda log: log.assign(
            accel_x=0.866 * log["accel_x"] + 0.5 * log["accel_y"],
            accel_y=0.866 * log["accel_y"] - 0.5 * log["accel_x"],
        ),
        "one side": lambda log: log.assign(
            wheel_speed_front=log["wheel_speed_front"] - 0.75 * log["yaw_rate"] / radius,
            wheel_speed_rear=log["wheel_speed_rear"] + 0.75 * log["yaw_rate"] / radius,
        ),
        "rear rpm": of(wheel_speed_rear=60 / (2 * np.pi)),
        "half": of(accel_y=0.5),
        "few": lambda log: log.head(300),
        "slow rows": lambda log: log.iloc[::10].assign(yaw_rate=-log["yaw_rate"].iloc[::10]),
    }


@pytest.fixture(scope="module")
def checks(slow, tmp_path_factory):
    """Return logs with mistakes, and one without units, in km/h, deg/s and g."""
    folder = tmp_path_factory.mktemp("checks")
    files = {}
    # so that deg/s are inside the range, too
    gentle = slow.assign(**{name: slow[name] * 0.5 for name in ("yaw_rate", "steer_angle", "accel_y")})
    for i, (name, change) in enumerate(list_mistakes().items()):
        files[name] = str(folder / f"{i}.csv")
        write_table(change(gentle), files[name])
    turn = 0.8 * slow["yaw_rate"]
    corners = (("VL", "front", -1), ("VR", "front", 1), ("HL", "rear", -1), ("HR", "rear", 1))
    wheels = {f"v_{p}": (slow[f"wheel_speed_{axle}"] * 0.33 + side * turn) * 3.6 for p, axle, side in corners}
    unsaid = pd.DataFrame(
        {
            "Zeit": slow["time"],
            "Lenkradwinkel": np.degrees(slow["steer_angle"]) * RATIO,
            **wheels,
            "Gierrate": -np.degrees(slow["yaw_rate"]),
            "Querbeschleunigung": slow["accel_y"] / 9.80665,
            "Laengsbeschleunigung": slow["accel_x"] / 9.80665,
        }
    )
    files["unsaid"] = str(folder / "unsaid.csv")
    unsaid.to_csv(files["unsaid"], sep=";", decimal=",", index=False)
    return files


@pytest.fixture(scope="module")
def cars(tmp_path_factory):
    """Return vehicle files by name."""
    folder = tmp_path_factory.mktemp("cars")
    lines = [
        "mass = 1500",
        "lf = 1.1",
        "lr = 1.6",
        "wheel_radius_front = 0.3",
        "wheel_radius_rear = 0.31",
        'name = "ours"',
    ]
    (folder / "little.toml").write_text("\n".join([*lines, "[uncertainty]", "cg_sd = 0.01"]))
    (folder / "misspelt.toml").write_text("\n".join(["masss = 1500", *lines]))
    (folder / "heavy.toml").write_text("\n".join(["mass = 1e9", *lines[1:]]))
    (folder / "short.toml").write_text("lf = 1.1")
    (folder / "broken.toml").write_text("mass = = 2")
    return {p.stem: str(p) for p in sorted(folder.iterdir())}


@pytest.fixture(scope="module")
def seen(built, browser, logs, cars, checks, tmp_path_factory):
    """Return the state of the page in the browser, as browse.mjs writes it."""
    file = tmp_path_factory.mktemp("page") / "logs.json"
    file.write_text(json.dumps({"logs": logs, "cars": cars, "checks": checks}))
    command = [
        "node",
        str(Path(__file__).parent / "browse.mjs"),
        str(page.install_modules()),
        browser,
        str(built),
        str(SHOTS),
        str(file),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=280, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout)


def run_tselab(folder, log, car):
    """Return EST.csv of `tselab estimate` as bytes, computed in this process."""
    numbers = np.random.default_rng(1).standard_normal(1000).tolist()
    if pd.read_csv(io.StringIO("\n".join(["x", *map(repr, numbers)])))["x"].tolist() != numbers:
        pytest.skip(
            f"pandas {pd.__version__} reads some numbers as the neighbour of the nearest double: update it"
        )
    (folder / "vehicle.toml").write_text(car)
    single.run_prepared(
        prepare_run(log, folder / "vehicle.toml", None, None, {}, "default", {}), folder / "est.csv", None
    )
    return (folder / "est.csv").read_bytes()


def run_command(folder, log, car):
    """Return EST.csv of the command itself as bytes."""
    (folder / "vehicle.toml").write_text(car)
    out = folder / "est.csv"
    command = [
        sys.executable,
        "-m",
        "tselab",
        "estimate",
        str(log),
        "--vehicle",
        str(folder / "vehicle.toml"),
        "--out",
        str(out),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 3, 4), done.stderr
    return out.read_bytes()


@pytest.mark.slow
def test_the_page_asks_no_network_and_reports_no_error(seen):
    assert seen["fatal"] == "" and seen["errors"] == []
    assert {url.split(":")[0] for url in seen["requests"]} <= {"file", "blob", "data"}
    assert seen["foot"] == "Reads CSV and Parquet."


@pytest.mark.slow
def test_the_example_is_estimated_as_on_the_command_line_to_the_byte(seen, tmp_path):
    given = seen["logs"]["example"]
    (tmp_path / "log.csv").write_text(given["log"])
    assert run_command(tmp_path, tmp_path / "log.csv", given["car"]) == given["est"].encode()


@pytest.mark.parametrize("name", ["example", "drive", "rough", "german", "parquet"])
def test_its_estimates_are_those_of_the_command_line_to_the_byte(seen, name, tmp_path):
    given = seen["logs"][name]
    (tmp_path / "log.csv").write_text(given["log"])
    assert given["state"].startswith("Done"), given["state"]
    assert given["est"].count("\n") == given["log"].count("\n")
    assert run_tselab(tmp_path, tmp_path / "log.csv", given["car"]) == given["est"].encode()


@pytest.mark.parametrize("name", ["plain", "rough", "clock", "coarse"])
def test_a_file_is_the_same_rows_here_and_there(seen, logs, name, tmp_path):
    """The file dropped on the page and the log it returns have the same rows."""
    given = seen["logs"][name]
    there, here = run_tselab(tmp_path, Path(logs[name]), given["car"]), given["est"].encode()
    if name != "clock":  # the mean of a wheel that is missing may differ by its last bit
        assert there == here
    a, b = (pd.read_csv(io.BytesIO(x)) for x in (there, here))
    pd.testing.assert_frame_equal(a, b, rtol=1e-9, atol=1e-12)


def test_the_built_in_example_is_a_drive_run_tselab(seen, tmp_path):
    config = Config.exact()
    plan = maneuvers.build(
        page.DRIVE, config, sample_time=config.sample_time, duration=page.SECONDS, road=[page.ROAD]
    )
    done = simulate(plan, config, SimConfig({"seed": page.SEED}))
    write_table(done.log, tmp_path / "log.csv")
    (tmp_path / "page.csv").write_text(seen["logs"]["example"]["log"])
    made = pd.read_csv(tmp_path / "page.csv", dtype=str).astype(float)
    expected = pd.read_csv(tmp_path / "log.csv", dtype=str).astype(float)
    pd.testing.assert_frame_equal(made[list(expected)], expected, check_exact=True)
    assert np.array_equal(made["ref_cy_front"], done.truth["true_cy_front"])


def test_it_finds_the_road_change_of_the_example(seen):
    assert "the road changed (all tyres) at 30." in seen["logs"]["example"]["change"]


def test_a_german_log_is_understood(seen, slow, tmp_path):
    """Semicolons, decimal commas, km/h, degrees, g, inverted steering wheel angle."""
    german = seen["logs"]["german"]
    found = {channel: (m["unit"], m["sign"]) for channel, m in german["map"].items()}
    assert (
        found["steer_angle"] == ("deg", -1)
        and found["yaw_rate"] == ("deg/s", 1)
        and found["accel_y"] == ("g", 1)
    )
    assert (
        german["map"]["wheel_speed_front"]["other"] == "v_VR [km/h]"
        and found["wheel_speed_front"][0] == "km/h"
    )
    ratio = german["map"]["steer_angle"]["ratio"]
    assert 0.85 * RATIO < ratio < 1.15 * RATIO  # contains understeer
    assert "ratio about" in german["hint"]
    (tmp_path / "log.csv").write_text(german["log"])
    rows = pd.read_csv(tmp_path / "log.csv")
    assert np.allclose(rows["steer_angle"] * ratio / RATIO, slow["steer_angle"], rtol=1e-12, atol=0)
    for name in CHANNELS[1:]:
        assert np.allclose(rows[name], slow[name], rtol=1e-9, atol=1e-12), name
    assert "semicolon" in german["notes"]


def test_a_parquet_file_has_the_rows_of_its_frame(seen, drive, tmp_path):
    (tmp_path / "log.csv").write_text(seen["logs"]["parquet"]["log"])
    rows = pd.read_csv(tmp_path / "log.csv", dtype=str).astype(float)
    for name in ["time", *CHANNELS]:
        assert np.array_equal(rows[name], drive[name]), name


def test_without_a_mass_nothing_is_valid_and_stiffness_follows_one_that_is_said_later(seen):
    given = seen["noMass"]
    rows = pd.read_csv(io.StringIO(given["est"]))
    for s in ("cx_front", "cy_front", "cy_rear"):
        assert not rows[f"{s}_valid"].any()
    assert (rows["cy_front_reason"] == "parameters uncertain").mean() > 0.5
    assert given["mass"] == ["", "not known"] and "The mass is not known" in given["notes"]
    assert "\nmass = " not in given["car"]  # the command asks for it
    (empty, before), (still, after) = given["before"], given["after"]
    assert empty == still == "" and after == pytest.approx(before * 1900 / 1500, rel=1e-3)


def test_what_nobody_said_is_that_of_the_class(seen, tmp_path):
    """A log alone: car and sensors are those of `tselab` for this mass and length."""
    (tmp_path / "page.toml").write_text(seen["logs"]["plain"]["car"])
    page_says = read_vehicle(tmp_path / "page.toml").values
    needed = [
        f"{key} = {page_says[key]}" for key in ("mass", "lf", "lr", "wheel_radius_front", "wheel_radius_rear")
    ]
    (tmp_path / "plain.toml").write_text("\n".join(needed))
    ordinary = make_filter_values(read_vehicle(tmp_path / "plain.toml"))
    compared = [key for key in page_says if key in ordinary]
    assert len(compared) > 30 and {"mass_sd", "accel_y_sd", "cornering_stiffness_front"} <= set(compared)
    for key in compared:
        assert page_says[key] == pytest.approx(ordinary[key], rel=1e-12), key


def test_a_vehicle_file_is_filled_in_as_tselab_fills_it_in(seen, cars):
    vehicle, page_says = read_vehicle(Path(cars["little"])), seen["cars"]["little"]
    assert page_says["wrong"] == ""
    assert vehicle.values["cornering_stiffness_front"] != Config.exact().cornering_stiffness_front
    for key, value in vehicle.values.items():
        assert page_says["settings"][key] == pytest.approx(value, rel=1e-12), key


def test_what_a_vehicle_file_says_outlives_the_next_log(seen, cars):
    for key, value in make_filter_values(read_vehicle(Path(cars["little"]))).items():
        if key in read_vehicle(Path(cars["little"])).values:
            assert seen["kept"][key] == pytest.approx(value, rel=1e-12), key


@pytest.mark.parametrize(
    ("kind", "name", "words"),
    [
        ("logs", "broken", ["line 41", "10 cells", "7 columns"]),
        ("logs", "word", ["line 2", "column time", '"x" is not a number', "seconds"]),
        ("logs", "empty", ["is empty"]),
        (
            "logs",
            "degrees",
            ["column steer_angle", "outside the allowed range -1.2 .. 1.2 rad", "steering ratio"],
        ),
        ("logs", "binary", ["binary", "tselab"]),
        ("cars", "misspelt", ["key masss is not known"]),
        ("cars", "heavy", ["key mass", "refused", "50 .. 50000 kg"]),
        ("cars", "short", ["key mass, lr", "is missing"]),
        ("cars", "broken", ["not TOML"]),
    ],
)
def test_what_is_wrong_with_a_file_is_said(seen, kind, name, words):
    wrong = seen[kind][name]["wrong"].replace("−", "-")
    for word in words:
        assert word in wrong, wrong


def test_every_control_has_a_name(seen):
    assert seen["nameless"] == []


@pytest.mark.parametrize("name", list_mistakes())
def test_channels_that_contradict_each_other_are_spoken_of_as_the_command_does(seen, checks, name, tmp_path):
    """Page and command report the same causes; their figures differ by a few percent."""
    car = Config.exact()
    (tmp_path / "car.toml").write_text(
        "\n".join(
            f"{key} = {getattr(car, key)}"
            for key in ("mass", "lf", "lr", "wheel_radius_front", "wheel_radius_rear")
        )
    )
    here = seen["checks"][name]
    try:
        expected = prepare_run(
            Path(checks[name]), tmp_path / "car.toml", None, None, {}, "default", {}
        ).warnings
    except UserError:  # values outside their range: the page refuses them, too
        assert "outside the allowed range" in here["wrong"]
        return
    assert here["wrong"] == ""
    lines = here["against"].replace("−", "-").splitlines()[:-1]
    number = re.compile(r"-?\d+\.?\d*(?:e[-+]?\d+)?")
    assert [number.sub("#", x) for x in lines] == [number.sub("#", x) for x in expected]
    for mine, theirs in zip(lines, expected, strict=True):
        assert np.allclose(
            [float(x) for x in number.findall(mine)], [float(x) for x in number.findall(theirs)], rtol=0.1
        )
    assert ("contradict" in here["cards"]) == bool(expected)


def test_units_that_nobody_says_are_guessed_from_what_the_rows_have_to_do_with_each_other(seen):
    found = seen["checks"]["unsaid"]
    units = {c: m["unit"] for c, m in found["map"].items()}
    assert [units[f"wheel_speed_{a}"] for a in ("front", "rear")] == ["km/h", "km/h"], found
    assert (units["yaw_rate"], units["accel_y"], units["accel_x"]) == ("deg/s", "g", "g")
    assert found["map"]["yaw_rate"]["sign"] == -1
    off = float(re.search(r"ratio about [\d.]+ \(± (\d+) %\)", found["hint"])[1]) / 100
    assert found["map"]["steer_angle"]["ratio"] == pytest.approx(RATIO, rel=off) and off < 0.35
    assert found["ratio sd"] == pytest.approx(off / 1.96, abs=0.004)  # and the sd of the estimate follows it
    assert seen["looseAfterCar"] == found["ratio sd"]
    assert found["against"] == found["wrong"] == ""
    assert "wheel speeds are in km/h" in found["hint"]


def test_a_setting_that_is_refused_is_shown_where_it_stands(seen):
    assert seen["refused"]["focus"] == "set-mass" and seen["refused"]["invalid"] == "true"
    assert "Not estimated: mass: 5; allowed" in seen["refused"]["state"]


def test_sliders_of_road_and_noise_move_by_their_keys_and_leave_the_driver_alone(seen):
    assert seen["sliders"]["level"] > 0 and seen["sliders"]["noise"] > 0 and seen["sliders"]["auto"]


def test_a_setting_outside_its_range_is_refused_with_the_range(seen):
    assert "mass: 5; allowed: 50 .. 50000 kg" in seen["mass"]


def test_the_filter_follows_a_road_change_in_the_drive(seen):
    dry, wet = seen["drive"]["dry"], seen["drive"]["wet"]
    assert wet["truth"] == pytest.approx(0.75 * dry["truth"])
    for at in (dry, wet):
        assert at["valid"] == 1
        assert abs(at["est"] - at["truth"]) < 4 * at["sd"] and at["sd"] < 0.1 * at["truth"]
    assert wet["kind"] == 1 and 18 < wet["age"] < 20  # the road, seen within 2 s


def test_keys_steer_and_take_over_from_the_driver(seen):
    assert seen["steered"]["angle"] > 0.01 and seen["steered"]["yaw"] > 0.01 and not seen["steered"]["auto"]


def test_a_peak_of_one_row_is_drawn_from_far(seen):
    """A plot of 200 000 rows on 300 pixels shows it."""
    assert seen["peak"] == 1


def test_it_zooms_by_keys(seen):
    assert seen["zoomed"] == pytest.approx(15.0)


def test_a_phone_needs_no_sideways_scrolling(seen):
    assert seen["overflow"] <= 0


def test_pictures_are_left_for_people_to_look_at(seen):
    light, dark, phone = (
        ("start", "example", "mapping", "broken", "against"),
        ("drive", "kept"),
        ("example", "drive"),
    )
    for name in (
        *(f"{x}-light" for x in light),
        *(f"{x}-dark" for x in dark),
        *(f"{x}-phone" for x in phone),
    ):
        assert (SHOTS / f"{name}.png").stat().st_size > 5000, name


def test_without_npm_the_page_is_built_and_says_what_it_lacks(tmp_path):
    try:
        page.find_compilers()
    except page.Failed as error:
        pytest.skip(str(error))
    said = page.build(tmp_path / "try.html", npm=False)
    assert "without Parquet" in said[0]
    assert '"parquet": false' in (tmp_path / "try.html").read_text()
