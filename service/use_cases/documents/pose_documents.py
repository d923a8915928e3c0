"""Poses as clients read them."""

from typing import cast

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Vector3
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.pose_parameters import STRONG_CORRELATION, pose_parameters
from algorithms.geometry.poses import PoseEstimate
from schemas.values.poses import Correlation, ErrorEllipsoid, PointStd, Pose, PoseStd, Quaternion, Row4, Row6

Rows4 = tuple[Row4, Row4, Row4, Row4]
Rows6 = tuple[Row6, Row6, Row6, Row6, Row6, Row6]
Triple = tuple[float, float, float]
PARAMETERS = ("omega_gon", "phi_gon", "kappa_gon", "tx_m", "ty_m", "tz_m")
"""The six parameters as they are called in documents."""


def rows(matrix: Array) -> tuple[tuple[float, ...], ...]:
    """Turn a matrix into nested tuples, row by row."""
    return tuple(tuple(float(value) for value in row) for row in matrix)


def matrix_rows(pose: RigidTransform) -> Rows4:
    """Give the 4x4 matrix of a motion."""
    return cast("Rows4", rows(pose.as_matrix()))


def pose_document(
    pose: PoseEstimate, *, target: str, source: str, centroid_m: Vector3 | None, a_posteriori: bool = False
) -> Pose:
    """Describe a pose with its standard deviations.

    Parameters
    ----------
    pose
        Between full coordinates.
    target, source
        Names of the frames, for the words.
    centroid_m
        (3,) where in the target frame the shift's standard deviation is given too; None to leave it out.
    a_posteriori
        The covariance was multiplied by sigma0 squared.
    """
    matrix = pose.target_from_source.as_matrix()
    x, y, z, w = pose.rotation.as_quat(canonical=True)
    parameters = pose_parameters(pose)
    scale = np.array([GON_PER_RAD, GON_PER_RAD, GON_PER_RAD, 1.0, 1.0, 1.0])
    values = parameters.values * scale + 0.0  # no minus zero
    std = np.sqrt(np.maximum(np.diag(parameters.covariance), 0.0)) * scale
    determined = pose.null_space.shape[1] == 0
    return Pose(
        direction=f"x in {target} = M · x in {source}",
        matrix=cast("Rows4", rows(matrix)),
        quaternion=Quaternion(w=float(w), x=float(x), y=float(y), z=float(z)),
        **_named(values, ~parameters.free),
        undetermined=_undetermined(pose, parameters.free),
        std=PoseStd(**_named(std, parameters.determined)),
        std_at_centroid_m=None if centroid_m is None else _point_std(pose, centroid_m),
        error_ellipsoid_at_centroid=None if centroid_m is None or not determined else _ellipsoid(pose, centroid_m),
        correlations=[
            Correlation(first=PARAMETERS[i], second=PARAMETERS[j], correlation=correlation)
            for i, j, correlation in parameters.correlations_above(STRONG_CORRELATION)
        ],
        covariance=cast("Rows6", rows(pose.covariance)) if determined else None,
        covariance_sigma0="a-posteriori" if a_posteriori else "a-priori",
    )


def _named(values: Array, known: Array) -> dict[str, float | None]:
    """Name six numbers; null where a parameter has none."""
    return {name: float(value) if k else None for name, value, k in zip(PARAMETERS, values, known, strict=True)}


def _undetermined(pose: PoseEstimate, free: Array) -> str | None:
    if not free.any():
        return None
    names = ", ".join(name for name, is_free in zip(PARAMETERS, free, strict=True) if is_free)
    count = pose.null_space.shape[1]
    return (
        f"{count} independent motion{'s' if count > 1 else ''} of the scan would fit as well, and {names} change with "
        "it; the matrix shows the possible pose nearest to the first guess"
    )


def fixed_pose_document(name: str) -> Pose:
    """Describe the station that carries the common frame: identity, known without error by definition."""
    identity = PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))
    return pose_document(identity, target="world", source=name, centroid_m=None)


def _point_std(pose: PoseEstimate, point_m: Vector3) -> PointStd:
    std = pose.position_std_m(point_m)
    return PointStd(tx_m=std[0], ty_m=std[1], tz_m=std[2], point_m=cast("Triple", tuple(float(c) for c in point_m)))


def _ellipsoid(pose: PoseEstimate, point_m: Vector3) -> ErrorEllipsoid:
    ellipsoid = pose.error_ellipsoid(point_m)
    return ErrorEllipsoid(
        semi_axes_m=cast("Triple", tuple(float(a) for a in ellipsoid.semi_axes_m)),
        directions=[cast("Triple", tuple(float(c) for c in column)) for column in ellipsoid.directions.T],
    )
