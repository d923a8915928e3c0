"""Pairs of scans for the comparison with other programs: open data and simulated scenes, every scan moved at random."""

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.scans.scan import Scan
from algorithms.simulation.ray_casting import RayCaster
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scene import Scene
from algorithms.simulation.scenes import SCENES
from algorithms.simulation.symmetric_scenes import symmetric_room
from service.formats import read_scan
from service.formats.writers import write_scans

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"
TOLERANCES = {
    "lpm_apartment": (0.5, 0.03),
    "garage_a": (0.05, 0.01),
    "eth_facade": (0.1, 0.02),
    "hall_a": (0.6, 0.1),
    "dtk_dat": (2.0, 0.2),
    "street_a": (1.0, 0.2),
}
"""Of the open sets [degree, m]: a few standard deviations of their reference poses, from their description."""
SIMULATED_TOLERANCE = (0.05, 0.01)
BUILDINGS = ("office", "house", "pipe_hall", "street_square")
ODDITIES = (1, 1, 2, 2, 4, 4)
"""Pieces of furniture in each of the box rooms that break the symmetry of a half turn."""
SIMULATED = (*BUILDINGS, "box_rooms")
SETS = (*TOLERANCES, *SIMULATED)
SCANNER = VirtualScanner(rows=300, columns=720, range_noise_std_m=0.003)
LEAST_OVERLAP = 0.05
"""Simulated pairs that share less are left out."""
NEAR_M = 0.5
"""Points of two scans nearer than this, in the true pose, count as overlap."""
THINNED_M = 0.1
REACH_M = 5.0
"""Scans are shifted by up to this along each axis before they are written, beside any turn."""


@dataclass(frozen=True, eq=False)
class PeerPair:
    """Two files, and what is true of them."""

    name: str
    target: Path
    """Without suffix: `.ply` is what Tieline reads, `.npy` what the others read."""
    source: Path
    truth: RigidTransform
    """Target from source."""
    station_m: np.ndarray
    """(3,) where the instrument of the source stood, in the source's frame: errors of translation count there."""
    overlap: float
    """Share of the target's surface that the source sees too."""


@dataclass(frozen=True, eq=False)
class PeerSet:
    """Pairs that share tolerances."""

    name: str
    rotation_deg: float
    translation_m: float
    pairs: tuple[PeerPair, ...]

    def errors(self, pair: PeerPair, matrix: Sequence[Sequence[float]]) -> tuple[float, float]:
        """Give rotation [degree] and translation [m] between a pose and the truth."""
        found = np.asarray(matrix, dtype=np.float64)
        # Not every program's float matrix is a rotation to the last digit.
        turn = Rotation.from_matrix(found[:3, :3]) * pair.truth.rotation.inv()
        shift = found[:3, :3] @ pair.station_m + found[:3, 3] - pair.truth.apply(pair.station_m)
        return float(np.degrees(turn.magnitude())), float(np.linalg.norm(shift))

    def is_right(self, errors: tuple[float, float]) -> bool:
        """Tell whether errors are within the tolerances."""
        return errors[0] <= self.rotation_deg and errors[1] <= self.translation_m


def chosen_sets() -> list[str]:
    """Give the names of TIELINE_PEER_SETS (comma between them), all by default."""
    return [name for name in os.environ.get("TIELINE_PEER_SETS", ",".join(SETS)).split(",") if name]


def build_set(name: str, folder: Path, seed: int, most_pairs: int | None) -> PeerSet:
    """Read or simulate the scans of a set, move each at random, write them, and list the pairs.

    Parameters
    ----------
    name
        Of the set.
    folder
        Where the files go.
    seed
        Of the motions, and of the simulation.
    most_pairs
        So many pairs at most, evenly chosen by overlap; None: all.
    """
    rng = np.random.default_rng([seed, *name.encode()])
    builder = _real if name in TOLERANCES else _box_rooms if name == "box_rooms" else _building
    pairs = sorted(builder(name, folder, rng), key=lambda pair: -pair.overlap)
    if most_pairs is not None and most_pairs < len(pairs):
        pairs = [pairs[k] for k in np.unique(np.linspace(0, len(pairs) - 1, most_pairs).round().astype(int))]
    return PeerSet(name, *TOLERANCES.get(name, SIMULATED_TOLERANCE), tuple(pairs))


