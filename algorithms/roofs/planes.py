"""Roof planes over a ground plan, as clusters of the parameters of small planes (the ACV's method).

A small neighbourhood slides over the points, z = a x + b y + c is fitted in it, and the parameters of all are points
of a space in which the faces of the roof are clusters (Jansa and Stanek 2003).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from algorithms.arrays import Array, CorePoints, Flags, Points, Scalars, Vector3
from algorithms.roofs.options import RoofOptions

MOST_NEIGHBOURS = 32
LEAST_NEIGHBOURS = 5
TOLERANCE = 3.0
"""In standard deviations of the points."""
MAD = 1.4826
"""From the median of absolute deviations to a normal distribution's standard deviation."""
ROUNDS, PASSES = 3, 2
MOST_STATED = 4.0
"""In stated noises: what scatters more is vegetation."""
CLASSES, WEAK, STEADY = 4, 0.05, 0.02
"""Of slopes; weight of equal noise in all directions; residuals so small are never left out of these fits."""
LINKED = 1.5
"""What is left lies together where the next points are so many of its spacings apart at most."""
MOST_FACES = 60
"""More faces over one plan are no roof but a heap."""


@dataclass(frozen=True, eq=False)
class RoofPlane:
    """One face's plane z = a x + b y + c."""

    parameters: Vector3
    """a, b, c; x and y from the same origin as the points [1, 1, m]."""
    before: int
    """Points that its cluster took."""
    after: int
    """Points that fit it."""
    rms_m: float
    """Of their height differences [m]."""
    noise_m: float
    """Standard deviation of heights about it, by the noise of all points [m]."""

    @property
    def level(self) -> bool:
        """Whether it was made horizontal."""
        return not self.parameters[:2].any()

    def heights(self, places: Array) -> Scalars:
        """Give z at places (n, 2) [m]."""
        return np.asarray(places[:, :2] @ self.parameters[:2] + self.parameters[2])


@dataclass(frozen=True)
class HeightNoise:
    """Noise of points on roofs: of heights, and of places, which a slope makes one of heights too."""

    vertical_m: float
    horizontal_m: float
    """Along the line of greatest slope [m]."""
    least_m: float = 0.0
    """Of heights: as the request states [m]."""

    def at(self, slope: Array) -> Scalars:
        """Return the standard deviation of heights about planes of these slopes [m]."""
        return np.maximum(self.least_m, np.hypot(self.vertical_m, self.horizontal_m * slope))


def roof_planes(points: Points, options: RoofOptions) -> tuple[Sequence[RoofPlane], Array]:
    """Find the planes of a roof.

    Parameters
    ----------
    points
        (n, 3) points over the plan, x and y near the origin [m].
    options
        How.

    Returns
    -------
    The planes, largest first, and the number of the plane of each point (n,), -1 for none.
    """
    labels = np.full(len(points), -1, dtype=np.int64)
    if len(points) <= LEAST_NEIGHBOURS:
        return [], labels
    noise = noise_of(points, options)
    least = least_points(points, options)
    planes: list[RoofPlane] = []
    # small faces are seen by themselves when the large ones are gone
    for _ in range(PASSES):
        free = np.flatnonzero(labels < 0)
        if len(free) < max(least, LEAST_NEIGHBOURS + 1):
            break
        more, taken = _clustered(points[free], options, noise, least, len(planes))
        labels[free] = taken
        planes += more
        if not more:
            break
    refined, labels = _refined(points, planes, labels, options, noise)
    rest, labels = _rest(points, labels, least, noise)
    return [*refined, *rest], labels


def _clustered(
    points: Points, options: RoofOptions, noise: HeightNoise, least: int, first: int
) -> tuple[list[RoofPlane], Array]:
    """Find clusters of small planes among points, and number the planes from `first` on; -1 for points of none."""
    labels = np.full(len(points), -1, dtype=np.int64)
    small, good = small_planes(points, options, noise)
    # a slope counts by the height that it makes across the neighbourhood's own place: the parameters are those at the
    # middle of the plan, where neither slope nor height is better known than the other
    lever = max(float(np.hypot(*np.ptp(points[:, :2], axis=0))) / 2.0, options.neighbourhood_m)
    scaled = small * np.array([lever, lever, 1.0])
    reach = TOLERANCE * noise.at(np.hypot(small[:, 0], small[:, 1])) * lever / options.neighbourhood_m
    planes: list[RoofPlane] = []
    free = good.copy()
    while free.sum() >= least and first + len(planes) < MOST_FACES:
        numbers = np.flatnonzero(free)
        tree = cKDTree(scaled[numbers])
        counts = tree.query_ball_point(scaled[numbers], reach[numbers], return_length=True)
        seed = int(np.argmax(counts))
        if counts[seed] < least:
            break
        members = numbers[tree.query_ball_point(scaled[numbers[seed]], reach[numbers[seed]])]
        plane, taken = _grown(points, small, members, free, options, noise)
        free[members] = False
        free[taken] = False
        if plane is None or plane.after < least:
            continue
        labels[taken] = first + len(planes)
        planes.append(plane)
    return planes, labels


