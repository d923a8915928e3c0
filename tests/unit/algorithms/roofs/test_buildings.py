"""Simulated roofs: their faces are found, and the buildings enclose what they enclose in truth."""

from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import cKDTree

from algorithms.arrays import Array
from algorithms.deviations.signed_distances import inside_polygon
from algorithms.errors import InvalidInputError
from algorithms.roofs.building import ROOF, BuildingModel, ground_height_m, modelled_building
from algorithms.roofs.options import RoofOptions
from algorithms.roofs.partition import area_of
from tests.scenes.roof_kinds import KINDS, flown

EAVES_M, NOISE_M, SPACING_M = 6.0, 0.02, 0.4
RECTANGLE = np.array([[0.0, 0.0], [14.0, 0.0], [14.0, 8.0], [0.0, 8.0]])
ELL = np.array([[0.0, 0.0], [16.0, 0.0], [16.0, 8.0], [8.0, 8.0], [8.0, 18.0], [0.0, 18.0]])
Height = Callable[[Array, Array], Array]


def flat(x: Array, y: Array) -> Array:  # noqa: ARG001
    return np.full_like(x, EAVES_M)


def gable(x: Array, y: Array) -> Array:  # noqa: ARG001
    return EAVES_M + 0.7 * np.minimum(y, 8.0 - y)


def hip(x: Array, y: Array) -> Array:
    return EAVES_M + 0.7 * np.minimum(np.minimum(y, 8.0 - y), np.minimum(x, 14.0 - x))


def ell(x: Array, y: Array) -> Array:
    """Two gables of one width that meet in a hip and a valley; each end a gable."""
    along_x = np.where(y <= 8.0, np.minimum(y, 8.0 - y), -np.inf)
    along_y = np.where(x <= 8.0, np.minimum(x, 8.0 - x), -np.inf)
    corner = np.minimum(np.minimum(x, y), np.maximum(8.0 - x, 8.0 - y))
    return EAVES_M + 0.7 * np.where((x <= 8.0) & (y <= 8.0), corner, np.maximum(along_x, along_y))


def stepped(x: Array, y: Array) -> Array:  # noqa: ARG001
    return np.where(x < 5.0, EAVES_M + 3.0, EAVES_M)


def scanned(outline: Array, height: Height, seed: int = 1, turn_rad: float = 0.3) -> tuple[Array, Array]:
    """Points of roof and ground, turned about the vertical as no axis of a site lies along a side; and the plan."""
    rng = np.random.default_rng(seed)
    low, high = outline.min(axis=0) - 4.0, outline.max(axis=0) + 4.0
    count = int(np.prod(high - low) / SPACING_M**2)
    places = rng.uniform(low, high, (count, 2))
    inside = inside_polygon(places, outline)
    z = np.where(inside, height(*places.T), 0.0) + rng.normal(0.0, NOISE_M, count)
    turn = np.array([[np.cos(turn_rad), -np.sin(turn_rad)], [np.sin(turn_rad), np.cos(turn_rad)]])
    return np.column_stack([places @ turn.T, z]), outline @ turn.T


def true_volume_m3(outline: Array, height: Height) -> float:
    step = 0.01
    x, y = np.meshgrid(*(np.arange(outline[:, k].min() + step / 2, outline[:, k].max(), step) for k in (0, 1)))
    places = np.column_stack([x.ravel(), y.ravel()])
    return float(height(*places[inside_polygon(places, outline)].T).sum() * step**2)


def modelled(outline: Array, height: Height) -> BuildingModel:
    points, plan = scanned(outline, height)
    return modelled_building(points, plan, ground_height_m(points, plan)[0], RoofOptions(neighbourhood_m=1.2))


@pytest.mark.parametrize(
    ("outline", "height", "faces"),
    [(RECTANGLE, flat, 1), (RECTANGLE, gable, 2), (RECTANGLE, hip, 4), (ELL, ell, 4), (RECTANGLE, stepped, 2)],
    ids=["flat", "gable", "hip", "ell", "stepped"],
)
def test_a_roof_has_its_faces_and_the_building_its_volume(outline: Array, height: Height, faces: int) -> None:
    model = modelled(outline, height)
    roof = [surface for surface in model.surfaces if surface.kind == ROOF]
    assert len(model.planes) == faces
    assert len(roof) == faces
    assert model.watertight
    ground = -NOISE_M * 1.28 * area_of(outline)  # the low quantile lies below the mean by so much
    assert model.volume_m3 == pytest.approx(true_volume_m3(outline, height) - ground, rel=0.01)
    for plane in model.planes:
        assert plane.rms_m == pytest.approx(NOISE_M, rel=0.25)
        assert plane.after >= plane.before > 0
    plan = sum(area_of(model.vertices[surface.rings[0], :2]) for surface in roof)
    assert plan == pytest.approx(area_of(outline), rel=1e-4)


