"""Where did the instrument stand? Found from the cloud alone.

From its true position a scan (nearly) never sees two surfaces in one direction. The further another position is away,
the more surfaces hide each other. So the position with the smallest share of hidden points is the instrument's. Where
little stands about, as in an open square, many positions hide nothing; but only from the instrument's, which measured
in steps of equal angles, are all directions seen equally densely: elsewhere points crowd in some of them.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Points, Vector3
from algorithms.scans.sensor_position_raster import NEAREST_SURFACE_M, positions_near_surface
from algorithms.scans.sensor_position_spread import position_std

MAX_HIDDEN_SHARE = 0.22
"""Above this share of hidden points no position explains the cloud as one set-up. True positions: 0.00 to 0.14."""
CROWDING = 0.05
"""What a point that is not alone in its direction counts, a hidden one being 1: it decides where nothing is hidden, and
hardly where thinning has made the density of all surfaces the same."""
FAR_FROM_SURFACE_M = 10.0
"""A given position is not tried when no surface is nearer: the origin of a moved cloud is no instrument [m]."""
KEPT_SHARE, LEAST_KEPT = 0.125, 200
"""Of the raster's positions so many pass the first sifting."""
STARTS, LEAST_STARTS = 8, 2
"""Distinct positions from which the search goes downhill; with every halving of its steps the worse half is dropped."""
LAST_STEP_M = 0.04
"""The search ends where its steps would not be longer [m]."""
SAME_POSITION_M = 1.0
"""The origin of another frame is seldom so near to where the instrument stood [m]."""
MIN_POINTS = 200


@dataclass(frozen=True)
class Resolution:
    """How closely a position is looked at."""

    points: int
    """Points of the cloud that are used."""
    cells: int
    """Directions are binned in cells x cells: in as many as there are points, or more."""


SIFTING, COARSE = Resolution(1_000, 28), Resolution(8_000, 80)
"""Most positions of the raster are sorted out with few points."""
MIDDLE, FINE = Resolution(10_000, 150), Resolution(40_000, 300)
"""The search goes downhill with few points while more than `LEAST_STARTS` positions are left."""


@dataclass(frozen=True, eq=False)
class SensorEstimate:
    """The instrument's position, and how well the cloud tells it."""

    position_m: Vector3 | None
    """Position in the frame of the points [m]; None when no credible position was found."""
    hidden_share: float
    """Share of points hidden behind others, seen from there (0 is perfect)."""
    std_m: float | None = None
    """Standard deviation of the position, all directions together [m] (`sensor_position_spread`); None without one."""
    confirms_candidate: bool = False
    """Whether the search itself, the candidate left aside, comes down beside it: the position is the candidate then."""


@dataclass(frozen=True, eq=False)
class _Cloud:
    """Points as the compiled loop wants them: coordinate by coordinate, about their middle, in single precision."""

    middle_m: Vector3
    coordinates: Array
    """(3, n) float32 [m]."""
    normals: Array
    """(3, n) float32."""
    known: Array
    """(n,) whether there is a normal."""
    cells: int
    spacing_m: float

    def seen_from(self, positions: Array) -> Array:
        """Give for each of m positions the shares of points that are hidden and that are not alone in their direction,
        and the distance of the nearest one [m], (m, 3).
        """
        from algorithms.scans import sensor_position_kernels as kernels
        from algorithms.scans.point_blocks import over_blocks

        found = np.empty((len(positions), 3))
        eyes = np.asarray(positions - self.middle_m, dtype=np.float32)

        def work(start: int, end: int) -> None:
            kernels.look_around(
                self.coordinates, self.normals, self.known, eyes, self.cells, self.spacing_m, start, end, found
            )

        over_blocks(work, len(positions), least=1)
        return found

    def costs(self, positions: Array) -> Array:
        """Give for each of m positions how much speaks against it, (m,)."""
        return np.asarray(self.seen_from(positions)[:, :2] @ (1.0, CROWDING))

    def costs_near_surface(self, positions: Array) -> Array:
        """Give the same, infinite where no instrument can stand."""
        found = self.seen_from(positions)
        stands = (found[:, 2] > NEAREST_SURFACE_M[0]) & (found[:, 2] < NEAREST_SURFACE_M[1])
        return np.where(stands, found[:, :2] @ (1.0, CROWDING), np.inf)


def _cloud(points: Points, normals: Points, cells: int, spacing_m: float) -> _Cloud:
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return _Cloud(
        middle,
        np.ascontiguousarray((points - middle).T, dtype=np.float32),
        np.ascontiguousarray(normals.T, dtype=np.float32),
        np.any(normals != 0.0, axis=1),
        cells,
        spacing_m,
    )


def hidden_shares(points: Points, normals: Points, positions: Array, *, cells: int, spacing_m: float) -> Array:
    """Give for each position the share of points hidden behind a nearer surface.

    Parameters
    ----------
    points
        (n, 3) thinned points [m].
    normals
        (n, 3) unit normals of any sign, zero where unknown.
    positions
        (m, 3) eye points [m].
    cells
        Directions are binned on an octahedron, unfolded to a square of cells x cells.
    spacing_m
        Spacing of the points [m].

    Returns
    -------
    (m,) shares, 0..1.
    """
    return np.asarray(_cloud(points, normals, cells, spacing_m).seen_from(positions)[:, 0])


