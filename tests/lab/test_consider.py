"""Parameter uncertainty (src/tables/uncertainty.toml) enters the sd of the stiffnesses.

A parameter that is off by its sd moves a stiffness by the amount that it adds to the sd.
"""

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from conftest import simulated
from tse.estimation.verdict import list_uncertain_parameters
from tse.library.core import NOMINAL, STIFFNESS, Config, NativeFilter

ROWS, DT = 6000, 0.01
LAST = slice(ROWS - 500, None)  # rows of which the mean is compared: a single one has its own noise
BASE = {"driven_axle": 1.0, "model_sd": 0.05}
WHEELS = ("wheel_speed_front", "wheel_speed_rear")
MIN_CHANGE = 0.002  # of a stiffness: smaller is not compared
ABSORBED = 0.006  # the same of what is a state, and found while driving


def drive(car: dict[str, float]) -> np.ndarray:
    """A minute of steering sweeps and torque steps at 20 m/s."""
    t = DT * np.arange(ROWS)
    steer, torque = (
        0.03 * np.sin(2 * np.pi * 0.35 * t + 3 * np.sin(0.25 * t)),
        1000 * np.tanh(6 * np.sin(1.3 * t)),
    )
    return simulated(car, {"seed": 3, "speed": 20.0}, DT, steer_angle=steer, wheel_torque_front=torque)


@pytest.fixture(scope="module")
def driven() -> np.ndarray:
    return drive({})


