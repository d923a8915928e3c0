"""The report of a job: chained stations, those left out, comparison with a reference, downloads."""

import json
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.poses import PoseEstimate
from algorithms.progress import NoProgress
from schemas.registration_result import Pair
from service.adapters.memory import MemoryBlobStore
from service.ports import StepContext
from service.use_cases.pose_documents import pose_document
from service.use_cases.run_registration_report import report_registration


def motion(x: float, kappa_gon: float) -> RigidTransform:
    return RigidTransform.from_components([x, 0.0, 0.0], Rotation.from_euler("z", kappa_gon * 0.9, degrees=True))


def pair(target: str, source: str, pose: RigidTransform, status: str = "accepted") -> Pair:
    estimate = PoseEstimate(pose, np.diag([1e-8, 1e-8, 1e-8, 1e-6, 1e-6, 1e-6]))
    return Pair(
        target=target,
        source=source,
        status=status,
        reasons=["a reason"],
        target_from_source=pose_document(estimate, target=target, source=source, centroid_m=np.array([1.0, 2.0, 3.0])),
        coarse=None,
        adjustment=None,
        correspondences=[],
        plane_correspondences=[],
        outliers=[],
        accuracy=None,
        rank_report=None,
        weak_directions=[],
        overlap=None,
        timings_s={"matching": 1.0},
    )


def report(pairs: list[Pair], names: list[str], **inputs: Any) -> tuple[dict[str, Any], MemoryBlobStore]:
    blobs = MemoryBlobStore()
    outputs = []
    for number, each in enumerate(pairs):
        key = f"jobs/j/pairs/{number}.json"
        blobs.write_bytes(key, each.model_dump_json(by_alias=True).encode())
        outputs.append({"pair": key, "status": each.status})
    stations = [{"name": name, "scan": {"file": f"f-{name}", "index": 0}} for name in names]
    counts = {"points": 10, "lines": 1, "planes": 2, "cylinders": 0, "noise_std_m": 0.002}
    features = [
        {"features": "k", "sha256": "ab", "counts": {"station": name, **counts}, "timings_s": {"read": 0.5}}
        for name in names
    ]
    arguments = {
        "job_id": "j",
        "inputs": {"stations": stations, "method": {"method": "auto"}, **inputs},
        "features": features,
        "pairs": outputs,
    }
    report_registration(StepContext(blobs, NoProgress()), arguments)
    return json.loads(blobs.local_path("jobs/j/result.json").read_text()), blobs


def test_a_station_seen_only_by_its_neighbour_is_chained_and_knows_less() -> None:
    result, _ = report([pair("A", "B", motion(1.0, 10.0)), pair("B", "C", motion(2.0, 20.0))], ["A", "B", "C"])
    assert result["status"] == "registered"
    near, far = (station["world_from_scan"] for station in result["stations"][1:])
    np.testing.assert_allclose(far["matrix"], (motion(1.0, 10.0) * motion(2.0, 20.0)).as_matrix(), atol=1e-12)
    assert far["std"]["tx_m"] > near["std"]["tx_m"]


def test_a_station_without_accepted_pair_is_left_out_by_name_with_the_reason() -> None:
    pairs = [pair("A", "B", motion(1.0, 10.0)), pair("A", "C", motion(2.0, 20.0), "doubtful")]
    result, _ = report(pairs, ["A", "B", "C"])
    assert result["status"] == "partly-registered"
    assert result["stations"][2]["status"] == "unregistered"
    assert result["stations"][2]["world_from_scan"] is None
    assert "doubtful" in result["stations"][2]["reason"]


def test_a_pose_that_was_not_accepted_never_becomes_a_station_pose() -> None:
    for status in ("doubtful", "rejected", "ambiguous", "degenerate"):
        result, _ = report([pair("A", "B", motion(1.0, 10.0), status)], ["A", "B"])
        assert result["status"] == "not-registered"
        assert result["stations"][1]["world_from_scan"] is None


def test_differences_of_angles_go_the_short_way_round() -> None:
    reference = {"A": np.eye(4).tolist(), "B": motion(1.0, -199.99).as_matrix().tolist()}
    result, _ = report([pair("A", "B", motion(1.0, 199.99))], ["A", "B"], reference=reference)
    kappa = next(row for row in result["comparison"] if row["parameter"] == "kappa_gon")
    assert kappa["difference"] == pytest.approx(-0.02, abs=1e-9)


def test_the_options_as_used_stand_in_the_provenance() -> None:
    result, _ = report([pair("A", "B", motion(1.0, 10.0))], ["A", "B"])
    method = result["provenance"]["method"]
    assert (method["method"], method["requested"]) == ("lines", "auto")
    assert method["matching"]["max_distance_m"] > 0.0


def test_every_listed_download_is_there_with_its_size() -> None:
    result, blobs = report([pair("A", "B", motion(1.0, 10.0))], ["A", "B"])
    names = {artifact["name"] for artifact in result["artifacts"]}
    assert {"poses.csv", "correspondences.csv", "A.txt", "B.txt"} <= names
    for artifact in result["artifacts"]:
        assert blobs.local_path(f"jobs/j/artifacts/{artifact['name']}").stat().st_size == artifact["bytes"]


def test_a_matrix_download_reads_back_exactly() -> None:
    result, blobs = report([pair("A", "B", motion(1.0, 10.0))], ["A", "B"])
    read = np.loadtxt(blobs.local_path("jobs/j/artifacts/B.txt"))
    np.testing.assert_array_equal(read, np.array(result["stations"][1]["world_from_scan"]["matrix"]))
