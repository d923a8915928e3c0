"""Which poses of files a job takes, and where they leave the frame open."""

from typing import Any

from service.ports import Json
from service.use_cases.inputs.file_poses import file_pose_faults, scans_by_number, with_file_poses

IDENTITY = [[float(i == j) for j in range(4)] for i in range(4)]
MOVED = [[1.0, 0.0, 0.0, 5000.0], *IDENTITY[1:]]


def stations(count: int, **scan: Any) -> list[Json]:
    return [{"name": f"S{k}", "scan": {"file": "f", "index": k, **scan}, "world_from_scan": None} for k in range(count)]


def scans(*poses: Any, **said: Any) -> Any:
    found = [{"index": k, **said, **({} if pose is None else {"scan_pose": pose})} for k, pose in enumerate(poses)]
    return scans_by_number({"f": {"scans": found}})


def matrices(given: list[Json]) -> list[Any]:
    return [station["world_from_scan"] and station["world_from_scan"]["matrix"] for station in given]


def test_the_setup_whose_frame_is_the_common_one_has_the_identity() -> None:
    find = scans(IDENTITY, MOVED)
    assert matrices(with_file_poses(stations(2), find)) == [IDENTITY, MOVED]
    assert not list(file_pose_faults(stations(2), find, "/inputs/stations"))


def test_identities_alone_say_nothing() -> None:
    find = scans(IDENTITY, IDENTITY, None)
    assert matrices(with_file_poses(stations(3), find)) == [None, None, None]
    assert not list(file_pose_faults(stations(3), find, "/inputs/stations"))


def test_two_identities_beside_a_pose_are_setups_that_nobody_has_registered() -> None:
    faults = list(file_pose_faults(stations(3), scans(IDENTITY, MOVED, IDENTITY), "/inputs/stations"))
    assert [fault.pointer for fault in faults] == [f"/inputs/stations/{k}/world_from_scan" for k in (0, 2)]


def test_a_stated_pose_is_kept_and_asks_for_no_other() -> None:
    given = stations(2)
    given[1]["world_from_scan"] = {"matrix": IDENTITY}
    assert matrices(with_file_poses(given, scans(MOVED, None))) == [MOVED, IDENTITY]
    assert not list(file_pose_faults(given, scans(MOVED, None), "/inputs/stations"))


def test_the_unit_that_the_request_states_is_that_of_the_pose_too() -> None:
    (in_mm,) = matrices(with_file_poses(stations(1, unit="mm"), scans(MOVED)))
    assert in_mm[0] == [1.0, 0.0, 0.0, 5.0]
    (declared,) = matrices(with_file_poses(stations(1, unit="mm"), scans(MOVED, unit="mm")))
    assert declared == MOVED
