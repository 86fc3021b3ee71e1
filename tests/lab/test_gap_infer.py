"""The inference of the gap workflow against what is computed another way: dense covariances, quadrature, counted cases."""

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize
from scipy.stats import multivariate_normal, norm
from test_identify import dense as dense_without_bias

from gap_logs import car, problem_of, write_log
from tse.impl.core import Config
from tse.impl.gap.catalogue import Own, Parameter, catalogue, of_the_car
from tse.impl.gap.infer import forms, naming, noise, roads
from tse.impl.gap.infer.hypotheses import Hypothesis, hypotheses, known_of, latencies, ln_size
from tse.impl.gap.infer.naming import Named, Probability, matters, settings
from tse.impl.gap.infer.remainder import Remainder
from tse.impl.gap.infer.search import Search, judge
from tse.impl.gap.infer.space import EPISODE, FEWEST, Layout, Space, raw, slopes
from tse.impl.gap.problem import STIFFNESS, Problem, Rows
from tse.impl.gap.run import workflow
from tse.impl.identify.data import BLOCK, CHANNELS, prepare
from tse.impl.identify.discrepancy import Discrepancy, Piece
from tse.impl.vehicle import read_vehicle

N = 240


def dense(d: Discrepancy, piece: Piece) -> np.ndarray:
    """The covariance of residuals, entry by entry, biases in it."""
    return dense_without_bias(d, piece) + noise.BIAS_SD**2 * np.outer(piece.bias, piece.bias)


def piece(seed: int, size: float = 1.0) -> Piece:
    rng = np.random.default_rng(seed)
    time = BLOCK * np.arange(N) + 3.0
    return Piece(time, np.ones(N), 2.0 + rng.random(N), np.ones(N), size * rng.standard_normal(N))


def test_likelihood_of_two_logs_is_that_of_their_dense_covariances() -> None:
    """1e-6 nats: rounding of a bias whose variance is 1e5 times the noise's."""
    d = Discrepancy(0.9, 0.1, 0.7, (0.4, 12.0))
    pieces = [piece(1), piece(2)]
    exact = sum(multivariate_normal.logpdf(p.residual, np.zeros(N), dense(d, p)) for p in pieces)
    ours = noise.likelihood(d, noise.Series.of(pieces)) - N * np.log(2 * np.pi)
    assert ours == pytest.approx(exact, abs=1e-6)


