"""The extended Gaussian image of a scan (Horn 1984), and how well another one lies on it once turned."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Matrices3, Points, Scalars
from algorithms.sphere_images.tessellation import Tessellation, tessellation


@dataclass(frozen=True, eq=False)
class SphereImage:
    """How much surface looks in each direction, in the cells of one tessellation."""

    cells: Tessellation
    values: Scalars
    """(n,) of each cell and, by half as much, of its neighbours."""


@dataclass(frozen=True, eq=False)
class Directions:
    """Normals of surfaces, and how much each of them counts."""

    normals: Points
    """(k, 3) unit vectors, towards the instrument."""
    weights: Scalars
    """(k,) such as the root of the area [m]."""


def sphere_image(directions: Directions, level: int) -> SphereImage:
    """Map directions to the cells of a sphere.

    Parameters
    ----------
    directions
        Of a scan.
    level
        Of the tessellation.
    """
    cells = tessellation(level)
    counts = np.bincount(cells.cells_of(directions.normals), directions.weights, minlength=len(cells.centres))
    values = counts.copy()
    # a direction at a cell's rim belongs half to its neighbour
    first, second = cells.edges.T
    np.add.at(values, first, 0.5 * counts[second])
    np.add.at(values, second, 0.5 * counts[first])
    return SphereImage(cells, values)


def correlations(image: SphereImage, directions: Directions, rotations: Matrices3) -> Scalars:
    """Correlate an image with directions in h rotations, (h,): 1 where all directions meet the image's in proportion.

    Parameters
    ----------
    image
        Of the target.
    directions
        Of the source.
    rotations
        (h, 3, 3) target from source.
    """
    turned: Array = np.einsum("hij,kj->hki", rotations, directions.normals).reshape(-1, 3)
    met = image.values[image.cells.cells_of(turned)].reshape(len(rotations), -1)
    norm = float(np.linalg.norm(image.values) * np.linalg.norm(directions.weights))
    return np.asarray(met @ directions.weights / max(norm, 1e-12))
