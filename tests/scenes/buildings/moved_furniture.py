"""Two stations in an office, and one piece of furniture or a door leaf that was moved by 5 cm between the scans."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.scan_features import ScanFeatures
from algorithms.progress import NoProgress
from algorithms.registration.base import PairResult, RegistrationProblem
from algorithms.registration.lines import LinesMethod
from algorithms.simulation import office
from algorithms.simulation.materials import WOOD
from algorithms.simulation.parts import Part, box, moved
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scene import scene_from_parts
from algorithms.simulation.stations import station_pose

SCANNER = VirtualScanner(rows=300, columns=720, mixed_pixels=False)
NEAR_M = 0.02
"""A plane whose centroid lies this near to a piece's box belongs to it."""
MOVED_M = 0.02
"""A face is wrong that moved by more than this along its normal; a table top moved sideways is as good as before."""
SAME_M = 0.005
"""A pair is good whose planes agree to this in the true pose."""


@dataclass(frozen=True)
class Move:
    """What was moved, and where the scanner stood."""

    corner_m: tuple[float, float, float]
    """Lowest corner of the piece."""
    shift_m: tuple[float, float, float]
    target: RigidTransform
    source: RigidTransform


def _station(x: float, y: float, heading_deg: float, tilts_deg: tuple[float, float] = (0.5, -0.8)) -> RigidTransform:
    heading, tilt_x, tilt_y = np.deg2rad([heading_deg, *tilts_deg])
    return station_pose((x, y, 1.6), float(heading), float(tilt_x), float(tilt_y))


DOOR_LEAF = box((9.50, 5.36, 0.02), (10.40, 5.40, 2.03), WOOD)
"""Of the door between corridor and east room, opened to 90 degrees."""

MOVES: Mapping[str, Move] = MappingProxyType(
    {
        "cupboard in the east room": Move(
            (9.47, 0.6, 0.0), (0.05, 0.0, 0.0), _station(10.9, 4.4, 48.0), _station(12.3, 3.2, 200.0, (-0.6, 0.4))
        ),
        "door leaf": Move(
            (9.50, 5.36, 0.02), (0.0, -0.05, 0.0), _station(10.9, 4.4, 48.0), _station(12.3, 3.2, 200.0, (-0.6, 0.4))
        ),
        "wall cupboard in the kitchen": Move(
            (5.27, 8.25, 1.5), (0.0, -0.05, 0.0), _station(7.0, 7.0, 30.0, (1.0, 0.0)), _station(8.6, 6.6, 120.0)
        ),
        "fridge": Move(
            (8.7, 7.95, 0.0), (-0.035, -0.035, 0.0), _station(7.0, 7.0, 30.0, (1.0, 0.0)), _station(8.0, 6.3, 120.0)
        ),
        "sideboard in the corridor": Move(
            (3.0, 4.27, 0.0), (0.0, 0.05, 0.0), _station(2.2, 4.95, 95.0, (0.1, 1.2)), _station(5.5, 4.95, 15.0)
        ),
        "wardrobe in the south-west room": Move(
            (3.45, 0.2, 0.0), (-0.05, 0.0, 0.0), _station(2.0, 2.8, 95.0, (0.1, 1.2)), _station(1.0, 1.5, 15.0)
        ),
    }
)
"""Pieces with at least one face that both stations see."""


@dataclass(frozen=True, eq=False)
class MovedFurniture:
    """Features of both scans, and which planes belong to faces that moved."""

    target: ScanFeatures
    source: ScanFeatures
    target_moved: np.ndarray
    """(p,) True for planes of moved faces."""
    source_moved: np.ndarray
    pose: RigidTransform
    """True target_from_source."""


@dataclass(frozen=True)
class Outcome:
    """What the registration made of the moved piece."""

    named_planes: int
    """Moved planes that the report names as removed."""
    wrong: int
    """Matched lines and planes of moved faces."""
    wrong_used: int
    """Those of them that still take part in the end."""
    good: int
    """Matched planes that agree in the true pose, and edges of such."""
    good_removed: int


