"""The surface of a scan, ready to have many poses of another scan laid into it."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Int64
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Flags, Indices, Matrices3, Matrix3, Points, Scalars, Vector3
from algorithms.geometry.rotations import rotation_matrix
from algorithms.scans.point_blocks import LEAST_BLOCK, over_blocks
from algorithms.scans.range_image import SphericalRangeImage, conservative_nearest_m, spherical_range_image

CELL_RAD = math.radians(1.0)
"""Angular cell of a range image of the thinned surface: about the spacing of its points at common ranges."""
OWNER_REACH = 2.6
"""Farther away than so many cells from a cell's centre no surface point counts as the nearest."""
MAX_CELLS = 24_000_000
"""Largest number of cells of the look-up raster; coarser cells beyond."""


@dataclass(frozen=True, eq=False)
class SurfaceOwners:
    """Which surface point is the nearest in the cells of a raster, for those near the surface, as it is kept."""

    shape: tuple[int, int, int]
    """Numbers of cells of the raster."""
    low_m: Vector3
    """Lowest corner of the raster [m]."""
    cell_m: float
    """Edge of its cells [m]."""
    cells: Array
    """(k,) int32 numbers of cells, ascending."""
    nearest: Array
    """(k,) int32 number of the surface point nearest to the cell's centre."""

    def raster(self, numbers: Indices) -> Array:
        """Give them cell by cell, (nx, ny, nz) int32, as places in a list of the points; -1 far from all. O(cells)."""
        places = np.zeros(numbers.max(initial=-1) + 1, dtype=np.int32)
        places[numbers] = np.arange(len(numbers), dtype=np.int32)
        owner = np.full(self.shape, -1, dtype=np.int32)
        owner.ravel()[self.cells] = places[self.nearest]
        return owner


@dataclass(frozen=True, eq=False)
class SurfaceIndex:
    """Oriented surface points of one scan, a raster that finds the nearest of them, and the space seen to be empty."""

    points: Points
    """(n, 3) surface points with a normal, in an order of even coverage: the first m are a fair sample [m]."""
    normals: Points
    """(n, 3) unit normals towards the sensor."""
    weights: Scalars
    """(n,) weights that give every direction of normals the same say, mean 1: floor and ceiling alone fix nothing."""
    owner: Array
    """(nx, ny, nz) int32 number of the surface point nearest to the cell's centre, -1 far from all."""
    low_m: Vector3
    """Lowest corner of the raster [m]."""
    cell_m: float
    """Edge of the raster's cells [m]."""
    spacing_m: float
    """Spacing of the surface points [m]."""
    nearest_m: Array
    """(rows, columns) float32 conservative ranges, inf where unknown; (0, 0) when the sensor's position is unknown."""
    sensor_m: Vector3
    """Position of the instrument [m]; zero when unknown."""
    cell_rad: float
    """Angular size of the range cells [rad]."""
    numbers: Indices
    """(n,) which of the points that the index was made of each one is."""

    @property
    def knows_free_space(self) -> bool:
        """Say whether the sensor's position is known."""
        return bool(self.nearest_m.size)

    @cached_property
    def centre_m(self) -> Vector3:
        """(3,) mean of the surface points [m]."""
        return np.asarray(self.points.mean(axis=0))

    @cached_property
    def median_range_m(self) -> float:
        """Median distance of the surface points from the instrument [m]."""
        return float(np.median(np.linalg.norm(self.points - self.sensor_m, axis=1)))


@dataclass(frozen=True, eq=False)
class Evidence:
    """What speaks for and against poses: weights relative to the moved surface, one entry a pose."""

    fitting: Scalars
    """(h,) share that lies on the other scan's surface with agreeing normals, 0..1."""
    support: Scalars
    """(h,) geometric mean of that share over three directions of normals, 0..1. A floor on a floor fits well and says
    nothing of where the scan belongs on it: what counts is that walls of every direction fit as well."""
    violation: Scalars
    """(h,) share that lies in space the other scan saw to be empty, 0..1."""


@dataclass(frozen=True)
class EvidenceLimits:
    """When a moved point fits, and when it violates free space."""

    max_distance_m: float
    """Largest distance from the tangent plane [m]."""
    max_angle_rad: float
    """Largest angle between the normals [rad]."""
    reach_m: float
    """Largest distance along the surface to its nearest point [m]."""
    margin_m: float = 0.15
    """How much nearer than seen a point must be to violate [m]."""
    margin_relative: float = 0.012
    """The same, relative to the range."""

    def as_array(self) -> Array:
        """Give the limits in the order the compiled loops expect."""
        return np.array(
            [self.max_distance_m, math.cos(self.max_angle_rad), self.reach_m, self.margin_m, self.margin_relative]
        )


