"""What rounded coordinates do to fitted planes: errors of offset and tilts that no residual shows.

A plane that is parallel to an axis of the file lies on one step, or on two: all its points share one error. One that is
inclined crosses steps; its error is a staircase, of which the adjustment of patch means sees a part. The means of the
patches have the covariance of `scans.rounding`, and the adjustment x = K y carries it on: C = K Σ Kᵀ.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float64, Int64

from algorithms.arrays import Array, Matrix, Points, Scalars, Vector3
from algorithms.scans.coordinate_steps import CoordinateSteps
from algorithms.scans.rounding import RoundedPieces, rounded_pieces

OFFSET_LOSS, TILT_LOSS = 0.1, 0.35
"""By how many steps over the whole length of a plane its inclination towards the steps is unknown (standard deviation).
For a plane on one step every inclination below a step over its length is possible, 0.3 to 0.4 of it on the average, and
all of it is the error of its tilt; its offset errs most where it is parallel, so for that it is taken to be."""
SEEMING_STEPS = 0.8
"""A plane that seems to cross some steps may cross so many fewer: one edge of a step near its rim does that."""
LARGEST_SCATTER_IN_STEPS = 0.25
"""Two steps, half of the points on each, have this variance in squared steps: the most that rounding adds."""
MOST_POINTS = 2000.0
"""Largest weight of a plane in the estimate of the scatter."""
NEGLIGIBLE = 1e-4
"""Shared errors of less than so many standard deviations of a point are none."""
ROUNDS, BISECTIONS = 3, 20
OTHER_SCATTER = 0.1
"""Relative uncertainty of the squared scatter of a plane by all else than its place between the steps."""
LEAST_COSINE = 0.1
"""Scatter that is there at grazing incidence too, as share of that of the ranges: little helps to average out steps."""
SURE_SCATTER = 0.7
"""So much of the estimated scatter is sure: what is left of rounding errors falls steeply with it."""
HARMLESS = 0.5
"""Steps below that many standard deviations of points do no harm: rounded noise of that size averages out."""


@dataclass(frozen=True, eq=False)
class PatchRounding:
    """Errors by rounding that the patches of k planes share."""

    coordinates: tuple[RoundedPieces, ...]
    """Of all patches, one for each rounded coordinate that matters."""
    places: Array
    """(p, 2) place of each patch in its plane, in lengths of the plane."""
    variances: Scalars
    """(p,) variance of each patch mean by them [m2]."""

    def plane_covariance(self, start: int, end: int, jacobian: Matrix, variances: Scalars) -> Array:
        """Give the covariance (3, 3) of (a1, a2, b) of the plane with the patches from `start` to `end`.

        Parameters
        ----------
        start, end
            Its patches.
        jacobian, variances
            As it was adjusted: (p, 3) derivatives and (p,) variances of the patch means.
        """
        covariance = np.zeros((3, 3))
        if not self.variances[start:end].any():
            return covariance
        scale = np.maximum(np.sqrt(np.mean(np.square(jacobian), axis=0)), 1e-12)
        scaled = jacobian / scale
        weighted = scaled.T / variances
        normal = weighted @ scaled
        gain = np.linalg.solve(normal + 1e-12 * np.trace(normal) * np.eye(3), weighted) / scale[:, None]
        apart = np.square(self.places[start:end, None] - self.places[None, start:end]).sum(axis=2)
        for own in self.coordinates:
            part = RoundedPieces(own.step_m, own.places[start:end], own.slopes[start:end], own.damping[start:end])
            covariance[:2, :2] += (gain @ part.covariance(TILT_LOSS**2 * apart) @ gain.T)[:2, :2]
            crossed = float(np.ptp(part.places))
            flatter = replace(part, places=part.places * max(0.0, 1.0 - SEEMING_STEPS / max(crossed, SEEMING_STEPS)))
            covariance[2, 2] += (gain @ flatter.covariance(OFFSET_LOSS**2 * apart) @ gain.T)[2, 2]
        return covariance


def patch_rounding(
    steps: CoordinateSteps,
    frames: Float64[Array, "k 13"],
    sums: Float64[Array, "p 5"],
    splits: Int64[Array, "splits"],
    sizes: Float64[Array, "k 2"],
    sensor_m: Vector3 | None,
) -> PatchRounding:
    """Say what errors by rounding the patches of planes share.

    Parameters
    ----------
    steps
        Of the scan's coordinates.
    frames
        The planes: normal, centroid, E1, E2, tolerance.
    sums
        Count, u, v, residual, squared residual of all occupied patches, plane by plane.
    splits
        Where the patches of each plane begin.
    sizes
        (k, 2) sides of the patches [m].
    sensor_m
        Where the instrument stood; without it points scatter alike whatever the incidence.
    """
    counts = np.diff(splits)
    owner = np.repeat(np.arange(len(counts)), counts)
    n = sums[:, 0]
    within = sums[:, 4] - np.square(sums[:, 3]) / n
    places = sums[:, 1:3] / n[:, None]
    normals, e1, e2 = frames[owner, :3], frames[owner, 6:9], frames[owner, 9:12]
    positions = frames[owner, 3:6] + places[:, :1] * e1 + places[:, 1:] * e2
    extents = np.stack([e1 * sizes[owner, :1], e2 * sizes[owner, 1:]], axis=1)
    spare = np.bincount(owner, n - 1.0, minlength=len(counts))
    scatter2 = np.bincount(owner, within, minlength=len(counts)) / np.maximum(spare, 1.0)
    if steps.largest_m < HARMLESS * np.sqrt(float(np.quantile(scatter2, 0.25)) if len(scatter2) else 0.0):
        return PatchRounding((), places, np.zeros(len(n)))
    cosines2 = _cosines2(positions, normals, sensor_m)

    def meet(scatter_m: Array) -> list[RoundedPieces]:
        return rounded_pieces(steps, positions, normals, extents, scatter_m, sensor_m)

    spans = [np.ptp(places[a:b], axis=0) if b > a else np.zeros(2) for a, b in pairwise(splits)]
    lengths = np.maximum(np.array(spans).reshape(-1, 2), 1e-9)
    scatter = _scatter(meet, owner, scatter2, np.minimum(spare, MOST_POINTS), cosines2)
    met = meet(SURE_SCATTER * scatter * np.sqrt(cosines2))
    coordinates = tuple(own for own in met if own.damping.any())
    variances = np.sum([own.variances for own in coordinates], axis=0) if coordinates else np.zeros(len(n))
    matters = variances > np.square(NEGLIGIBLE) * np.maximum(scatter2, 0.0)[owner]
    return PatchRounding(coordinates if matters.any() else (), places / lengths[owner], np.where(matters, variances, 0))


def _cosines2(positions: Points, normals: Points, sensor_m: Vector3 | None) -> Scalars:
    """Give which share of the variance of ranges shows across the surface, (p,)."""
    if sensor_m is None:
        return np.ones(len(positions))
    rays = positions - sensor_m
    squares = np.maximum(np.einsum("pi,pi->p", rays, rays), 1e-18)
    return np.asarray(np.square(np.einsum("pi,pi->p", rays, normals)) / squares + LEAST_COSINE**2)


def _scatter(
    meet: Callable[[Array], list[RoundedPieces]],
    owner: Int64[Array, "p"],
    scatter2: Float64[Array, "k"],
    counts: Float64[Array, "k"],
    shares: Scalars,
) -> float:
    """Estimate the standard deviation of ranges before coordinates were rounded [m], from all planes together.

    Points scatter about their patch mean by σ² c + Σ n² s²/12 less the variance of that mean, on the average over all
    places of a plane between the steps. One plane that lies on them may scatter by anything from nothing to half a
    step, so planes that cross them count most. Rough surfaces count no more than rounding can make them scatter.
    """
    patches = np.maximum(np.bincount(owner, minlength=len(counts)), 1)

    def by_plane(values: Array) -> Array:
        return np.asarray(np.bincount(owner, values, minlength=len(counts)) / patches)

    def expected(scatter: float) -> tuple[Array, Array]:
        """Give the expected squared scatter of each plane, and by how much it may differ by its place."""
        met = meet(scatter * np.sqrt(shares))
        rounded, shared = np.zeros(len(owner)), np.zeros(len(owner))
        for own in met:
            rounded += np.square(own.slopes * own.step_m) / 12.0 - own.variances
            shared += np.abs(own.slopes) * own.step_m * np.sqrt(own.variances / 12.0)
        return by_plane(scatter**2 * shares + rounded), by_plane(shared)

    if not counts.any():
        return 0.0
    largest = np.sum([LARGEST_SCATTER_IN_STEPS * np.square(own.slopes * own.step_m) for own in meet(0.0 * shares)], 0)
    seen = np.minimum(scatter2, np.median(scatter2) + by_plane(largest))
    found = 0.0
    for _ in range(ROUNDS):
        mean, by_place = expected(found)
        weights = counts / np.square(OTHER_SCATTER * (mean + seen) + by_place + 1e-18)
        low, high = 0.0, 2.0 * float(np.sqrt(np.average(seen, weights=weights))) + 1e-12
        for _ in range(BISECTIONS):
            found = 0.5 * (low + high)
            if float(weights @ (expected(found)[0] - seen)) < 0.0:
                low = found
            else:
                high = found
    return found
