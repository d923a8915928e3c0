"""From how far each method comes back to the right pose, ours beside Open3D's and small_gicp. Run with -m benchmark -s.

Every method gets the same points, starts and cells, and one thread. `TIELINE_BASIN_SETS` chooses the sets, by commas.
Needs the group `bench` of the project's dependencies for small_gicp, which is left out where it is not there.
"""

import importlib.util
import json
import os
import time

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.closest_points.d2_tree import D2Tree
from algorithms.closest_points.iteration import ErrorKind, IterationLimits, iterated
from algorithms.closest_points.surface_model import SurfaceModel
from algorithms.distributions.cell_registration import match_cells, starts_around
from algorithms.distributions.layer_registration import cell_sizes
from algorithms.errors import TooFewCorrespondencesError
from algorithms.registration.ndt_3d import CellOptions
from algorithms.scans.open3d_loading import import_open3d, missing_for_open3d
from tests.benchmark.peer_sets import DATA

if (missing := missing_for_open3d()) is not None:
    pytest.skip(str(missing), allow_module_level=True)
o3d = import_open3d()

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(3600)]
SETS = {"eth_facade": ("s0", "s2"), "garage_a": ("scan000", "scan001")}
CHOSEN = os.environ.get("TIELINE_BASIN_SETS", ",".join(SETS)).split(",")
THINNED_M, CELL_M, REACH_M = 0.15, 1.0, 1.0
"""Voxels of all clouds, cells of all NDT, and the farthest pairs of all ICP (the default of small_gicp)."""
SHIFTS_M, TURNS_DEG = (0.5, 1.0, 2.0, 4.0, 8.0), (5.0, 10.0, 20.0, 40.0)
DIRECTIONS = 4
RIGHT_M, RIGHT_DEG = 0.15, 0.5
LEAST_BACK = 3
"""Of the directions, for a distance to count as one from which a method comes back."""
OPTIONS = CellOptions()


class Pair:
    """Two clouds and their true pose."""

    def __init__(self, name):
        target, source = SETS[name]
        self.target, self.source = (self._cloud(name, each) for each in (target, source))
        poses = json.loads((DATA / name / "poses.json").read_text())
        first, second = (RigidTransform.from_matrix(np.array(poses[each])) for each in (target, source))
        self.truth = first.inv() * second
        self.surface = SurfaceModel.of(np.asarray(self.target.points), np.asarray(self.target.normals))
        self.points, self.normals = np.asarray(self.source.points), np.asarray(self.source.normals)

    @staticmethod
    def _cloud(name, scan):
        cloud = o3d.io.read_point_cloud(DATA / name / f"{scan}.ply").voxel_down_sample(THINNED_M)
        cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=4.0 * THINNED_M, max_nn=30))
        # towards the instrument, in the origin
        cloud.orient_normals_towards_camera_location(np.zeros(3))
        return cloud


def closest(kind, *, tree=False):
    def register(pair, start):
        limits = IterationLimits(REACH_M, 0.8, 100, 1e-5)
        pairing = D2Tree(pair.surface, 0.05, REACH_M) if tree else None
        try:
            return iterated(pair.surface, pair.points, pair.normals, start, kind, limits, pairing).pose
        except TooFewCorrespondencesError:
            return start

    return register


def ndt_3d(pair, start):
    sizes = cell_sizes(OPTIONS.coarsest_cell_m, OPTIONS.finest_cell_m, OPTIONS.steps)
    middle = start.apply(pair.points.mean(axis=0))
    starts = starts_around(start, middle, OPTIONS.beside_rad, OPTIONS.beside_m)
    return match_cells(pair.surface.points, pair.points, sizes, starts)[0].pose


def ndt_3d_one_start(pair, start):
    sizes = cell_sizes(OPTIONS.coarsest_cell_m, CELL_M, 4)
    return match_cells(pair.surface.points, pair.points, sizes, [start])[0].pose


def ndt_3d_one_size(pair, start):
    return match_cells(pair.surface.points, pair.points, [CELL_M], [start])[0].pose


def open3d_ndt(pair, start):
    registration = o3d.pipelines.registration
    option = registration.NormalDistributionsTransformOption(voxel_size=CELL_M)
    found = registration.registration_ndt(pair.source, pair.target, option, start.as_matrix())
    return RigidTransform.from_matrix(np.array(found.transformation))


