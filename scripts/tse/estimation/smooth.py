"""Fixed-interval smoother: the stiffness on a stretch of road, from the filter's means
and sds.

The filter uses the rows up to each row. The smoother adds the rows after it, up to the
end of the stretch. Rows beyond a change are not used, since its report may name the wrong
axle."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import pandas as pd

from tse.library.core import NOMINAL, STIFFNESS, Config

STEP = 0.1  # s: the smoother uses one row, the last, of each such interval
# Min share of a variance that later rows can reduce: the fixed part is known at the end
# only.
MIN_FREE = 0.01

Array = npt.NDArray[np.float64]


def smooth_backward(mean: Array, var: Array, walk: Array) -> tuple[Array, Array]:
    """Smooth a random walk that a Kalman filter has estimated.

    Parameters
    ----------
    mean, var : (n,) array
        Mean and variance after each row, given all rows up to it.
    walk : (n - 1,) array
        Min process variance from each row to the next. Where the filter's variance rises
        by more, that rise is taken.

    Returns
    -------
    mean, var : (n,) array
        Mean and variance, given all rows.

    Notes
    -----
    Rauch, Tung & Striebel (1965): with Q = max(walk, rise of P) and C = P/(P + Q),
    m += C (m' - m), P += C^2 (P' - P - Q). Primes denote the smoothed next row.
    """
    m, p = mean.tolist(), var.tolist()
    opened = np.maximum(walk, np.diff(var)).tolist()
    for i in range(len(m) - 2, -1, -1):
        before = p[i] + opened[i]
        gain = p[i] / before if before > 0 else 0.0
        m[i] += gain * (m[i + 1] - m[i])
        p[i] += gain * gain * (p[i + 1] - before)
    return np.array(m), np.array(p)


def compute_fixed_parts(table: pd.DataFrame, config: Config, parts: Mapping[str, Array]) -> dict[str, float]:
    """Return the part of each stiffness' relative variance that no row changes: model
    error and uncertain parameters of the car.

    Parameters
    ----------
    table : DataFrame
        The whole log, with columns of EST.csv: status, each stiffness.
    config : Config
        Settings of the run.
    parts : mapping
        Filter.uncertainty_sd() at the end.

    Returns
    -------
    dict
        By stiffness. Empty without a row, and for particle filters, which have no random
        walk.
    """
    used = np.flatnonzero(table["status"].to_numpy() >= 0)
    if config.form or not len(used):
        return {}
    ends = {key: float(table[key].iloc[used[-1]]) / getattr(config, NOMINAL[key]) for key in STIFFNESS}
    return {
        key: sum(float(x[a]) ** 2 for x in parts.values()) / ends[key] ** 2 for a, key in enumerate(STIFFNESS)
    }


def smooth_stretch(rows: pd.DataFrame, key: str, config: Config, part: float) -> tuple[float, float]:
    """Return the stiffness on a stretch of road, and the sd of a row drawn at random.

    Parameters
    ----------
    rows : DataFrame
        Rows of the stretch, with columns of EST.csv: time, status, the stiffness and its
        sd.
    key : str
        Which stiffness.
    config : Config
        Settings of the run: steady_walk.
    part : float
        Part of the relative variance that is common to all rows (compute_fixed_parts()).

    Returns
    -------
    tuple
        In the unit of the column; NaN where every row was refused.

    Notes
    -----
    Mean of the smoothed logarithms. Its variance is the mean of the rows' variances plus
    the variance of their means, so it does not shrink with the number of rows.
    """
    used = np.flatnonzero(rows["status"].to_numpy() >= 0)
    last = used[np.flatnonzero(np.diff(np.floor(rows["time"].to_numpy()[used] / STEP), append=np.inf))]
    time, mean, sd = (rows[name].to_numpy()[last].astype(float) for name in ("time", key, f"{key}_sd"))
    if not len(time):
        return float("nan"), float("nan")
    whole = (sd / mean) ** 2
    free = np.maximum(whole - part, MIN_FREE * whole)
    logs, var = smooth_backward(np.log(mean), free, config.steady_walk**2 * np.maximum(np.diff(time), 0.0))
    value = float(np.exp(np.mean(logs)))
    return value, value * float(np.sqrt(np.mean(var + whole - free) + np.var(logs)))
