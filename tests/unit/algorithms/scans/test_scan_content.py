"""A scan is known again by its content, whatever the order and the format of its points."""

from pathlib import Path

import numpy as np
import pytest

from algorithms.scans.content import ScanContent, same_content
from algorithms.scans.content_sums import content_of
from service.formats import inspect_file
from tests.unit.algorithms.scans.test_far_points import ROOM

FAR = np.array([500_000.0, 5_300_000.0, 100.0])


def content(points: np.ndarray, origin_m: np.ndarray | None = None) -> ScanContent:
    return content_of(points, np.zeros(3) if origin_m is None else origin_m)


@pytest.mark.parametrize(
    "other",
    [ROOM[::-1], np.round(ROOM, 4), np.round(ROOM, 3), ROOM.astype(np.float32).astype(np.float64)],
    ids=["another order", "text of four decimals", "millimetres", "single precision"],
)
def test_order_and_rounding_do_not_hide_that_scans_are_the_same(other: np.ndarray) -> None:
    assert same_content(content(ROOM), content(np.ascontiguousarray(other)))


def test_the_local_origin_does_not_count() -> None:
    assert same_content(content(ROOM, FAR), content(ROOM + 17.0, FAR - 17.0))


@pytest.mark.parametrize(
    "other",
    [ROOM[1:], ROOM + np.array([0.01, 0.0, 0.0]), ROOM[:, [1, 0, 2]], ROOM * 1.001],
    ids=["one point less", "moved by 10 mm", "axes exchanged", "larger"],
)
def test_other_points_are_another_content(other: np.ndarray) -> None:
    assert not same_content(content(ROOM), content(np.ascontiguousarray(other)))


def test_two_measurements_of_one_place_with_as_many_points_are_two() -> None:
    rng = np.random.default_rng(1)
    noisy = ROOM + rng.normal(size=ROOM.shape) * 0.002
    again = noisy.copy()
    again[::3] = ROOM[::3] * rng.uniform(0.9, 1.0, (len(ROOM[::3]), 1))
    assert not same_content(content(noisy), content(again))


def test_documents_carry_the_content(tmp_path: Path) -> None:
    first, second = tmp_path / "a.xyz", tmp_path / "b.csv"
    np.savetxt(first, ROOM[:500], fmt="%.6f")
    np.savetxt(second, ROOM[:500][::-1], fmt="%.4f", delimiter=",", header="x,y,z", comments="")
    documents = [inspect_file(path, path.name)[0].to_json() for path in (first, second)]
    contents = [ScanContent.from_json(document["content"]) for document in documents]
    assert same_content(*contents)
    assert [document["warnings"] for document in documents] == [[], []]