def make_log(
    driven: np.ndarray, columns: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] | None = None
) -> np.ndarray:
    """Return the log, with columns changed by functions of time and column."""
    rows = np.zeros(ROWS, NativeFilter(Config.exact()).inputs(1).dtype)
    t = DT * np.arange(ROWS)
    for name in rows.dtype.names:
        if name in driven.dtype.names:
            rows[name] = (columns or {}).get(name, lambda _, x: x)(t, driven[name])
    rows["dt"] = DT
    return rows


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def estimate_rows(rows: np.ndarray, **settings: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the estimates of all rows, and Filter.uncertainty_sd() at the end."""
    filter_ = NativeFilter(Config.exact(BASE | settings))
    out = filter_.outputs(len(rows))
    filter_.step_into(rows, out)
    return out, filter_.uncertainty_sd()


def delay_by(by: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    return lambda t, x: np.interp(t - by, t, x)


def multiply_by(by: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    return lambda _, x: by * x


def add_offset(by: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    return lambda _, x: x + by


CAR = Config.exact()
Run = Callable[[np.ndarray, float, dict[str, float]], tuple[np.ndarray, dict[str, np.ndarray]]]


def change_car(**settings: Callable[[float], float]) -> Run:
    """Return a run whose car differs from the settings."""
    return lambda y, by, more: estimate_rows(make_log(y), **{k: f(by) for k, f in settings.items()}, **more)


def change_sensors(change: Callable[[float], Callable], *columns: str) -> Run:
    """Return a run whose sensors differ from the settings."""
    return lambda y, by, more: estimate_rows(make_log(y, dict.fromkeys(columns, change(by))), **more)


# setting: size of the error, and the estimates with it. wheel_delay_sd shows less than
# MIN_CHANGE on this drive. lean_sd needs a bank.
OFF: dict[str, tuple[float, Run]] = {
    "mass_sd": (
        0.05,
        change_car(mass=lambda by: CAR.mass * (1 + by), yaw_inertia=lambda by: CAR.yaw_inertia * (1 + by)),
    ),
    "yaw_inertia_sd": (0.05, change_car(yaw_inertia=lambda by: CAR.yaw_inertia * (1 + by))),
    "cg_sd": (0.02, change_car(lf=lambda by: CAR.lf - by, lr=lambda by: CAR.lr + by)),
    "accel_y_scale_sd": (0.02, change_sensors(lambda by: multiply_by(1 + by), "accel_y")),
    "gyro_scale_sd": (0.01, change_sensors(lambda by: multiply_by(1 + by), "yaw_rate")),
    "accel_delay_sd": (0.001, change_sensors(delay_by, "accel_x", "accel_y")),
    "trail_sd": (0.02, change_car(aligning_moment_trail=lambda by: by)),
}
FOUND: dict[str, tuple[float, Run]] = {  # states
    "steer_ratio_sd": (0.01, change_sensors(lambda by: multiply_by(1 + by), "steer_angle")),
    "steer_offset_sd": (0.002, change_sensors(add_offset, "steer_angle")),
    "wheel_radius_sd": (0.005, change_sensors(lambda by: multiply_by(1 + by), "wheel_speed_rear")),
}


def measure_change(driven: np.ndarray, name: str, by: float, run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Return how a parameter that is off by its sd moves the stiffnesses, and their sd.

    The filter considers the parameter.
    """
    (above, parts), (below, _) = (run(driven, sign * by, {name: by}) for sign in (1, -1))
    moved = [abs(float(np.mean(above[s][LAST] - below[s][LAST]))) / 2 for s in STIFFNESS]
    return np.array(moved), parts[name]


@pytest.mark.parametrize("name", OFF)
def test_the_sd_is_what_the_estimates_move_by(driven: np.ndarray, name: str) -> None:
    """To 30 %, of what is not estimated: on the same noise."""
    moved, part = measure_change(driven, name, *OFF[name])
    compared = np.maximum(moved, part) > MIN_CHANGE
    assert compared.any()
    assert (part[compared] > 0.7 * moved[compared]).all() and (
        part[compared] < 1.3 * moved[compared]
    ).all(), (moved, part)


@pytest.mark.parametrize("name", FOUND)
def test_what_is_found_while_driving_moves_them_by_no_more_than_is_said(
    driven: np.ndarray, name: str
) -> None:
    moved, part = measure_change(driven, name, *FOUND[name])
    assert (moved < 1.3 * part + ABSORBED).all(), (moved, part)
    off, _ = FOUND[name][1](driven, FOUND[name][0], {})  # a filter that is told that it is exact does worse
    exact, _ = estimate_rows(make_log(driven))
    wrong = [abs(float(np.mean(off[s][LAST] - exact[s][LAST]))) for s in STIFFNESS]
    assert np.linalg.norm(moved) < np.linalg.norm(wrong)


def test_tyres_that_build_up_their_force_are_within_what_is_said(driven: np.ndarray) -> None:
    slow = drive({"relaxation_length": 0.2})
    assumed, parts = estimate_rows(make_log(slow), relaxation_sd=0.2)
    exact, _ = estimate_rows(make_log(driven))
    moved = np.array([abs(float(np.mean(assumed[s][LAST] - exact[s][LAST]))) for s in STIFFNESS])
    assert (moved < 1.96 * parts["relaxation_sd"] + MIN_CHANGE).all() and parts["relaxation_sd"][
        1
    ] > MIN_CHANGE


def drive_over_hills(grade: float, seconds: float = 120.0) -> tuple[np.ndarray, np.ndarray]:
    """Return rows of a car on slopes, and the slope of each row.

    The slope rises and falls by `grade` every 25 s. The car is driven on its front axle
    and braked on both. The motion is integrated in steps of 1 ms without the library.
    """
    fine, every, mass, stiffness, radius = (
        0.001,
        10,
        CAR.mass,
        CAR.longitudinal_stiffness_front,
        CAR.wheel_radius_front,
    )
    rng = np.random.default_rng(5)
    t = fine * np.arange(round(seconds / fine))
    wish = np.repeat(rng.uniform(-1.5, 1.5, round(seconds / 4)), round(4 / fine))
    wish = np.convolve(wish, np.full(600, 1 / 600), mode="same")  # a pedal takes 0.6 s
    slope, v = np.arctan(grade) * np.sin(2 * np.pi * t / 25 + 1), 12.0
    speed, force = np.empty(len(t)), np.empty(len(t))
    for i in range(len(t)):
        speed[i], force[i] = v, wish[i] - 0.1 * (v - 12.0)
        v += fine * (force[i] - 9.81 * np.sin(slope[i]))
    front = np.where(force > 0, 1.0, 0.65)
    rows = np.zeros(len(t) // every, NativeFilter(Config.exact()).inputs(1).dtype)
    for axle, share in (("front", front), ("rear", 1.0 - front)):
        slip = share * mass * force / stiffness
        turned = np.where(slip > 0, speed / (1 - slip), speed * (1 + slip)) / radius
        rows[f"wheel_speed_{axle}"] = turned[::every]
    rows["accel_x"] = force[::every] + 0.1 * rng.standard_normal(len(rows))
    rows["accel_y"], rows["yaw_rate"] = (
        0.15 * rng.standard_normal(len(rows)),
        0.003 * rng.standard_normal(len(rows)),
    )
    rows["dt"] = DT
    return rows, slope[::every]


@pytest.mark.parametrize("grade", [0.02, 0.05, 0.07])
def test_a_grade_is_found_and_costs_no_stiffness(grade: float) -> None:
    """5 % of the rows: what is asked."""
    rows, _ = drive_over_hills(grade)
    settings = {
        "accel_x_sd": 0.1,
        "longitudinal_stiffness_rear": CAR.longitudinal_stiffness_front,
        "driven_axle": 1.0,
        "grade_sd": 0.03,
    }
    filter_ = NativeFilter(Config.exact(settings))
    out = filter_.outputs(len(rows))
    filter_.step_into(rows, out)
    valid, off = out["cx_front_valid"][2000:] == 0, np.abs(out["cx_front"][2000:] - 1.0) > 0.1
    assert valid.mean() > 0.5 and off[valid].mean() < 0.05, (valid.mean(), off[valid].mean())
    assert (
        rms(out["vel_x"][2000:] - CAR.wheel_radius_rear * rows["wheel_speed_rear"][2000:]) < 0.1
    )  # the speed goes with no hill


def test_a_channel_that_comes_back_and_a_gap_leave_no_jump(driven: np.ndarray) -> None:
    """A delayed channel is corrected by the rate of its row.

    The rate is not that over the time since the channel or the rows were lost.
    """
    told = {"accel_delay_sd": 0.01, "relaxation_sd": 0.5, "wheel_delay_sd": 0.01}
    rows = make_log(driven)
    whole, _ = estimate_rows(rows, **told)
    rows["accel_y"][3000:3050] = np.nan
    rows["dt"][4000] = 0.5  # longer than max_gap
    holed, _ = estimate_rows(rows, **told)
    for key in ("cy_front_sd", "cy_rear_sd"):
        assert holed[key][3050] < 1.05 * whole[key][3050] and holed[key][4001] < 1.1 * whole[key][4001]


def test_the_parts_of_an_interval_add_up_to_it(driven: np.ndarray) -> None:
    told = {"mass_sd": 0.04, "cg_sd": 0.03, "trail_sd": 0.02}
    rows = make_log(driven)
    out, parts = estimate_rows(rows, **told)
    exact, _ = estimate_rows(rows)
    assert {name for name, sd in parts.items() if sd.any()} >= {*told, "model_sd"}
    for a, key in enumerate(STIFFNESS):
        together = sum(parts[name][a] ** 2 for name in told)
        added = out[f"{key}_sd"][-1] ** 2 - exact[f"{key}_sd"][-1] ** 2
        assert together == pytest.approx(added, rel=0.2), key
    table = pd.DataFrame({k: out[k] * getattr(CAR, NOMINAL[s]) for s in STIFFNESS for k in (s, f"{s}_sd")})
    alone = {name: sd for name, sd in parts.items() if name in told}
    words = list_uncertain_parameters(table, Config.exact(BASE | told), alone)
    assert [w.split(":")[0] for w in words][-2:] == ["front cornering stiffness", "rear cornering stiffness"]
    assert "is parameter uncertainty: " in words[-1] and "mass_sd 8 %" in words[-1]
    assert (
        list_uncertain_parameters(table, Config.exact(BASE), {name: 0 * sd for name, sd in parts.items()})
        == []
    )
    assert (
        list_uncertain_parameters(table[:0], Config.exact(BASE), parts)
        == []
        == list_uncertain_parameters(table, Config.exact(BASE), {})
    )


def test_a_row_after_next_to_no_time_says_no_more_than_any(driven: np.ndarray) -> None:
    """The difference of two frames within a microsecond is noise and gives no rate."""
    config = Config.exact({"model_sd": 0.03, "relaxation_sd": 0.3, "mass_sd": 0.02, "accel_y_scale_sd": 0.02})
    largest = []
    for dt in (DT, 1e-5, 1e-6):
        rows = make_log(driven)
        rows["dt"][2000:2002] = dt, 2 * DT - dt
        filter_ = NativeFilter(config)
        outputs = filter_.outputs(ROWS)
        filter_.step_into(rows, outputs)
        largest.append(outputs["cy_front_sd"][2000:].max())
    assert (
        max(largest[1:]) < 1.5 * largest[0]
    )  # 9.7 times as large when the difference was divided by that time
