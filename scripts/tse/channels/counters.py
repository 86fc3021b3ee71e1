"""Find the modulo of message counters."""

import numpy as np

# [1] Min share of the steps of a counter that are +1. The step from its highest value
# back to its lowest value is taken as +1, too.
MIN_COUNTING_SHARE = 0.8
# find_modulo() tries these moduli, and then max - min + 1 of the logged counter values.
USUAL_MODULI = (4, 8, 16, 32, 64, 256, 65536)


def find_modulo(counter: np.ndarray) -> int:
    """Return the modulo of a counter, i.e. the number of steps until its values repeat.

    Parameters
    ----------
    counter : ndarray, (entries,)
        Values of the counter, one per message. NaN: missing.

    Returns
    -------
    int
        Modulo. 0: the signal is not a counter.

    Notes
    -----
    The modulo need not be a power of 2, since a counter may leave out its highest value,
    or 0. For example, counters with the values 0 .. 14 or 1 .. 15 have the modulo 15. If
    several moduli fit equally well, a power of 2 is returned.
    """
    there = counter[np.isfinite(counter)]
    if len(there) < 2 or there.min() < 0:
        return 0
    own = int(there.max() - there.min()) + 1
    step = np.diff(there)
    best, share = 0, MIN_COUNTING_SHARE
    for modulo in (*USUAL_MODULI, own):
        if modulo < max(own, 2) or (own < 3 and modulo == own):
            continue
        on = float(np.mean(np.mod(step, modulo) == 1))
        if on > share + (0.0 if modulo != own else 1e-9):
            best, share = modulo, on
    return best