def open3d_plane(pair, start):
    registration = o3d.pipelines.registration
    found = registration.registration_icp(
        pair.source, pair.target, REACH_M, start.as_matrix(), registration.TransformationEstimationPointToPlane(),
        registration.ICPConvergenceCriteria(max_iteration=100),
    )  # fmt: skip
    return RigidTransform.from_matrix(np.array(found.transformation))


def small_gicp(pair, start):
    import small_gicp as peer

    found = peer.align(
        pair.surface.points, pair.points, start.as_matrix(), registration_type="GICP",
        downsampling_resolution=THINNED_M, max_correspondence_distance=REACH_M, num_threads=1, max_iterations=100,
    )  # fmt: skip
    return RigidTransform.from_matrix(np.array(found.T_target_source))


METHODS = {
    "ndt-3d": ndt_3d,
    "ndt-3d, one start": ndt_3d_one_start,
    "ndt-3d, one size": ndt_3d_one_size,
    "icp-point": closest(ErrorKind.POINT),
    "icp-plane": closest(ErrorKind.PLANE),
    "icp-d2": closest(ErrorKind.D2, tree=True),
    "Open3D NDT": open3d_ndt,
    "Open3D point to plane": open3d_plane,
    **({"small_gicp": small_gicp} if importlib.util.find_spec("small_gicp") else {}),
}


def displaced(pair, shift_m, turn_deg, rng):
    """Give the true pose, shifted, and turned about the middle of the source."""
    direction, axis = (each / np.linalg.norm(each) for each in rng.normal(size=(2, 3)))
    middle = pair.truth.apply(pair.points.mean(axis=0))
    turn = Rotation.from_rotvec(np.radians(turn_deg) * axis)
    moved = RigidTransform.from_components(middle - turn.apply(middle) + shift_m * direction, turn)
    return moved * pair.truth


def is_right(pair, pose):
    middle = pair.points.mean(axis=0)
    turn = np.degrees((pose.rotation * pair.truth.rotation.inv()).magnitude())
    return turn < RIGHT_DEG and np.linalg.norm(pose.apply(middle) - pair.truth.apply(middle)) < RIGHT_M


def farthest(back, distances):
    """Give the distance up to which all smaller ones are come back from as well."""
    reached = 0.0
    for distance in distances:
        if back[distance] < LEAST_BACK:
            break
        reached = distance
    return reached


@pytest.mark.parametrize("name", CHOSEN)
def test_how_far_each_method_comes_back_from(name):
    pair = Pair(name)
    cases = [("shift", s) for s in SHIFTS_M] + [("turn", t) for t in TURNS_DEG]
    starts = [
        (kind, size, displaced(pair, size * (kind == "shift"), size * (kind == "turn"), np.random.default_rng(k)))
        for kind, size in cases
        for k in range(DIRECTIONS)
    ]
    print(f"\n{name}: {len(pair.surface.points)} and {len(pair.points)} points; came back of {DIRECTIONS} starts each")
    print(f"{'':>22}" + "".join(f"{s:5g} m" for s in SHIFTS_M) + "".join(f"{t:5g} °" for t in TURNS_DEG) + "   s/start")
    reached, seconds = {}, {}
    for method, register in METHODS.items():
        register(pair, pair.truth)  # compiled, and its trees built
        back = dict.fromkeys(cases, 0)
        begun = time.process_time()
        for kind, size, start in starts:
            back[kind, size] += is_right(pair, register(pair, start))
        seconds[method] = (time.process_time() - begun) / len(starts)
        counts = "".join(f"{count:7d}" for count in back.values())
        print(f"{method:>22}{counts}   {seconds[method]:7.2f}", flush=True)
        reached[method] = farthest({s: back["shift", s] for s in SHIFTS_M}, SHIFTS_M)
    print("back from at least, in shift [m]: " + ", ".join(f"{method} {far:g}" for method, far in reached.items()))
    ratio = seconds["ndt-3d, one size"] / seconds["Open3D NDT"]
    print(f"ndt-3d in one size of cells takes {ratio:.1f} times as long as Open3D's NDT in the same cells")
    assert reached["ndt-3d"] >= 2.0 * reached.get("small_gicp", 0.0)
