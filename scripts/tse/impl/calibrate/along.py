"""Run the filter over a log."""

import numpy as np

from tse.impl.core import Config, Filter
from tse.impl.rows import Log


def outputs(config: Config, log: Log) -> np.ndarray:
    """Return what the filter makes of a log, a row each."""
    filter_ = Filter(config)
    rows, given = filter_.inputs(len(log)), log.rows()
    for column in rows.dtype.names:
        rows[column] = given[column]
    out = filter_.outputs(len(rows))
    filter_.step_into(rows, out)
    return out
