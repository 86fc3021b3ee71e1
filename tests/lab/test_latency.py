"""Channels with known latencies cost nothing if the filter has the latencies.

The output of `tselab estimate` names them.
"""

import numpy as np
import pandas as pd
import pytest

from conftest import RAN, simulated, tselab_here
from tse.car.vehicle import list_latency_settings, read_vehicle
from tse.estimation import regimes
from tse.library.core import STIFFNESS, Config, NativeFilter, SettingError, library
from tse.library.errors import UserError
from tse.report import plots
from tse.report.report import read_figures

ROWS, DT = 6000, 0.01
LAST = slice(-1500, None)
WHEELS = ("wheel_speed_front", "wheel_speed_rear")
# Share of the stiffness, with an sd of 0.02. The row of 10 ms in one substep makes 0.01.
# With two substeps it is 0.02 at most.
INTEGRATED = 0.035
STRICT = {"steer_lag_sd": 0.0, "driven_axle": 1.0}  # the filter finds no latency by itself


@pytest.fixture(scope="module")
def driven() -> np.ndarray:
    """Simulate rows at 1 ms without latencies.

    Steering sweeps to 1.5 Hz, and torque steps are smoothed over 0.1 s.
    """
    n = 10
    t = DT / n * np.arange(ROWS * n)
    steer, torque = (
        0.03 * np.sin(2 * np.pi * 0.9 * t + 8 * np.sin(0.25 * t)),
        1000 * np.tanh(6 * np.sin(1.3 * t)),
    )
    sim = {"seed": 3, "speed": 20.0, "noise": 0.0}
    return simulated({"sample_time": DT / n}, sim, DT / n, steer_angle=steer, wheel_torque_front=torque)


def make_log(driven: np.ndarray, late: dict[str, float], seed: int = 1) -> np.ndarray:
    """Return a noisy log every 10 ms whose columns are late by these seconds."""
    config, random = Config.exact(), np.random.default_rng(seed)
    rows = np.zeros(ROWS, NativeFilter(config).inputs(1).dtype)
    fine, t = DT / 10 * np.arange(len(driven)), DT * np.arange(ROWS)
    for channel in library().channels:
        name = channel.name
        rows[name] = np.interp(t - late.get(name, 0.0), fine, driven[name])
        if f"{name}_sd" in config:
            rows[name] += random.normal(0, getattr(config, f"{name}_sd"), ROWS)
    rows["dt"] = DT
    return rows


def estimate_rows(rows: np.ndarray, late: dict[str, float], **settings: float) -> np.ndarray:
    filter_ = NativeFilter(
        Config.exact(STRICT | settings | {f"{name}_latency": by for name, by in late.items()})
    )
    out = filter_.outputs(len(rows))
    filter_.step_into(rows, out)
    return out


def draw_latencies(seed: int) -> dict[str, float]:
    """Draw a latency of each channel; the wheels, of one controller, share theirs."""
    random = np.random.default_rng(seed)
    steer, wheels, x, y = random.uniform(0.0, 0.06, 4)
    return {"steer_angle": steer, **dict.fromkeys(WHEELS, wheels), "accel_x": x, "accel_y": y}


def normalise_errors(row: np.void) -> list[float]:
    """Return the stiffness errors in sd; the simulated tyres are the nominal ones."""
    return [float((row[key] - 1) / row[f"{key}_sd"]) for key in STIFFNESS]


@pytest.mark.parametrize("seed", range(6))
def test_told_latencies_cost_nothing(driven: np.ndarray, seed: int) -> None:
    """The error is within 4 sd, as without latencies, and the estimate is valid.

    The sd is at most 1.3 times that without latencies.
    """
    late = draw_latencies(seed)
    plain, told = (
        estimate_rows(make_log(driven, {}, seed), {}),
        estimate_rows(make_log(driven, late, seed), late),
    )
    assert max(map(abs, normalise_errors(plain[-1]))) < 4 and max(map(abs, normalise_errors(told[-1]))) < 4
    for key in STIFFNESS:
        assert told[-1][key] == pytest.approx(plain[-1][key], abs=0.01)
        assert told[-1][key] == pytest.approx(1.0, abs=0.08 if key == "cx_front" else INTEGRATED)
        assert told[-1][f"{key}_valid"] == plain[-1][f"{key}_valid"] == 0
        assert np.median(told[f"{key}_sd"][LAST]) < 1.3 * np.median(plain[f"{key}_sd"][LAST])
    age = told[-1]["estimate_age"]  # whole rows more than accel_x is late
    rows = (age - late["accel_x"]) / DT
    assert -1e-9 < age - max(late.values()) < DT and rows == pytest.approx(round(rows))
    for channel in (
        "accel_x",
        "accel_y",
        "yaw_rate",
    ):  # interpolation makes rows quieter and like the ones before
        assert 0.5 < told[-1][f"noise_{channel}"] < 1.25
        assert told[-1][f"discrepancy_{channel}"] == 0


def test_untold_they_are_read_as_another_stiffness(driven: np.ndarray) -> None:
    """This shows that the test above depends on the given latencies.

    One of six drives is exempt: its latencies happen to be alike.
    """
    worst = [
        max(
            abs(estimate_rows(make_log(driven, draw_latencies(seed), seed), {})[-1][key] - 1)
            for key in STIFFNESS
        )
        for seed in range(6)
    ]
    assert sorted(worst)[1] > 0.05, worst


