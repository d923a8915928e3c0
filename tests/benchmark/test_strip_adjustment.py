"""Planted errors of strips over many made-up flights, and strips of a million points; run with -m benchmark -s."""

import time
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from algorithms.progress import NoProgress
from algorithms.simulation.strip_flights import Flight, Landscape, PlantedErrors, fly
from algorithms.strips.adjustment import Adjusted
from algorithms.strips.control import ControlPatch
from algorithms.strips.discrepancies import discrepancies
from algorithms.strips.options import StripOptions
from algorithms.strips.strip import Strip, Trajectory
from algorithms.strips.strip_block import adjust_strips
from tests.scenes.flown_strips import DEGREES, GON, LAND, LINES, known_places, village
from tests.scenes.survey_flights import Country, Survey, SurveyErrors, surveyed

pytestmark = pytest.mark.benchmark
FLIGHTS = 30
IMPROBABLE = 1e-4
"""Probability with which honest standard deviations fail the test of one kind of unknown at one end."""
STDS = np.array([0.3] * 3 + [0.1] * 3 + [0.02 * GON] * 3 + [0.01 * GON] * 3)
"""Planted errors are drawn from what the observations of zero expect: then normalised errors are standard normal."""
MOST_MISMATCHED = 0.004
"""Of good patches, as in the source's block (4 of 1002)."""
PATCH_RADIUS_M = 4.0
SAMPLES = 60
"""Points of a strip that are compared."""


def drawn(seed: int, strips: int) -> PlantedErrors:
    rng = np.random.default_rng(seed)
    return PlantedErrors(DEGREES, rng.normal(0.0, STDS, (strips, len(STDS))), rng.normal(0.0, 0.2 * GON, 3))


def in_axes_of(planted: PlantedErrors, strips: list[Strip]) -> np.ndarray:
    """Give what was planted in axes of the lines in those of the strips, whose paths waver a little."""
    out = planted.coefficients.copy()
    for number, (line, strip) in enumerate(zip(LINES, strips, strict=True)):
        x, y = (np.array(line.end_m) - line.start_m) / np.hypot(*(np.array(line.end_m) - line.start_m))
        nominal = np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])
        _, tilts = DEGREES.split(out[number])
        out[number, 3 * (DEGREES.shift + 1) :] = (tilts @ nominal.T @ strip.path.axes).ravel()
    return out


@pytest.mark.parametrize("with_control", [True, False])
def test_planted_errors_are_found_as_well_as_said(*, with_control: bool) -> None:
    normalised, nees, by_kind, good, lost, wrong, missed = [], [], [], 0, 0, 0, 0
    own = np.arange(len(LINES) * DEGREES.count).reshape(len(LINES), DEGREES.count)
    kinds = {f"{name} t^{power}": own[:, k] for k, (name, power) in enumerate(DEGREES.names())}
    kinds["boresight"] = own.size + np.arange(3)
    for seed in range(FLIGHTS):
        planted = drawn(seed, len(LINES))
        land = replace(LAND, seed=seed, raised=12, raised_side_m=18.0)
        strips = [each.strip for each in village(planted, land, seed)]
        control = known_places(land, seed=seed) if with_control else []
        adjusted = adjust_strips(strips, control, StripOptions(), NoProgress()).adjusted
        error = adjusted.block.vector(adjusted.state) - np.concatenate(
            [in_axes_of(planted, strips).ravel(), planted.boresight_rad]
        )
        normalised.append(error / np.sqrt(np.diag(adjusted.cofactors)))
        nees.append(float(error @ np.linalg.solve(adjusted.cofactors, error) / len(error)))
        # the strips of a block share motions that ties do not see: its values of one kind are one sample, not five
        parts = [(error[which], adjusted.cofactors[np.ix_(which, which)]) for which in kinds.values()]
        by_kind.append([float(part @ np.linalg.solve(covariance, part)) for part, covariance in parts])
        ties = adjusted.block.ties
        off = ties.anchors_m.mean(axis=1)[:, None, :2] - land.squares(LINES)
        near = np.abs(off).max(axis=2).min(axis=1)
        high = (near < 0.5 * land.raised_side_m - PATCH_RADIUS_M) & (ties.strips % 2 == 1)
        clear = near > 0.5 * land.raised_side_m + PATCH_RADIUS_M + 1.0
        # a raised patch misleads where a strip without the square sees its place too
        low = np.zeros(len(adjusted.block.references_m), dtype=bool)
        low[ties.patches[ties.strips % 2 == 0]] = True
        misleads = high & low[ties.patches]
        # where several strips see it raised, they may be right about each other, and the others are left out
        beside = np.zeros_like(low)
        beside[ties.patches[(ties.strips % 2 == 0) & adjusted.used]] = True
        wrong, missed = (
            wrong + int(misleads.sum()),
            missed + int((misleads & adjusted.used & beside[ties.patches]).sum()),
        )
        good, lost = good + int(clear.sum()), lost + int((clear & ~adjusted.used).sum())
    z = np.array(normalised)
    means = dict(zip(kinds, np.sum(by_kind, axis=0) / [FLIGHTS * len(which) for which in kinds.values()], strict=True))
    print(f"\ncontrol {with_control}: NEES {np.mean(nees):.2f}, within 2 std {(np.abs(z) <= 2.0).mean():.3f}; "
          f"{lost} of {good} good patches left out, {missed} of {wrong} wrong ones used; by kind "
          + ", ".join(f"{name} {value:.2f}" for name, value in means.items()))  # fmt: skip
    assert 0.8 < np.mean(nees) < 1.2
    assert (np.abs(z) <= 2.0).mean() > 0.93
    for name, which in kinds.items():
        degrees = FLIGHTS * len(which)
        least, most = (float(side(IMPROBABLE, degrees)) / degrees for side in (stats.chi2.ppf, stats.chi2.isf))
        assert least < means[name] < most, name
    assert lost <= MOST_MISMATCHED * good
    assert missed <= 0.1 * wrong


