"""The inference of the gap workflow against other computations.

These are integrals, least squares and counted cases.
"""

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

from gap_logs import make_problem, write_car, write_log
from tse.car.vehicle import read_vehicle
from tse.gaps.catalogue import CatalogueParameter, Own, drop_log_values, load_catalogue
from tse.gaps.fit import compute_covariance
from tse.gaps.fit import fit_parameters as gap_fit
from tse.gaps.infer import folds, naming, roads
from tse.gaps.infer.hypotheses import (
    Hypothesis,
    apply_priors,
    compute_ln_size_prior,
    make_hypotheses,
    make_latencies,
)
from tse.gaps.infer.naming import Named, Probability, compute_relevance, convert_to_settings
from tse.gaps.infer.remainder import Remainder
from tse.gaps.infer.search import Around, Search, compute_error_duration, compute_ln_likelihood, judge_set
from tse.gaps.infer.space import LASTING, Space
from tse.gaps.problem import STIFFNESS_PARAMETERS, Problem, Rows
from tse.gaps.run import workflow
from tse.identify.data import BLOCK_TIME, COMPARED_CHANNELS, prepare
from tse.identify.fit import measure_scales
from tse.identify.unknowns import COMPLIANCE
from tse.library.core import Config

N = 1500


@dataclass
class Linear:
    """The interface that Space needs of a problem, for one log of accel_y.

    It is linear in the compliance of front and rear and in an effect.
    """

    effect: CatalogueParameter
    size: float

    def __post_init__(self) -> None:
        rng = np.random.default_rng(8)
        self.time = BLOCK_TIME * np.arange(N)
        self.columns = {"cy_front": 30 * np.sin(self.time), "cy_rear": 20 * np.cos(1.7 * self.time)}
        self.columns[self.effect.name] = 8.0 / self.effect.scale * np.sin(4.1 * self.time)
        self.weight = np.ones(N)
        zeros = np.zeros(N, int)
        self.rows = Rows(zeros, zeros + COMPARED_CHANNELS.index("accel_y"), self.time, np.arange(N), zeros)
        truth = {"cy_front": 1.1, "cy_rear": 0.9, self.effect.name: self.size}
        self.measured = self.predict(truth) + 0.4 + rng.standard_normal(N)

    def predict(self, values: dict[str, float]) -> np.ndarray:
        numbers = {
            k: 1.0 / values.get(k, 1.0) if k in COMPLIANCE else values.get(k, 0.0) for k in self.columns
        }
        return sum(numbers[k] * c for k, c in self.columns.items())

    def compute_residuals(self, values: dict[str, float]) -> np.ndarray:
        left = self.measured - self.predict(values)
        return left - left.mean()

    def compute_jacobian(
        self, values: dict[str, float], base: np.ndarray, parameters: list[CatalogueParameter], reach: float
    ) -> np.ndarray:
        by = {p.name: 1e-6 * p.scale for p in parameters}
        moved = [self.compute_residuals(values | {n: values[n] + h}) for n, h in by.items()]
        return np.column_stack(
            [(m - base) / h for m, h in zip(moved, by.values(), strict=True)] or [np.zeros((N, 0))]
        )


def make_one_effect(of: float = 1.0) -> tuple[Hypothesis, Linear]:
    """Return an effect of one strength and no shape, `of` times its typical size."""
    h = next(h for h in make_hypotheses() if h.id == "mass")
    (p,) = h.effect.fitted
    return h, Linear(p, of * p.scale)


def compute_channel_likelihood(square: float) -> float:
    return compute_ln_likelihood(square, N)


@pytest.mark.parametrize("rms", [0.8, 1.1, 1.5, 6.0, 40.0])
def test_a_likelihood_falls_with_the_sd_that_its_residuals_count_with(rms: float) -> None:
    """The derivative of the fit (measure_scales) is compared with a difference.

    Tolerance 1e-4: the second order of the difference. A residual nearer to the noise
    than LASTING counts in full.
    """
    noise = np.random.default_rng(3).standard_normal(N)
    residual = rms * noise / np.sqrt(np.mean(noise**2))
    space = SimpleNamespace(
        groups=[(0, "accel_y")],
        channels=("accel_y",),
        compute_noise=Space.compute_noise,
        get_step=Space.get_step,
        compute_lasting_error=Space.compute_lasting_error,
    )
    sd = measure_scales(space, [residual])["accel_y"].sd
    h = 1e-4
    slope = (compute_channel_likelihood(rms**2 + h) - compute_channel_likelihood(rms**2 - h)) / (2 * h * N)
    assert slope == pytest.approx(-0.5 / sd**2, rel=1e-4)


