"""A street whose scanner reads its vertical circle wrong: what the error does to poses, found from the planes alone.

Direct registrations of two scans some stations apart are laid beside the chain of the neighbours between them: with an
instrument in adjustment they agree. Run with -m benchmark -s for the figures. Registrations start at the reference,
so that the search plays no part.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.poses import PoseEstimate
from algorithms.network.instrument_calibration import InstrumentCalibration, SoughtError, calibrate_instruments
from algorithms.network.instrument_responses import ALL_ERRORS
from algorithms.network.links import StationLink
from algorithms.network.pose_graph import adjust_pose_graph
from algorithms.network.tracks import StationFeatures, build_tracks
from algorithms.progress import NoProgress
from algorithms.registration.surface_estimate import estimate_by_surfaces
from algorithms.registration.surface_options import SurfaceOptions
from algorithms.scans.instrument_errors import INSTRUMENT_ERRORS, UNITS, InstrumentError, without_errors
from algorithms.scans.scan import Scan
from service.formats import read_scan
from tests.benchmark.peer_sets import DATA
from tests.scenes.buildings.instrument_tolerances import MGON

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(3600)]

STREET = DATA / "street_a"
FARTHEST = 5
"""Stations apart of the direct registrations."""
TOLERANCES = {
    InstrumentError.VERTICAL_INDEX: 500.0 * MGON,
    InstrumentError.RANGE_OFFSET: 0.05,
    InstrumentError.RANGE_SCALE: 1e-3,
    InstrumentError.COLLIMATION: 500.0 * MGON,
    InstrumentError.TRUNNION: 500.0 * MGON,
}
"""Nobody knows the maker of this scanner: wide."""
SAME_TURN, SAME_SHIFT_M = np.cos(np.radians(2.0)), 0.15
"""Planes of two scans within these limits are one."""
PLANE_FLOOR = np.array([3e-3, 3e-3, 0.02])
"""Added to the standard deviations of planes (tilts [rad], offset [m]): facades with reliefs in steps of 17 cm are
planes to centimetres only, and two scans see different parts of them."""
PAIR_STD = np.array([2e-3, 2e-3, 2e-3, 0.03, 0.03, 0.03])
"""Of every registration, for the start of the adjustment: rotation vector [rad], translation [m]."""


def street_scans() -> list[Scan]:
    """Read the scans, whose frames are the scanner's own."""
    paths = sorted(STREET.glob("scan*.ply"))
    return [replace(scan, sensor_m=-scan.origin_m) for scan in (read_scan(path, path.name) for path in paths)]


def features_of(scans: list[Scan]) -> list[ScanFeatures]:
    rng = np.random.default_rng
    return [extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=rng(0)) for scan in scans]


def reference_poses(features: list[ScanFeatures]) -> list[RigidTransform]:
    """Give the reference between the reduced frames."""
    import json

    stored = json.loads((STREET / "poses.json").read_text())
    found = []
    for number, station in enumerate(features):
        pose = RigidTransform.from_matrix(np.array(stored[f"scan{number:03d}"]))
        found.append(pose * RigidTransform.from_translation(station.origin_m))
    return found


def common_planes(target: ScanFeatures, source: ScanFeatures, pose: RigidTransform) -> np.ndarray:
    """Pair planes that lie in one another, the nearest of each."""
    ours, theirs = target.planes, source.planes
    normals, centroids = pose.rotation.apply(theirs.normals), pose.apply(theirs.centroids)
    pairs = []
    for k in range(len(theirs)):
        apart = np.linalg.norm(ours.centroids - centroids[k], axis=1)
        across = np.abs(np.einsum("ij,ij->i", ours.normals, centroids[k] - ours.centroids))
        reach = np.sqrt(np.maximum(ours.areas_m2, theirs.areas_m2[k]))
        same = (ours.normals @ normals[k] > SAME_TURN) & (across < SAME_SHIFT_M) & (apart < reach)
        if same.any():
            pairs.append((int(np.flatnonzero(same)[np.argmin(apart[same])]), k))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def registered(features: list[ScanFeatures], starts: list[RigidTransform]) -> dict[tuple[int, int], PoseEstimate]:
    """Register neighbours by surfaces, from the reference on, and pairs farther apart from their chain on."""
    found: dict[tuple[int, int], PoseEstimate] = {}
    for apart in range(1, FARTHEST + 1):
        for i in range(len(features) - apart):
            j = i + apart
            start = starts[i].inv() * starts[j] if apart == 1 else chain_of(found, i, j)
            found[i, j] = estimate_by_surfaces(features[i], features[j], start, SurfaceOptions()).pose
    return found


