"""A disturbance that enters at a known place is located there.

The residuals are made by scipy's matrix exponential of a separate linear single-track
model, not by the filter that looks for them.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lfilter

from gap_logs import STIFFNESS, make_groups, make_prepared, make_problem, write_car, write_log
from tse.gaps.fit import Fit, fit_parameters
from tse.gaps.infer import remainder, where
from tse.gaps.infer.remainder import is_noise, remove_spikes, remove_walk
from tse.gaps.problem import STIFFNESS_PARAMETERS as PARAMETERS
from tse.gaps.problem import Problem
from tse.identify.data import BLOCK_TIME, simulate
from tse.library.core import Config

STEP = 0.04  # s, a block


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """Two logs of the car as the vehicle file says, and their fit_parameters."""
    folder = tmp_path_factory.mktemp("where")
    vehicle = write_car(folder)
    paths = [
        write_log(folder / f"{d}.csv", vehicle, d, {}, seed) for seed, d in enumerate(("sweep", "steps"), 31)
    ]
    problem = make_problem(vehicle, *paths)
    return problem, fit_parameters(problem, PARAMETERS, {})


def draw_drift(n: int, tau: float, rng: np.random.Generator) -> np.ndarray:
    """Draw an Ornstein-Uhlenbeck process of unit variance."""
    x, keep = np.zeros(n), np.exp(-STEP / tau)
    for k in range(1, n):
        x[k] = keep * x[k - 1] + np.sqrt(1 - keep**2) * rng.standard_normal()
    return x


def compute_response(
    config: Config, speed: float, place: str, d: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the change of lateral acceleration and yaw rate by a disturbance.

    The disturbance is in N, N m, m/s2 or rad/s. The stiffness is that of the logs.
    """
    if place == "sensor accel_y":
        return d, np.zeros_like(d)
    if place == "sensor yaw_rate":
        return np.zeros_like(d), d
    m, inertia = config.mass, config.yaw_inertia
    cf = config.cornering_stiffness_front * STIFFNESS["cy_front"]
    cr = config.cornering_stiffness_rear * STIFFNESS["cy_rear"]
    a, b = config.lf, config.lr
    matrix = np.array([
        [-(cf + cr) / (m * speed), -(a * cf - b * cr) / (m * speed) - speed],
        [-(a * cf - b * cr) / (inertia * speed), -(a**2 * cf + b**2 * cr) / (inertia * speed)],
    ])  # fmt: skip
    push = {
        "front axle": (1 / m, a / inertia), "rear axle": (1 / m, -b / inertia), "side force": (1 / m, 0.0),
        "yaw moment": (0.0, 1 / inertia), "road (bank)": (1.0, 0.0),
    }[place]  # fmt: skip
    whole = np.zeros((3, 3))
    whole[:2, :2], whole[:2, 2] = matrix, push
    f = expm(whole * STEP)
    x, ay, r = np.zeros(2), [], []
    for value in d:
        force = (
            value / m if place in ("front axle", "rear axle", "side force") else 0.0
        )  # an accelerometer feels no gravity
        ay.append(matrix[0] @ x + speed * x[1] + force)
        r.append(x[1])
        x = f[:2, :2] @ x + f[:2, 2] * value
    return np.array(ay), np.array(r)


def make_disturbed(clean, place: str, size: float, make) -> list[where.Entry]:
    """Return entries for residuals of noise, a wrong stiffness and a disturbance."""
    problem, baseline = clean
    rng = np.random.default_rng(7)
    residuals = rng.standard_normal(len(baseline.residuals)) + baseline.jacobian @ [0.02, -0.03, 0.02]
    speed = problem.average_quantity("wheel_speed_front") * problem.config.wheel_radius_front
    for i in range(len(problem.logs)):
        ay_rows = (problem.rows.log == i) & problem.rows.of("accel_y")
        r_rows = (problem.rows.log == i) & problem.rows.of("yaw_rate")
        ay, r = compute_response(
            problem.config, float(speed[ay_rows].mean()), place, size * make(i, int(ay_rows.sum()), rng)
        )
        residuals[ay_rows] += problem.weight[ay_rows] * ay
        residuals[r_rows] += problem.weight[r_rows] * r
    return where.find_entries(problem, replace(baseline, residuals=residuals))


