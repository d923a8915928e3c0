"""Process `transform`: its plan and its steps, from uploaded files to downloads."""

import json
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.scans.scan import Scan
from schemas.requests.transform import TransformDocument
from service.adapters.files.local_files import LocalFiles
from service.errors import InvalidRequestError
from service.formats import read_scan
from service.formats.writers import write_scans
from service.ports import Json, StepContext
from service.processes import OFFERED_PROCESSES, STEPS
from service.use_cases.inputs.validate_request import validated
from service.use_cases.steps.registered_calls import distinct_stems

POSES = {
    "S1": RigidTransform.from_components([500_000.0, 5_400_000.0, 300.0], Rotation.identity()),
    "S 2 (b)": RigidTransform.from_components([500_010.0, 5_400_005.0, 301.0], Rotation.from_rotvec([0.1, -0.2, 2.0])),
}
COVARIANCE = np.diag([1e-8, 1e-8, 4e-8, 1e-6, 1e-6, 4e-6])
SHA = {"a": "a" * 64, "b": "b" * 64, "c": "c" * 64}


class Progress:
    def report(self, fraction: float, message: str) -> None:
        assert 0.0 <= fraction <= 1.0, message


def a_scan(seed: int, name: str) -> Scan:
    rng = np.random.default_rng(seed)
    return Scan(
        points=rng.uniform(-20.0, 20.0, (500, 3)),
        origin_m=np.zeros(3),
        name=name,
        intensity=rng.random(500).astype(np.float32),
        color=rng.integers(0, 256, (500, 3)).astype(np.uint8),
    )


SCANS = {name: a_scan(seed, name) for seed, name in enumerate(POSES)}


@pytest.fixture
def context(tmp_path: Path) -> StepContext:
    blobs = LocalFiles(tmp_path / "store")
    for key, scans in (("a", [*SCANS.values()]), ("b", [SCANS["S1"]])):
        write_scans(tmp_path / f"{key}.e57", scans)
        blobs.put_file(f"files/{SHA[key]}", tmp_path / f"{key}.e57")
    return StepContext(blobs, Progress(), {"max_points": 10**6, "max_photo_pixels": 10**6, "min_free_bytes": 0})


def inputs(**more: Any) -> Json:
    stations = [
        {
            "name": name,
            "scan": {"file": "fa", "index": index},
            "world_from_scan": {"matrix": pose.as_matrix().tolist(), "covariance": COVARIANCE.tolist()},
        }
        for index, (name, pose) in enumerate(POSES.items())
    ]
    process = OFFERED_PROCESSES["transform"]
    return validated(process.inputs, {"stations": stations, **more}).model_dump(mode="json", by_alias=True)


def run(context: StepContext, given: Json) -> TransformDocument:
    """Do what the engine does: stage after stage until the plan has none."""
    files = {"fa": {"name": "house.e57", "sha256": SHA["a"]}, "fb": {"name": "other.e57", "sha256": SHA["b"]}}
    job = {"id": "j1", "process_id": "transform", "inputs": given, "files": files}
    outputs: list[list[Json]] = []
    plan = OFFERED_PROCESSES["transform"].plan
    while (calls := plan.next_stage(job, outputs)) is not None:
        outputs.append([STEPS[call.name](context, json.loads(json.dumps(call.arguments))) for call in calls])
    return TransformDocument.model_validate_json(context.blobs.local_path("jobs/j1/result.json").read_bytes())


def download(context: StepContext, name: str) -> Path:
    return context.blobs.local_path(f"jobs/j1/artifacts/{name}")


def world(name: str) -> np.ndarray:
    return POSES[name].apply(SCANS[name].points)


def test_an_uploaded_e57_comes_back_as_the_same_file_with_new_poses(context: StepContext) -> None:
    document = run(context, inputs())
    (file,) = document.files
    assert (file.name, file.stations, file.points) == ("house-registered.e57", [*POSES], 1000)
    assert file.notes[0].startswith("the uploaded file with other poses")
    path = download(context, file.name)
    for index, pose in enumerate(POSES.values()):
        found = read_scan(path, file.name, index).world_from_scan
        assert found is not None
        assert np.abs(found.as_matrix() - pose.as_matrix()).max() < 1e-9
    before = context.blobs.local_path(f"files/{SHA['a']}").read_bytes()
    assert path.read_bytes()[1024 : len(before)] == before[1024:]