def test_channels_that_are_early_are_as_good(driven: np.ndarray) -> None:
    late = {name: -by for name, by in draw_latencies(7).items()}
    last = estimate_rows(make_log(driven, late), late)[-1]
    assert last["estimate_age"] < DT and max(map(abs, normalise_errors(last))) < 4
    assert all(
        last[key] == pytest.approx(1.0, abs=0.08 if key == "cx_front" else INTEGRATED) for key in STIFFNESS
    )


# ---- tselab estimate

CAR = """mass = 1900.0
yaw_inertia = 3000.0
lf = 1.25
lr = 1.5
wheel_radius_front = 0.33
wheel_radius_rear = 0.33
cornering_stiffness_front = 1.2e5
cornering_stiffness_rear = 1.4e5
longitudinal_stiffness_front = 1.6e5
longitudinal_stiffness_rear = 1.6e5
[sensors]
accel_x_sd = 0.15
accel_y_sd = 0.15
yaw_rate_sd = 0.0035
wheel_noise_sd = 0.0
[latency]
steer_angle = 0.034
accel_y = -0.011
"""
EXACT = "[uncertainty]\n" + "".join(f"{name} = 0\n" for name in library().uncertainties)
LATE = {"steer_angle": 0.034, "accel_y": -0.011}


@pytest.fixture(scope="module")
def run(driven: np.ndarray, tmp_path_factory: pytest.TempPathFactory) -> tuple:
    folder = tmp_path_factory.mktemp("latency")
    rows = make_log(driven, LATE)
    table = pd.DataFrame({"time": DT * np.arange(ROWS)} | {c.name: rows[c.name] for c in library().channels})
    table["ref_vel_y"] = driven["true_vel_y"][::10]
    table.to_csv(folder / "log.csv", index=False)
    (folder / "car.toml").write_text(CAR + EXACT)
    done = tselab_here(
        "estimate",
        "--verbose",
        folder / "log.csv",
        "--vehicle",
        folder / "car.toml",
        "--report",
        folder / "r.html",
        cwd=folder,
    )
    assert done.code in RAN, done.err
    return done, pd.read_csv(folder / "log.est.csv"), table, (folder / "r.html").read_text(encoding="utf-8")


def test_the_run_and_the_report_say_how_old_the_estimates_are(run: tuple) -> None:
    done, est, table, page = run
    words = "steer_angle 34 ms, accel_y -11 ms behind yaw_rate; estimates refer to 40 ms before their row"
    assert words in done.out and words in page
    assert np.array_equal(est["time"], table["time"])
    waiting = est["status"] == library().status("TSE_W_WAITING")
    assert waiting.sum() == 6 and waiting[:6].all()  # from -11 to 40 ms: 5.1 rows
    assert est["estimate_age"].to_numpy() == pytest.approx(0.04)


def test_reference_and_estimate_are_drawn_at_the_times_that_they_are_of(run: tuple) -> None:
    """vel_y agrees with the reference at the plot's time better than at the row's."""
    _, est, table, page = run
    traces = {
        t["name"]: t
        for figure in read_figures(page)
        for t in figure["data"]
        if t["name"] in ("ref_vel_y", "estimate")
    }
    assert np.asarray(traces["ref_vel_y"]["x"]) == pytest.approx(table["time"].to_numpy())
    spoken = regimes.estimate_times(est)
    assert spoken == pytest.approx(table["time"].to_numpy() - 0.04, abs=1e-6)
    for figure in read_figures(page):
        for trace in figure["data"]:
            if trace["name"] == "estimate":
                assert np.asarray(trace["x"]) == pytest.approx(spoken, abs=1e-6)
    late = slice(2000, None)
    true = np.interp(spoken[late], table["time"], table["ref_vel_y"])
    at_its_time = np.sqrt(np.mean((est["vel_y"][late] - true) ** 2))
    at_its_row = np.sqrt(np.mean((est["vel_y"][late] - table["ref_vel_y"][late]) ** 2))
    assert at_its_time < 0.5 * at_its_row


def test_where_nothing_is_late_nothing_is_drawn_otherwise(driven: np.ndarray) -> None:
    table = pd.DataFrame({"time": [0.0, 0.01], "estimate_age": [0.0, np.nan]})  # NaN: a row that was refused
    assert np.array_equal(regimes.estimate_times(table), table["time"])
    assert np.array_equal(regimes.estimate_times(table[["time"]]), table["time"])
    assert "estimate_age" in plots.OPTIONAL


def test_keys_of_the_vehicle_file_are_the_channels(tmp_path) -> None:
    path = tmp_path / "car.toml"
    path.write_text(CAR)
    car = read_vehicle(path)
    assert car.values["steer_angle_latency"] == 0.034 and car.values["accel_y_latency"] == -0.011
    path.write_text(CAR + "yaw_rate = 0.01\n")
    with pytest.raises(UserError, match=r"latency.yaw_rate is not known: it is the reference"):
        read_vehicle(path)
    assert list(list_latency_settings()) == [c.name for c in library().channels if c.name != "yaw_rate"]
    path.write_text(CAR.replace("0.034", "0.5"))
    with pytest.raises(UserError, match=r"latency.steer_angle.*-0\.2 \.\. 0\.2"):
        read_vehicle(path)
    path.write_text("latency = 0.1\n" + CAR.split("[latency]")[0])
    with pytest.raises(UserError, match="must be a table"):
        read_vehicle(path)


def test_latencies_that_the_filter_cannot_keep_are_refused_with_their_name() -> None:
    with pytest.raises(SettingError, match=r"wheel_speed_rear_latency = 0\.2 is refused"):
        NativeFilter(Config.exact({"sample_time": 0.005, "wheel_speed_rear_latency": 0.2}))
