"""Waves within strips are estimated with their sizes, and what corrections cannot follow is found."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from algorithms.progress import NoProgress
from algorithms.strips import strip_block
from algorithms.strips.adjustment import Adjusted
from algorithms.strips.control import ControlPatch
from algorithms.strips.homologous import homologous
from algorithms.strips.options import CorrectionOptions, StripOptions
from algorithms.strips.strip import Strip, Trajectory
from algorithms.strips.strip_block import adjust_strips
from algorithms.strips.waves import PER_KNOT, Knots, WaveSizes, knots_of, likeliest_sizes
from tests.scenes.flown_strips import GON, known_places, planted_errors, village
from tests.scenes.survey_flights import Country, Survey, SurveyedStrip, SurveyErrors, surveyed

SURVEY = Survey(length_m=420.0, lines=2, rows_per_s=30.0, points_per_row=130)
ERRORS = SurveyErrors(boresight_gon=(0.1, -0.08, 0.1))


@pytest.fixture(scope="module")
def country() -> Country:
    return Country.drawn(SURVEY, 1)


@pytest.fixture(scope="module")
def flown(country: Country) -> list[SurveyedStrip]:
    return surveyed(SURVEY, country, ERRORS, 1)


def adjusted(flown: list[SurveyedStrip], country: Country, *, with_path: bool = True, **corrections: bool) -> Adjusted:
    paths = [Trajectory(each.path_times_s, each.path_m, each.angles_rad) if with_path else None for each in flown]
    strips = [Strip(each.name, each.points_m, each.times_s, path) for each, path in zip(flown, paths, strict=True)]
    control = [ControlPatch(name, points, np.full(points.shape, 0.01)) for name, points in country.control(SURVEY, 1)]
    options = StripOptions(corrections=replace(CorrectionOptions(), **corrections))
    return adjust_strips(strips, control, options, NoProgress()).adjusted


def normalised(found: Adjusted, flown: list[SurveyedStrip]) -> np.ndarray:
    """Return errors of points over their standard deviations (strips, n, 3)."""
    every = []
    for number, strip in enumerate(flown):
        rows = np.linspace(0, len(strip.times_s) - 1, 60).astype(int)
        points, times = strip.silent_m[rows], strip.times_s[rows]
        moved = found.block.correction(found.state, number).applied(points, times)
        design = found.block.design(found.state, number, points, times)
        which = found.block.columns_of(number)
        variances = np.einsum("nic,cd,nid->ni", design, found.whole_cofactors[np.ix_(which, which)], design)
        every.append((moved - strip.true_m[rows]) / np.sqrt(variances))
    return np.array(every)


def test_sizes_of_waves_are_found_from_exact_values() -> None:
    rng, knots = np.random.default_rng(3), knots_of([(0.0, 40.0)] * 6)
    true = WaveSizes(0.02, 0.04, 1e-4, 5.0)
    values = np.concatenate([
        np.linalg.solve(np.linalg.cholesky(precision).T, rng.normal(size=len(precision)))
        for precision in true.precisions(knots)
    ])  # fmt: skip
    weights = np.tile([1e-3] * 3 + [1e-5] * 3, len(values) // PER_KNOT) ** -2.0
    found = likeliest_sizes(WaveSizes(), knots, np.diag(weights), weights * values)
    np.testing.assert_allclose(found.logarithms, true.logarithms, atol=0.25)


def test_knots_interpolate_linearly_and_spread_the_same_way() -> None:
    knots, rng = Knots(np.array([0.0, 1.0, 3.0])), np.random.default_rng(0)
    values, times, fields = rng.normal(size=(3, 6)), np.array([0.0, 0.25, 2.0, 3.0]), rng.normal(size=(4, 6))
    numbers, derivatives = knots.spread(fields, times)
    np.testing.assert_allclose(
        (derivatives * values.ravel()[numbers]).sum(axis=1), (fields * knots.interpolated(values, times)).sum(axis=1)
    )


def test_a_block_of_too_many_strips_has_no_waves() -> None:
    assert knots_of([(0.0, 10.0)] * 200) == []


def test_the_design_is_that_of_differences(flown: list[SurveyedStrip], country: Country) -> None:
    found = adjusted(flown, country, with_path=False)
    block, state, strip = found.block, found.state, flown[1]
    points, times = strip.silent_m[::3000], strip.times_s[::3000]
    design, columns = block.design(state, 1, points, times), block.columns_of(1)
    for k in np.random.default_rng(0).permutation(len(columns))[:25].tolist():
        step = 1e-6 * (np.arange(block.count) == columns[k])
        ends = [block.correction(block.moved(state, sign * step, 0.0 * state.planes), 1) for sign in (1.0, -1.0)]
        apart = (ends[0].applied(points, times) - ends[1].applied(points, times)) / 2e-6
        np.testing.assert_allclose(design[:, :, k], apart, rtol=1e-6, atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("with_path", [True, False])
def test_points_are_as_wrong_as_said_with_waves_and_a_boresight(
    flown: list[SurveyedStrip], country: Country, *, with_path: bool
) -> None:
    found = adjusted(flown, country, with_path=with_path)
    assert found.block.with_boresight is with_path
    assert found.block.with_mount is not with_path
    assert np.sqrt((normalised(found, flown) ** 2).mean()) < 1.5
    assert not found.along.significant


@pytest.mark.slow
def test_waves_that_polynomials_do_not_follow_are_found_in_blocks_of_residuals(
    flown: list[SurveyedStrip], country: Country
) -> None:
    found = adjusted(flown, country, waves=False)
    assert found.along.significant
    assert found.block_factor > 1.5


def test_patches_are_looked_for_until_they_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    # a bore-sight of 0.16 gon without trajectories moves the strips by half a metre: two passes left them 1.4 m off
    planted = replace(planted_errors(2), boresight_rad=0.16 * GON * np.array([0.6, -0.6, 0.53]))
    flown = village(planted, seed=2)[:3]
    strips = [Strip(each.strip.name, each.strip.points, each.strip.times_s) for each in flown]
    looked = []

    def counted(*arguments: Any) -> Any:
        looked.append(1)
        return homologous(*arguments)

    monkeypatch.setattr(strip_block, "homologous", counted)
    found = adjust_strips(strips, known_places(), StripOptions(), NoProgress()).adjusted
    assert 2 < len(looked) <= 6
    for number, each in enumerate(flown):
        moved = found.block.correction(found.state, number).applied(each.strip.points, each.strip.times_s)
        assert np.abs((moved - each.true_points).mean(axis=0)).max() < 0.7
