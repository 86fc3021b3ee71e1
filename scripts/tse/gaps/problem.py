"""Compare the measurements of all logs with a simulation. A residual is the difference
between measurement and simulation, minus the bias of the sensor, divided by the sd of the
sensor noise.

Measurements and simulation are averaged over blocks of 40 ms before they are compared.
The sd is that of the noise in such a mean. So with a perfect model the residuals have
variance 1.

A stiffness or a parameter of an effect has one value for all logs. The bias of a sensor
has one value for each log. The residuals are linear in the bias. So the bias needs no
iteration: it is the weighted mean of measurement minus simulation.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from tse.gaps.catalogue import CatalogueParameter, Effect, Key, Own, drop_log_values, list_signed_delays
from tse.gaps.parallel import is_copy
from tse.identify.data import COMPARED_CHANNELS, PreparedLog, average_blocks, simulate
from tse.identify.knots import KNOT_DISTANCE, KNOT_SD, PROFILES
from tse.library.core import NOMINAL, Config
from tse.log.rows import MEASURES

# The stiffness parameters: ratio of each stiffness to its value in the vehicle file
STIFFNESS_PARAMETERS = tuple(
    CatalogueParameter(
        name, name, True, "1", 1.0, 0.1, 5.0, 0.5, 2.0, 0.02, 1, f"{name} / its value in the vehicle file"
    )
    for name in NOMINAL
)


# Names of the latencies [s] that a fit may add to the latencies of the vehicle file. Such
# a latency is not a setting of the simulation (make_config()). Instead, the channel is
# shifted in time by this latency (get_latencies()).
LATENT = frozenset(("wheel_speed_latency", "accel_x_latency", "accel_y_latency"))


@dataclass(frozen=True)
class Rows:
    """Log, channel and time of each entry of a residual vector. The vector has one entry
    for each block of each channel of each log.
    """

    log: np.ndarray  # index of the log
    channel: np.ndarray  # index in COMPARED_CHANNELS
    time: np.ndarray  # [s] mean time of the block
    block: np.ndarray  # index of the block; the channels of a log share the indices
    group: np.ndarray  # index of the pair (log, channel); each pair has its own bias

    def of(self, channel: str) -> np.ndarray:
        """Return a mask that is True for the entries of this channel."""
        return self.channel == COMPARED_CHANNELS.index(channel)


class Problem:
    """Logs, a car, and the comparison of the logs with simulations of this car. Several
    threads may simulate at the same time, because simulations change no common data.
    """

    def __init__(self, logs: Sequence[PreparedLog], config: Config, jobs: int = 1):
        self.logs = [log for log in logs if log.stretches]
        self.notes = [n for log in logs for n in log.notes]
        self.config = config
        self.jobs = max(1, jobs)
        # Values that replace values of the vehicle file, but are not fitted
        self.fixed: dict[Key, float] = {}
        self.nominal = config.as_dict()
        self.given = {name: self.nominal[name] for name in list_signed_delays()}
        if self.logs:  # the drift of the effect stiffness_drift lasts as long as the longest log
            self.nominal["stiffness_drift_time"] = max(float(log.time[-1] - log.time[0]) for log in self.logs)
        missing = [
            {c: ~np.isfinite(log.measured[c]) for c in MEASURES if c in log.measured} for log in self.logs
        ]
        self._missing = [{c: rows for c, rows in log.items() if rows.any()} for log in missing]
        self._measured, self.weight, self.rows = self._lay_out_rows()
        self.noise_energy = self._compute_noise_energy()
        self._groups = int(self.rows.group.max()) + 1 if len(self.rows.group) else 0

    def of(self, logs: Sequence[PreparedLog]) -> Problem:
        """Return a problem with the same car and different logs."""
        return Problem(logs, self.config, self.jobs)

    def holding(self, values: Mapping[Key, float]) -> Problem:
        """Return a copy of the problem in which these values are fixed, not fitted."""
        other = copy.copy(self)
        other.fixed = self.fixed | dict(values)
        return other

    def measure(self, values: Mapping[Key, float]) -> None:
        """Replace the measurements by a simulation of a car with these values.

        Noise with a thousandth of the sd of the sensor noise is added, so that a fit
        ends: it ends when the relative change of its sum of squares is small. Without
        noise, each iteration would reduce the sum by a large factor, towards 0.
        """
        noise = np.random.default_rng(0).standard_normal(len(self.weight))
        self._measured = self.predict(values) + np.where(
            self.weight > 0, 0.001 * noise / np.maximum(self.weight, 1e-300), 0.0
        )

    # ---- parameters

    def strengths(self, effect: Effect) -> tuple[CatalogueParameter, ...]:
        """Return the strengths of an effect, i.e. its parameters that state a size
        (CatalogueParameter). For bank or grade, these are the values of the profile at
        all knots of all logs.
        """
        if effect.id not in PROFILES:
            return effect.strengths
        p, prior = effect.strengths[0], KNOT_SD
        return tuple(
            CatalogueParameter(
                Own(effect.id, i, k),
                "profile",
                True,
                p.unit,
                0.0,
                p.low,
                p.high,
                0.0,
                prior,
                p.negligible,
                0,
                f"{p.text}, {self.logs[i].name} at {KNOT_DISTANCE * k:g} m",
                prior,
            )
            for i in range(len(self.logs))
            for k in range(self._count_knots(i))
        )

    def _count_knots(self, i: int) -> int:
        return int(self.logs[i].distance[-1] // KNOT_DISTANCE) + 2

    # ---- layout

    def _lay_out_rows(self) -> tuple[np.ndarray, np.ndarray, Rows]:
        measured, weight, columns, group, block = [], [], [], 0, 0
        for i, log in enumerate(self.logs):
            time, _ = average_blocks(log, log.time)
            for channel in log.channels:
                mean, count = average_blocks(log, log.measured[channel])
                measured.append(mean)
                variance = log.noise[channel] ** 2 / np.maximum(count, 1)
                # Median number of measured values in a block. Blocks with at most half
                # as many values get the weight 0.
                usual = float(np.median(count[count > 0])) if count.any() else 1.0
                weight.append(np.where(count > 0.5 * usual, 1.0 / np.sqrt(variance), 0.0))
                n = len(mean)
                columns.append(
                    (
                        np.full(n, i),
                        np.full(n, COMPARED_CHANNELS.index(channel)),
                        time,
                        block + np.arange(n),
                        np.full(n, group),
                    )
                )
                group += 1
            block += len(time)
        rows = (
            Rows(*(np.concatenate(c) for c in zip(*columns, strict=True)))
            if columns
            else Rows(*(np.zeros(0, int),) * 5)
        )
        y = np.concatenate(measured) if measured else np.zeros(0)
        w = np.concatenate(weight) if weight else np.zeros(0)
        return np.where(w > 0, y, 0.0), w, rows

    def _compute_noise_energy(self) -> np.ndarray:
        """Return the expected square of each residual if it is sensor noise only.

        The expected square is 1. If the noise sd of a channel was below a lower limit and
        was raised to this limit, the expected square is less than 1, because residuals
        are divided by the raised sd.
        """
        quiet = [q for log in self.logs for c in log.channels for q in [log.quiet.get(c, 1.0)]]
        return np.where(self.weight > 0, np.array(quiet)[self.rows.group] ** 2, 0.0) if quiet else np.zeros(0)

    def used(self) -> Iterator[tuple[str, np.ndarray]]:
        """Yield the name of each channel, and a mask over the residual vector: True for
        the blocks of this channel that have enough measured values (weight > 0).
        """
        for c in np.unique(self.rows.channel):
            yield COMPARED_CHANNELS[c], (self.rows.channel == c) & (self.weight > 0)

    @property
    def measured(self) -> np.ndarray:
        """The measurements, one for each entry of the residual vector. NaN: missing."""
        return np.where(self.weight > 0, self._measured, np.nan)

    def average_quantity(self, name: str) -> np.ndarray:
        """Return the block means of an input or a measurement, one for each entry of the
        residual vector: the means of a log are repeated for each of its channels.
        """
        parts = []
        for log in self.logs:
            x = log.inputs.get(name, log.measured.get(name))
            mean, count = average_blocks(log, x)
            parts.extend([np.where(count > 0, mean, np.nan)] * len(log.channels))
        return np.concatenate(parts)

    # ---- residuals

    def make_config(self, values: Mapping[Key, float]) -> Config:
        """Return the settings of the simulation with these values of the parameters.

        Stiffnesses, latencies and delays in `values` do not change the settings.
        simulate() gets them as separate arguments, which get_stiffness_ratios() and
        get_latencies() compute from `values`.
        """
        values = drop_log_values(self.fixed | dict(values))
        others = {*NOMINAL, *LATENT, *list_signed_delays()}
        return Config.exact(self.nominal | {k: v for k, v in values.items() if k not in others})

    def get_stiffness_ratios(self, values: Mapping[Key, float]) -> dict[str, float]:
        """Return the ratio of each stiffness to its value in the vehicle file."""
        values = self.fixed | dict(values)
        return {k: values.get(k, 1.0) for k in NOMINAL}

    def get_latencies(self, values: Mapping[Key, float]) -> dict[str, float]:
        """Return for each channel the latency [s] that is added to its latency in the
        vehicle file.

        A channel with the latency L has at time t the value of t - L. So an input of the
        simulation that has the latency L is read from the log at t + L.

        Fitted delays become latencies of the inputs. D is the fitted delay minus the
        delay in the vehicle file.

        IMU: its values at time t belong to the inputs at t - D. So all inputs (steering
        angle and wheel speeds) get the latency -D.
        Steering: the wheels have at time t the angle that was logged at t - D. So the
        steering angle gets the latency -D.
        """
        values = self.fixed | dict(values)
        if LATENT.isdisjoint(values) and list_signed_delays().isdisjoint(values):
            return {}
        imu = values.get("imu_delay_time", self.given["imu_delay_time"]) - self.given["imu_delay_time"]
        steering = (
            values.get("steering_delay_time", self.given["steering_delay_time"])
            - self.given["steering_delay_time"]
        )
        wheels = values.get("wheel_speed_latency", 0.0)
        found = {
            "steer_angle": -imu - steering,
            "wheel_speed_front": wheels - imu,
            "wheel_speed_rear": wheels - imu,
        }
        return found | {c: values.get(f"{c}_latency", 0.0) for c in ("accel_x", "accel_y")}

    def interpolate_profiles(self, values: Mapping[Key, float], i: int) -> dict[str, np.ndarray]:
        """Return bank and grade [rad] in each row of the log with index i, interpolated
        linearly between the knots. A profile whose values are all 0 is left out.
        """
        values = self.fixed | dict(values)
        found = {}
        # `own` has the values at the knots of this log. Mostly there are none. Then the
        # loop is skipped, because this function is called often.
        own = [k for k in values if isinstance(k, Own) and k.log == i]
        for effect in PROFILES if own else ():
            knots = [values.get(Own(effect, i, k), 0.0) for k in range(self._count_knots(i))]
            if any(knots):
                found[effect] = np.interp(self.logs[i].distance, KNOT_DISTANCE * np.arange(len(knots)), knots)
        return found

    def predict(self, values: Mapping[Key, float]) -> np.ndarray:
        """Return the block means of the simulated measurements, one for each entry of the
        residual vector. They contain no sensor bias.
        """
        config, later, parts = self.make_config(values), self.get_latencies(values), []
        for i, log in enumerate(self.logs):
            simulated = simulate(
                config,
                log,
                log.channels,
                self.get_stiffness_ratios(values),
                self.interpolate_profiles(values, i),
                later,
            )
            for channel in log.channels:  # means over the rows in which the channel was measured
                missing = self._missing[i].get(channel)
                x = simulated[channel] if missing is None else np.where(missing, np.nan, simulated[channel])
                parts.append(average_blocks(log, x)[0])
        return np.concatenate(parts)

    def predict_all(self, asked: Sequence[Mapping[Key, float]]) -> list[np.ndarray]:
        """Return the result of predict() for each set of values in `asked`, computed in
        up to `jobs` threads.
        """
        if self.jobs == 1 or len(asked) < 2 or is_copy():
            return [self.predict(values) for values in asked]
        # Threads run in parallel here, because the library releases Python's global
        # interpreter lock while it simulates.
        with ThreadPoolExecutor(self.jobs) as pool:
            return list(pool.map(self.predict, asked))

    def simulate_channels(self, values: Mapping[Key, float], names: Sequence[str]) -> dict[str, np.ndarray]:
        """Return the block means of simulated quantities, one for each entry of the
        residual vector: the means of a log are repeated for each of its channels.
        """
        config = self.make_config(values)
        later = self.get_latencies(values)
        parts: dict[str, list[np.ndarray]] = {n: [] for n in names}
        for i, log in enumerate(self.logs):
            predicted = simulate(
                config,
                log,
                names,
                self.get_stiffness_ratios(values),
                self.interpolate_profiles(values, i),
                later,
            )
            for n in names:
                parts[n].extend([average_blocks(log, predicted[n])[0]] * len(log.channels))
        return {n: np.concatenate(p) for n, p in parts.items()}

    def compute_residuals(self, values: Mapping[Key, float]) -> np.ndarray:
        """Return the whitened residuals: (measured - simulated - bias) / sd of noise."""
        return self.whiten(self._measured - self.predict(values))

    def whiten(self, difference: np.ndarray) -> np.ndarray:
        """Subtract the bias of each log and channel, and divide by the sd of noise."""
        return self.weight * self.subtract_bias(difference)

    def subtract_bias(self, difference: np.ndarray) -> np.ndarray:
        """Subtract the bias of each log and channel: the weighted mean of its entries."""
        w2 = self.weight**2
        total = np.bincount(self.rows.group, w2, self._groups)
        mean = np.bincount(self.rows.group, w2 * difference, self._groups) / np.maximum(total, 1e-300)
        return difference - mean[self.rows.group]

    def generate_moves(
        self, values: Mapping[Key, float], parameters: Sequence[CatalogueParameter], reach: float = 1.0
    ) -> Iterator[tuple[dict[int, float], np.ndarray]]:
        """Simulate with changed parameters, for finite differences. Yield a pair for each
        simulation. The first is a dict, index of a changed parameter -> its change. The
        second is the result of predict().

        A change is `reach` times the step of the parameter. Each simulation changes one
        parameter, or one knot of a road profile in every log: a knot influences only the
        residuals of its own log.
        """

        def shifted(p: CatalogueParameter) -> float:
            x, h = values.get(p.name, p.default), reach * p.step
            return h if p.low <= x + h <= p.high else -h

        runs: dict[Key | tuple[str, int | None], dict[int, float]] = {}
        for j, p in enumerate(parameters):
            key = (p.name.of, p.name.knot) if isinstance(p.name, Own) else p.name
            runs.setdefault(key, {})[j] = shifted(p)
        names = [(p.name, values.get(p.name, p.default)) for p in parameters]
        asked = [
            dict(values) | {names[j][0]: names[j][1] + h for j, h in run.items()} for run in runs.values()
        ]
        yield from zip(runs.values(), self.predict_all(asked), strict=True)

    def compute_jacobian(
        self,
        values: Mapping[Key, float],
        base: np.ndarray,
        parameters: Sequence[CatalogueParameter],
        reach: float = 1.0,
    ) -> np.ndarray:
        """Return the partial derivatives of the whitened residuals with respect to the
        parameters, by finite differences over `reach` times the step of each parameter.

        `base` are the whitened residuals at `values`.
        """
        slopes = np.zeros((len(base), len(parameters)))
        for run, predicted in self.generate_moves(values, parameters, reach):
            change = self.whiten(self._measured - predicted) - base
            for j, h in run.items():
                name = parameters[j].name
                mine = self.rows.log == name.log if isinstance(name, Own) else slice(None)
                slopes[mine, j] = change[mine] / h
        return slopes
