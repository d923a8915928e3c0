"""Starts that somebody chose for a pair, as the numerics take them and as the result tells of them."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Vector3
from algorithms.closest_points.picked_points import PickedPose, picked_pose
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.priors import PairPriors, StationPrior
from algorithms.registration.base import PairResult
from schemas.values.starts import StartDocument
from service.ports import Json
from service.use_cases.documents.pose_documents import matrix_rows


@dataclass(frozen=True, eq=False)
class Start:
    """A chosen start between two stations."""

    chosen_by: str
    reduced: PoseEstimate
    """Target from source between the reduced frames."""
    picked: PickedPose | None
    """None: a pose was chosen."""

    def priors(self, target: Json, source: Json) -> PairPriors:
        """Give what the search takes: the target's frame is the world; levelling counts as ever.

        Parameters
        ----------
        target, source
            Arguments of the step for either station: ``name`` and what is ``known`` of it.
        """
        fixed = PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))
        return PairPriors(
            StationPrior(target["name"], _levelled(target), fixed),
            StationPrior(source["name"], _levelled(source), self.reduced),
            chosen_by=self.chosen_by,
        )

    def document(self, result: PairResult, target: ScanFeatures, source: ScanFeatures) -> StartDocument:
        """Tell of it beside what came out.

        Parameters
        ----------
        result
            Of the pair.
        target, source
            Features of both scans.
        """
        full = self.reduced.moved_to_origins(target.origin_m, source.origin_m).target_from_source
        turn_gon = shift_m = None
        if (estimate := _pose_of(result)) is not None:
            turn_gon = float((estimate.rotation * full.rotation.inv()).magnitude()) * GON_PER_RAD
            points = source.surface.points
            centre = source.origin_m + (points.mean(axis=0) if len(points) else 0.0)
            shift_m = float(np.linalg.norm(estimate.apply(centre) - full.apply(centre)))
        picked = self.picked
        return StartDocument(
            chosen_by=self.chosen_by,
            how="pose" if picked is None else "picked-points",
            target_from_source=matrix_rows(full),
            residuals_m=[] if picked is None else [(float(x), float(y), float(z)) for x, y, z in picked.residuals_m],
            statistic=None if picked is None else picked.statistic,
            critical=None if picked is None else picked.critical,
            turn_gon=turn_gon,
            shift_m=shift_m,
        )


def chosen_start(request: Json, target: str, target_origin_m: Vector3, source_origin_m: Vector3) -> Start:
    """Give a start of a request for a pair, whichever of the two is called the target there.

    Parameters
    ----------
    request
        One of the inputs' `starts`.
    target
        Name of the pair's target.
    target_origin_m, source_origin_m
        (3,) local origins of the pair's reduced frames in the coordinates of the files [m].
    """
    is_same = request["target"] == target
    first, second = (target_origin_m, source_origin_m) if is_same else (source_origin_m, target_origin_m)
    picked = None
    if request.get("picked_points") is not None:
        points = np.array(request["picked_points"], dtype=np.float64)
        of_first, of_second = points[:, :3] - first, points[:, 3:] - second
        # the residuals are told in the axes of the pair's target
        sides = {"target": of_first, "source": of_second} if is_same else {"target": of_second, "source": of_first}
        picked = picked_pose(**sides, std_m=request["std_m"])
        return Start(request["chosen_by"], picked.pose, picked)
    given = RigidTransform.from_matrix(np.array(request["target_from_source"], dtype=np.float64))
    std = [request["std_rotation_gon"] / GON_PER_RAD] * 3 + [request["std_translation_m"]] * 3
    reduced = RigidTransform.from_translation(-first) * given * RigidTransform.from_translation(second)
    estimate = PoseEstimate(reduced, np.diag(np.square(std)))
    return Start(request["chosen_by"], estimate if is_same else estimate.inverse(), None)


def _levelled(side: Json) -> float | None:
    std = (side.get("known") or {}).get("levelled_std_gon")
    return None if std is None else std / GON_PER_RAD


def _pose_of(result: PairResult) -> RigidTransform | None:
    """Give the pose between full coordinates."""
    if result.final is not None:
        return result.final.pose.target_from_source
    return None if result.fine is None else result.fine.pose.target_from_source
