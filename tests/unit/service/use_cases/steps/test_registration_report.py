"""The report of a job: chained stations, those left out, comparison with a reference, downloads."""

import csv
import json
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.lines import Lines, lines_from_arrays
from algorithms.geometry.poses import PoseEstimate
from algorithms.progress import NoProgress
from schemas.results.precision import Determined, Precision
from schemas.results.registration_result import Overlap, Pair, UnexplainedSurface
from service.ports import StepContext
from service.use_cases.documents.pose_documents import pose_document
from service.use_cases.steps.feature_store import save_features
from service.use_cases.steps.run_registration_report import report_registration
from tests.doubles.memory import MemoryBlobStore
from tests.unit.service.use_cases.documents.test_pair_documents import MIXED, adjusted
from tests.unit.service.use_cases.steps.test_feature_store import some_features


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


def two_lines() -> Lines:
    anchors = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    return lines_from_arrays(anchors, np.eye(3)[:2], np.tile(np.eye(4), (2, 1, 1)), np.tile([-1.0, 1.0], (2, 1)))


def report(
    pairs: list[Pair],
    names: list[str],
    warnings: dict[str, list[str]] | None = None,
    compared: dict[str, Pair] | None = None,
    **inputs: Any,
) -> tuple[dict[str, Any], MemoryBlobStore]:
    blobs = MemoryBlobStore()
    outputs = []
    for number, each in enumerate(pairs):
        key = f"jobs/j/pairs/{number}.json"
        blobs.write_bytes(key, each.model_dump_json(by_alias=True).encode())
        outputs.append({"pair": key, "status": each.status})
    stations = [{"name": name, "scan": {"file": f"f-{name}", "index": 0}} for name in names]
    counts = {"points": 10, "lines": 1, "planes": 2, "cylinders": 0, "noise_std_m": 0.002}
    path = blobs.scratch() / "features.npz"
    save_features(path, replace(some_features(), lines=two_lines()))
    blobs.put_file("features/k.npz", path)
    features = [
        {
            "features": "features/k.npz",
            "sha256": "ab",
            "counts": {"station": name, **counts, "warnings": (warnings or {}).get(name, [])},
            "timings_s": {"read": 0.5},
        }
        for name in names
    ]
    arguments = {
        "job_id": "j",
        "inputs": {"stations": stations, "method": {"method": "auto"}, **inputs},
        "features": features,
        "pairs": outputs,
    }
    cost = {"seconds": 2.0, "peak_memory_bytes": None, "centre_m": [0.0, 0.0, 0.0]}
    for method, each in (compared or {}).items():
        key = f"jobs/j/methods/{method}.json"
        blobs.write_bytes(key, each.model_dump_json(by_alias=True).encode())
        arguments["compared"] = [*arguments.get("compared", []), {"pair": key, "method": method, **cost}]
    arguments["pairs"] = [{**output, **cost} for output in outputs]
    report_registration(StepContext(blobs, NoProgress()), arguments)
    return json.loads(blobs.local_path("jobs/j/result.json").read_text()), blobs


def test_a_station_without_accepted_pair_is_left_out_by_name_with_the_reason() -> None:
    pairs = [pair("A", "B", motion(1.0, 10.0)), pair("A", "C", motion(2.0, 20.0), "doubtful")]
    result, _ = report(pairs, ["A", "B", "C"])
    assert result["status"] == "partly-registered"
    assert result["stations"][2]["status"] == "unregistered"
    assert result["stations"][2]["world_from_scan"] is None
    assert "doubtful" in result["stations"][2]["reason"]


def test_what_is_to_be_said_of_a_scan_stands_among_the_reasons_of_its_pairs_once() -> None:
    said = {"A": ["a.las: converted"], "B": ["a.las: converted", "b.ply: odd"]}
    result, _ = report([pair("A", "B", motion(1.0, 10.0))], ["A", "B"], said)
    assert result["pairs"][0]["reasons"] == ["a reason", "a.las: converted", "b.ply: odd"]
    assert [each["warnings"] for each in result["features"]] == list(said.values())


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
    assert (method["method"], method["requested"]) == ("auto", "auto")
    assert method["matching"]["max_distance_m"] > 0.0


