"""Point scenes with known planes and cylinders, without a scanner: exact or with white noise."""

import numpy as np

from algorithms.geometry.cylinders import Cylinders
from algorithms.geometry.lines import Lines
from algorithms.geometry.planes import Planes
from algorithms.scans.scan import Scan

SENSOR = np.array([0.3, -0.2, 0.1])
NO_PLANES = Planes(
    normals=np.empty((0, 3)),
    centroids=np.empty((0, 3)),
    bases=np.empty((0, 3, 2)),
    covariances=np.empty((0, 3, 3)),
    noise_std_m=np.empty(0),
    point_counts=np.empty(0, dtype=np.int64),
    areas_m2=np.empty(0),
    boundary=np.empty((0, 2)),
    boundary_splits=np.zeros(1, dtype=np.int64),
)
NO_CYLINDERS = Cylinders(
    Lines.empty(), np.empty(0), np.empty(0), np.empty(0, bool), np.empty(0), np.empty(0), np.empty(0, np.int64)
)


def rectangle(rng, corner, side_a, side_b, count, noise_m=0.0):
    """Give `count` points spread over a parallelogram, with noise across it."""
    a, b = np.asarray(side_a, float), np.asarray(side_b, float)
    normal = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
    uv = rng.random((count, 2))
    return np.asarray(corner, float) + uv[:, :1] * a + uv[:, 1:] * b + rng.normal(0, noise_m, (count, 1)) * normal


def room(rng, per_m2=150.0, noise_m=0.0):
    """Give the six faces of a room of 6 x 4 x 3 m around the origin: twelve edges."""
    low, high = np.array([-3.0, -2.0, -1.5]), np.array([3.0, 2.0, 1.5])
    size = high - low
    parts = []
    for axis in range(3):
        a, b = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        a, b = a * size, b * size
        count = int(per_m2 * np.linalg.norm(a) * np.linalg.norm(b))
        for end in (low[axis], high[axis]):
            corner = low.copy()
            corner[axis] = end
            parts.append(rectangle(rng, corner, a, b, count, noise_m))
    return np.concatenate(parts)


def tube(rng, start, end, radius_m, count, arc_rad=np.pi, noise_m=0.0, facing=(1.0, 0.0, 0.0)):
    """Give points on the part of a cylinder that turns to `facing`."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    axis = (end - start) / np.linalg.norm(end - start)
    e1 = np.asarray(facing, float) - (np.asarray(facing, float) @ axis) * axis
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(axis, e1)
    angle = (rng.random(count) - 0.5) * arc_rad
    radii = radius_m + rng.normal(0, noise_m, count)
    ring = np.cos(angle)[:, None] * e1 + np.sin(angle)[:, None] * e2
    return start + rng.random((count, 1)) * (end - start) + radii[:, None] * ring


def cloud(points, sensor_m=SENSOR):
    return Scan(points=np.ascontiguousarray(points), origin_m=np.zeros(3), name="cloud", sensor_m=sensor_m)