def write_moved(scan: Scan, path: Path, rng: np.random.Generator) -> RigidTransform:
    """Turn and shift a scan at random and write it for all programs; give the motion, moved from scan."""
    motion = RigidTransform.from_components(rng.uniform(-REACH_M, REACH_M, 3), Rotation.random(rng=rng))
    points = np.ascontiguousarray(motion.apply(scan.points + scan.origin_m))
    cloud = replace(scan, points=points, origin_m=np.zeros(3), sensor_m=None, grid=None, world_from_scan=None)
    write_scans(path.with_suffix(".ply"), [cloud])
    np.save(path.with_suffix(".npy"), points)
    return motion


def _thinned(points: np.ndarray) -> np.ndarray:
    cells = np.floor(points / THINNED_M).astype(np.int64)
    return np.ascontiguousarray(points[np.unique(cells, axis=0, return_index=True)[1]])


def _real(name: str, folder: Path, rng: np.random.Generator) -> list[PeerPair]:
    poses = {
        scan: RigidTransform.from_matrix(np.array(matrix))
        for scan, matrix in json.loads((DATA / name / "poses.json").read_text()).items()
    }
    motions, clouds = {}, {}
    for scan in sorted(poses):
        path = DATA / name / f"{scan}.ply"
        read = read_scan(path, path.name)
        motions[scan] = write_moved(read, folder / scan, rng)
        clouds[scan] = _thinned(poses[scan].apply(read.points + read.origin_m))
    trees = {scan: cKDTree(cloud) for scan, cloud in clouds.items()}

    def overlap(target: str, source: str) -> float:
        return float(np.mean(trees[source].query(clouds[target], distance_upper_bound=NEAR_M)[0] <= NEAR_M))

    return [
        _pair(target, source, folder, poses, motions, overlap(target, source))
        for target, source in combinations(sorted(poses), 2)
    ]


def _pair(
    target: str,
    source: str,
    folder: Path,
    poses: dict[str, RigidTransform],
    motions: dict[str, RigidTransform],
    overlap: float,
) -> PeerPair:
    truth = motions[target] * poses[target].inv() * poses[source] * motions[source].inv()
    station = motions[source].apply(np.zeros(3))
    return PeerPair(f"{target}<-{source}", folder / target, folder / source, truth, station, overlap)


def _building(name: str, folder: Path, rng: np.random.Generator) -> list[PeerPair]:
    return _simulated_pairs(SCENES[name](), "", folder, rng)


def _box_rooms(name: str, folder: Path, rng: np.random.Generator) -> list[PeerPair]:
    return [
        pair
        for number, oddities in enumerate(ODDITIES)
        for pair in _simulated_pairs(symmetric_room(rng, oddities), f"{name}-{number}-", folder, rng)
    ]


def _simulated_pairs(scene: Scene, prefix: str, folder: Path, rng: np.random.Generator) -> list[PeerPair]:
    names = [f"{prefix}S{number}" for number in range(1, len(scene.stations) + 1)]
    poses = dict(zip(names, scene.stations, strict=True))
    motions, clouds = {}, {}
    for scan, read in zip(names, simulate_stations(scene, scene.stations, SCANNER, rng), strict=True):
        motions[scan] = write_moved(read, folder / scan, rng)
        clouds[scan] = _thinned(poses[scan].apply(read.points))
    caster = RayCaster(scene)
    overlaps = {
        (target, source): share_in_sight(caster, clouds[target], poses[source].translation)
        for target, source in combinations(names, 2)
    }
    return [
        _pair(target, source, folder, poses, motions, overlap)
        for (target, source), overlap in overlaps.items()
        if overlap >= LEAST_OVERLAP
    ]


def share_in_sight(caster: RayCaster, points: np.ndarray, eye: np.ndarray) -> float:
    """Give the share of points that nothing hides from an instrument.

    Not their distances from the other scan's points: the other side of a partition is near and not in sight.
    """
    rays = points - eye
    distances = np.linalg.norm(rays, axis=1)
    hits = caster.cast(np.asarray(eye), rays / distances[:, None])
    return float(np.mean(np.abs(hits.ranges_m - distances) < 0.03))
