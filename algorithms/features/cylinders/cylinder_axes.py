"""Cylinders (pipes, columns, tanks) among the points that lie on no plane, and their axes as lines."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Points, Vector3
from algorithms.features.cylinders.cylinder_axes_kernels import adjust_cylinder, axis_misfits, search_cylinders
from algorithms.features.cylinders.cylinder_fitting import FittedCylinder, fit_cylinder
from algorithms.features.options import FeatureOptions
from algorithms.features.patches.patch_covariance import NUMERICAL_STD_M
from algorithms.geometry.cylinders import Cylinders
from algorithms.geometry.lines import LineSource, lines_from_arrays
from algorithms.scans.coordinate_steps import FULL_PRECISION, CoordinateSteps
from algorithms.scans.point_blocks import over_blocks
from algorithms.scans.surface_cells import cell_surfaces, orient
from algorithms.scans.voxel_grid import voxel_cells, voxel_cells_of_fitting_size

LEAST_VOXEL_M = 0.02
"""Smallest voxel of the search [m]."""
MOST_VOXELS = 400_000
"""More leftover voxels than that are merged into larger ones."""
PATCH_SIZES = (40, 160, 640)
"""Cells in the patches that hypotheses are made from: small ones for thin pipes, large ones for tanks."""
MIN_CELLS = 15
"""Least number of cells of a cylinder."""
MIN_POINTS = 40
"""Least number of points of a cylinder."""
MIN_ARC_RAD = float(np.deg2rad(80.0))
"""Least seen arc."""
LARGE_RADIUS_M, LARGE_ARC_RAD = 0.8, float(np.deg2rad(120.0))
"""Cylinders of a larger radius need a larger arc: uneven ground and walls make giant false ones."""
WELL_KNOWN_RADIUS = 0.005
"""Unless the standard deviation of the radius, as share of the radius, is no larger."""
LENGTH_IN_RADII = 2.0
"""Least length in radii: shorter pieces do not fix their axis."""
SHORT_LENGTH_M, SHORT_TILT_STD_RAD = 1.6, 0.005
"""Unless they are so long and the standard deviation of the axis' direction is no larger: tanks may be wider than high.
"""
WITHIN_LIMIT = 1.02
"""Radii up to so many times the largest one wanted are taken: of tanks as large as that half come out larger."""
LARGEST_RADIUS_STD, LARGEST_RADIUS_STD_M = 0.1, 0.04
"""Largest standard deviation of the radius, as share of the radius, and in metres."""
ROUGHNESS, ROUGHNESS_M = 0.01, 0.01
"""Deviation of real pipes and columns from a cylinder, as share of the radius, and in metres: what is larger is no
less round."""
THINNED = 2000
"""Points used while outliers are being dropped."""
LEAST_FILL = 0.5
"""Least share of the cylinder's seen surface that must hold points: bushes are full of circles, but porous."""


@dataclass(frozen=True, eq=False)
class _Found:
    """A cylinder of one or several pieces."""

    pieces: tuple[int, ...]
    """Numbers of the candidates that were put together, in this order."""
    cylinder: FittedCylinder
    own: Array
    """Numbers of its points."""

    @property
    def row(self) -> tuple[Vector3, Vector3, float]:
        """Anchor, direction and radius [m]."""
        return self.cylinder.anchor, self.cylinder.direction, self.cylinder.radius_m


