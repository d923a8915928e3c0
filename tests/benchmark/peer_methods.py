"""Registration of two scans without a first guess: public programs with the settings of their authors, and Tieline.

Runs in a process of its own (`peer_child.py`) without pytest, so that nothing but the method is measured.
"""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

VOXELS_PER_DIAGONAL = 200
"""The finest of the three voxel sizes is the diagonal of the scans over this number, each other one twice the last."""
FINEST_M, COARSEST_M = 0.05, 1.0
KISS_LEAST_INLIERS = 5
"""Final inliers below which the examples of KISS-Matcher's authors say that the registration may have failed."""


@dataclass(frozen=True)
class Answer:
    """What a method says of one pair, and what that took."""

    matrix: list[list[float]] | None
    """(4, 4) target from source; None: the method gives no pose."""
    good: bool
    """Whether the method itself finds nothing wrong with its pose."""
    status: str
    """Its own words."""
    wall_s: float
    cpu_s: float
    all_wall_s: float
    """With the voxel sizes that were tried and not taken."""
    all_cpu_s: float


@dataclass(frozen=True)
class Trial:
    """A peer's pose with one voxel size."""

    matrix: np.ndarray
    good: bool
    status: str
    wall_s: float
    cpu_s: float


Register = Callable[[np.ndarray, np.ndarray, float, float], tuple[np.ndarray, bool, str]]
"""Register target and source points (n, 3) with a voxel size and the finest one [m]: pose, own verdict, own words."""
Fitness = Callable[[np.ndarray, np.ndarray, np.ndarray, float], float]
"""Share of the source that has a neighbour in the target, for a pose and a distance [m]."""


def voxel_sizes_m(*clouds: np.ndarray) -> list[float]:
    """Give three sizes from the scans' extent (2 to 98 % of the points along their principal axes)."""
    diagonals = []
    for points in clouds:
        centred = points - points.mean(axis=0)
        axes = np.linalg.eigh(centred.T @ centred)[1]
        low, high = np.quantile(centred @ axes, [0.02, 0.98], axis=0)
        diagonals.append(float(np.linalg.norm(high - low)))
    finest = max(float(np.mean(diagonals)) / VOXELS_PER_DIAGONAL, FINEST_M)
    return [min(finest * factor, COARSEST_M) for factor in (1.0, 2.0, 4.0)]


def best_of_three(register: Register, fitness: Fitness, target_file: Path, source_file: Path) -> Answer:
    """Register with three voxel sizes and take the pose of the best fitness, all judged at the finest size.

    Only reading and the size that was taken count as the peer's time, as if its user had known which one to choose.
    """
    clocks = time.perf_counter(), time.process_time()
    target, source = np.load(target_file.with_suffix(".npy")), np.load(source_file.with_suffix(".npy"))
    reading = time.perf_counter() - clocks[0], time.process_time() - clocks[1]
    sizes = voxel_sizes_m(target, source)
    trials = []
    for voxel in sizes:
        begun = time.perf_counter(), time.process_time()
        matrix, good, status = register(target, source, voxel, sizes[0])
        taken = time.perf_counter() - begun[0], time.process_time() - begun[1]
        trials.append(Trial(matrix, good, f"{status}, voxel {voxel:.2f} m", *taken))
    scores = [fitness(target, source, trial.matrix, sizes[0]) for trial in trials]
    best = trials[int(np.argmax(scores))]
    return Answer(
        best.matrix.tolist(),
        best.good,
        f"{best.status}, fitness {max(scores):.2f}",
        reading[0] + best.wall_s,
        reading[1] + best.cpu_s,
        time.perf_counter() - clocks[0],
        time.process_time() - clocks[1],
    )


@cache
def open3d():
    """Import Open3D where the machine has no libusb of its own."""
    from algorithms.scans.open3d_loading import import_open3d

    return import_open3d()


def open3d_cloud(points: np.ndarray):
    return open3d().geometry.PointCloud(open3d().utility.Vector3dVector(points))