@pytest.mark.parametrize("with_path", [True, False])
def test_points_are_as_wrong_as_said_in_flights_of_another_simulator(*, with_path: bool) -> None:
    survey, inside, squares, factors = Survey(), [], [], []
    for seed in range(FLIGHTS):
        country = Country.drawn(survey, seed)
        draw = np.random.default_rng(seed).normal(0.0, 0.1, 3)
        flown = surveyed(survey, country, SurveyErrors(boresight_gon=(draw[0], draw[1], draw[2])), seed)
        paths = [Trajectory(each.path_times_s, each.path_m, each.angles_rad) if with_path else None for each in flown]
        strips = [Strip(each.name, each.points_m, each.times_s, path) for each, path in zip(flown, paths, strict=True)]
        control = [ControlPatch(name, at, np.full(at.shape, 0.01)) for name, at in country.control(survey, seed)]
        adjusted = adjust_strips(strips, control, StripOptions(), NoProgress()).adjusted
        factors.append(max(adjusted.along.factor, adjusted.across.factor))
        for number, each in enumerate(flown):
            rows = np.linspace(0, len(each.times_s) - 1, SAMPLES).astype(np.int64)
            points, times = each.silent_m[rows], each.times_s[rows]
            error = adjusted.block.correction(adjusted.state, number).applied(points, times) - each.true_m[rows]
            normalised = error / stds_of(adjusted, number, points, times)
            inside.append((np.abs(normalised) < stats.norm.isf(0.025)).mean(axis=0))
            squares.append((normalised**2).mean(axis=0))
    covered = np.mean(inside, axis=0)
    print(f"\npaths {with_path}: 95 % intervals hold {covered.mean():.3f} (x, y, z {covered.round(3)}), normalised rms "
          f"{np.sqrt(np.mean(squares, axis=0)).round(2)}, variance of blocks at most {max(factors):.2f}")  # fmt: skip
    assert 0.90 < covered.mean() < 0.98


def stds_of(adjusted: Adjusted, strip: int, points: np.ndarray, times: np.ndarray) -> np.ndarray:
    design, columns = adjusted.block.design(adjusted.state, strip, points, times), adjusted.block.columns_of(strip)
    covariance = adjusted.whole_cofactors[np.ix_(columns, columns)]
    return np.sqrt(np.einsum("nic,cd,nid->ni", design, covariance, design))


def test_strips_of_a_million_points_take_seconds() -> None:
    lines = Flight.block(2, 1000.0, cross=1)
    flight = Flight(lines, points_per_line=1000, lines_per_s=50.0)
    strips = [each.strip for each in fly(flight, Landscape(), drawn(1, 3), 1)]
    started = time.process_time()
    adjust_strips(strips, [], StripOptions(), NoProgress())
    adjusted = time.process_time() - started
    discrepancies([each.points for each in strips], 2.0)
    compared = time.process_time() - started - adjusted
    points = sum(len(each.points) for each in strips) / 1e6
    print(f"\n{points:.1f} M points, {len(strips)} strips: adjusted in {adjusted:.1f} s, compared in {compared:.1f} s")
    assert adjusted + compared < 20.0 * points