def chain_of(pairs: dict[tuple[int, int], PoseEstimate], first: int, last: int) -> RigidTransform:
    """Chain the registrations of the neighbours from one station to another."""
    chain = RigidTransform.identity()
    for k in range(first, last):
        chain = chain * pairs[k, k + 1].target_from_source
    return chain


def links_of(features: list[ScanFeatures], pairs: dict[tuple[int, int], PoseEstimate]) -> list[StationLink]:
    no_lines = np.empty((0, 2), dtype=np.int64)
    found = []
    for (i, j), pose in pairs.items():
        planes = common_planes(features[i], features[j], pose.target_from_source)
        noise = max(features[i].noise_std_m, features[j].noise_std_m)
        # the wrong circle errs more than the surfaces' own noise: all pairs count alike
        weighted = PoseEstimate(pose.target_from_source, np.diag(PAIR_STD**2))
        found.append(StationLink(i, j, weighted, no_lines, planes, np.zeros(3), 10.0, noise))
    return found


def degrees(turn: RigidTransform) -> float:
    return float(np.degrees(turn.rotation.magnitude()))


def disagreements(pairs: dict[tuple[int, int], PoseEstimate]) -> dict[int, float]:
    """Give the median angle between direct registration and chain of neighbours, by stations apart [deg]."""
    found: dict[int, list[float]] = {}
    for (i, j), direct in pairs.items():
        if j - i < 2:
            continue
        found.setdefault(j - i, []).append(degrees(direct.target_from_source.inv() * chain_of(pairs, i, j)))
    return {apart: float(np.median(angles)) for apart, angles in sorted(found.items())}


def errors_against(starts: list[RigidTransform], links: list[StationLink]) -> tuple[float, float]:
    """Give the median angle [deg] and shift [m] of adjusted poses from the reference, first station held."""
    solution = adjust_pose_graph(links, range(len(starts)))
    away = [
        (starts[0].inv() * pose).inv() * solution.unknowns.poses[k] for k, pose in enumerate(starts) if k > 0
    ]  # fmt: skip
    return float(np.median([degrees(each) for each in away])), float(
        np.median([np.linalg.norm(each.translation) for each in away])
    )


def calibrated(features: list[ScanFeatures], links: list[StationLink], count: int) -> InstrumentCalibration:
    stations = {k: _with_floor(StationFeatures.of_features(each)) for k, each in enumerate(features)}
    solution = adjust_pose_graph(links, range(count))
    start = {k: solution.unknowns.poses[k] for k in range(count)}
    sought = [SoughtError(error, tuple(range(count)), TOLERANCES[error]) for error in INSTRUMENT_ERRORS]
    return calibrate_instruments(stations, build_tracks(stations, links, start), range(count), start, sought)


def _with_floor(station: StationFeatures) -> StationFeatures:
    covariances = station.planes.covariances + np.diag(PLANE_FLOOR**2)
    return replace(station, planes=replace(station.planes, covariances=covariances))


def told(result: InstrumentCalibration) -> str:
    words = []
    for found in result.errors:
        unit, factor = UNITS[found.sought.error]
        state = "significant" if found.significant else "determined" if found.determined else "not determined"
        words.append(f"{found.sought.error} {found.value * factor:.1f} ± {found.std * factor:.1f} {unit} ({state})")
    return "; ".join(words)


def test_with_the_index_taken_off_direct_registrations_agree_with_chains() -> None:
    scans = street_scans()
    features = features_of(scans)
    starts = reference_poses(features)
    pairs = registered(features, starts)
    links = links_of(features, pairs)
    before = disagreements(pairs)
    print(f"planes: {[len(each.planes) for each in features]}, common {[len(link.planes) for link in links]}")
    print(f"before: direct against chain {before} deg; from the reference {errors_against(starts, links)}")
    result = calibrated(features, links, len(scans))
    print(told(result))
    values = result.values(0)[: len(INSTRUMENT_ERRORS)]
    index = np.where(np.arange(len(values)) == ALL_ERRORS.index(InstrumentError.VERTICAL_INDEX), values, 0.0)
    mended = [replace(scan, points=without_errors(scan.points, scan.sensor_m, index)) for scan in scans]
    again = features_of(mended)
    starts = reference_poses(again)
    pairs = registered(again, starts)
    links = links_of(again, pairs)
    after = disagreements(pairs)
    print(f"after: direct against chain {after} deg; from the reference {errors_against(starts, links)}")
    print(f"what is left: {told(calibrated(again, links, len(scans)))}")
    assert sum(after.values()) < 0.5 * sum(before.values())
