"""Planted errors of strips are found, with honest standard deviations; what cannot be known is said."""

from dataclasses import replace

import numpy as np
import pytest

from algorithms.adjustment.testing import GlobalVerdict
from algorithms.errors import InvalidInputError, TooFewCorrespondencesError
from algorithms.progress import NoProgress
from algorithms.simulation.strip_flights import FlownStrip, PlantedErrors
from algorithms.strips.corrections import Degrees
from algorithms.strips.determination import determination_of
from algorithms.strips.discrepancies import discrepancies, figures_of
from algorithms.strips.options import CorrectionOptions, PatchOptions, StripOptions
from algorithms.strips.strip import Strip
from algorithms.strips.strip_block import StripBlock, adjust_strips
from tests.scenes.flown_strips import DEGREES, LAND, LINES, known_places, planted_errors, village

RAISED = replace(LAND, raised=12, raised_side_m=18.0)


@pytest.fixture(scope="module")
def planted() -> PlantedErrors:
    return planted_errors(1)


@pytest.fixture(scope="module")
def flown(planted: PlantedErrors) -> list[FlownStrip]:
    return village(planted, RAISED)


@pytest.fixture(scope="module")
def block(flown: list[FlownStrip]) -> StripBlock:
    return adjust_strips([each.strip for each in flown], known_places(RAISED), StripOptions(), NoProgress())


def test_planted_shifts_drifts_tilts_and_boresight_are_found_as_well_as_said(
    block: StripBlock, planted: PlantedErrors
) -> None:
    adjusted = block.adjusted
    truth = np.concatenate([planted.coefficients.ravel(), planted.boresight_rad])
    error = adjusted.block.vector(adjusted.state) - truth
    assert (np.abs(error) <= 2.0 * np.sqrt(np.diag(adjusted.cofactors))).mean() >= 0.9
    nees = error @ np.linalg.solve(adjusted.cofactors, error) / len(error)
    assert 0.5 < nees < 1.5


def test_corrected_strips_lie_where_they_belong_and_on_each_other(block: StripBlock, flown: list[FlownStrip]) -> None:
    state = block.adjusted.state
    before = [each.strip.points for each in flown]
    after = [
        block.adjusted.block.correction(state, k).applied(each.strip.points, each.strip.times_s)
        for k, each in enumerate(flown)
    ]
    wrong, left = (
        np.sqrt(
            np.mean([((points - each.true_points) ** 2).mean() for points, each in zip(clouds, flown, strict=True)])
        )
        for clouds in (before, after)
    )
    assert left < 0.06 < 0.15 < wrong
    unadjusted, adjusted = (figures_of(discrepancies(clouds, 2.0).differences_m) for clouds in (before, after))
    assert adjusted.median_m < 0.02 < 0.06 < unadjusted.median_m


def test_patches_that_are_no_longer_the_same_surface_are_found(block: StripBlock) -> None:
    ties, adjusted = block.adjusted.block.ties, block.adjusted
    places = ties.anchors_m.mean(axis=1)[:, None, :2]
    from_middle = np.abs(places - RAISED.squares(LINES)).max(axis=2).min(axis=1)
    raised = (ties.strips % 2 == 1) & (from_middle < 0.5 * RAISED.raised_side_m - 4.0)
    assert raised.sum() >= 3
    assert not adjusted.paired[raised].any()
    elsewhere = from_middle > 0.5 * RAISED.raised_side_m + 5.0
    assert (~adjusted.used[elsewhere]).mean() <= 0.004


@pytest.mark.slow
def test_control_determines_the_block_and_without_it_that_is_said(block: StripBlock, flown: list[FlownStrip]) -> None:
    strips = [each.strip for each in flown]
    held = {motion.name: motion for motion in determination_of(block.adjusted, strips).motions}
    # four roofs in each corner tell a turn in plan no better than the assumption that there is none
    assert {name for name, motion in held.items() if not motion.determined} <= {"turn about z"}
    assert held["turn about z"].std < held["turn about z"].zero_std
    alone = determination_of(adjust_strips(strips, [], StripOptions(passes=1), NoProgress()).adjusted, strips)
    assert [motion.name for motion in alone.motions if not motion.determined] == [
        "shift along x", "shift along y", "shift along z", "turn about x", "turn about y", "turn about z",
    ]  # fmt: skip
    assert "height control" in next(motion for motion in alone.motions if motion.name == "shift along z").advice


@pytest.mark.slow
def test_over_level_ground_without_roofs_the_adjustment_settles_all_the_same() -> None:
    # patches of level ground tell the bore-sight by less than a millimetre: noise bends the equations as much
    level = replace(LAND, seed=0, relief_m=0.0, houses=0.0, trees=0.0)
    flown = village(planted_errors(0), level, 0)
    adjusted = adjust_strips([each.strip for each in flown], [], StripOptions(passes=1), NoProgress()).adjusted
    assert adjusted.test.verdict is not GlobalVerdict.TOO_LARGE


