"""Scans are named by their number in the file, also where scans without points stand between them."""

from dataclasses import replace
from datetime import UTC, datetime

import pytest

from schemas.register_inputs import Station
from service.adapters.memory import MemoryFileStore
from service.errors import InvalidRequestError
from service.ports import StoredFile
from service.use_cases.check_stations import check_station

FILE = StoredFile(
    id="a" * 32, name="a.e57", bytes=9, sha256="", format="E57", kind="scan", created=datetime(2026, 1, 1, tzinfo=UTC)
)


def station(index: int) -> Station:
    return Station.model_validate({"name": "S", "scan": {"file": FILE.id, "index": index}})


@pytest.fixture
def files() -> MemoryFileStore:
    store = MemoryFileStore()
    store.add(replace(FILE, scans=({"index": 1}, {"index": 3})))
    return store


def test_a_scan_after_one_without_points_can_be_chosen(files: MemoryFileStore) -> None:
    check_station(station(3), files)


def test_a_scan_without_points_cannot_be_chosen(files: MemoryFileStore) -> None:
    with pytest.raises(InvalidRequestError) as caught:
        check_station(station(0), files)
    assert caught.value.faults[0].detail == "the file 'a.e57' holds 2 scan(s), numbered 1, 3"