def surface_index(
    points: Points,
    normals: Points,
    spacing_m: float,
    sensor_m: Vector3 | None,
    *,
    seen: SphericalRangeImage | None = None,
    owners: SurfaceOwners | None = None,
) -> SurfaceIndex:
    """Build the index of one scan.

    Parameters
    ----------
    points
        (n, 3) points of the thinned surface [m].
    normals
        (n, 3) unit normals towards the sensor, zero where unknown.
    spacing_m
        Spacing of the points [m].
    sensor_m
        Position of the instrument [m]; None when unknown: then nothing is known of free space.
    seen
        What the instrument saw, from all points of the scan: the space it knows to be empty reaches nearer to surfaces
        than the thinned surface can tell. None: the thinned surface must do.
    owners
        What `surface_owners` says of the same points; None: it is asked, which is most of the work.
    """
    oriented = _evenly(normals)
    own, own_normals = points[oriented], normals[oriented]
    owners = _owners(points, oriented, spacing_m) if owners is None else owners
    if sensor_m is None:
        nearest, sensor, cell_rad = np.empty((0, 0), dtype=np.float32), np.zeros(3), CELL_RAD
    else:
        if seen is None:
            seen = spherical_range_image(points, sensor_m, CELL_RAD, splat_m=0.7 * spacing_m)
        nearest, sensor, cell_rad = conservative_nearest_m(seen), seen.sensor_m, seen.cell_rad
    return SurfaceIndex(
        points=np.ascontiguousarray(own),
        normals=np.ascontiguousarray(own_normals),
        weights=direction_weights(own_normals),
        owner=owners.raster(oriented),
        low_m=owners.low_m,
        cell_m=owners.cell_m,
        spacing_m=spacing_m,
        nearest_m=nearest,
        sensor_m=sensor,
        cell_rad=cell_rad,
        numbers=oriented,
    )


def surface_owners(points: Points, normals: Points, spacing_m: float) -> SurfaceOwners:
    """Say which point is the nearest around a surface, so that the index need not ask again; O(n log n + cells).

    Parameters
    ----------
    points, normals, spacing_m
        As `surface_index` takes them.
    """
    return _owners(points, _evenly(normals), spacing_m)


def direction_weights(normals: Points) -> Scalars:
    """Weigh surface points so that every direction is equally well represented, mean 1.

    The weight is the leverage n' M^-1 n with M the scatter of the normals, iterated: a large floor then says no more
    than the few walls that alone fix the horizontal position. Directions that occur hardly at all are not blown up.
    """
    if len(normals) == 0:
        return np.empty(0)
    weights = np.ones(len(normals))
    for _ in range(3):
        scatter = (normals * weights[:, None]).T @ normals / weights.sum()
        leverage = np.einsum("ij,ij->i", normals @ np.linalg.inv(scatter + 0.02 * np.eye(3)), normals)
        weights = np.clip(weights * leverage, 0.2, 5.0)
        weights /= weights.mean()
    return weights


