"""Methods side by side: the plan that runs them, the table of what came out, its files."""

import csv
import io
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.poses import PoseEstimate
from schemas.requests.register_inputs import RegisterInputs
from schemas.results.method_comparison import MethodComparison
from schemas.results.own_figures import OwnFigures
from schemas.results.registration_result import Pair
from service.errors import InvalidRequestError
from service.ports import StoredFile
from service.processes.register.plan import RegisterPlan, other_methods
from service.use_cases.documents.method_comparison_documents import MethodOnPair, method_comparison
from service.use_cases.documents.pose_documents import pose_document
from service.use_cases.inputs.check_stations import check_register_inputs
from service.use_cases.reports.method_files import matrix_csv, method_files
from tests.doubles.memory import MemoryFileStore
from tests.unit.service.use_cases.steps.test_registration_report import motion, pair

FEATURES = [{"features": f"features/{name}", "counts": {"station": name}} for name in "AB"]
CENTRE = (10.0, 20.0, 1.0)


def inputs(*methods: Any, **more: Any) -> dict[str, Any]:
    stations = [{"name": name, "scan": {"file": name}} for name in "AB"]
    asked = RegisterInputs.model_validate({"stations": stations, "compare_methods": list(methods), **more})
    return asked.model_dump(mode="json", by_alias=True)


def job(*methods: Any) -> dict[str, Any]:
    files = {name: {"name": f"{name}.e57", "sha256": name * 64} for name in "AB"}
    return {"id": "j", "process_id": "register", "inputs": inputs(*methods), "files": files}


PAIRS = [{"pair": "jobs/j/pairs/0.json", "status": "accepted", "target": "A", "source": "B", "link": None}]


def test_every_other_method_registers_every_pair_between_the_pairs_and_the_report() -> None:
    outputs: list[list[dict[str, Any]]] = [FEATURES, PAIRS]
    calls = RegisterPlan().next_stage(job("ndt", "auto", "lines"), outputs)
    assert calls is not None
    assert [(call.name, call.arguments["name"], call.arguments["method"]["method"]) for call in calls] == [
        ("compare-method", "ndt", "ndt"),
        ("compare-method", "lines", "lines"),
    ]
    assert len({call.arguments["number"] for call in calls}) == 2
    outputs.append([{"pair": "p", "method": "ndt"}, {"pair": "q", "method": "lines"}])
    report = RegisterPlan().next_stage(job("ndt", "auto", "lines"), outputs)
    assert report is not None
    assert report[0].name == "report-registration"
    assert report[0].arguments["compared"] == outputs[2]
    assert RegisterPlan().next_stage(job("ndt", "auto", "lines"), [*outputs, [{}]]) is None


def test_without_other_methods_the_report_follows_the_pairs() -> None:
    report = RegisterPlan().next_stage(job(), [FEATURES, PAIRS])
    assert report is not None
    assert report[0].name == "report-registration"
    assert "compared" not in report[0].arguments


def test_one_method_in_two_ways_has_two_names_and_a_method_named_twice_is_run_once() -> None:
    finer = {"method": "ndt", "layers": {"steps": 4}}
    others = other_methods(inputs("ndt", "ndt", finer))
    assert list(others) == ["ndt", "ndt (2)"]


def test_an_unknown_method_is_refused_with_its_place() -> None:
    with pytest.raises(ValueError, match=r"compare_methods\.1"):
        inputs("lines", "magic")


def test_features_of_its_own_are_refused_for_a_compared_method() -> None:
    store = MemoryFileStore()
    when = datetime(2026, 1, 1, tzinfo=UTC)
    for name in "AB":
        store.add(StoredFile(name * 32, name, 9, name, "E57", "scan", when, scans=({"index": 0},)))
    stations = [{"name": name, "scan": {"file": name * 32}} for name in "AB"]
    method = {"method": "planes", "features": {"min_plane_points": 99}}
    asked = RegisterInputs.model_validate({"stations": stations, "compare_methods": ["lines", method]})
    with pytest.raises(InvalidRequestError) as caught:
        check_register_inputs(asked, store, 5)
    assert [fault.pointer for fault in caught.value.faults] == ["/inputs/compare_methods/1/features"]


def with_own_pose(each: Pair, own: RigidTransform) -> Pair:
    claimed = pose_document(PoseEstimate(own, 1e-6 * np.eye(6)), target="A", source="B", centroid_m=None)
    figures = OwnFigures(
        label="a method", claimed=claimed, rigorous=each.target_from_source, steps=[], lines=[], declared_outliers=[],
        mean_std_rotation_gon=None, mean_std_translation_m=None, max_angle_gon=None, max_distance_m=None,
        convergence=[], remarks=[],
    )  # fmt: skip
    return each.model_copy(update={"own_figures": figures})


