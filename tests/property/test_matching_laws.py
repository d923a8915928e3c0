"""Laws of matching that hold for any lines and any motion."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.scan_features import ScanFeatures, SurfaceSample
from algorithms.geometry.cylinders import Cylinders
from algorithms.geometry.line_motion import moved_lines
from algorithms.geometry.lines import Lines, LineSource, lines_from_arrays
from algorithms.matching.correspondences import corresponding_lines
from algorithms.matching.degeneracy import free_freedoms
from algorithms.matching.line_pairs import line_pair_motions
from tests.scenes.lines.feature_scenes import NO_PLANES

SEEDS = st.integers(min_value=0, max_value=10_000)


def _pipes(seed: int, count: int = 7) -> tuple[Lines, np.ndarray]:
    """Axes of random pipes and their radii."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3))
    lines = lines_from_arrays(
        rng.uniform(-6.0, 6.0, (count, 3)),
        directions / np.linalg.norm(directions, axis=1, keepdims=True),
        np.tile(1e-6 * np.eye(4), (count, 1, 1)),
        np.tile([-1.0, 1.0], (count, 1)),
        sources=np.full(count, int(LineSource.CYLINDER_AXIS), dtype=np.int32),
        parents=np.column_stack([np.arange(count), np.full(count, -1)]),
    )
    return lines, rng.uniform(0.05, 0.4, count)


def _features(lines: Lines, radii: np.ndarray) -> ScanFeatures:
    n = len(radii)
    cylinders = Cylinders(
        axes=lines,
        radii_m=radii,
        radius_std_m=np.full(n, 1e-3),
        convex=np.ones(n, dtype=np.bool_),
        arcs_rad=np.full(n, 3.0),
        noise_std_m=np.full(n, 1e-3),
        point_counts=np.full(n, 500),
    )
    surface = SurfaceSample(np.empty((0, 3)), np.empty((0, 3)), np.empty(0, dtype=np.int32), 0.1)
    return ScanFeatures(lines, NO_PLANES, cylinders, surface, None, np.zeros(3), None, 0, 0.001)


def _motion(seed: int) -> RigidTransform:
    rng = np.random.default_rng(seed + 1)
    return RigidTransform.from_components(rng.uniform(-20.0, 20.0, 3), Rotation.from_rotvec(rng.uniform(-1.8, 1.8, 3)))


@settings(max_examples=25)
@given(SEEDS)
def test_the_true_motion_is_among_those_that_pairs_of_pipes_propose(seed: int) -> None:
    lines, radii = _pipes(seed)
    motion = _motion(seed)
    proposed = line_pair_motions(
        _features(moved_lines(lines, motion), radii), _features(lines, radii), max_angle_rad=0.03, max_distance_m=0.15
    )
    turns = np.linalg.norm(proposed.rotations - motion.rotation.as_matrix(), axis=(1, 2))
    shifts = np.linalg.norm(proposed.translations_m - motion.translation, axis=1)
    # Exact data: only rounding is left.
    assert ((turns < 1e-6) & (shifts < 1e-5)).any()


@settings(max_examples=25)
@given(SEEDS)
def test_moved_lines_correspond_to_themselves(seed: int) -> None:
    lines, radii = _pipes(seed)
    motion = _motion(seed)
    pairs = corresponding_lines(
        _features(moved_lines(lines, motion), radii), _features(lines, radii), motion,
        max_angle_rad=0.02, max_distance_m=0.02,
    )  # fmt: skip
    np.testing.assert_array_equal(pairs, np.column_stack([np.arange(len(lines))] * 2))


@settings(max_examples=25)
@given(SEEDS)
def test_swapping_target_and_source_swaps_the_columns_of_correspondences(seed: int) -> None:
    lines, radii = _pipes(seed)
    motion = _motion(seed)
    ours, theirs = _features(moved_lines(lines, motion), radii), _features(lines[[2, 0, 5]], radii[[2, 0, 5]])
    theirs = _features(
        lines_from_arrays(
            theirs.lines.anchors, theirs.lines.directions, theirs.lines.covariances, theirs.lines.extents,
            sources=theirs.lines.sources, parents=np.column_stack([np.arange(3), np.full(3, -1)]),
        ),
        radii[[2, 0, 5]],
    )  # fmt: skip
    limits = {"max_angle_rad": 0.02, "max_distance_m": 0.02}
    forward = corresponding_lines(ours, theirs, motion, **limits)
    backward = corresponding_lines(theirs, ours, motion.inv(), **limits)
    assert {tuple(pair) for pair in forward.tolist()} == {tuple(pair[::-1]) for pair in backward.tolist()}


@settings(max_examples=25)
@given(SEEDS)
def test_parallel_lines_leave_only_the_shift_along_them_free(seed: int) -> None:
    lines, radii = _pipes(seed)
    direction = lines.directions[0]
    parallel = lines_from_arrays(
        lines.anchors, np.tile(direction, (len(lines), 1)), lines.covariances, lines.extents, sources=lines.sources,
        parents=lines.parents,
    )  # fmt: skip
    free = free_freedoms(_features(parallel, radii))
    assert free.shape == (6, 1)
    np.testing.assert_allclose(np.abs(free[3:, 0] @ direction), 1.0, atol=1e-9)


@settings(max_examples=25)
@given(SEEDS)
def test_random_lines_leave_nothing_free(seed: int) -> None:
    assert free_freedoms(_features(*_pipes(seed))).shape == (6, 0)