@pytest.mark.parametrize(("place", "size"), [
    ("front axle", 300.0), ("rear axle", 300.0), ("side force", 400.0), ("yaw moment", 600.0),
    ("road (bank)", 0.3), ("sensor accel_y", 0.2), ("sensor yaw_rate", 0.01),
])  # fmt: skip
def test_disturbance_is_found_where_it_enters(clean, place, size):
    found = make_disturbed(clean, place, size, lambda i, n, rng: draw_drift(n, 0.6, rng))
    assert found[0].place == place
    assert found[0].nats > found[1].nats + 8  # as a name needs it
    c = clean[0].config
    unit = {
        "front axle": STIFFNESS["cy_front"] * c.cornering_stiffness_front,
        "rear axle": STIFFNESS["cy_rear"] * c.cornering_stiffness_rear,
        "side force": c.mass,
        "yaw moment": c.yaw_inertia,
    }.get(place, 1.0)  # of a formula's places
    assert size / 3 < found[0].size * unit < size * 3


def test_what_follows_the_steering_is_not_the_road(clean):
    """With a rolling body the accelerometer leans with the car's own turning.

    A bank of the road does not.
    """
    problem, baseline = clean
    turning = problem.simulate_channels(baseline.values, ("accel_y",))["accel_y"]

    def roll(i, n, rng):
        ay = turning[(problem.rows.log == i) & problem.rows.of("accel_y")]
        return np.convolve(ay, np.exp(-np.arange(20) * STEP / 0.1) * (1 - np.exp(-STEP / 0.1)))[:n]

    found = make_disturbed(clean, "sensor accel_y", 0.1, roll)
    assert found[0].place == "sensor accel_y" and found[-1].place == "road (bank)"


def test_nothing_gives_no_entry_evidence(clean):
    problem, baseline = clean
    assert max(e.nats for e in where.find_entries(problem, baseline)) < 8


def test_a_disturbance_is_located_only_where_both_lateral_sensors_are():
    p = Problem([make_prepared(measured={"accel_x": 0.0, "yaw_rate": 0.0})], Config.exact())
    assert where.find_entries(p, Fit([], {}, np.zeros(100), np.zeros((100, 0)))) == []


