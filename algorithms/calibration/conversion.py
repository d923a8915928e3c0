"""The camera of one lens model in the parameters of another."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array
from algorithms.calibration.lenses import Lens
from algorithms.calibration.projection import format_grid, on_sphere

ROUNDS = 50
CELLS = 24


@dataclass(frozen=True, eq=False)
class Converted:
    """Parameters of the other model."""

    parameters: Array
    """(k,)."""
    largest_px: float
    """By how much it misses the first camera somewhere in the format."""


def converted(first: tuple[Lens, Array], lens: Lens, names: tuple[str, ...], width: int, height: int) -> Converted:
    """Fit parameters to the rays of a camera over its whole format, by least squares in the image (MATH 3.1).

    Parameters
    ----------
    first
        Lens and parameters.
    lens
        The other model; both frames are the same.
    names
        Parameters that are fitted; others are zero.
    width, height
        Of the format [px].
    """
    image = format_grid(width, height, CELLS, CELLS)
    rays = on_sphere(first[0], image, first[1], 1.0)
    found = np.zeros(len(lens.names))
    found[:3] = first[1][:3]
    free = [lens.place(name) for name in names]
    for _ in range(ROUNDS):
        misfit = lens.misfit(rays, image, found)
        design = misfit.by_parameters.reshape(-1, len(found))[:, free]
        sizes = np.linalg.norm(design, axis=0)
        step = -np.linalg.lstsq(design / sizes, misfit.residuals.ravel(), rcond=None)[0]
        found[free] += step / sizes
        if np.abs(step).max() < 1e-9:
            break
    apart = np.linalg.norm(lens.image(rays, found, image) - image, axis=1)
    return Converted(found, float(apart.max()))
