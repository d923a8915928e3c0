"""The grid of a scan tells where up is, whatever the file's coordinates are."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.scans.scan import Scan, ScanGrid
from algorithms.scans.scanner_axis import scanner_axis

SENSOR = np.array([3.0, -2.0, 1.5])


def scan_in(rotation: Rotation, *, low_deg: float = -60.0, high_deg: float = 90.0, from_below: bool = False) -> Scan:
    """A panorama of a sphere with a third of its upper half missing, in turned coordinates."""
    elevations = np.deg2rad(np.linspace(low_deg, high_deg, 120) if from_below else np.linspace(high_deg, low_deg, 120))
    azimuths = np.linspace(-np.pi, np.pi, 240, endpoint=False)
    e, a = np.meshgrid(elevations, azimuths, indexing="ij")
    rng = np.random.default_rng(4)
    seen = (e < 0.0) | (rng.random(e.shape) > 1.0 / 3.0)
    rays = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)[seen]
    points = SENSOR + rotation.apply(rays * rng.uniform(4.0, 9.0, (len(rays), 1)))
    index = np.full(e.shape, -1, dtype=np.int32)
    index[seen] = np.arange(len(points))
    return Scan(points, np.zeros(3), grid=ScanGrid(index), sensor_m=SENSOR)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("from_below", [True, False])
def test_the_axis_of_turned_coordinates_is_found(seed: int, from_below: bool) -> None:
    rotation = Rotation.random(rng=np.random.default_rng(seed))
    axis = scanner_axis(scan_in(rotation, from_below=from_below))
    assert axis == pytest.approx(rotation.apply([0.0, 0.0, 1.0]), abs=1e-6)


def test_a_field_of_view_that_reaches_as_far_down_as_up_leaves_the_sign_to_the_coordinates() -> None:
    rotation = Rotation.from_rotvec([0.3, 0.2, 1.0])
    axis = scanner_axis(scan_in(rotation, low_deg=-50.0, high_deg=50.0))
    assert axis == pytest.approx(rotation.apply([0.0, 0.0, 1.0]), abs=1e-6)


def test_without_a_grid_the_coordinates_are_taken_as_upright() -> None:
    scan = replace(scan_in(Rotation.from_rotvec([0.5, 0.0, 0.0])), grid=None)
    assert scanner_axis(scan).tolist() == [0.0, 0.0, 1.0]


def test_a_grid_whose_columns_share_no_axis_is_no_scanner_s() -> None:
    scan = scan_in(Rotation.from_rotvec([0.5, 0.0, 0.0]))
    mixed = np.random.default_rng(5).permutation(scan.points)
    assert scanner_axis(replace(scan, points=mixed)).tolist() == [0.0, 0.0, 1.0]


def test_a_scan_without_points_is_upright() -> None:
    empty = Scan(np.empty((0, 3)), np.zeros(3), grid=ScanGrid(np.full((3, 4), -1, np.int32)), sensor_m=SENSOR)
    assert scanner_axis(empty).tolist() == [0.0, 0.0, 1.0]