def test_the_evidence_of_a_place_is_that_of_normal_residuals(monkeypatch):
    """One log of 50 blocks; all places but one have a response of chance.

    The front axle explains, beside what the stiffness does. A bank that follows accel_y
    is the last, whatever its evidence.
    """
    rng = np.random.default_rng(9)
    p = Problem([make_prepared(measured={"accel_y": 0.0, "yaw_rate": 0.0})], Config.exact())
    response = {place: rng.standard_normal((100, 7)) for place in where.PLACES.values()}
    jacobian = rng.standard_normal((100, 2))
    weights = rng.standard_normal(7)
    e = -2.0 * response["front_angle"] @ weights + jacobian @ [3.0, -2.0] + rng.standard_normal(100)
    shape = np.maximum(0.0, 1.0 - np.abs(np.arange(50)[:, None] / 10 - np.arange(7))) @ weights
    at = [{"dt": np.full(50, 0.04), "accel_y": rng.standard_normal(50)}]
    asked = []

    def respond(problem, values, signals, place, hats):
        asked.append(hats[0])
        return response[place]

    monkeypatch.setattr(where, "compute_signals", lambda *_: at)
    monkeypatch.setattr(where, "compute_responses", respond)
    found = {x.place: x for x in where.find_entries(p, Fit([], {}, e, jacobian))}
    hats = asked[0]
    assert hats.shape == (50, 7) and hats[[0, 10, 5], [0, 1, 0]] == pytest.approx([1.0, 1.0, 0.5])
    assert next(iter(found)) == "front axle" and found["front axle"].unit == "rad"
    assert found["road (bank)"].unit == "m/s2" and found["yaw moment"].unit == "rad/s2"
    rest = np.eye(100) - jacobian @ np.linalg.pinv(jacobian)
    for name, place in where.PLACES.items():
        a, r = rest @ response[place], rest @ e
        unit = np.sqrt(100 / np.sum(a**2))
        sizes = unit * 2.0 ** np.arange(-3, 6)
        variance = [np.eye(100) + s**2 * a @ a.T for s in sizes]
        nats = [0.5 * (r @ r - r @ np.linalg.solve(c, r) - np.linalg.slogdet(c)[1]) for c in variance]
        assert found[name].nats == pytest.approx(max(nats), rel=1e-6, abs=1e-6)
        s = sizes[int(np.argmax(nats))]
        assert found[name].size == pytest.approx(s)
        taken = r @ a @ np.linalg.solve(a.T @ a + np.eye(7) / s**2, a.T @ r)
        assert found[name].share == pytest.approx(taken / (r @ r), rel=1e-6)
    assert [x.nats for x in found.values()] == sorted((x.nats for x in found.values()), reverse=True)
    response["bank"] = response["front_angle"] * 1.0
    at[0]["accel_y"] = shape
    places = [x.place for x in where.find_entries(p, Fit([], {}, e, jacobian))]
    assert places[0] == "front axle" and places[-1] == "road (bank)"
    at[0]["accel_y"] = np.cos(np.arange(50.0))
    places = [x.place for x in where.find_entries(p, Fit([], {}, e, jacobian))]
    assert places[:2] == ["front axle", "road (bank)"]


def test_the_evidence_of_logs_is_summed_and_each_is_seen_beside_its_own_fit(monkeypatch):
    """The second log has accel_x as well, which shows no lateral disturbance."""
    rng = np.random.default_rng(11)
    lateral = {"accel_y": 0.0, "yaw_rate": 0.0}
    logs = [make_prepared("a", measured=lateral), make_prepared("b", measured=lateral | {"accel_x": 0.0})]
    p = Problem(logs, Config.exact())
    response, jacobian = rng.standard_normal((250, 7)), rng.standard_normal((250, 2))
    e = response @ rng.standard_normal(7) + rng.standard_normal(250)
    at = [{"dt": np.full(50, 0.04), "accel_y": rng.standard_normal(50)}] * 2
    monkeypatch.setattr(where, "compute_signals", lambda *_: at)
    monkeypatch.setattr(where, "compute_responses", lambda *_: response)
    monkeypatch.setattr(where, "PLACES", {"yaw moment": "yaw_moment"})
    (found,) = where.find_entries(p, Fit([], {}, e, jacobian))
    parts = []
    for i in (0, 1):
        rows = (p.rows.log == i) & ~p.rows.of("accel_x")
        rest = np.eye(100) - jacobian[rows] @ np.linalg.pinv(jacobian[rows])
        parts.append((rest @ response[rows], rest @ e[rows]))
    unit = np.sqrt(200 / sum(np.sum(a**2) for a, _ in parts))
    nats = []
    for s in unit * 2.0 ** np.arange(-3, 6):
        nats.append(0.0)
        for a, r in parts:
            c = np.eye(100) + s**2 * a @ a.T
            nats[-1] += 0.5 * (r @ r - r @ np.linalg.solve(c, r) - np.linalg.slogdet(c)[1])
    assert found.nats == pytest.approx(max(nats), rel=1e-6)
    assert found.size == pytest.approx(unit * 2.0 ** (int(np.argmax(nats)) - 3))
    s = found.size
    taken = sum(r @ a @ np.linalg.solve(a.T @ a + np.eye(7) / s**2, a.T @ r) for a, r in parts)
    assert found.share == pytest.approx(taken / sum(r @ r for _, r in parts), rel=1e-6)


# ---- conditions


