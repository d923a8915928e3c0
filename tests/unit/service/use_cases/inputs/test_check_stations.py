"""Scans are named by their number in the file, also where scans without points stand between them."""

from dataclasses import replace
from datetime import UTC, datetime

import pytest

from algorithms.network.options import MOST_TIED
from schemas.requests.register_inputs import RegisterInputs, Station
from service.errors import InvalidRequestError
from service.ports import StoredFile
from service.use_cases.inputs.check_stations import check_register_inputs, check_station
from tests.doubles.memory import MemoryFileStore

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


def _contents(mean_x_m: float) -> dict[str, object]:
    scatter = [[4.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]]
    return {"index": 0, "content": {"points": 900, "mean_m": [mean_x_m, 2.0, 3.0], "scatter_m2": scatter}}


@pytest.mark.parametrize(("other_mean_m", "refused"), [(1.00004, True), (1.2, False)])
def test_the_same_points_in_another_format_are_refused_for_both_stations(other_mean_m: float, refused: bool) -> None:
    store = MemoryFileStore()
    store.add(replace(FILE, sha256="1" * 64, scans=(_contents(1.0),)))
    store.add(replace(FILE, id="b" * 32, sha256="2" * 64, scans=(_contents(other_mean_m),)))
    stations = [{"name": file[0], "scan": {"file": file, "index": 0}} for file in ("a" * 32, "b" * 32)]
    inputs = RegisterInputs.model_validate({"stations": stations})
    if not refused:
        check_register_inputs(inputs, store, 5)
        return
    with pytest.raises(InvalidRequestError) as caught:
        check_register_inputs(inputs, store, 5)
    assert [fault.pointer for fault in caught.value.faults] == ["/inputs/stations/0/scan", "/inputs/stations/1/scan"]


def test_every_further_copy_of_a_scan_is_named() -> None:
    store = MemoryFileStore()
    for number, mean_m in enumerate((1.0, 7.0, 1.00004, 1.00008)):
        store.add(replace(FILE, id="abcd"[number] * 32, sha256=str(number) * 64, scans=(_contents(mean_m),)))
    stations = [{"name": name, "scan": {"file": name * 32, "index": 0}} for name in "abcd"]
    with pytest.raises(InvalidRequestError) as caught:
        check_register_inputs(RegisterInputs.model_validate({"stations": stations}), store, 5)
    assert {fault.pointer for fault in caught.value.faults} == {f"/inputs/stations/{k}/scan" for k in (0, 2, 3)}


@pytest.mark.parametrize(
    ("asked", "pointer"),
    [
        ({"targets": {"kinds": [{"kind": "sphere", "radius_m": 0.1}]}}, "/inputs/targets"),
        ({"fix": "free"}, "/inputs/fix"),
        ({"scanner": {"estimate": ["vertical_index"]}}, "/inputs/scanner"),
    ],
)
def test_of_very_many_stations_what_needs_one_covariance_of_all_is_refused(
    asked: dict[str, object], pointer: str
) -> None:
    store = MemoryFileStore()
    store.add(replace(FILE, scans=tuple({"index": k} for k in range(MOST_TIED + 1))))
    stations = [{"name": f"S{k}", "scan": {"file": FILE.id, "index": k}} for k in range(MOST_TIED + 1)]
    check_register_inputs(RegisterInputs.model_validate({"stations": stations}), store, 5000)
    with pytest.raises(InvalidRequestError) as caught:
        check_register_inputs(RegisterInputs.model_validate({"stations": stations, **asked}), store, 5000)
    assert [fault.pointer for fault in caught.value.faults] == [pointer]
    assert f"at most {MOST_TIED}" in caught.value.faults[0].detail


def test_of_a_network_whose_result_comes_in_pages_methods_are_not_compared() -> None:
    store = MemoryFileStore()
    store.add(replace(FILE, scans=tuple({"index": k} for k in range(4))))
    stations = [{"name": f"S{k}", "scan": {"file": FILE.id, "index": k}} for k in range(4)]
    inputs = RegisterInputs.model_validate({"stations": stations, "compare_methods": ["lines"]})
    check_register_inputs(inputs, store, 5000, 4)
    with pytest.raises(InvalidRequestError) as caught:
        check_register_inputs(inputs, store, 5000, 3)
    assert [fault.pointer for fault in caught.value.faults] == ["/inputs/compare_methods"]
