"""The fit of a set of effects to the logs, as a problem that tse.identify.fit can solve.

The unknowns are the stiffnesses of the axles, the strengths of all effects of the search,
and the shapes of the effects of the set. A strength is the size of an effect. A shape is
any other parameter of an effect, such as a time constant. Effects of the set may have any
size. Effects outside the set are not fixed at 0, because every car has a little of them.
They have a narrow prior about 0, with an sd below their negligible size
(CatalogueParameter.negligible).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from scipy.sparse import csc_matrix

from tse.gaps.catalogue import CatalogueParameter
from tse.gaps.fit import NOISE_LIMIT
from tse.gaps.infer.hypotheses import Hypothesis, choose_start, fit_prior
from tse.gaps.problem import STIFFNESS_PARAMETERS, Problem
from tse.identify.data import BLOCK_TIME, COMPARED_CHANNELS, MIN_FIT_SPEED
from tse.identify.lasting import Piece
from tse.identify.problem import ACTIVE_TIME
from tse.identify.unknowns import COMPLIANCE
from tse.log.noise import compute_moving_average

# prior sd of each stiffness, relative to its value in the vehicle file
STIFFNESS_SD = 0.5
# prior sd of the strength of an effect outside the fitted set of effects (see the top of
# this file), as a multiple of CatalogueParameter.negligible
ABSENT = 0.5
# rms of the error that even the best model has, in units of the noise sd of a residual.
# Noise (rms 1) and this error together have the rms NOISE_LIMIT, the largest residual rms
# with which a model counts as explaining a channel.
LASTING = (NOISE_LIMIT**2 - 1.0) ** 0.5
# Width of the finite differences for effects outside the fitted set, as a multiple of
# CatalogueParameter.step. As a step is 0.02 of the typical size of a parameter, the width
# is 0.3 of the typical size. Effects are nonlinear, so a wide difference describes the
# influence of an effect of typical size better than a narrow one.
REACH = 15.0


class Space:
    """The unknowns, priors and residuals of the fit of one set of effects.

    Parameters
    ----------
    problem
        The logs.
    asked
        All effects of the search, in the set or outside it.
    members
        Ids of the effects of the set.
    lent
        Partial derivatives of the residuals from the fit of a different set, one matrix
        for each group. They are used for the effects that are not in `members`, which
        saves simulations. None: the partial derivatives of all effects are simulated.

    Attributes
    ----------
    parameters, names
        The unknowns x. For a cornering stiffness, x is the inverse of its value.
    groups
        Pairs (index of a log, channel). The residuals of each pair form one vector.
    """

    knots, knot_sd = 0, 1.0  # the roads of the logs are known, so no road profiles are fitted

    def __init__(
        self,
        problem: Problem,
        asked: Sequence[Hypothesis],
        members: Collection[str],
        lent: Sequence[np.ndarray] | None = None,
    ):
        self.problem, self.asked, self.lent = problem, asked, lent
        self.members = frozenset(members)
        self.effects = tuple(h for h in asked if h.id in self.members)
        strengths = [p for h in asked for p in h.effect.strengths]
        shapes = [p for h in self.effects for p in h.effect.shapes]
        self.parameters: tuple[CatalogueParameter, ...] = (
            *STIFFNESS_PARAMETERS,
            *dict.fromkeys(strengths),
            *shapes,
        )
        self.names = tuple(p.name for p in self.parameters)
        self._there = {p.name for h in self.effects for p in h.effect.fitted} | {
            p.name for p in STIFFNESS_PARAMETERS
        }
        self._inverse = np.array([n in COMPLIANCE for n in self.names])
        self.mean, self.sd = self.compute_prior(self.members)
        self.information = np.diag(self.sd**-2)
        ends = np.array([(p.low, p.high) for p in self.parameters], float)
        self.low, self.high = np.sort([self.to_search(e) for e in ends.T], axis=0)
        self._lay_out()

    def compute_prior(self, members: Collection[str]) -> tuple[np.ndarray, np.ndarray]:
        """Return the prior mean and sd that the unknowns have if `members` are the
        effects of the set.

        Shape parameters, such as time constants, have the same prior in the set and
        outside it. For effects outside the set, Around.judge() in search.py replaces this
        prior by a narrow one, to fix their shapes.
        """
        there = {p.name for h in self.asked if h.id in members for p in h.effect.fitted}
        found = []
        for p in self.parameters:
            if p in STIFFNESS_PARAMETERS:
                found.append((1.0, STIFFNESS_SD))
            elif p.name in there or not p.strength:
                found.append(fit_prior(p))
            else:
                found.append((p.default, ABSENT * p.negligible))
        mean, sd = np.array(found).T
        return mean, sd

    def _lay_out(self) -> None:
        rows = self.problem.rows
        self.groups: list[tuple[int, str]] = []
        # for each group, its indices into the residual vector of the problem
        self._rows: list[np.ndarray] = []
        for g in range(int(rows.group.max()) + 1 if len(rows.group) else 0):
            mine = np.flatnonzero((rows.group == g) & (self.problem.weight > 0))
            if len(mine) > 1:
                self.groups.append((int(rows.log[mine[0]]), COMPARED_CHANNELS[rows.channel[mine[0]]]))
                self._rows.append(mine)
        self.channels = tuple(dict.fromkeys(c for _, c in self.groups))
        self.time = [rows.time[mine].astype(float) for mine in self._rows]

    # ---- values

    def to_search(self, values: np.ndarray) -> np.ndarray:
        """Return the unknowns x for these values: the inverse of a cornering stiffness,
        and the value itself for all other parameters.
        """
        return np.where(self._inverse, 1.0 / np.where(self._inverse, values, 1.0), values)

    # Converts the unknowns x to values. It is to_search() again, because 1 / (1 / value)
    # = value. The name comes from CarProblem, where this function returns ln(stiffness);
    # tse.identify.fit calls it for both.
    to_ln = to_search

    def compute_ln_slope(self, x: np.ndarray) -> np.ndarray:
        """Return the derivative of each parameter's value with respect to the unknown."""
        return np.where(self._inverse, -1.0 / np.where(self._inverse, x, 1.0) ** 2, 1.0)

    def values(self, x: np.ndarray) -> dict[str, float]:
        """Return parameter -> value in the simulation, for the unknowns x."""
        return dict(zip(self.names, map(float, self.to_ln(x)), strict=True))

    def at(self, values: Mapping[str, float]) -> np.ndarray:
        """Return the unknowns x at which a fit starts.

        A parameter starts at its value in `values`. Without such a value, it starts at
        choose_start() if its effect is in the set, otherwise at its default. If all
        strengths of an effect of the set are negligible in `values`, they start at
        choose_start(), too.
        """
        there = {p.name for h in self.effects for p in h.effect.fitted}
        values = {p.name: values[p.name] for p in self.parameters if p.name in values}
        for h in self.effects:
            if all(abs(values.get(p.name, p.default) - p.default) < p.negligible for p in h.effect.strengths):
                values = {n: v for n, v in values.items() if n not in {p.name for p in h.effect.strengths}}
        first = [
            values.get(p.name, choose_start(p) if p.name in there else p.default) for p in self.parameters
        ]
        return np.clip(self.to_search(np.array(first)), self.low, self.high)

    # ---- functions that tse.identify.fit calls. `g`: index of a group. `z`: unknowns of
    # ---- the roads, not used here. `base`: residuals at x.

    @staticmethod
    def compute_noise(g: int) -> float:
        """Return the sd of the noise in the residuals: 1, because they are whitened."""
        return 1.0

    @staticmethod
    def get_step(g: int) -> float:
        """Return the time [s] between residuals."""
        return BLOCK_TIME

    @staticmethod
    def compute_lasting_error(channel: str) -> float:
        """Return the rms of the error that even the best model has in a channel, in units
        of the noise. It is the same for all channels.
        """
        return LASTING

    def compute_residuals(self, x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        """Return the residuals of each group, in units of the noise. The bias of the
        group, i.e. the weighted mean of measurement minus simulation, is subtracted.
        """
        whole = self.problem.compute_residuals(self.values(x))
        return [whole[mine] for mine in self._rows]

    def compute_slopes(self, x: np.ndarray, z: np.ndarray, base: list[np.ndarray]) -> list[np.ndarray]:
        """Return the partial derivatives of the residuals with respect to x, one matrix
        for each group.

        If `lent` is given, the columns of the effects outside the set are taken from it
        and not computed at x. This is accurate enough, because the sizes of these effects
        are negligible.
        """
        if self.lent is None:
            return self.compute_own_slopes(x, base)
        found = self._simulate_slopes(x, base, ((1.0, True),))
        mine = np.array([n in self._there for n in self.names])
        for table, other in zip(found, self.lent, strict=True):
            k = np.flatnonzero(~mine[: other.shape[1]])
            table[:, k] = other[:, k]
        return found

    def compute_own_slopes(self, x: np.ndarray, base: list[np.ndarray]) -> list[np.ndarray]:
        """Return the same matrices as compute_slopes(), but simulate all columns, and
        take none from `lent`.
        """
        return self._simulate_slopes(x, base, ((1.0, True), (REACH, False)))

    def _simulate_slopes(
        self, x: np.ndarray, base: list[np.ndarray], parts: Sequence[tuple[float, bool]]
    ) -> list[np.ndarray]:
        """Compute partial derivatives by simulation, and return one matrix for each
        group.

        `parts` has pairs (reach, chosen). The finite differences have the width `reach`
        times CatalogueParameter.step, for stiffnesses and effects of the set if `chosen`
        is True, and for effects outside the set if it is False. Unknowns without a pair
        get a column of 0. `base` are the residuals at x.
        """
        values = self.values(x)
        whole = np.zeros(len(self.problem.weight))
        for mine, residual in zip(self._rows, base, strict=True):
            whole[mine] = residual
        found = np.zeros((len(whole), len(self.names)))
        for reach, chosen in parts:
            of = [k for k, n in enumerate(self.names) if (n in self._there) == chosen]
            found[:, of] = self.problem.compute_jacobian(
                values, whole, [self.parameters[k] for k in of], reach
            )
        found *= self.compute_ln_slope(x)
        return [found[mine] for mine in self._rows]

    # ---- functions that estimate_model_sd() calls (identify/vehicle_file.py), to compute
    # ---- the ratio of model error to signal

    def make_piece(self, g: int, residual: np.ndarray) -> Piece:
        """Return times, moving rms of the signal, and residuals of one channel of one log
        (group `g`).

        The signal is the measurement minus its median, in units of the sd of the noise.
        The window of the moving rms has the length ACTIVE_TIME.
        """
        weight, level = (x[self._rows[g]] for x in (self.problem.weight, self.problem.measured))
        square = compute_moving_average(
            (level - np.median(level)) ** 2, max(1, round(ACTIVE_TIME / BLOCK_TIME))
        )
        return Piece(self.time[g], np.sqrt(square) * weight, residual)

    def compute_unit_yaw_rate(self, g: int) -> np.ndarray:
        """Return, for each residual of a group, the yaw rate of a steady turn with 1 m/s2
        lateral acceleration at the current speed, in units of the noise. Multiplied by a
        limit of the lateral acceleration [m/s2], it gives the limit of the yaw rate.
        """
        problem, rows = self.problem, self._rows[g]
        speed = problem.config.wheel_radius_rear * problem.average_quantity("wheel_speed_rear")[rows]
        return problem.weight[rows] / np.maximum(speed, MIN_FIT_SPEED)

    @staticmethod
    def compute_road_slopes(x: np.ndarray, z: np.ndarray, base: list[np.ndarray]) -> list[csc_matrix]:
        """Return matrices without columns, since there are no unknowns z of the road."""
        return [csc_matrix((len(r), 0)) for r in base]