def _small_fits(points: Points, options: RoofOptions, steady_m: float) -> tuple[Array, Array, Array]:
    """Fit z = a x + b y + c about each point without what lies off it: parameters from the point, rms, count."""
    distances, found = cKDTree(points[:, :2]).query(
        points[:, :2], k=min(MOST_NEIGHBOURS, len(points)), distance_upper_bound=options.neighbourhood_m
    )
    known = np.isfinite(np.asarray(distances))
    near = points[np.where(known, found, 0)]
    weights = known.astype(np.float64)
    design = np.concatenate([near[:, :, :2], np.ones((*near.shape[:2], 1))], axis=2)
    centred = design.copy()
    centred[:, :, :2] -= points[:, None, :2]
    parameters, rms = _fitted(centred, near[:, :, 2], weights)
    for _ in range(ROUNDS):
        residuals = np.abs(near[:, :, 2] - np.einsum("nkj,nj->nk", centred, parameters))
        weights = known & (residuals <= np.maximum(2.0 * rms, steady_m)[:, None])
        parameters, rms = _fitted(centred, near[:, :, 2], weights.astype(np.float64))
    return parameters, rms, weights.sum(axis=1)


def small_planes(points: Points, options: RoofOptions, noise: HeightNoise | None = None) -> tuple[CorePoints, Flags]:
    """Fit z = a x + b y + c about each point, and tell which fits are planes of a roof for this noise."""
    noise = noise or HeightNoise(options.noise_m, 0.0)
    parameters, rms, count = _small_fits(points, options, noise.vertical_m)
    reached = cKDTree(points[:, :2]).query_ball_point(points[:, :2], options.neighbourhood_m, return_length=True)
    slope = np.hypot(parameters[:, 0], parameters[:, 1])
    sigma = noise.at(slope)
    own = np.abs(points[:, 2] - parameters[:, 2]) <= TOLERANCE * sigma
    good = (
        (count >= np.maximum(LEAST_NEIGHBOURS, 0.5 * np.minimum(reached, MOST_NEIGHBOURS))) & (rms <= 1.5 * sigma) & own
    )
    good &= slope <= np.tan(np.radians(options.steepest_deg))
    parameters[:, 2] -= np.einsum("ij,ij->i", parameters[:, :2], points[:, :2])
    return parameters, good


def noise_of(points: Points, options: RoofOptions) -> HeightNoise:
    """Estimate the noise from the fit of small planes: their median in each class of slopes.

    Parameters
    ----------
    points
        (n, 3) over one plan, or of one site [m].
    options
        The neighbourhood.
    """
    if len(points) <= LEAST_NEIGHBOURS:
        return HeightNoise(options.noise_m, 0.0, options.noise_m)
    parameters, rms, count = _small_fits(points, options, STEADY)
    slope2 = np.sum(parameters[:, :2] ** 2, axis=1)
    told = (count >= 2 * LEAST_NEIGHBOURS) & (slope2 <= np.tan(np.radians(options.steepest_deg)) ** 2)
    if told.sum() < 4 * LEAST_NEIGHBOURS:
        return HeightNoise(options.noise_m, 0.0, options.noise_m)
    order = np.flatnonzero(told)[np.argsort(slope2[told])]
    groups = np.array_split(order, CLASSES)
    design = np.array([[1.0, float(np.median(slope2[group]))] for group in groups])
    squares = np.array([float(np.median(rms[group] ** 2)) for group in groups])
    # heights of level roofs tell nothing of places: then the noise is as large in all directions
    rows = np.vstack([design, [WEAK, -WEAK]])
    vertical, horizontal = nnls(rows / np.append(squares, squares.mean())[:, None], np.append(np.ones(CLASSES), 0.0))[0]
    most = MOST_STATED * options.noise_m
    return HeightNoise(min(float(np.sqrt(vertical)), most), min(float(np.sqrt(horizontal)), most), options.noise_m)


def _fitted(design: Array, heights: Array, weights: Array) -> tuple[Array, Array]:
    """Solve all small least squares at once; lightly damped, so that places on one line have an answer, a poor one."""
    normal = np.einsum("nk,nki,nkj->nij", weights, design, design) + 1e-9 * np.eye(3)
    right = np.einsum("nk,nki,nk->ni", weights, design, heights)
    parameters = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
    residuals = heights - np.einsum("nkj,nj->nk", design, parameters)
    freedom = np.maximum(weights.sum(axis=1) - 3.0, 1.0)
    return parameters, np.sqrt(np.einsum("nk,nk->n", weights, residuals**2) / freedom)


