"""Edges that are wider or narrower than single edges of the same photo are called composite."""

import numpy as np
import pytest

from algorithms.photos.edge_widths import DISPLACED, FEW, LEAST_TOLERANCE, composite_edges, displacement_stds

SINGLE_PX, NOISE = 0.6, 2.0


def judged(widths, contrasts=60.0, lengths=200.0):
    widths = np.asarray(widths, float)
    return composite_edges(widths, np.full(len(widths), contrasts), np.full(len(widths), lengths), NOISE)


def photo_widths(count, rng, spread=0.01):
    return SINGLE_PX * (1.0 + spread * rng.standard_normal(count))


@pytest.mark.parametrize("factor", [1.3, 0.7])
def test_an_edge_that_is_much_wider_or_narrower_than_the_others_is_composite(factor):
    widths = np.append(photo_widths(40, np.random.default_rng(1)), factor * SINGLE_PX)
    assert np.flatnonzero(judged(widths)).tolist() == [40]


def test_edges_as_wide_as_the_others_are_single():
    assert not judged(photo_widths(200, np.random.default_rng(2))).any()


def test_a_photo_of_one_width_without_scatter_has_no_composite_edges():
    assert not judged(np.full(30, SINGLE_PX)).any()


def test_composite_edges_are_found_even_if_most_edges_are_composite():
    rng = np.random.default_rng(3)
    widths = np.concatenate([photo_widths(50, rng), rng.uniform(0.75, 3.0, 70)])
    flags = judged(widths)
    assert flags[50:].all()
    assert not flags[:50].any()


def test_too_few_certain_widths_tell_nothing():
    widths = np.append(np.full(FEW - 2, SINGLE_PX), 5.0)
    assert not judged(widths).any()


def test_a_wide_edge_of_uncertain_width_is_not_accused():
    widths = np.append(photo_widths(40, np.random.default_rng(4)), 1.2 * SINGLE_PX)
    contrasts, lengths = np.full(41, 60.0), np.full(41, 200.0)
    contrasts[-1], lengths[-1] = 8.0, 20.0  # its width has a standard deviation of 0.15 px
    assert not composite_edges(widths, contrasts, lengths, NOISE)[-1]


def test_the_sharpness_of_a_poor_lens_may_vary_over_the_photo():
    rng = np.random.default_rng(5)
    varied = photo_widths(300, rng, spread=0.06)
    # 2.5 standard deviations on both sides hold 98.8 % of a normal distribution; the noise of the widths adds to them
    assert judged(varied).mean() < 0.012


def displacements(widths, contrasts=60.0, lengths=200.0):
    widths = np.asarray(widths, float)
    return displacement_stds(widths, np.full(len(widths), contrasts), np.full(len(widths), lengths), NOISE)


def test_edges_as_wide_as_the_others_are_displaced_by_nothing():
    assert displacements(photo_widths(100, np.random.default_rng(6))).max() == 0.0


@pytest.mark.parametrize("factor", [1.2, 0.8])
def test_an_edge_wider_or_narrower_than_the_others_may_be_displaced(factor):
    widths = np.append(np.full(40, SINGLE_PX), factor * SINGLE_PX)
    allowed = SINGLE_PX * (1.0 + np.sign(factor - 1.0) * LEAST_TOLERANCE)
    exact = DISPLACED * np.sqrt(abs((factor * SINGLE_PX) ** 2 - allowed**2))
    # what noise does to the width of so long an edge is hardly anything
    assert displacements(widths, lengths=1e6)[-1] == pytest.approx(exact, rel=0.02)


def test_two_edges_within_the_blur_lie_as_far_from_their_common_profile_as_stated():
    # a seventh of the contrast belongs to an edge so far from the other one
    share, apart_px = 1.0 / 7.25, 0.8
    between = np.sqrt(SINGLE_PX**2 + share * (1.0 - share) * apart_px**2)
    widths = np.append(np.full(40, SINGLE_PX), between)
    assert displacements(widths, lengths=1e6)[-1] == pytest.approx(share * apart_px, rel=0.35)
