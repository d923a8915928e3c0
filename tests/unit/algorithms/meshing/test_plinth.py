"""A sculpture and the plinth of planes it stands on become one watertight body of their volume."""

import numpy as np
import pytest

from algorithms.arrays import Array
from algorithms.errors import InvalidInputError
from algorithms.meshing.body import modelled_body
from algorithms.meshing.faults import faults_of
from algorithms.meshing.options import MeshOptions
from algorithms.meshing.plinth import Plinth, standing_on
from algorithms.meshing.reconstruction import enclosed_volume
from algorithms.progress import NoProgress

HALF_M = np.array([0.6, 0.5, 0.4])
"""Of a box about the origin."""
PLANES = np.vstack([np.eye(3), -np.eye(3)])
RADIUS_M, UP_M = 0.35, 0.15
"""Of a ball whose middle is so high above the top."""
NO_FLAGS = np.empty(0, dtype=np.int64)


def box() -> Plinth:
    return Plinth(PLANES * np.tile(HALF_M, 2)[:, None], PLANES, top=2)


def scanned(rng: np.random.Generator, noise_m: float) -> tuple[Array, Array]:
    """Points of box and ball as seen from outside, and from where."""
    out = rng.normal(size=(20_000, 3))
    out /= np.linalg.norm(out, axis=1)[:, None]
    ball = RADIUS_M * out + [0.0, 0.0, HALF_M[2] + UP_M]
    ball = ball[ball[:, 2] > HALF_M[2]]
    sides = rng.integers(0, 6, 40_000)
    faces = rng.uniform(-1.0, 1.0, (len(sides), 3)) * HALF_M
    faces[np.arange(len(sides)), sides % 3] = np.where(sides < 3, 1.0, -1.0) * HALF_M[sides % 3]
    under = (sides == 2) & (np.hypot(faces[:, 0], faces[:, 1]) < np.sqrt(RADIUS_M**2 - UP_M**2))
    points = np.vstack([ball, faces[~under]])
    return points + rng.normal(0.0, noise_m, points.shape), 10.0 * points


def volume_m3() -> float:
    """Box and the ball's part above the top: π h² (3 r - h) / 3."""
    high = RADIUS_M + UP_M
    return float(8.0 * HALF_M.prod() + np.pi * high**2 * (3.0 * RADIUS_M - high) / 3.0)


@pytest.mark.slow
def test_plinth_and_sculpture_are_one_watertight_body_of_their_volume() -> None:
    points, sensors = scanned(np.random.default_rng(3), 0.002)
    body = modelled_body(points, sensors, MeshOptions(resolution_m=0.02), [], NoProgress(), plinth=(box(), None))
    assert body.watertight
    assert body.volume_m3 == pytest.approx(volume_m3(), rel=0.005)
    assert body.steps[-1].step == "plinth"
    # no face is left between the two
    centres = body.mesh.vertices[body.mesh.triangles].mean(axis=1)
    between = (np.abs(centres[:, 2] - HALF_M[2]) < 1e-6) & (np.hypot(centres[:, 0], centres[:, 1]) < 0.2)
    assert not between.any()
    assert np.nanstd(body.deviations_m) < 0.004


def test_a_plinth_keeps_its_corners_exactly() -> None:
    points, sensors = scanned(np.random.default_rng(4), 0.0)
    mesh = modelled_body(points, sensors, MeshOptions(resolution_m=0.05), [], NoProgress()).mesh
    joined = standing_on(mesh, box(), 0.08)
    assert {fault.kind for fault in faults_of(joined, NO_FLAGS)} == set()
    assert enclosed_volume(joined) == pytest.approx(volume_m3(), rel=0.005)
    for signs in np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3):
        assert np.linalg.norm(joined.vertices - signs * HALF_M, axis=1).min() < 1e-12


def test_what_bounds_no_body_or_does_not_stand_on_it_is_refused() -> None:
    points, sensors = scanned(np.random.default_rng(5), 0.0)
    mesh = modelled_body(points, sensors, MeshOptions(resolution_m=0.05), [], NoProgress()).mesh
    open_ = Plinth(box().points_m[:5], PLANES[:5], top=2)
    with pytest.raises(InvalidInputError, match="bound no body"):
        standing_on(mesh, open_, 0.03)
    aside = Plinth(box().points_m + np.array([0.6, 0.0, 0.0]), PLANES, top=2)
    with pytest.raises(InvalidInputError, match="beyond its top"):
        standing_on(mesh, aside, 0.03)
