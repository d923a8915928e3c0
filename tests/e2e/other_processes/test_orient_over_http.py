"""Two stations with a bad pose are laid on each other over HTTP, with a detail that both show."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from tests.e2e.running.running_service import RunningService
from tests.e2e.running.virtual_scans import first_from_second


def stations_of(service: RunningService, house: Sequence[Path]) -> list[dict[str, object]]:
    off = RigidTransform.from_components([0.04, -0.03, 0.02], Rotation.from_rotvec([0.004, -0.003, 0.01]))
    poses = (RigidTransform.identity(), off * first_from_second("house"))
    return [
        {"name": path.stem, "scan": {"file": service.upload(path)["id"]}, "world_from_scan": pose.as_matrix().tolist()}
        for path, pose in zip(house, poses, strict=True)
    ]


def test_clouds_come_to_lie_on_each_other(service: RunningService, house: Sequence[Path]) -> None:
    stations, truth = stations_of(service, house), first_from_second("house")
    first, second = (str(station["name"]) for station in stations)
    detail = np.array([2.0, 1.0, 0.5])
    ties = [{"first": first, "second": second, "points": [[*truth.apply(detail), *detail]]}]
    result = service.result(service.execute("orient", {"stations": stations, "ties": ties}))
    assert result["converged"]
    assert result["neighbours"] == [[first, second]]
    error = truth.inv() * RigidTransform.from_matrix(np.array(result["stations"][1]["world_from_scan"]))
    assert float(error.rotation.magnitude()) < 0.001
    assert float(np.linalg.norm(error.translation)) < 0.01
    assert result["ties"][0]["distances_m"][0] < 0.01


def test_stations_that_are_not_there_are_named(service: RunningService, house: Sequence[Path]) -> None:
    stations = stations_of(service, house)
    inputs = {"stations": stations, "fixed": ["X"], "ties": [{"first": "X", "second": "X", "points": [[0.0] * 6]}]}
    answer = service.post("/processes/orient/execution", json={"inputs": inputs})
    assert answer.status_code == 400
    assert "there is no station 'X'" in answer.text
    assert "tied to itself" in answer.text
