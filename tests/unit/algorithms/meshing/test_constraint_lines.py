"""A plinth's edges stay sharp where lines say that there are edges."""

from itertools import product

import numpy as np
import pytest

from algorithms.arrays import Array
from algorithms.deviations.signed_distances import from_mesh
from algorithms.errors import InvalidInputError
from algorithms.meshing.body import ModelledBody, modelled_body
from algorithms.meshing.constraint_lines import ConstraintLine
from algorithms.meshing.options import MeshOptions
from algorithms.progress import NoProgress

SIZE_M = np.array([1.0, 0.6, 0.4])


def plinth(noise_m: float, spacing_m: float = 0.012) -> tuple[Array, Array]:
    """Points of all six faces with noise across them, and instruments before each."""
    rng = np.random.default_rng(3)
    points, sensors = [], []
    for axis, side in product(range(3), (0.0, 1.0)):
        others = [k for k in range(3) if k != axis]
        count = int(np.prod(SIZE_M[others]) / spacing_m**2)
        face = np.empty((count, 3))
        face[:, others] = rng.uniform(0.0, 1.0, (count, 2)) * SIZE_M[others]
        face[:, axis] = side * SIZE_M[axis] + rng.normal(0.0, noise_m, count)
        sensor = SIZE_M / 2.0
        sensor[axis] += (2.0 * side - 1.0) * 10.0
        points.append(face)
        sensors.append(np.tile(sensor, (count, 1)))
    return np.concatenate(points), np.concatenate(sensors)


def edges() -> list[ConstraintLine]:
    lines = []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for corner in product((0.0, 1.0), repeat=2):
            start = np.zeros(3)
            start[others] = np.array(corner) * SIZE_M[others]
            end = start.copy()
            end[axis] = SIZE_M[axis]
            lines.append(ConstraintLine(start, end))
    return lines


def from_edges_m(body: ModelledBody) -> Array:
    shares = np.linspace(0.0, 1.0, 101)[:, None]
    places = np.concatenate([line.start_m + shares * (line.end_m - line.start_m) for line in edges()])
    return np.abs(from_mesh(places, body.mesh, np.inf).distances_m)


@pytest.mark.slow
def test_edges_are_kept_to_two_millimetres_with_lines_and_not_without() -> None:
    points, sensors = plinth(0.001)
    options = MeshOptions(resolution_m=0.03)
    rounded = modelled_body(points, sensors, options, [], NoProgress())
    sharp = modelled_body(points, sensors, options, [], NoProgress(), lines=edges())
    assert np.quantile(from_edges_m(rounded), 0.95) > 0.004
    assert from_edges_m(sharp).max() < 0.002
    assert sharp.watertight
    assert sharp.volume_m3 == pytest.approx(float(np.prod(SIZE_M)), rel=0.005)


def test_a_line_in_the_middle_of_a_face_is_refused() -> None:
    points, sensors = plinth(0.001)
    away = ConstraintLine(np.array([0.2, 0.3, 0.7]), np.array([0.8, 0.3, 0.7]))
    with pytest.raises(InvalidInputError, match=r"lines\[0\].*two surfaces"):
        modelled_body(points, sensors, MeshOptions(resolution_m=0.03), [], NoProgress(), lines=[away])
