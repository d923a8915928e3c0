"""Steps that settle sooner: what earlier ones tell of the equations' bend is taken from the last (Anderson 1965).

Gauss-Newton steps leave out second derivatives. Where the data hardly tell an unknown, noise times these is no longer
small against what they tell, and the steps only shrink by a share, to and fro between unknowns and planes.
"""

from collections import deque

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Matrix

DEPTH = 3
"""Earlier steps that are looked at."""


class Mixing:
    """Mixes steps of one adjustment, over unknowns (u,) and what follows them (f,)."""

    def __init__(self) -> None:
        self._places: deque[Array] = deque(maxlen=DEPTH + 1)
        self._steps: deque[Array] = deque(maxlen=DEPTH + 1)

    def mixed(
        self,
        place: Float64[Array, "u"],
        step: Float64[Array, "u"],
        place_following: Float64[Array, "f"],
        following: Float64[Array, "f"],
        normal: Matrix,
    ) -> tuple[Array, Array]:
        """Give the step to take, of unknowns and followers, instead of the one that the equations at a place tell.

        The combination of steps that is shortest, in units of the standard deviations of `normal`, is taken from the
        same combination of places. The first step is left as it is.
        """
        count = len(place)
        self._places.append(np.concatenate([place, place_following]))
        self._steps.append(np.concatenate([step, following]))
        whole = self._steps[-1]
        if len(self._steps) > 1:
            places, steps = np.diff(np.array(self._places), axis=0), np.diff(np.array(self._steps), axis=0)
            scale = np.linalg.cholesky(normal).T
            shares = np.linalg.lstsq(scale @ steps[:, :count].T, scale @ step, rcond=1e-8)[0]
            whole = whole - shares @ (places + steps)
        return whole[:count], whole[count:]
