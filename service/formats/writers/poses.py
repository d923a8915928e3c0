"""Poses of stations as other programs read them.

CloudCompare and everyone who takes matrices: `x_world = M x_scan`, four rows of four numbers. 3DTK: left-handed
(x right, y up, z forward), centimetres, degrees; its angles turn as Rx Ry Rz of these axes (EulerToMatrix4), and a scan
of right-handed axes (x forward, y left, z up) is read as (-y, z, x). RiSCAN PRO: X_GLCS = M_POP M_SOP X_SOCS
(A. Ullrich, R. Schwarz, H. Kager, eq. 1): M_SOP is near, M_POP brings it far away and may turn to left-handed axes.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Matrix4, Matrix6, Vector3
from algorithms.geometry.angles import angles_from_rotation
from service.formats.writers.csv_table import csv_text

CONVENTION = "x_world = R x_scan + t [m]; covariance of (rotation vector on the left in world axes [rad], t [m])"
CENTIMETRES = 100.0
LEFT_HANDED = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""3DTK's axes of (forward, left, up)."""
NORTH_EAST = np.array([[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""(north, east, height) of (east, north, height): left-handed, as some national systems are."""
NEAR_M = 1_000.0
"""Stations nearer to the origin need no M_POP to keep their digits."""


@dataclass(frozen=True, eq=False)
class StationPose:
    """Where a station stands."""

    name: str
    world_from_scan: RigidTransform
    covariance: Matrix6 | None = None
    """Of (rotation vector on the left in world axes [rad], translation [m]); None: unknown."""


def cloudcompare(poses: Sequence[StationPose]) -> dict[str, bytes]:
    """Give one 4×4 matrix per station."""
    return {f"{pose.name}.txt": _matrix_text(pose.world_from_scan.as_matrix()) for pose in poses}


def poses_table(poses: Sequence[StationPose]) -> dict[str, bytes]:
    """Give one table: name, the matrix row by row, the quaternion."""
    matrix_names = [f"a{row}{column}" for row in range(1, 5) for column in range(1, 5)]
    rows = (
        [pose.name, *pose.world_from_scan.as_matrix().ravel().tolist(), *_quaternion(pose.world_from_scan).tolist()]
        for pose in poses
    )
    return {"poses.csv": csv_text(["name", *matrix_names, "qw", "qx", "qy", "qz"], rows).encode()}


def poses_3dtk(poses: Sequence[StationPose]) -> dict[str, bytes]:
    """Give one `.pose` per station in the order of the stations: position [cm], angles [deg], left-handed."""
    files = {}
    for number, pose in enumerate(poses):
        rotation = LEFT_HANDED @ pose.world_from_scan.rotation.as_matrix() @ LEFT_HANDED.T
        angles_deg = np.degrees(angles_from_rotation(Rotation.from_matrix(rotation)))
        position_cm = CENTIMETRES * LEFT_HANDED @ pose.world_from_scan.translation
        lines = [" ".join(_digits(number) for number in three.tolist()) for three in (position_cm, angles_deg)]
        files[f"scan{number:03d}.pose"] = ("\n".join(lines) + "\n").encode()
    return files


def riscan(poses: Sequence[StationPose], *, is_left_handed: bool = False) -> dict[str, bytes]:
    """Give M_SOP of each station and M_POP of the project.

    Parameters
    ----------
    poses
        The stations; their world frame is east, north, height.
    is_left_handed
        Whether GLCS is north, east, height. Only M_POP knows of it: PRCS is right-handed as always.
    """
    origin_m = _near_origin(poses)
    pop = RigidTransform.from_translation(origin_m).as_matrix()
    to_project = RigidTransform.from_translation(-origin_m)
    files = {"project.pop.dat": _matrix_text(NORTH_EAST @ pop if is_left_handed else pop)}
    for pose in poses:
        files[f"{pose.name}.sop.dat"] = _matrix_text((to_project * pose.world_from_scan).as_matrix())
    return files


def poses_json(poses: Sequence[StationPose]) -> dict[str, bytes]:
    """Give one document with matrices, quaternions and covariances."""
    stations = [
        {
            "name": pose.name,
            "world_from_scan": {
                "matrix": pose.world_from_scan.as_matrix().tolist(),
                "quaternion": dict(zip("wxyz", _quaternion(pose.world_from_scan).tolist(), strict=True)),
                "covariance": None if pose.covariance is None else pose.covariance.tolist(),
            },
        }
        for pose in poses
    ]
    document = {"convention": CONVENTION, "stations": stations}
    return {"poses.json": (json.dumps(document, indent=1) + "\n").encode()}


POSE_FORMATS: Mapping[str, Callable[[Sequence[StationPose]], dict[str, bytes]]] = {
    "cloudcompare": cloudcompare,
    "csv": poses_table,
    "3dtk": poses_3dtk,
    "riscan": riscan,
    "json": poses_json,
}
"""Files by name, of all stations."""


def _near_origin(poses: Sequence[StationPose]) -> Vector3:
    """Give a point of whole metres in the middle of the stations; zero where they are near enough."""
    places: Array = np.array([pose.world_from_scan.translation for pose in poses]).reshape(-1, 3)
    if len(places) == 0 or np.abs(places).max() < NEAR_M:
        return np.zeros(3)
    return np.asarray(np.round(places.mean(axis=0)))


def _quaternion(pose: RigidTransform) -> Array:
    return np.asarray(pose.rotation.as_quat(canonical=True, scalar_first=True))


def _matrix_text(matrix: Matrix4) -> bytes:
    return ("\n".join(" ".join(_digits(number) for number in row) for row in matrix.tolist()) + "\n").encode()


def _digits(number: float) -> str:
    return repr(number + 0.0)  # no negative zeros