def find_cylinders(
    points: Points,
    sensor_m: Vector3 | None,
    noise_std_m: float,
    options: FeatureOptions,
    steps: CoordinateSteps = FULL_PRECISION,
) -> Cylinders:
    """Find cylinders among points that lie on no plane.

    Parameters
    ----------
    points
        (n, 3) points left over by the planes [m].
    sensor_m
        Where the instrument stood; without it all cylinders are called convex.
    noise_std_m
        Typical noise of points across surfaces [m].
    options
        Radius limits.
    steps
        What the coordinates are rounded to.
    """
    if len(points) < MIN_POINTS:
        return cylinders_from([], [], [])
    cells = voxel_cells_of_fitting_size(points, least_size_m=LEAST_VOXEL_M)
    size = cells.size_m
    while len(cells) > MOST_VOXELS:
        size *= 1.25
        cells = voxel_cells(points, size)
    surfaces = orient(cells, cell_surfaces(cells, cap=20.0, min_count=6.0), sensor_m)
    smooth = surfaces.residual_std_m < 0.5 * surfaces.width_std_m
    normals = np.where(smooth[:, None], surfaces.normals, 0.0)
    labels, rows = search_cylinders(
        np.flatnonzero(smooth),
        np.ascontiguousarray(cells.means),
        normals,
        cells.neighbours,
        np.array(PATCH_SIZES),
        options.min_cylinder_radius_m,
        WITHIN_LIMIT * options.max_cylinder_radius_m,
        noise_std_m,
        MIN_CELLS,
    )
    members = _points_by_label(labels, cells.cell_of_point, len(rows))
    order = sorted(range(len(rows)), key=lambda k: -len(members[k]))
    fits: dict[tuple[int, ...], tuple[FittedCylinder, Array] | None] = {}

    def fitted(pieces: tuple[int, ...], held: list[Array]) -> tuple[FittedCylinder, Array] | None:
        if pieces not in fits:
            last = pieces[-1]
            fit = _refine(points, np.concatenate([*held, members[last]]), rows[last], noise_std_m, steps)
            fits[pieces] = fit if fit is not None and _is_sound(fit[0], noise_std_m, options) else None
        return fits[pieces]

    def cylinders_of(numbers: Sequence[int]) -> list[_Found]:
        """Fit a cylinder to each piece, or to it and to what it continues, the largest first."""
        found: list[_Found] = []
        for k in numbers:
            near = next((i for i, other in enumerate(found) if _continues(rows[k], *other.row)), None)
            pieces, held = ((k,), []) if near is None else ((*found[near].pieces, k), [found[near].own])
            fit = fitted(pieces, held)
            if fit is None:
                continue
            if near is None:
                found.append(_Found(pieces, *fit))
            else:
                found[near] = _Found(pieces, *fit)
        return found

    # pieces that seem to belong together are fitted side by side; what comes of it is looked up then, piece by piece
    groups = _groups(rows, order)
    over_blocks(lambda start, end: [cylinders_of(each) for each in groups[start:end]], len(groups), least=1)
    found = cylinders_of(order)
    convex = [_is_convex(each.cylinder, sensor_m) for each in found]
    return cylinders_from([each.cylinder for each in found], convex, [len(each.own) for each in found])


def cylinders_from(found: list[FittedCylinder], convex: list[bool], counts: list[int]) -> Cylinders:
    """Collect fitted cylinders column by column; their axes carry the number of the cylinder as parent."""
    k = len(found)
    numbers = np.arange(k, dtype=np.int64)
    axes = lines_from_arrays(
        np.array([c.anchor for c in found]).reshape(k, 3),
        np.array([c.direction for c in found]).reshape(k, 3),
        np.array([c.covariance[:4, :4] for c in found]).reshape(k, 4, 4),
        np.array([c.extent for c in found]).reshape(k, 2),
        bases=np.array([c.basis for c in found]).reshape(k, 3, 2),
        sources=np.full(k, LineSource.CYLINDER_AXIS, dtype=np.int32),
        parents=np.stack([numbers, np.full(k, -1, dtype=np.int64)], axis=1),
    )
    return Cylinders(
        axes=axes,
        radii_m=np.array([c.radius_m for c in found], dtype=np.float64),
        radius_std_m=np.array([np.sqrt(c.covariance[4, 4]) for c in found], dtype=np.float64),
        convex=np.array(convex, dtype=np.bool_),
        arcs_rad=np.array([c.arc_rad for c in found], dtype=np.float64),
        noise_std_m=np.array([c.noise_std_m for c in found], dtype=np.float64),
        point_counts=np.array(counts, dtype=np.int64),
    )


def _points_by_label(labels: Array, cell_of_point: Array, count: int) -> list[Array]:
    """List the points of every label."""
    # two bytes are sorted in a pass
    label = labels.astype(np.int16 if count < np.iinfo(np.int16).max else labels.dtype)[cell_of_point]
    inside = np.flatnonzero(label >= 0)
    order = inside[np.argsort(label[inside], kind="stable")]
    bounds = np.searchsorted(label[order], np.arange(count + 1))
    return [order[bounds[k] : bounds[k + 1]] for k in range(count)]


