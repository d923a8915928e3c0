"""Of a scan with too many points every second, third … row and column is kept, as if the rest had not been measured."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from algorithms.progress import NoProgress
from service.errors import UnreadableFileError
from service.formats import base, e57, inspect_file, las, read_scan, surveyed
from service.formats.base import ReadLimits, ScanFile, ScanRecords
from service.formats.thinned import Thinned, read_thinned_scan
from service.formats.writers import PointPiece, StationCloud, writer_of

ROWS, COLUMNS = 40, 60


def cloud(*, structured: bool) -> StationCloud:
    row, column = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    points = np.column_stack([0.1 * column, 0.1 * row, np.sin(0.3 * column)]).astype(np.float64)
    grid = (row, column) if structured else (None, None)
    piece = PointPiece(points, (points[:, 0] / 10.0).astype(np.float32), None, *grid)
    shape = {"rows": ROWS, "columns": COLUMNS} if structured else {}
    return StationCloud("wall", lambda: iter([piece]), np.zeros(3), has_intensity=True, has_color=False, **shape)


@pytest.fixture(params=[True, False], ids=["grid", "cloud"])
def structured(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


@pytest.fixture
def file(tmp_path: Path, structured: bool, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(e57, "RECORDS_AT_ONCE", 177)
    assert base.RECORDS_AT_ONCE > ROWS * COLUMNS  # else the pieces were cut anyway
    path = tmp_path / "wall.e57"
    writer_of("e57").write(path, [cloud(structured=structured)], NoProgress())
    return path


def test_the_points_kept_are_those_of_every_third_row_and_column(file: Path, structured: bool) -> None:
    whole = read_scan(file, file.name)
    thinned, words = read_thinned_scan(file, file.name, 0, len(whole), len(whole) // 9 + 1)
    if structured:
        assert whole.grid is not None
        kept = np.sort(whole.grid.index[::3, ::3].ravel())
        assert thinned.grid is not None
        assert (thinned.grid.rows, thinned.grid.columns) == (-(-ROWS // 3), -(-COLUMNS // 3))
        assert "third row and column" in words
    else:
        kept = np.arange(0, len(whole), 9)
        assert thinned.grid is None
        assert "every 9th one" in words
    np.testing.assert_allclose(thinned.points + thinned.origin_m, (whole.points + whole.origin_m)[kept], atol=1e-9)
    assert whole.intensity is not None
    assert thinned.intensity is not None
    np.testing.assert_array_equal(thinned.intensity, whole.intensity[kept])


def test_where_there_is_room_for_all_all_are_kept(file: Path) -> None:
    whole = read_scan(file, file.name)
    thinned, _ = read_thinned_scan(file, file.name, 0, len(whole), len(whole))
    np.testing.assert_array_equal(thinned.points, whole.points)


@pytest.mark.parametrize("lowest", [0, 1])
def test_of_a_scan_that_was_thinned_before_no_more_is_kept_and_no_less(lowest: int) -> None:
    row, column = (2 * numbers + lowest for numbers in np.divmod(np.arange(ROWS * COLUMNS), COLUMNS))
    records = ScanRecords(0, np.zeros((len(row), 3)), row=row, column=column)
    kept = Thinned(ScanFile(Path("a"), "a.e57"), records, len(row), len(row) // 4)
    kept.take(records)
    joined = kept.joined()
    assert joined.row is not None
    assert joined.column is not None
    assert sorted(set(joined.row.tolist())) == list(range(ROWS // 2))
    assert sorted(set(joined.column.tolist())) == list(range(COLUMNS // 2))
    assert len(joined.points) == ROWS * COLUMNS // 4


def test_a_large_scan_with_an_absurd_coordinate_is_refused_wherever_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(surveyed, "WARNED_OF", 10)  # so that it is none of the points that are kept
    points = np.column_stack([np.arange(100.0), np.arange(100.0) ** 1.5, np.zeros(100)])
    points[51] = 1e9
    absurd = StationCloud("a", lambda: iter([PointPiece(points, None, None)]), np.zeros(3))
    path = tmp_path / "a.e57"
    writer_of("e57").write(path, [absurd], NoProgress())
    with pytest.raises(UnreadableFileError, match="beyond"):
        inspect_file(path, path.name, ReadLimits(at_once=99))


@pytest.mark.parametrize("kind", ["e57", "laz"])
def test_a_scan_that_is_never_whole_in_memory_is_described_as_any_other(
    kind: str, structured: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(e57, "RECORDS_AT_ONCE", 177)
    monkeypatch.setattr(las, "POINTS_AT_ONCE", 177)
    monkeypatch.setattr(surveyed, "WARNED_OF", 500)
    path = tmp_path / f"wall.{kind}"
    writer_of(kind).write(path, [cloud(structured=structured)], NoProgress())
    (whole,) = inspect_file(path, path.name)
    (large,) = inspect_file(path, path.name, ReadLimits(at_once=ROWS * COLUMNS - 1))
    np.testing.assert_allclose(large.bounds_m, whole.bounds_m, atol=1e-9)
    assert large.content is not None
    assert whole.content is not None
    assert large.content.points == whole.content.points
    np.testing.assert_allclose(large.content.mean_m, whole.content.mean_m, atol=1e-9)
    np.testing.assert_allclose(large.content.scatter_m2, whole.content.scatter_m2, atol=1e-9)
    told = [replace(each, bounds_m=None, content=None).to_json() for each in (large, whole)]
    assert told[0] == told[1]


def test_a_scan_that_is_not_there_is_refused_by_its_number(file: Path) -> None:
    with pytest.raises(UnreadableFileError, match="scan 3"):
        read_thinned_scan(file, file.name, 3, 100, 10)