def test_evidence_of_a_linear_problem_is_the_integral() -> None:
    """Laplace's method is exact for a linear and normal problem.

    0.05 nats: the search ends at a tenth of a sd. The effect is off or on; its strength
    is unknown in both cases. The residual is noise, whose likelihood is normal.
    """
    variance = 1.0 + compute_error_duration() * LASTING**2
    for size, members in ((0.0, ()), (1.0, ("mass",))):
        h, problem = make_one_effect(size)
        j = judge_set(problem, [h], members, {})
        a = np.column_stack([problem.columns.get(n, np.zeros(N)) for n in j.space.names])
        a = a - a.mean(axis=0)
        y = problem.measured - problem.measured.mean() - a @ j.space.mean
        exact = multivariate_normal.logpdf(y, np.zeros(N), variance * np.eye(N) + (a * j.space.sd**2) @ a.T)
        exact += 0.5 * N * np.log(2 * np.pi * variance) + compute_channel_likelihood(0.0)
        ours = j.evidence
        for e in j.effects:  # a normal stands for the size's prior while it is fitted
            value, at = j.values[problem.effect.name], j.space.names.index(problem.effect.name)
            ours -= e.odds + e.compute_ln_prior(j.values) - norm.logpdf(value, 0.0, j.space.sd[at])
        assert ours == pytest.approx(exact, abs=0.05)


def test_slopes_of_one_fit_have_the_evidence_of_another_set() -> None:
    """Exact for what is linear: a tenth of a nat, at which fits end."""
    h, problem = make_one_effect(0.3)
    with_it, nothing = judge_set(problem, [h], ["mass"], {}), judge_set(problem, [h], [], {})
    assert Around(with_it).judge(with_it.ids).evidence == pytest.approx(with_it.evidence, abs=1e-9)
    assert Around(with_it).judge(nothing.ids).evidence == pytest.approx(nothing.evidence, abs=0.1)
    assert Around(nothing).judge(with_it.ids).evidence == pytest.approx(with_it.evidence, abs=0.1)
    there = Around(nothing).judge(with_it.ids)
    assert there.values["mass_change"] == pytest.approx(with_it.values["mass_change"], rel=1e-3)
    assert there.compute_sd()["mass_change"] == pytest.approx(with_it.compute_sd()["mass_change"], rel=1e-3)


def test_a_search_names_what_is_there_and_nothing_else() -> None:
    for of, expected in ((1.0, {"mass"}), (0.0, set())):
        h, problem = make_one_effect(of)
        search = Search(problem, [h])
        assert search.run().ids == expected
        assert Probability(search, frozenset(expected)).of_class("mass") == pytest.approx(
            1.0 if expected else 0.0, abs=0.05
        )