def estimate_sensor_position(
    points: Points, normals: Points, *, candidate_m: Vector3 | None = None, rng: np.random.Generator
) -> SensorEstimate:
    """Find the position from which the fewest points of a scan hide behind others or crowd in one direction.

    A raster of positions is sifted with few points, what passes is ranked with more, and from the best distinct ones
    the search goes downhill, with up to `FINE.points` in the end.

    Parameters
    ----------
    points
        (n, 3) points of one scan, as densely as they were measured [m]: their density in every direction counts.
    normals
        (n, 3) unit normals of any sign, zero where unknown.
    candidate_m
        A position that is likely, e.g. the origin of the file: taken if no other is clearly better, or it is near the
        best one.
    rng
        Draws the subsets of points and the offsets of the raster of positions.

    Returns
    -------
    Estimate; `position_m` is None when the points are too few or no position is credible.
    """
    if len(points) < MIN_POINTS:
        return SensorEstimate(None, 1.0)
    drawn = np.sort(rng.permutation(len(points))[: FINE.points])
    points, normals = points[drawn], normals[drawn]
    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
    spacing = 1.3 * float(np.median(np.asarray(tree.query(points[::7], k=2)[0])[:, 1]))
    order = rng.permutation(len(points))

    def cloud(resolution: Resolution, spacing_m: float) -> _Cloud:
        used = np.sort(order[: resolution.points])
        return _cloud(points[used], normals[used], resolution.cells, spacing_m)

    if spacing > NEAREST_SURFACE_M[1]:  # nothing could be said of how near to a surface a position is
        return SensorEstimate(None, 1.0)
    raster, step = positions_near_surface(points, tree, rng)
    if len(raster) == 0:
        return SensorEstimate(None, 1.0)
    kept = max(LEAST_KEPT, int(KEPT_SHARE * len(raster)))
    sifted = np.argsort(cloud(SIFTING, 1.3 * spacing).costs(raster), kind="stable")[:kept]
    raster = raster[np.sort(sifted)]
    costs = cloud(COARSE, 1.3 * spacing).costs(raster)
    fine = cloud(FINE, spacing)
    starts = raster[_distinct(raster, costs, apart_m=1.5 * step, most=STARTS)]
    minima, minima_costs = _downhill(cloud(MIDDLE, 1.3 * spacing), fine, starts, 0.5 * step)
    best = minima[0]
    best_share = float(fine.seen_from(best[None])[0, 0])
    std = position_std(fine.costs_near_surface, minima, minima_costs)
    confirmed = False
    if candidate_m is not None:
        share, _, nearest = fine.seen_from(candidate_m[None])[0].tolist()
        # The file's own origin needs only be about as good as the best of thousands of tried positions.
        near = float(np.linalg.norm(candidate_m - best)) <= SAME_POSITION_M and share <= MAX_HIDDEN_SHARE
        good = near or share <= 1.5 * best_share + 0.01
        if good and NEAREST_SURFACE_M[0] < nearest < FAR_FROM_SURFACE_M:
            best_share, best, confirmed = share, candidate_m, near
    if best_share > MAX_HIDDEN_SHARE:
        return SensorEstimate(None, best_share)
    return SensorEstimate(np.asarray(best, dtype=np.float64), best_share, std, confirmed)


def _distinct(positions: Array, costs: Array, *, apart_m: float, most: int) -> list[int]:
    """Pick the positions of the smallest costs that lie apart from each other."""
    chosen: list[int] = []
    for k in np.argsort(costs, kind="stable"):
        if all(np.linalg.norm(positions[k] - positions[j]) > apart_m for j in chosen):
            chosen.append(int(k))
            if len(chosen) == most:
                break
    return chosen


_AROUND = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]) / np.sqrt(3.0)


def _downhill(middle: _Cloud, fine: _Cloud, starts: Array, step: float) -> tuple[Array, Array]:
    """Walk downhill from (k, 3) starts in ever smaller steps, with ever fewer of them: a count has no derivative.

    Gives where the walks ended, those that were given up too, and the costs there, the best of the last ones first.
    """
    given_up, their_costs = [np.empty((0, 3))], [np.empty(0)]
    while True:
        few = len(starts) <= LEAST_STARTS
        found = np.array([_walk(fine if few else middle, start, step) for start in starts])
        costs = fine.costs(found)
        order = np.argsort(costs, kind="stable")
        found, costs = found[order], costs[order]
        step *= 0.5
        if step <= LAST_STEP_M:
            return np.concatenate([found, *given_up]), np.concatenate([costs, *their_costs])
        kept = max(len(found) // 2, LEAST_STARTS)
        given_up.append(found[kept:])
        their_costs.append(costs[kept:])
        starts = found[:kept]


def _walk(cloud: _Cloud, start: Vector3, step: float) -> Vector3:
    """Go to the best position around as long as that is better."""
    best, least = start, float(cloud.costs(start[None])[0])
    while True:
        around = best + step * _AROUND
        costs = cloud.costs_near_surface(around)
        k = int(np.argmin(costs))
        if costs[k] >= least:
            return best
        best, least = around[k], float(costs[k])