def open3d_thinned(points: np.ndarray, voxel: float):
    """Thin, estimate normals and FPFH features as Open3D's tutorial on global registration does."""
    search = open3d().geometry.KDTreeSearchParamHybrid
    cloud = open3d_cloud(points).voxel_down_sample(voxel)
    cloud.estimate_normals(search(radius=2.0 * voxel, max_nn=30))
    features = open3d().pipelines.registration.compute_fpfh_feature(cloud, search(radius=5.0 * voxel, max_nn=100))
    return cloud, features


def open3d_refined(target: np.ndarray, source: np.ndarray, thinned: tuple, start: np.ndarray, sizes: tuple):
    """Refine by point-to-plane ICP on all points within 0.4 voxels, as the same tutorial does, and more.

    Before it goes one on the thinned points within 1.5 voxels, the tolerance of the search, because the fine one often
    stops where it starts; after it one within 0.2 of the finest voxels, which makes errors two to five times smaller.
    """
    registration = open3d().pipelines.registration
    voxel, finest = sizes
    full = open3d_cloud(target)
    full.estimate_normals(open3d().geometry.KDTreeSearchParamHybrid(radius=2.0 * finest, max_nn=30))
    whole = (full, open3d_cloud(source))
    for (onto, moved), distance in ((thinned, 1.5 * voxel), (whole, 0.4 * voxel), (whole, 0.2 * finest)):
        result = registration.registration_icp(
            moved, onto, distance, start, registration.TransformationEstimationPointToPlane()
        )
        start = result.transformation
    return result


def open3d_ransac(target: np.ndarray, source: np.ndarray, voxel: float, finest: float):
    registration = open3d().pipelines.registration
    open3d().utility.random.seed(0)
    (thin_target, target_features), (thin_source, source_features) = (
        open3d_thinned(points, voxel) for points in (target, source)
    )
    found = registration.registration_ransac_based_on_feature_matching(
        thin_source,
        thin_target,
        source_features,
        target_features,
        True,
        1.5 * voxel,
        registration.TransformationEstimationPointToPoint(False),
        3,
        [
            registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
            registration.CorrespondenceCheckerBasedOnDistance(1.5 * voxel),
        ],
        registration.RANSACConvergenceCriteria(100_000, 0.999),
    )
    return open3d_answer(
        open3d_refined(target, source, (thin_target, thin_source), found.transformation, (voxel, finest))
    )


def open3d_fgr(target: np.ndarray, source: np.ndarray, voxel: float, finest: float):
    registration = open3d().pipelines.registration
    open3d().utility.random.seed(0)
    (thin_target, target_features), (thin_source, source_features) = (
        open3d_thinned(points, voxel) for points in (target, source)
    )
    found = registration.registration_fgr_based_on_feature_matching(
        thin_source,
        thin_target,
        source_features,
        target_features,
        registration.FastGlobalRegistrationOption(maximum_correspondence_distance=0.5 * voxel),
    )
    return open3d_answer(
        open3d_refined(target, source, (thin_target, thin_source), found.transformation, (voxel, finest))
    )


def open3d_answer(result):
    """Open3D has no verdict: what fits somewhere counts as good."""
    return np.array(result.transformation), result.fitness > 0.0, f"icp fitness {result.fitness:.2f}"


def open3d_fitness(target: np.ndarray, source: np.ndarray, matrix: np.ndarray, voxel: float) -> float:
    clouds = [open3d_cloud(points).voxel_down_sample(voxel) for points in (source, target)]
    return float(open3d().pipelines.registration.evaluate_registration(*clouds, voxel, matrix).fitness)


def gicp(target: np.ndarray, source: np.ndarray, voxel: float, start: np.ndarray, distance: float):
    """Align by small_gicp on all processors with its own criteria of convergence."""
    import small_gicp

    result = small_gicp.align(
        target,
        source,
        init_T_target_source=start,
        registration_type="GICP",
        downsampling_resolution=voxel,
        max_correspondence_distance=distance,
        num_threads=processors(),
    )
    # It calls converged, too, what has not a single correspondence.
    good = bool(result.converged) and result.num_inliers > 0
    return np.array(result.T_target_source), good, f"gicp {result.num_inliers} inliers"


