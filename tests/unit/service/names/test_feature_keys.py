"""Where the features of a scan are kept."""

from datetime import UTC, datetime

import pytest

from service.names.feature_keys import feature_key, features_of_content
from service.ports import StoredFile
from service.processes import PLANS

SHA256 = "a" * 64


def test_projects_do_not_share_features_whose_speed_would_tell_of_the_other() -> None:
    keys = {feature_key(SHA256, 0, {}, owner=owner) for owner in ("", "alice", "bob")}
    assert len(keys) == 3


def test_a_project_does_not_pass_for_photos() -> None:
    assert feature_key(SHA256, 0, {}, {"project": "alice"}) != feature_key(SHA256, 0, {}, owner="alice")


@pytest.mark.parametrize("owner", ["", "alice"])
def test_all_features_of_a_content_go_with_it(owner: str) -> None:
    assert feature_key(SHA256, 0, {}, owner=owner).startswith(f"{features_of_content(SHA256)}/")


def test_a_plan_names_the_project_of_each_scan() -> None:
    file = StoredFile("f1", "a.e57", 1, SHA256, "E57", "scan", datetime(2026, 1, 1, tzinfo=UTC), owner="alice")
    inputs = {"station": {"name": "S1", "scan": {"file": "f1", "index": 0}, "photos": []}, "options": None}
    job = {"id": "j", "process_id": "extract-lines", "inputs": inputs, "files": {"f1": file.summary()}, "fetches": []}
    stage = PLANS["extract-lines"].next_stage(job, [])
    assert stage is not None
    assert [call.arguments["owner"] for call in stage] == ["alice"]


@pytest.mark.parametrize("reading", [{"unit": "mm"}, {"unit": "ft"}, {"columns": "x,y,z"}])
def test_what_was_said_of_reading_a_file_gives_other_features(reading: dict[str, str]) -> None:
    assert feature_key(SHA256, 0, {}, reading=reading) != feature_key(SHA256, 0, {})


def test_a_plan_tells_how_a_scan_is_read_and_what_is_to_be_said_of_it() -> None:
    scans = (
        {"index": 0, "name": "first", "warnings": ["odd"], "text_columns": "-,x,y,z"},
        {"index": 1, "name": "second", "usable": False, "reason": "no points"},
    )
    file = StoredFile("f1", "a.xyz", 1, SHA256, "XYZ text", "scan", datetime(2026, 1, 1, tzinfo=UTC), scans=scans)
    inputs = {"station": {"name": "S1", "scan": {"file": "f1", "index": 0, "unit": "mm"}, "photos": []}}
    job = {"id": "j", "process_id": "extract-lines", "inputs": inputs, "files": {"f1": file.summary()}, "fetches": []}
    stage = PLANS["extract-lines"].next_stage(job, [])
    assert stage is not None
    arguments = stage[0].arguments
    assert (arguments["columns"], arguments["unit"]) == ("-,x,y,z", "mm")
    assert arguments["warnings"] == [
        "a.xyz: odd",
        "a.xyz: the coordinates were converted from mm to metres, as the request states",
        "a.xyz: scan 1 'second' was left out: no points",
    ]
