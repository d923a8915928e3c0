"""Scenes and points for a viewer: with the access rules of results, by ranges, whatever stations are called."""

import json
from datetime import UTC, datetime
from typing import Any

import pytest

from service.dependencies import Adapters
from service.names.scene_keys import scene_key
from service.ports import Job, JobStatus
from tests.api.conftest import Client

NOW = datetime(2026, 1, 31, 12, tzinfo=UTC)
HOSTILE = '</script><img src=x onerror="alert(1)">'
POINTS = bytes(range(256))
BLOCKS = {"format": "tieline-points/1", "nodes": [[0, 0, 0, 0, 0, 16]]}
KEYS = ("features/a/b.points", "features/a/b.points.json")
STATION: dict[str, Any] = {
    "name": HOSTILE, "status": "fixed", "reason": None, "world_from_scan": None, "covariance": None,
    "noise_std_m": 0.002, "points": 16, "sensor_m": None, "bounds_m": [[0, 0, 0], [1, 1, 1]],
    "lines": [], "planes": [], "cylinders": [],
}  # fmt: skip
SCENE = {"stations": [STATION], "stages": [], "pairs": [], "points": [KEYS]}


def a_job(adapters: Adapters, name: str = "job0", *, finished: bool = True) -> str:
    adapters.jobs.create_and_enqueue(Job(name, "register", {}, JobStatus.ACCEPTED, NOW, updated=NOW))
    adapters.jobs.start(name, NOW)
    if finished:
        adapters.jobs.succeed(name, NOW)
    return name


@pytest.fixture
def job(adapters: Adapters) -> str:
    name = a_job(adapters)
    adapters.blobs.write_bytes(scene_key(name), json.dumps(SCENE).encode())
    adapters.blobs.write_bytes(KEYS[0], POINTS)
    adapters.blobs.write_bytes(KEYS[1], json.dumps(BLOCKS).encode())
    return name


def test_a_scene_says_where_the_points_are_and_not_under_which_names_they_are_kept(client: Client, job: str) -> None:
    answer = client.get(f"/jobs/{job}/scene")
    assert answer.status_code == 200
    assert answer.json()["clouds"] == [{"station": HOSTILE, "href": f"/jobs/{job}/scene/points/0", "blocks": BLOCKS}]
    assert "features/" not in answer.text


def test_names_of_stations_are_data_and_the_answer_says_that_it_is_no_page(client: Client, job: str) -> None:
    answer = client.get(f"/jobs/{job}/scene", headers={"Accept": "text/html"})
    assert answer.headers["content-type"] == "application/json"
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert "default-src 'none'" in answer.headers["content-security-policy"]


def test_points_come_by_ranges(client: Client, job: str) -> None:
    answer = client.get(f"/jobs/{job}/scene/points/0", headers={"Range": "bytes=16-31"})
    assert (answer.status_code, answer.content) == (206, POINTS[16:32])
    assert answer.headers["content-range"] == "bytes 16-31/256"
    assert client.get(f"/jobs/{job}/scene/points/0", headers={"Range": "bytes=256-"}).status_code == 416


@pytest.mark.parametrize("number", ["1", "-1", "999999999999"])
def test_there_are_no_points_of_a_station_that_is_none(client: Client, job: str, number: str) -> None:
    assert client.get(f"/jobs/{job}/scene/points/{number}").status_code == 404


@pytest.mark.parametrize("number", ["x", "0%2F..%2F..", "1e3"])
def test_what_is_no_number_of_a_station_is_refused(client: Client, job: str, number: str) -> None:
    assert client.get(f"/jobs/{job}/scene/points/{number}").status_code in {400, 404}


def test_a_scene_stays_when_the_points_are_gone_with_their_file(client: Client, adapters: Adapters, job: str) -> None:
    adapters.blobs.delete_prefix("features/a")
    assert client.get(f"/jobs/{job}/scene").json()["clouds"] == [{"station": HOSTILE, "href": None, "blocks": None}]
    assert client.get(f"/jobs/{job}/scene/points/0").status_code == 404


def test_a_job_that_runs_or_has_nothing_to_show_has_no_scene(client: Client, adapters: Adapters) -> None:
    for name in (a_job(adapters, "running", finished=False), a_job(adapters, "without"), "nobody"):
        assert client.get(f"/jobs/{name}/scene").status_code == 404
        assert client.get(f"/jobs/{name}/scene/points/0").status_code == 404
