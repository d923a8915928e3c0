"""Level squares of ground that a scan sees about itself, and nothing else."""

import numpy as np

from algorithms.features.scan_features import ScanFeatures, SurfaceSample
from algorithms.geometry.lines import Lines
from algorithms.geometry.planes import Planes
from tests.scenes.lines.feature_scenes import NO_CYLINDERS


def ground(
    places_m: list[tuple[float, float, float]], sizes_m: list[float], tilt_std_rad: float = 1e-5
) -> ScanFeatures:
    """Put squares of the given sizes at places, seen from above."""
    n = len(places_m)
    corners = [0.5 * size * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) for size in sizes_m]
    planes = Planes(
        normals=np.tile([0.0, 0.0, 1.0], (n, 1)),
        centroids=np.array(places_m).reshape(-1, 3),
        bases=np.tile(np.eye(3)[:, :2], (n, 1, 1)),
        covariances=np.tile(np.diag([tilt_std_rad**2, tilt_std_rad**2, 1e-10]), (n, 1, 1)),
        noise_std_m=np.full(n, 0.002),
        point_counts=np.full(n, 1000),
        areas_m2=np.square(np.array(sizes_m, dtype=np.float64)),
        boundary=np.concatenate([np.empty((0, 2)), *corners]),
        boundary_splits=np.arange(0, 4 * n + 1, 4),
    )
    nothing = np.empty((0, 3))
    return ScanFeatures(
        lines=Lines.empty(),
        planes=planes,
        cylinders=NO_CYLINDERS,
        surface=SurfaceSample(nothing, nothing, np.empty(0, dtype=np.int32), 0.1),
        seen=None,
        origin_m=np.zeros(3),
        sensor_m=np.zeros(3),
        point_count=0,
        noise_std_m=0.002,
    )