def gicp_from_identity(target: np.ndarray, source: np.ndarray, voxel: float, finest: float):  # noqa: ARG001
    """Align without a start, with correspondences within four voxels as by default."""
    return gicp(target, source, voxel, np.eye(4), 4.0 * voxel)


def kiss_gicp(target: np.ndarray, source: np.ndarray, voxel: float, finest: float):
    """Find a start by KISS-Matcher and refine it by GICP, twice.

    First as by default, then with a quarter of the finest voxels and correspondences within half of them: the default
    alone leaves errors ten times as large.
    """
    import kiss_matcher

    matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(voxel))
    found = matcher.estimate(source, target)
    start = np.eye(4)
    start[:3, :3], start[:3, 3] = np.array(found.rotation), np.array(found.translation).ravel()
    inliers = matcher.get_num_final_inliers()
    near, _, _ = gicp(target, source, voxel, start, 4.0 * voxel)
    matrix, converged, status = gicp(target, source, 0.25 * finest, near, 0.5 * finest)
    return matrix, bool(found.valid) and inliers >= KISS_LEAST_INLIERS and converged, f"{inliers} inliers, {status}"


def gicp_fitness(target: np.ndarray, source: np.ndarray, matrix: np.ndarray, voxel: float) -> float:
    import small_gicp

    thin_target, thin_source = (small_gicp.voxelgrid_sampling(points, voxel).points() for points in (target, source))
    tree = small_gicp.KdTree(np.ascontiguousarray(thin_target[:, :3]))
    moved = thin_source[:, :3] @ matrix[:3, :3].T + matrix[:3, 3]
    squares = np.asarray(tree.batch_nearest_neighbor_search(moved, processors())[1])
    return float(np.mean(squares <= voxel**2))


def processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def tieline_features(file: Path):
    """Read a scan and extract its features as the service does; features, wall and processor time [s]."""
    from algorithms.features.extraction import extract_features
    from algorithms.progress import NoProgress
    from service.formats import read_scan
    from service.use_cases.steps.run_features import SEED

    begun = time.perf_counter(), time.process_time()
    path = file.with_suffix(".ply")
    scan = read_scan(path, path.name)
    options = tieline_method().features
    features = extract_features(scan, options, progress=NoProgress(), rng=np.random.default_rng(SEED))
    return features, time.perf_counter() - begun[0], time.process_time() - begun[1]


@cache
def tieline_method():
    """Choose what a request with `auto` gets."""
    from service.use_cases.steps.run_pair import method_of

    return method_of({"method": "auto"})


def tieline(target_file: Path, source_file: Path) -> Answer:
    """Read, extract and register; a pair pays for the features of both scans, though they are extracted once."""
    from algorithms.progress import NoProgress
    from algorithms.registration.base import PairStatus, RegistrationProblem

    (target, *target_s), (source, *source_s) = (tieline_features(file) for file in (target_file, source_file))
    begun = time.perf_counter(), time.process_time()
    problem = RegistrationProblem(target, source)
    result = tieline_method().register(problem, progress=NoProgress())
    wall = time.perf_counter() - begun[0] + target_s[0] + source_s[0]
    cpu = time.process_time() - begun[1] + target_s[1] + source_s[1]
    matrix = None if result.final is None else result.final.pose.target_from_source.as_matrix().tolist()
    words = f"{result.status.value}: {result.reasons[-1] if result.reasons else ''}"
    return Answer(matrix, result.status is PairStatus.ACCEPTED, words, wall, cpu, wall, cpu)


METHODS: dict[str, Callable[[Path, Path], Answer]] = {
    "open3d-ransac": lambda target, source: best_of_three(open3d_ransac, open3d_fitness, target, source),
    "open3d-fgr": lambda target, source: best_of_three(open3d_fgr, open3d_fitness, target, source),
    "kiss+gicp": lambda target, source: best_of_three(kiss_gicp, gicp_fitness, target, source),
    "gicp": lambda target, source: best_of_three(gicp_from_identity, gicp_fitness, target, source),
    "tieline": tieline,
}
"""Every method by its name in the tables; target and source are paths without suffix."""
