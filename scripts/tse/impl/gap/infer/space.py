"""The numbers that are fitted for one set of effects, and what they do to the residuals: what tse.impl.identify.fit searches.

Stiffness is the car's, and a little each log's own; effects of the set have wide priors for the search (their sizes are judged
after), shapes the typical ones. What the effects that are named so far do is known to their forms only (forms.py).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tse.impl.gap.catalogue import Key, Own, Parameter
from tse.impl.gap.infer import forms, noise
from tse.impl.gap.infer.forms import AXLES
from tse.impl.gap.infer.hypotheses import Hypothesis, fit_prior
from tse.impl.gap.problem import STIFFNESS, Problem
from tse.impl.identify.data import BLOCK, CHANNELS, SLOWEST
from tse.impl.identify.discrepancy import Discrepancy, Piece
from tse.impl.noise import smooth

STIFFNESS_SD = 0.5  # of the car's over the vehicle file's
OWN_SD = 0.02  # of a log's over the car's: warmth, load, road of one day
LEAST_SIZE = 1.0  # in units of noise: a channel that stands still is not known to a share of nothing
ACTIVE_TIME = 1.0  # s: over which a channel's size is taken
MOST_SHARE = 5.0  # of shapes, in prior sd
# s: of a manoeuvre, all through which a wrong model is wrong in the same way: its residuals say one value of a
# channel
EPISODE = 30.0
FEWEST = 3.0  # such values, also of one short log: it has its manoeuvres, too
UNMOVED = 1.0  # sum of squares in sd, by which residuals may change before their discrepancy is found anew
REACH = 15.0  # steps: a chord over a third of the typical size says more of an effect than its tangent at zero
TINY = 1e-06  # sd of a share that is as good as none


class Layout:
    """Residuals by log and channel, in units of the noise of a block; the same for every set of effects."""

    def __init__(self, problem: Problem):
        self.problem = problem
        rows, window = problem.rows, max(1, round(ACTIVE_TIME / BLOCK))
        self.groups: list[tuple[int, str]] = []
        self.rows: list[np.ndarray] = []  # indices into the residual vector of the problem
        self.time: list[np.ndarray] = []
        self.size: list[np.ndarray] = []
        self.bias: list[np.ndarray] = []
        for g in range(int(rows.group.max()) + 1 if len(rows.group) else 0):
            mine = np.flatnonzero(rows.group == g)
            used = mine[problem.weight[mine] > 0]
            if len(used) < 2:
                continue
            channel = CHANNELS[rows.channel[used[0]]]
            w, y = problem.weight[used], problem.measured[used]
            away = y - np.median(y)
            self.groups.append((int(rows.log[used[0]]), channel))
            self.rows.append(used)
            self.time.append(rows.time[used].astype(float))
            self.size.append(np.maximum(np.sqrt(smooth(away**2, window)) * w, LEAST_SIZE))
            self.bias.append(w / np.median(w))
        self.channels = tuple(dict.fromkeys(c for _, c in self.groups))
        self.one = [np.ones(len(t)) for t in self.time]
        self.power = dict.fromkeys(self.channels, 1.0)
        shapes = [(c, name) for c in self.channels for name in forms.names(c)]
        self.shape_of = np.array([c for c, _ in shapes] + [AXLES] * len(STIFFNESS))
        self.shape_sd = np.array([forms.sd(name) for _, name in shapes] + [TINY] * len(STIFFNESS))
        self.shapes: list[np.ndarray] = [np.zeros((len(t), len(self.shape_sd))) for t in self.time]
        self.by = forms.modulators(problem, {})

    def explains(self, before: list[np.ndarray], after: list[np.ndarray], values: Mapping[str, float]) -> None:
        """What effects do, from residuals without and with them, has these forms only roughly; and where they make tyres act late,
        those of one axle may be later. `values`: with the effects."""
        whole = np.zeros(len(self.problem.rows.log))
        for rows, b, a, bias in zip(self.rows, before, after, self.bias, strict=True):
            change = b - a
            whole[rows] = change - (np.median(change) if bias.any() else 0.0)
        tables = {c: forms.of(self.problem, whole, self.by, c) for c in self.channels if forms.names(c)}
        for g, (rows, (_, channel)) in enumerate(zip(self.rows, self.groups, strict=True)):
            if channel in tables:
                self.shapes[g][:, self.shape_of == channel] = tables[channel][rows]
        rates = np.zeros((len(whole), len(STIFFNESS)))
        for rows, table in zip(self.rows, slopes(self, values, after, STIFFNESS), strict=True):
            rates[rows] = table
        # late by a length, as tyres are; by a time the relaxation of tests.gap.loop gets three names more
        times = forms.RATE_TIME / np.maximum(1.0 + self.by[" v"], SLOWEST / forms.FAST)
        rates = np.column_stack([times * forms.rate(self.problem, x) for x in rates.T])
        for mine, rows in zip(self.shapes, self.rows, strict=True):
            mine[:, self.shape_of == AXLES] = rates[rows]
        used = np.concatenate(self.rows)
        both = rates[used].sum(axis=1)
        late = abs(float(both @ whole[used])) / max(float(both @ both), 1e-300)  # of all tyres, that is most like what effects do
        self.shape_sd[self.shape_of == AXLES] = max(forms.APART * late, TINY)

    def trust(self, left: Mapping[str, noise.Left]) -> None:
        """How much the likelihood of each channel counts, when the best model leaves this: in full while it is noise, as a
        value in an EPISODE when it is the model's error (a coarsened posterior: Miller & Dunson 2019)."""
        for c, x in left.items():
            blocks = sum(len(t) for t, (_, own) in zip(self.time, self.groups, strict=True) if own == c)
            self.power[c] = 1.0 / max(1.0, x.wrong / max(FEWEST, blocks * BLOCK / EPISODE))

    def split(self, vector: np.ndarray) -> list[np.ndarray]:
        return [vector[r] for r in self.rows]


