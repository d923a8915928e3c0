"""Text tables: delimiters, names, counts, and the line that is wrong."""

from pathlib import Path

import numpy as np
import pytest

from algorithms.scans.scan import Scan
from service.errors import FileTooLargeError, UnreadableFileError
from service.formats import ReadLimits, read_scan


def scan_of(tmp_path: Path, text: str, filename: str = "a.xyz", limits: ReadLimits | None = None) -> Scan:
    path = tmp_path / filename
    path.write_bytes(text.encode("utf-8"))
    return read_scan(path, filename, 0, limits or ReadLimits())


ROWS = [[0, 0, 0.5], [1, 0, 0.25], [0, 1, 0], [0, 0, 1]]


@pytest.mark.parametrize("delimiter", [" ", "\t", ",", ", ", ";", "   "])
def test_every_usual_delimiter_is_understood(tmp_path: Path, delimiter: str) -> None:
    text = "\n".join(delimiter.join(str(number) for number in row) for row in ROWS)
    assert scan_of(tmp_path, text).points.tolist() == ROWS


@pytest.mark.parametrize(
    "head",
    ["", "# made by hand\n", "\ufeff", "4\n", "x y z\n", "X[m] Y[m] Z[m]\n", "//X Y Z\n4\n", "\n\n"],
)
def test_what_may_stand_before_the_numbers(tmp_path: Path, head: str) -> None:
    assert scan_of(tmp_path, head + "0 0 0.5\n1 0 0.25\n0 1 0\n0 0 1\n").points.tolist() == ROWS


def test_lines_may_end_as_on_windows(tmp_path: Path) -> None:
    assert len(scan_of(tmp_path, "0 0 0\r\n1 0 0\r\n0 1 0\r\n0 0 1\r\n")) == 4


def test_a_fourth_column_is_intensity(tmp_path: Path) -> None:
    scan = scan_of(tmp_path, "0 0 0 -7\n1 0 0 8\n0 1 0 9\n0 0 1 10\n")
    assert scan.intensity is not None
    assert scan.intensity.tolist() == [-7, 8, 9, 10]


def test_columns_without_end_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UnreadableFileError, match=r"20003 columns, at most 1000 .*line 1"):
        scan_of(tmp_path, ("1.5 2.5 3.5" + " 1" * 20_000 + "\n") * 5)
    wide = "".join(f"{row[0]} {row[1]} {row[2]}" + " 1" * 900 + "\n" for row in ROWS)
    assert scan_of(tmp_path, "x y z" + " a" * 900 + "\n" + wide).points.tolist() == ROWS


def test_seven_columns_of_pts_are_intensity_and_colour(tmp_path: Path) -> None:
    scan = scan_of(tmp_path, "4\n0 0 0 -7 1 2 3\n1 0 0 8 4 5 6\n0 1 0 9 7 8 9\n0 0 1 10 255 0 0\n", "a.pts")
    assert scan.color is not None
    assert scan.intensity is not None
    assert (scan.color[3].tolist(), scan.intensity[3]) == ([255, 0, 0], 10)


def test_six_columns_of_small_integers_are_colours(tmp_path: Path) -> None:
    scan = scan_of(tmp_path, "0 0 0 1 2 3\n1 0 0 4 5 6\n0 1 0 7 8 9\n0 0 1 255 0 0\n")
    assert scan.color is not None
    assert scan.color[1].tolist() == [4, 5, 6]


def test_six_columns_of_fractions_are_normals_and_no_colours(tmp_path: Path) -> None:
    scan = scan_of(tmp_path, "0 0 0 0.1 0 0\n1 0 0 0 0 1\n0 1 0 0 1 0\n0 0 1 1 0 0\n")
    assert scan.color is None


def test_names_decide_in_any_order_and_others_are_passed_over(tmp_path: Path) -> None:
    text = "id,time,z,y,x,Intensity,a,b,c\n" + "".join(
        f"p{i},12:00,{i},{i**2},{i**3},{i + 5},u,v,w\n" for i in range(5)
    )
    scan = scan_of(tmp_path, text, "a.csv")
    assert scan.points[3].tolist() == [27.0, 9.0, 3.0]


def test_nan_lines_are_dropped(tmp_path: Path) -> None:
    assert len(scan_of(tmp_path, "nan nan nan\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n")) == 4


def test_millimetres_survive_500_km(tmp_path: Path) -> None:
    rows = [
        [500000.001, 5400000.002, 100.003],
        [500001.001, 5400000.002, 100],
        [500000, 5400001, 100],
        [5e5, 5.4e6, 101],
    ]
    scan = scan_of(tmp_path, "\n".join(" ".join(f"{number:.3f}" for number in row) for row in rows))
    # float64 resolves 1e-9 m at 5400 km
    assert np.abs(scan.points + scan.origin_m - rows).max() < 2e-9


def test_text_tells_no_sensor(tmp_path: Path) -> None:
    assert scan_of(tmp_path, "0 0 0\n1 0 0\n0 1 0\n0 0 1\n").sensor_m is None


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("0 0 0\n1 0 0\n0 1\n0 0 1\n", "line 3"),
        ("0 0 0\n1 0 0\n0 1 x\n0 0 1\n", "line 3"),
        ("5\n0.0 0.0 0.0\n1.0 0 0\n0 1.0 0\n0 0 1.0\n", "declares 5 points, the file has 4"),
        ("99999999999999\n0 0 0\n1 0 0\n", "need at least"),
        ("1,5;2,5;3,5\n", "equal"),
        ("1,5 2,5\n", "not XYZ text"),
        ("0 0 0\n", "equal"),
    ],
)
def test_a_broken_table_is_refused_with_the_line(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(UnreadableFileError, match=reason):
        scan_of(tmp_path, text)


def test_a_table_longer_than_the_limit_is_too_large(tmp_path: Path) -> None:
    with pytest.raises(FileTooLargeError):
        scan_of(tmp_path, "0 0 0\n1 0 0\n0 1 0\n0 0 1\n", limits=ReadLimits(max_points=3))