def test_features_are_magnitudes_of_inputs_and_of_the_simulation():
    """The car brakes by 2 m/s2 and turns its wheels to the right by 0.02 rad/s."""
    time = 0.01 * np.arange(300)
    log = make_prepared(steer=-0.02 * time)
    for axle in ("front", "rear"):
        log.inputs[f"wheel_speed_{axle}"] = (20.0 - 2.0 * time) / 0.33
    p = Problem([log], Config.exact())
    found = where.compute_features(p, {"cy_front": 0.9})
    channels = ("accel_x", "accel_y", "vel_x")
    out = simulate(p.make_config({}), log, channels, {"cy_front": 0.9}, {})
    x = {c: v[220:224].mean() for c, v in out.items()}  # block 30 of each channel
    assert x["accel_y"] < -0.1 and x["accel_x"] == pytest.approx(-2.0, abs=0.1)
    at = [30, 80, 130]
    expected = {
        "speed": x["vel_x"],
        "|accel_y|": -x["accel_y"],
        "|accel_x|": -x["accel_x"],
        "|steering angle|": 0.02 * 2.215,
        "|steering rate|": 0.02,
        "|slip|": abs((20.0 - 2.0 * 2.215) / x["vel_x"] - 1.0),
        "time": 2.215,
    }
    assert found.keys() == expected.keys() and expected["|slip|"] > 0.001
    for name, value in expected.items():
        np.testing.assert_allclose(found[name][at], value, rtol=1e-6, err_msg=name)


def make_windows(monkeypatch, rows_apart: float, **features: np.ndarray) -> SimpleNamespace:
    """Return a problem of accel_y and yaw_rate with these features of its blocks."""
    n = len(next(iter(features.values())))
    problem, _ = make_groups(("accel_y", np.zeros(n)), ("yaw_rate", np.zeros(n)))
    time = np.tile(rows_apart * np.arange(n), 2)
    problem.rows = replace(problem.rows, log=np.zeros(2 * n, int), time=time)
    both = {name: np.tile(x, 2) for name, x in features.items()}
    monkeypatch.setattr(where, "compute_features", lambda *_: both)
    return problem


def test_residuals_that_grow_with_a_signal_are_large_where_it_is_high(monkeypatch):
    """Those of accel_y grow with the speed, those of yaw_rate fall, less clearly."""
    speed = np.linspace(5.0, 30.0, 1500)
    p = make_windows(monkeypatch, 0.04, speed=speed, still=np.ones(1500))
    rng = np.random.default_rng(3)
    e = np.concatenate([speed * np.tile([1.0, -1.0], 750), (40.0 - speed) * rng.standard_normal(1500)])
    first, second = where.find_conditions(p, e, {})
    assert (first.channel, first.condition) == ("accel_y", "high speed")
    assert first.strength == pytest.approx(1.0)
    assert (second.channel, second.condition) == ("yaw_rate", "low speed")
    assert -1.0 < second.strength < -0.7
    assert where.find_conditions(p, -e, {}) == [first, second]  # of either sign
    falling = where.find_conditions(p, np.concatenate([e[1500:], e[:1500][::-1]]), {})
    found = [(c.channel, c.condition) for c in falling]
    assert found == [("yaw_rate", "low speed"), ("accel_y", "low speed")]
    rising = where.find_conditions(p, np.concatenate([e[:1500][::-1], e[1500:][::-1]]), {})
    assert [c.strength > 0 for c in rising] == [False, True]  # by magnitude


def test_windows_are_those_of_each_log(monkeypatch):
    """In the second log the speed falls: at the same time the sum is constant."""
    rise = np.linspace(5.0, 30.0, 750)
    p = make_windows(monkeypatch, 0.04, speed=np.concatenate([rise, rise[::-1]]))
    one = np.repeat([0, 1], 750)
    p.rows = replace(p.rows, log=np.tile(one, 2), time=np.tile(0.04 * np.arange(750), 4))
    e = np.tile(np.concatenate([rise, rise[::-1]]), 2) * np.tile([1.0, -1.0], 1500)
    found = where.find_conditions(p, e, {})
    assert [(c.channel, c.condition) for c in found] == [
        ("accel_y", "high speed"),
        ("yaw_rate", "high speed"),
    ]
    assert min(c.strength for c in found) > 0.999


