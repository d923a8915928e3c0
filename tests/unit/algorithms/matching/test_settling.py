"""Poses settled, scored and sifted on the surfaces of a small room."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.matching.polish import polished
from algorithms.matching.settling import settled
from algorithms.matching.votes import motions_of
from algorithms.scans.pose_scores import balance, score_poses, strict_limits
from algorithms.scans.surface_index import EvidenceLimits, SurfaceIndex, evidence_of, surface_index
from algorithms.scans.surface_index_kernels import _angle
from tests.scenes.lines.feature_scenes import room

SPACING_M = 0.12
DISTANCES_M = (0.3, 0.17, 0.1)
MOTION = RigidTransform.from_components([4.0, -2.0, 1.0], Rotation.from_rotvec([0.3, -0.2, 1.1]))


def _surface(seed: int, sensor_m: tuple[float, float, float]) -> SurfaceIndex:
    """The six faces of a room of 6 x 4 x 3 m, in the room's frame."""
    points = room(np.random.default_rng(seed), per_m2=60.0)
    normals = np.zeros_like(points)
    faces = np.argmax(np.abs(points) / [3.0, 2.0, 1.5], axis=1)
    normals[np.arange(len(points)), faces] = -np.sign(points[np.arange(len(points)), faces])
    return surface_index(points, normals, SPACING_M, np.array(sensor_m))


def _moved(scan: SurfaceIndex, motion: RigidTransform) -> SurfaceIndex:
    """The same surface in another frame."""
    return surface_index(
        motion.apply(scan.points), motion.rotation.apply(scan.normals), SPACING_M, motion.apply(scan.sensor_m)
    )


@pytest.fixture(scope="module")
def scans() -> tuple[SurfaceIndex, SurfaceIndex]:
    return _surface(1, (0.5, 0.2, 0.1)), _moved(_surface(2, (-1.0, -0.4, 0.0)), MOTION.inv())


@pytest.fixture(scope="module")
def starts() -> list[RigidTransform]:
    rng = np.random.default_rng(3)
    return [
        RigidTransform.from_components(rng.normal(0.0, 0.08, 3), Rotation.from_rotvec(rng.normal(0.0, 0.01, 3)))
        * MOTION
        for _ in range(4)
    ]


def test_settling_many_poses_equals_polishing_each(scans, starts):
    together = settled(motions_of(starts), *scans, distances_m=DISTANCES_M, points=800)
    alone = motions_of([polished(start, *scans, distances_m=DISTANCES_M, points=800) for start in starts])
    # The same sums in another order: rounding.
    np.testing.assert_allclose(together.rotations, alone.rotations, atol=1e-9)
    np.testing.assert_allclose(together.translations_m, alone.translations_m, atol=1e-9)


def test_settling_finds_the_true_pose_from_decimetres(scans, starts):
    together = settled(motions_of(starts), *scans, distances_m=DISTANCES_M, points=800)
    # Exact surfaces: what is left comes from gaps across the room's edges.
    np.testing.assert_allclose(together.translations_m, np.tile(MOTION.translation, (4, 1)), atol=2e-3)


def _evidence_point_by_point(
    pose: RigidTransform, moved: SurfaceIndex, fixed: SurfaceIndex, points: int, limits: EvidenceLimits
) -> tuple[float, float]:
    """What fits and what stands in free space, by plain look-ups."""
    fits = free = 0.0
    total = moved.weights[:points].sum()
    for point, normal, weight in zip(
        pose.apply(moved.points[:points]), pose.rotation.apply(moved.normals[:points]), moved.weights, strict=False
    ):
        cell = np.floor((point - fixed.low_m) / fixed.cell_m).astype(int)
        q = fixed.owner[tuple(cell)] if (cell >= 0).all() and (cell < fixed.owner.shape).all() else -1
        gap = point - fixed.points[q]
        off = gap @ fixed.normals[q]
        near = abs(off) <= limits.max_distance_m and gap @ gap - off**2 <= limits.reach_m**2
        if q >= 0 and near and normal @ fixed.normals[q] >= np.cos(limits.max_angle_rad):
            fits += weight
            continue
        ray = point - fixed.sensor_m
        distance = np.linalg.norm(ray)
        row = int(np.arccos(ray[2] / distance) / fixed.cell_rad)
        column = int((np.arctan2(ray[1], ray[0]) + np.pi) / fixed.cell_rad)
        bound = fixed.nearest_m[row, column] * (1.0 - limits.margin_relative) - limits.margin_m
        cosine = abs(normal @ ray) / distance
        span = fixed.cell_rad * distance * np.sqrt(1.0 - cosine**2) / max(cosine, 0.1)
        if np.isfinite(bound) and cosine >= 0.1 and distance < bound - span:
            free += weight
    return fits / total, free / total


