"""What is told of the car and may be off (include/tse/told.def): the sd that it adds is the derivative of the estimates by it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from tselab.core import NOMINAL, Config, Filter, SimConfig, Simulator
from tselab.verdict import of_what_is_told

ROWS, DT = 6000, 0.01
LOOKED = slice(1500, None, 25)  # rows
BASE = {"steer_lag_sd": 0.0, "steady_walk": 0.001}  # the lag would find out some of it
WHEELS = ("wheel_speed_front", "wheel_speed_rear")
# smaller is not compared
LOOKED_AT = {"cx_front": 0.002, "cy_front": 0.0015, "cy_rear": 0.0015, "vel_y": 0.002, "bias_accel_x": 0.005}


def drive(car: dict[str, float]) -> np.ndarray:
    """A minute of steering sweeps and torque steps at 20 m/s."""
    simulator = Simulator(Config(car), SimConfig({"seed": 3, "speed": 20.0}))
    inputs, outputs = simulator.inputs(ROWS), simulator.outputs(ROWS)
    t = DT * np.arange(ROWS)
    inputs["dt"], inputs["road_level"] = DT, 1.0
    inputs["steer_angle"] = 0.03 * np.sin(2 * np.pi * 0.35 * t + 3 * np.sin(0.25 * t))
    inputs["wheel_torque_front"] = inputs["wheel_torque_rear"] = 500 * np.tanh(6 * np.sin(1.3 * t))
    for i in range(ROWS):
        simulator.step_into(inputs, outputs, i)
    return outputs


@pytest.fixture(scope="module")
def driven() -> np.ndarray:
    return drive({})


def logged(
    driven: np.ndarray, columns: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] | None = None
) -> np.ndarray:
    """The log, with columns changed by functions of time and column."""
    rows = np.zeros(ROWS, Filter(Config()).inputs(1).dtype)
    t = DT * np.arange(ROWS)
    for name in rows.dtype.names:
        if name in driven.dtype.names:
            rows[name] = (columns or {}).get(name, lambda _, x: x)(t, driven[name])
    rows["dt"] = DT
    return rows


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def estimated(rows: np.ndarray, truth: np.ndarray | None = None, **settings: float) -> np.ndarray:
    """Estimates of the rows LOOKED at; truth: vel_y less that of this drive."""
    filter_ = Filter(Config(BASE | settings))
    out = filter_.outputs(len(rows))
    filter_.step_into(rows, out)
    if truth is not None:
        out["vel_y"] -= truth["true_vel_y"]
    return out[LOOKED]


def driven_otherwise(y: np.ndarray, car: dict[str, float]) -> np.ndarray:
    """What is estimated when the car is another; vel_y as if it had moved as this one."""
    other = drive(car)
    found = estimated(logged(other), other)
    found["vel_y"] += y["true_vel_y"][LOOKED]
    return found


def late(by: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    return lambda t, x: np.interp(t - by, t, x)


def times(by: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    return lambda _, x: by * x


def plus(by: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    return lambda _, x: x + by


CAR = Config()
# setting: how far off, and what is estimated then. Of the car: told otherwise. Of the sensors: logged otherwise. Of road and
# tyres: driven otherwise.
OFF: dict[str, tuple[float, Callable[[np.ndarray, float], np.ndarray]]] = {
    "yaw_inertia_sd": (0.02, lambda y, by: estimated(logged(y), yaw_inertia=CAR.yaw_inertia * (1 + by))),
    "cg_sd": (0.02, lambda y, by: estimated(logged(y), lf=CAR.lf - by, lr=CAR.lr + by)),
    "steer_ratio_sd": (0.01, lambda y, by: estimated(logged(y, {"steer_angle": times(1 + by)}))),
    "steer_offset_sd": (0.001, lambda y, by: estimated(logged(y, {"steer_angle": plus(by)}))),
    "accel_y_scale_sd": (0.01, lambda y, by: estimated(logged(y, {"accel_y": times(1 + by)}))),
    "wheel_delay_sd": (0.0005, lambda y, by: estimated(logged(y, dict.fromkeys(WHEELS, late(by))))),
    "accel_delay_sd": (0.001, lambda y, by: estimated(logged(y, dict.fromkeys(("accel_x", "accel_y"), late(by))))),
    "wheel_radius_sd": (0.005, lambda y, by: estimated(logged(y, {"wheel_speed_rear": times(1 + by)}))),
    "relaxation_sd": (0.05, lambda y, by: driven_otherwise(y, {"relaxation_length": by})),
}
NEVER_BELOW_ZERO = ("relaxation_sd",)


def test_every_quantity_is_looked_at() -> None:
    names = [name for name in Config().fields if name.endswith("_sd")]
    told = names[names.index("yaw_inertia_sd") : names.index("wheel_radius_sd") + 1]
    assert sorted(OFF) == sorted(told)


@pytest.mark.parametrize("name", OFF)
def test_the_sd_is_what_the_estimates_move_by(driven: np.ndarray, name: str) -> None:
    """To 30 %, which is what is not linear of it; of the RMS over the rows, of runs on the same noise."""
    by, run = OFF[name]
    exact, considered = estimated(logged(driven)), estimated(logged(driven), **{name: by})
    above = run(driven, by)
    below = exact if name in NEVER_BELOW_ZERO else run(driven, -by)
    compared = 0
    for key, least in LOOKED_AT.items():
        assert np.array_equal(exact[key], considered[key])  # nothing is estimated otherwise
        moved = rms(above[key] - below[key]) / (1 if name in NEVER_BELOW_ZERO else 2)
        added = np.sqrt(np.mean(considered[f"{key}_sd"] ** 2 - exact[f"{key}_sd"] ** 2))
        if max(moved, added) > least:
            assert 0.7 * moved < added < 1.3 * moved, f"{key}: moves by {moved:.4f}, sd {added:.4f}"
            compared += 1
    assert compared


def over_hills(grade: float, seconds: float = 120.0) -> tuple[np.ndarray, np.ndarray]:
    """Rows of a car on slopes that rise and fall by `grade` every 25 s, driven on its front axle and braked on both, and the
    slope of each row; integrated in steps of 1 ms by nothing of the library."""
    fine, every, mass, stiffness, radius = 0.001, 10, CAR.mass, CAR.longitudinal_stiffness_front, CAR.wheel_radius_front
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
    rows = np.zeros(len(t) // every, Filter(Config()).inputs(1).dtype)
    for axle, share in (("front", front), ("rear", 1.0 - front)):
        slip = share * mass * force / stiffness
        turned = np.where(slip > 0, speed / (1 - slip), speed * (1 + slip)) / radius
        rows[f"wheel_speed_{axle}"] = turned[::every]
    rows["accel_x"] = force[::every] + 0.1 * rng.standard_normal(len(rows))
    rows["accel_y"], rows["yaw_rate"] = 0.15 * rng.standard_normal(len(rows)), 0.003 * rng.standard_normal(len(rows))
    rows["dt"] = DT
    return rows, slope[::every]


@pytest.mark.parametrize("grade", [0.02, 0.05, 0.07])
def test_a_grade_that_nobody_told_is_found_and_costs_no_stiffness(grade: float) -> None:
    """5 % of the rows: what is asked. The grade is found to a fifth: how far it goes in 1 s, as late as a walk follows."""
    rows, slope = over_hills(grade)
    settings = BASE | {"accel_x_sd": 0.1, "longitudinal_stiffness_rear": CAR.longitudinal_stiffness_front}
    found = {}
    for name, more in (("told nothing", {}), ("hills", {"grade_sd": 0.02})):
        filter_ = Filter(Config(settings | more))
        out = filter_.outputs(len(rows))
        filter_.step_into(rows, out)
        found[name] = out[2000:]
    out = found["hills"]
    valid, off = out["cx_front_valid"] == 0, np.abs(out["cx_front"] - 1.0) > 0.1
    assert valid.mean() > 0.5 and off[valid].mean() < 0.05, (
        f"valid {valid.mean():.2f}, of these off {off[valid].mean():.2f}"
    )
    assert rms(out["bias_accel_x"] - 9.81 * np.sin(slope[2000:])) < 0.2 * rms(9.81 * np.sin(slope))
    assert np.median(found["told nothing"]["cx_front"]) < 0.6  # hills that must not be are a car that slips


def test_a_channel_that_comes_back_and_a_gap_leave_no_jump(driven: np.ndarray) -> None:
    """What is late by a rate takes the rate of its row. With that since the last forecast, before channel or time were lost, the
    band of a stiffness grew by 2 % in one row, and that of vel_y to three times what it is in the whole log."""
    told = {"accel_delay_sd": 0.01, "relaxation_sd": 0.5, "wheel_delay_sd": 0.01}

    def bands(rows: np.ndarray) -> np.ndarray:
        filter_ = Filter(Config(BASE | told))
        out = filter_.outputs(ROWS)
        filter_.step_into(rows, out)
        return out

    rows = logged(driven)
    whole = bands(rows)
    rows["accel_y"][3000:3050] = np.nan
    rows["dt"][4000] = 0.5  # longer than max_gap
    holed = bands(rows)
    assert holed["cy_front_sd"][3050] < 1.01 * whole["cy_front_sd"][3050]
    assert holed["vel_y_sd"][4001] < 2 * whole["vel_y_sd"][4001]  # placed anew: 1.8 in the row before


def test_mass_is_in_all_stiffnesses(driven: np.ndarray) -> None:
    exact, considered = estimated(logged(driven)), estimated(logged(driven), mass_sd=0.1)
    heavier = estimated(logged(driven), mass=CAR.mass * 1.1, yaw_inertia=CAR.yaw_inertia * 1.1)
    for key in ("cx_front", "cy_front", "cy_rear"):
        added = np.sqrt(considered[f"{key}_sd"] ** 2 - exact[f"{key}_sd"] ** 2)
        assert np.abs(heavier[key] - exact[key]) == pytest.approx(added, rel=0.1)


def test_the_parts_of_a_band_are_told_and_add_up_to_it(driven: np.ndarray) -> None:
    rows, told = logged(driven), {"mass_sd": 0.04, "steer_ratio_sd": 0.03, "relaxation_sd": 0.2}
    filter_ = Filter(Config(BASE | told))
    out = filter_.outputs(ROWS)
    filter_.step_into(rows, out)
    parts, exact = filter_.told_sd(), estimated(rows)
    assert [name for name, sd in parts.items() if sd.any()] == list(told)
    for a, key in enumerate(("cx_front", "cy_front", "cy_rear")):
        together = np.sqrt(sum(sd[a] ** 2 for sd in parts.values()))
        added = np.sqrt(
            out[f"{key}_sd"][-1] ** 2 - exact[f"{key}_sd"][-1] ** 2
        )  # LOOKED at last: 24 rows before the end
        assert together == pytest.approx(added, rel=0.1)
    table = pd.DataFrame(
        {k: out[k] * getattr(CAR, NOMINAL[k.removesuffix("_sd")]) for s in NOMINAL for k in (s, f"{s}_sd")}
    )
    words = of_what_is_told(table, filter_.config, parts)
    assert len(words) == 3 and words[0].startswith("front longitudinal stiffness: of the band at the end, ± ")
    assert "mass_sd 8 %" in words[1] and "steer_ratio_sd" in words[1]
    assert of_what_is_told(table, filter_.config, {name: 0 * sd for name, sd in parts.items()}) == []
    assert of_what_is_told(table[:0], filter_.config, parts) == [] == of_what_is_told(table, filter_.config, {})


def test_a_row_after_next_to_no_time_says_no_more_than_any(driven: np.ndarray) -> None:
    """Two frames that are stamped within a microsecond: what differs between them is noise, and no rate of anything."""
    config = Config({"model_sd": 0.03, "relaxation_sd": 0.3, "mass_sd": 0.02, "accel_y_scale_sd": 0.02})
    largest = []
    for dt in (DT, 1e-5, 1e-6):
        rows = logged(driven)
        rows["dt"][2000:2002] = dt, 2 * DT - dt
        filter_ = Filter(config)
        outputs = filter_.outputs(ROWS)
        filter_.step_into(rows, outputs)
        largest.append(outputs["cy_front_sd"][2000:].max())
    assert max(largest[1:]) < 1.5 * largest[0]  # 9.7 times as large when the difference was divided by that time