@pytest.mark.parametrize("name", ["laz", "copc", "ply", "pcd", "xyz", "pts"])
def test_merged_files_have_all_points_in_the_world_frame_to_a_tenth_of_a_millimetre(
    context: StepContext, name: str
) -> None:
    (file,) = run(context, inputs(format=name, merge=True)).files
    assert (file.points, file.stations) == (1000, [*POSES])
    scans = [read_scan(download(context, file.name), file.name, k) for k in range(2 if name == "pts" else 1)]
    found = np.concatenate([scan.points + scan.origin_m for scan in scans])
    expected = np.concatenate([world(each) for each in POSES])
    order = [np.lexsort(points.round(2).T) for points in (found, expected)]
    # steps of 0.1 mm: half of one for each axis
    assert np.abs(found[order[0]] - expected[order[1]]).max() < 1e-4


def test_each_station_has_a_file_of_its_own_unless_they_are_merged(context: StepContext) -> None:
    document = run(context, inputs(format="laz"))
    assert [file.name for file in document.files] == ["S1-registered.laz", "S_2_b_-registered.laz"]
    assert [artifact.bytes for artifact in document.artifacts] == [
        download(context, file.name).stat().st_size for file in document.files
    ]


def test_standard_deviations_grow_with_the_distance_from_the_station(context: StepContext) -> None:
    (file, _) = run(context, inputs(format="laz", per_point_std=True, range_std_m=0.002)).files
    cloud = laspy.read(download(context, file.name))
    expected_mm = 1000.0 * np.sqrt(
        # about x and y 0.1 mrad, about z 0.2 mrad; shifts of 1, 1 and 2 mm; ranges of 2 mm
        (SCANS["S1"].points ** 2 * [5e-8, 5e-8, 2e-8]).sum(axis=1) + 6e-6 + 4e-6
    )
    order = [np.lexsort(np.round(p, 2).T) for p in (np.array(cloud.xyz), world("S1"))]
    assert np.array(cloud["std_mm"])[order[0]] == pytest.approx(expected_mm[order[1]], rel=1e-4)


def test_standard_deviations_without_noise_of_the_ranges_say_so(context: StepContext) -> None:
    files = run(context, inputs(format="laz", per_point_std=True)).files
    assert any("no part for the noise" in note for note in files[0].notes)


def test_a_new_e57_keeps_the_standard_deviations_as_a_field_of_its_own(context: StepContext) -> None:
    (file,) = run(context, inputs(per_point_std=True, range_std_m=0.001)).files
    assert not any("byte for byte" in note for note in file.notes)
    found = read_scan(download(context, file.name), file.name, 1)
    assert np.abs(found.points - SCANS["S 2 (b)"].points).max() < 1e-9


def test_the_reference_system_stands_in_the_file(context: StepContext) -> None:
    (file, _) = run(context, inputs(format="laz", crs="EPSG:25832")).files
    crs = laspy.read(download(context, file.name)).header.parse_crs()
    assert crs is not None
    assert crs.to_epsg() == 25832


def test_poses_alone_come_in_all_conventions(context: StepContext) -> None:
    names = {file.name for file in run(context, inputs(format="poses")).files}
    assert {"poses.csv", "poses.json", "S1.txt", "scan001.pose", "project.pop.dat", "S_2__b_.sop.dat"} <= names
    document = json.loads(download(context, "poses.json").read_bytes())
    assert document["stations"][0]["world_from_scan"]["covariance"] == COVARIANCE.tolist()


def test_coordinates_that_are_the_world_s_stay_where_they_are(context: StepContext) -> None:
    given = inputs(format="ply")
    given["stations"][0]["world_from_scan"] = None
    file = run(context, given).files[0]
    found = read_scan(download(context, file.name), file.name)
    assert np.abs(found.points + found.origin_m - SCANS["S1"].points).max() < 1e-9


@pytest.mark.parametrize(
    ("more", "pointer", "words"),
    [
        ({"crs": "EPSG:4326"}, "/crs", "no plane coordinates"),
        ({"crs": "EPSG:2263"}, "/crs", "US survey foot"),
        ({"crs": "Gauß-Krüger irgendwo"}, "/crs", "PROJ knows"),
        ({"format": "doc"}, "/format", "e57"),
        ({"range_std_m": -1.0}, "/range_std_m", "0"),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(more: Json, pointer: str, words: str) -> None:
    with pytest.raises(InvalidRequestError) as refused:
        inputs(**more)
    (fault,) = refused.value.faults
    assert fault.pointer.endswith(pointer)
    assert words in fault.detail


def test_without_a_covariance_no_standard_deviations_are_made_up(context: StepContext) -> None:
    given = inputs(format="laz", per_point_std=True)
    given["stations"][1]["world_from_scan"]["covariance"] = None
    with pytest.raises(InvalidRequestError, match=r"covariance of the pose of 'S 2 \(b\)'"):
        run(context, given)


def test_names_of_files_are_plain_and_distinct() -> None:
    assert distinct_stems(["S 1", "S_1", "s_1", "..", "Küche"]) == ["S_1", "S_1-2", "s_1-3", "scan", "K_che"]