def test_what_folds_leave_is_what_fits_without_them_leave() -> None:
    """Compare with numpy's least squares, a fold at a time, with the priors as rows.

    1 % of what they leave more than the fit to all rows does: the search ends near its
    minimum.
    """
    h, problem = make_one_effect()
    j = judge_set(problem, [h], ["mass"], {})
    a = np.column_stack([problem.columns.get(n, np.zeros(N)) for n in j.space.names])
    a = a - a.mean(axis=0)
    y = problem.measured - problem.measured.mean()
    fold = (problem.time // folds.FOLD_PIECE_TIME).astype(int) % folds.FOLDS
    sd, left = j.fit.scales["accel_y"].sd, 0.0
    for k in np.unique(fold):
        rows = fold != k
        table = np.vstack([a[rows] / sd, np.diag(1.0 / j.space.sd)])
        x = np.linalg.lstsq(table, np.append(y[rows] / sd, j.space.mean / j.space.sd), rcond=None)[0]
        left += float(np.sum((y[~rows] - a[~rows] @ x) ** 2))
    fitted = float(np.sum(j.fit.residuals[0] ** 2))
    assert folds.compute_held_out(j)["accel_y"] - fitted == pytest.approx(left - fitted, rel=0.01)


def make_large_set(*ids: str) -> SimpleNamespace:
    """Return a set in which every effect has its typical size, known to a percent."""
    effects = [SimpleNamespace(id=i, effect=load_catalogue()[i]) for i in ids]
    strengths = [p for h in effects for p in h.effect.strengths]
    values, sd = ({p.name: share * p.scale for p in strengths} for share in (1.0, 0.01))
    return SimpleNamespace(effects=effects, values=values, compute_sd=lambda: sd)


def test_a_size_is_there_as_far_as_it_is_more_than_negligible() -> None:
    """Beside the share of a million normal numbers that are, 1 sd: 0.0005."""
    one = make_large_set("gyro_scale")
    (p,) = one.effects[0].effect.strengths
    drawn = np.random.default_rng(0).standard_normal(1_000_000)
    for size, sd in ((1.0, 0.5), (0.5, 0.3), (-1.2, 1.0), (3.0, 0.1)):  # of what is negligible
        one.values[p.name], one.compute_sd()[p.name] = size * p.negligible, sd * p.negligible
        assert compute_relevance(one, one.effects[0]) == pytest.approx(
            np.mean(np.abs(size + sd * drawn) > 1.0), abs=0.002
        )


def test_effects_that_share_the_probability_are_each_others_look_alikes() -> None:
    """The logs of all drives prefer the effect that the fitted logs do not.

    Both effects form one class, which is certainly missing.
    """
    sets = {("yaw_inertia",): 0.3, ("mass",): 0.6, ("mass", "grade"): 0.06, (): 0.04}
    known = {frozenset(k): make_large_set(*k) for k in sets}
    search = SimpleNamespace(
        compute_probabilities=lambda: {frozenset(k): p for k, p in sets.items()}, list_judged=lambda: known
    )
    found = Probability(search, frozenset(("yaw_inertia",)))
    assert found.of_class("yaw_inertia") == pytest.approx(0.96)
    assert found.in_place("yaw_inertia") == pytest.approx({"mass": 0.66, "grade": 0.06})
    assert found.effects["yaw_inertia"] == pytest.approx(0.3)


@pytest.mark.parametrize("effect", sorted(h.id for h in make_hypotheses()))
def test_the_prior_of_a_size_is_a_density(effect: str) -> None:
    """1 %: what lies beyond a hundred times the typical sizes."""
    h = next(h for h in make_hypotheses() if h.id == effect)
    for p in h.effect.strengths:
        top = max(abs(p.typical_low - p.default), abs(p.typical_high - p.default))
        edges = np.geomspace(1e-4 * top, 100 * top, 60)
        mass = sum(
            quad(lambda x, p=p, s=s: np.exp(compute_ln_size_prior(p, s * x)), a, b)[0]
            for s in (-1, 1)
            for a, b in pairwise(edges)
        )
        assert mass == pytest.approx(1.0, abs=0.01), p.name
        assert (
            compute_ln_size_prior(p, p.scale * (p.sign or 1))
            > compute_ln_size_prior(p, 10 * p.scale * (p.sign or 1)) + 5.0
        )  # no car has that


def test_what_the_file_says_of_a_number_is_the_prior_of_its_size(tmp_path: Path) -> None:
    """A car is 12 % heavier than its file states.

    The file states the mass to 1 % and the inertia to a fifth, so the mass is not the
    cause.
    """
    path = write_car(tmp_path)
    assert apply_priors(read_vehicle(path)) == list(load_catalogue().values())  # all is 0: nothing is said
    text = path.read_text(encoding="utf-8").replace("\nmass_sd = 0.0", "\nmass_sd = 0.01")
    path.write_text(text.replace("yaw_inertia_sd = 0.0", "yaw_inertia_sd = 0.2"), encoding="utf-8")
    effects = apply_priors(read_vehicle(path))
    heavy = next(h for h in make_hypotheses(effects) if h.id == "mass")
    for size in (0.0, -0.15):
        assert heavy.compute_ln_prior({"mass_change": size}) == pytest.approx(norm.logpdf(size, 0.0, 0.01))
    logs = [
        write_log(tmp_path / f"{d}.csv", path, d, {"mass_change": 0.12}, k)
        for k, d in enumerate(("sweep", "steps"))
    ]
    problem = make_problem(path, *logs)
    for asked, names in (
        (list(load_catalogue().values()), {"mass", "yaw_inertia"}),
        (effects, {"yaw_inertia"}),
    ):
        (named,) = naming.name_effects(problem, asked).named
        assert {named.effect.id, *named.look_alikes} == names


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    folder = tmp_path_factory.mktemp("infer")
    vehicle = write_car(folder)
    log = write_log(folder / "steps.csv", vehicle, "steps", {}, 3, seconds=12.0)
    return make_problem(vehicle, log)


def test_a_delay_is_the_same_as_the_settings_that_are_written_of_it(late: Problem) -> None:
    """A positive delay equals the C library's delay, a negative one equals latencies.

    The numbers agree to 2 % of the change.
    """
    plain = late.predict({})
    for values in (
        {"imu_delay_time": 0.02},
        {"steering_delay_time": 0.015},
        {"imu_delay_time": -0.02, "accel_y_latency": 0.01},
    ):
        told = convert_to_settings(late, values)
        assert all(v >= 0 for k, v in told.items() if not k.endswith("_latency"))
        shifted = late.predict(values)
        if any(v < 0 for v in values.values()):
            moved = {k: v for k, v in told.items() if k.endswith("_latency")}
            assert moved == pytest.approx(
                {
                    "steer_angle_latency": 0.02,
                    "wheel_speed_front_latency": 0.02,
                    "wheel_speed_rear_latency": 0.02,
                    "accel_y_latency": 0.01,
                }
            )
            continue
        other = Problem(late.logs, Config.exact(late.config.as_dict() | told))
        assert np.std(other.predict({}) - shifted) < 0.02 * np.std(shifted - plain)


def test_values_that_are_held_act_as_if_they_were_given(late: Problem) -> None:
    """Settings, stiffness and latencies are held.

    A road's profile is fitted to their residuals.
    """
    values = {
        "cy_front": 0.9,
        "cy_rear": 1.05,
        "body_roll_gain": 0.01,
        "imu_delay_time": -0.01,
        "accel_y_latency": 0.02,
    }
    given = late.compute_residuals(values)
    late.fixed = values
    try:
        assert np.array_equal(late.compute_residuals({}), given)
        (moved,) = late.predict_all([{"cy_front": 0.8}])
    finally:
        late.fixed = {}
    assert np.array_equal(moved, late.predict(values | {"cy_front": 0.8}))
    assert not np.allclose(late.compute_residuals({}), given)


def test_what_is_one_logs_own_is_told_from_what_is_the_cars(tmp_path):
    values = {"cy_rear": 0.9, Own("bank", 0, 0): 0.01, Own("bank", 0, 1): -0.01, Own("grade", 0, 0): 0.02}
    assert drop_log_values(values) == {"cy_rear": 0.9}
    assert [str(k) for k in values] == ["cy_rear", "bank@0:0", "bank@0:1", "grade@0:0"]


def test_latencies_that_are_asked_for_are_no_settings(late: Problem) -> None:
    names = {p.name for e in make_latencies() for p in e.parameters} | {"steering_delay_time"}
    assert late.make_config(dict.fromkeys(names, 0.01)).as_dict() == late.config.as_dict() | {
        "stiffness_drift_time": late.nominal["stiffness_drift_time"]
    }


def test_late_messages_are_found_beside_the_effect(tmp_path: Path) -> None:
    """Steering logged 20 ms late and a roll of the car are both found."""
    vehicle = write_car(tmp_path)
    log = write_log(tmp_path / "log.csv", vehicle, "sweep", {"body_roll_gain": 0.009}, 5)
    table = pd.read_csv(log)
    table["steer_angle"] = table["steer_angle"].shift(2)
    table.dropna().to_csv(log, index=False, float_format="%.9g")
    result = workflow.run_workflow([log], vehicle, jobs=2)
    verdict = result.as_json()
    assert [e["id"] for e in verdict["effects"]] == ["body_roll"], result.words
    assert verdict["effects"][0]["probability"] > 0.9
    late = {s["id"]: s for s in verdict["sensors"]}["steer_angle_latency"]
    assert late["value"] == pytest.approx(0.02, abs=0.002)
    assert late["ci95"][0] < 0.02 < late["ci95"][1]


@pytest.mark.slow
def test_a_road_that_leans_into_its_curves_is_no_scale_of_accel_y(tmp_path: Path) -> None:
    """The lean of the road is written as bank_superelevation.

    It is no answer by itself where something else is left.
    """
    vehicle = write_car(tmp_path)
    logs = [
        write_log(tmp_path / f"{d}.csv", vehicle, d, {"bank_superelevation": 0.12}, 5)
        for d in ("sweep", "steps")
    ]
    result = workflow.run_workflow(logs, vehicle, jobs=2)
    assert [e["id"] for e in result.as_json()["effects"]] == ["superelevation"], result.words
    (named,) = [n for n in result.naming.named if not n.message]
    low, high = named.ci95["bank_superelevation"]
    assert low < 0.12 < high and high - low < 0.08
    written = convert_to_settings(result.problem, result.naming.final.values)
    assert written["bank_superelevation"] == named.values["bank_superelevation"]
    left = [Remainder("yaw_rate", 3.0, "disturbance", "")]
    assert workflow.judge_run(result, [], left)[1] == 20


def test_a_hill_is_found_with_the_car_and_a_delay_beside_it_keeps_its_name(tmp_path: Path) -> None:
    """A delay of the IMU that shows in yaw_rate, beside a grade of which accel_x is full:
    0.08 rad, 0.057 rms."""
    vehicle = write_car(tmp_path)
    path = write_log(tmp_path / "log.csv", vehicle, "sweep", {"imu_delay_time": 0.008}, 5)
    table = pd.read_csv(path)
    table["accel_x"] += 9.81 * 0.08 * np.sin(2 * np.pi * table["time"] / 12.0)
    table.to_csv(path, index=False)
    read = read_vehicle(vehicle)
    logs, config = workflow.read_logs([path], read)
    found = roads.find_roads([prepare(log, config) for log in logs], config, read, 1)
    assert [r.effect.id for r in found.found] == ["grade"]
    assert found.found[0].size == pytest.approx(
        0.057, abs=0.012
    )  # knots are 2 s apart, and a prior of 0.03 rad holds them
    problem = Problem(found.logs, config)
    level = naming.fit_plain_car(make_problem(vehicle, path))
    names = naming.name_effects(problem, [load_catalogue()["imu_delay"]], baseline=level, roads=found.found)
    late = next(n for n in names.named if n.effect.id == "imu_delay")
    assert late.values["imu_delay_time"] == pytest.approx(0.008, abs=0.002)
    assert names.named[-1].effect.id == "grade"


def test_a_level_road_has_no_name(tmp_path: Path) -> None:
    vehicle = write_car(tmp_path)
    log = write_log(tmp_path / "log.csv", vehicle, "sweep", {"body_roll_gain": 0.009}, 4)
    read = read_vehicle(vehicle)
    logs, config = workflow.read_logs([log], read)
    found = roads.find_roads([prepare(log, config) for log in logs], config, read, 1)
    assert found.found == [] and found.fit is None and not found.logs[0].road


def test_latencies_have_the_intervals_of_the_names_that_they_are_sums_of(late: Problem) -> None:
    """The steering's latency is its own delay plus the IMU's; the wheels' is the IMU's.

    An effect of the car adds nothing. A low pass has an interval of its own.
    """
    sizes = {
        "imu_delay": (-0.02, 0.002),
        "steering_delay": (-0.01, 0.001),
        "steering_lag": (0.012, 0.003),
        "mass": (0.1, 0.02),
    }
    named = []
    for effect, (x, half) in sizes.items():
        key = load_catalogue()[effect].strengths[0].name
        named.append(Named(load_catalogue()[effect], {key: x}, {key: (x - half, x + half)}, 0.5, 40.0))
    values = {k: v for n in named for k, v in n.values.items()}
    found = {
        s["id"]: s
        for s in workflow.list_sensor_corrections(
            late, SimpleNamespace(named=named, final=SimpleNamespace(values=values))
        )
    }
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
    """A scale that is surely below the size that counts is not possible.

    A name that does not stand is listed with the reason. So is a name that closes less of
    the others' residual than a name must.
    """
    vehicle = write_car(tmp_path)
    log = write_log(
        tmp_path / "log.csv", vehicle, "sweep", {"body_roll_gain": 0.009, "gyro_scale_error": 0.002}, 3
    )
    problem = make_problem(vehicle, log)
    asked = [load_catalogue()[e] for e in ("body_roll", "steering_offset", "gyro_scale", "imu_delay")]
    found = naming.name_effects(problem, asked)
    assert [n.effect.id for n in found.named] == ["body_roll"]
    why = {p["id"]: p["why"] for p in found.possible}
    assert "gyro_scale" not in why and set(why.values()) <= {"below 90 %"}
    less = naming.drop_names(problem, found, frozenset(), "a reason")
    assert {p["id"]: p["why"] for p in less.possible} == {"body_roll": "a reason"} | why
    assert naming.MIN_CLOSED < found.named[0].alone <= 1.0
    monkeypatch.setattr(naming, "MIN_CLOSED", 1.1)
    idle = naming.name_effects(problem, asked)
    assert (
        not idle.named
        and {p["id"]: p["why"] for p in idle.possible}["body_roll"] == "it closes almost nothing"
    )


def test_a_road_is_kept_whatever_names_are_not(tmp_path: Path) -> None:
    vehicle = write_car(tmp_path)
    log = write_log(tmp_path / "log.csv", vehicle, "sweep", {}, 3)
    level = make_problem(vehicle, log)
    profile = {"grade": 0.01 * np.sin(level.logs[0].distance / 50)}
    problem = level.of([replace(level.logs[0], road=profile)])
    baseline, fitted = naming.fit_plain_car(level), naming.fit_plain_car(problem)
    road = roads.FoundRoad(load_catalogue()["grade"], 0.007, (0.006, 0.008), 40.0, 0.99)
    assert (
        naming.name_roads(problem, baseline, fitted, [road]) == []
    )  # the log was driven on a level road: it closes nothing
    (named,) = naming.name_roads(problem, fitted, baseline, [road])  # and the other way round
    assert named.values == {"grade_angle": 0.007} and 0.0 <= named.share <= 1.0
    found = naming.Naming(baseline, baseline, [named], 0.5, [], [], True)
    kept = naming.drop_names(problem, found, frozenset({"grade"}), "a reason")
    assert kept.named == [named] and kept.possible == []
    assert kept.final.values == naming.fit_plain_car(problem).values


def test_the_plain_car_is_least_squares(tmp_path: Path) -> None:
    """Compare with a search of scipy without slopes, for a car with rolls and delays.

    No other stiffness leaves a smaller residual.
    """
    vehicle = write_car(tmp_path)
    log = write_log(
        tmp_path / "log.csv", vehicle, "sweep", {"body_roll_gain": 0.009, "imu_delay_time": 0.03}, 3
    )
    problem = make_problem(vehicle, log)
    keys = [p.name for p in STIFFNESS_PARAMETERS]

    def left(x: np.ndarray) -> float:
        e = problem.compute_residuals(dict(zip(keys, np.exp(x), strict=True)))
        return float(e @ e)

    best = minimize(
        left, np.zeros(3), method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-6 * left(np.zeros(3))}
    )
    plain = naming.fit_plain_car(problem).residuals
    assert float(plain @ plain) == pytest.approx(best.fun, rel=2e-3)


