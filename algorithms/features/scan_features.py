"""Everything registration needs to know of one scan: lines, planes, cylinders, and what was seen where."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float64, Int64

from algorithms.arrays import Array, Labels, Points, Vector3
from algorithms.features.mount_test import MountTest
from algorithms.geometry.cylinders import Cylinders
from algorithms.geometry.lines import Lines
from algorithms.geometry.planes import Planes
from algorithms.scans.instrument_errors import Sweep
from algorithms.scans.range_image import SphericalRangeImage
from algorithms.scans.surface_index import SurfaceIndex, SurfaceOwners, surface_index


@dataclass(frozen=True, eq=False)
class SurfaceSample:
    """A scan thinned to one point per voxel."""

    points: Points
    """(k, 3) voxel centroids, reduced scan frame [m]."""
    normals: Points
    """(k, 3) unit normals towards the sensor; zero where no surface could be fitted, or only one seen edge-on."""
    plane_labels: Labels
    """(k,) number of the plane the voxel belongs to, -1 for none."""
    voxel_size_m: float
    """Edge length of the voxels [m]."""
    owners: SurfaceOwners | None = None
    """Which of them is nearest where, found once for all pairs of the scan; None: each index looks for itself."""


@dataclass(frozen=True, eq=False)
class PhotoEdges:
    """What the q photos of a station gave, and what its n lines are in them."""

    segment_counts: Int64[Array, "q"]
    """(q,) straight edges found in each photo."""
    projected_counts: Int64[Array, "q"]
    """(q,) of them those that gave a line in space."""
    merged_counts: Int64[Array, "q"]
    """(q,) of these those that became part of a line which the scan or another photo shows too."""
    rejection_counts: Int64[Array, "q reasons"]
    """(q, reasons) edges that gave none, by `EdgeRejection`."""
    line_normals: Points
    """(n, 3) unit normal, towards the camera, of the surface that a line of photos lies in; zero for others."""
    line_kinds: Labels
    """(n,) `SpaceEdgeKind` of lines of photos; -1 for others."""
    witnesses: Lines | None = None
    """w lines of edges that are crowded or of unclear owner: they measure nothing but help to tell poses apart."""
    witness_normals: Array | None = None
    """(w, 3) unit normals, towards the camera, of their surfaces."""
    other_readings: Array | None = None
    """(q, 2) another reading of each photo's pose with which its lines are found again in the scan, -1 where there is
    none, and how many are (`misstated_mounts`)."""


@dataclass(frozen=True, eq=False)
class Symmetries:
    """The motions that lay a scan onto itself, and the limits they were looked for with (`matching.symmetries`)."""

    motions: Float64[Array, "k 4 4"]
    """(k, 4, 4) in the reduced scan frame."""
    max_angle_rad: float
    """Angles between features that differ by less counted as equal [rad]."""
    max_distance_m: float
    """Distances between features that differ by less counted as equal [m]."""


@dataclass(frozen=True, eq=False)
class Rounding:
    """What the coordinates of a scan are rounded to, and what that does to its planes."""

    steps_m: Vector3
    """(3,) step along each axis of the file [m] (`scans.coordinate_steps`)."""
    range_step_m: float
    """Step of the distances from the instrument [m]; 0 where none is seen."""
    uneven: bool
    """Whether coordinates fall on slices of unequal thickness; the steps are typical ones then."""
    std_m: float
    """Standard deviation of single points by it, in the worst direction [m]."""
    plane_covariances: Float64[Array, "k 3 3"]
    """(k, 3, 3) of (a1, a2, b): errors by rounding that all points of a plane share, near and far parts of it alike."""

    @property
    def shared_std_m(self) -> float:
        """Root mean square of the offset errors of planes by rounding [m]."""
        return float(np.sqrt(self.plane_covariances[:, 2, 2].mean())) if len(self.plane_covariances) else self.std_m


@dataclass(frozen=True, eq=False)
class ScanFeatures:
    """Features of one scan, all in its reduced scan frame."""

    lines: Lines
    """Plane intersections, cylinder axes and edges of photos."""
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
    photo_covariances: Float64[Array, "q 6 6"] = field(default_factory=lambda: np.zeros((0, 6, 6)))
    """(q, 6, 6) covariance of the mount of each photo that `Lines.photos` counts: rotation vector on the left of the
    scan axes [rad], translation of the projection centre [m] (MATH 2.5)."""
    photo_edges: PhotoEdges | None = None
    """What the photos gave; None: the station has no photos."""
    mount_test: MountTest | None = None
    """Whether the photos fit the scan; None: the station has no photos."""
    symmetries: Symmetries | None = None
    """How the scan is like itself, known once for all its pairs; None: each pair looks for it."""
    sensor_std_m: float | None = None
    """Standard deviation of the instrument's position where it was guessed from the cloud, all directions together [m];
    None where the file states it, or nobody knows it."""
    far_point_count: int = 0
    """Isolated points far from everything else that were left out before all this (`scans.far_points`)."""
    farthest_m: float = 0.0
    """How far away the farthest of them was [m]."""
    warnings: tuple[str, ...] = ()
    """What makes one doubt that the coordinates are metres (`scans.scale_plausibility`)."""
    rounding: Rounding | None = None
    """What its coordinates are rounded to; None: not known."""
    plane_responses: Float64[Array, "p 3 11"] | None = None
    """(p, 3, 11) how each plane's (a1, a2, b) answer to errors of the instrument, `INSTRUMENT_ERRORS`, and to drifts,
    `DRIFT_ERRORS`, zero where the time of points is not known; None: the file does not tell where the scanner stood,
    nor is it seen from its origin."""
    sweep: Sweep | None = None
    """When the instrument looked where; None: the file does not tell."""

    @property
    def spacing_m(self) -> float:
        """Distance of neighbouring points, about [m]: side of a square of the surface that holds one, on the average.

        Surface is counted in voxels, and the average is ruled by what is near, so this is rather too small.
        """
        return self.surface.voxel_size_m * float(np.sqrt(len(self.surface.points) / max(self.point_count, 1)))

    @cached_property
    def index(self) -> SurfaceIndex:
        """The thinned surface, ready to have poses of another scan laid into it; built once."""
        surface = self.surface
        return surface_index(
            surface.points,
            surface.normals,
            surface.voxel_size_m,
            self.sensor_m,
            seen=self.seen,
            owners=surface.owners,
        )
