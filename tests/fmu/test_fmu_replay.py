"""A log gives the same bits in every output through the C library and through the FMU."""

import functools
import threading
from dataclasses import dataclass

import numpy as np
import pytest
from fmu_support import (
    CHANNELS,
    KNOWN,
    Instance,
    Log,
    Unit,
    compute_expected_outputs,
    expect_same_rows,
    load_unit,
    make_parameters,
    read_recorded_drive,
)

from tse.library.core import Config, SimConfig
from tse.simulation import maneuvers
from tse.simulation.simulate import drive, simulate


def simulate_drive(duration: float = 6.0, seed: int = 4, irregular: bool = False) -> Log:
    """Simulate square waves, some cells and rows lost; irregular: steps of 3 .. 30 ms."""
    random = np.random.default_rng(seed)
    config = Config.exact()
    maneuver = maneuvers.build(
        "square-waves", config, sample_time=0.001 if irregular else 0.01, duration=duration
    )
    _, outputs = drive(maneuver, config, SimConfig({"seed": seed}))
    keep = np.ones(len(maneuver.time), bool)
    if irregular:
        keep[:] = False
        rows = np.cumsum(random.integers(3, 31, len(keep) // 3))
        keep[rows[rows < len(keep)]] = True
    keep[keep.nonzero()[0][random.integers(5, keep.sum(), 12)]] = False  # lost rows
    first = len(keep) // 2
    keep[first : first + (300 if irregular else 30)] = False  # and a gap that is too long to bridge
    channels = np.stack([outputs[n] for n in CHANNELS], axis=1)[keep]
    channels[random.random(channels.shape) < 0.01] = np.nan
    return Log(maneuver.time[keep], channels)


def expect_same_replay(
    estimator: Unit, log: Log, settings: dict[str, float], form: str | None = None
) -> None:
    full = {**(Config.settings_of(form) if form else {}), **settings}
    expected = log.through_library(settings, form)
    with Instance(estimator) as instance:
        instance.start(make_parameters(full, estimator), time=float(log.time[0]))
        expect_same_rows(
            log.through_fmu(instance), (compute_expected_outputs(row, Config.exact(full)) for row in expected)
        )


def test_the_recorded_drive_with_default_settings(estimator: Unit) -> None:
    expect_same_replay(estimator, read_recorded_drive(), {})


SWEEP = [
    ({"seed": 2, "particles": 512}, None),
    ({"seed": 77, "particles": 16, "forgetting": 0.98}, None),
    ({"particles": 101, "forgetting": 0.999, "mass": 1500.0, "resampling": 2}, None),
    (
        {
            "max_slip": 1.0,
            "noise_max": 1.0,
            "driven_axle": 1,
            "model_sd": 0.05,
            "grip": 1.0,
            "grip_sd": 0.2,
            "relaxation_length": 0.4,
        },
        None,
    ),
    ({"particles": 150}, "robust"),
    ({"particles": 150, "seed": 9, "initial_cy_rear": 0.7}, "paper"),
]


@pytest.mark.parametrize(("settings", "form"), SWEEP, ids=lambda p: str(p) if isinstance(p, str) else "")
def test_a_drive_with_gaps_with_other_parameters(
    estimator: Unit, settings: dict[str, float], form: str | None
) -> None:
    expect_same_replay(estimator, simulate_drive(), settings, form)


def test_where_only_some_stiffnesses_show_not_all_are_called_valid(estimator: Unit) -> None:
    """A slalom at constant speed shows cornering stiffness only."""
    config = Config.exact({"particles": 100})
    maneuver = maneuvers.build("sine-sweep", config, sample_time=0.01, duration=8.0)
    _, outputs = drive(maneuver, config, SimConfig())
    log = Log(maneuver.time, np.stack([outputs[n] for n in CHANNELS], axis=1))
    with Instance(estimator) as instance:
        instance.start({**KNOWN, "filter.particles": 100})
        rows = log.through_fmu(instance)
    expect_same_rows(
        rows, (compute_expected_outputs(row, config) for row in log.through_library({"particles": 100}))
    )
    assert any(
        r["estimate.cy_rear_valid"] and not r["estimate.cx_front_valid"] and not r["estimate.valid"]
        for r in rows
    )


def test_irregular_rows_are_variable_communication_steps(estimator: Unit) -> None:
    log = simulate_drive(irregular=True)
    steps = np.diff(log.time)
    assert len(log) > 200 and steps.min() < 0.005 and steps.max() > 0.2 and len(set(np.round(steps, 6))) > 20
    expect_same_replay(estimator, log, {"particles": 100})


def test_a_log_that_starts_late_and_a_second_run_after_reset(estimator: Unit) -> None:
    log = simulate_drive(2.0)
    late = Log(log.time + 1e5, log.channels)
    expected = [
        compute_expected_outputs(row, Config.exact({"particles": 60}))
        for row in late.through_library({"particles": 60})
    ]
    with Instance(estimator) as instance:
        for _ in range(2):
            instance.start({**KNOWN, "filter.particles": 60}, time=float(late.time[0]))
            expect_same_rows(late.through_fmu(instance), expected)
            instance.slave.terminate()
            instance.slave.reset()


def test_instances_in_threads_do_what_each_does_alone(estimator: Unit) -> None:
    """FMPy lets go of Python's lock during a call."""
    logs = [simulate_drive(3.0, seed) for seed in (1, 2, 3)]
    got: dict[int, list] = {}

    def work(k: int) -> None:
        with Instance(estimator, f"thread {k}") as instance:
            instance.start({**KNOWN, "filter.particles": 200})
            got[k] = logs[k].through_fmu(instance)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(3)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    for k, log in enumerate(logs):
        rows = log.through_library({"particles": 200})
        expect_same_rows(
            got[k], (compute_expected_outputs(row, Config.exact({"particles": 200})) for row in rows)
        )


# ---- The paper's study (Sec. IV-A) with the two FMUs in a loop, against the same study
# through the library.


SEEDS = (1, 2, 3)
DURATION, WINDOW, STEP = 40.0, 20.0, 0.01  # s
STIFFNESS = ("cx_front", "cy_front", "cy_rear")
START = {f"initial_{s}": 0.7 for s in STIFFNESS}


def make_square_wave(time: float, period: float) -> float:
    return 1.0 if (time / period + 1e-9) % 1.0 < 0.5 else -1.0


@dataclass
class Study:
    """Inputs and outputs of the estimator row by row, and scores per stiffness.

    The scores: mean error [%], mean square error [%^2], share of the time called valid
    [%].
    """

    log: Log
    rows: list[dict[str, float]]
    result: dict[str, tuple[float, float, float]]


@functools.cache
def run_study(seed: int, ramp: bool = True) -> Study:
    """Run both."""
    vehicle, estimator = load_unit("SingleTrackVehicle"), load_unit("TireStiffnessEstimator")
    n = round(DURATION / STEP) + 1
    errors, valid, channels, rows = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, len(CHANNELS))), []

    def driver(k: int) -> dict[str, float]:
        return {
            "steer_angle": 0.02 * make_square_wave(k * STEP, 4.0),
            "wheel_torque_front": 700.0 * make_square_wave(k * STEP, 5.0),
        }

    with Instance(vehicle, "vehicle") as car, Instance(estimator, "estimator") as filter_:
        car.start({"simulation.seed": seed, "ramp": ramp}, driver(0))
        filter_.start(make_parameters({"seed": seed, **START}, estimator))
        for k in range(n):
            row = car.get([f"sensor.{c}" for c in CHANNELS] + [f"true.{s}" for s in STIFFNESS])
            channels[k] = [row[f"sensor.{c}"] for c in CHANNELS]
            filter_.set({c: row[f"sensor.{c}"] for c in CHANNELS})
            filter_.step(k * STEP, STEP)
            rows.append(filter_.get())
            for a, s in enumerate(STIFFNESS):
                errors[k, a] = 100 * (rows[-1][f"estimate.{s}"] / row[f"true.{s}"] - 1)
                valid[k, a] = rows[-1][f"estimate.{s}_valid"]
            # ramp: the driver's inputs at the end of the step; held: those at its start
            car.set(driver(k + 1 if ramp else k))
            car.step(k * STEP, STEP)
    late = np.arange(n) * STEP >= WINDOW
    result = {
        s: (errors[late, a].mean(), np.mean(errors[late, a] ** 2), 100 * valid[late, a].mean())
        for a, s in enumerate(STIFFNESS)
    }
    return Study(Log(np.arange(n) * STEP, channels), rows, result)


