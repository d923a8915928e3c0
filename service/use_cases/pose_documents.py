"""Poses as clients read them."""

from typing import cast

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Vector3
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.poses import PoseEstimate
from schemas.poses import ErrorEllipsoid, PointStd, Pose, PoseStd, Quaternion, Row4, Row6

Rows4 = tuple[Row4, Row4, Row4, Row4]
Rows6 = tuple[Row6, Row6, Row6, Row6, Row6, Row6]
Triple = tuple[float, float, float]


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
    angles = pose.omega_phi_kappa_rad * GON_PER_RAD + 0.0  # no minus zero
    angle_std = [None if s is None else s * GON_PER_RAD for s in pose.omega_phi_kappa_std_rad]
    shift_std = pose.translation_std_m
    determined = pose.null_space.shape[1] == 0
    return Pose(
        direction=f"x in {target} = M · x in {source}",
        matrix=cast("Rows4", rows(matrix)),
        quaternion=Quaternion(w=float(w), x=float(x), y=float(y), z=float(z)),
        omega_gon=float(angles[0]),
        phi_gon=float(angles[1]),
        kappa_gon=float(angles[2]),
        tx_m=float(matrix[0, 3]),
        ty_m=float(matrix[1, 3]),
        tz_m=float(matrix[2, 3]),
        std=PoseStd(
            omega_gon=angle_std[0],
            phi_gon=angle_std[1],
            kappa_gon=angle_std[2],
            tx_m=shift_std[0],
            ty_m=shift_std[1],
            tz_m=shift_std[2],
        ),
        std_at_centroid_m=None if centroid_m is None else _point_std(pose, centroid_m),
        error_ellipsoid_at_centroid=None if centroid_m is None or not determined else _ellipsoid(pose, centroid_m),
        covariance=cast("Rows6", rows(pose.covariance)) if determined else None,
        covariance_sigma0="a-posteriori" if a_posteriori else "a-priori",
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