def test_the_discrepancy_of_noise_is_noise_and_of_a_misfit_a_misfit() -> None:
    quiet = noise.found([piece(k) for k in range(4)])
    assert quiet.white == pytest.approx(1.0, abs=0.05) and noise.Left.of(quiet, [piece(0)]).energy < 1.1
    rng = np.random.default_rng(5)
    wrong = [
        replace(p, residual=p.residual + 0.8 * p.size * np.repeat(rng.standard_normal(N // 8), 8)) for p in map(piece, range(4))
    ]
    found = noise.Left.of(noise.found(wrong), wrong)
    assert found.energy > 3.0
    assert found.wrong < found.values < len(wrong) * N  # neighbours say the same


@dataclass
class Linear:
    """What a Layout asks of a problem: one log of accel_y, linear in front and rear stiffness and in an effect."""

    effect: Parameter
    size: float
    jobs: int = 1

    def __post_init__(self) -> None:
        rng = np.random.default_rng(8)
        self.logs = [SimpleNamespace(channels=["accel_y"])]
        self.time = BLOCK * np.arange(N)
        self.columns = {"cy_front": 30 * np.sin(self.time), "cy_rear": 20 * np.cos(1.7 * self.time)}
        self.columns[self.effect.name] = 8.0 / self.effect.scale * np.sin(4.1 * self.time)
        self.weight = np.ones(N)
        zeros = np.zeros(N, int)
        self.rows = Rows(zeros, zeros + CHANNELS.index("accel_y"), self.time, np.arange(N), zeros)
        truth = {"cy_front": 1.1, "cy_rear": 0.9, self.effect.name: self.size}
        self.measured = self.predict(truth) + 0.4 + rng.standard_normal(N)

    def predict(self, values: dict[str, float]) -> np.ndarray:
        default = {"cy_front": 1.0, "cy_rear": 1.0}
        return sum(values.get(k, default.get(k, 0.0)) * c for k, c in self.columns.items())

    def predict_all(self, asked: list[dict[str, float]]) -> list[np.ndarray]:
        return [self.predict(a) for a in asked]

    moved = Problem.moved

    def channels(self, values: dict[str, float], names: tuple[str, ...]) -> dict[str, np.ndarray]:
        return {n: np.zeros(N) for n in names}

    def quantity(self, name: str) -> np.ndarray:
        return np.zeros(N)


def one_effect(of: float = 1.0) -> tuple[Hypothesis, Linear]:
    """An effect of one strength and no shape, `of` times its typical size."""
    h = next(h for h in hypotheses() if h.id == "mass")
    (p,) = h.effect.fitted
    return h, Linear(p, of * p.scale)


def test_evidence_of_a_linear_problem_is_the_integral() -> None:
    """Laplace's method is exact for what is linear and normal; 0.05 nats: slopes are differences, and the search ends at a tenth of
    a sd. With and without the effect."""
    h, problem = one_effect()
    layout = Layout(problem)
    for effects in ((), (h,)):
        j = judge(layout, effects, {}, None)
        d = j.noise["accel_y"]
        p = j.space.piece(0, problem.measured)
        names = list(j.space.names[: j.space.shares])
        a = np.column_stack([problem.columns.get(n, np.zeros(N)) for n in names])
        prior = np.diag(j.space.sd[: j.space.shares] ** 2)
        mean = a @ j.space.mean[: j.space.shares]
        exact = multivariate_normal.logpdf(problem.measured, mean, dense(d, p) + a @ prior @ a.T) + noise.ln_prior(d)
        ours = j.evidence - 0.5 * N * np.log(2 * np.pi)
        for e in effects:  # a normal stands for the size's prior while it is fitted
            value = j.values[problem.effect.name]
            ours -= e.odds + e.ln_prior(j.values) - norm.logpdf(value, 0.0, j.space.sd[names.index(problem.effect.name)])
        assert ours == pytest.approx(exact, abs=0.05)


def test_a_search_names_what_is_there_and_nothing_else() -> None:
    for of, expected in ((1.0, {"mass"}), (0.0, set())):
        h, problem = one_effect(of)
        search = Search(Layout(problem), [h])
        assert search.run().ids == expected
        assert Probability(search, frozenset(expected)).of_class("mass") == pytest.approx(1.0 if expected else 0.0, abs=0.05)


def test_sets_that_copies_of_the_process_judge_are_worth_the_same() -> None:
    h, problem = one_effect()
    found = []
    for jobs in (1, 2):
        search = Search(Layout(problem), [h], jobs)
        nothing = search.judge((), {})
        both = search.judge_all([(frozenset({h.id}), nothing.values, nothing), (frozenset(), nothing.values, nothing)])
        again = search.judge_all([(frozenset({h.id}), {}, nothing)] * 2)  # known by now
        assert again[0] is both[0] and both[0].effects[0] is h and both[0].space.layout is search.layout
        found.append((both[0].evidence, list(both[0].x), search.run().ids))
    assert found[0] == found[1]


def large(*ids: str) -> SimpleNamespace:
    """A set in which every effect has its typical size, known to a percent."""
    effects = [SimpleNamespace(id=i, effect=catalogue()[i]) for i in ids]
    strengths = [p for h in effects for p in h.effect.strengths]
    values, sd = ({p.name: share * p.scale for p in strengths} for share in (1.0, 0.01))
    return SimpleNamespace(effects=effects, values=values, sd=lambda: sd)


def test_a_size_is_there_as_far_as_it_is_more_than_negligible() -> None:
    """Beside the share of a million normal numbers that are, 1 sd: 0.0005."""
    one = large("gyro_scale")
    (p,) = one.effects[0].effect.strengths
    drawn = np.random.default_rng(0).standard_normal(1_000_000)
    for size, sd in ((1.0, 0.5), (0.5, 0.3), (-1.2, 1.0), (3.0, 0.1)):  # of what is negligible
        one.values[p.name], one.sd()[p.name] = size * p.negligible, sd * p.negligible
        assert matters(one, one.effects[0]) == pytest.approx(np.mean(np.abs(size + sd * drawn) > 1.0), abs=0.002)


def test_effects_that_share_the_probability_are_each_others_look_alikes() -> None:
    """Two of which the logs of all drives prefer the one that the fitted ones do not: one class, surely missing."""
    sets = {("yaw_inertia",): 0.3, ("mass",): 0.6, ("mass", "grade"): 0.06, (): 0.04}
    known = {frozenset(k): large(*k) for k in sets}
    search = SimpleNamespace(probabilities=lambda: {frozenset(k): p for k, p in sets.items()}, known=known)
    found = Probability(search, frozenset(("yaw_inertia",)))
    assert found.of_class("yaw_inertia") == pytest.approx(0.96)
    assert found.in_place("yaw_inertia") == pytest.approx({"mass": 0.66, "grade": 0.06})
    assert found.effects["yaw_inertia"] == pytest.approx(0.3)


def test_a_channel_that_is_wrong_counts_as_few_values() -> None:
    _, problem = one_effect()
    layout = Layout(problem)
    layout.trust({"accel_y": noise.Left(1.0, 200.0)})
    assert layout.power["accel_y"] == 1.0
    layout.trust({"accel_y": noise.Left(1e9, 200.0)})
    seconds = BLOCK * sum(len(t) for t, (_, c) in zip(layout.time, layout.groups, strict=True) if c == "accel_y")
    assert layout.power["accel_y"] * 200.0 == pytest.approx(max(FEWEST, seconds / EPISODE))


@pytest.mark.parametrize("effect", sorted(h.id for h in hypotheses()))
def test_the_prior_of_a_size_is_a_density(effect: str) -> None:
    """1 %: what lies beyond a hundred times the typical sizes."""
    h = next(h for h in hypotheses() if h.id == effect)
    for p in h.effect.strengths:
        top = max(abs(p.typical_low - p.default), abs(p.typical_high - p.default))
        edges = np.geomspace(1e-4 * top, 100 * top, 60)
        mass = sum(quad(lambda x, p=p, s=s: np.exp(ln_size(p, s * x)), a, b)[0] for s in (-1, 1) for a, b in pairwise(edges))
        assert mass == pytest.approx(1.0, abs=0.01), p.name
        assert ln_size(p, p.scale * (p.sign or 1)) > ln_size(p, 10 * p.scale * (p.sign or 1)) + 5.0  # no car has that


def test_what_the_file_says_of_a_number_is_the_prior_of_its_size(tmp_path: Path) -> None:
    """A car that is 12 % heavier than a file that knows its mass to 1 %, and its inertia to a fifth: it is not the mass."""
    path = car(tmp_path)
    assert known_of(read_vehicle(path)) == list(catalogue().values())  # all is 0: nothing is said
    text = path.read_text(encoding="utf-8").replace("\nmass_sd = 0.0", "\nmass_sd = 0.01")
    path.write_text(text.replace("yaw_inertia_sd = 0.0", "yaw_inertia_sd = 0.2"), encoding="utf-8")
    effects = known_of(read_vehicle(path))
    heavy = next(h for h in hypotheses(effects) if h.id == "mass")
    for size in (0.0, -0.15):
        assert heavy.ln_prior({"mass_change": size}) == pytest.approx(norm.logpdf(size, 0.0, 0.01))
    logs = [write_log(tmp_path / f"{d}.csv", path, d, {"mass_change": 0.12}, k) for k, d in enumerate(("sweep", "steps"))]
    problem = problem_of(path, *logs)
    for asked, names in ((list(catalogue().values()), {"mass", "yaw_inertia"}), (effects, {"yaw_inertia"})):
        (named,) = naming.name(problem, asked).named
        assert {named.effect.id, *named.look_alikes} == names


def test_forms_of_a_lagging_effect_are_lags() -> None:
    """A delay of a sine is, to first order, minus the delay times its rate; 2 %: differences over 0.08 s at 0.5 Hz."""
    _, problem = one_effect()
    signal = np.sin(np.pi * problem.time)
    columns = forms.of(problem, signal, forms.modulators(problem, {}), "accel_y")
    rate = columns[:, forms.names("accel_y").index("'")] / forms.RATE_TIME
    assert rate[2:-2] == pytest.approx(np.pi * np.cos(np.pi * problem.time)[2:-2], abs=0.02 * np.pi)


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    folder = tmp_path_factory.mktemp("infer")
    vehicle = car(folder)
    log = write_log(folder / "steps.csv", vehicle, "steps", {}, 3, seconds=12.0)
    return problem_of(vehicle, log)


def test_a_delay_is_the_same_as_the_settings_that_are_written_of_it(late: Problem) -> None:
    """Positive: what the C library simulates as a delay. Negative: as latencies. The same numbers to 2 % of the change."""
    plain = late.predict({})
    for values in ({"imu_delay_time": 0.02}, {"steering_delay_time": 0.015}, {"imu_delay_time": -0.02, "accel_y_latency": 0.01}):
        told = settings(late, values)
        assert all(v >= 0 for k, v in told.items() if not k.endswith("_latency"))
        shifted = late.predict(values)
        if any(v < 0 for v in values.values()):
            moved = {k: v for k, v in told.items() if k.endswith("_latency")}
            assert moved == pytest.approx({"steer_angle_latency": 0.02, "wheel_speed_front_latency": 0.02,
                                           "wheel_speed_rear_latency": 0.02, "accel_y_latency": 0.01})  # fmt: skip
            continue
        other = Problem(late.logs, Config(late.config.as_dict() | told))
        assert np.std(other.predict({}) - shifted) < 0.02 * np.std(shifted - plain)


def test_values_that_are_held_act_as_if_they_were_given(late: Problem) -> None:
    """All of them: settings, stiffness of the car and of a log, latencies. A road's profile is fitted to what they leave."""
    values = {"cy_front": 0.9, Own("cy_rear", 0): 0.05, "body_roll_gain": 0.01, "imu_delay_time": -0.01, "accel_y_latency": 0.02}
    given = late.residuals(values)
    late.fixed = values
    try:
        assert np.array_equal(late.residuals({}), given)
        (moved,) = late.predict_all([{"cy_front": 0.8}])
    finally:
        late.fixed = {}
    assert np.array_equal(moved, late.predict(values | {"cy_front": 0.8}))
    assert not np.allclose(late.residuals({}), given)


def test_what_is_one_logs_own_is_told_from_what_is_the_cars(tmp_path):
    values = {"cy_rear": 0.9, Own("cy_rear", 1): 0.05, Own("bank", 0, 0): 0.01, Own("bank", 0, 1): -0.01, Own("grade", 0, 0): 0.02}
    assert of_the_car(values) == {"cy_rear": 0.9}
    assert [str(k) for k in values] == ["cy_rear", "cy_rear@1", "bank@0:0", "bank@0:1", "grade@0:0"]


def test_the_stiffness_of_the_car_is_that_about_which_its_logs_lie(tmp_path: Path) -> None:
    """And what the logs read does not change."""
    path = car(tmp_path)
    logs = [write_log(tmp_path / f"{k}.csv", path, "sweep", {}, k, 8.0) for k in (1, 2, 3)]
    space = Space(Layout(problem_of(path, *logs)), ())
    x = space.first.copy()
    x[3:12] = 0.01 * np.arange(1.0, 10.0)
    centred = space.centred(x)
    np.testing.assert_allclose(centred[3:12].reshape(3, 3).mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(centred[:3] - x[:3], [0.04, 0.05, 0.06])
    for before, after in zip(space.residuals(x), space.residuals(centred), strict=True):
        np.testing.assert_allclose(after, before, atol=1e-9)


def test_latencies_that_are_asked_for_are_no_settings(late: Problem) -> None:
    names = {p.name for e in latencies() for p in e.parameters} | {"steering_delay_time"}
    assert late.model(dict.fromkeys(names, 0.01)).as_dict() == late.config.as_dict() | {
        "stiffness_drift_time": late.nominal["stiffness_drift_time"]
    }


def test_late_messages_are_found_beside_the_effect(tmp_path: Path) -> None:
    """Steering logged 20 ms late and a car that rolls: both, and the improved vehicle says so."""
    vehicle = car(tmp_path)
    log = write_log(tmp_path / "log.csv", vehicle, "sweep", {"body_roll_gain": 0.009}, 5)
    table = pd.read_csv(log)
    table["steer_angle"] = table["steer_angle"].shift(2)
    table.dropna().to_csv(log, index=False, float_format="%.9g")
    result = workflow.run([log], vehicle, jobs=2)
    verdict = result.as_json()
    assert [e["id"] for e in verdict["effects"]] == ["body_roll"], result.words
    assert verdict["effects"][0]["probability"] > 0.9
    late = {s["id"]: s for s in verdict["sensors"]}["steer_angle_latency"]
    assert late["value"] == pytest.approx(0.02, abs=0.002)
    assert late["ci95"][0] < 0.02 < late["ci95"][1]


def test_a_road_that_leans_into_its_curves_is_no_scale_of_accel_y(tmp_path: Path) -> None:
    """Of the road: what is written of it is bank_superelevation, and it is no answer by itself where something is left."""
    vehicle = car(tmp_path)
    logs = [write_log(tmp_path / f"{d}.csv", vehicle, d, {"bank_superelevation": 0.12}, 5) for d in ("sweep", "steps")]
    result = workflow.run(logs, vehicle, jobs=2)
    assert [e["id"] for e in result.as_json()["effects"]] == ["superelevation"], result.words
    (named,) = [n for n in result.naming.named if not n.message]
    low, high = named.ci95["bank_superelevation"]
    assert low < 0.12 < high and high - low < 0.08
    written = settings(result.problem, result.naming.final.values)
    assert written["bank_superelevation"] == named.values["bank_superelevation"]
    left = [Remainder("yaw_rate", 3.0, "disturbance", "")]
    assert workflow.judge(result, [], left)[1] == 20


def test_a_hill_is_found_with_the_car_and_a_delay_beside_it_keeps_its_name(tmp_path: Path) -> None:
    """A delay of the IMU that shows in yaw_rate, beside a grade of which accel_x is full:
    0.08 rad, 0.057 rms."""
    vehicle = car(tmp_path)
    path = write_log(tmp_path / "log.csv", vehicle, "sweep", {"imu_delay_time": 0.008}, 5)
    table = pd.read_csv(path)
    table["accel_x"] += 9.81 * 0.08 * np.sin(2 * np.pi * table["time"] / 12.0)
    table.to_csv(path, index=False)
    read = read_vehicle(vehicle)
    logs, config = workflow.read([path], read)
    found = roads.find([prepare(log, config) for log in logs], config, read, 1)
    assert [r.effect.id for r in found.found] == ["grade"]
    assert found.found[0].size == pytest.approx(0.057, abs=0.012)  # knots are 2 s apart, and a prior of 0.03 rad holds them
    problem = Problem(found.logs, config)
    level = naming.plain_car(problem_of(vehicle, path))
    names = naming.name(problem, [catalogue()["imu_delay"]], baseline=level, roads=found.found)
    late = next(n for n in names.named if n.effect.id == "imu_delay")
    assert late.values["imu_delay_time"] == pytest.approx(0.008, abs=0.002)
    assert names.named[-1].effect.id == "grade"


def test_a_level_road_has_no_name(tmp_path: Path) -> None:
    vehicle = car(tmp_path)
    log = write_log(tmp_path / "log.csv", vehicle, "sweep", {"body_roll_gain": 0.009}, 4)
    read = read_vehicle(vehicle)
    logs, config = workflow.read([log], read)
    found = roads.find([prepare(log, config) for log in logs], config, read, 1)
    assert found.found == [] and found.fit is None and not found.logs[0].road


def test_latencies_have_the_intervals_of_the_names_that_they_are_sums_of(late: Problem) -> None:
    """The steering's: its own and the IMU's; the wheels': the IMU's; an effect of the car has no share. Of a low pass its own."""
    sizes = {"imu_delay": (-0.02, 0.002), "steering_delay": (-0.01, 0.001), "steering_lag": (0.012, 0.003), "mass": (0.1, 0.02)}
    named = []
    for effect, (x, half) in sizes.items():
        key = catalogue()[effect].strengths[0].name
        named.append(Named(catalogue()[effect], {key: x}, {key: (x - half, x + half)}, 0.5, 40.0))
    values = {k: v for n in named for k, v in n.values.items()}
    found = {s["id"]: s for s in workflow.sensors(late, SimpleNamespace(named=named, final=SimpleNamespace(values=values)))}
    expected = {
        "steer_angle_latency": (0.03, np.hypot(0.002, 0.001)),
        "wheel_speed_front_latency": (0.02, 0.002),
        "wheel_speed_rear_latency": (0.02, 0.002),
        "low_pass": (0.012, 0.003),
    }
    assert found.keys() == expected.keys()
    for k, (value, half) in expected.items():
        assert found[k]["value"] == pytest.approx(value)
        assert found[k]["ci95"] == pytest.approx([value - half, value + half], abs=1e-9)


def test_what_is_possible_says_why_it_has_no_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A scale that is surely below what counts is not there; a name that does not stand has the reason given, and so has one that
    closes less of what the others leave than a name must."""
    vehicle = car(tmp_path)
    log = write_log(tmp_path / "log.csv", vehicle, "sweep", {"body_roll_gain": 0.009, "gyro_scale_error": 0.06}, 3)
    problem = problem_of(vehicle, log)
    asked = [catalogue()[e] for e in ("body_roll", "steering_offset", "gyro_scale", "imu_delay")]
    asked[2] = replace(asked[2], parameters=tuple(replace(p, negligible=0.15) for p in asked[2].parameters))
    found = naming.name(problem, asked)
    assert [n.effect.id for n in found.named] == ["body_roll"]
    why = {p["id"]: p["why"] for p in found.possible}
    assert "gyro_scale" not in why and set(why.values()) <= {"below 90 %"}
    less = naming.without(problem, found, frozenset(), "a reason")
    assert {p["id"]: p["why"] for p in less.possible} == {"body_roll": "a reason"} | why
    assert naming.LEAST_CLOSED < found.named[0].alone <= 1.0
    monkeypatch.setattr(naming, "LEAST_CLOSED", 1.1)
    idle = naming.name(problem, asked)
    assert not idle.named and {p["id"]: p["why"] for p in idle.possible}["body_roll"] == "it closes next to nothing"


def test_a_road_is_kept_whatever_names_are_not(tmp_path: Path) -> None:
    vehicle = car(tmp_path)
    log = write_log(tmp_path / "log.csv", vehicle, "sweep", {}, 3)
    level = problem_of(vehicle, log)
    profile = {"grade": 0.01 * np.sin(level.logs[0].distance / 50)}
    problem = level.of([replace(level.logs[0], road=profile)])
    baseline, fitted = naming.plain_car(level), naming.plain_car(problem)
    road = roads.FoundRoad(catalogue()["grade"], 0.007, (0.006, 0.008), 40.0, 0.99)
    assert naming.named_roads(problem, baseline, fitted, [road]) == []  # the log was driven on a level road: it closes nothing
    (named,) = naming.named_roads(problem, fitted, baseline, [road])  # and the other way round
    assert named.values == {"grade_angle": 0.007} and 0.0 <= named.share <= 1.0
    found = naming.Naming(baseline, baseline, [named], 0.5, [], [], True)
    kept = naming.without(problem, found, frozenset({"grade"}), "a reason")
    assert kept.named == [named] and kept.possible == []
    assert kept.final.values == naming.plain_car(problem).values


def test_the_plain_car_is_least_squares(tmp_path: Path) -> None:
    """Of a car with rolls and delays: no other stiffness leaves less, by a search of scipy without slopes."""
    vehicle = car(tmp_path)
    log = write_log(tmp_path / "log.csv", vehicle, "sweep", {"body_roll_gain": 0.009, "imu_delay_time": 0.03}, 3)
    problem = problem_of(vehicle, log)
    keys = [p.name for p in STIFFNESS]

    def left(x: np.ndarray) -> float:
        e = problem.residuals(dict(zip(keys, np.exp(x), strict=True)))
        return float(e @ e)

    best = minimize(left, np.zeros(3), method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-6 * left(np.zeros(3))})
    plain = naming.plain_car(problem).residuals
    assert float(plain @ plain) == pytest.approx(best.fun, rel=2e-3)


def test_an_axle_may_be_late_by_a_length(late: Problem) -> None:
    """Half as long at twice the speed: what shapes say of a tyre's lateness over the rate of what it does."""
    layout = Layout(late)
    values = {"relaxation_length": 0.5}
    before, after = (layout.split(raw(late, v)) for v in ({}, values))
    layout.explains(before, after, values)
    speed = late.channels({}, ("vel_x",))["vel_x"]
    for k, p in enumerate(STIFFNESS):
        whole = np.zeros(len(late.rows.log))
        for rows, table in zip(layout.rows, slopes(layout, values, after, [p]), strict=True):
            whole[rows] = table[:, 0]
        rate = forms.rate(late, whole)
        for rows, shapes in zip(layout.rows, layout.shapes, strict=True):
            axle = shapes[:, np.flatnonzero(layout.shape_of == forms.AXLES)[k]]
            np.testing.assert_allclose(axle * speed[rows], 2.0 * rate[rows], rtol=1e-9, atol=1e-9)  # 0.1 s at 20 m/s


def test_a_road_is_told_by_the_size_of_its_profile() -> None:
    """Which has one number, where the effect has two strengths; and a delay below zero is a message that is late."""
    bank = Named(catalogue()["bank"], {"bank_angle": 0.012}, {"bank_angle": (0.01, 0.014)}, 0.5, 40.0, 0.99)
    assert not bank.message
    assert "banks by 0.69 degrees (0.57 .. 0.8), rms (bank); probability 99 %" in workflow._sentence(bank)
    assert "rms, the same on 3 laps (bank)" in workflow._sentence(bank, 3)
    assert workflow._as_json(bank)["parameters"].keys() == {"angle"}
    delay = Named(catalogue()["imu_delay"], {"imu_delay_time": -0.02}, {"imu_delay_time": (-0.021, -0.019)}, 0.5, 40.0)
    assert delay.message and "logged late" in workflow._sentence(delay)


def test_a_name_below_90_percent_is_possible_and_has_exit_code_11(late: Problem) -> None:
    """And a gap of the held-out logs is no all-clear."""
    baseline = naming.plain_car(late)

    def judged(probability: float | None, elsewhere: list[Remainder]) -> tuple[int, list[str]]:
        values, ci95 = {"body_roll_gain": 0.009}, {"body_roll_gain": (0.008, 0.01)}
        named = [] if probability is None else [Named(catalogue()["body_roll"], values, ci95, 0.4, 40.0, probability)]
        found = naming.Naming(baseline, baseline, named, 0.4, [], [], True)
        return workflow.judge(workflow.Found(found), [], [], elsewhere)[1:]

    sure, unsure = judged(0.95, []), judged(0.61, [])
    assert sure[0] == 10 and sure[1][0].startswith("gravity in accel_y")
    assert unsure[0] == 11 and unsure[1][0].startswith("possibly ")
    assert judged(None, [])[0] == 0
    swing = 5.0 * np.sin(np.pi * late.rows.time)
    assert len(workflow.what_is_left(late, replace(baseline, residuals=baseline.residuals + swing))) == 3
    assert workflow.what_is_left(late, replace(baseline, residuals=4.0 * baseline.residuals)) == []  # noise, though larger
    code, words = judged(None, [Remainder("yaw_rate", 3.08, "disturbance", "")])
    assert code == 20 and "yaw_rate 3.08 times the noise" in words[-1]
    assert "Nothing" not in " ".join(words) and "nothing is missing" not in " ".join(words)


def test_names_that_close_little_and_roads_are_no_answer_where_something_is_left(late: Problem) -> None:
    """Nor is more likely than not an all-clear."""
    baseline = naming.plain_car(late)
    left = [Remainder("yaw_rate", 3.0, "disturbance", "")]

    def name_of(effect: str, closed: float) -> Named:
        (p,) = catalogue()[effect].strengths[:1]
        return Named(catalogue()[effect], {p.name: 0.01}, {p.name: (0.0, 0.02)}, closed, 40.0, 0.99)

    def code(effect: str, closed: float, remains: list[Remainder], possible: float = 0.0) -> int:
        named = [name_of(effect, closed)] if closed else []
        maybe = [{"id": effect, "probability": possible, "why": "below 90 %"}] if possible else []
        found = naming.Naming(baseline, baseline, named, closed, maybe, [], True)
        return workflow.judge(workflow.Found(found), [], remains)[1]

    assert (code("body_roll", 0.6, left), code("body_roll", 0.06, left), code("grade", 0.8, left)) == (10, 20, 20)
    assert (code("body_roll", 0.06, []), code("grade", 0.8, [])) == (10, 10)
    for closes, wanted in ((0.2, 10), (0.1, 20)):  # of the 0.3 that the road leaves
        names = [name_of("body_roll", closes), name_of("grade", 0.7)]
        both = naming.Naming(baseline, baseline, names, 0.7 + closes, [], [], True)
        assert workflow.judge(workflow.Found(both), [], left)[1] == wanted
    roll = name_of("body_roll", 0.9)
    beside = SimpleNamespace(formula=SimpleNamespace(text="", place=""), words=[])
    found = workflow.Found(naming.Naming(baseline, baseline, [roll], 0.9, [], [], True), beside)
    assert workflow.judge(found, [], [])[1] == 10
    assert workflow.judge(found, [], [], left)[1] == 20  # held-out logs that names and formula do not explain
    assert (code("body_roll", 0.0, [], 0.61), code("body_roll", 0.0, [], 0.3), code("body_roll", 0.0, left, 0.61)) == (11, 0, 20)


def test_a_lag_that_no_steering_is_quick_enough_for_is_a_low_pass() -> None:
    """Of the IMU, as far as a log can say; a lag of a steering is one."""
    lag = {
        t: Named(catalogue()["steering_lag"], {"steering_lag_time": t}, {"steering_lag_time": (t - 0.002, t + 0.002)}, 0.5, 40.0)
        for t in (0.012, 0.03)
    }
    assert lag[0.012].message and "low pass" in lag[0.012].title
    assert not lag[0.03].message
