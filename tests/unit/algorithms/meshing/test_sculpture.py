"""A simulated sculpture: its mesh encloses its volume, and the distances of the noisy cloud are its noise."""

import numpy as np
import pytest

from algorithms.arrays import Array, Scalars
from algorithms.deviations.statistics import deviation_statistics
from algorithms.meshing.body import modelled_body
from algorithms.meshing.options import MeshOptions
from algorithms.progress import NoProgress

NOISE_M = 0.012
"""Of the source's instrument (Haring 2003)."""


def radii(directions: Array) -> Scalars:
    """A body with limbs and hollows, about a metre large, seen from its middle."""
    x, y, z = directions.T
    return np.asarray(1.0 + 0.12 * np.sin(4.0 * x) * np.cos(3.0 * y) + 0.1 * np.sin(5.0 * z) + 0.08 * x * y)


def volume_m3() -> float:
    """∫ r³ / 3 over all directions, by Gauss and Legendre along the axis and equal steps around it."""
    heights, weights = np.polynomial.legendre.leggauss(200)
    around = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    z, angle = np.meshgrid(heights, around, indexing="ij")
    flat = np.sqrt(1.0 - z**2)
    directions = np.column_stack([(flat * np.cos(angle)).ravel(), (flat * np.sin(angle)).ravel(), z.ravel()])
    cubes = radii(directions).reshape(z.shape) ** 3 / 3.0
    return float(weights @ cubes.mean(axis=1)) * 2.0 * np.pi


@pytest.mark.slow
def test_a_sculpture_of_twelve_millimetres_noise_has_its_volume_and_distances_as_in_the_source() -> None:
    rng = np.random.default_rng(7)
    directions = rng.normal(size=(60_000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    points = (radii(directions) + rng.normal(0.0, NOISE_M, len(directions)))[:, None] * directions
    body = modelled_body(points, 5.0 * directions, MeshOptions(share=0.5), [], NoProgress())
    assert body.watertight
    # uniting triangles folds one of a thousand over, which may pierce its neighbour, and the list says so
    assert {fault.kind for fault in body.faults} <= {"flipped", "self-intersection"}
    assert sum(fault.count for fault in body.faults) <= 0.001 * len(body.mesh.triangles)
    assert body.volume_m3 == pytest.approx(volume_m3(), rel=0.005)
    found = deviation_statistics(body.deviations_m, 0.01)
    # claim 25: mean of the amounts 12 mm and standard deviation 13 mm for 12 mm noise and details lost
    # here no detail is lost, and the mesh follows some of the noise: its cells are three standard deviations wide
    assert 0.75 < found.mean_absolute_m / (NOISE_M * np.sqrt(2.0 / np.pi)) <= 1.0
    assert 0.75 < found.std_m / NOISE_M <= 13.0 / 12.0
    assert abs(found.mean_m) < 0.001