def evidence_of(
    rotations: Matrices3, translations_m: Points, moved: SurfaceIndex, fixed: SurfaceIndex, *, points: int,
    limits: EvidenceLimits, sifting: bool = False,
) -> Evidence:  # fmt: skip
    """Lay the first `points` surface points of one scan into the other in every pose, and collect what fits.

    Parameters
    ----------
    rotations, translations_m
        (h, 3, 3) and (h, 3): fixed from moved.
    moved, fixed
        The two scans.
    points
        How many surface points of `moved` to try.
    limits
        What fits and what violates.
    sifting
        Give a pose up as soon as clearly more stands in free space than fits; its shares are of the points until then.
    """
    from algorithms.scans import surface_index_kernels as kernels

    m = min(points, len(moved.points))
    out = np.zeros((len(rotations), 8))
    weights, normals = moved.weights[:m], moved.normals[:m]
    rotations, translations = np.ascontiguousarray(rotations), np.ascontiguousarray(translations_m)
    points_of, limit_values = np.ascontiguousarray(moved.points[:m].T), limits.as_array()

    def lay(start: int, end: int) -> None:
        kernels.evidence(
            rotations[start:end], translations[start:end], points_of, normals,
            weights, fixed.points, fixed.normals, fixed.owner, fixed.low_m, fixed.cell_m, fixed.nearest_m,
            fixed.sensor_m, fixed.cell_rad, limit_values, sifting, out[start:end],
        )  # fmt: skip

    over_blocks(lay, len(rotations), least=max(LEAST_BLOCK // max(m, 1), 1))
    total = max(float(weights.sum()), 1e-12)
    fitting = out[:, 0] / total
    return Evidence(
        fitting=fitting,
        support=_directional_mean(
            out[:, 2:][:, _SYMMETRIC].reshape(-1, 3, 3) / total,
            (normals * weights[:, None]).T @ normals / total,
            fitting,
        ),
        violation=out[:, 1] / total,
    )


def seen_through(
    fixed_from_moved: RigidTransform,
    points: Points,
    normals: Points,
    fixed: SurfaceIndex,
    limits: EvidenceLimits,
    *,
    across_m: float = 0.0,
) -> Flags:
    """Say which moved points stand where the other instrument looked through; none where its position is unknown.

    Parameters
    ----------
    fixed_from_moved
        Pose.
    points, normals
        (n, 3) surface points of the moved scan and their normals.
    fixed
        The other scan.
    limits
        Margins of free space; what lies on the surface is not told apart here.
    across_m
        Only where what was seen lies farther than this off the plane of the surface that stands there [m].
    """
    from algorithms.scans import surface_index_kernels as kernels

    free = np.zeros(len(points), dtype=bool)
    if fixed.knows_free_space and len(points):
        rays = np.ascontiguousarray((fixed_from_moved.apply(points) - fixed.sensor_m).T)
        turned = normals @ rotation_matrix(fixed_from_moved).T
        kernels.seen_through(
            rays, turned, fixed.nearest_m, fixed.cell_rad, limits.margin_m, limits.margin_relative, across_m, free
        )
    return free


_SYMMETRIC = [0, 1, 2, 1, 3, 4, 2, 4, 5]
"""Where the nine entries of a symmetric 3x3 matrix stand among its six moments."""


def _directional_mean(fitting_moments: Array, all_moments: Matrix3, fitting: Scalars) -> Scalars:
    """Give the geometric mean of the fitting shares along the principal directions: (det F / det A)^(1/3).

    Directions that hardly occur at all are credited with the overall share.
    """
    floor = 0.03
    ratio = np.linalg.det(fitting_moments + (floor * fitting)[:, None, None] * np.eye(3)) / np.linalg.det(
        all_moments + floor * np.eye(3)
    )
    return np.asarray(np.cbrt(np.clip(ratio, 0.0, 1.0)))


def _evenly(normals: Points) -> Int64[Array, "m"]:
    """List the points with a normal so that the first of them, however many, cover the whole surface."""
    oriented = np.flatnonzero(np.einsum("ij,ij->i", normals, normals) > 0.5)
    # a fixed shuffle: the generator is local and its seed belongs to the method
    return oriented[np.random.default_rng(20).permutation(len(oriented))].astype(np.int64)


def _owners(surface: Points, numbers: Int64[Array, "m"], spacing_m: float) -> SurfaceOwners:
    """Find the nearest of some surface points, as far as two cells around them; of equally near ones the first."""
    from algorithms.scans import surface_index_kernels as kernels

    points = surface[numbers]
    if len(points) == 0:
        nothing = np.empty(0, dtype=np.int32)
        return SurfaceOwners((1, 1, 1), np.zeros(3), max(spacing_m, 0.1), nothing, nothing)
    low, high = points.min(axis=0), points.max(axis=0)
    cell = max(1.2 * spacing_m, 0.12)
    while np.prod(np.ceil((high - low) / cell) + 5) > MAX_CELLS:
        cell *= 1.2
    low = low - 2.0 * cell
    nx, ny, nz = (int(k) for k in np.ceil((high - low) / cell) + 3)
    own_cells = np.ravel_multi_index(tuple(((points - low) / cell).astype(np.int64).T), (nx, ny, nz))
    order = np.argsort(own_cells)
    ranked = own_cells[order]
    occupied = ranked[np.append(True, ranked[1:] > ranked[:-1])]
    raster = np.full((nx, ny, nz), -1, dtype=np.int32)
    # the space around the surface, cell by cell: as far from occupied ones as the square root of five
    kernels.mark_around(occupied, 2, 5, raster)
    cells = np.flatnonzero(raster.ravel() == kernels.MARK).astype(np.int32)
    raster.ravel()[cells] = np.arange(len(cells), dtype=np.int32)
    nearest = np.full(len(cells), -1, dtype=np.int32)
    kernels.nearest_points(points, order, low, cell, OWNER_REACH, raster, nearest)
    found = nearest >= 0
    return SurfaceOwners((nx, ny, nz), low, cell, cells[found], numbers[nearest[found]].astype(np.int32))
