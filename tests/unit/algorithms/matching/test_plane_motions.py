"""Motions that planes and parallel lines propose together."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.scan_features import ScanFeatures, SurfaceSample
from algorithms.geometry.cylinders import Cylinders
from algorithms.geometry.line_motion import moved_lines
from algorithms.geometry.lines import Lines, LineSource, bases_of, lines_from_arrays
from algorithms.geometry.planes import Planes
from algorithms.matching.line_pairs import line_pair_motions
from algorithms.matching.plane_triples import offset_votes, plane_motions
from algorithms.matching.votes import Motions
from tests.scenes.lines.feature_scenes import NO_PLANES

MAX_ANGLE_RAD = 0.03
PILLARS_M = np.array([[-7.0, 0.0, 1.5], [7.0, 0.0, 1.5]])
MOTION = RigidTransform.from_components([12.0, -7.0, 3.0], Rotation.from_rotvec([0.5, -0.8, 1.9]))
HALF_TURN = RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, np.pi]))


def _planes(motion: RigidTransform) -> Planes:
    """Water between two banks."""
    steep = np.array([0.33, 0.0, 0.94]) / np.linalg.norm([0.33, 0.0, 0.94])
    normals = motion.rotation.apply(np.array([[0.0, 0.0, 1.0], steep * [-1.0, 1.0, 1.0], steep]))
    centroids = motion.apply(np.array([[0.0, -3.0, 0.0], [11.5, -5.0, 1.05], [-11.5, -5.0, 1.05]]))
    corners = np.tile([[-4.0, -4.0], [4.0, -4.0], [4.0, 4.0], [-4.0, 4.0]], (3, 1))
    return Planes(
        normals=normals,
        centroids=centroids,
        bases=bases_of(normals),
        covariances=np.tile(1e-6 * np.eye(3), (3, 1, 1)),
        noise_std_m=np.full(3, 0.002),
        point_counts=np.full(3, 5000),
        areas_m2=np.array([200.0, 64.0, 60.0]),
        boundary=corners,
        boundary_splits=np.array([0, 4, 8, 12]),
    )


def _river(motion: RigidTransform, *, with_planes: bool = True) -> ScanFeatures:
    """Two pillars in a river, in the frame that a motion leads to."""
    pillars = lines_from_arrays(
        PILLARS_M,
        np.tile([0.0, 0.0, 1.0], (2, 1)),
        np.tile(1e-6 * np.eye(4), (2, 1, 1)),
        np.tile([-1.5, 1.5], (2, 1)),
        sources=np.full(2, int(LineSource.CYLINDER_AXIS), dtype=np.int32),
        parents=np.array([[0, -1], [1, -1]]),
    )
    lines: Lines = moved_lines(pillars, motion)
    cylinders = Cylinders(
        axes=lines,
        radii_m=np.full(2, 0.55),
        radius_std_m=np.full(2, 1e-3),
        convex=np.ones(2, dtype=np.bool_),
        arcs_rad=np.full(2, 3.0),
        noise_std_m=np.full(2, 1e-3),
        point_counts=np.full(2, 500),
    )
    surface = SurfaceSample(np.empty((0, 3)), np.empty((0, 3)), np.empty(0, dtype=np.int32), 0.1)
    planes = _planes(motion) if with_planes else NO_PLANES
    return ScanFeatures(lines, planes, cylinders, surface, None, np.zeros(3), None, 0, 0.001)


def _nearest(proposed: Motions, motion: RigidTransform) -> tuple[float, float]:
    """Rotation (Frobenius) and shift of the proposal that comes nearest, in the middle of the river."""
    middle = np.array([0.0, 0.0, 1.0])
    turns = np.linalg.norm(proposed.rotations - motion.rotation.as_matrix(), axis=(1, 2))
    shifts = np.linalg.norm(proposed.rotations @ middle + proposed.translations_m - motion.apply(middle), axis=1)
    best = int(np.argmin(turns + shifts))
    return float(turns[best]), float(shifts[best])


@pytest.mark.parametrize("symmetry", [RigidTransform.identity(), HALF_TURN], ids=["itself", "half a turn"])
def test_two_pillars_and_the_water_propose_the_motion_and_its_half_turn(symmetry):
    proposed = plane_motions(
        offset_votes(_river(MOTION), _river(RigidTransform.identity()), max_angle_rad=MAX_ANGLE_RAD)
    )
    # Exact data; votes are gathered in bins of a decimetre.
    turn, shift = _nearest(proposed, MOTION * symmetry)
    assert turn < 1e-6
    assert shift < 0.05


def test_parallel_pillars_form_no_pair_that_fixes_a_motion():
    pairs = line_pair_motions(
        _river(MOTION), _river(RigidTransform.identity()), max_angle_rad=MAX_ANGLE_RAD, max_distance_m=0.15
    )
    assert len(pairs) == 0


def test_pillars_without_any_plane_propose_nothing():
    bare = [_river(motion, with_planes=False) for motion in (MOTION, RigidTransform.identity())]
    assert len(plane_motions(offset_votes(*bare, max_angle_rad=MAX_ANGLE_RAD))) == 0
