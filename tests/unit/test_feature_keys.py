"""Where the features of a scan are kept."""

from datetime import UTC, datetime

import pytest

from service.ports import StoredFile
from service.use_cases.feature_keys import feature_key, features_of_content
from service.use_cases.plans import PLANS

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
