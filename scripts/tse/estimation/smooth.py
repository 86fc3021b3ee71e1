"""Fixed-interval smoother: compute the stiffness on a stretch of road from the means and
sds of the filter.

The filter's estimate in a row uses only the rows up to this one. The smoother also uses
the later rows of the stretch. It does not use rows after the next change of the
stiffness. After a change, the filter may attribute the new stiffness of one axle to the
other axle. Smoothing across the change would carry this error back into the stretch."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import pandas as pd

from tse.library.core import NOMINAL, STIFFNESS, Config

SMOOTHING_STEP = 0.1  # [s] the smoother uses the last row of each interval of this length
# A part of the variance of a stiffness is common to all rows, e.g. from an uncertain
# mass. Later rows reduce only the rest: the variance in the row minus the common part.
# The common part is computed at the end of the log (compute_fixed_parts()), and may
# exceed the variance in a row. So the rest is taken as at least MIN_FREE times the
# variance.
MIN_FREE = 0.01

Array = npt.NDArray[np.float64]


def smooth_backward(mean: Array, var: Array, walk: Array) -> tuple[Array, Array]:
    """Smooth a random walk that a Kalman filter has estimated.

    Parameters
    ----------
    mean, var : (n,) array
        Mean and variance of the filter in each row, given the rows up to this one.
    walk : (n - 1,) array
        Variance that the random walk adds from each row to the next. If the filter's
        variance rises by more than this between two rows, the rise is used instead.

    Returns
    -------
    mean, var : (n,) array
        Mean and variance in each row, given all rows.

    Notes
    -----
    Rauch, Tung & Striebel (1965): with Q = max(walk, rise of P) and C = P/(P + Q),
    m += C (m' - m) and P += C^2 (P' - P - Q). m and P are the filter's mean and variance
    in a row. m' and P' are the smoothed mean and variance in the next row.
    """
    m, p = mean.tolist(), var.tolist()
    q = np.maximum(walk, np.diff(var)).tolist()
    for i in range(len(m) - 2, -1, -1):
        predicted = p[i] + q[i]
        gain = p[i] / predicted if predicted > 0 else 0.0
        m[i] += gain * (m[i + 1] - m[i])
        p[i] += gain * gain * (p[i + 1] - predicted)
    return np.array(m), np.array(p)


def compute_fixed_parts(table: pd.DataFrame, config: Config, parts: Mapping[str, Array]) -> dict[str, float]:
    """Return, for each stiffness, the part of its variance that further measurements do
    not reduce, divided by the square of the stiffness in the last row that was not
    refused. This part is caused by uncertain parameters of the car and by model error
    (setting model_sd).

    Parameters
    ----------
    table : DataFrame
        Estimates of the whole log: status and each stiffness, as in EST.csv.
    config : Config
        Settings of the run.
    parts : mapping
        Setting such as mass_sd or model_sd -> sds that this uncertainty causes in the
        three stiffnesses, relative to the nominal stiffness: the result of
        Filter.uncertainty_sd() after the last row.

    Returns
    -------
    dict
        Stiffness -> relative variance. Empty if all rows were refused (status below 0).
        Also empty for particle filters, because their stiffness is not a random walk and
        cannot be smoothed by smooth_backward().
    """
    used = np.flatnonzero(table["status"].to_numpy() >= 0)
    if config.form or not len(used):
        return {}
    ends = {key: float(table[key].iloc[used[-1]]) / getattr(config, NOMINAL[key]) for key in STIFFNESS}
    return {
        key: sum(float(x[a]) ** 2 for x in parts.values()) / ends[key] ** 2 for a, key in enumerate(STIFFNESS)
    }


def smooth_stretch(rows: pd.DataFrame, key: str, config: Config, part: float) -> tuple[float, float]:
    """Return the smoothed stiffness on a stretch of road, and the sd of the stiffness in
    a randomly chosen row of the stretch.

    Parameters
    ----------
    rows : DataFrame
        Estimates on the stretch: time, status, the stiffness and its sd, as in EST.csv.
    key : str
        Key of the stiffness in STIFFNESS.
    config : Config
        Settings of the run. Only steady_walk [1/sqrt(s)] is used: the sd by which ln of
        the stiffness changes in 1 s (random walk).
    part : float
        Part of the relative variance that is common to all rows, so that smoothing does
        not reduce it (compute_fixed_parts()).

    Returns
    -------
    tuple
        Stiffness and sd in the unit of the column. NaN if every row was refused.

    Notes
    -----
    ln of the stiffness is smoothed, and the returned stiffness is exp of the mean over
    the rows. The variance is the mean of the smoothed variances plus the variance of the
    smoothed means over the rows. So the variance does not decrease with the number of
    rows.
    """
    used = np.flatnonzero(rows["status"].to_numpy() >= 0)
    last = used[
        np.flatnonzero(np.diff(np.floor(rows["time"].to_numpy()[used] / SMOOTHING_STEP), append=np.inf))
    ]
    time, mean, sd = (rows[name].to_numpy()[last].astype(float) for name in ("time", key, f"{key}_sd"))
    if not len(time):
        return float("nan"), float("nan")
    whole = (sd / mean) ** 2
    free = np.maximum(whole - part, MIN_FREE * whole)
    logs, var = smooth_backward(np.log(mean), free, config.steady_walk**2 * np.maximum(np.diff(time), 0.0))
    value = float(np.exp(np.mean(logs)))
    return value, value * float(np.sqrt(np.mean(var + whole - free) + np.var(logs)))
