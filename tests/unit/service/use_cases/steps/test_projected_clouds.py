"""Registered points in the projection of the control: files carry a system only where their points are in it."""

import json
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from pyproj import Transformer
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.progress import NoProgress
from algorithms.scans.scan import Scan
from schemas.register_inputs import RegisterInputs
from schemas.registered_output import RegisteredOptions
from service.adapters.files.local_files import LocalFiles
from service.formats import writers
from service.names.content_keys import content_key
from service.ports import Json, StepContext
from service.processes import STEPS
from service.use_cases.inputs.check_control import system_faults
from service.use_cases.steps.registered_calls import registered_calls

UTM, LONGITUDE, LATITUDE, HEIGHT_M = "EPSG:25832", 9.02, 48.75, 300.0
PROJECTED = Transformer.from_pipeline(
    f"+proj=pipeline +step +inv +proj=topocentric +ellps=GRS80 +lon_0={LONGITUDE} +lat_0={LATITUDE} +h_0={HEIGHT_M} "
    "+step +inv +proj=cart +ellps=GRS80 +step +proj=utm +zone=32 +ellps=GRS80"
)
ORIGIN = [float(each) for each in PROJECTED.transform(0.0, 0.0, 0.0)]
POSE = RigidTransform.from_components([400.0, -300.0, 5.0], Rotation.from_euler("z", 0.7))
POINTS = np.random.default_rng(3).uniform(-150.0, 150.0, (800, 3))
STATION = {"name": "A", "scan": {"file": "f", "index": 0}}
UNMET: Json = {"global_from_project": None, "system": None}
MET: Json = {"global_from_project": np.eye(4).tolist(), "system": {"origin": ORIGIN}}


@pytest.fixture
def context(tmp_path: Path) -> StepContext:
    found = StepContext(
        LocalFiles(tmp_path / "store"),
        NoProgress(),
        {"max_points": 10**6, "max_photo_pixels": 10**6, "min_free_bytes": 0},
    )
    writers.write_scans(tmp_path / "a.e57", [Scan(points=POINTS, origin_m=np.zeros(3), name="A")])
    found.blobs.put_file(content_key("a" * 64), tmp_path / "a.e57")
    return found


def written(context: StepContext, control: Json, **options: Any) -> tuple[Path, list[str]]:
    """Write the station as a registration with control would, and give the file and its notes."""
    pose = {"matrix": POSE.as_matrix().tolist(), "covariance": (1e-6 * np.eye(6)).tolist()}
    result = {"stations": [{"name": "A", "world_from_scan": pose}], "features": [], "control": control}
    context.blobs.write_bytes("jobs/j/result.json", json.dumps(result).encode())
    job: Json = {"id": "j", "inputs": {}, "files": {"f": {"name": "a.e57", "sha256": "a" * 64}}}
    wanted = RegisteredOptions(**options).model_dump(mode="json")
    held = {"control": {"crs": UTM, "geoid_undulation_m": 0.0}}
    (call,) = registered_calls(job, [STATION], {**wanted, **held}, "jobs/j/result.json")
    (file,) = STEPS[call.name](context, json.loads(json.dumps(call.arguments)))["files"]
    return context.blobs.local_path(f"jobs/j/artifacts/{file['name']}"), file["notes"]


def truth() -> np.ndarray:
    return np.column_stack(PROJECTED.transform(*POSE.apply(POINTS).T))


@pytest.mark.parametrize("cleaning", [None, {}])
def test_points_are_written_in_the_projection_one_by_one(context: StepContext, cleaning: Json | None) -> None:
    path, _ = written(context, MET, format="laz", merge=True, cleaning=cleaning)
    file = laspy.read(path)
    crs = file.header.parse_crs()
    assert crs is not None
    assert crs.to_epsg() == 25832
    # scale and curvature of the earth are what no rigid motion gives
    turned = np.array(ORIGIN) + POSE.apply(POINTS)
    assert np.abs(turned - truth()).max() > 0.05
    apart, _ = cKDTree(truth()).query(np.asarray(file.xyz))
    assert len(apart) > 0.5 * len(POINTS)
    assert apart.max() < 1e-4


def test_rigid_poses_carry_no_projection_and_say_so(context: StepContext) -> None:
    path, notes = written(context, MET, format="e57")
    assert b"25832" not in path.read_bytes()
    assert "rigid" in notes[-1]


def test_where_the_control_was_not_met_no_system_is_named(context: StepContext) -> None:
    path, notes = written(context, UNMET, format="laz", merge=True)
    assert "not met" in notes[-1]
    file = laspy.read(path)
    assert file.header.parse_crs() is None
    np.testing.assert_allclose(np.asarray(file.xyz), POSE.apply(POINTS), atol=1e-4)


CONTROL = [{"name": f"P{k}", "x": 500_000.0 + k, "y": 5_400_000.0 + k * k, "z": 300.0, "std": 0.01} for k in range(3)]


@pytest.mark.parametrize(
    ("said", "registered", "refused"),
    [
        ({"crs": UTM}, {"format": "e57", "crs": UTM}, "rigid"),
        ({"crs": UTM}, {"format": "laz", "crs": "EPSG:25833"}, UTM),
        ({"crs": UTM, "fix": "free"}, {"format": "laz", "crs": UTM}, "frame is that of a station"),
        ({"crs": UTM}, {"format": "laz", "crs": UTM}, ""),
        ({"crs": UTM}, {"format": "e57"}, ""),
        ({}, {"format": "e57", "crs": UTM}, ""),
    ],
)
def test_a_label_that_would_be_wrong_is_refused(said: Json, registered: Json, refused: str) -> None:
    stations = [{"name": name, "scan": {"file": "f"}} for name in "AB"]
    inputs = RegisterInputs.model_validate({"stations": stations, "control": CONTROL, **said})
    faults = list(system_faults(inputs, RegisteredOptions(**registered)))
    assert [fault.pointer for fault in faults] == (["/outputs/registered/crs"] if refused else [])
    assert all(refused in fault.detail for fault in faults)