def test_a_road_is_told_by_the_size_of_its_profile() -> None:
    """A road's profile has one number where an effect has two strengths.

    A negative delay is a late message.
    """
    bank = Named(
        load_catalogue()["bank"], {"bank_angle": 0.012}, {"bank_angle": (0.01, 0.014)}, 0.5, 40.0, 0.99
    )
    assert not bank.message
    assert (
        "banks by 0.69 degrees rms (95 %: 0.57 .. 0.8) (bank); probability 99 %"
        in workflow._describe_name(bank)
    )
    assert "0.8), the same on 3 laps (bank)" in workflow._describe_name(bank, 3)
    grade = Named(
        load_catalogue()["grade"], {"grade_angle": 0.02}, {"grade_angle": (0.01, 0.03)}, 0.5, 40.0, 0.99
    )
    assert "that the accel_x bias varies by 0.2 m/s2" in workflow._describe_name(grade)
    assert "bias varies" not in workflow._describe_name(grade, 2)  # a road is the same again, a sensor is not
    assert workflow._convert_name(bank)["parameters"].keys() == {"angle"}
    delay = Named(
        load_catalogue()["imu_delay"],
        {"imu_delay_time": -0.02},
        {"imu_delay_time": (-0.021, -0.019)},
        0.5,
        40.0,
    )
    assert not bank.message
    assert (
        "banks by 0.69 degrees rms (95 %: 0.57 .. 0.8) (bank); probability 99 %"
        in workflow._describe_name(bank)
    )
    assert "0.8), the same on 3 laps (bank)" in workflow._describe_name(bank, 3)
    grade = Named(
        load_catalogue()["grade"], {"grade_angle": 0.02}, {"grade_angle": (0.01, 0.03)}, 0.5, 40.0, 0.99
    )
    assert "that the accel_x bias varies by 0.2 m/s2" in workflow._describe_name(grade)
    assert "bias varies" not in workflow._describe_name(grade, 2)  # a road is the same again, a sensor is not
    assert workflow._convert_name(bank)["parameters"].keys() == {"angle"}
    delay = Named(
        load_catalogue()["imu_delay"],
        {"imu_delay_time": -0.02},
        {"imu_delay_time": (-0.021, -0.019)},
        0.5,
        40.0,
    )
    assert delay.message and "logged late" in workflow._describe_name(delay)


