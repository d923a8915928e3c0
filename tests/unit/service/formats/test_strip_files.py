"""Strips with times and trajectories are read; corrected strips keep all but their coordinates."""

from pathlib import Path

import laspy
import numpy as np
import pytest

from service.errors import UnreadableFileError, UnwritableError
from service.formats import inspect_upload
from service.formats.base import ReadLimits, ScanFile
from service.formats.strips import read_strip, read_trajectory, write_corrected

BASE_M = np.array([500_000.0, 5_600_000.0, 300.0])
HEAD = "time,easting,northing,height,roll,pitch,yaw\n"


def las(path: Path, *, point_format: int = 1, times: tuple[float, ...] = (30.0, 10.0, 20.0, 40.0, 50.0)) -> Path:
    header = laspy.LasHeader(point_format=point_format, version="1.2")
    header.scales, header.offsets = np.full(3, 0.001), BASE_M
    data = laspy.LasData(header)
    data.x, data.y, data.z = (BASE_M + np.arange(15.0).reshape(5, 3) ** 1.5).T
    data.intensity = np.arange(5, dtype=np.uint16)
    data.scan_direction_flag = np.array([0, 1, 1, 0, 0], dtype=np.uint8)
    if point_format == 1:
        data.gps_time = np.array(times)
    data.write(str(path))
    return path


def test_points_come_in_the_order_of_their_times(tmp_path: Path) -> None:
    strip = read_strip(las(tmp_path / "a.laz"), "a.laz", ReadLimits())
    assert strip.gps_time_s.tolist() == [10.0, 20.0, 30.0, 40.0, 50.0]
    assert strip.order is not None
    np.testing.assert_allclose(strip.points, (np.arange(15.0).reshape(5, 3) ** 1.5)[strip.order], atol=0.0006)
    assert strip.directions is not None
    assert strip.directions.tolist() == [1, 1, 0, 0, 0]
    (scan,) = inspect_upload(tmp_path / "a.laz", "a.laz").scans
    assert scan.gps_time_s == (10.0, 50.0)


def test_points_without_times_are_no_strip(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", point_format=0)
    with pytest.raises(UnreadableFileError, match="no GPS time"):
        read_strip(path, "a.las", ReadLimits())
    assert inspect_upload(path, "a.las").scans[0].gps_time_s is None
    strange = las(tmp_path / "b.las", times=(1.0, 2.0, float("nan"), 4.0, 5.0))
    with pytest.raises(UnreadableFileError, match="no number"):
        read_strip(strange, "b.las", ReadLimits())
    assert inspect_upload(strange, "b.las").scans[0].gps_time_s is None


def test_corrected_strips_keep_all_but_their_coordinates(tmp_path: Path) -> None:
    source = ScanFile(las(tmp_path / "a.las"), "a.las")
    before, target = laspy.read(source.path), tmp_path / "b.laz"
    assert write_corrected(source, ReadLimits(), target, lambda p, t, _: p + 0.01 * t[:, None]) == 5
    after = laspy.read(target)
    for name in ("intensity", "gps_time", "scan_direction_flag"):
        np.testing.assert_array_equal(np.asarray(before[name]), np.asarray(after[name]))
    moved = np.asarray(after.x) - np.asarray(before.x)
    np.testing.assert_allclose(moved, 0.01 * np.asarray(before.gps_time), atol=0.001)
    with pytest.raises(UnwritableError, match="beyond the reach"):
        write_corrected(source, ReadLimits(), tmp_path / "c.laz", lambda p, _, __: p + 1e7)
    assert not (tmp_path / "c.laz").exists()


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        (HEAD + "100,500000,5600000,800,1,2,90\n101,500050,5600000,801,-1,0,91\n", None),
        ("100 500000 5600000 800 1 2 90\n101 500050 5600000 801 -1 0 91\n", None),
        (
            "90 100 7 1 2 800 5600000 500000\n91 101 7 -1 0 801 5600000 500050\n",
            ["heading", "time", "-", "roll", "pitch", "z", "y", "x"],
        ),
    ],
)
def test_trajectories_are_read_as_their_columns_say(tmp_path: Path, text: str, columns: list[str] | None) -> None:
    path = tmp_path / "flight.txt"
    path.write_text(text)
    found = read_trajectory(path, "flight.txt", columns, "deg", BASE_M, 100.0)
    np.testing.assert_allclose(found.times_s, [0.0, 1.0])
    np.testing.assert_allclose(found.positions_m, [[0.0, 0.0, 500.0], [50.0, 0.0, 501.0]])
    assert found.angles_rad is not None
    np.testing.assert_allclose(np.degrees(found.angles_rad), [[1.0, 2.0, 90.0], [-1.0, 0.0, 91.0]])


def test_units_in_the_names_of_a_trajectory_are_those_of_its_numbers(tmp_path: Path) -> None:
    path = tmp_path / "flight.txt"
    x, y, z = BASE_M
    head = "time[ms],x [mm],y [mm],z [m],roll[gon],pitch[gon],yaw[gon]\n"
    path.write_text(head + f"100000,{x * 1e3},{y * 1e3},{z},10,20,100\n101000,{x * 1e3},{y * 1e3},{z},10,20,100\n")
    found = read_trajectory(path, "flight.txt", None, "deg", BASE_M, 100.0)
    np.testing.assert_allclose(found.times_s, [0.0, 1.0])
    np.testing.assert_allclose(found.positions_m, np.zeros((2, 3)), atol=1e-6)
    assert found.angles_rad is not None
    np.testing.assert_allclose(np.degrees(found.angles_rad[0]), [9.0, 18.0, 90.0])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time,x[furlong],y,z\n1,2,3,4\n2,3,4,5\n", "'furlong' of the column 'x.furlong.'"),
        ("1 2 3 4 5\n2 3 4 5 6\n", "5 columns without names"),
        ("time x y z roll\n1 2 3 4 5\n2 3 4 5 6\n", "holds pitch, heading"),
        ("when x y z\n1 2 3 4\n2 3 4 5\n", "holds time"),
        ("time x y z\n1 2 3 4\n1 3 4 5\n", "is not later"),
        ("time x y z\n1 2 3 4\n2 3 nan 5\n", "no finite number"),
        ("time x y z\n1 2 3 4\n", "fewer than two places"),
        ("no numbers at all\n", "line 1"),
    ],
)
def test_what_is_no_trajectory_is_refused_with_its_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "flight.txt"
    path.write_text(text)
    with pytest.raises(UnreadableFileError, match=said):
        read_trajectory(path, "flight.txt", None, "deg", BASE_M, 0.0)
