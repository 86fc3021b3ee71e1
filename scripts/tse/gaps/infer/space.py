"""The logs of a gap with a set of effects, as tse.identify.fit takes a problem.

Unknown are the stiffness of the axles, the strengths of all effects that are asked, and
the shapes of those of the set. An effect of the set may have any size; one that is not in
the set may have a size that does not matter (Parameter.negligible): no car is without it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from scipy.sparse import csc_matrix

from tse.gaps.catalogue import CatalogueParameter
from tse.gaps.fit import NOISE_LIMIT
from tse.gaps.infer.hypotheses import Hypothesis, choose_start, fit_prior
from tse.gaps.problem import STIFFNESS, Problem
from tse.identify.data import BLOCK_TIME, COMPARED_CHANNELS, MIN_FIT_SPEED
from tse.identify.lasting import Piece
from tse.identify.problem import ACTIVE_TIME
from tse.identify.unknowns import COMPLIANCE
from tse.log.noise import compute_moving_average

STIFFNESS_SD = 0.5  # of the car's over the vehicle file's
# sd of the strength of an effect that is not there, over the size that is negligible
ABSENT = 0.5
# of the noise of a block: the error of any model, rms
LASTING = (NOISE_LIMIT**2 - 1.0) ** 0.5
# steps: a chord over a third of the typical size says more of an effect than its tangent
# at zero
REACH = 15.0


class Space:
    """One set of effects.

    Parameters
    ----------
    problem
        The logs.
    asked
        Effects that may be there.
    members
        Ids of those that are.
    lent
        Slopes of another set of the same effects, by group: those of effects that are not
        in this set are taken from there. None: they are simulated.

    Attributes
    ----------
    parameters, names
        Unknowns. Cornering stiffness is searched as its inverse.
    groups
        Log and channel of each vector of residuals.
    """

    knots, knot_sd = 0, 1.0  # the roads of the logs are known

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
        self.parameters: tuple[CatalogueParameter, ...] = (*STIFFNESS, *dict.fromkeys(strengths), *shapes)
        self.names = tuple(p.name for p in self.parameters)
        self._there = {p.name for h in self.effects for p in h.effect.fitted} | {p.name for p in STIFFNESS}
        self._inverse = np.array([n in COMPLIANCE for n in self.names])
        self.mean, self.sd = self.prior(self.members)
        self.information = np.diag(self.sd**-2)
        ends = np.array([(p.low, p.high) for p in self.parameters], float)
        self.low, self.high = np.sort([self.to_search(e) for e in ends.T], axis=0)
        self._lay_out()

    def prior(self, members: Collection[str]) -> tuple[np.ndarray, np.ndarray]:
        """Return mean and sd of the unknowns with another set of effects; shapes of
        effects that it lacks do not count.
        """
        there = {p.name for h in self.asked if h.id in members for p in h.effect.fitted}
        found = []
        for p in self.parameters:
            if p in STIFFNESS:
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
        # indices into the residual vector of the problem
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
        """Return the unknowns as they are searched."""
        return np.where(self._inverse, 1.0 / np.where(self._inverse, values, 1.0), values)

    to_ln = to_search  # its own inverse; the unknowns of a gap are no logarithms

    def compute_ln_slope(self, x: np.ndarray) -> np.ndarray:
        """Return d(values)/dx, of each by itself."""
        return np.where(self._inverse, -1.0 / np.where(self._inverse, x, 1.0) ** 2, 1.0)

    def values(self, x: np.ndarray) -> dict[str, float]:
        """Return what the simulation takes."""
        return dict(zip(self.names, map(float, self.to_ln(x)), strict=True))

    def at(self, values: Mapping[str, float]) -> np.ndarray:
        """Return x of values; what they lack begins at its default, an effect of the set
        that they do not have a little off it.
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

    # ---- what the fit asks

    @staticmethod
    def compute_noise(g: int) -> float:
        """Return it of a residual: these are in its units."""
        return 1.0

    @staticmethod
    def get_step(g: int) -> float:
        """Return the time [s] between residuals."""
        return BLOCK_TIME

    @staticmethod
    def compute_lasting_error(channel: str) -> float:
        """Return the part of the residuals, rms, that is no noise of any model."""
        return LASTING

    def compute_residuals(self, x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        """Return residuals without bias by group, in units of the noise."""
        whole = self.problem.residuals(self.values(x))
        return [whole[mine] for mine in self._rows]

    def compute_slopes(self, x: np.ndarray, z: np.ndarray, base: list[np.ndarray]) -> list[np.ndarray]:
        """Return d(residuals)/dx, a matrix per group.

        What is lent follows `x` no further: what is not there has a size that does not
        matter.
        """
        if self.lent is None:
            return self.own_slopes(x, base)
        found = self._simulate_slopes(x, base, ((1.0, True),))
        mine = np.array([n in self._there for n in self.names])
        for table, other in zip(found, self.lent, strict=True):
            k = np.flatnonzero(~mine[: other.shape[1]])
            table[:, k] = other[:, k]
        return found

    def own_slopes(self, x: np.ndarray, base: list[np.ndarray]) -> list[np.ndarray]:
        """Return the same with nothing lent."""
        return self._simulate_slopes(x, base, ((1.0, True), (REACH, False)))

    def _simulate_slopes(
        self, x: np.ndarray, base: list[np.ndarray], parts: Sequence[tuple[float, bool]]
    ) -> list[np.ndarray]:
        """Return slopes over a reach of what is there (True), or is not; nothing of the
        others.
        """
        values = self.values(x)
        whole = np.zeros(len(self.problem.weight))
        for mine, residual in zip(self._rows, base, strict=True):
            whole[mine] = residual
        found = np.zeros((len(whole), len(self.names)))
        for reach, chosen in parts:
            of = [k for k, n in enumerate(self.names) if (n in self._there) == chosen]
            found[:, of] = self.problem.jacobian(values, whole, [self.parameters[k] for k in of], reach)
        found *= self.compute_ln_slope(x)
        return [found[mine] for mine in self._rows]

    # ---- what lasts of residuals

    def make_piece(self, g: int, residual: np.ndarray) -> Piece:
        """Return residuals of a group with the size of their channel."""
        weight, level = (x[self._rows[g]] for x in (self.problem.weight, self.problem.measured))
        square = compute_moving_average(
            (level - np.median(level)) ** 2, max(1, round(ACTIVE_TIME / BLOCK_TIME))
        )
        return Piece(self.time[g], np.sqrt(square) * weight, residual)

    def compute_unit_yaw_rate(self, g: int) -> np.ndarray:
        """Return the yaw rate of 1 m/s2 across, in units of the noise."""
        problem, rows = self.problem, self._rows[g]
        speed = problem.config.wheel_radius_rear * problem.quantity("wheel_speed_rear")[rows]
        return problem.weight[rows] / np.maximum(speed, MIN_FIT_SPEED)

    @staticmethod
    def compute_road_slopes(x: np.ndarray, z: np.ndarray, base: list[np.ndarray]) -> list[csc_matrix]:
        """Return d(residuals)/dz: there is no z."""
        return [csc_matrix((len(r), 0)) for r in base]
