"""Tables whose first columns are no coordinates, or whose numbers are written in another way."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from algorithms.arrays import Array
from algorithms.scans.scan import Scan
from service.errors import UnreadableFileError
from service.formats import inspect_file, read_scan

COUNT = 3000
NUMBER = np.arange(COUNT)


@pytest.fixture(scope="module")
def points() -> Array:
    rng = np.random.default_rng(7)
    return np.round(rng.uniform([-9.0, -7.0, -2.0], [9.0, 7.0, 3.0], (COUNT, 3)), 4)


def stored(path: Path, columns: Sequence[Array], form: str, separator: str = " ") -> Path:
    np.savetxt(path, np.column_stack(columns), fmt=form, delimiter=separator)
    return path


def read(path: Path, columns: str = "") -> Scan:
    return read_scan(path, path.name, columns=columns)


def reason_of(path: Path, columns: str = "") -> str:
    with pytest.raises(UnreadableFileError) as caught:
        inspect_file(path, path.name, columns=columns)
    return caught.value.reason


LEADING: dict[str, tuple[list[Array], str]] = {
    "numbers of points": ([NUMBER], "%d %.4f %.4f %.4f"),
    "numbers with gaps": ([NUMBER * 3 + 7], "%d %.4f %.4f %.4f"),
    "rows and columns": ([NUMBER % 75, NUMBER // 75], "%d %d %.4f %.4f %.4f"),
    "rows and columns with decimals": ([NUMBER % 75, NUMBER // 75], "%.4f"),
    "rings": ([NUMBER % 16], "%d %.4f %.4f %.4f"),
    "seconds": ([1_700_000_000 + NUMBER // 500], "%d %.4f %.4f %.4f"),
    "equal steps of time": ([100.0 + NUMBER * 0.0125], "%.4f %.4f %.4f %.4f"),
    "row, column and number": ([NUMBER % 75, NUMBER // 75, NUMBER], "%d %d %d %.4f %.4f %.4f"),
}


@pytest.mark.parametrize("kind", LEADING)
def test_leading_columns_that_are_no_coordinates_are_passed_over(kind: str, points: Array, tmp_path: Path) -> None:
    leading, form = LEADING[kind]
    path = stored(tmp_path / "a.xyz", [*leading, *points.T], form)
    assert read(path).points.tolist() == points.tolist()


def test_what_stands_behind_the_coordinates_is_still_known(points: Array, tmp_path: Path) -> None:
    grey = np.full((COUNT, 3), 128)
    path = stored(tmp_path / "a.xyz", [NUMBER % 9, *points.T, NUMBER % 99, *grey.T], "%d %.4f %.4f %.4f %d %d %d %d")
    scan = read(path)
    assert scan.intensity is not None
    assert scan.color is not None
    assert (float(scan.intensity[5]), scan.color[5].tolist()) == (5.0, [128, 128, 128])


def test_names_of_points_are_passed_over(points: Array, tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("".join(f"P{k} {x} {y} {z}\n" for k, (x, y, z) in enumerate(points.tolist())))
    assert read(path).points.tolist() == points.tolist()


def test_a_column_of_numbers_is_told_from_lines_far_behind_the_first(points: Array, tmp_path: Path) -> None:
    x = np.where(NUMBER < 2500, np.round(points[:, 0]), points[:, 0])  # the first lines hold whole numbers by chance
    many = [np.tile(column, 4) for column in (x, points[:, 1], points[:, 2])]
    path = stored(tmp_path / "a.xyz", many, "%.4f")
    assert read(path).points.tolist() == np.column_stack(many).tolist()


@pytest.mark.parametrize(
    ("make", "seen"),
    [
        (lambda p: [NUMBER % 75, NUMBER // 75, p[:, 0]], "column 1: 0 to 74"),
        (lambda p: [NUMBER, *(p * 1000).round().T], "whole numbers, counting"),
        (lambda p: [np.cumsum(0.01 + NUMBER % 3), *p.T], "always rises or falls"),
        (lambda p: [*(p * 1000).round().T, *(p / 20).T], "whole numbers and three of fractions"),
        (lambda p: [p[:, 0], NUMBER % 7, p[:, 1], p[:, 2]], "column 2 holds whole numbers only"),
    ],
)
def test_what_is_not_clear_is_refused_with_what_was_seen_and_how_to_say_it(
    make: Callable[[Array], list[Array]], seen: str, points: Array, tmp_path: Path
) -> None:
    reason = reason_of(stored(tmp_path / "a.xyz", make(points), "%.6g"))
    assert seen in reason
    assert "`columns`" in reason


def test_a_statement_decides_what_is_not_clear(points: Array, tmp_path: Path) -> None:
    path = stored(tmp_path / "a.xyz", [np.cumsum(0.01 + NUMBER % 3), *points.T], "%.4f")
    assert read(path, "-,x,y,z").points.tolist() == points.tolist()


@pytest.mark.parametrize(
    ("columns", "reason"),
    [
        ("x,y,z", "names 3 columns .* the lines have 4"),
        ("x,y,z,row", "is row, but it holds"),
        ("x,y,z,r,g,b", "names 6 columns .* the lines have 4"),
    ],
)
def test_a_statement_that_the_table_contradicts_is_refused(
    columns: str, reason: str, points: Array, tmp_path: Path
) -> None:
    path = stored(tmp_path / "a.xyz", [NUMBER, *points.T], "%d %.4f %.4f %.4f")
    with pytest.raises(UnreadableFileError, match=reason):
        inspect_file(path, path.name, columns=columns)


def test_columns_are_no_matter_of_other_formats(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_text("ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n")
    assert "this is PLY" in reason_of(path, "x,y,z")


def test_names_that_nobody_knows_are_passed_over_where_columns_are_stated(points: Array, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("Punkt;Wert1;Wert2;Wert3\n" + "".join(f"7;{x};{y};{z}\n" for x, y, z in points.tolist()))
    assert "`columns`" in reason_of(path)
    assert read(path, "id,x,y,z").points.tolist() == points.tolist()


def test_a_separator_may_end_each_line(points: Array, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("".join(f"{x};{y};{z};\n" for x, y, z in points.tolist()))
    assert read(path).points.tolist() == points.tolist()


@pytest.mark.parametrize("separator", [";", "\t", "   ", " "])
def test_decimal_commas_are_read(separator: str, points: Array, tmp_path: Path) -> None:
    path = tmp_path / "german.csv"
    path.write_text("".join(separator.join(f"{v:.4f}".replace(".", ",") for v in row) + "\n" for row in points))
    assert read(path).points.tolist() == points.tolist()


@pytest.mark.parametrize("lead", ["", "7,"])
def test_commas_for_both_are_refused_with_the_way_out(lead: str, points: Array, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("".join(lead + ",".join(f"{v:.4f}".replace(".", ",") for v in row) + "\n" for row in points))
    assert "write decimal points" in reason_of(path)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-8-sig"])
def test_texts_of_other_encodings_are_read(encoding: str, points: Array, tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("".join(f"{x} {y} {z}\n" for x, y, z in points.tolist()), encoding=encoding)
    assert read(path).points.tolist() == points.tolist()


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"1.000,5;2.000,5;3.000,5\n", "marks between thousands"),
        ("1 2 3\n".encode("utf-32"), "UTF-32"),
        (b"1.5 2.5\n", "coordinates need three"),
        (b'"1.5","2.5","3.5"\n', "numbers in quotation marks"),
        (b"lon,lat,height\n8.5,47.4,400\n", "longitude and latitude"),
    ],
)
def test_the_reason_of_the_reader_reaches_the_user(content: bytes, reason: str, tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(content)
    assert reason in reason_of(path)