class Space:
    """One set of effects."""

    def __init__(self, layout: Layout, effects: Sequence[Hypothesis], start: Mapping[str, float] | None = None):
        self.layout, self.effects = layout, tuple(effects)
        problem = self.problem = layout.problem
        self.parameters: tuple[Parameter, ...] = (*STIFFNESS, *(p for h in effects for p in h.effect.fitted))
        self.logs = problem.logs
        self.own = [Own(p.name, i) for i in range(len(self.logs)) for p in STIFFNESS] if len(self.logs) > 1 else []
        self.shares = len(self.parameters) + len(self.own)  # where they begin
        self.names = (*(p.name for p in self.parameters), *self.own, *(f"share {k}" for k in range(len(layout.shape_sd))))
        priors = [(1.0, STIFFNESS_SD) if p in STIFFNESS else fit_prior(p) for p in self.parameters]
        priors += [(0.0, OWN_SD)] * len(self.own) + [(0.0, s) for s in layout.shape_sd]
        self.mean, self.sd = (np.array(x) for x in zip(*priors, strict=True))
        self.information = np.diag(self.sd**-2)
        limits = [(p.low, p.high) for p in self.parameters] + [(-5 * OWN_SD, 5 * OWN_SD)] * len(self.own)
        limits += [(-MOST_SHARE * s, MOST_SHARE * s) for s in layout.shape_sd]
        self.low, self.high = (np.array(x, float) for x in zip(*limits, strict=True))
        self.first = np.clip([(start or {}).get(n, m) for n, m in zip(self.names, self.mean, strict=True)], self.low, self.high)
        self.groups, self.time, self.channels, self.power = layout.groups, layout.time, layout.channels, layout.power
        self._found: dict[str, tuple[list[np.ndarray], Discrepancy]] = {}

    def values(self, x: np.ndarray) -> dict[Key, float]:
        """What the simulation takes."""
        return dict(zip(self.names[: self.shares], map(float, x), strict=False))

    def centred(self, x: np.ndarray) -> np.ndarray:
        """The same residuals with stiffnesses of the car about which those of the logs lie: a search that follows its slopes hardly
        moves along what is the car's and that of all logs alike."""
        x, n = x.copy(), len(STIFFNESS)
        own = x[len(self.parameters) : self.shares].reshape(-1, n)
        if len(own):
            mean = np.clip(x[:n] + own.mean(axis=0), self.low[:n], self.high[:n]) - x[:n]
            x[:n] += mean
            own -= mean
        return x

    def piece(self, g: int, residual: np.ndarray) -> Piece:
        layout = self.layout
        return Piece(self.time[g], layout.one[g], layout.size[g], layout.bias[g], residual)

    def pieces(self, residuals: list[np.ndarray], channel: str) -> list[Piece]:
        return [self.piece(g, residuals[g]) for g, (_, c) in enumerate(self.groups) if c == channel]

    def one_at_speed(self, g: int) -> np.ndarray:
        """Yaw rate of 1 m/s2 across, in units of the noise of a block."""
        problem, rows = self.problem, self.layout.rows[g]
        speed = problem.config.wheel_radius_rear * problem.quantity("wheel_speed_rear")[rows]
        return problem.weight[rows] / np.maximum(speed, SLOWEST)

    def knows(self, found: Mapping[str, Discrepancy], residuals: list[np.ndarray]) -> None:
        """Discrepancies that are the most probable ones of such residuals."""
        for c, d in found.items():
            self._found[c] = [r for r, (_, own) in zip(residuals, self.groups, strict=True) if own == c], d

    def found(self, pieces: Sequence[Piece], start: Discrepancy | None, far: bool = False) -> Discrepancy:
        """The most probable discrepancy of a channel; as it was, while its residuals have hardly moved. `far` is nothing here: the
        prior of the slow part is proper."""
        channel = next((c for c, (_, d) in self._found.items() if d is start), None)
        if channel is None:
            return noise.found(pieces, start)
        before, d = self._found[channel]
        moved = [replace(p, residual=p.residual - r) for p, r in zip(pieces, before, strict=True)]
        if sum(float(np.sum(d.whiten(m, m.residual[:, None])[0] ** 2)) for m in moved) < UNMOVED:
            return d
        d = noise.found(pieces, start)
        self._found[channel] = [p.residual for p in pieces], d
        return d

    def cost(self, d: Discrepancy, pieces: Sequence[Piece]) -> float:
        return -noise.worth(d, noise.Series.of(pieces))

    def physical(self, x: np.ndarray) -> list[np.ndarray]:
        """Residuals without what shapes of forms explain."""
        return self.layout.split(raw(self.problem, self.values(x)))

    def residuals(self, x: np.ndarray) -> list[np.ndarray]:
        return [r - u @ x[self.shares :] for r, u in zip(self.physical(x), self.layout.shapes, strict=True)]

    def slopes(self, x: np.ndarray, base: list[np.ndarray]) -> list[np.ndarray]:
        """d(residuals)/dx, a matrix per group. The stiffness of a log acts as the car's does, there alone."""
        without = [r + u @ x[self.shares :] for r, u in zip(base, self.layout.shapes, strict=True)]
        car = slopes(self.layout, self.values(x), without, self.parameters)
        found = []
        for table, (i, _), add in zip(car, self.groups, self.layout.shapes, strict=True):
            wide = np.zeros((len(table), len(self.names)))
            wide[:, : table.shape[1]] = table
            if self.own:
                first = len(self.parameters) + len(STIFFNESS) * i
                wide[:, first : first + len(STIFFNESS)] = table[:, : len(STIFFNESS)]
            wide[:, self.shares :] = -add
            found.append(wide)
        return found


def raw(problem: Problem, values: Mapping[str, float]) -> np.ndarray:
    """Measured less predicted in units of the noise; biases are in it."""
    return problem.weight * np.nan_to_num(problem.measured - problem.predict(values))


def slopes(
    layout: Layout, values: Mapping[str, float], base: list[np.ndarray], parameters: Sequence[Parameter], reach: float = 1.0
) -> list[np.ndarray]:
    """Slopes of raw() over parameters by differences of `reach` times their steps."""
    problem, found = layout.problem, [np.zeros((len(b), len(parameters))) for b in base]
    for run, predicted in problem.moved(values, parameters, reach):
        ((k, h),) = run.items()
        moved = layout.split(problem.weight * np.nan_to_num(problem.measured - predicted))
        for table, m, b in zip(found, moved, base, strict=True):
            table[:, k] = (m - b) / h
    return found
