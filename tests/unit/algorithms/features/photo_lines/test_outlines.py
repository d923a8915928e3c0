"""Edges that enclose a field on a plane become its outline; what does not close, or lies elsewhere, does not."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.features.photo_lines.outlines import Outline, outlines
from algorithms.features.photo_lines.projection_options import SpaceEdgeKind
from algorithms.geometry.lines import Lines, bases_of, lines_from_arrays
from algorithms.geometry.planes import Planes

TURN = Rotation.from_rotvec([0.3, -0.8, 0.4])
CENTRE = np.array([4.0, -2.0, 1.5])
SIGN = np.array([[0.0, 0.0], [0.8, 0.0], [0.8, 0.5], [0.3, 0.7], [0.0, 0.5]])


def plane() -> Planes:
    normal = TURN.apply([[0.0, 0.0, 1.0]])
    corners = np.array([[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]])
    return Planes(
        normals=normal,
        centroids=CENTRE[None],
        bases=TURN.as_matrix()[None, :, :2].copy(),
        covariances=np.zeros((1, 3, 3)),
        noise_std_m=np.array([0.001]),
        point_counts=np.array([1000]),
        areas_m2=np.array([16.0]),
        boundary=corners,
        boundary_splits=np.array([0, 4]),
    )


def in_space(flat: np.ndarray, off_m: float = 0.0) -> np.ndarray:
    return np.asarray(CENTRE + TURN.apply(np.column_stack([flat, np.full(len(flat), off_m)])))


def edges(corners: np.ndarray, short_m: float = 0.01, off_m: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Give the sides of a polygon in space, each ending a little before its corners."""
    starts, ends = corners, np.roll(corners, -1, axis=0)
    along = (ends - starts) / np.linalg.norm(ends - starts, axis=1)[:, None]
    return in_space(starts + short_m * along, off_m), in_space(ends - short_m * along, off_m)


def found(starts: np.ndarray, ends: np.ndarray, kind: SpaceEdgeKind = SpaceEdgeKind.SURFACE_EDGE) -> list[Outline]:
    lengths = np.linalg.norm(ends - starts, axis=1)
    directions = (ends - starts) / lengths[:, None]
    lines: Lines = lines_from_arrays(
        starts, directions, np.zeros((len(starts), 4, 4)), np.column_stack([np.zeros(len(starts)), lengths]),
        bases=bases_of(directions),
    )  # fmt: skip
    return outlines(lines, np.full(len(lines), int(kind)), np.repeat(plane().normals, len(lines), axis=0), plane())


@pytest.mark.parametrize("seed", range(4))
def test_the_sides_of_a_sign_become_its_outline_in_whatever_order_and_direction_they_come(seed: int) -> None:
    rng = np.random.default_rng(seed)
    starts, ends = edges(SIGN)
    order, turned = rng.permutation(len(SIGN)), rng.random(len(SIGN)) < 0.5
    starts, ends = np.where(turned[:, None], ends, starts)[order], np.where(turned[:, None], starts, ends)[order]
    (outline,) = found(starts, ends)
    assert sorted(outline.lines) == list(range(len(SIGN)))
    assert outline.area_m2 == pytest.approx(0.4 + 0.5 * (0.8 * 0.2), abs=1e-9)
    apart = np.linalg.norm(outline.corners[:, None] - in_space(SIGN)[None], axis=2)
    np.testing.assert_allclose(apart.min(axis=1), 0.0, atol=1e-9)


def test_two_fields_side_by_side_stay_two() -> None:
    one, two = edges(SIGN), edges(SIGN + np.array([1.0, 0.0]))
    assert len(found(np.vstack([one[0], two[0]]), np.vstack([one[1], two[1]]))) == 2


def test_three_sides_of_four_enclose_nothing() -> None:
    starts, ends = edges(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]))
    assert found(starts[:3], ends[:3]) == []


def test_edges_that_end_far_from_their_corners_are_not_joined() -> None:
    assert found(*edges(SIGN, short_m=0.2)) == []


def test_edges_before_the_plane_and_silhouettes_are_no_outlines_on_it() -> None:
    assert found(*edges(SIGN, off_m=0.1)) == []
    assert found(*edges(SIGN), SpaceEdgeKind.SILHOUETTE) == []
