"""What a writer writes, the reader of that format gives back."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.scans.scan import Scan, ScanGrid
from service.formats import inspect_file, read_scan
from service.formats.writers import write_scans

ROWS, COLUMNS = 9, 14


def write_one_ply(path: Path, scans: list[Scan]) -> None:
    """Without its pose: PLY would get the points in the world frame."""
    write_scans(path, [replace(scans[0], world_from_scan=None)])


WRITERS: dict[str, Callable[[Path, list[Scan]], object]] = {
    "a.e57": write_scans,
    "a.ptx": write_scans,
    "a.ply": write_one_ply,
}
TOLERANCE_M = {
    "a.e57": 2e-9,  # float64 resolves 1e-9 m at 5400 km
    "a.ply": 2e-9,
    "a.ptx": 5.1e-7,  # printed to the micrometre
}
STRUCTURED = ["a.e57", "a.ptx"]


def made_scan(seed: int, origin_m: list[float], *, color: bool = True) -> Scan:
    """A dome with gaps, seen from its own origin; the outermost rows and columns have returns."""
    rng = np.random.default_rng(seed)
    zenith = np.linspace(0.4, 2.6, ROWS)[:, None]
    azimuth = np.linspace(-3.0, 3.0, COLUMNS)[None, :]
    distance_m = rng.uniform(2.0, 30.0, (ROWS, COLUMNS))
    seen = rng.random((ROWS, COLUMNS)) < 0.7
    seen[0], seen[-1], seen[:, 0], seen[:, -1] = True, True, True, True
    directions = np.stack(
        [np.sin(zenith) * np.cos(azimuth), np.sin(zenith) * np.sin(azimuth), np.cos(zenith) + 0 * azimuth], axis=-1
    )
    points = (distance_m[..., None] * directions)[seen]
    number = np.full((ROWS, COLUMNS), -1, dtype=np.int32)
    number[seen] = rng.permutation(len(points)).astype(np.int32)
    ordered = np.empty_like(points)
    ordered[number[seen]] = points
    return Scan(
        points=ordered,
        origin_m=np.array(origin_m),
        name="Küche 1",
        grid=ScanGrid(index=number),
        intensity=rng.random(len(points)).astype(np.float32),
        color=rng.integers(0, 256, (len(points), 3)).astype(np.uint8) if color else None,
        sensor_m=-np.array(origin_m) if not any(origin_m) else None,
        world_from_scan=RigidTransform.from_components(rng.normal(size=3) * 100, Rotation.random(rng=rng)),
    )


NEAR, FAR = [0.0, 0.0, 0.0], [500_000.0, 5_400_000.0, 300.0]


def cells(scan: Scan) -> np.ndarray:
    """Coordinates per row and column, full, NaN where nothing came back."""
    assert scan.grid is not None
    full = np.vstack([scan.points + scan.origin_m, [[np.nan] * 3]])
    return full[scan.grid.index]


@pytest.mark.parametrize("filename", WRITERS)
@pytest.mark.parametrize("origin_m", [NEAR, FAR])
@settings(max_examples=8, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 10_000))
def test_coordinates_come_back(filename: str, origin_m: list[float], tmp_path: Path, seed: int) -> None:
    scan = made_scan(seed, origin_m)
    WRITERS[filename](tmp_path / filename, [scan])
    back = read_scan(tmp_path / filename, filename)
    expected = np.sort((scan.points + scan.origin_m).round(6), axis=0)
    assert np.abs(np.sort(back.points + back.origin_m, axis=0) - expected).max() < TOLERANCE_M[filename] + 5e-7


@pytest.mark.parametrize("filename", ["a.e57", "a.ply"])
@pytest.mark.parametrize("origin_m", [NEAR, FAR])
def test_binary_formats_give_back_every_point_exactly_in_order(
    filename: str, origin_m: list[float], tmp_path: Path
) -> None:
    scan = made_scan(1, origin_m)
    WRITERS[filename](tmp_path / filename, [scan])
    back = read_scan(tmp_path / filename, filename)
    assert np.abs(back.points + (back.origin_m - scan.origin_m) - scan.points).max() < TOLERANCE_M[filename]


@pytest.mark.parametrize("filename", STRUCTURED)
@pytest.mark.parametrize("origin_m", [NEAR, FAR])
@settings(max_examples=8, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 10_000))
def test_every_cell_of_the_grid_holds_its_point_again(
    filename: str, origin_m: list[float], tmp_path: Path, seed: int
) -> None:
    scan = made_scan(seed, origin_m)
    WRITERS[filename](tmp_path / filename, [scan])
    back = cells(read_scan(tmp_path / filename, filename))
    assert np.allclose(back, cells(scan), rtol=0.0, atol=TOLERANCE_M[filename], equal_nan=True)


@pytest.mark.parametrize("filename", STRUCTURED)
def test_the_pose_comes_back(filename: str, tmp_path: Path) -> None:
    scan = made_scan(2, NEAR)
    WRITERS[filename](tmp_path / filename, [scan])
    back = read_scan(tmp_path / filename, filename)
    assert back.world_from_scan is not None
    assert scan.world_from_scan is not None
    # PTX is written with 12 digits: 1e-10 of 100 m
    assert np.abs(back.world_from_scan.as_matrix() - scan.world_from_scan.as_matrix()).max() < 1e-9


@pytest.mark.parametrize("filename", STRUCTURED)
def test_the_sensor_of_a_near_scan_comes_back(filename: str, tmp_path: Path) -> None:
    WRITERS[filename](tmp_path / filename, [made_scan(2, NEAR)])
    sensor_m = read_scan(tmp_path / filename, filename).sensor_m
    assert sensor_m is not None
    assert np.abs(sensor_m).max() < 1e-9


@pytest.mark.parametrize("filename", WRITERS)
def test_intensity_and_colour_stay_with_their_points(filename: str, tmp_path: Path) -> None:
    scan = made_scan(3, NEAR)
    WRITERS[filename](tmp_path / filename, [scan])
    back = read_scan(tmp_path / filename, filename)
    assert scan.intensity is not None
    assert scan.color is not None
    assert back.intensity is not None
    assert back.color is not None
    before = {(round(float(i), 6), *c) for i, c in zip(scan.intensity, scan.color.tolist(), strict=True)}
    after = {(round(float(i), 6), *c) for i, c in zip(back.intensity, back.color.tolist(), strict=True)}
    assert before == after


@pytest.mark.parametrize("filename", WRITERS)
def test_what_a_scan_has_not_is_not_invented(filename: str, tmp_path: Path) -> None:
    full = made_scan(4, NEAR, color=False)
    WRITERS[filename](tmp_path / filename, [Scan(points=full.points, origin_m=full.origin_m)])
    back = read_scan(tmp_path / filename, filename)
    assert (back.grid, back.color) == (None, None)


@pytest.mark.parametrize("filename", STRUCTURED)
def test_several_scans_share_a_file(filename: str, tmp_path: Path) -> None:
    scans = [made_scan(seed, NEAR) for seed in (5, 6, 7)]
    WRITERS[filename](tmp_path / filename, scans)
    infos = inspect_file(tmp_path / filename, filename)
    assert [(info.index, info.points) for info in infos] == [(i, len(scan)) for i, scan in enumerate(scans)]


def test_the_name_of_a_scan_comes_back_in_e57(tmp_path: Path) -> None:
    write_scans(tmp_path / "a.e57", [made_scan(8, NEAR)])
    assert inspect_file(tmp_path / "a.e57", "a.e57")[0].name == "Küche 1"


def test_rows_and_columns_beyond_one_buffer_stay_right(tmp_path: Path) -> None:
    """pye57 spoils integers of one kind of buffer after some thousand records; this scan is longer than a buffer."""
    rows, columns = 700, 800
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    row, column = np.divmod(np.arange(rows * columns), columns)
    points = np.column_stack([row * 0.01, column * 0.01, np.ones(rows * columns)])
    write_scans(tmp_path / "a.e57", [Scan(points=points, origin_m=np.zeros(3), grid=ScanGrid(index=index))])
    back = read_scan(tmp_path / "a.e57", "a.e57")
    assert back.grid is not None
    assert np.array_equal(back.grid.index, index)
