"""Free space that all points of a scan know of, and its thinned surface does not."""

import numpy as np
import pytest

from algorithms.scans.range_image import SphericalRangeImage, spherical_range_image
from algorithms.scans.surface_index import EvidenceLimits, SurfaceIndex, evidence_of, surface_index

SENSOR_M = np.zeros(3)
LIMITS = EvidenceLimits(0.08, np.radians(20.0), 0.25)
WALL_M, BEHIND_M, HALF_SLIT_M = 6.0, 12.0, 0.2
"""A wall six metres away, and what a slit of 0.4 m (3.8 degrees) in it lets be seen."""


def _facing(points: np.ndarray) -> np.ndarray:
    return np.tile([-1.0, 0.0, 0.0], (len(points), 1))


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    """All points of the scan, a tenth of a degree apart."""
    azimuth, elevation = np.meshgrid(np.radians(np.arange(-30.0, 30.0, 0.1)), np.radians(np.arange(-10.0, 10.0, 0.1)))
    directions = np.column_stack([np.ones(azimuth.size), np.tan(azimuth.ravel()), np.tan(elevation.ravel())])
    through = np.abs(WALL_M * directions[:, 1]) < HALF_SLIT_M
    return directions * np.where(through, BEHIND_M, WALL_M)[:, None]


@pytest.fixture(scope="module")
def seen(points) -> SphericalRangeImage:
    return spherical_range_image(points, SENSOR_M, np.radians(0.5))


def _in_the_slit(incidence_deg: float = 0.0) -> SurfaceIndex:
    """A board three metres behind the slit, where the instrument looked through; turned away by an angle."""
    y, z = np.meshgrid(np.linspace(-0.1, 0.1, 5), np.linspace(-0.5, 0.5, 20))
    board = np.column_stack([np.full(y.size, WALL_M + 3.0), y.ravel(), z.ravel()])
    turned = np.radians(incidence_deg)
    return surface_index(board, np.tile([-np.cos(turned), np.sin(turned), 0.0], (len(board), 1)), 0.1, SENSOR_M)


def _violation(fixed: SurfaceIndex, incidence_deg: float = 0.0) -> float:
    board = _in_the_slit(incidence_deg)
    found = evidence_of(np.eye(3)[None], np.zeros((1, 3)), board, fixed, points=1000, limits=LIMITS)
    return float(found.violation[0])


def test_what_stands_behind_a_slit_contradicts_what_all_points_saw(points, seen):
    thinned = points[::20]
    assert _violation(surface_index(thinned, _facing(thinned), 0.1, SENSOR_M, seen=seen)) > 0.9


@pytest.mark.parametrize(("incidence_deg", "contradicted"), [(75.0, True), (87.0, False)])
def test_what_is_met_so_flatly_that_it_sends_nothing_back_contradicts_nothing(
    points, seen, incidence_deg, contradicted
):
    thinned = points[::20]
    fixed = surface_index(thinned, _facing(thinned), 0.1, SENSOR_M, seen=seen)
    assert (_violation(fixed, incidence_deg) > 0.9) == contradicted


def test_the_thinned_surface_alone_cannot_tell_a_slit(points):
    thinned = points[::20]
    assert _violation(surface_index(thinned, _facing(thinned), 0.1, SENSOR_M)) < 0.1


def test_an_unknown_instrument_sees_nothing(points, seen):
    thinned = points[::20]
    assert not surface_index(thinned, _facing(thinned), 0.1, None, seen=seen).knows_free_space
