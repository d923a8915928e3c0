"""The only pose that hardly anything speaks against."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.matching.self_likeness import Contradiction
from algorithms.matching.spotless import lone_spotless_pose
from algorithms.scans.surface_index import SurfaceIndex, surface_index

BEST = Contradiction(0.2, 0.15)
"""Fits best, but much of it stands in free space."""


def at(shift_m: float) -> RigidTransform:
    return RigidTransform.from_translation([shift_m, 0.0, 0.0])


@pytest.fixture(scope="module")
def scan() -> SurfaceIndex:
    """A floor, seen from above: what counts here is where the instrument stood, and how far its surfaces are."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(-5.0, 5.0, 0.25), np.arange(-5.0, 5.0, 0.25)))
    points = np.column_stack([x, y, np.full(x.size, -1.6)])
    return surface_index(points, np.tile([0.0, 0.0, 1.0], (x.size, 1)), 0.25, np.zeros(3))


def number(scan: SurfaceIndex, *others: tuple[float, Contradiction]) -> int | None:
    poses = (at(0.0), *(at(shift) for shift, _ in others))
    return lone_spotless_pose(poses, (BEST, *(each for _, each in others)), scan, scan)


def test_it_is_found_behind_poses_that_fit_better(scan: SurfaceIndex) -> None:
    assert number(scan, (10.0, Contradiction(0.07, 0.0)), (20.0, Contradiction(0.05, 0.04))) == 1


def test_another_clean_pose_of_like_support_leaves_it_open(scan: SurfaceIndex) -> None:
    assert number(scan, (10.0, Contradiction(0.07, 0.0)), (20.0, Contradiction(0.04, 0.01))) is None


def test_a_clean_pose_with_far_less_support_does_not_count(scan: SurfaceIndex) -> None:
    assert number(scan, (10.0, Contradiction(0.09, 0.0)), (20.0, Contradiction(0.025, 0.0))) == 1


def test_a_clean_pose_beside_it_does_not_count(scan: SurfaceIndex) -> None:
    assert number(scan, (10.0, Contradiction(0.07, 0.0)), (10.1, Contradiction(0.06, 0.0))) == 1


def test_where_something_speaks_against_it_the_others_must_be_four_times_as_bad(scan: SurfaceIndex) -> None:
    assert number(scan, (10.0, Contradiction(0.09, 0.012)), (20.0, Contradiction(0.06, 0.04))) is None


def test_it_does_not_displace_a_pose_of_many_times_its_support(scan: SurfaceIndex) -> None:
    assert number(scan, (10.0, Contradiction(0.04, 0.0))) is None


def test_what_lays_next_to_nothing_on_each_other_is_no_pose(scan: SurfaceIndex) -> None:
    assert number(scan, (10.0, Contradiction(0.02, 0.0))) is None


@pytest.mark.parametrize(("against", "found"), [(0.12, 1), (0.06, None)])
def test_a_pose_that_fits_better_is_displaced_only_where_much_speaks_against_it(scan, against, found) -> None:
    """Landings of a stairwell are all alike: a wrong pose may show nothing, and no better one be the right one."""
    judged = Contradiction(0.6, against), Contradiction(0.28, 0.006)
    assert lone_spotless_pose((at(0.0), at(10.0)), judged, scan, scan) == found


def test_where_an_instrument_is_unknown_no_pose_is_spotless(scan: SurfaceIndex) -> None:
    blind = surface_index(scan.points, scan.normals, 0.25, None)
    judged = (BEST, Contradiction(0.2, 0.0))
    assert lone_spotless_pose((at(0.0), at(10.0)), judged, scan, blind) is None
    assert lone_spotless_pose((at(0.0), at(10.0)), judged, scan, scan) == 1


def test_what_fits_by_chance_with_no_lines_in_common_leaves_nothing_open(scan: SurfaceIndex) -> None:
    poses, judged = (at(0.0), at(10.0), at(20.0)), (BEST, Contradiction(0.07, 0.0), Contradiction(0.035, 0.0))

    def lone(*common: int) -> int | None:
        return lone_spotless_pose(poses, judged, scan, scan, lambda k: common[k])

    assert lone(30, 12, 1) == 1
    assert lone(30, 12, 4) is None
    assert lone(30, 7, 0) is None


def test_lines_in_common_do_not_outweigh_a_clean_pose_that_chance_does_not_make(scan: SurfaceIndex) -> None:
    judged = (BEST, Contradiction(0.2, 0.0), Contradiction(0.09, 0.0))
    assert lone_spotless_pose((at(0.0), at(10.0), at(20.0)), judged, scan, scan, lambda k: (0, 40, 0)[k]) is None
