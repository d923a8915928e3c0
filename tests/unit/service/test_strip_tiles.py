"""Tiles are divided into strips: by point source, joined over tiles, slivers left out and named."""

import numpy as np
import pytest

from algorithms.errors import InvalidInputError
from service.adapters.files.local_files import checked_key
from service.formats.strips import StripRecords
from service.processes.adjust_strips.adjusting import file_stems
from service.processes.adjust_strips.tiles import divided


def tile(*strips: tuple[int, int, float]) -> StripRecords:
    """Give a tile of strips: point source, number of points, first time; 100 points a second, in the order of times."""
    sources = np.concatenate([np.full(count, source, dtype=np.int32) for source, count, _ in strips])
    times = np.concatenate([first + 0.01 * np.arange(count) for _, count, first in strips])
    order = np.argsort(times, kind="stable")
    return StripRecords(np.zeros((len(times), 3)), np.zeros(3), times[order], None, None, sources[order])


def test_points_of_one_source_in_several_tiles_are_one_strip() -> None:
    files = [tile((1, 300, 0.0), (2, 200, 500.0)), tile((1, 150, 4.0), (2, 100, 503.0))]
    strips, remarks = divided(files, ["a", "b"], [False, False])
    assert [(each.name, each.source) for each in strips] == [("source-1", 1), ("source-2", 2)]
    assert [sum(len(part.numbers) for part in each.parts) for each in strips] == [450, 300]
    assert remarks == []


def test_a_source_that_comes_again_much_later_is_another_strip() -> None:
    files = [tile((1, 300, 0.0), (2, 200, 500.0)), tile((1, 150, 90_000.0))]
    strips, _ = divided(files, ["a", "b"], [False, False])
    assert [(each.name, each.source) for each in strips] == [("a-1", 1), ("a-2", 2), ("b", 1)]


def test_files_of_one_source_each_are_strips_even_if_it_is_the_same() -> None:
    strips, _ = divided([tile((7, 300, 0.0)), tile((7, 300, 3.0))], ["a", "b"], [False, False])
    assert [(each.name, each.source) for each in strips] == [("a", None), ("b", None)]


def test_a_file_that_is_said_to_be_one_strip_is_one() -> None:
    strips, _ = divided([tile((1, 300, 0.0), (2, 200, 1.0)), tile((3, 300, 50.0))], ["a", "b"], [True, False])
    assert [(each.name, each.source) for each in strips] == [("a", None), ("b", None)]


def test_pauses_divide_a_file_whose_points_name_one_source() -> None:
    strips, remarks = divided([tile((0, 300, 0.0), (0, 200, 500.0), (0, 40, 900.0))], ["a"], [False])
    assert [(each.name, each.source) for each in strips] == [("a-part-1", None), ("a-part-2", None)]
    times = np.array([-1.0, 250.0, 252.0, 600.0, 800.0])
    owned = [each.owns(times, np.zeros(5, dtype=np.int32)).tolist() for each in strips]
    assert owned == [[True, True, False, False, False], [False, False, True, True, False]]
    assert "pause 2 times" in remarks[0]
    assert "a, part 3 has 40 points" in remarks[1]
    whole, _ = divided([tile((0, 300, 0.0), (0, 200, 500.0))], ["a"], [True])
    assert [each.name for each in whole] == ["a"]


def test_a_sliver_is_left_out_and_named() -> None:
    strips, remarks = divided([tile((1, 300, 0.0), (2, 30, 100.0), (3, 200, 200.0))], ["a"], [False])
    assert [each.name for each in strips] == ["a-1", "a-3"]
    assert len(remarks) == 1
    assert "point source 2 has 30 points" in remarks[0]


def test_more_sources_than_strips_may_be_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="make 301 strips"):
        divided([tile(*((k, 100, 10.0 * k) for k in range(301)))], ["a"], [False])


def test_files_of_strips_are_called_as_these_unless_no_download_can_be() -> None:
    assert file_stems(["Flug 1 (Nord)", "Küche"]) == ["Flug 1 (Nord)", "Küche"]
    hostile = file_stems(["=1+1", "'=1+1", "Flug 1, Nord", "-", "A&B"])
    assert len(set(hostile)) == 5
    assert [checked_key(f"jobs/1/artifacts/{stem}-corrected.laz") for stem in hostile]
