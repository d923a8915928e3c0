"""Rows of strips, and patches that stand for all of their points."""

from dataclasses import replace

import numpy as np
import pytest

from algorithms.arrays import Points
from algorithms.strips.adjustment import lifts_of
from algorithms.strips.block import COMBINED
from algorithms.strips.candidates import frames_of
from algorithms.strips.homologous import PointCells, homologous, times_counted
from algorithms.strips.options import PatchOptions
from algorithms.strips.patch_kernels import line_numbers
from algorithms.strips.strip import Strip

NORMAL = np.array([0.3, -0.2, 1.0]) / np.sqrt(1.13)


def tilted(noise_m: float, *, lag_m: float = 0.0) -> Strip:
    """Scan an inclined plane to and fro."""
    rng = np.random.default_rng(3)
    times = np.linspace(0.0, 2.0, 4000)
    row = np.arange(4000) // 100
    across = 40.0 * (np.arange(4000) % 100 / 99.0)
    across = np.where(row % 2 == 0, across, 40.0 - across)
    xy = np.column_stack([20.0 * times, across])
    z = -(xy @ NORMAL[:2]) / NORMAL[2]
    side = np.where(row % 2 == 0, 1.0, -1.0)
    points = np.column_stack([xy, z]) + (noise_m * rng.uniform(-1.7, 1.7, 4000) + lag_m * side)[:, None] * NORMAL
    return Strip("tilted", points, times, None, (row % 2 == 0).astype(np.int8))


def fitted(strip: Strip, places: Points, options: PatchOptions) -> tuple[Points, object]:
    frames = frames_of(np.tile(NORMAL, (len(places), 1)))
    cells = PointCells.of(strip.points, 0.5 * options.size_m)
    radii = np.full(len(places), 0.5 * options.size_m)
    return frames, homologous([strip], [cells], [places], frames, radii, options)


def test_four_anchors_make_the_normal_equations_of_all_points() -> None:
    strip, options = replace(tilted(0.02), directions=None), PatchOptions(floor_m=0.0)
    place = np.array([[20.0, 20.0, -(np.array([20.0, 20.0]) @ NORMAL[:2]) / NORMAL[2]]])
    frames, ties = fitted(strip, place, options)
    frame = frames[0]
    local = (strip.points - place[0]) @ frame
    inside = np.hypot(*(strip.points[:, :2] - place[0, :2]).T) <= 4.0
    u, v, w = local[inside].T
    design = np.column_stack([np.ones_like(u), u, v])
    solution = np.linalg.solve(design.T @ design, design.T @ w)
    assert ties.points[0] == inside.sum()  # nothing far off among these points
    anchors = (ties.anchors_m[0] - place[0]) @ frame
    rows = np.column_stack([np.ones(4), anchors[:, :2]])
    variance = 4.0 * ties.std_m[0] ** 2
    np.testing.assert_allclose(rows.T @ rows / variance, design.T @ design / ties.rms_m[0] ** 2, rtol=1e-9, atol=1e-3)
    np.testing.assert_allclose(anchors[:, 2], rows @ solution, atol=1e-12)
    # their fourth combination is zero: three observations say all
    assert np.array([1.0, -1.0, 1.0, -1.0]) @ anchors[:, 2] == pytest.approx(0.0, abs=1e-12)
    assert COMBINED @ anchors[:, 2] @ COMBINED @ anchors[:, 2] == pytest.approx((anchors[:, 2] ** 2).mean())
    assert ties.times_s[0].mean() == pytest.approx(strip.times_s[inside].mean())


def test_heaps_on_a_patch_are_outliers_and_a_heap_that_is_too_large_makes_it_none() -> None:
    strip = tilted(0.01)
    place = np.array([[20.0, 20.0, -(np.array([20.0, 20.0]) @ NORMAL[:2]) / NORMAL[2]]])
    inside = np.flatnonzero(np.hypot(*(strip.points[:, :2] - place[0, :2]).T) <= 4.0)
    _, clean = fitted(strip, place, PatchOptions())
    for share, found in ((0.15, 1), (0.3, 0)):
        points = strip.points.copy()
        points[inside[: int(share * len(inside))], 2] += 1.5
        _, ties = fitted(Strip("heaped", points, strip.times_s, None, strip.directions), place, PatchOptions())
        assert len(ties) == found
        if found:
            assert np.abs((ties.anchors_m - clean.anchors_m).mean(axis=(0, 1)) @ NORMAL) < 0.003


def test_the_lag_of_a_swinging_mirror_is_told_from_the_height() -> None:
    place = np.array([[20.0, 20.0, -(np.array([20.0, 20.0]) @ NORMAL[:2]) / NORMAL[2]]])
    _, ties = fitted(tilted(0.01, lag_m=0.02), place, PatchOptions())
    assert ties.lag_m[0] == pytest.approx(0.02, abs=3.0 * ties.lag_std_m[0])
    assert np.abs((ties.anchors_m[0] - place[0]) @ NORMAL).max() < 0.01


@pytest.mark.parametrize("oscillating", [True, False])
def test_lines_are_told_by_the_turns_of_the_mirror_also_where_points_are_missing(*, oscillating: bool) -> None:
    angles = np.tile(np.linspace(-1.0, 1.0, 50), 20).reshape(20, 50)
    if oscillating:
        angles[1::2] = angles[1::2, ::-1]
    rows = np.repeat(np.arange(20), 50)
    rng = np.random.default_rng(1)
    seen = rng.random(1000) < 0.8
    noisy = angles.ravel() + rng.normal(0.0, 0.01, 1000)
    found = line_numbers(noisy[seen], 0.2, 1.0)
    assert found[-1] == 19
    # at the turn itself a point or two may count for the neighbour
    assert (found == rows[seen]).mean() > 0.98


def test_a_shift_along_the_normal_is_what_its_estimation_takes_off_the_squares() -> None:
    rng = np.random.default_rng(4)
    design, values = rng.normal(size=(24, 5)), rng.normal(size=24)
    lifted = np.column_stack([design, np.arange(24) == 3])
    squares = [float(np.linalg.lstsq(columns, values)[1][0]) for columns in (design, lifted)]
    tie = slice(3, 6)
    for used in (True, False):
        rows = np.ones(24, dtype=bool)
        rows[tie] = used
        unknowns = np.linalg.lstsq(design[rows], values[rows])[0]
        spread = (design[tie] @ np.linalg.inv(design[rows].T @ design[rows]) @ design[tie].T)[None]
        own = np.eye(3) + (-spread if used else spread)
        (found,) = lifts_of(own, (values - design @ unknowns)[None, tie], used=np.array([used]))
        assert found == pytest.approx(squares[0] - squares[1], rel=1e-9)


def test_points_that_patches_share_count_once_in_all() -> None:
    places, radii = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 5.0], [0.5, 0.0], [30.0, 0.0]]), np.array([4, 4, 4, 2.0, 4])
    drawn = np.random.default_rng(0).uniform(-10.0, 10.0, (100_000, 2))
    inside = np.hypot(*(drawn[:, None] - places).transpose(2, 0, 1)) < radii
    expected = [inside.sum(axis=1)[inside[:, k]].mean() for k in range(4)]
    np.testing.assert_allclose(times_counted(places, radii), [*expected, 1.0], rtol=0.01)
