"""Spheres of known radius: votes of centres from normals, a robust fit, and tests that it is a sphere."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Flags, OtherPoints, Points, Scalars, Vector3
from algorithms.progress import NoProgress, Progress
from algorithms.scans.surface_cells import SurfaceCells, cell_surfaces
from algorithms.scans.voxel_grid import hash_into_voxels
from algorithms.targets.found import Candidate, FoundTarget, RejectedCandidate
from algorithms.targets.options import TargetKind
from algorithms.targets.seen_cloud import SeenCloud

POINTS_ACROSS = 2.5
"""Of a sphere at least so many points must lie along its radius."""
MEAN_CELL, NORMAL_RADIUS, VOTE_CELL = 0.25, 0.6, 0.25
"""In radii: cells whose points are averaged, neighbourhoods of normals, cells of votes."""
FLAT_BLOCK, FLATTER = 1.25, 0.5
"""In blocks of so many radii a surface is flat that bends by less than such a part of the sphere."""
NEIGHBOURS = 16
CELLS_AT_ONCE = 1 << 17
"""Bounds the memory."""
LEAST_VOTES = 6
PLANE_SHARE = 0.27
"""Of a plane's votes in a cube of 7 vote cells, 9 of 49 fall into its middle 3 cells; half as much again is chance."""
MOST_CANDIDATES = 2000
LEAST_COSINE = 0.42
"""Flatter than 65 degrees a beam's footprint leaves the sphere."""
LEAST_POINTS = 12
LEAST_COVERAGE = 0.6
RIM_SHARE = 0.35
"""A surface that goes on beyond the sphere's has so many points beside it, relative to those on it."""
INSIDE_SHARE, BEHIND_SHARE = 0.08, 0.1
"""So many points within the sphere, or behind it in its middle, relative to those on it, and it is none."""
RADIUS_SIGMAS, RADIUS_TOLERANCE = 4.0, 0.04
"""The radius that the points would have by themselves may differ by so many standard deviations plus so many radii."""
WORST_RMS = 0.06
"""Residuals of more than so many radii are those of something else, and not worth a word."""
MOST_SAMPLED, SEEN_AT_FIRST, LEAST_AT_FIRST = 3000, 0.4, 0.5
"""Where a sample of the points within so many radii of the surface covers less of the cap, no sphere is fitted."""
ANGLE_PART = 0.2
"""Standard deviation across the beam relative to that along it."""
SEEN_SECTORS = 6
"""The visible cap is divided into an inner disc and two rings of so many sectors."""


@dataclass(frozen=True, eq=False)
class SphereFit:
    """A sphere of fixed radius through points."""

    centre_m: Vector3
    covariance_m2: Array
    """(3, 3) with the residuals' own scale."""
    residuals_m: Scalars
    """(n,) distances of all given points from the surface, outside positive."""
    used: Array
    """(n,) bool."""
    scale_m: float
    """Robust standard deviation along the beam."""


def find_spheres(cloud: SeenCloud, radius_m: float, *, progress: Progress | None = None) -> list[Candidate]:
    """Find spheres of one radius.

    Parameters
    ----------
    cloud
        The scan about its instrument.
    radius_m
        Radius of the spheres [m].
    progress
        Is told the candidates that were looked at.

    Returns
    -------
    Found ones and rejected ones, some of them twice.
    """
    listener = progress or NoProgress()
    dense = cloud.points[cloud.ranges * cloud.step_rad < radius_m / POINTS_ACROSS]
    if len(dense) < LEAST_POINTS:
        return []
    centres = voted_centres(dense, radius_m)
    found: list[Candidate] = []
    for number, centre in enumerate(centres):
        listener.report(number / len(centres), "spheres")
        candidate = tested_sphere(cloud, centre, radius_m)
        if candidate is not None:
            found.append(candidate)
    return found


def voted_centres(points: Points, radius_m: float) -> OtherPoints:
    """Give the places (k, 3) for which many surface points vote as the centre of a sphere, the most voted first.

    Each local mean votes for the place one radius behind it along its normal. A plane spreads its votes over a plane,
    a sphere gathers them in one place.

    Parameters
    ----------
    points
        (n, 3) relative to the instrument [m].
    radius_m
        Radius [m].
    """
    hashed = hash_into_voxels(np.ascontiguousarray(points), radius_m * MEAN_CELL)
    means = hashed.moments[:, 1:4]
    if len(means) < LEAST_VOTES:
        return np.empty((0, 3))
    curved = np.flatnonzero(~_in_flat_blocks(means, radius_m))
    if len(curved) < LEAST_VOTES:
        return np.empty((0, 3))
    tree = cKDTree(means, balanced_tree=False, compact_nodes=False)
    parts = [
        _votes(tree, means, curved[start : start + CELLS_AT_ONCE], radius_m)
        for start in range(0, len(curved), CELLS_AT_ONCE)
    ]
    votes = np.concatenate(parts)
    return _gathered(votes, radius_m * VOTE_CELL) if len(votes) else votes


