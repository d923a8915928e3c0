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


def test_a_pair_of_too_few_features_is_rejected_with_what_to_do():
    first, second = (features_of(room_points(8000, 0.2, seed)) for seed in (1, 2))
    result = DEFAULT_METHOD().register(
        RegistrationProblem(first, second), progress=NoProgress(), rng=np.random.default_rng(0)
    )
    assert result.status is PairStatus.REJECTED
    assert "too few planes in 8000 points" in result.reasons[0]
    assert "more points" in result.advice
    assert not result.free_directions
