"""Few features of sparse or noisy points are told from geometry that leaves a motion free."""

import numpy as np
import pytest

from algorithms.errors import DegenerateGeometryError, TooFewFeaturesError
from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.matching.degeneracy import require_determining_geometry
from algorithms.progress import NoProgress
from algorithms.registration import DEFAULT_METHOD
from algorithms.registration.base import PairStatus, RegistrationProblem
from tests.scenes.lines.feature_scenes import cloud

ROOM_M = np.array([8.0, 6.0, 3.0])


def room_points(count, noise_m, seed=1, faces=6):
    """Spread points over the faces of a room: pairs of opposite ones, those across x last."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.0, 1.0, (count, 3)) * ROOM_M
    face = rng.integers(0, faces, count)
    axis = 2 - face // 2
    points[np.arange(count), axis] = np.where(face % 2 == 0, 0.0, ROOM_M[axis])
    return points - 0.5 * ROOM_M + rng.normal(0.0, noise_m, (count, 3))


def features_of(points):
    return extract_features(
        cloud(points, sensor_m=None), FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0)
    )


@pytest.mark.parametrize(("count", "noise_m"), [(8000, 0.2), (500, 0.03), (30_000, 0.1)])
def test_noisy_or_sparse_points_on_all_walls_are_too_few_and_not_degenerate(count, noise_m):
    with pytest.raises(TooFewFeaturesError, match=f"too few planes in {count} points of the target scan") as refusal:
        require_determining_geometry(features_of(room_points(count, noise_m)), "target frame")
    assert "translation" not in str(refusal.value)
    assert "more points" in refusal.value.advice


@pytest.mark.parametrize(("count", "noise_m"), [(8000, 0.03), (60_000, 0.005)])
def test_a_corridor_without_ends_is_degenerate_at_any_density(count, noise_m):
    with pytest.raises(DegenerateGeometryError) as refusal:
        require_determining_geometry(features_of(room_points(count, noise_m, faces=4)), "target frame")
    assert refusal.value.rank == 5


def heap_points(count, radius_m=0.5, seed=2):
    """Spread points over a rough heap that lies in the corridor, seen from all sides: no plane fits to it."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return radius_m * normals * (1.0 + rng.normal(0.0, 0.2, (count, 1)))


def test_surface_that_stands_across_what_the_planes_leave_open_means_too_few_features():
    corridor = room_points(60_000, 0.005, faces=4)
    with pytest.raises(TooFewFeaturesError, match="of the surface stands across what they leave open"):
        require_determining_geometry(features_of(np.vstack([corridor, heap_points(4000)])), "target frame")


def test_hardly_any_surface_across_leaves_a_corridor_degenerate():
    corridor = room_points(60_000, 0.005, faces=4)
    with pytest.raises(DegenerateGeometryError):
        require_determining_geometry(features_of(np.vstack([corridor, heap_points(60, 0.2)])), "target frame")


def test_surface_of_a_tank_that_was_recognised_does_not_count_as_surface_across():
    rng = np.random.default_rng(3)
    angles, heights = rng.uniform(0.0, 2 * np.pi, 30_000), rng.uniform(0.0, 6.0, 30_000)
    tank = np.column_stack([2.0 * np.cos(angles), 2.0 * np.sin(angles), heights])
    ground = np.column_stack([rng.uniform(-8.0, 8.0, (30_000, 2)), np.zeros(30_000)])
    ground = ground[np.hypot(*ground[:, :2].T) > 2.0]
    features = features_of(np.vstack([tank, ground]) + rng.normal(0.0, 0.003, (30_000 + len(ground), 3)))
    assert len(features.cylinders) == 1
    with pytest.raises(DegenerateGeometryError):
        require_determining_geometry(features, "target frame")


def test_a_pair_of_too_few_features_is_rejected_with_what_to_do():
    first, second = (features_of(room_points(8000, 0.2, seed)) for seed in (1, 2))
    result = DEFAULT_METHOD().register(RegistrationProblem(first, second), progress=NoProgress())
    assert result.status is PairStatus.REJECTED
    assert "too few planes in 8000 points" in result.reasons[0]
    assert "more points" in result.advice
    assert not result.free_directions