def _in_flat_blocks(means: Points, radius_m: float) -> Flags:
    """Tell which local means (n,) lie in blocks that hold a plane and nothing else.

    A sphere's cap of any radius a has the standard deviation a² / (r sqrt 48) across its plane and a / 2 along it.
    """
    hashed = hash_into_voxels(means, FLAT_BLOCK * radius_m)
    alone = np.empty((len(hashed.keys), 0), dtype=np.int32)
    blocks = SurfaceCells(hashed.cell_of_point, hashed.moments, alone, FLAT_BLOCK * radius_m)
    surfaces = cell_surfaces(blocks, cap=np.inf, min_count=float(LEAST_VOTES))
    flat = surfaces.residual_std_m * radius_m * np.sqrt(3.0) < FLATTER * surfaces.width_std_m**2
    return np.asarray(flat[hashed.cell_of_point])


def _votes(tree: cKDTree, means: Points, which: Array, radius_m: float) -> OtherPoints:
    """Give the centres (k, 3) of the spheres that touch the surface in some of its means [m], where such a sphere is
    nearer to the means around than their plane is.
    """
    count = min(NEIGHBOURS, len(means))
    neighbours: Array = np.asarray(
        tree.query(means[which], k=count, distance_upper_bound=NORMAL_RADIUS * radius_m)[1]
    ).reshape(-1, count)
    there: Array = neighbours < len(means)
    enough = there.sum(axis=1) >= LEAST_VOTES
    neighbours, there = neighbours[enough], there[enough]
    around = np.where(there[:, :, None], means[np.minimum(neighbours, len(means) - 1)], 0.0)
    middle = around.sum(axis=1) / there.sum(axis=1)[:, None]
    off = np.where(there[:, :, None], around - middle[:, None], 0.0)
    sizes, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", off, off))
    normals = axes[:, :, 0]
    normals = normals * -np.sign(np.einsum("ij,ij->i", normals, middle))[:, None]
    centres = middle - radius_m * normals
    apart = np.where(there, np.linalg.norm(off + radius_m * normals[:, None], axis=2), 0.0)
    misses = np.where(there, apart - (apart.sum(axis=1) / there.sum(axis=1))[:, None], 0.0)
    return np.asarray(centres[np.einsum("ij,ij->i", misses, misses) < sizes[:, 0]])


def _gathered(votes: Points, cell_m: float) -> OtherPoints:
    """Give the means (k, 3) of votes that gather more than those of a plane, the most first."""
    cells = np.floor(votes / cell_m).astype(np.int64)
    cells -= cells.min(axis=0) - 4
    size = [int(length) for length in cells.max(axis=0) + 5]
    keys = (cells[:, 0] * size[1] + cells[:, 1]) * size[2] + cells[:, 2]
    unique, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
    around3 = [(i * size[1] + j) * size[2] + k for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)]
    own = np.flatnonzero(counts >= 2)
    near = _counts_at(unique, counts, unique[own], around3)
    own, near = own[near >= LEAST_VOTES], near[near >= LEAST_VOTES]
    order = np.argsort(-near, kind="stable")[: 40 * MOST_CANDIDATES]
    own, near = own[order], near[order]
    steps = range(-3, 4)
    around7 = [(i * size[1] + j) * size[2] + k for i in steps for j in steps for k in steps]
    wide = _counts_at(unique, counts, unique[own], around7)
    gathered = near > np.maximum(PLANE_SHARE * wide, LEAST_VOTES - 1)
    own, near = own[gathered], near[gathered]
    sums = np.stack([np.bincount(inverse, votes[:, k], len(unique)) for k in range(3)], axis=1)
    places = sums[own] / counts[own, None]
    kept: list[int] = []
    for k in range(len(places)):
        if len(kept) >= MOST_CANDIDATES:
            break
        if not kept or np.min(np.sum((places[kept] - places[k]) ** 2, axis=1)) > (2.0 * cell_m) ** 2:
            kept.append(k)
    return np.asarray(places[kept])