def of(method: str, each: Pair) -> MethodOnPair:
    return MethodOnPair(method, each, 1.5, 10**8, CENTRE)


def compared(*others: MethodOnPair, reference: Any = None) -> MethodComparison:
    first = of("auto", pair("A", "B", motion(1.0, 10.0)))
    return method_comparison([first], others, "A", reference)


def test_the_shift_between_two_poses_is_that_of_the_middle_of_the_scan() -> None:
    turned = motion(1.0, 10.5)
    row = compared(of("ndt", with_own_pose(pair("A", "B", motion(1.0, 10.0)), turned))).rows[1]
    difference = row.difference_to_rigorous
    assert difference is not None
    assert difference.rotation_gon == pytest.approx(0.5)
    expected = np.linalg.norm(turned.apply(np.array(CENTRE)) - motion(1.0, 10.0).apply(np.array(CENTRE)))
    assert difference.shift_m == pytest.approx(expected)
    assert difference.significant


def test_a_pose_within_its_standard_deviations_of_the_reference_differs_by_nothing_significant() -> None:
    near = motion(1.001, 10.0).as_matrix().tolist()
    row = compared(reference={"B": near}).rows[0]
    assert row.difference_to_reference is not None
    assert row.difference_to_reference.shift_m == pytest.approx(0.001)
    assert row.difference_to_reference.significant is False
    assert row.mark == "accepted"


def test_the_matrix_tells_accepted_found_failed_and_wrong() -> None:
    right, wrong = motion(1.0, 10.0), motion(9.0, 110.0)
    result = compared(
        of("egi", with_own_pose(pair("A", "B", right, "doubtful"), right)),
        of("ndt", with_own_pose(pair("A", "B", wrong, "rejected"), wrong)),
        of("lines", pair("A", "B", wrong)),
        reference={"A": np.eye(4).tolist(), "B": right.as_matrix().tolist()},
    )
    assert [(row.method, row.marks) for row in result.matrix.methods] == [
        ("auto", ["accepted"]),
        ("egi", ["found"]),
        ("ndt", ["failed"]),
        ("lines", ["wrong"]),
    ]
    assert list(csv.reader(io.StringIO(matrix_csv(result)))) == [
        ["method", "B -> A"],
        ["auto", "✓"],
        ["egi", "(✓)"],
        ["ndt", "✗"],
        ["lines", "✗!"],
    ]


def test_the_comparison_does_not_depend_on_how_far_the_coordinates_are() -> None:
    far = RigidTransform.from_translation([500_000.0, 5_300_000.0, 0.0])
    near, moved = (
        method_comparison(
            [of("auto", pair("A", "B", shift * motion(1.0, 10.0)))],
            [of("lines", pair("A", "B", shift * motion(1.01, 10.02)))],
            "A",
            None,
        ).rows[1]
        for shift in (RigidTransform.identity(), far)
    )
    assert near.difference_to_rigorous is not None
    assert moved.difference_to_rigorous is not None
    assert moved.difference_to_rigorous.shift_m == pytest.approx(near.difference_to_rigorous.shift_m, abs=1e-8)
    assert moved.difference_to_rigorous.statistic == pytest.approx(near.difference_to_rigorous.statistic, rel=1e-6)


def test_the_table_of_the_csv_has_a_row_for_each_pair_and_method_and_the_picture_a_dot() -> None:
    right = motion(1.0, 10.0)
    files = method_files(compared(of("egi", with_own_pose(pair("A", "B", right, "doubtful"), motion(1.2, 10.0)))))
    rows = list(csv.DictReader(io.StringIO(files["methods.csv"][1].decode())))
    assert [row["method"] for row in rows] == ["auto", "egi"]
    assert float(rows[1]["difference_to_rigorous_shift_m"]) == pytest.approx(0.2)
    assert float(rows[1]["kappa_gon"]) == pytest.approx(10.0)
    assert files["methods.svg"][1].decode().count("<circle") == 1
    assert rows[0]["difference_to_reference_shift_m"] == ""


def test_a_rotation_about_the_middle_moves_it_by_nothing() -> None:
    centre = np.array(CENTRE)
    about = RigidTransform.from_translation(centre) * RigidTransform.from_rotation(Rotation.from_rotvec([0, 0, 0.001]))
    about *= RigidTransform.from_translation(-centre)
    identity = of("auto", pair("A", "B", RigidTransform.identity()))
    row = method_comparison([identity], [of("lines", pair("A", "B", about))], "A", None).rows[1]
    assert row.difference_to_rigorous is not None
    assert row.difference_to_rigorous.shift_m == pytest.approx(0.0, abs=1e-12)
