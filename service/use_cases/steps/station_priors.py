"""What a request says of stations beforehand, as the numerics take it."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Vector3
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.pose_parameters import pose_with_parameter_std
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.priors import PairPriors, StationPrior
from schemas.values.approximate_pose import ApproximateStd
from service.ports import Json
from service.use_cases.documents.pose_documents import PARAMETERS

UNITS = np.array([GON_PER_RAD, GON_PER_RAD, GON_PER_RAD, 1.0, 1.0, 1.0])


def priors_of_pair(target: Json, source: Json, target_origin_m: Vector3, source_origin_m: Vector3) -> PairPriors | None:
    """Give what is known of two stations; None where nothing is.

    Parameters
    ----------
    target, source
        Arguments of the step for either station: ``name`` and what is ``known`` of it.
    target_origin_m, source_origin_m
        (3,) local origins of the reduced frames in the coordinates of the files [m].
    """
    if not (target.get("known") and source.get("known")):
        return None
    return PairPriors(_prior(target, target_origin_m), _prior(source, source_origin_m))


def approximate_pose(request: Json | list[list[float]], origin_m: Vector3) -> PoseEstimate:
    """Give the pose of a reduced frame from a matrix, or matrix and accuracy.

    The standard deviations hold where the coordinates of the scan lie, however far from their origin that is: a
    rotation that is roughly known must not make an unknown place of it.

    Parameters
    ----------
    request
        As in the inputs of the job.
    origin_m
        (3,) local origin of the reduced frame [m].
    """
    given: Json = {"matrix": request} if isinstance(request, list) else request
    std = {**ApproximateStd().model_dump(), **(given.get("std") or {})}
    pose = RigidTransform.from_matrix(np.array(given["matrix"], dtype=np.float64))
    reduced = pose * RigidTransform.from_translation(origin_m)
    return pose_with_parameter_std(reduced, np.array([std[name] for name in PARAMETERS]) / UNITS)


def _prior(side: Json, origin_m: Vector3) -> StationPrior:
    known = side["known"]
    levelled, approximate = known.get("levelled_std_gon"), known.get("approximate_pose")
    return StationPrior(
        side["name"],
        None if levelled is None else levelled / GON_PER_RAD,
        None if approximate is None else approximate_pose(approximate, origin_m),
    )
