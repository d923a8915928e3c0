"""What every reader promises, whatever the format."""

from pathlib import Path

import numpy as np
import pytest

from service.errors import FileTooLargeError, UnreadableFileError
from service.formats.base import ReadLimits, ScanFile, ScanRecords
from service.formats.finishing import check_count, colors_8bit, finish, scan_info

FILE = ScanFile(Path("stored-under-an-id"), "room.e57")
TETRAHEDRON = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


def grid_records(**changes: object) -> ScanRecords:
    """Six points in 2 rows and 3 columns."""
    number = np.arange(6)
    points = np.column_stack([number, number**2, np.ones(6)]).astype(float)
    members = {"index": 0, "points": points, "row": number % 2, "column": number // 2} | changes
    return ScanRecords(**members)  # type: ignore[arg-type]


def test_points_that_are_not_finite_are_dropped() -> None:
    points = np.vstack([TETRAHEDRON, [[np.nan, 0, 0], [0, np.inf, 0]]])
    assert finish(FILE, ScanRecords(index=0, points=points)).points.tolist() == TETRAHEDRON.tolist()


def test_intensity_and_colour_follow_their_points() -> None:
    points = np.vstack([[[np.nan, 0, 0]], TETRAHEDRON])
    intensity = np.arange(5, dtype=np.float32)
    color = np.arange(15, dtype=np.uint8).reshape(5, 3)
    scan = finish(FILE, ScanRecords(index=0, points=points, intensity=intensity, color=color))
    assert scan.intensity is not None
    assert scan.color is not None
    assert (scan.intensity.tolist(), scan.color[0].tolist()) == ([1, 2, 3, 4], [3, 4, 5])


def test_the_grid_is_renumbered_when_points_are_dropped() -> None:
    records = grid_records()
    records.points[2] = np.nan
    scan = finish(FILE, records)
    assert scan.grid is not None
    assert scan.grid.index.tolist() == [[0, -1, 3], [1, 2, 4]]


def test_records_without_a_return_are_dropped() -> None:
    scan = finish(FILE, grid_records(valid=np.array([True, True, True, True, True, False])))
    assert len(scan) == 5


def test_the_number_of_dropped_records_is_told() -> None:
    records = grid_records(valid=np.array([True, True, True, True, False, False]))
    assert scan_info(0, finish(FILE, records), 2).dropped == 2


def test_rows_and_columns_need_not_begin_at_zero() -> None:
    scan = finish(FILE, grid_records(row=np.arange(6) % 2 + 500, column=np.arange(6) // 2 - 7))
    assert scan.grid is not None
    assert scan.grid.index.tolist() == [[0, 2, 4], [1, 3, 5]]


def test_of_two_returns_in_one_direction_the_first_stays_in_the_grid() -> None:
    column = np.array([0, 0, 1, 1, 2, 2])
    row = np.array([0, 1, 0, 1, 1, 1])
    scan = finish(FILE, grid_records(row=row, column=column))
    assert scan.grid is not None
    assert scan.grid.index.tolist() == [[0, 2, -1], [1, 3, 4]]


def test_an_absurd_grid_is_left_out_and_not_allocated() -> None:
    row = np.array([0, 1, 2, 3, 4, 1 << 30])
    assert finish(FILE, grid_records(row=row)).grid is None


def test_a_grid_of_one_row_is_none() -> None:
    assert finish(FILE, grid_records(row=np.zeros(6, dtype=int))).grid is None


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (np.zeros((0, 3)), "no points"),
        (np.full((5, 3), np.nan), "finite"),
        (np.ones((1, 3)), "equal"),
        (np.ones((9, 3)), "equal"),
        (TETRAHEDRON[:3], "3 distinct points"),
        (np.vstack([TETRAHEDRON[:3]] * 900), "3 distinct points"),
        (np.vstack([TETRAHEDRON, [[1e300, 0, 0]]]), "1e\\+300"),
        (np.vstack([TETRAHEDRON, [[0, -1.01e8, 0]]]), "1.01e\\+08"),
    ],
)
def test_absurd_points_are_refused_with_the_reason(points: np.ndarray, reason: str) -> None:
    with np.errstate(over="ignore"), pytest.raises(UnreadableFileError, match=reason):
        finish(FILE, ScanRecords(index=0, points=points))


def test_the_absurd_point_is_named() -> None:
    points = np.vstack([[[np.nan] * 3], TETRAHEDRON, [[0, 0, 1e9]]])
    with pytest.raises(UnreadableFileError) as caught:
        finish(FILE, ScanRecords(index=2, points=points))
    assert (caught.value.filename, caught.value.place) == ("room.e57", "scan 2, point 5")


def test_near_coordinates_keep_the_origin_of_the_file() -> None:
    scan = finish(FILE, ScanRecords(index=0, points=TETRAHEDRON + 500.0))
    assert scan.origin_m.tolist() == [0.0, 0.0, 0.0]


def test_far_coordinates_are_reduced_to_a_round_origin() -> None:
    scan = finish(FILE, ScanRecords(index=0, points=TETRAHEDRON + np.array([500_000.2, 5_400_000.2, 300.2])))
    assert scan.origin_m.tolist() == [500_001.0, 5_400_001.0, 301.0]


def test_far_coordinates_keep_micrometres() -> None:
    far_m = np.array([500_000.2, 5_400_000.2, 300.2])
    scan = finish(FILE, ScanRecords(index=0, points=TETRAHEDRON + far_m))
    # float64 resolves 1e-9 m at 5400 km
    assert np.abs(scan.points - (TETRAHEDRON + (far_m - scan.origin_m))).max() < 2e-9


def test_what_was_subtracted_before_is_accounted_for() -> None:
    base_m = np.array([500_000.0, 5_400_000.0, 300.0])
    scan = finish(FILE, ScanRecords(index=0, points=TETRAHEDRON.copy(), base_m=base_m))
    assert np.abs(scan.points + scan.origin_m - base_m - TETRAHEDRON).max() < 2e-9


def test_the_sensor_is_given_in_reduced_coordinates() -> None:
    points = TETRAHEDRON + np.array([2000.0, 0.0, 0.0])
    scan = finish(FILE, ScanRecords(index=0, points=points, sensor_in_scan_m=np.array([1990.0, 0.0, 0.0])))
    assert scan.sensor_m is not None
    assert (scan.sensor_m + scan.origin_m).tolist() == [1990.0, 0.0, 0.0]


def test_an_instrument_500_km_from_every_point_is_not_believed() -> None:
    scan = finish(FILE, ScanRecords(index=0, points=TETRAHEDRON + 500_000.0, sensor_in_scan_m=np.zeros(3)))
    assert scan.sensor_m is None


def test_more_points_than_the_file_can_hold_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"x" * 100)
    with pytest.raises(UnreadableFileError, match="need at least 1200000000000 bytes; the file has 100"):
        check_count(ScanFile(path, "a.ply"), 10**11, 12.0, ReadLimits(), "header")


def test_more_points_than_the_limit_are_too_large(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"x" * 100)
    with pytest.raises(FileTooLargeError, match="11 points"):
        check_count(ScanFile(path, "a.ply"), 11, 1.0, ReadLimits(max_points=10), "header")


def test_wide_colours_are_scaled_to_8_bits() -> None:
    channels = np.array([[0, 32768, 65535]], dtype=np.uint16)
    assert colors_8bit(channels, 65535.0).tolist() == [[0, 128, 255]]
