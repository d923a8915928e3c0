"""Everything registration needs to know of one scan: lines, planes, cylinders, and what was seen where."""

from dataclasses import dataclass

from algorithms.arrays import Labels, Points, Vector3
from algorithms.geometry.cylinders import Cylinders
from algorithms.geometry.lines import Lines
from algorithms.geometry.planes import Planes
from algorithms.scans.range_image import SphericalRangeImage


@dataclass(frozen=True, eq=False)
class SurfaceSample:
    """A scan thinned to one point per voxel."""

    points: Points
    """(k, 3) voxel centroids, reduced scan frame [m]."""
    normals: Points
    """(k, 3) unit normals towards the sensor; zero where no surface could be fitted."""
    plane_labels: Labels
    """(k,) number of the plane the voxel belongs to, -1 for none."""
    voxel_size_m: float
    """Edge length of the voxels [m]."""


@dataclass(frozen=True, eq=False)
class ScanFeatures:
    """Features of one scan, all in its reduced scan frame."""

    lines: Lines
    """Plane intersections and cylinder axes (and later photo edges)."""
    planes: Planes
    cylinders: Cylinders
    surface: SurfaceSample
    seen: SphericalRangeImage | None
    """What the instrument saw in each direction; None when its position is unknown."""
    origin_m: Vector3
    """Local origin of the reduced frame in the file's frame [m]."""
    sensor_m: Vector3 | None
    """Position of the instrument in the reduced frame [m]."""
    point_count: int
    """Points of the full scan."""
    noise_std_m: float
    """Typical standard deviation of single points from fitted planes [m]."""