@pytest.mark.parametrize("noise_m", [0.01, 0.05, 0.2])
def test_level_ground_is_as_high_as_it_is_whatever_its_noise(noise_m: float) -> None:
    errors = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        places = rng.uniform(RECTANGLE.min(axis=0) - 4.0, RECTANGLE.max(axis=0) + 4.0, (1500, 2))
        height, std = ground_height_m(np.column_stack([places, rng.normal(3.0, noise_m, 1500)]), RECTANGLE)
        errors.append((height - 3.0) / std)
        assert std < 0.15 * noise_m
    assert abs(np.mean(errors)) < 0.7
    assert np.std(errors) < 1.5


def test_on_a_slope_a_building_stands_on_the_low_ground() -> None:
    rng = np.random.default_rng(1)
    places = rng.uniform(RECTANGLE.min(axis=0) - 3.0, RECTANGLE.max(axis=0) + 3.0, (3000, 2))
    points = np.column_stack([places, 0.1 * places[:, 0] + rng.normal(0.0, 0.02, 3000)])
    height, _ = ground_height_m(points, RECTANGLE)
    assert height == pytest.approx(-0.18, abs=0.03)  # a tenth of what lies beside the plan is lower


@pytest.mark.parametrize("name", list(KINDS))
@pytest.mark.parametrize("noise_m", [(0.02, 0.01), (0.1, 0.05)], ids=["fine", "coarse"])
def test_a_building_is_a_valid_solid(name: str, noise_m: tuple[float, float]) -> None:
    points, plan = flown(KINDS[name], 2, 6.0, noise_m), KINDS[name].outline
    model = modelled_building(points, plan, 0.0, RoofOptions())
    assert model.watertight
    sides: Counter[tuple[int, int]] = Counter()
    for surface in model.surfaces:
        for ring in surface.rings:
            assert len(set(ring.tolist())) == len(ring) >= 3
            sides.update(zip(ring.tolist(), np.roll(ring, -1).tolist(), strict=True))
        outer = model.vertices[surface.rings[0]] - model.vertices[surface.rings[0][0]]
        normal = np.cross(outer, np.roll(outer, -1, axis=0)).sum(axis=0)
        assert 0.5 * np.linalg.norm(normal) > 1e-4
        corners = model.vertices[np.concatenate(surface.rings)]
        apart = (corners - corners.mean(axis=0)) @ (normal / np.linalg.norm(normal))
        assert np.abs(apart).max() < 0.01
    assert all(count == 1 and sides[end, start] == 1 for (start, end), count in sides.items())
    distances, _ = cKDTree(model.vertices).query(model.vertices, k=2)
    assert np.asarray(distances)[:, 1].min() > 0.015


def test_what_no_plane_takes_gets_a_level_one() -> None:
    kind = KINDS["parapet"]
    model = modelled_building(flown(kind, 1, 6.0, (0.02, 0.01)), kind.outline, 0.0, RoofOptions())
    assert sorted(float(plane.parameters[2]) for plane in model.planes) == pytest.approx([6.0, 7.0], abs=0.02)


def test_what_stands_on_a_roof_changes_no_face() -> None:
    points, plan = scanned(RECTANGLE, gable)
    rng = np.random.default_rng(2)
    chimney = np.column_stack([plan.mean(axis=0) + rng.uniform(-0.3, 0.3, (30, 2)), rng.uniform(9.0, 11.0, 30)])
    model = modelled_building(np.concatenate([points, chimney]), plan, 0.0, RoofOptions(neighbourhood_m=1.2))
    assert len(model.planes) == 2
    assert model.volume_m3 == pytest.approx(true_volume_m3(RECTANGLE, gable), rel=0.01)


def test_a_plan_without_ground_or_roof_says_so() -> None:
    points, plan = scanned(RECTANGLE, gable)
    with pytest.raises(InvalidInputError, match="ground"):
        ground_height_m(points, plan + 100.0)
    with pytest.raises(InvalidInputError, match="0 points of a roof"):
        modelled_building(points, plan + 100.0, 0.0, RoofOptions())
