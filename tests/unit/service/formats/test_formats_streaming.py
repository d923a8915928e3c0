"""A scan read piece by piece is the scan that is read as a whole, in every format."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.scans.scan import Scan, ScanGrid
from service.errors import UnreadableFileError
from service.formats import base, e57, pcd, ply, ptx, read_scan, text
from service.formats.base import ScanFile
from service.formats.streaming import stream_scan
from service.formats.writers import StationCloud, surveyed, write_scans

SHARED = Path(__file__).resolve().parents[5] / "shared" / "data" / "formats"
ROWS, COLUMNS = 40, 30
FAR = np.array([500_000.0, 5_400_000.0, 300.0])


@pytest.fixture(autouse=True)
def _small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pieces of a few hundred records, so that small files have several."""
    for module in (base, e57, pcd, ply, ptx, text):
        monkeypatch.setattr(module, "RECORDS_AT_ONCE", 257)


def shared_files() -> list[str]:
    patterns = ("las/*", "ply/*", "pcd/*", "ptx/*", "pts/*", "csv/*", "e57/*")
    damaged = {"bad-crc.e57", "corrupt_crc.e57"}
    found = [path for pattern in patterns for path in SHARED.glob(pattern) if path.name not in damaged]
    return sorted(path.relative_to(SHARED).as_posix() for path in found if path.stat().st_size < 700_000)


def whole(cloud: StationCloud) -> Scan:
    """Put the pieces together."""
    pieces = list(cloud.pieces())
    points = np.concatenate([piece.points for piece in pieces])
    index = None
    if cloud.rows is not None and cloud.columns is not None:
        row, column = (np.concatenate([getattr(piece, name) for piece in pieces]) for name in ("row", "column"))
        index = np.full((cloud.rows, cloud.columns), -1, dtype=np.int32)
        index[row[::-1], column[::-1]] = np.arange(len(points) - 1, -1, -1, dtype=np.int32)
    zeros = {"intensity": np.float32, "color": np.uint8}
    columns = {
        name: np.concatenate(
            [
                np.zeros((len(piece), 3) if name == "color" else len(piece), kind)
                if getattr(piece, name) is None
                else getattr(piece, name)
                for piece in pieces
            ]
        )
        for name, kind in zeros.items()
        if getattr(cloud, f"has_{name}")
    }
    grid = None if index is None else ScanGrid(index)
    return Scan(points, cloud.origin_m, grid=grid, intensity=columns.get("intensity"), color=columns.get("color"))


def assert_same(path: Path) -> None:
    try:
        expected = read_scan(path, path.name)
    except UnreadableFileError as fault:
        pytest.skip(f"not a scan that can be registered: {fault.reason}")
    cloud = stream_scan(ScanFile(path, path.name))
    found = whole(cloud)
    assert np.array_equal(found.origin_m, expected.origin_m)
    assert np.abs(found.points - expected.points).max() < 1e-9
    assert (found.intensity is None) == (expected.intensity is None)
    assert (found.color is None) == (expected.color is None)
    if expected.intensity is not None:
        assert np.array_equal(found.intensity, expected.intensity, equal_nan=True)
    if expected.color is not None:
        assert np.array_equal(found.color, expected.color)
    assert (found.grid is None) == (expected.grid is None)
    if expected.grid is not None and found.grid is not None:
        assert np.array_equal(found.grid.index, expected.grid.index)
    assert cloud.facts is not None
    assert cloud.facts.points == len(expected)
    assert np.abs(np.array([cloud.facts.low_m, cloud.facts.high_m]) - expected.bounds_m).max() < 1e-6


def a_scan(origin_m: np.ndarray) -> Scan:
    rng = np.random.default_rng(4)
    seen = rng.random((ROWS, COLUMNS)) < 0.8
    seen[0], seen[:, 0], seen[-1], seen[:, -1] = True, True, True, True
    index = np.full((ROWS, COLUMNS), -1, dtype=np.int32)
    count = int(seen.sum())
    index.T[seen.T] = np.arange(count, dtype=np.int32)
    return Scan(
        points=rng.uniform(-20.0, 20.0, (count, 3)),
        origin_m=origin_m,
        grid=ScanGrid(index),
        intensity=rng.random(count).astype(np.float32),
        color=rng.integers(0, 256, (count, 3)).astype(np.uint8),
    )


@pytest.mark.parametrize("name", shared_files())
def test_original_files_come_piece_by_piece_as_they_come_whole(name: str) -> None:
    assert_same(SHARED / name)


@pytest.mark.parametrize("ending", [".e57", ".laz", ".copc.laz", ".ply", ".pcd", ".ptx", ".pts", ".xyz"])
@pytest.mark.parametrize("origin_m", [np.zeros(3), FAR], ids=["near", "far"])
def test_written_files_come_piece_by_piece_as_they_come_whole(
    ending: str, origin_m: np.ndarray, tmp_path: Path
) -> None:
    write_scans(tmp_path / f"a{ending}", [a_scan(origin_m)])
    assert_same(tmp_path / f"a{ending}")


def test_a_cloud_can_be_read_twice(tmp_path: Path) -> None:
    write_scans(tmp_path / "a.e57", [a_scan(FAR)])
    cloud = stream_scan(ScanFile(tmp_path / "a.e57", "a.e57"))
    first, second = whole(cloud), whole(cloud)
    assert np.array_equal(first.points, second.points)


def test_the_second_scan_of_a_file_is_its_own(tmp_path: Path) -> None:
    pose = RigidTransform.from_components([1.0, 2.0, 3.0], Rotation.from_rotvec([0.0, 0.0, 1.0]))
    scan = a_scan(np.zeros(3))
    moved = Scan(points=scan.points + 1.0, origin_m=np.zeros(3), world_from_scan=pose)
    for ending in (".e57", ".ptx"):
        write_scans(tmp_path / f"a{ending}", [scan, moved])
        cloud = stream_scan(ScanFile(tmp_path / f"a{ending}", f"a{ending}"), 1)
        assert np.abs(whole(cloud).points - moved.points).max() < 1e-6
        assert cloud.world_from_scan is not None
        assert np.abs(cloud.pose.as_matrix() - pose.as_matrix()).max() < 1e-12


def test_a_scan_that_is_not_there_is_refused(tmp_path: Path) -> None:
    write_scans(tmp_path / "a.e57", [a_scan(np.zeros(3))])
    with pytest.raises(UnreadableFileError, match="no points under this index"):
        stream_scan(ScanFile(tmp_path / "a.e57", "a.e57"), 1)


def test_facts_are_found_out_by_reading_where_nobody_gives_them() -> None:
    pieces = a_scan(FAR)
    from service.formats.writers import cloud_of

    facts = surveyed(cloud_of(pieces)).facts
    assert facts is not None
    assert facts.points == len(pieces)
    assert np.abs(np.array([facts.low_m, facts.high_m]) - pieces.bounds_m).max() < 1e-9
