"""Photos and scan of a station tell by the lines that both show whether cameras sit where they are said to sit."""

import numpy as np
import pytest

from algorithms.features.mount_test import MountTest
from algorithms.features.photo_lines.mount_contradictions import check_mounts
from algorithms.features.photo_lines.projection_options import MergeOptions
from tests.scenes.lines.merged_line_scenes import DrawnRoom, drawn_room

GON = np.pi / 200.0
SHARP = MergeOptions(rounding_std_m=0.0)
TIGHT = (0.001 * GON, 0.0001)
"""A mount known to 0.001 gon and 0.1 mm."""
TENTH = np.array([0.0, 0.0, 0.1 * GON, 0.0, 0.0, 0.0])
"""0.1 gon about z."""


def checked(room: DrawnRoom, options: MergeOptions = SHARP) -> MountTest:
    return check_mounts(room.cloud, room.planes, [room.part], [room.mount], options)


@pytest.mark.parametrize("seed", range(5))
def test_a_tenth_of_a_gon_that_mount_std_does_not_allow_contradicts(seed: int) -> None:
    room = drawn_room(np.random.default_rng(seed), 10, mount_std=TIGHT, mount_error=TENTH)
    assert checked(room).contradicts


@pytest.mark.parametrize("seed", range(5))
def test_a_tenth_of_a_gon_that_mount_std_allows_contradicts_nothing(seed: int) -> None:
    room = drawn_room(np.random.default_rng(seed), 10, mount_std=(0.1 * GON, 0.0001), mount_error=TENTH)
    assert not checked(room).contradicts


@pytest.mark.parametrize("seed", range(5))
def test_rounded_edges_do_not_hide_a_tenth_of_a_gon(seed: int) -> None:
    room = drawn_room(np.random.default_rng(seed), 10, mount_std=TIGHT, mount_error=TENTH)
    assert checked(room, MergeOptions()).contradicts


@pytest.mark.slow
def test_good_mounts_give_chi_square() -> None:
    rng = np.random.default_rng(1)
    found = [checked(drawn_room(rng, 6)) for _ in range(60)]
    assert {test.degrees_of_freedom for test in found} == {6}
    # 6 with a standard deviation of the mean of 0.45
    assert np.mean([test.statistic for test in found]) == pytest.approx(6.0, abs=1.3)


@pytest.mark.slow
def test_estimated_mount_errors_are_as_certain_as_they_say() -> None:
    rng = np.random.default_rng(2)
    squares = []
    for _ in range(40):
        test = checked(drawn_room(rng, 8, mount_std=TIGHT, mount_error=TENTH))
        left = test.mount_errors[0] - TENTH
        squares.append(left @ np.linalg.solve(test.error_covariances[0], left))
    # 6 with a standard deviation of the mean of 0.55
    assert np.mean(squares) == pytest.approx(6.0, abs=1.6)


@pytest.mark.parametrize("seed", range(6))
def test_photo_lines_that_show_something_else_do_not_make_a_mount_wrong(seed: int) -> None:
    room = drawn_room(np.random.default_rng(seed), 10, mount_std=TIGHT, wrong=2)
    assert not checked(room).contradicts


@pytest.mark.parametrize("seed", range(5))
def test_photo_lines_that_show_something_else_do_not_hide_a_wrong_mount(seed: int) -> None:
    room = drawn_room(np.random.default_rng(seed), 10, mount_std=TIGHT, mount_error=TENTH, wrong=3)
    assert checked(room).contradicts


def test_three_lines_are_too_few_to_blame_the_mount() -> None:
    test = checked(drawn_room(np.random.default_rng(3), 3, mount_std=TIGHT, mount_error=TENTH))
    assert (test.degrees_of_freedom, test.statistic, test.critical) == (0, 0.0, 0.0)
    assert test.in_words() is None


def test_a_second_photo_is_judged_by_itself() -> None:
    rng = np.random.default_rng(4)
    room = drawn_room(rng, 10, mount_std=TIGHT, mount_error=TENTH)
    none = room.part[np.zeros(len(room.part), dtype=bool)]
    test = check_mounts(room.cloud, room.planes, [none, room.part], [room.mount] * 2, SHARP)
    assert test.pair_counts[0] == 0
    assert test.statistics[0] == 0.0
    assert test.statistics[1] > test.criticals[1]
    assert test.statistic == pytest.approx(test.statistics[1], rel=1e-9)


def test_two_photos_of_the_same_lines_share_what_rounding_and_planes_do() -> None:
    """The second photo has the same edges without errors of their own: it adds nothing but its own mount."""
    room = drawn_room(np.random.default_rng(5), 10, mount_std=TIGHT, mount_error=TENTH)
    two = check_mounts(room.cloud, room.planes, [room.part] * 2, [room.mount] * 2, MergeOptions(rounding_std_m=0.003))
    # independent photos would add up
    assert two.statistic < 0.8 * two.statistics.sum()


def test_no_photos_contradict_nothing() -> None:
    room = drawn_room(np.random.default_rng(6), 4)
    test = check_mounts(room.cloud, room.planes, [], [], SHARP)
    assert not test.contradicts
    assert test.mount_errors.shape == (0, 6)


def test_words_name_angle_axis_and_test_value() -> None:
    covariance = np.diag([(0.004 * GON) ** 2] * 3 + [0.002**2] * 3)
    test = MountTest(
        statistic=812.34,
        degrees_of_freedom=6,
        critical=22.46,
        variance_factor=1.0,
        pair_counts=np.array([10, 12]),
        statistics=np.array([3.0, 800.0]),
        degrees_of_freedom_each=np.array([6, 6]),
        criticals=np.array([22.46, 22.46]),
        mount_errors=np.array([np.zeros(6), [0.0, 0.0, -0.1 * GON, 0.0006, 0.0008, 0.0]]),
        error_covariances=np.stack([covariance] * 2),
    )
    assert test.in_words() == (
        "the photos contradict the scan, which shows the same lines elsewhere: mount error of about photo 2 (12 "
        "lines): 0.100 gon about z (std 0.004 gon) and 1.0 mm along (0.60, 0.80, 0.00) (std 2.0 mm); global test "
        "T = 812.3 > 22.5 with 6 degrees of freedom"
    )