def _grown(
    points: Points, small: Array, members: Array, free: Flags, options: RoofOptions, noise: HeightNoise
) -> tuple[RoofPlane | None, Array]:
    """Fit a plane to a cluster, and take all free points that lie in it and whose small planes are like it."""
    taken = members
    for _ in range(ROUNDS):
        if len(taken) < LEAST_NEIGHBOURS:
            return None, taken
        parameters = least_squares_plane(points[taken])
        sigma = float(noise.at(np.array([np.hypot(*parameters[:2])]))[0])
        slopes = TOLERANCE * sigma / options.neighbourhood_m
        off = np.abs(points[:, 2] - points[:, :2] @ parameters[:2] - parameters[2])
        alike = np.hypot(*(small[:, :2] - parameters[:2]).T) <= slopes
        taken = np.flatnonzero(free & alike & (off <= TOLERANCE * sigma))
    rms = float(np.sqrt(np.mean(off[taken] ** 2))) if len(taken) else np.inf
    return RoofPlane(parameters, len(members), len(taken), rms, sigma), taken


def _refined(
    points: Points, planes: Sequence[RoofPlane], labels: Array, options: RoofOptions, noise: HeightNoise
) -> tuple[Sequence[RoofPlane], Array]:
    """Give points without a plane, as those beside ridges, to the plane near them in which they lie best."""
    if not planes:
        return planes, labels
    known = labels >= 0
    off = np.abs(np.column_stack([points[:, 2] - plane.heights(points) for plane in planes]))
    sigmas = noise.at(np.array([np.hypot(*plane.parameters[:2]) for plane in planes]))
    distances, nearest = cKDTree(points[known, :2]).query(
        points[:, :2], k=min(MOST_NEIGHBOURS, int(known.sum())), distance_upper_bound=options.neighbourhood_m
    )
    near_labels = np.append(labels[known], -1)[np.where(np.isfinite(distances), nearest, -1)].reshape(len(points), -1)
    beside = np.stack([(near_labels == k).any(axis=1) for k in range(len(planes))], axis=1)
    fitting = np.where(beside, off, np.inf)
    best = np.argmin(fitting, axis=1)
    within = fitting[np.arange(len(points)), best] <= TOLERANCE * sigmas[best]
    labels = np.where(~known & within, best, labels)
    refined = []
    for k, plane in enumerate(planes):
        own = points[labels == k]
        parameters = least_squares_plane(own)
        rms = float(np.sqrt(np.mean((own[:, 2] - own[:, :2] @ parameters[:2] - parameters[2]) ** 2)))
        sigma = float(noise.at(np.hypot(*parameters[:2])[None])[0])
        refined.append(RoofPlane(parameters, plane.before, len(own), rms, sigma))
    return refined, labels


def _rest(points: Points, labels: Array, least: int, noise: HeightNoise) -> tuple[Sequence[RoofPlane], Array]:
    """Give horizontal planes to what is left, where it lies together: as the source does with parts without a face."""
    free = np.flatnonzero(labels < 0)
    labels, first = labels.copy(), int(labels.max()) + 1
    planes: list[RoofPlane] = []
    if len(free) < least:
        return planes, labels
    distances, _ = cKDTree(points[:, :2]).query(points[free, :2], k=LEAST_NEIGHBOURS)
    spacing = float(np.median(np.asarray(distances)[:, -1]))
    level = float(noise.at(np.zeros(1))[0])
    scaled = points[free] / np.array([LINKED * spacing, LINKED * spacing, TOLERANCE * level])
    pairs = cKDTree(scaled).query_pairs(1.0, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(free), len(free)))
    _, parts = connected_components(graph, directed=False)
    sizes = np.bincount(parts)
    for part in np.argsort(-sizes, kind="stable")[:MOST_FACES]:
        own = free[(parts == part) & (labels[free] < 0)]
        if len(own) < least:
            continue
        # parts of one level, as the sides of a parapet, are one
        own = free[(np.abs(points[free, 2] - np.median(points[own, 2])) <= TOLERANCE * level) & (labels[free] < 0)]
        if len(own) < least:
            continue
        heights = points[own, 2]
        labels[own] = first + len(planes)
        planes.append(RoofPlane(np.array([0.0, 0.0, float(heights.mean())]), 0, len(own), float(heights.std()), level))
    return planes, labels


def least_squares_plane(points: Points) -> Vector3:
    """Fit z = a x + b y + c to points, (3,)."""
    middle = points.mean(axis=0)
    slope = np.linalg.lstsq(points[:, :2] - middle[:2], points[:, 2] - middle[2])[0]
    return np.array([slope[0], slope[1], middle[2] - slope @ middle[:2]])


def least_points(points: Points, options: RoofOptions) -> int:
    """Give the points that the smallest face has, by the density of all."""
    tree = cKDTree(points[:, :2])
    sample = points[:: max(1, len(points) // 500), :2]
    counts = tree.query_ball_point(sample, options.neighbourhood_m, return_length=True)
    density = float(np.median(counts)) / (np.pi * options.neighbourhood_m**2)
    return max(LEAST_NEIGHBOURS, int(0.5 * density * options.least_area_m2))