def _counts_at(keys: Array, counts: Array, centres: Array, offsets: list[int]) -> Array:
    """Add up the counts of the cells around some."""
    total = np.zeros(len(centres), dtype=np.int64)
    for offset in offsets:
        wanted = centres + offset
        place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        total += np.where(keys[place] == wanted, counts[place], 0)
    return total


def fit_sphere(points: Points, start_m: Vector3, radius_m: float) -> SphereFit | None:
    """Fit the centre of a sphere of fixed radius to points seen from the origin; None where too few lie on it.

    Residuals are distances from the surface, weighted by the beam's incidence: noise is along the beam. What lies
    farther off than three robust standard deviations, or is met flatter than 65 degrees, does not take part.

    Parameters
    ----------
    points
        (n, 3) relative to the instrument [m].
    start_m
        (3,) approximate centre, within half a radius.
    radius_m
        Radius [m].
    """
    centre = np.array(start_m, dtype=np.float64)
    towards = -points / np.linalg.norm(points, axis=1, keepdims=True)
    limit = 0.35 * radius_m
    scale = limit
    used = np.zeros(len(points), dtype=bool)
    normal = np.zeros((3, 3))
    for _ in range(25):
        offset = points - centre
        distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-9)
        outward = offset / distance[:, None]
        residuals = distance - radius_m
        cosines = np.einsum("ij,ij->i", outward, towards)
        used = (np.abs(residuals) < limit) & (cosines > LEAST_COSINE)
        if np.count_nonzero(used) < LEAST_POINTS:
            return None
        weights = 1.0 / (cosines[used] ** 2 + ANGLE_PART**2 * (1.0 - cosines[used] ** 2))
        design = outward[used]
        normal = (design * weights[:, None]).T @ design
        sizes = np.linalg.eigvalsh(normal)
        if not sizes[0] > 1e-8 * sizes[2]:
            return None
        step = np.linalg.solve(normal, (design * weights[:, None]).T @ residuals[used])
        centre = centre + step
        scale = max(1.4826 * float(np.median(np.abs(residuals[used]) * np.sqrt(weights))), 1e-6)
        shrunk = max(3.0 * scale, 0.5 * limit if limit > 6.0 * scale else 3.0 * scale)
        settled = float(np.linalg.norm(step)) < 1e-7 * radius_m and shrunk > 0.98 * limit
        limit = min(limit, shrunk)
        if settled:
            break
    offset = points - centre
    distance = np.linalg.norm(offset, axis=1)
    residuals = distance - radius_m
    freedom = int(np.count_nonzero(used)) - 3
    variance = float(np.sum(weights * residuals[used] ** 2)) / freedom
    # three standard deviations leave 1.3 % of the sum of squares out
    # and the variance is itself estimated: f / (f - 2) for the heavier tails of few points
    inflation = 1.027 * freedom / (freedom - 2)
    return SphereFit(centre, inflation * variance * np.linalg.inv(normal), residuals, used, float(np.sqrt(variance)))