def test_compared_methods_stand_in_the_result_the_report_and_the_downloads() -> None:
    wrong = pair("A", "B", motion(3.0, 10.0), "rejected")
    result, blobs = report([pair("A", "B", motion(1.0, 10.0))], ["A", "B"], compared={"ndt": wrong})
    rows = result["method_comparison"]["rows"]
    assert [(row["method"], row["mark"]) for row in rows] == [("auto", "accepted"), ("ndt", "failed")]
    assert rows[1]["difference_to_rigorous"]["shift_m"] == pytest.approx(2.0)
    names = {artifact["name"] for artifact in result["artifacts"]}
    assert {"methods.csv", "methods-matrix.csv", "methods.svg"} <= names
    page = blobs.local_path("jobs/j/artifacts/report.html").read_text()
    assert "Methods side by side" in page
    assert page.count("<td>✗</td>") == 1


def test_without_compared_methods_nothing_is_said_of_them() -> None:
    result, blobs = report([pair("A", "B", motion(1.0, 10.0))], ["A", "B"])
    assert "method_comparison" not in result
    assert "Methods side by side" not in blobs.local_path("jobs/j/artifacts/report.html").read_text()


def test_pairs_as_a_table_answer_place_rank_and_precision() -> None:
    known = Precision(
        tolerance_m=0.02, tolerance_stated=False, kept=False, centre_std_m=0.01, far_m=40.0, far_std_m=0.038,
        std_gon=0.01, undetected_m=None, findings=["the far end"],
    )  # fmt: skip
    coarse = pair("A", "B", motion(1.0, 10.0), "coarse").model_copy(
        update={"precision": known, "determined": Determined(rank=6, free=[], advice="")}
    )
    result, blobs = report([coarse], ["A", "B"])
    assert result["stations"][1]["status"] == "registered"
    with blobs.local_path("jobs/j/artifacts/pairs.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert (row["status"], row["use"], row["parameters_determined"]) == ("coarse", "uncontrolled", "6")
    assert (float(row["std_far_m"]), float(row["tolerance_m"]), row["place_probability"]) == (0.038, 0.02, "")
    page = blobs.local_path("jobs/j/artifacts/report.html").read_text()
    assert "Precision: less than asked; 38.00 mm" in page
    assert "Determined: all six parameters" in page


def test_every_listed_download_is_there_with_its_size() -> None:
    result, blobs = report([pair("A", "B", motion(1.0, 10.0))], ["A", "B"])
    names = {artifact["name"] for artifact in result["artifacts"]}
    assert {
        "poses.csv",
        "pairs.csv",
        "correspondences.csv",
        "lines.ply",
        "lines.dxf",
        "report.html",
        "report.pdf",
        "result.json",
        "A.txt",
        "B.txt",
    } <= names
    for artifact in result["artifacts"]:
        assert blobs.local_path(f"jobs/j/artifacts/{artifact['name']}").stat().st_size == artifact["bytes"]


def test_a_matrix_download_reads_back_exactly() -> None:
    result, blobs = report([pair("A", "B", motion(1.0, 10.0))], ["A", "B"])
    read = np.loadtxt(blobs.local_path("jobs/j/artifacts/B.txt"))
    np.testing.assert_array_equal(read, np.array(result["stations"][1]["world_from_scan"]["matrix"]))


def test_the_result_can_be_downloaded_as_a_file_that_lists_itself() -> None:
    result, blobs = report([pair("A", "B", motion(1.0, 10.0))], ["A", "B"])
    assert json.loads(blobs.local_path("jobs/j/artifacts/result.json").read_text()) == result


def test_the_table_of_correspondences_has_every_figure_under_a_name_with_its_unit() -> None:
    matched = adjusted(MIXED, moved=4)
    _, blobs = report([matched], ["A", "B"])
    with blobs.local_path("jobs/j/artifacts/correspondences.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(matched.correspondences)
    for row, entry in zip(rows, matched.correspondences, strict=True):
        assert (row["target_feature"], row["state"], row["kind"]) == (entry.target_line, entry.state, "line")
        assert float(row["residual_offset_2_m"]) == entry.residuals[3]
        assert entry.test is not None
        assert float(row["test_critical_b_method"]) == entry.test.critical_b_method
    assert (rows[4]["mdb_tilt_1_rad"], rows[4]["effect_tx_m"]) == ("", "")
    assert rows[4]["why"].startswith("moved between the scans")
    assert all(rows[3][name] for name in ("mdb_tilt_1_rad", "effect_omega_gon", "effect_global_effect", "at_x_m"))


def test_lines_lie_in_the_common_frame_as_edges() -> None:
    _, blobs = report([pair("A", "B", motion(1.0, 100.0))], ["A", "B"])
    data = blobs.local_path("jobs/j/artifacts/lines.ply").read_bytes()
    header, body = data.split(b"end_header\n", 1)
    assert b"element vertex 8" in header
    assert b"element edge 4" in header
    ends = np.frombuffer(body[: 8 * 24], dtype="<f8").reshape(-1, 2, 3)
    origin = some_features().origin_m
    np.testing.assert_allclose(ends[0], np.add(origin, [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), atol=1e-9)
    np.testing.assert_allclose(ends[2], motion(1.0, 100.0).apply(ends[0]), atol=1e-6)
    edges = np.frombuffer(body[8 * 24 :], dtype=[("ends", "<i4", 2), ("color", "u1", 3)])
    assert edges["ends"].tolist() == [[0, 1], [2, 3], [4, 5], [6, 7]]


class Page(HTMLParser):
    """Notes tags and text; fails where a tag is closed that was not open."""

    VOID = ("meta", "br", "img")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.links: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.links += [value or "" for name, value in attrs if name in {"src", "href", "xlink:href"}]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:  # noqa: ARG002 - given
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:
        self.text += data


def page(pairs: list[Pair], **inputs: Any) -> Page:
    _, blobs = report(pairs, ["A", "B"], **inputs)
    parsed = Page()
    parsed.feed(blobs.local_path("jobs/j/artifacts/report.html").read_text())
    parsed.close()
    return parsed


def test_the_report_needs_nothing_beside_itself_and_is_well_formed() -> None:
    parsed = page([adjusted(MIXED, moved=4)])
    assert parsed.open == []
    assert all(link.startswith("data:image/png;base64,") for link in parsed.links)
    assert not {"script", "link", "iframe"} & set(parsed.tags)
    assert parsed.tags.count("svg") >= 4


def test_the_report_names_what_was_removed_and_why() -> None:
    text = page([adjusted(MIXED, moved=4)]).text
    assert "A/L5 – B/L5" in text
    assert "moved between the scans" in text


def test_the_report_of_parallel_lines_shows_dashes_and_what_is_free() -> None:
    degenerate = adjusted([[0, 0, 1]] * 6).model_copy(update={"status": "degenerate"})
    text = page([degenerate]).text
    assert "translation along" in text
    assert "would fit as well" in text


def test_the_report_compares_with_the_reference() -> None:
    reference = {"A": np.eye(4).tolist(), "B": {"matrix": motion(1.0, 10.0).as_matrix().tolist()}}
    text = page([pair("A", "B", motion(1.0, 10.0))], reference=reference).text
    assert "Comparison with the reference" in text
    assert "no more than their standard deviations explain" in text


def test_the_report_says_where_surface_stands_in_free_space() -> None:
    pieces = [UnexplainedSurface(station="B", centre_m=(12.344, -3.0, 1.5), area_m2=2.25, range_m=9.87)]
    overlap = Overlap(
        fraction_0_5m=0.6, fraction_0_1m=0.5, rms_m=0.004, free_space_violations=0.01, unexplained=pieces
    )  # fmt: skip
    parsed = page([pair("A", "B", motion(1.0, 10.0)).model_copy(update={"overlap": overlap})])
    assert parsed.open == []
    assert all(words in parsed.text for words in ("Surface in free space", "12.34", "2.25", "9.9"))


def test_reasons_cannot_inject_markup() -> None:
    hostile = pair("A", "B", motion(1.0, 10.0)).model_copy(update={"reasons": ["<script>alert(1)</script>"]})
    parsed = page([hostile])
    assert "script" not in parsed.tags
    assert "<script>alert(1)</script>" in parsed.text