def _groups(rows: Array, order: Sequence[int]) -> list[list[int]]:
    """Put candidates together that seem to continue the same one, in their order."""
    groups: list[list[int]] = []
    for k in order:
        first = (rows[each[0]] for each in groups)
        near = next((i for i, row in enumerate(first) if _continues(rows[k], row[:3], row[3:6], row[6])), None)
        if near is None:
            groups.append([k])
        else:
            groups[near].append(k)
    return groups


def _continues(row: Array, anchor: Vector3, direction: Vector3, radius_m: float) -> bool:
    """Tell whether a candidate (point, direction, radius) lies on a cylinder."""
    if abs(row[3:6] @ direction) < np.cos(np.deg2rad(5.0)) or abs(row[6] / radius_m - 1.0) > 0.2:
        return False
    offset = row[:3] - anchor
    across = offset - (offset @ direction) * direction
    return bool(np.linalg.norm(across) < 0.25 * radius_m)


def _refine(
    points: Points, own: Array, row: Array, noise_std_m: float, steps: CoordinateSteps
) -> tuple[FittedCylinder, Array] | None:
    """Fit a cylinder to its points without those that do not lie on it; None if too few remain or it collapses."""
    anchor, direction, radius = row[:3].copy(), row[3:6].copy(), float(row[6])
    huber = max(2.0 * noise_std_m, NUMERICAL_STD_M)
    for _ in range(2):
        if len(own) < MIN_POINTS:
            return None
        step = max(1, len(own) // THINNED)
        radius = float(adjust_cylinder(points[own[::step]], anchor, direction, radius, 5, huber)[0])
        misfit = axis_misfits(points, own, anchor, direction, radius)
        limit = 3.5 * max(1.4826 * float(np.median(misfit[::step])), steps.std_m, NUMERICAL_STD_M)
        own = own[misfit <= limit]
    if len(own) < MIN_POINTS or not radius > 0:
        return None
    cylinder = fit_cylinder(points[own], anchor, direction, radius, noise_std_m, steps)
    return None if cylinder is None else (cylinder, own)


def _is_sound(cylinder: FittedCylinder, noise_std_m: float, options: FeatureOptions) -> bool:
    """Refuse cylinders that are too short, too open, too porous or too uncertain to be one."""
    radius = cylinder.radius_m
    radius_std = float(np.sqrt(cylinder.covariance[4, 4]))
    needs_large_arc = radius > LARGE_RADIUS_M and radius_std > WELL_KNOWN_RADIUS * radius
    roughness_m = min(ROUGHNESS * radius, ROUGHNESS_M)
    return bool(
        options.min_cylinder_radius_m <= radius <= WITHIN_LIMIT * options.max_cylinder_radius_m
        and _is_long(cylinder)
        and cylinder.arc_rad >= (LARGE_ARC_RAD if needs_large_arc else MIN_ARC_RAD)
        and radius_std <= min(LARGEST_RADIUS_STD * radius, LARGEST_RADIUS_STD_M)
        and cylinder.noise_std_m <= min(LARGEST_RADIUS_STD * radius, 1.5 * noise_std_m + roughness_m)
        and cylinder.fill >= LEAST_FILL
    )


def _is_long(cylinder: FittedCylinder) -> bool:
    """Say whether a piece is long enough to fix its axis."""
    length = float(cylinder.extent[1] - cylinder.extent[0])
    tilt_std = float(np.sqrt(cylinder.covariance[0, 0] + cylinder.covariance[1, 1]))
    short = length >= SHORT_LENGTH_M and tilt_std <= SHORT_TILT_STD_RAD
    return length >= LENGTH_IN_RADII * cylinder.radius_m or short


def _is_convex(cylinder: FittedCylinder, sensor_m: Vector3 | None) -> bool:
    """Tell whether the instrument stood outside the cylinder."""
    if sensor_m is None:
        return True
    offset = sensor_m - cylinder.anchor
    across = offset - (offset @ cylinder.direction) * cylinder.direction
    return bool(np.linalg.norm(across) > cylinder.radius_m)