@pytest.mark.slow
def test_polynomials_without_patches_to_hold_them_do_not_swing(flown: list[FlownStrip]) -> None:
    # plants everywhere in the middle of the flight: ties at both ends only
    rng = np.random.default_rng(0)
    strips = []
    for each in (flown[0].strip, flown[2].strip, *(flown[k].strip for k in (3, 4))):
        inside = np.abs(each.points[:, 0] - 120.0) < 70.0
        points = each.points + np.column_stack(
            [np.zeros((len(inside), 2)), inside * rng.uniform(0.0, 6.0, len(inside))]
        )
        strips.append(replace(each, points=points))
    options = StripOptions(corrections=CorrectionOptions(shift_degree=5, tilt_degree=-1, boresight=False), passes=1)
    told = determination_of(adjust_strips(strips, [], options, NoProgress()).adjusted, strips)
    (first, *_) = told.oscillations
    assert first.strip in {0, 1}
    assert first.powers
    assert first.without_m > 3.0 * first.largest_m
    assert first.largest_m < 1.0
    held = {each.parameter for each in told.coefficients if each.strip == first.strip and each.held and each.power > 1}
    assert {"shift_x", "shift_y"} <= held


@pytest.mark.slow
def test_without_trajectories_points_are_corrected_by_polynomials(planted: PlantedErrors) -> None:
    shifts_only = planted.coefficients.copy()
    shifts_only[:, 6:] = 0.0
    flown = village(PlantedErrors(DEGREES, shifts_only))
    strips = [Strip(each.strip.name, each.strip.points, each.strip.times_s) for each in flown]
    options = StripOptions(corrections=CorrectionOptions(tilt_degree=-1))
    adjusted = adjust_strips(strips, known_places(), options, NoProgress()).adjusted
    error = adjusted.state.coefficients - shifts_only[:, :6]
    assert np.abs(error[:, 2]).max() < 0.01
    assert (np.abs(error.ravel()) <= 2.0 * np.sqrt(np.diag(adjusted.cofactors))).mean() >= 0.9
    assert not adjusted.block.with_boresight


@pytest.mark.slow
def test_an_observation_of_zero_that_is_wrong_is_given_up(planted: PlantedErrors) -> None:
    far = planted.coefficients.copy()
    far[1, 2] = 0.9
    options = StripOptions(corrections=CorrectionOptions(shift_std_m=0.1))
    flown = village(replace(planted, coefficients=far))
    adjusted = adjust_strips([each.strip for each in flown], known_places(), options, NoProgress()).adjusted
    given_up = np.flatnonzero(adjusted.zero_weights == 0.0)
    assert DEGREES.count + 2 in given_up
    assert adjusted.state.coefficients[1, 2] == pytest.approx(0.9, abs=0.1)


def test_strips_that_do_not_overlap_have_nothing_in_common(flown: list[FlownStrip]) -> None:
    first = flown[0].strip
    away = replace(first, name="away", points=first.points + np.array([1000.0, 0.0, 0.0]))
    with pytest.raises(TooFewCorrespondencesError, match="patches that two strips see"):
        adjust_strips([first, away], [], StripOptions(), NoProgress())
    with pytest.raises(InvalidInputError, match="one strip alone"):
        adjust_strips([first], [], StripOptions(), NoProgress())


@pytest.mark.slow
def test_steep_patches_alone_can_be_wanted(flown: list[FlownStrip]) -> None:
    options = StripOptions(patches=PatchOptions(least_slope_deg=15.0, size_m=5.0, spacing_m=10.0), passes=1)
    adjusted = adjust_strips([each.strip for each in flown], [], options, NoProgress()).adjusted
    assert np.degrees(np.arccos(adjusted.block.frames[:, 2, 2])).min() >= 15.0


@pytest.mark.slow
def test_roofs_alone_can_be_wanted(flown: list[FlownStrip]) -> None:
    roofs = PatchOptions(least_rise_m=3.0, size_m=4.0, spacing_m=10.0, least_points=8)
    strips = [each.strip for each in flown]
    block = adjust_strips(strips, [], StripOptions(patches=roofs, passes=1), NoProgress()).adjusted.block
    x, y, z = block.references_m.T
    # eaves are 6 m above the ground at the house's middle
    assert (z - RAISED.terrain(x, y)).min() > 2.0
    assert len(x) > 20


@pytest.mark.slow
def test_higher_powers_of_time_follow_a_wave_of_the_heights(planted: PlantedErrors) -> None:
    flown = village(replace(planted, wave_m=0.1, wave_s=10.0), LAND)
    left = []
    for degree in (1, 4):
        options = StripOptions(corrections=CorrectionOptions(shift_degree=degree, waves=False))
        adjusted = adjust_strips([each.strip for each in flown], known_places(LAND), options, NoProgress()).adjusted
        heights = [
            adjusted.block.correction(adjusted.state, k).applied(each.strip.points, each.strip.times_s)[:, 2]
            - each.true_points[:, 2]
            for k, each in enumerate(flown)
        ]
        left.append(float(np.sqrt(np.mean([(each**2).mean() for each in heights]))))
    assert left[1] < 0.03 < 0.06 < left[0]


def test_times_of_no_flight_are_refused(flown: list[FlownStrip]) -> None:
    first = flown[0].strip
    with pytest.raises(InvalidInputError, match="all its points have one time"):
        replace(first, times_s=np.zeros_like(first.times_s))
    with pytest.raises(InvalidInputError, match="not in the order"):
        replace(first, times_s=-first.times_s)
    with pytest.raises(InvalidInputError, match="does not cover"):
        replace(first, times_s=first.times_s + 1e4)
    assert Degrees.of(CorrectionOptions()).count == DEGREES.count
