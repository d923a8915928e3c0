"""Photos of point scenes with known edges, without a renderer: exact edges, or with white noise."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.camera_mounts import CameraAxes, scan_from_camera_with_axes
from algorithms.geometry.cameras import Camera
from algorithms.photos.segments import ImageSegments
from algorithms.scans.scan import Scan

CAMERA = Camera(width=3000, height=2000, fx=1800.0, fy=1805.0, cx=1510.0, cy=990.0)


def looking(yaw_rad=0.0, position_m=(0.05, 0.02, 0.2), origin_m=(0.0, 0.0, 0.0)):
    """Give scan_from_camera of a camera that looks along the scan's x axis turned by yaw about z."""
    head = RigidTransform.from_components(
        np.asarray(position_m, float) + np.asarray(origin_m, float), Rotation.from_rotvec([0.0, 0.02, yaw_rad])
    )
    return scan_from_camera_with_axes(head, CameraAxes.FORWARD_LEFT_UP)


def segments_of(starts, ends, camera, scan_from_camera, rng=None, std_px=0.1):
    """Project true lines (n, 3) to (n, 3) of the scan frame and disturb them: `std_px` at each pixel of the edge."""
    to_camera = scan_from_camera.inv()
    a, b = (camera.ideal_from_camera(to_camera.apply(np.asarray(p, float))) for p in (starts, ends))
    lengths = np.linalg.norm(b - a, axis=1)
    directions = (b - a) / lengths[:, None]
    centres = 0.5 * (a + b)
    covariances = np.zeros((len(a), 2, 2))
    covariances[:, 0, 0] = 12.0 * std_px**2 / lengths**3
    covariances[:, 1, 1] = std_px**2 / lengths
    if rng is not None:
        normals = np.column_stack([-directions[:, 1], directions[:, 0]])
        angles = rng.normal(0.0, np.sqrt(covariances[:, 0, 0]))
        centres = centres + rng.normal(0.0, np.sqrt(covariances[:, 1, 1]))[:, None] * normals
        directions = directions + angles[:, None] * normals
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    half = 0.5 * lengths
    return ImageSegments(
        centres=centres,
        directions=directions,
        extents=np.column_stack([-half, half]),
        covariances=covariances,
        contrasts=np.full(len(a), 40.0),
        widths_px=np.full(len(a), 0.7),
        point_counts=lengths.astype(np.int64),
        raw_ends=np.stack([a, b], axis=1),
        composite=np.zeros(len(a), dtype=bool),
    )


def panel(corner, side_a, side_b, step_m, rng=None, noise_m=0.0, sensor=(0.0, 0.0, 0.0)):
    """Give a grid of points on a parallelogram; noise is along the ray from the sensor, as of a scanner."""
    corner, a, b = (np.asarray(v, float) for v in (corner, side_a, side_b))
    steps_a, steps_b = (np.arange(0.5 * step_m, np.linalg.norm(v), step_m) / np.linalg.norm(v) for v in (a, b))
    u, v = np.meshgrid(steps_a, steps_b)
    points = corner + u.reshape(-1, 1) * a + v.reshape(-1, 1) * b
    if rng is not None:
        rays = points - np.asarray(sensor, float)
        ranges = np.linalg.norm(rays, axis=1, keepdims=True)
        points = points + rays / ranges * rng.normal(0.0, noise_m, (len(points), 1))
    return points


def scan_of(*panels, intensities=None, origin_m=(0.0, 0.0, 0.0)):
    """Join panels to a scan, each with its own mean intensity (two percent of scatter) where these are given."""
    points = np.ascontiguousarray(np.concatenate(panels))
    intensity = None
    if intensities is not None:
        rng = np.random.default_rng(5)
        intensity = np.concatenate(
            [value * (1.0 + 0.02 * rng.standard_normal(len(p))) for value, p in zip(intensities, panels, strict=True)]
        ).astype(np.float32)
    return Scan(points, np.asarray(origin_m, float), intensity=intensity, sensor_m=np.zeros(3))


def line_errors(lines, starts, ends):
    """Give (n, 4) errors (a1, a2, b1, b2) of true lines as seen from the estimates."""
    true = (ends - starts) / np.linalg.norm(ends - starts, axis=1, keepdims=True)
    cosines = np.einsum("ni,ni->n", true, lines.directions)[:, None]
    true = true * np.sign(cosines)
    cosines = np.abs(cosines)
    tilts = np.einsum("nij,ni->nj", lines.bases, true) / cosines
    along = np.einsum("ni,ni->n", lines.anchors - starts, lines.directions)[:, None] / cosines
    offsets = np.einsum("nij,ni->nj", lines.bases, starts + along * true - lines.anchors)
    return np.hstack([tilts, offsets])


def normalised_errors(lines, errors):
    return np.einsum("ni,nij,nj->n", errors, np.linalg.inv(lines.covariances), errors)