def test_a_name_below_90_percent_is_possible_and_has_exit_code_11(late: Problem) -> None:
    """And a gap of the held-out logs is no all-clear."""
    baseline = naming.fit_plain_car(late)

    def judged(probability: float | None, elsewhere: list[Remainder]) -> tuple[int, list[str]]:
        values, ci95 = {"body_roll_gain": 0.009}, {"body_roll_gain": (0.008, 0.01)}
        named = (
            []
            if probability is None
            else [Named(load_catalogue()["body_roll"], values, ci95, 0.4, 40.0, probability)]
        )
        found = naming.Naming(baseline, baseline, named, 0.4, [], [], True)
        return workflow.judge_run(workflow.Found(found), [], [], elsewhere)[1:]

    sure, unsure = judged(0.95, []), judged(0.61, [])
    assert sure[0] == 10 and sure[1][0].startswith("gravity in accel_y")
    assert unsure[0] == 11 and unsure[1][0].startswith("possibly ")
    assert judged(None, [])[0] == 0
    swing = 5.0 * np.sin(np.pi * late.rows.time)
    assert (
        len(workflow.find_excess_remainders(late, replace(baseline, residuals=baseline.residuals + swing)))
        == 3
    )
    assert (
        workflow.find_excess_remainders(late, replace(baseline, residuals=4.0 * baseline.residuals)) == []
    )  # noise, though larger
    code, words = judged(None, [Remainder("yaw_rate", 3.08, "disturbance", "")])
    assert code == 20 and "yaw_rate 3.08 times the sensor noise" in words[-1]
    assert "Nothing" not in " ".join(words) and "nothing is missing" not in " ".join(words)


