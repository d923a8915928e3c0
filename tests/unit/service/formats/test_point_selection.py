"""Points that a LAS file marks: what is used of them, what is left out, and that it is said."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest

from service.errors import UnreadableFileError
from service.formats import inspect_file, read_scan
from service.formats import las as formats_las
from service.formats.base import ReadLimits, ScanFile
from service.formats.point_selection import ALL_POINTS, PointSelection
from service.formats.streaming import stream_scan
from service.formats.thinned import read_thinned_scan

N = 1000
SEED = 4


def las(path: Path, point_format: int, fields: Mapping[str, Any]) -> Path:
    """Write points with attributes."""
    rng = np.random.default_rng(SEED)
    header = laspy.LasHeader(point_format=point_format, version="1.4" if point_format >= 6 else "1.2")
    header.scales = [0.001] * 3
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = rng.uniform(0.0, 50.0, (3, N))
    cloud.return_number = cloud.number_of_returns = np.ones(N, np.uint8)
    for name, values in fields.items():
        cloud[name] = values
    cloud.write(path)
    return path


def marked() -> dict[str, Any]:
    number = np.arange(N)
    return {
        "classification": np.select([number < 20, number < 50, number < 90], [7, 18, 12], 2).astype(np.uint8),
        "withheld": (number % 10 == 0).astype(np.uint8),
        "return_number": (1 + number % 2).astype(np.uint8),
        "number_of_returns": np.full(N, 2, np.uint8),
    }


@pytest.mark.parametrize("ending", ["las", "laz"])
@pytest.mark.parametrize("point_format", [0, 1, 2, 3, 6, 7, 8])
def test_withheld_points_and_noise_are_left_out_and_said(tmp_path: Path, point_format: int, ending: str) -> None:
    path = las(tmp_path / f"a.{ending}", point_format, marked())
    (info,) = inspect_file(path, path.name)
    assert (info.points, info.dropped) == (N - 145, 145)
    assert info.warnings == (
        "points left out as the file marks them: 100 withheld, 45 noise (classes 7 and 18)",
    )  # fmt: skip
    assert len(read_scan(path, path.name)) == N - 145


@pytest.mark.parametrize("at_once", [10, 10 * N])
def test_a_scan_that_comes_in_pieces_leaves_out_the_same(tmp_path: Path, at_once: int) -> None:
    path = las(tmp_path / "a.laz", 6, marked())
    (info,) = inspect_file(path, path.name, ReadLimits(at_once=at_once))
    assert (info.points, info.dropped) == (N - 145, 145)
    assert any("100 withheld" in said for said in info.warnings)
    facts = stream_scan(ScanFile(path, path.name)).facts
    assert facts is not None
    assert facts.points == N - 145


@pytest.mark.parametrize(
    ("selection", "count"),
    [
        (ALL_POINTS, N),
        (PointSelection(withheld=True), N - 50),
        (PointSelection(classes=(7,), withheld=True), 20),
        (PointSelection(classes=(7, 18)), 45),
        (PointSelection(returns="last", withheld=True), 475),
        (PointSelection(returns="first"), 380),
        (PointSelection(withheld=True, overlap=False), N - 90),
    ],
)
def test_a_selection_says_which_points_are_used(tmp_path: Path, selection: PointSelection, count: int) -> None:
    path = las(tmp_path / "a.las", 1, marked())
    facts = stream_scan(ScanFile(path, path.name, selection=selection)).facts
    assert facts is not None
    assert facts.points == count


def test_returns_that_nobody_numbered_are_last_and_first(tmp_path: Path) -> None:
    zero = {"return_number": np.zeros(N, np.uint8), "number_of_returns": np.zeros(N, np.uint8)}
    path = las(tmp_path / "a.las", 0, zero)
    for returns in ("first", "last"):
        facts = stream_scan(ScanFile(path, path.name, selection=PointSelection(returns=returns))).facts
        assert facts is not None
        assert facts.points == N


def test_a_flag_of_overlap_counts_in_new_formats(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", 6, {"overlap": np.arange(N) % 4 == 0})
    facts = stream_scan(ScanFile(path, path.name, selection=PointSelection(overlap=False))).facts
    assert facts is not None
    assert facts.points == 750


def test_a_file_whose_points_are_all_withheld_is_refused_in_words(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", 6, {"withheld": np.ones(N, np.uint8)})
    with pytest.raises(
        UnreadableFileError, match=r"no point of the scan is left: .* 1000 withheld.*; take the marks off"
    ):
        read_scan(path, path.name)
    with pytest.raises(UnreadableFileError, match="1000 withheld"):
        stream_scan(ScanFile(path, path.name))


def test_points_are_left_out_of_a_thinned_scan_though_its_first_piece_has_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(formats_las, "POINTS_AT_ONCE", 100)
    path = las(tmp_path / "a.las", 6, {"withheld": np.arange(N) >= 500})
    scan, _ = read_thinned_scan(path, path.name, 0, N, N)
    assert len(scan) == 500
