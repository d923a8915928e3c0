"""Planes of a turned plinth keep their constraints, and their covariance is honest."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.arrays import Array
from algorithms.errors import DegenerateGeometryError, InvalidInputError
from algorithms.geometry.lines import bases_of
from algorithms.meshing.options import PlaneRelation
from algorithms.meshing.plane_models import (
    PlaneConstraint,
    adjusted_planes,
    constraint_values,
    corner_of,
)

STD_M = 0.004
TURN = Rotation.from_euler("z", 0.4)
SIZE_M = np.array([2.0, 1.5, 1.0])
V, P, R = PlaneRelation.VERTICAL, PlaneRelation.PARALLEL, PlaneRelation.ORTHOGONAL
BOX = [
    *(PlaneConstraint(V, k) for k in range(4)),
    PlaneConstraint(P, 0, 1),
    PlaneConstraint(P, 2, 3),
    *(PlaneConstraint(R, i, j) for i in (0, 1) for j in (2, 3)),
    *(PlaneConstraint(R, 4, k) for k in range(4)),
]
"""Four walls and a top; eight of the constraints follow from the others."""


def faces(seed: int, count: int = 200, turn: Rotation = TURN) -> list[Array]:
    rng = np.random.default_rng(seed)
    found = []
    for axis, side in ((0, 0.0), (0, 1.0), (1, 0.0), (1, 1.0), (2, 1.0)):
        places = rng.uniform(0.0, 1.0, (count, 3))
        places[:, axis] = side
        found.append(turn.apply(places * SIZE_M + rng.normal(0.0, STD_M, (count, 3))) + 100.0)
    return found


def test_constraints_are_kept_exactly_and_a_corner_is_right_to_a_millimetre() -> None:
    model = adjusted_planes(faces(1), BOX)
    misses, jacobian = constraint_values(model.normals, model.bases, BOX)
    assert np.abs(misses).max() < 1e-12
    assert np.linalg.matrix_rank(jacobian) == 9
    # five planes have fifteen unknowns; a box whose top is free in height has one turn and five distances
    assert model.redundancy == 1000 - 6
    assert model.std_m == pytest.approx(STD_M, rel=0.1)
    corner, covariance = corner_of(model, (1, 3, 4))
    assert np.abs(corner - TURN.apply(SIZE_M) - 100.0).max() < 0.001
    assert np.sqrt(np.diag(covariance)).max() < 0.001


def test_derivatives_of_constraints_are_those_of_differences() -> None:
    rng = np.random.default_rng(2)
    normals = rng.normal(size=(5, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    constraints = [PlaneConstraint(V, 1), PlaneConstraint(R, 0, 3), PlaneConstraint(P, 4, 2)]
    bases = bases_of(normals)
    _, jacobian = constraint_values(normals, bases, constraints)
    step = 1e-6

    def moved(unknown: int, by: float) -> Array:
        plane, part = divmod(unknown, 3)
        turned, frames = normals.copy(), bases.copy()
        if part < 2:
            # the frame turns with its normal, without a twist about it
            axis = np.cross(normals[plane], bases[plane, :, part])
            turn = Rotation.from_rotvec(by * axis)
            turned[plane], frames[plane] = turn.apply(normals[plane]), turn.apply(bases[plane].T).T
        return constraint_values(turned, frames, constraints)[0]

    numerical = np.stack([(moved(k, step) - moved(k, -step)) / (2.0 * step) for k in range(15)], axis=1)
    assert np.abs(jacobian - numerical).max() < 1e-9


def test_without_constraints_each_plane_is_that_of_least_squares() -> None:
    points = faces(3)
    model = adjusted_planes(points, [])
    for own, normal in zip(points, model.normals, strict=True):
        _, _, axes = np.linalg.svd(own - own.mean(axis=0), full_matrices=False)
        assert abs(normal @ axes[2]) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.slow
def test_corners_are_as_uncertain_as_their_covariance_says() -> None:
    truth = TURN.apply(SIZE_M) + 100.0
    squares = []
    for seed in range(150):
        corner, covariance = corner_of(adjusted_planes(faces(100 + seed, 40), BOX), (1, 3, 4))
        squares.append((corner - truth) @ np.linalg.solve(covariance, corner - truth))
    # the mean of 150 squared errors of three degrees of freedom has a standard deviation of 0.2
    assert np.mean(squares) == pytest.approx(3.0, abs=0.6)


def test_what_determines_nothing_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="plane 0 has 3 points"):
        adjusted_planes([np.zeros((3, 3))], [])
    line = np.outer(np.arange(10.0), [1.0, 0.0, 0.0])
    with pytest.raises(DegenerateGeometryError, match="plane 0"):
        adjusted_planes([line], [])
    model = adjusted_planes(faces(4), BOX)
    with pytest.raises(DegenerateGeometryError, match="parallel"):
        corner_of(model, (0, 1, 4))