def test_names_that_close_little_and_roads_are_no_answer_where_something_is_left(late: Problem) -> None:
    """Nor is more likely than not an all-clear."""
    baseline = naming.fit_plain_car(late)
    left = [Remainder("yaw_rate", 3.0, "disturbance", "")]

    def name_of(effect: str, closed: float) -> Named:
        (p,) = load_catalogue()[effect].strengths[:1]
        return Named(load_catalogue()[effect], {p.name: 0.01}, {p.name: (0.0, 0.02)}, closed, 40.0, 0.99)

    def code(effect: str, closed: float, remains: list[Remainder], possible: float = 0.0) -> int:
        named = [name_of(effect, closed)] if closed else []
        maybe = [{"id": effect, "probability": possible, "why": "below 90 %"}] if possible else []
        found = naming.Naming(baseline, baseline, named, closed, maybe, [], True)
        return workflow.judge_run(workflow.Found(found), [], remains)[1]

    assert (code("body_roll", 0.6, left), code("body_roll", 0.06, left), code("grade", 0.8, left)) == (
        10,
        20,
        20,
    )
    assert (code("body_roll", 0.06, []), code("grade", 0.8, [])) == (10, 10)
    for closes, wanted in ((0.2, 10), (0.1, 20)):  # of the 0.3 that the road leaves
        names = [name_of("body_roll", closes), name_of("grade", 0.7)]
        both = naming.Naming(baseline, baseline, names, 0.7 + closes, [], [], True)
        assert workflow.judge_run(workflow.Found(both), [], left)[1] == wanted
    roll = name_of("body_roll", 0.9)
    beside = SimpleNamespace(formula=SimpleNamespace(text="", place=""), words=[])
    found = workflow.Found(naming.Naming(baseline, baseline, [roll], 0.9, [], [], True), beside)
    assert workflow.judge_run(found, [], [])[1] == 10
    assert (
        workflow.judge_run(found, [], [], left)[1] == 20
    )  # held-out logs that names and formula do not explain
    assert (
        code("body_roll", 0.0, [], 0.61),
        code("body_roll", 0.0, [], 0.3),
        code("body_roll", 0.0, left, 0.61),
    ) == (11, 0, 20)