def tested_sphere(cloud: SeenCloud, start_m: Vector3, radius_m: float) -> Candidate | None:
    """Fit a sphere at a place and test that it is one; None where too few points lie on it to say anything."""
    numbers = cloud.near(start_m, 1.9 * radius_m)
    if len(numbers) < LEAST_POINTS:
        return None
    points = cloud.points[numbers]
    sample = points[:: max(1, len(points) // MOST_SAMPLED)]
    near = np.abs(np.linalg.norm(sample - start_m, axis=1) - radius_m) < SEEN_AT_FIRST * radius_m
    if cap_coverage(sample[near], start_m, cloud.step_rad, radius_m) < LEAST_AT_FIRST:
        return None
    fit = fit_sphere(points, start_m, radius_m)
    if fit is None or float(np.linalg.norm(fit.centre_m - start_m)) > 0.8 * radius_m:
        return None
    used = int(np.count_nonzero(fit.used))
    rms = float(np.sqrt(np.mean(fit.residuals_m[fit.used] ** 2)))
    if rms > WORST_RMS * radius_m:
        return None
    coverage = cap_coverage(points[fit.used], fit.centre_m, cloud.step_rad, radius_m)
    reason = _not_a_sphere(cloud, points, fit, radius_m, coverage)
    centre = fit.centre_m + cloud.sensor_m
    if reason is not None:
        return RejectedCandidate(TargetKind.SPHERE, centre, reason)
    score = min(coverage, 1.0 - rms / (WORST_RMS * radius_m))
    covariance = fit.covariance_m2
    return FoundTarget(TargetKind.SPHERE, centre, covariance, used, 0.0, rms, coverage, 0.0, score, 2.0 * radius_m)


def cap_coverage(points: Points, centre_m: Vector3, step_rad: float, radius_m: float) -> float:
    """Give the share of the visible cap's parts of equal view in which points lie, 0..1.

    The cap seen at less than 60 degrees is divided, as the instrument sees it, into an inner disc and rings of sectors:
    so few that each should hold two points at the scan's spacing.
    """
    range_m = float(np.linalg.norm(centre_m))
    view = centre_m / range_m
    basis = np.linalg.svd(view[None, :])[2][1:]
    seen = (points - centre_m) @ basis.T / (radius_m * np.sin(np.deg2rad(60.0)))
    distance, angle = np.hypot(seen[:, 0], seen[:, 1]), np.arctan2(seen[:, 1], seen[:, 0])
    expected = np.pi * (radius_m * np.sin(np.deg2rad(60.0)) / (range_m * step_rad)) ** 2
    rings = 2 if expected > 4.0 * (2 * SEEN_SECTORS + 1) else 1
    ring = np.digitize(distance, np.array([0.4, 0.72, 1.0]) if rings == 2 else np.array([0.4, 1.0]))
    sector = np.minimum(((angle + np.pi) / (2.0 * np.pi) * SEEN_SECTORS).astype(np.int64), SEEN_SECTORS - 1)
    outer = (ring >= 1) & (ring <= rings)
    parts = len(np.unique(ring[outer] * SEEN_SECTORS + sector[outer])) + int(np.any(ring == 0))
    return parts / (rings * SEEN_SECTORS + 1)


def _not_a_sphere(cloud: SeenCloud, points: Points, fit: SphereFit, radius_m: float, coverage: float) -> str | None:
    """Say why points on a sphere are none, or nothing."""
    if coverage < LEAST_COVERAGE:
        return f"points cover only {coverage:.0%} of the visible cap"
    used = int(np.count_nonzero(fit.used))
    towards = -fit.centre_m / np.linalg.norm(fit.centre_m)
    facing = (points - fit.centre_m) @ towards > 0.0
    margin = max(4.0 * fit.scale_m, 0.04 * radius_m)
    beside = np.count_nonzero(facing & (fit.residuals_m > margin) & (fit.residuals_m < 0.6 * radius_m))
    inside = np.count_nonzero(fit.residuals_m < -max(margin, 0.15 * radius_m))
    behind = _points_behind(cloud, fit.centre_m, radius_m)
    own, std = _own_radius(points[fit.used], fit, radius_m)
    checks = (
        (beside > RIM_SHARE * used, f"the surface goes on beside it: {beside} points near {used} on the sphere"),
        (inside > INSIDE_SHARE * used, f"{inside} points lie within it, {used} on it"),
        (behind > BEHIND_SHARE * used, f"the beam passes through: {behind} points behind it, {used} on it"),
        (
            abs(own - radius_m) > RADIUS_SIGMAS * std + RADIUS_TOLERANCE * radius_m,
            f"its radius is {own * 1e3:.1f} mm (standard deviation {std * 1e3:.1f} mm)",
        ),
    )
    return next((reason for failed, reason in checks if failed), None)


def _points_behind(cloud: SeenCloud, centre_m: Vector3, radius_m: float) -> int:
    """Count points behind the sphere whose beams would have gone through its middle."""
    range_m = float(np.linalg.norm(centre_m))
    view = centre_m / range_m
    along = cloud.points @ view
    # within a cone of so many radii about the centre
    cosine = np.cos(np.arctan(0.75 * radius_m / range_m))
    return int(np.count_nonzero((along > range_m + 1.5 * radius_m) & (along > cosine * cloud.ranges)))


def _own_radius(points: Points, fit: SphereFit, radius_m: float) -> tuple[float, float]:
    """Give the radius that the points have by themselves and its standard deviation [m], by one step from the fit."""
    offset = points - fit.centre_m
    distance = np.linalg.norm(offset, axis=1)
    design = np.column_stack([offset / distance[:, None], np.ones(len(points))])
    towards = -points / np.linalg.norm(points, axis=1, keepdims=True)
    cosines = np.einsum("ij,ij->i", design[:, :3], towards)
    weights = 1.0 / (cosines**2 + ANGLE_PART**2 * (1.0 - cosines**2))
    normal = (design * weights[:, None]).T @ design
    cofactors = np.linalg.pinv(normal, hermitian=True)
    step = cofactors @ ((design * weights[:, None]).T @ (distance - radius_m))
    return radius_m + float(step[3]), fit.scale_m * float(np.sqrt(max(cofactors[3, 3], 0.0)))