@pytest.mark.parametrize("seed", SEEDS)
def test_each_run_is_the_run_of_the_library(seed: int) -> None:
    """The vehicle drives as the simulator does, but for the last bit of the time steps.

    From its log the estimator computes what the library computes.
    """
    run, settings = run_study(seed), {"seed": seed, **START}
    config = Config.exact(settings)
    maneuver = maneuvers.build("square-waves", config, sample_time=STEP, duration=DURATION)
    log = simulate(maneuver, config, SimConfig({"seed": seed})).log
    assert np.abs(log[CHANNELS].to_numpy(float) - run.log.channels).max() < 1e-9
    expect_same_rows(
        run.rows, (compute_expected_outputs(row, config) for row in run.log.through_library(settings))
    )


def test_estimates_leave_the_start_for_the_truth() -> None:
    """They start 30 % too low."""
    for s in STIFFNESS:
        mean, square_, valid = np.array([run_study(seed).result[s] for seed in SEEDS]).T
        print(
            f"{s}: mean error {mean.mean():+.2f} %, RMS {np.sqrt(square_).mean():.2f} %, "
            f"valid {valid.mean():.0f} %"
        )
        assert np.sqrt(square_).max() < 15 and valid.min() > 50, s


def test_held_inputs_cost_the_stiffness_little() -> None:
    """Held inputs lead the logged rows by half a row (src/host/simulate.c, between()).

    The estimator can only interpolate. Hence `ramp` is true by default.
    """
    for s in STIFFNESS:
        cost = np.array(
            [run_study(seed, ramp=False).result[s][0] - run_study(seed).result[s][0] for seed in SEEDS]
        )
        print(
            f"{s}: ramp=false moves the mean error by {cost.mean():+.2f} % "
            f"({cost.min():+.2f} .. {cost.max():+.2f})"
        )
        assert 0 < np.abs(cost).max() < 5, s


