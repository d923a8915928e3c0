"""Smoothing takes noise away, leaves planes where they are, and says what each pass moved."""

import numpy as np

from algorithms.cleaning.options import Smoothing
from algorithms.cleaning.smoothing import smoothed
from algorithms.cleaning.thinning import curvature_thinned, voxel_thinned
from algorithms.progress import NoProgress

NOISE_M = 0.012


def noisy_plane(count: int = 30_000, size_m: float = 0.8) -> np.ndarray:
    """Give a plane with the noise of claim 25, thinned to a point per cubic centimetre as there."""
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-size_m / 2, size_m / 2, (count, 2)), rng.normal(0.0, NOISE_M, count)])
    return points[voxel_thinned(points, 0.01)]


def test_three_passes_move_less_each_time_and_leave_the_plane_where_it_is() -> None:
    points = noisy_plane()
    cloud = smoothed(points, Smoothing(), NoProgress())
    means = [each.mean_m for each in cloud.passes]
    # the published passes move 6.9, 3.5 and 1.3 mm in the mean, with 4.9, 3.1 and 1.4 mm standard deviation
    assert 0.005 < means[0] < 0.010
    assert 0.003 < cloud.passes[0].std_m < 0.007
    assert means[0] > 1.5 * means[1] > 2.0 * means[2]
    assert all(each.largest_m >= each.mean_m for each in cloud.passes)
    assert cloud.passes[-1].remaining == len(cloud.points) == len(cloud.numbers)
    assert len(points) == cloud.passes[-1].remaining + sum(each.removed for each in cloud.passes)
    inner = np.abs(cloud.points[:, :2]).max(axis=1) < 0.3
    assert abs(cloud.points[inner, 2].mean()) < 0.3 * NOISE_M
    assert cloud.points[inner, 2].std() < 0.3 * NOISE_M


def test_thinning_keeps_one_measured_point_of_every_cube() -> None:
    points = np.random.default_rng(0).uniform(0.0, 1.0, (5000, 3))
    kept = points[voxel_thinned(points, 0.1)]
    assert len(kept) <= 11**3
    assert np.isin(kept[:, 0], points[:, 0]).all()
    assert (voxel_thinned(kept, 0.02)).all()


def test_thinning_by_curvature_keeps_edges_denser_than_faces_and_the_wanted_share() -> None:
    rng = np.random.default_rng(2)
    flat, wall = rng.uniform(0.0, 1.0, (2, 20_000, 2))
    points = np.concatenate(
        [np.column_stack([flat, np.zeros(len(flat))]), np.column_stack([np.zeros(len(wall)), wall])]
    )
    kept = points[curvature_thinned(points, 0.25)]
    assert len(kept) == 10_000
    at_edge = np.hypot(points[:, 0], points[:, 2]) < 0.05
    of_kept = np.hypot(kept[:, 0], kept[:, 2]) < 0.05
    assert of_kept.mean() > 2.0 * at_edge.mean()
    # no hole in the faces
    corners = np.stack(np.meshgrid(np.arange(0.1, 1.0, 0.1), np.arange(0.1, 1.0, 0.1)), axis=-1).reshape(-1, 2)
    gaps = np.linalg.norm(kept[None, :, :] - np.column_stack([corners, np.zeros(len(corners))])[:, None, :], axis=2)
    assert gaps.min(axis=1).max() < 0.06