def test_windows_count_by_their_means_and_not_if_more_than_half_of_them_is_missing(monkeypatch):
    """Each second window has 15 of 25 blocks, and the last one has 5."""
    block = np.arange(25 * 24 + 5)
    kept = (block // 25 % 2 == 0) | (block % 25 < 15)
    speed = np.where(block < 600, 5.0 + 0.01 * block, 50.0)
    p = make_windows(monkeypatch, 0.04, speed=speed[kept])
    p.rows = replace(p.rows, time=np.tile(0.04 * block[kept] + 0.01, 2))
    e = np.where(block < 600, speed, 0.0)[kept]
    for c in where.find_conditions(p, np.tile(e, 2), {}):
        assert c.condition == "high speed" and c.strength == pytest.approx(1.0)
    assert len(where.find_conditions(p, np.tile(e, 2), {})) == 2


@pytest.mark.parametrize(("windows", "there"), [(19, 0), (20, 2)])
def test_few_windows_show_no_condition(monkeypatch, windows, there):
    speed = np.linspace(5.0, 30.0, 25 * windows)
    p = make_windows(monkeypatch, 0.04, speed=speed)
    assert len(where.find_conditions(p, np.tile(speed, 2), {})) == there


def test_conditions_are_neither_weak_nor_due_to_chance(monkeypatch):
    """Of 4000 windows a correlation of 0.1 is certain, of 60 one of 0.25 is not."""
    rng = np.random.default_rng(8)
    drawn = rng.standard_normal(4000)
    p = make_windows(monkeypatch, 1.0, weak=drawn, strong=drawn + rng.standard_normal(4000))
    energy = np.exp(0.1 * drawn + rng.standard_normal(4000)), np.exp(drawn + rng.standard_normal(4000))
    found = where.find_conditions(p, np.sqrt(np.concatenate(energy)), {})
    assert [(c.channel, c.condition) for c in found] == [
        ("yaw_rate", "high weak"),
        ("yaw_rate", "high strong"),
    ]
    assert found[0].strength > found[1].strength > 0.15
    x = np.arange(60.0)
    y = 0.25 * (x - 29.5) / np.std(x) + np.random.default_rng(1).standard_normal(60)
    few = make_windows(monkeypatch, 1.0, weak=x)
    assert where.find_conditions(few, np.sqrt(np.tile(np.exp(y), 2)), {}) == []


# ---- the remainder


LOG = np.repeat(np.arange(4), 750)  # four logs of 30 s


def draw_white(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(len(LOG))


def filter_low_pass(x: np.ndarray, seconds: float) -> np.ndarray:
    a = np.exp(-BLOCK_TIME / seconds)
    return lfilter([np.sqrt(1 - a * a)], [1.0, -a], x)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("seconds", [0.001, 0.02, 0.03])
def test_noise_behind_the_low_pass_of_a_sensor_is_noise(seconds: float, seed: int) -> None:
    assert is_noise(1.7 * filter_low_pass(draw_white(seed), seconds), LOG)


@pytest.mark.parametrize("seed", range(5))
def test_what_lasts_swings_or_comes_and_goes_is_not(seed: int) -> None:
    t = BLOCK_TIME * np.arange(len(LOG))
    assert not is_noise(draw_white(seed) + filter_low_pass(draw_white(seed + 100), 0.3), LOG)  # gusts
    assert not is_noise(draw_white(seed) + 1.2 * np.sin(2 * np.pi * 5.5 * t), LOG)  # an axle
    assert not is_noise(
        draw_white(seed) * np.where(np.sin(0.4 * t) > 0.5, 3.0, 1.0), LOG
    )  # where something is done


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_about_the_mean_of_its_log_and_neither_long_nor_alternating(seed: int) -> None:
    """An autocorrelation of 0.61 from block to block lasts 4 blocks, 3 are noise."""
    white = draw_white(seed)
    assert is_noise(white + np.array([3.0, -5.0, 0.0, 2.0])[LOG], LOG)
    assert not is_noise(filter_low_pass(white, 0.08), LOG)
    assert not is_noise(white - 0.4 * np.roll(white, 1), LOG)  # of -0.34 from block to block
    assert is_noise(white + 0.4 * np.roll(white, 1), LOG)


@pytest.mark.parametrize("seed", range(5))
def test_a_walk_of_the_bias_is_taken_out_and_little_else(seed: int) -> None:
    step = 0.05
    walk = np.concatenate([np.cumsum(step * draw_white(seed + 10 + i)[:750]) for i in range(4)])
    rest = remove_walk(draw_white(seed) + walk, LOG, step)
    assert np.sqrt(np.mean(rest**2)) < 1.05
    swing = np.sin(2 * np.pi * 0.5 * BLOCK_TIME * np.arange(len(LOG)))
    assert np.sqrt(np.mean(remove_walk(swing, LOG, step) ** 2)) > 0.85 * np.sqrt(np.mean(swing**2))


def test_a_drift_is_followed_to_both_ends_of_each_log() -> None:
    """Of 7.5 in a log, upwards and downwards, at most a lag of a fifth is left."""
    rise = np.linspace(0.0, 7.5, 750)
    rest = remove_walk(np.concatenate([rise, rise[::-1], 3.0 + rise, -rise]), LOG, 0.05)
    assert np.abs(rest).max() < 0.3


def test_a_bias_that_stays_is_no_walk() -> None:
    np.testing.assert_array_equal(remove_walk(draw_white(1), LOG, 0.0), draw_white(1))


def test_lone_spikes_go_and_what_lasts_two_blocks_stays() -> None:
    x = draw_white(3)
    spiked = x.copy()
    spiked[[100, 800, 1600]] += 15.0
    spiked[2000:2003] += 15.0
    rest = remove_spikes(spiked, LOG)
    assert np.abs(rest[[100, 800, 1600]]).max() < 3.0
    np.testing.assert_array_equal(rest[2000:2003], spiked[2000:2003])
    assert np.mean(rest != spiked) < 0.005


def test_a_spike_is_replaced_by_its_neighbours_within_its_log() -> None:
    x = np.tile([1.0, -1.0], 10)
    x[[0, 5, 10, 15, 19]] = 30.0  # two logs of 10 blocks: at their ends, and inside
    x[7] = 5.0  # less than 1.25 times three sd
    log = np.repeat([0, 1], 10)
    rest = remove_spikes(x, log)
    assert (rest[5], rest[15]) == (1.0, 1.0)  # both neighbours are 1
    inside = np.delete(np.arange(20), [5, 15])
    np.testing.assert_array_equal(rest[inside], x[inside])
    assert x[5] == 30.0  # in a copy
    last = np.where(np.arange(20) == 9, 30.0, np.tile([1.0, -1.0], 10))
    np.testing.assert_array_equal(remove_spikes(last, log), last)
    np.testing.assert_array_equal(remove_spikes(np.array([1.0, 30.0]), log[:2]), [1.0, 30.0])


def test_the_walk_of_a_bias_is_in_units_of_the_noise_of_a_block() -> None:
    """0.005 m/s2/sqrt(s) over 40 ms; the weight is 1 / sd of a block."""
    p = SimpleNamespace(weight=np.array([50.0, 100.0, 900.0, 7.0]))
    rows = np.array([True, True, True, False])
    assert remainder.estimate_walk(p, rows, "accel_y") == pytest.approx(0.005 * 0.2 * 100.0)
    assert remainder.estimate_walk(p, rows, "yaw_rate") == pytest.approx(0.0003 * 0.2 * 100.0)
    assert remainder.estimate_walk(p, rows, "ins_vel_x") == 0.0


def test_a_short_span_has_half_of_what_is_above_the_noise() -> None:
    time = np.tile(0.04 * np.arange(750), 4)
    e = np.ones(3000)  # noise
    e[2250 + np.array([100, 101, 102, 103])] = np.sqrt(10.0)
    e[2250 + 400] = np.sqrt(7.0)
    begin, end, log = remainder.find_short_span(e, LOG, time)  # 21 of 42: three of the four
    assert (begin, end, log) == (pytest.approx(4.0), pytest.approx(4.08), 3)
    e[50] = np.sqrt(1.0 + 60.0)  # more than all of the other log
    assert remainder.find_short_span(e, LOG, time) == (pytest.approx(2.0), pytest.approx(2.0), 0)
    both = np.ones(3000)
    both[[10, 760, 1510]] = 9.0  # a third in each of three logs
    assert remainder.find_short_span(both, LOG, time) is None
    long = np.ones(3000)
    long[:700] = 2.0  # half of them are 11.7 % of all logs
    assert remainder.find_short_span(long, LOG, time) is not None
    one = np.zeros(1000, int)
    for rows, there in ((299, True), (310, False)):  # half of them: 15 % of all
        long = np.ones(1000)
        long[:rows] = 2.0
        found = remainder.find_short_span(long, one, 0.04 * np.arange(1000))
        assert (found is not None) is there


def find_kind(
    monkeypatch, e: np.ndarray, conditions: tuple[where.Condition, ...] = ()
) -> remainder.Remainder:
    monkeypatch.setattr(remainder, "find_conditions", lambda *_: list(conditions))
    p = SimpleNamespace(
        rows=SimpleNamespace(log=LOG, time=np.tile(0.04 * np.arange(750), 4)),
        weight=np.full(3000, 100.0),
        logs=[SimpleNamespace(name=f"log {k}") for k in range(4)],
        used=lambda: [("accel_y", np.ones(3000, bool))],
    )
    (found,) = remainder.find_remainders(p, e, {}, 1.2)
    assert found.channel == "accel_y" and found.gap == pytest.approx(np.sqrt(np.mean(e**2)))
    return found


def test_what_remains_is_classified(monkeypatch) -> None:
    noise = draw_white(5)
    assert find_kind(monkeypatch, noise).words == "accel_y: noise only"
    spiked = noise.copy()
    spiked[100::300] = 40.0
    found = find_kind(monkeypatch, spiked)
    assert found.kind == "noise" and found.words.endswith("apart from single spikes or a drifting bias")
    walk = np.concatenate([np.cumsum(0.1 * draw_white(20 + k)[:750]) for k in range(4)])
    assert find_kind(monkeypatch, noise + walk).words == found.words
    found = find_kind(monkeypatch, 1.5 * noise)
    assert found.kind == "noise" and found.words.startswith("accel_y: noise only, 1.4")
    burst = noise.copy()
    burst[1600:1640] += 15.0 * np.sin(0.3 * np.arange(40))
    found = find_kind(monkeypatch, burst)
    assert found.kind == "localised" and "half of the remaining error is in log 2 between" in found.words
    begin, end = (float(x) for x in found.words.partition("between ")[2].removesuffix(" s").split(" and "))
    assert 4.0 <= begin < end <= 5.6


def test_a_disturbance_is_stated_with_its_strongest_condition(monkeypatch) -> None:
    swing = draw_white(6) + 3.0 * np.sin(2 * np.pi * 0.6 * BLOCK_TIME * np.arange(3000))
    size = np.sqrt(np.mean(swing**2))
    found = find_kind(monkeypatch, swing)
    assert found.kind == "disturbance"
    assert found.words == f"accel_y: the remaining error is {size:.2f} times the noise"
    conditions = [
        ("yaw_rate", "low time", 0.9),
        ("accel_y", "high speed", 0.8),
        ("accel_y", "low speed", -0.3),
    ]
    found = find_kind(monkeypatch, swing, tuple(where.Condition(*c) for c in conditions))
    assert found.words.endswith("times the noise, largest at high speed")
