"""The search (identify/fit.py), priors (unknowns.py) and proposals (advice.py), on linear
problems whose solution is linear algebra."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.sparse import csc_matrix
from scipy.stats import multivariate_normal

from tse.car.vehicle import make_default_vehicle
from tse.identify import advice, fit, unknowns
from tse.identify.data import FitStretch, PreparedLog
from tse.identify.fit import CarFit, ResidualScale
from tse.library.core import Config

NOISE = 0.1


class Linear:
    """Residuals y - a x - b z of two channels in two logs. The search has x in other
    coordinates than the result: ln(stiffness) is taken to be 3 x."""

    channels = ("accel_y", "yaw_rate")
    groups = ((0, "accel_y"), (0, "yaw_rate"), (1, "yaw_rate"))
    names = ("a", "cy_front", "cy_rear")
    knot_sd = 0.5

    def __init__(self, knots: int = 0, seed: int = 1):
        rng = np.random.default_rng(seed)
        self.knots, self.car = knots, 3
        self.a = [rng.standard_normal((n, 3)) for n in (60, 40, 50)]
        self.b = [rng.standard_normal((n, knots)) for n in (60, 40, 50)]
        self.mean, self.sd = np.array([0.2, -0.1, 0.3]), np.array([1.0, 2.0, 0.5])
        self.low, self.high = self.mean - 5, self.mean + 5
        self.information = np.diag(self.sd**-2.0)
        self.truth = np.array([0.5, 0.2, 0.1]), 0.3 * rng.standard_normal(knots)
        x, z = self.truth
        self.y = [
            a @ x + b @ z + NOISE * rng.standard_normal(len(a)) for a, b in zip(self.a, self.b, strict=True)
        ]
        self.slopes_asked = 0

    def compute_residuals(self, x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        return [y - a @ x - b @ z for y, a, b in zip(self.y, self.a, self.b, strict=True)]

    def compute_slopes(self, x: np.ndarray, z: np.ndarray, base: list[np.ndarray]) -> list[np.ndarray]:
        self.slopes_asked += 1
        return [-a for a in self.a]

    def compute_road_slopes(self, x: np.ndarray, z: np.ndarray, base: list[np.ndarray]) -> list[csc_matrix]:
        return [csc_matrix(-b) for b in self.b]

    def compute_noise(self, g: int) -> float:
        return NOISE

    def get_step(self, g: int) -> float:
        return 5.0  # longer than MODEL_TIME: all errors are independent

    def compute_lasting_error(self, channel: str) -> float:
        return 0.0

    def to_ln(self, x: np.ndarray) -> np.ndarray:
        return 3.0 * x

    def compute_ln_slope(self, x: np.ndarray) -> np.ndarray:
        return np.full(len(x), 3.0)

    def solve(self, scales: dict[str, ResidualScale], groups: tuple[int, ...] = (0, 1, 2)):
        """Return mean and covariance of (x, z) by least squares, without Huber loss."""
        n = 3 + self.knots
        whole = np.zeros((n, n))
        whole[:3, :3], whole[3:, 3:] = self.information, np.eye(self.knots) / self.knot_sd**2
        right = np.concatenate([self.information @ self.mean, np.zeros(self.knots)])
        for g in groups:
            both = np.hstack([self.a[g], self.b[g]]) / scales[self.groups[g][1]].sd
            whole += both.T @ both
            right += both.T @ self.y[g] / scales[self.groups[g][1]].sd
        return np.linalg.solve(whole, right), np.linalg.inv(whole)


SCALES = {"accel_y": ResidualScale(0.1, 0.2), "yaw_rate": ResidualScale(0.3, 0.4)}


# ---- scales of residuals


def measure(
    residuals: list[np.ndarray], noises: list[float], lasting: float = 0.0, step: float = 0.04, **how
):
    problem = SimpleNamespace(
        channels=("yaw_rate",), groups=[(i, "yaw_rate") for i in range(len(residuals))],
        compute_noise=lambda g: noises[g], get_step=lambda g: step, compute_lasting_error=lambda c: lasting,
    )  # fmt: skip
    return fit.measure_scales(problem, residuals, **how)["yaw_rate"]


def test_far_from_the_maximum_residuals_are_weighted_as_independent_ones() -> None:
    e = [0.3 * np.random.default_rng(1).standard_normal(4000)]
    far = measure(e, [0.1], near=False)
    assert far.sd == far.rms == pytest.approx(0.3, rel=0.03)
    near = measure(e, [0.1])
    # a model error of 0.3^2 - 0.1^2 counts once in 2 s, i.e. in 50 values
    assert near.sd**2 == pytest.approx(0.01 + 50 * (near.rms**2 - 0.01))
    assert measure(e, [0.1], step=3.0).sd == pytest.approx(near.rms)  # a value lasts longer than that


def test_each_channel_has_its_own_residuals_noise_and_step_in_all_logs() -> None:
    rng = np.random.default_rng(2)
    e = [0.3 * rng.standard_normal(900), 2.0 * rng.standard_normal(500), 0.3 * rng.standard_normal(300)]
    problem = SimpleNamespace(
        channels=("accel_x", "yaw_rate"), groups=[(0, "yaw_rate"), (0, "accel_x"), (1, "yaw_rate")],
        compute_noise=lambda g: (0.1, 1.5, 0.2)[g], get_step=lambda g: (0.04, 0.4, 0.04)[g],
        compute_lasting_error=lambda c: 0.0,
    )  # fmt: skip
    found = fit.measure_scales(problem, e)
    assert found["accel_x"].sd ** 2 == pytest.approx(1.5**2 + 5 * (found["accel_x"].rms ** 2 - 1.5**2))
    noise = (900 * 0.1**2 + 300 * 0.2**2) / 1200
    assert found["yaw_rate"].sd ** 2 == pytest.approx(noise + 50 * (found["yaw_rate"].rms ** 2 - noise))
    assert found["yaw_rate"].rms == pytest.approx(0.3, rel=0.05)


def test_residuals_are_at_least_as_large_as_noise_and_lasting_error_together() -> None:
    """Of two logs, the longer one counts more: noise^2 is the mean over their values."""
    none = [np.zeros(300), np.zeros(100)]
    assert measure(none, [0.01, 0.03]).rms == pytest.approx(np.sqrt((3 * 0.01**2 + 0.03**2) / 4))
    assert measure(none, [0.03, 0.03], lasting=0.04).rms == pytest.approx(0.05)
    assert measure(none, [0.0, 0.0]).rms == 1e-9


def test_outliers_are_clipped_at_four_times_the_size_of_the_residuals() -> None:
    e = np.append(np.tile([1.0, -1.0], 50), [100.0, -100.0])
    by_median = 4 * 1.4826
    assert measure([e], [0.0]).rms == pytest.approx(np.sqrt((100 + 2 * by_median**2) / 102))
    before = {"yaw_rate": ResidualScale(2.0, 9.0)}
    assert measure([e], [0.0], before=before).rms == pytest.approx(np.sqrt((100 + 2 * 8.0**2) / 102))
    # the limit is never below four times the noise
    half = np.repeat([1.0, 100.0], 50)
    assert measure([half], [3.0], before=before).rms == pytest.approx(np.sqrt((1 + 12.0**2) / 2))


# ---- cost, normal equations, step


def test_the_cost_is_quadratic_up_to_four_rms_and_linear_beyond_with_both_priors() -> None:
    problem = SimpleNamespace(
        mean=np.array([1.0, 2.0]), information=np.array([[4.0, 1.0], [1.0, 2.0]]), knot_sd=0.5,
        groups=[(0, "accel_y"), (0, "yaw_rate")],
    )  # fmt: skip
    x, z = np.array([1.5, 1.0]), np.array([0.2, -0.1])
    residuals = [np.array([0.2, -0.5]), np.array([-1.2, 2.2])]
    prior = 0.5 * (4 * 0.25 - 2 * 0.5 + 2 * 1.0) + 0.5 * (0.04 + 0.01) / 0.25
    # accel_y is linear from 0.4 on, yaw_rate from 1.2 on
    data = (0.5 * 0.04 + 0.4 * (0.5 - 0.2)) / 0.2**2 + (0.5 * 1.44 + 1.2 * (2.2 - 0.6)) / 0.4**2
    assert fit.compute_cost(problem, SCALES, x, z, residuals) == pytest.approx(prior + data)


@pytest.mark.parametrize("knots", [0, 4])
@pytest.mark.parametrize("channels", [None, ("yaw_rate",)])
def test_normal_equations_are_those_of_the_channels_that_are_asked_for(knots, channels) -> None:
    """Compare with dense algebra over car and road, with one residual that is an
    outlier."""
    p = Linear(knots)
    x, z = p.mean + 0.1, np.full(knots, 0.05)
    p.y[1][7] += 9.0
    e = p.compute_residuals(x, z)
    got = fit.build_normal(
        p, SCALES, x, z, e, p.compute_slopes(x, z, e), p.compute_road_slopes(x, z, e), channels
    )
    whole = np.zeros((3 + knots, 3 + knots))
    whole[:3, :3], whole[3:, 3:] = p.information, np.eye(knots) / p.knot_sd**2
    gradient = np.concatenate([p.information @ (x - p.mean), z / p.knot_sd**2])
    for g in (0, 1, 2) if channels is None else (1, 2):
        scale = SCALES[p.groups[g][1]]
        both = -np.hstack([p.a[g], p.b[g]])
        w = np.where(np.abs(e[g]) > 4 * scale.rms, 4 * scale.rms / np.abs(e[g]), 1.0) / scale.sd**2
        whole += both.T @ (w[:, None] * both)
        gradient += both.T @ (w * e[g])
    inverse = np.linalg.inv(whole)
    np.testing.assert_allclose(np.linalg.inv(got.information), inverse[:3, :3], rtol=1e-9)
    by = np.linalg.solve(got.information, -got.gradient)
    np.testing.assert_allclose(np.concatenate([by, got.solve_road(by)]), -inverse @ gradient, rtol=1e-8)
    np.testing.assert_allclose(got.compute_road_sd(), np.sqrt(np.diag(inverse)[3:]), rtol=1e-9)


def test_the_evidence_of_a_road_is_the_ratio_of_prior_and_posterior_density_at_0() -> None:
    """Savage and Dickey, with densities of scipy. Values that are 0 have evidence
    against them."""
    p = Linear(5)
    p.y = [y + a @ np.zeros(3) for y, a in zip(p.y, p.a, strict=True)]
    (mean, covariance), zero = p.solve(SCALES), np.zeros(2)
    x, z = mean[:3], mean[3:]
    e = p.compute_residuals(x, z)
    got = fit.build_normal(p, {c: ResidualScale(1e9, s.sd) for c, s in SCALES.items()}, x, z, e,
                           p.compute_slopes(x, z, e), p.compute_road_slopes(x, z, e))  # fmt: skip
    at = slice(1, 3)
    prior = multivariate_normal(zero, p.knot_sd**2 * np.eye(2)).logpdf(zero)
    posterior = multivariate_normal(z[at], covariance[3:, 3:][at, at]).logpdf(zero)
    assert got.compute_road_evidence(at, z, p.knot_sd) == pytest.approx(prior - posterior)
    assert got.compute_road_evidence(at, np.zeros(5), p.knot_sd) < 0
    level = fit.NormalEquations(np.eye(3), np.zeros(3), np.zeros((0, 3)), np.zeros(0), None)
    assert level.compute_road_evidence(slice(0, 0), np.zeros(0), 0.5) == 0.0
    assert len(level.compute_road_sd()) == len(level.solve_road(np.ones(3))) == 0


def test_no_unknown_moves_by_more_than_one_and_a_half_prior_sd_in_a_step() -> None:
    p = SimpleNamespace(low=np.full(2, -9.0), high=np.full(2, 9.0), sd=np.array([0.4, 2.0]))
    equations = fit.NormalEquations(np.eye(2), np.array([-5.0, 1.0]), np.zeros((0, 2)), np.zeros(0), None)
    np.testing.assert_allclose(fit.compute_step(p, equations, np.zeros(2)), [0.6, -1.0], atol=1e-9)
    equations.gradient = np.array([5.0, -4.0])
    np.testing.assert_allclose(fit.compute_step(p, equations, np.zeros(2)), [-0.6, 3.0], atol=1e-9)
    p.low, p.high = np.array([0.4, -9.0]), np.array([9.0, 1.0])
    np.testing.assert_allclose(fit.compute_step(p, equations, np.array([0.7, 0.5])), [-0.3, 0.5], atol=1e-9)


def test_the_gain_that_slopes_predict_is_that_of_a_linear_problem() -> None:
    p = Linear(3)
    x, z, by, along = p.mean, np.zeros(3), np.array([0.2, 0.1, -0.1]), np.array([0.1, -0.2, 0.05])
    e, there = p.compute_residuals(x, z), p.compute_residuals(x + by, z + along)
    slopes = p.compute_slopes(x, z, e), p.compute_road_slopes(x, z, e)
    gain = fit.compute_cost(p, SCALES, x, z, e) - fit.compute_cost(p, SCALES, x + by, z + along, there)
    assert fit._predict_gain(p, SCALES, x, z, e, *slopes, by, along) == pytest.approx(gain)
    # slopes that predict the step are not changed
    for old, new in zip(slopes[0], fit._update_slopes(p, *slopes, e, there, by, along), strict=True):
        np.testing.assert_allclose(new, old, atol=1e-12)


def test_updated_slopes_predict_the_last_step_with_the_least_change_per_prior_sd() -> None:
    """The least change is a pseudoinverse."""
    p, rng = Linear(2), np.random.default_rng(3)
    by, along = np.array([0.2, 0.1, -0.1]), np.array([0.1, -0.2])
    before = p.compute_residuals(p.mean, np.zeros(2))
    after = [e + rng.standard_normal(len(e)) for e in before]
    slopes, roads = p.compute_slopes(p.mean, along, before), p.compute_road_slopes(p.mean, along, before)
    new = fit._update_slopes(p, slopes, roads, before, after, by, along)
    for j, r, k, b, a in zip(slopes, roads, new, before, after, strict=True):
        np.testing.assert_allclose(b + k @ by + r @ along, a, atol=1e-12)
        lacks = a - b - j @ by - r @ along
        expected = np.outer(lacks, np.linalg.pinv((by / p.sd)[:, None])[0]) / p.sd
        np.testing.assert_allclose(k - j, expected, atol=1e-12)


def test_a_road_is_fitted_first_if_that_reduces_the_cost() -> None:
    p = Linear(4)
    x, z = p.mean, np.zeros(4)
    e = p.compute_residuals(x, z)
    slopes = p.compute_slopes(x, z, e), p.compute_road_slopes(x, z, e)
    large = {c: ResidualScale(1e9, s.sd) for c, s in SCALES.items()}
    hills, left = fit._fit_road(p, large, x, z, e, *slopes)
    weights = np.concatenate(
        [np.full(len(y), 1 / SCALES[c].sd) for y, (_, c) in zip(p.y, p.groups, strict=True)]
    )
    a = np.vstack([weights[:, None] * np.vstack(p.b), np.eye(4) / p.knot_sd])
    best = np.linalg.lstsq(a, np.append(weights * np.concatenate(e), np.zeros(4)), rcond=None)[0]
    np.testing.assert_allclose(hills, best, rtol=1e-8)
    np.testing.assert_allclose(left[2], e[2] - p.b[2] @ best)
    wrong = [csc_matrix(-0.05 * r) for r in slopes[1]]  # they lead far off, and the other way
    assert fit._fit_road(p, large, x, z, e, slopes[0], wrong) is None


# ---- the search


@pytest.mark.parametrize("knots", [0, 4])
def test_a_search_ends_at_the_least_squares_of_car_and_road(knots: int) -> None:
    p, words = Linear(knots), []
    found = fit.fit(p, say=words.append)
    mean, covariance = p.solve(found.scales)
    sd = np.sqrt(np.diag(covariance))
    assert found.converged and found.steps == len(words) and 0 < found.moved < 0.1
    np.testing.assert_allclose(found.search, mean[:3], atol=0.1 * sd[:3].min())
    np.testing.assert_allclose(found.z, mean[3:], atol=0.1 * sd.max())
    np.testing.assert_array_equal(found.x, 3.0 * found.search)
    np.testing.assert_allclose(found.covariance, 9.0 * covariance[:3, :3], rtol=0.03)
    np.testing.assert_array_equal(found.residuals[1], p.compute_residuals(found.search, found.z)[1])
    np.testing.assert_array_equal(found.level[1], p.compute_residuals(found.search, np.zeros(knots))[1])
    assert words[0].startswith("step 1: the largest change of an unknown is ") and words[0].endswith(" sd")
    few = fit.compute_covariance(p, found, ["yaw_rate"])
    np.testing.assert_allclose(few, 9.0 * p.solve(found.scales, (1, 2))[1][:3, :3], rtol=0.03)


def test_a_search_stops_at_its_limit_of_steps_where_it_is() -> None:
    p = Linear()
    p.mean, p.sd = p.truth[0] + 20.0, np.full(3, 0.5)  # steps of 0.75 lead 20 away
    p.information, p.low, p.high = np.diag(p.sd**-2.0), np.full(3, -99.0), np.full(3, 99.0)
    none = fit.fit(p, max_steps=0)
    np.testing.assert_array_equal(none.search, p.mean)
    assert not none.converged and none.steps == 0 and none.moved == np.inf
    two = fit.fit(p, max_steps=2)
    assert not two.converged and two.steps == 2
    assert (np.abs(two.search - p.mean) > 0.1).all() and (np.abs(two.search - p.mean) < 1.5).all()
    np.testing.assert_array_equal(fit.fit(p, two.search, max_steps=0).search, two.search)
    p.high = p.mean - 3.0  # a mean beyond the bounds is no start
    np.testing.assert_array_equal(fit.fit(p, max_steps=0).search, p.high)


def test_a_step_that_raises_the_cost_is_halved_in_car_and_road_if_its_slopes_are_exact(monkeypatch) -> None:
    """The first two lengths raise the cost, the third one does not."""
    p, tried = Linear(4), []
    plain = p.compute_residuals

    def worsen(x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        tried.append((x, z))
        return [e + (100.0 if len(tried) in (2, 3) else 0.0) for e in plain(x, z)]

    monkeypatch.setattr(fit, "_fit_road", lambda *_: None)
    monkeypatch.setattr(p, "compute_residuals", worsen)
    found = fit.fit(p, max_steps=1)
    x, z = tried[0]
    assert len(tried) == 5 and found.steps == 1  # the start, three lengths, and level roads
    steps = [(a - x, b - z) for a, b in tried[1:4]]
    for k in (1, 2):
        np.testing.assert_allclose(steps[k][0], steps[0][0] * 0.5**k)
        np.testing.assert_allclose(steps[k][1], steps[0][1] * 0.5**k)
    np.testing.assert_array_equal(found.search, tried[3][0])
    np.testing.assert_array_equal(found.z, tried[3][1])
    assert np.abs(steps[0][1]).min() > 0.001


def test_a_step_with_updated_slopes_that_raises_the_cost_is_not_halved_but_simulated_again(
    monkeypatch,
) -> None:
    p, tried, asked = Linear(), [], []
    p.mean, p.sd = p.truth[0] + 20.0, np.full(3, 0.5)  # far off: steps of 0.75
    p.information, p.low, p.high = np.diag(p.sd**-2.0), np.full(3, -99.0), np.full(3, 99.0)
    plain = p.compute_residuals

    def worsen(x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        tried.append(x)
        asked.append(p.slopes_asked)
        return [e + (1000.0 if len(tried) == 3 else 0.0) for e in plain(x, z)]

    monkeypatch.setattr(p, "compute_residuals", worsen)
    found = fit.fit(p, max_steps=2)
    assert found.steps == 2 and asked == [0, 1, 1, 2]
    np.testing.assert_allclose(tried[3], tried[2])  # the slopes were right


@pytest.mark.parametrize(
    ("gain", "near", "ends"), [(0.09, True, True), (0.11, True, False), (0.09, False, False)]
)
def test_a_search_near_the_maximum_ends_if_the_predicted_gain_is_below_a_tenth(
    monkeypatch, gain, near, ends
) -> None:
    monkeypatch.setattr(fit, "_predict_gain", lambda *_: gain)
    found = fit.fit(Linear(), near=near, max_steps=1)
    assert found.steps == 1 and found.moved > 0.1 and found.converged == ends


def test_a_search_near_the_maximum_ends_where_no_length_of_a_step_reduces_the_cost(monkeypatch) -> None:
    p, tried = Linear(), []
    plain = p.compute_residuals

    def worsen(x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        tried.append(x)
        assert len(tried) < 20
        return [e + (100.0 if len(tried) > 1 else 0.0) for e in plain(x, z)]

    monkeypatch.setattr(p, "compute_residuals", worsen)
    found = fit.fit(p, near=True)
    assert found.converged and found.steps == 0 and len(tried) == 1 + fit.MAX_HALVINGS
    np.testing.assert_array_equal(found.search, p.mean)


def test_after_a_step_the_slopes_are_those_that_predict_it(monkeypatch) -> None:
    """Residuals have a part that is quadratic in x, which the first slopes lack."""
    p, seen = Linear(), []
    plain = p.compute_residuals

    def bend(x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        seen.append((x, [e + 0.2 * (x[0] - 0.2) ** 2 for e in plain(x, z)]))
        return seen[-1][1]

    monkeypatch.setattr(p, "compute_residuals", bend)
    found = fit.fit(p, max_steps=1)
    assert p.slopes_asked == 1 and len(seen) == 2
    (start, before), (end, after) = seen
    for table, a, b in zip(found.slopes[0], before, after, strict=True):
        np.testing.assert_allclose(table @ (end - start), b - a, atol=1e-9)
    assert abs(found.slopes[0][0] + p.a[0]).max() > 0.01


def test_a_move_is_measured_in_posterior_sds_and_scales_follow_from_those_before(monkeypatch) -> None:
    """With regressors that are hardly different, so sds are larger than each alone."""
    p, seen = Linear(4), []
    p.a = [a @ np.array([[1.0, 1.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 1.0]]) for a in p.a]
    p.y = [a @ p.truth[0] + b @ p.truth[1] + 0.01 * y for a, b, y in zip(p.a, p.b, p.y, strict=True)]
    plain = fit.measure_scales

    def measure(problem: object, residuals: object, before: object = None, near: bool = True) -> object:
        seen.append((before, plain(problem, residuals, before, near)))
        return seen[-1][1]

    monkeypatch.setattr(fit, "measure_scales", measure)
    found = fit.fit(p, max_steps=1)
    assert [before for before, _ in seen] == [None, seen[0][1], seen[1][1]]  # start, road, step
    sd = np.sqrt(np.diag(p.solve(seen[1][1])[1]))[:3]
    assert found.moved == pytest.approx(np.max(np.abs(found.search - p.mean) / sd), rel=0.1)


def test_a_covariance_of_some_channels_is_converted_at_the_place_of_the_search(monkeypatch) -> None:
    p = Linear()
    found = fit.fit(p)
    plain = fit.compute_covariance(p, found, ["yaw_rate"])
    monkeypatch.setattr(p, "compute_ln_slope", lambda x: 3.0 * x)
    np.testing.assert_allclose(
        fit.compute_covariance(p, found, ["yaw_rate"]), plain * np.outer(found.search, found.search)
    )


def test_slopes_that_are_known_at_the_start_are_not_simulated_again() -> None:
    p = Linear()
    best = fit.fit(p)
    p.slopes_asked = 0
    again = fit.fit(p, best.search, near=True, tables=[-a for a in p.a])
    assert p.slopes_asked == 0 and again.converged
    np.testing.assert_allclose(again.search, best.search, atol=1e-3)
    fit.fit(p, best.search, near=True)
    assert p.slopes_asked > 0


# ---- unknowns


def test_the_unit_of_an_unknown_is_that_of_its_setting_and_a_second_for_a_latency() -> None:
    assert unknowns.get_unit("accel_y_latency") == "s"
    assert unknowns.get_unit("relaxation_length") == "m"
    assert unknowns.get_unit("yaw_inertia") == "kg m2"
    assert unknowns.get_unit("cy_front") == "ln"
    assert unknowns.name_in_log("superelevation", 2) == "superelevation@2"
    assert unknowns.name_bias("yaw_rate", 1) == "yaw_rate~1"


def test_a_part_of_a_prior_is_that_of_the_names_in_their_order() -> None:
    covariance = np.array([[4.0, 1.0, 0.5], [1.0, 9.0, 0.2], [0.5, 0.2, 1.0]])
    prior = unknowns.Prior(("a", "b", "c"), np.arange(3.0), covariance, -np.arange(1.0, 4), np.arange(1.0, 4))
    np.testing.assert_array_equal(prior.sd, [2.0, 3.0, 1.0])
    part = prior.select(("c", "a"))
    assert part.names == ("c", "a")
    np.testing.assert_array_equal(part.mean, [2.0, 0.0])
    np.testing.assert_array_equal(part.covariance, [[1.0, 0.5], [0.5, 4.0]])
    np.testing.assert_array_equal(np.stack([part.low, part.high]), [[-3.0, -1.0], [3.0, 1.0]])


def test_errors_in_common_join_radii_and_messages_and_nothing_else() -> None:
    config = Config.exact({"wheel_radius_front": 0.3, "wheel_radius_rear": 0.4, "yaw_inertia": 3000.0})
    prior = unknowns.make_prior(make_default_vehicle(), config)
    at = prior.names.index
    front, rear = at("wheel_radius_front"), at("wheel_radius_rear")
    np.testing.assert_allclose(prior.mean[[front, rear]], [0.3, 0.4])
    np.testing.assert_allclose(prior.low[[front, rear]], [0.27, 0.36])
    np.testing.assert_allclose(prior.high[[front, rear]], [0.33, 0.44])
    np.testing.assert_allclose(prior.sd[[front, rear]], np.hypot(0.003, 0.007) * np.array([0.3, 0.4]))
    assert prior.covariance[front, rear] == pytest.approx(0.007**2 * 0.3 * 0.4)
    x, y = at("accel_x_latency"), at("accel_y_latency")
    assert prior.covariance[x, y] == pytest.approx(0.02**2)
    assert prior.sd[x] == pytest.approx(np.hypot(0.01, 0.02))
    off = prior.covariance - np.diag(np.diag(prior.covariance))
    pairs = {tuple(sorted((prior.names[i], prior.names[k]))) for i, k in np.argwhere(off)}
    assert pairs == {
        ("wheel_radius_front", "wheel_radius_rear"), ("accel_x_latency", "accel_y_latency"),
        ("wheel_speed_front_latency", "wheel_speed_rear_latency"),
    }  # fmt: skip
    assert prior.sd[at("yaw_inertia")] == pytest.approx(300.0)
    stiffness = [at(n) for n in ("cx_front", "cy_front", "cy_rear")]
    np.testing.assert_array_equal(prior.mean[stiffness], 0.0)
    np.testing.assert_allclose(prior.sd[stiffness], 0.5)
    np.testing.assert_array_equal(-prior.low[stiffness], prior.high[stiffness])


def test_an_uncertainty_that_the_file_states_is_a_prior_sd_but_for_errors_in_common() -> None:
    vehicle = make_default_vehicle()
    sds = {"relaxation_sd": 0.1, "steer_offset_sd": 0.0, "yaw_inertia_sd": 0.2, "accel_delay_sd": 0.5}
    vehicle.values |= sds | {"trail_sd": 0.07}
    config = Config.exact({"yaw_inertia": 3000.0})

    def get(given: list[str]) -> dict[str, float]:
        vehicle.given_uncertainty = given
        prior = unknowns.make_prior(vehicle, config)
        return dict(zip(prior.names, prior.sd, strict=True))

    plain, found = get([]), get(list(sds))
    assert found["relaxation_length"] == pytest.approx(0.1)
    assert found["steering_offset_angle"] == pytest.approx(0.01 * plain["steering_offset_angle"])
    assert (plain["yaw_inertia"], found["yaw_inertia"]) == pytest.approx((300.0, 600.0))
    same = set(found) - {"relaxation_length", "steering_offset_angle", "yaw_inertia"}
    assert {n: found[n] for n in same} == {n: plain[n] for n in same}  # also the trail, which is not stated


def test_the_place_of_a_velocity_sensor_is_an_unknown_where_a_velocity_is_measured() -> None:
    """With the sds of the vehicle file; one that is known exactly keeps a small sd."""
    config = Config.exact(
        {"velocity_lever_sd": 0.3, "velocity_heading_sd": 0.0, "velocity_latency_sd": 0.004}
    )
    vehicle = make_default_vehicle()
    vehicle.values |= {"velocity_lever_y": -0.7, "relaxation_length": 99.0}
    prior = unknowns.make_prior(vehicle, config, velocity=True)
    sd = dict(zip(prior.names, prior.sd, strict=True))
    assert sd["velocity_lever_x"] == sd["velocity_lever_y"] == pytest.approx(0.3)
    assert sd["velocity_latency"] == pytest.approx(0.004)
    assert sd["velocity_heading"] == pytest.approx(0.0002)
    assert prior.mean[prior.names.index("velocity_lever_y")] == -0.7
    assert prior.mean[prior.names.index("relaxation_length")] == 3.0  # its bound
    assert not any(n.startswith("velocity") for n in unknowns.make_prior(vehicle, config).names)


def test_an_earlier_calibration_replaces_what_it_has_and_the_rest_is_as_before() -> None:
    vehicle = make_default_vehicle()
    plain = unknowns.make_prior(vehicle, Config.exact())
    vehicle.calibration = {
        "names": ["cy_rear", "nobody", "relaxation_length"],
        "mean": [0.2, 7.0, 0.6],
        "covariance": [[0.01, 0.3, 0.002], [0.3, 9.0, 0.4], [0.002, 0.4, 0.04]],
    }
    prior = unknowns.make_prior(vehicle, Config.exact())
    at = prior.names.index
    k, r = at("cy_rear"), at("relaxation_length")
    assert (prior.mean[k], prior.mean[r]) == (0.2, 0.6)
    np.testing.assert_array_equal(prior.covariance[np.ix_([k, r], [k, r])], [[0.01, 0.002], [0.002, 0.04]])
    others = [n for n in range(len(prior.names)) if n not in (k, r)]
    np.testing.assert_array_equal(prior.mean[others], plain.mean[others])
    np.testing.assert_array_equal(
        prior.covariance[np.ix_(others, others)], plain.covariance[np.ix_(others, others)]
    )


# ---- proposals


def test_a_sweep_passes_from_the_first_to_the_last_frequency_at_a_constant_rate_of_octaves() -> None:
    t = np.linspace(0.0, 40.0, 40_001)
    phase = cumulative_trapezoid(2 * np.pi * 0.2 * (3.0 / 0.2) ** (t / 40.0), t, initial=0.0)
    np.testing.assert_allclose(advice.steer_sweep(t), 0.03 * np.sin(phase), atol=1e-5)
    np.testing.assert_allclose(advice.steer_slalom(t), 0.03 * np.sin(2 * np.pi * 0.6 * t), atol=1e-12)


def test_steps_change_sides_every_four_seconds_within_300_ms_and_begin_to_the_left() -> None:
    t = np.array([0.0, 0.15, 0.3, 2.0, 3.9999, 4.0001, 4.15, 4.3, 6.0, 8.15, 8.225, 8.3])
    expected = [-1, 0, 1, 1, 1, 1, 0, -1, -1, 0, 0.5, 1]
    np.testing.assert_allclose(advice.steer_steps(t), 0.03 * np.array(expected), atol=3e-5)


def make_advised(channels: tuple[str, ...] = ("yaw_rate",)) -> tuple[SimpleNamespace, CarFit]:
    """Return a problem with four unknowns of the car and one of a log, and its fit."""
    names = ("cy_front", "cy_rear", "yaw_inertia", "steer_angle_latency", "yaw_rate~0")
    root = np.random.default_rng(5).standard_normal((9, 5))
    prior = SimpleNamespace(names=[*names[:4], "velocity_latency"])
    slopes = np.array([-2.0, -0.5, 1.0, 1.0, 1.0])  # -1/x of two compliances
    problem = SimpleNamespace(
        names=names, car=4, channels=channels, prior=prior, compute_ln_slope=lambda x: slopes,
        config=SimpleNamespace(yaw_inertia=2000.0),
    )  # fmt: skip
    normal = fit.NormalEquations(root.T @ root, np.zeros(5), np.zeros((0, 5)), np.zeros(0), None)
    return problem, CarFit(np.zeros(5), np.zeros(0), np.eye(5), np.zeros(5), {}, [], ([], []), normal)


def test_intervals_with_a_number_that_is_known_are_those_of_one_more_measurement() -> None:
    """Compare with the update of a covariance by a measurement (Kalman)."""
    problem, ended = make_advised()
    covariance = np.linalg.inv(ended.equations.information)[:4, :4]
    np.testing.assert_allclose(
        np.linalg.inv(advice._compute_car_information(problem, ended)), covariance, rtol=1e-9
    )
    assert advice._list_latencies(problem) == ["steer_angle_latency"]
    for known in (0.002, 0.3):  # compared with 0.3 .. 0.6 from the logs
        after = covariance - np.outer(covariance[3], covariance[3]) / (covariance[3, 3] + known**2)
        found = advice._compute_sd_if_known(problem, ended, ["steer_angle_latency"], known)
        sd = np.sqrt(np.diag(after))
        assert found == pytest.approx({"cy_front": 2.0 * sd[0], "cy_rear": 0.5 * sd[1]})


@pytest.mark.parametrize(
    ("channels", "expected"),
    [
        (
            ("yaw_rate",),
            ["yaw inertia known to 3 %", "40 s of slalom at 65 km/h", "these drives with an INS"],
        ),
        (
            ("yaw_rate", "ins_vel_y"),
            [
                "position of the velocity sensor known to 2 cm",
                "yaw inertia known to 3 %",
                "40 s of slalom at 65 km/h",
            ],
        ),
    ],
)
def test_what_narrows_one_interval_by_a_tenth_is_proposed_cheapest_first(
    monkeypatch, channels, expected
) -> None:
    """Now both sds are 0.1. Latencies and steps leave 0.091 of both, the others narrow
    one axle to 0.089."""
    problem, ended = make_advised(channels)
    asked: list[tuple[list[str], float]] = []

    def know(_problem: object, _fit: object, names: list[str], sd: float) -> dict[str, float]:
        asked.append((names, sd))
        narrow = 0.089 if names[0] != "steer_angle_latency" else 0.091
        return {"cy_front": 0.099, "cy_rear": narrow}

    def drive(_problem: object, _fit: object, steer: object) -> dict[str, float]:
        return {"cy_front": 0.089 if steer is advice.steer_slalom else 0.091, "cy_rear": 0.0999}

    monkeypatch.setattr(advice, "compute_axle_sd", lambda *_: {"cy_front": 0.1, "cy_rear": 0.1})
    monkeypatch.setattr(advice, "_compute_sd_if_known", know)
    monkeypatch.setattr(advice, "compute_sd_after", drive)
    monkeypatch.setattr(advice, "_compute_sd_with_velocity", lambda *_: {"cy_front": 0.01, "cy_rear": 0.01})
    found = advice.list_offers(problem, ended, make_default_vehicle())
    assert [o.what for o in found] == expected
    levers = [(["velocity_lever_x", "velocity_lever_y"], 0.02)] if len(channels) > 1 else []
    assert asked == [(["steer_angle_latency"], 0.002), (["yaw_inertia"], 60.0), *levers]
    head, first, *_ = advice.describe_offers({"cy_front": 0.1, "cy_rear": 0.2}, found)
    assert head.startswith("Cornering stiffness, front and rear: now +- 20 and +- 39 %.")
    assert first == f"  {expected[0]}: +- 19 and +- 17 %"


class Other:
    """Stands in for the CarProblem of further logs: residuals a x + b z + 70."""

    car, knots, knot_sd, groups = 4, 2, 0.5, ((0, "yaw_rate"), (0, "ins_vel_y"))
    names = ("velocity_latency", "cy_rear", "cy_front", "yaw_inertia", "steer_angle_latency", "yaw_rate~0")

    def __init__(self, *given: object):
        rng, n = np.random.default_rng(6), len(self.names)
        self.given, self.asked = given, []
        self.a, self.b = rng.standard_normal((2, 30, n)), rng.standard_normal((2, 30, 2))
        self.mean, self.information = np.arange(10.0, 10.0 + n), np.diag(np.arange(1.0, 1.0 + n))

    def compute_residuals(self, x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        self.asked.append((x, z))
        return [np.full(30, 70.0), np.full(30, 70.0)]

    def compute_slopes(self, x: np.ndarray, z: np.ndarray, base: list[np.ndarray]) -> list[np.ndarray]:
        assert base[0][0] == 70.0
        return list(self.a)

    def compute_road_slopes(self, x: np.ndarray, z: np.ndarray, base: list[np.ndarray]) -> list[csc_matrix]:
        return [csc_matrix(b) for b in self.b]

    def invert(self, sds: tuple[float, float]) -> np.ndarray:
        """Return the covariance of x and z if the residuals of the channels have these
        sds."""
        both = np.concatenate([np.hstack([a, b]) / sd for a, b, sd in zip(self.a, self.b, sds, strict=True)])
        prior = np.append(np.diag(self.information), np.full(2, 4.0))
        return np.linalg.inv(both.T @ both + np.diag(prior))


def test_a_manoeuvre_adds_what_its_residuals_show_of_the_car_and_not_the_prior_again(monkeypatch) -> None:
    """The information of the car with the roads and biases of the manoeuvre unknown."""
    made: list[Other] = []
    monkeypatch.setattr(advice, "CarProblem", lambda *given: made.append(Other(*given)) or made[-1])
    monkeypatch.setattr(advice, "_make_log", lambda problem, steer: ("log of", steer))
    problem, ended = make_advised()
    problem.logs, problem.jobs, problem.information = [], 3, np.diag([0.1, 0.2, 0.3, 0.4, 0.5])
    ended.search = np.arange(1.0, 6.0)
    ended.scales = {"yaw_rate": ResidualScale(0.1, 0.2), "ins_vel_y": ResidualScale(0.3, 0.4)}
    found = advice.compute_sd_after(problem, ended, advice.steer_steps)
    (other,) = made
    assert other.given == ([("log of", advice.steer_steps)], problem.config, problem.prior, 3)
    np.testing.assert_array_equal(other.asked[0][0], [1, 2, 3, 4, 14, 15])  # its own unknowns: the prior
    np.testing.assert_array_equal(other.asked[0][1], [0, 0])
    added = np.linalg.inv(other.invert((0.2, 0.4))[:4, :4]) - np.diag([0.1, 0.2, 0.3, 0.4])
    whole = np.linalg.inv(np.linalg.inv(ended.equations.information)[:4, :4]) + added
    sd = np.sqrt(np.diag(np.linalg.inv(whole)))
    assert found == pytest.approx({"cy_front": 2.0 * sd[0], "cy_rear": 0.5 * sd[1]})


@pytest.mark.parametrize("leans", [0, 2])
def test_a_velocity_has_the_slow_error_of_its_sensor_and_an_unknown_place(monkeypatch, leans: int) -> None:
    """Its residuals are correlated as those of the gyro."""
    made: list[Other] = []
    monkeypatch.setattr(advice, "CarProblem", lambda *given: made.append(Other(*given)) or made[-1])
    monkeypatch.setattr(advice, "make_prior", lambda vehicle, config, velocity: ("prior", velocity))
    problem, ended = make_advised()
    problem.prior.names.remove("velocity_latency")
    time = 0.01 * np.arange(50)
    log = PreparedLog(Path("a.csv"), time, {}, {"yaw_rate": time}, {"yaw_rate": 0.1}, [], 4, time)
    problem.logs, problem.jobs, problem.road, problem.leans = [log, log], 3, "road", leans
    problem.config.ins_velocity_sd = 0.3
    ended.search, ended.z = np.arange(1.0, 6.0), np.array([0.1, 0.2])
    ended.scales = {"accel_y": ResidualScale(5.0, 5.0), "yaw_rate": ResidualScale(0.1, 0.2)}
    found = advice._compute_sd_with_velocity(problem, ended, make_default_vehicle())
    (other,) = made
    logs, *rest = other.given
    assert rest == [problem.config, ("prior", True), 3, "road", leans > 0]
    assert [set(g.measured) for g in logs] == [{"yaw_rate", "ins_vel_y"}] * 2 and set(log.measured) == {
        "yaw_rate"
    }
    assert logs[0].noise == {"yaw_rate": 0.1, "ins_vel_y": 0.0} and len(logs[1].measured["ins_vel_y"]) == 50
    np.testing.assert_array_equal(other.asked[0][0], [10, 2, 1, 3, 4, 5])  # the place: its prior mean
    np.testing.assert_array_equal(other.asked[0][1], ended.z)
    sd = np.sqrt(np.diag(other.invert((0.2, 0.5 * 0.3 * 0.2 / 0.1))))
    assert found == pytest.approx({"cy_front": 2.0 * sd[2], "cy_rear": 0.5 * sd[1]})


def test_the_log_of_a_manoeuvre_has_the_rows_channels_and_noise_of_the_first_log() -> None:
    """At 50 Hz: 2000 rows in blocks of 3, at 18 m/s."""
    time = 0.02 * np.arange(200)
    noise = {"accel_y": 0.07, "yaw_rate": 0.003}
    like = PreparedLog(Path("a.csv"), time, {}, {}, noise, [FitStretch(0, 200, time > 1)], 3, 18 * time)
    config = Config.exact({"wheel_radius_front": 0.3, "wheel_radius_rear": 0.36})
    problem = SimpleNamespace(
        logs=[like, None], config=config, channels=("yaw_rate", "accel_y", "gnss_speed")
    )
    log = advice._make_log(problem, advice.steer_slalom)
    assert len(log.time) == 1998 and log.step == pytest.approx(0.02) and log.rows_per_block == 3
    assert log.time[-1] < advice.MANOEUVRE_TIME and log.noise == noise
    np.testing.assert_allclose(log.inputs["wheel_speed_front"], 60.0)
    np.testing.assert_allclose(log.inputs["wheel_speed_rear"], 50.0)
    np.testing.assert_allclose(log.inputs["steer_angle"], 0.03 * np.sin(1.2 * np.pi * log.time), atol=1e-12)
    np.testing.assert_allclose(log.distance, 18.0 * log.time)
    assert set(log.measured) == {"accel_y", "yaw_rate"} and not log.measured["yaw_rate"].any()
    (stretch,) = log.stretches
    # the first second ends in row 50, in the 17th block of 3 rows
    assert (stretch.first, stretch.last, int(np.argmax(stretch.used))) == (0, 1998, 51)
    assert not stretch.used[:51].any() and stretch.used[51:].all()