def simulate(name: str, seed: int, *, range_noise_m: float = 0.002) -> MovedFurniture:
    """Scan the office before and after the move, and extract the features."""
    move, rng = MOVES[name], np.random.default_rng(seed)
    scanner = VirtualScanner(
        rows=SCANNER.rows, columns=SCANNER.columns, mixed_pixels=False, range_noise_std_m=range_noise_m
    )
    before = [*office._outer_walls(), *office._partitions(), *office._furniture(), DOOR_LEAF]
    piece = next(k for k, part in enumerate(before) if np.allclose(part.vertices.min(axis=0), move.corner_m))
    after = list(before)
    after[piece] = moved([before[piece]], RigidTransform.from_translation(np.array(move.shift_m)))[0]
    features, flags = [], []
    for parts, station in ((before, move.target), (after, move.source)):
        scan = scan_scene(scene_from_parts("office", parts, []), station, scanner, rng)
        features.append(extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=rng))
        flags.append(_of_moved_faces(features[-1], parts[piece], station, np.array(move.shift_m)))
    return MovedFurniture(features[0], features[1], flags[0], flags[1], move.target.inv() * move.source)


def register(furniture: MovedFurniture) -> PairResult:
    """Register as the service does."""
    problem = RegistrationProblem(furniture.target, furniture.source)
    return LinesMethod().register(problem, progress=NoProgress())


def outcome_of(furniture: MovedFurniture, result: PairResult) -> Outcome:
    """Compare what was removed with what was moved."""
    assert result.fine is not None
    fine, adjustment = result.fine, result.fine.adjustment
    plane_wrong = furniture.target_moved[fine.planes[:, 0]] | furniture.source_moved[fine.planes[:, 1]]
    edge = (furniture.target.lines.sources[fine.lines[:, 0]] == 0) & (fine.lines[:, 0] >= 0)
    target_parents = furniture.target.lines.parents[fine.lines[:, 0]]
    source_parents = furniture.source.lines.parents[fine.lines[:, 1]]
    line_wrong = edge & (
        furniture.target_moved[target_parents].any(axis=1) | furniture.source_moved[source_parents].any(axis=1)
    )
    plane_good = ~plane_wrong & (_gaps(furniture, fine.planes) < SAME_M)
    parents_agree = np.ones(len(fine.lines), dtype=bool)
    for k in (0, 1):
        # the parents come in any order: one of the two ways round agrees
        straight = _gaps(furniture, np.stack([target_parents[:, k], source_parents[:, k]], axis=1))
        crossed = _gaps(furniture, np.stack([target_parents[:, k], source_parents[:, 1 - k]], axis=1))
        parents_agree &= np.minimum(straight, crossed) < SAME_M
    line_good = ~line_wrong & edge & parents_agree
    removed_lines = adjustment.lines.states == CorrespondenceState.REMOVED
    removed_planes = adjustment.planes.states == CorrespondenceState.REMOVED
    named = {(r.target_number, r.source_number) for r in adjustment.removals if r.kind == "plane"}
    moved_pairs = {(int(i), int(j)) for i, j in fine.planes[plane_wrong]}
    return Outcome(
        named_planes=len(named & moved_pairs),
        wrong=int(plane_wrong.sum() + line_wrong.sum()),
        wrong_used=int((plane_wrong & ~removed_planes).sum() + (line_wrong & ~removed_lines).sum()),
        good=int(plane_good.sum() + line_good.sum()),
        good_removed=int((plane_good & removed_planes).sum() + (line_good & removed_lines).sum()),
    )


def _of_moved_faces(features: ScanFeatures, piece: Part, station: RigidTransform, shift_m: np.ndarray) -> np.ndarray:
    """Say which planes lie on the piece and look along the shift."""
    centroids = station.apply(features.planes.centroids)
    low, high = piece.vertices.min(axis=0) - NEAR_M, piece.vertices.max(axis=0) + NEAR_M
    along = np.abs(station.rotation.apply(features.planes.normals) @ shift_m)
    return np.asarray(((centroids > low) & (centroids < high)).all(axis=1) & (along > MOVED_M))


def _gaps(furniture: MovedFurniture, pairs: np.ndarray) -> np.ndarray:
    """Give the distances of planes in the true pose, at the source's centroid [m]; turned planes lie far apart."""
    target, source = furniture.target.planes, furniture.source.planes
    centroids = furniture.pose.apply(source.centroids[pairs[:, 1]])
    normals = target.normals[pairs[:, 0]]
    cosines = np.einsum("ij,ij->i", furniture.pose.rotation.apply(source.normals[pairs[:, 1]]), normals)
    gaps = np.abs(np.einsum("ij,ij->i", centroids - target.centroids[pairs[:, 0]], normals))
    return np.where(cosines > np.cos(0.02), gaps, np.inf)