@pytest.mark.parametrize("points", [1, 64, 150, 777])
def test_the_evidence_of_poses_is_what_a_look_at_point_by_point_gives(scans, points):
    target, source = scans
    limits = strict_limits(0.0, SPACING_M)
    for shift in ([0.0, 0.0, 0.0], [0.4, -0.9, 0.2], [3.5, 0.3, 0.1]):
        pose = RigidTransform.from_components(shift, Rotation.from_rotvec([0.0, 0.02, 0.1])) * MOTION
        motion = motions_of([pose])
        found = evidence_of(motion.rotations, motion.translations_m, source, target, points=points, limits=limits)
        expected = _evidence_point_by_point(pose, source, target, points, limits)
        np.testing.assert_allclose([found.fitting[0], found.violation[0]], expected, atol=1e-12)


def test_settling_leaves_a_pose_without_common_surface_where_it_is(scans):
    far = motions_of([RigidTransform.from_translation([100.0, 0.0, 0.0])])
    settled_far = settled(far, *scans, distances_m=DISTANCES_M, points=800)
    np.testing.assert_allclose(settled_far.translations_m, far.translations_m, atol=1e-12)


def test_sifting_gives_a_good_pose_its_full_score_and_a_hopeless_one_nearly_none(scans):
    inside = RigidTransform.from_components([0.7, 0.6, 0.2], Rotation.from_rotvec([0.4, 0.5, 0.2])) * MOTION
    motions = motions_of([MOTION, inside])
    limits = strict_limits(0.0, SPACING_M)
    full, sifted = (
        score_poses(motions.rotations, motions.translations_m, *scans, points=600, limits=limits, sifting=sifting)
        for sifting in (False, True)
    )
    assert sifted.score[0] == full.score[0] > 0.5
    assert sifted.score[1] < 0.05


def test_no_score_is_negative(scans):
    motions = motions_of([RigidTransform.from_rotation(Rotation.random(random_state=k)) * MOTION for k in range(5)])
    limits = strict_limits(0.0, SPACING_M)
    scores = score_poses(motions.rotations, motions.translations_m, *scans, points=600, limits=limits)
    assert (scores.score >= 0.0).all()
    assert (scores.score <= scores.support).all()


def test_scans_that_stand_in_each_others_free_space_have_a_negative_balance(scans):
    aside = RigidTransform.from_components([1.2, 0.7, 0.4], Rotation.from_rotvec([0.2, 0.3, 0.5])) * MOTION
    motions = motions_of([MOTION, aside])
    limits = strict_limits(0.0, SPACING_M)
    scores = score_poses(motions.rotations, motions.translations_m, *scans, points=600, limits=limits)
    good, bad = balance(scores.support, scores.violation)
    assert good > 0.5
    assert bad < -0.5
    assert (scores.charitable >= scores.score).all()


def test_the_quick_angle_is_right_within_a_thousandth_of_a_cell():
    y, x = np.random.default_rng(4).normal(size=(2, 500))
    x[:4], y[:4] = (1.0, -1.0, 0.0, 0.0), (0.0, 0.0, 1.0, -1.0)
    found = np.array([_angle(a, b) for a, b in zip(y, x, strict=True)])
    # A cell of the range image is 17 mrad wide.
    np.testing.assert_allclose(found, np.arctan2(y, x), atol=2e-5)
