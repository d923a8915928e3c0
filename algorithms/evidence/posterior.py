"""How probable each of the poses is that were found, beside another like place and none of them at all."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Scalars


@dataclass(frozen=True, eq=False)
class Posterior:
    """Probabilities that sum to one."""

    best: int
    """Number of the most probable pose."""
    poses: Scalars
    """(h,) of each pose."""
    elsewhere: float
    """Of another place that looks like this one and that neither scan shows."""
    none: float
    """Of none of these: the scans have nothing in common, or the right pose was not found."""


def posterior(total: Scalars, elsewhere: float) -> Posterior:
    """Give the probabilities of h poses.

    Parameters
    ----------
    total
        (h,) log-odds against chance, which is "none of these".
    elsewhere
        Log-odds, against the best pose, of another place that looks like it.
    """
    best = int(np.argmax(total))
    # of the largest exponent nothing overflows
    largest = max(float(total[best]), 0.0)
    odds, none, other = np.exp(total - largest), np.exp(-largest), np.exp(total[best] + elsewhere - largest)
    whole = odds.sum() + none + other
    return Posterior(best, odds / whole, float(other / whole), float(none / whole))
