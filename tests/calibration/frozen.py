"""Freeze what drawn pairs show in the poses that are found.

``python -m tests.calibration.frozen FOLDER FAMILY FIRST LAST`` freezes draws of a family.
Each draw becomes one file in the folder, so that a run goes on where it stopped; `--pack FOLDER` makes one archive of
them all, from which the model of the evidence is fitted in seconds, without scanning (`fit`). `--real FOLDER SET`
freezes pairs of an open set (with ``PYTHONPATH=tests/benchmark``); `--pack FOLDER real_scans.npz` packs them.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest import mock

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array
from algorithms.errors import AlgorithmError
from algorithms.evidence.pose_evidence import PairEvidence
from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.scan_features import ScanFeatures
from algorithms.matching import coarse_registration
from algorithms.matching.candidates import candidate_motions
from algorithms.matching.coarse_registration import CoarseRegistration, with_all_shifts, with_symmetries
from algorithms.matching.degeneracy import require_determining_geometry
from algorithms.matching.directions import comes_first
from algorithms.matching.feature_fit import GATES, common_features, feature_pose_near
from algorithms.matching.hypotheses import RankedPoses, rank_hypotheses
from algorithms.matching.line_evidence import LineWitness
from algorithms.matching.options import MatchingOptions
from algorithms.matching.plane_triples import OffsetVotes
from algorithms.matching.votes import Motions
from algorithms.progress import NoProgress
from algorithms.quality.acceptance import AcceptanceStatus, Verdict
from algorithms.quality.overlap import verify_pose
from algorithms.registration import DEFAULT_METHOD, final_verdict
from algorithms.registration import verdict as registration_verdict
from algorithms.registration.base import FinalPose, PairStatus, RegistrationProblem
from algorithms.scans.surface_index import SurfaceIndex
from service.formats import read_scan
from tests.calibration.drawn_pairs import DrawnPair, drawn_pairs

ARCHIVE = Path(__file__).parent / "hypotheses.npz"
RIGHT_RAD, RIGHT_M = np.radians(0.6), 0.15
"""A pose of the search is right within this, before it is adjusted."""
ACCEPTED_RAD, ACCEPTED_M = np.radians(0.3), 0.05
"""The answer of the service is."""
NAMES = ("support", "violation", "score")


def every_pose(target: ScanFeatures, source: ScanFeatures) -> tuple[RankedPoses, RankedPoses]:
    """Propose as the search does: what lines and planes vote for, and this with all shifts and symmetries."""
    options = MatchingOptions()
    for scan, name in ((target, "target"), (source, "source")):
        require_determining_geometry(scan, name)
    noise_m = max(target.noise_std_m, source.noise_std_m)
    voted = rank_hypotheses(candidate_motions(target, source, options), target.index, source.index, noise_m=noise_m)
    return voted, with_symmetries(with_all_shifts(voted, target, source, options), target, source, options)


def frozen_pair(pair: DrawnPair) -> dict[str, Array] | None:
    """Give all that a verdict of a pair can rest on, as arrays; None where the search refuses."""
    target, source, truth = pair.target, pair.source, pair.truth
    with shifts_remembered():
        status, is_right, is_precise = registered(target, source, truth)
        if not comes_first(target, source):
            target, source, truth = source, target, None if truth is None else truth.inv()
        try:
            voted, ranked = every_pose(target, source)
        except AlgorithmError:
            return None
    scores = ranked.scores
    kept = ranked.worth_weighing()
    counted, lines = PairEvidence(target, source), LineWitness(target, source)
    poses = [ranked.poses[k] for k in kept]
    shown = [counted.of(pose) for pose in poses]
    fitted = [feature_pose_near(target, source, pose) for pose in poses]
    seen = [lines.seen_in(pose) for pose in fitted]
    angle_rad, distance_m = GATES[-1]
    first = {pose.as_matrix().tobytes() for pose in voted.poses}
    centre = source.surface.points.mean(axis=0)
    right = [truth is not None and near(pose, truth, centre, RIGHT_RAD, RIGHT_M) for pose in poses]
    common = 0.0 if truth is None else verify_pose(target, source, truth).support_share
    return {
        "family": np.array([pair.family]),
        "building": np.array([pair.building]),
        "status": np.array([status]),
        "status_right": np.array([is_right]),
        "precise": np.array([is_precise]),
        "same_place": np.array([truth is not None]),
        "common": np.array([common]),
        "free_space": np.array([target.index.knows_free_space and source.index.knows_free_space]),
        "noise_m": np.array([max(target.noise_std_m, source.noise_std_m)]),
        "pose_count": np.array([len(poses)]),
        "right": np.array(right, dtype=bool),
        "voted": np.array([pose.as_matrix().tobytes() in first for pose in poses], dtype=bool),
        "poses": np.array([pose.as_matrix()[:3] for pose in poses], dtype=np.float32).reshape(-1, 3, 4),
        **{name: np.array([getattr(scores, name)[k] for k in kept], dtype=np.float32) for name in NAMES},
        "lines": np.array([[each.expected, each.found] for each in seen], dtype=np.int32).reshape(-1, 2),
        "features": np.array(
            [
                common_features(target, source, pose, max_angle_rad=angle_rad, max_distance_m=distance_m)
                for pose in fitted
            ],
            dtype=np.int32,
        ),
        "control": np.array([each.control for each in shown], dtype=np.float32),
        "fitting_count": np.array([len(each.fitting) for each in shown], dtype=np.int32),
        "fitting": _joined([each.fitting for each in shown]),
        "against_count": np.array([len(each.through) for each in shown], dtype=np.int32),
        "through": _joined([each.through for each in shown]),
        "beside": _joined([each.beside for each in shown]),
    }


def registered(target: ScanFeatures, source: ScanFeatures, truth: RigidTransform | None) -> tuple[str, bool, bool]:
    """Give the rules' status, whether its pose is right, and whether nothing but the place would be in doubt.

    The evidence has no veto here: what it is worth is weighed beside the rules.
    """
    precise = []

    def status_of_final(
        problem: RegistrationProblem, coarse: CoarseRegistration, final: FinalPose, verdict: Verdict, **more: Any
    ) -> tuple[PairStatus, tuple[str, ...]]:
        sure = replace(coarse, ambiguous=False), final, Verdict(AcceptanceStatus.ACCEPTED, ())
        precise.append(final_verdict.status_of_final(problem, *sure, **more)[0] is PairStatus.ACCEPTED)
        return final_verdict.status_of_final(problem, coarse, final, verdict, **more)

    with (
        mock.patch.object(registration_verdict, "status_of_final", status_of_final),
        mock.patch.object(registration_verdict, "LEAST_PROBABILITY", 0.0),
        mock.patch.object(registration_verdict, "CERTAIN_PROBABILITY", 0.0),
    ):
        result = DEFAULT_METHOD().register(RegistrationProblem(target, source), progress=NoProgress())
    is_precise = bool(precise and precise[-1])
    if result.final is None or truth is None:
        return result.status.value, False, is_precise
    pose, centre = result.final.reduced.target_from_source, source.surface.points.mean(axis=0)
    return result.status.value, near(pose, truth, centre, ACCEPTED_RAD, ACCEPTED_M), is_precise


@contextmanager
def shifts_remembered() -> Iterator[None]:
    """Search all shifts of a pair once: the search in force and the freezing want the same, and it costs most."""
    search, known = coarse_registration.correlated_motions, {}

    def remembered(votes: list[OffsetVotes], target: SurfaceIndex, source: SurfaceIndex) -> Motions:
        key = (id(target), id(source), *(each.rotation.tobytes() for each in votes))
        if key not in known:
            known[key] = search(votes, target, source)
        return known[key]

    with mock.patch.object(coarse_registration, "correlated_motions", remembered):
        yield


def near(pose: RigidTransform, truth: RigidTransform, centre: Array, angle_rad: float, shift_m: float) -> bool:
    """Say whether a pose is the true one."""
    turn = (pose.rotation * truth.rotation.inv()).magnitude()
    return bool(turn < angle_rad and np.linalg.norm(pose.apply(centre) - truth.apply(centre)) < shift_m)


def _joined(parts: list[Array]) -> Array:
    return np.concatenate([np.zeros(0), *parts]).astype(np.float16)


@dataclass(frozen=True, eq=False)
class Frozen:
    """An archive: n pairs, h poses of all of them, and their pieces."""

    arrays: dict[str, Array]

    @classmethod
    def read(cls, path: Path = ARCHIVE) -> "Frozen":
        """Read an archive."""
        with np.load(path) as archive:
            return cls(dict(archive))


def pack(folder: Path, path: Path = ARCHIVE) -> None:
    """Join the files of a folder, in the order of their names, into one archive."""
    parts = [dict(np.load(each)) for each in sorted(folder.glob("*.npz"))]
    parts = [part for part in parts if part]
    common = [name for name in parts[0] if all(name in part for part in parts)]
    np.savez_compressed(path, **{name: np.concatenate([part[name] for part in parts]) for name in common})


def freeze(folder: Path, family: str, number: int) -> None:
    """Freeze the pairs of one draw, unless they are."""
    path = folder / f"{family}-{number:05d}.npz"
    if path.exists():
        return
    found = [each for each in map(frozen_pair, drawn_pairs(family, number)) if each is not None]
    joined = {name: np.concatenate([each[name] for each in found]) for name in found[0]} if found else {}
    np.savez_compressed(path, **joined)


def freeze_real(folder: Path, name: str) -> None:
    """Freeze a dozen pairs at most of an open set, evenly chosen by their overlap."""
    from peer_sets import build_set

    @cache
    def features_of(path: Path) -> ScanFeatures:
        scan = read_scan(path.with_suffix(".ply"), path.name)
        return extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))

    found = []
    with TemporaryDirectory() as scans:
        for pair in build_set(name, Path(scans), 1, 12).pairs:
            target, source = features_of(pair.target), features_of(pair.source)
            onto, back = (RigidTransform.from_translation(each) for each in (-target.origin_m, source.origin_m))
            found.append(frozen_pair(DrawnPair(f"real_{name}", pair.name, target, source, onto * pair.truth * back)))
    found = [each for each in found if each is not None]
    joined = {key: np.concatenate([each[key] for each in found]) for key in found[0]}
    np.savez_compressed(folder / f"real_{name}.npz", **joined)


if __name__ == "__main__":
    if sys.argv[1] == "--pack":
        pack(Path(sys.argv[2]), ARCHIVE.with_name(sys.argv[3]) if sys.argv[3:] else ARCHIVE)
    elif sys.argv[1] == "--real":
        freeze_real(Path(sys.argv[2]), sys.argv[3])
    else:
        place = Path(sys.argv[1])
        place.mkdir(parents=True, exist_ok=True)
        for draw in range(int(sys.argv[3]), int(sys.argv[4])):
            freeze(place, sys.argv[2], draw)
