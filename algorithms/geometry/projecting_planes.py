"""The plane through a straight edge of a photo and the projection centre, and its errors (MATH 2.5)."""

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Bases, Points, Vectors2
from algorithms.geometry.cameras import Camera


def projecting_planes(
    centres: Vectors2, directions: Vectors2, camera: Camera, scan_from_camera: RigidTransform
) -> tuple[Points, Bases, Float64[Array, "n 2 2"], Float64[Array, "n 3 6"]]:
    """Give the projecting planes of edges, in the scan frame, and how they depend on edge and camera pose.

    An edge through c with direction d and normal m = (-d_y, d_x) is the line l = (m, -m.c) of homogeneous ideal
    pixels; its plane in the camera frame has the normal Kᵀ l and contains the projection centre. With the edge's errors
    d → d + angle m, c → c + offset m: dl = (-d, d.c) angle + (0, 0, -1) offset. With the pose's errors
    (MATH 2.5) dN = w × N, and the centre moves by dt.

    Parameters
    ----------
    centres, directions
        (n, 2) points and unit directions of the edges in ideal pixels.
    camera, scan_from_camera
        Interior orientation and pose.

    Returns
    -------
    normals
        (n, 3) unit normals N in the scan frame; every plane contains the projection centre.
    bases
        (n, 3, 2) columns E1, E2 with (E1, E2, N) right-handed.
    by_edge
        (n, 2, 2) derivatives of (a1, a2), N → N + E a, by the edge's (angle, offset) [1/rad, 1/px].
    by_pose
        (n, 3, 6) derivatives of (a1, a2, b), b the shift along N, by the errors of the pose: rotation vector on the
        left in scan axes, translation.
    """
    rotation = scan_from_camera.rotation.as_matrix()
    across = np.column_stack([-directions[:, 1], directions[:, 0]])
    lines = np.column_stack([across, -np.einsum("ni,ni->n", across, centres)])
    by_angle = np.column_stack([-directions, np.einsum("ni,ni->n", directions, centres)])
    by_offset = np.tile([0.0, 0.0, -1.0], (len(lines), 1))
    to_scan = rotation @ camera.matrix.T
    normals = lines @ to_scan.T
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / lengths
    bases = _bases_along(normals, directions, camera, rotation)
    changes = np.stack([by_angle @ to_scan.T, by_offset @ to_scan.T], axis=2) / lengths[:, :, None]
    by_edge = np.einsum("nij,nik->njk", bases, changes)
    by_pose = np.zeros((len(normals), 3, 6))
    # E_k . (w × N) = w . (N × E_k)
    by_pose[:, :2, :3] = np.cross(normals[:, None, :], np.swapaxes(bases, 1, 2))
    by_pose[:, 2, 3:] = normals
    return normals, bases, by_edge, by_pose


def _bases_along(normals: Points, directions: Vectors2, camera: Camera, rotation: Array) -> Bases:
    """Give bases of the planes whose E1 runs along the edges."""
    along = np.column_stack([directions / np.array([camera.fx, camera.fy]), np.zeros(len(directions))]) @ rotation.T
    along = along - np.einsum("ni,ni->n", along, normals)[:, None] * normals
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([along, np.cross(normals, along)], axis=2)