def test_the_friction_of_each_axle_is_said_where_they_differ() -> None:
    """1/(inverse friction (1 +- balance))."""
    size = {"tyre_saturation_inverse_friction": 0.8, "tyre_saturation_balance": 0.2}
    named = Named(
        load_catalogue()["tyre_saturation"],
        size,
        {k: (x - 0.01, x + 0.01) for k, x in size.items()},
        0.5,
        40.0,
    )
    assert "friction 1.04 in front and 1.56 in the rear" in workflow._describe_name(named)
    same = replace(named, values=size | {"tyre_saturation_balance": 0.0})
    assert "in the rear" not in workflow._describe_name(same)


def test_a_lag_that_no_steering_is_quick_enough_for_is_a_low_pass() -> None:
    """Of the IMU, as far as a log can say; a lag of a steering is one."""
    lag = {
        t: Named(
            load_catalogue()["steering_lag"],
            {"steering_lag_time": t},
            {"steering_lag_time": (t - 0.002, t + 0.002)},
            0.5,
            40.0,
        )
        for t in (0.012, 0.03)
    }
    assert lag[0.012].message and "low pass" in lag[0.012].title
    assert not lag[0.03].message


def test_a_fit_of_a_parameter_that_changes_nothing_ends_with_numbers(tmp_path: Path) -> None:
    """scipy's trust region divides by the slope."""
    vehicle = write_car(tmp_path)
    problem = make_problem(vehicle, write_log(tmp_path / "log.csv", vehicle, "sweep", {}, 1, 20.0))
    idle = CatalogueParameter(
        "formula_a", "a", True, "1", 1.0, -1e6, 1e6, 1.0, 1.0, 0.0, 0, "it acts nowhere"
    )
    found = gap_fit(problem, [*STIFFNESS_PARAMETERS, idle], {})
    assert all(np.isfinite(v) for v in found.values.values())


def test_a_parameter_that_changes_nothing_keeps_the_sd_of_its_prior(late: Problem) -> None:
    idle = CatalogueParameter(
        "formula_a", "a", True, "1", 0.0, -1e6, 1e6, 1.0, 1.0, 0.0, 0, "it acts nowhere", 0.3
    )
    found = gap_fit(late, [*STIFFNESS_PARAMETERS, idle], {})
    covariance = compute_covariance(late, found)
    assert np.sqrt(covariance[-1, -1]) == pytest.approx(0.3)
    assert not covariance[-1, :-1].any()  # nothing of it is in the stiffness


def test_a_latency_that_is_found_adds_to_that_of_the_vehicle_file(late: Problem) -> None:
    """Written are the sums: the file that comes out replaces the one that went in."""
    given = {"accel_y_latency": 0.03, "steer_angle_latency": 0.01}
    problem = Problem(late.logs, Config.exact(late.config.as_dict() | given))
    told = convert_to_settings(problem, {"accel_y_latency": 0.012, "imu_delay_time": -0.02})
    later = {"accel_y_latency": 0.042, "steer_angle_latency": 0.03}
    assert {k: told[k] for k in later} == pytest.approx(later)
