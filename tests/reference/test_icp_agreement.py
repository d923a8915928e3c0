"""Iterative closest points beside those of Open3D on neighbouring scans of a yard: the same minimum to 0.1 mm."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.closest_points.iteration import ErrorKind, IterationLimits, iterated
from algorithms.closest_points.surface_model import SurfaceModel
from algorithms.scans.open3d_loading import import_open3d, missing_for_open3d

if (missing := missing_for_open3d()) is not None:
    pytest.skip(str(missing), allow_module_level=True)
o3d = import_open3d()
DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "eth_facade"
MAX_DISTANCE_M = 0.3
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not DATA.is_dir(), reason="the shared scans of the yard are not beside the project"),
]


@cache
def cloud(name: str) -> Any:
    points = o3d.io.read_point_cloud(DATA / f"{name}.ply").voxel_down_sample(0.15)
    points.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=0.5, max_nn=30))
    return points


def start_of(target: str, source: str) -> RigidTransform:
    """Give the reference pose, some centimetres and hundredths of a radian off."""
    poses = {name: RigidTransform.from_matrix(np.array(each)) for name, each in _poses().items()}
    off = RigidTransform.from_components([0.05, -0.03, 0.02], Rotation.from_rotvec([0.002, -0.003, 0.004]))
    return off * poses[target].inv() * poses[source]


def _poses() -> dict[str, list[list[float]]]:
    poses: dict[str, list[list[float]]] = json.loads((DATA / "poses.json").read_text())
    return poses


@pytest.mark.parametrize(("target", "source"), [("s0", "s2"), ("s1", "s4")])
@pytest.mark.parametrize("kind", [ErrorKind.PLANE, ErrorKind.POINT])
def test_the_pose_is_that_of_open3d(kind: ErrorKind, target: str, source: str) -> None:
    ours, theirs = cloud(target), cloud(source)
    start = start_of(target, source)
    estimation = import_open3d().pipelines.registration
    rule = (
        estimation.TransformationEstimationPointToPlane()
        if kind is ErrorKind.PLANE
        else estimation.TransformationEstimationPointToPoint()
    )
    criteria = estimation.ICPConvergenceCriteria(1e-14, 1e-14, 1000)
    known = estimation.registration_icp(theirs, ours, MAX_DISTANCE_M, start.as_matrix(), rule, criteria).transformation
    surface = SurfaceModel.of(np.asarray(ours.points), np.asarray(ours.normals))
    limits = IterationLimits(MAX_DISTANCE_M, max_iterations=1000, least_step_m=1e-9, robust=False)
    points, normals = np.asarray(theirs.points), np.asarray(theirs.normals)
    found = iterated(surface, points, normals, start, kind, limits)
    difference = found.pose.apply(points) - RigidTransform.from_matrix(np.array(known)).apply(points)
    assert float(np.linalg.norm(difference, axis=1).max()) < 1e-4