def test_a_first_row_of_zeros_is_forgotten() -> None:
    """Importers that connect outputs one step late hand on a first row of zeros.

    Soon the estimates are close to those without it (fmu/connect.html).
    """
    run, estimator = run_study(1), load_unit("TireStiffnessEstimator")
    channels = run.log.channels[:2000].copy()
    channels[0] = 0.0
    with Instance(estimator) as instance:
        instance.start(make_parameters({"seed": 1, **START}, estimator))
        rows = Log(run.log.time[:2000], channels).through_fmu(instance)
    for k in (499, 999, 1999):
        for s in STIFFNESS:
            off = rows[k][f"estimate.{s}"] - run.rows[k][f"estimate.{s}"]
            assert abs(off) < 1.96 * run.rows[k][f"estimate.{s}_sd"], (k, s)


def test_an_fmu_that_is_told_no_mass_finds_nothing_valid(estimator: Unit) -> None:
    log = simulate_drive()
    with Instance(estimator) as instance:
        instance.start(time=float(log.time[0]))
        rows = log.through_fmu(instance)
    reasons = {row[f"estimate.{s}_reason"] for row in rows for s in ("cx_front", "cy_front", "cy_rear")}
    assert 0 not in reasons and 7 in reasons  # the parameters of the car are too uncertain
    assert not any(row["estimate.valid"] for row in rows)
