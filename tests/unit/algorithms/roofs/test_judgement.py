"""A volume that is called right is right, for eleven kinds of buildings; what is not is said with its share."""

import numpy as np
import pytest

from algorithms.arrays import Array
from algorithms.errors import InvalidInputError
from algorithms.roofs.building import ground_height_m, modelled_building
from algorithms.roofs.judgement import BuildingFigures, figures_of
from algorithms.roofs.options import RoofOptions
from algorithms.roofs.outlines import found_outlines
from algorithms.roofs.planes import noise_of
from tests.scenes.roof_kinds import KINDS, RoofKind, flown

OPTIONS = RoofOptions()
NOISES_M = [(0.02, 0.01), (0.05, 0.03), (0.1, 0.05)]


def judged(points: Array, kind: RoofKind, *, found: bool) -> tuple[float, BuildingFigures, str | None]:
    """Give the error of the volume as a share, and what is said of it."""
    outline, ground, ground_std = kind.outline, 0.0, 0.0
    if found:
        outlines, grounds = found_outlines(points, OPTIONS, 20.0)
        outline, ground = outlines[0], grounds[0]
    else:
        ground, ground_std = ground_height_m(points, outline)
    model = modelled_building(points, outline, ground, OPTIONS)
    figures = figures_of(model, points, outline, OPTIONS, found_plan=found, ground_std_m=ground_std)
    reason = figures.reason(model.volume_m3, found_plan=found)
    return model.volume_m3 / kind.volume_m3() - 1.0, figures, reason if model.watertight else "open"


def test_a_steep_pyramid_under_a_level_plane_is_not_called_right() -> None:
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-12.0, 12.0, (2, 3600))
    on = (np.abs(x) < 4.0) & (np.abs(y) < 4.0)
    z = np.where(on, 8.0 + 1.2 * (4.0 - np.maximum(np.abs(x), np.abs(y))), 0.0)
    points = np.column_stack([x, y, z]) + rng.normal(0.0, 1.0, (3600, 3)) * [0.05, 0.05, 0.03]
    kind = KINDS["pyramid"]
    assert kind.volume_m3() == pytest.approx(614.4, rel=1e-3)
    error, _, reason = judged(points, kind, found=False)
    assert abs(error) <= 0.01 or reason


@pytest.mark.parametrize("name", list(KINDS))
def test_a_volume_over_a_stated_plan_that_is_called_right_is_right(name: str) -> None:
    error, _, reason = judged(flown(KINDS[name], 1, 6.0, (0.05, 0.03)), KINDS[name], found=False)
    assert abs(error) <= 0.01 or reason


@pytest.mark.parametrize("name", list(KINDS))
def test_a_roof_of_little_noise_is_called_right(name: str) -> None:
    error, figures, reason = judged(flown(KINDS[name], 1, 6.0, (0.02, 0.01)), KINDS[name], found=False)
    assert reason is None
    assert error == pytest.approx(0.0, abs=0.01)
    assert figures.share_without_face < 0.05


@pytest.mark.parametrize("name", ["gable", "steep gable", "hip", "pyramid", "mansard", "ell", "dormer"])
def test_faces_are_found_in_noise_that_the_request_does_not_state(name: str) -> None:
    error, _, reason = judged(flown(KINDS[name], 1, 6.0, (0.1, 0.05)), KINDS[name], found=False)
    assert reason is None
    assert error == pytest.approx(0.0, abs=0.01)


def test_noise_of_places_and_heights_is_told_apart_by_slopes() -> None:
    points = flown(KINDS["mansard"], 1, 12.0, (0.1, 0.05))
    noise = noise_of(points[points[:, 2] > 2.0], OPTIONS)
    assert noise.vertical_m == pytest.approx(0.05, rel=0.25)
    assert noise.horizontal_m == pytest.approx(0.1, rel=0.25)


def test_a_roof_of_which_a_part_was_not_seen_says_how_much() -> None:
    kind = KINDS["gable"]
    points = flown(kind, 1, 12.0, (0.02, 0.01))
    hidden = (points[:, 0] > 0.0) & (np.abs(points[:, 1]) < 4.5) & (points[:, 0] < 6.0) & (points[:, 2] > 1.0)
    _, figures, reason = judged(points[~hidden], kind, found=False)
    assert figures.unseen_share == pytest.approx(5.0 / 12.0, abs=0.05)
    assert reason is not None
    assert "have no point near" in reason


def test_a_plan_that_its_faces_do_not_cover_is_not_called_right() -> None:
    kind = KINDS["gable"]
    points = flown(kind, 1, 6.0, (0.02, 0.01))
    half = np.array([[-6.0, -4.0], [6.0, -4.0], [6.0, 0.0], [-6.0, 0.0]])
    model = modelled_building(points, half, 0.0, OPTIONS)
    figures = figures_of(model, points, kind.outline, OPTIONS, found_plan=False)
    assert figures.misfit_m3 == pytest.approx(0.5 * kind.volume_m3(), rel=0.03)


def test_an_uncertain_height_of_the_ground_makes_the_volume_uncertain() -> None:
    kind = KINDS["flat"]
    points = flown(kind, 1, 6.0, (0.02, 0.01))
    model = modelled_building(points, kind.outline, 0.0, OPTIONS)
    figures = figures_of(model, points, kind.outline, OPTIONS, found_plan=False, ground_std_m=0.04)
    assert figures.misfit_std_m3 == pytest.approx(0.04 * 96.0, rel=0.01)
    assert figures.reason(model.volume_m3, found_plan=False) is not None


FLIGHTS = [(seed, density, noise) for seed in range(5) for density in (4.0, 6.0, 12.0) for noise in NOISES_M]
"""Seed, points per square metre and noise."""
FEW = [(k % 5, (4.0, 6.0, 12.0)[k // 3], NOISES_M[k % 3]) for k in range(9)]
"""One seed for every density and noise."""


@pytest.mark.parametrize("found", [False, True], ids=["stated", "found"])
@pytest.mark.parametrize(
    "flights",
    [pytest.param(FEW, marks=pytest.mark.slow, id="few"), pytest.param(FLIGHTS, marks=pytest.mark.benchmark, id="all")],
)
@pytest.mark.parametrize("name", list(KINDS))
def test_no_wrong_volume_is_called_right_over_seeds_densities_and_noises(
    name: str, flights: list[tuple[int, float, tuple[float, float]]], *, found: bool
) -> None:
    kind, wrong = KINDS[name], []
    for seed, density, noise in flights:
        try:
            error, _, reason = judged(flown(kind, seed, density, noise), kind, found=found)
        except InvalidInputError:
            continue
        if reason is None and abs(error) > (0.04 if found else 0.01):
            wrong.append((seed, density, noise, error))
    assert not wrong
