"""Where did the instrument stand? Found from the cloud alone.

From its true position a scan (nearly) never sees two surfaces in one direction. The further another position is away,
the more surfaces hide each other. So the position with the smallest share of hidden points is the instrument's.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Points, Vector3

MAX_HIDDEN_SHARE = 0.22
"""Above this share of hidden points no position explains the cloud as one set-up. True positions: 0.00 to 0.14."""
NEAREST_SURFACE_M = (0.05, 3.5)
"""A terrestrial instrument stands on something: its nearest measured surface is within these bounds [m]. Without this
bound a bird's-eye view of a street explains the cloud as well as the true position does."""
FAR_FROM_SURFACE_M = 10.0
"""A given position is not tried when no surface is nearer: the origin of a moved cloud is no instrument [m]."""
COARSE_CELLS, FINE_CELLS = 32, 96
COARSE_POINTS, FINE_POINTS = 8_000, 40_000
MAX_CANDIDATES = 4_000
MIN_POINTS = 200


@dataclass(frozen=True, eq=False)
class SensorEstimate:
    """The instrument's position, and how well the cloud tells it."""

    position_m: Vector3 | None
    """Position in the frame of the points [m]; None when no credible position was found."""
    hidden_share: float
    """Share of points hidden behind others, seen from there (0 is perfect)."""
    runner_up_share: float
    """The same for the best position clearly elsewhere; 1 if there is none."""
    spread_m: float
    """Rms distance to the other tried positions that explain the cloud nearly as well [m]: a measure of uncertainty."""
    confidence: float
    """0 (any other position explains the cloud as well) to 1 (none does)."""


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
        Directions are binned on a cube of 6 faces with cells x cells.
    spacing_m
        Spacing of the points [m].

    Returns
    -------
    (m,) shares, 0..1.
    """
    from algorithms.scans import sensor_position_kernels as kernels
    from algorithms.scans.point_blocks import over_blocks

    shares = np.empty(len(positions))
    points, normals = np.ascontiguousarray(points), np.ascontiguousarray(normals)
    positions = np.ascontiguousarray(positions)

    def work(start: int, end: int) -> None:
        kernels.hidden_shares(points, normals, positions, cells, spacing_m, start, end, shares)

    over_blocks(work, len(positions), least=1)
    return shares


def estimate_sensor_position(
    points: Points, normals: Points, *, candidate_m: Vector3 | None = None, rng: np.random.Generator
) -> SensorEstimate:
    """Find the position from which the fewest points of a scan hide behind others.

    Parameters
    ----------
    points
        (n, 3) points of one scan, thinned to about equal spacing [m].
    normals
        (n, 3) unit normals of any sign, zero where unknown.
    candidate_m
        A position to try first, e.g. the origin of the file: taken if no other is clearly better.
    rng
        Draws the subsets of points and the offsets of the raster of positions.

    Returns
    -------
    Estimate; `position_m` is None when the points are too few or no position is credible.
    """
    if len(points) < MIN_POINTS:
        return SensorEstimate(None, 1.0, 1.0, np.inf, 0.0)
    fine = np.sort(rng.permutation(len(points))[:FINE_POINTS])
    points, normals = points[fine], normals[fine]
    tree = cKDTree(points)
    spacing = 1.3 * float(np.median(np.asarray(tree.query(points[::7], k=2)[0])[:, 1]))
    coarse = np.sort(rng.permutation(len(points))[:COARSE_POINTS])

    low, high = points.min(axis=0), points.max(axis=0)
    step = float(np.clip((np.prod(high - low + 1.0) / 6000.0) ** (1.0 / 3.0), 0.4, 2.0))
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    raster = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    raster = raster + rng.uniform(-0.3, 0.3, size=raster.shape) * step
    nearest = np.asarray(tree.query(raster)[0])
    # A raster point may be half a step nearer or farther than the position it stands for.
    raster = raster[(nearest > NEAREST_SURFACE_M[0]) & (nearest < NEAREST_SURFACE_M[1] + 0.5 * step)]
    if len(raster) > MAX_CANDIDATES:
        raster = raster[np.sort(rng.permutation(len(raster))[:MAX_CANDIDATES])]
    if len(raster) == 0:
        return SensorEstimate(None, 1.0, 1.0, np.inf, 0.0)
    shares = hidden_shares(points[coarse], normals[coarse], raster, cells=COARSE_CELLS, spacing_m=1.3 * spacing)
    starts = [raster[k] for k in _distinct(raster, shares, apart_m=1.5 * step, most=12)]
    trials: list[tuple[Array, Array]] = []
    refined = [_refine(points, normals, tree, (start, 0.5 * step, spacing), trials) for start in starts]
    refined.sort(key=lambda item: item[0])
    best_share, best = refined[0]
    if candidate_m is not None and NEAREST_SURFACE_M[0] < float(tree.query(candidate_m)[0]) < FAR_FROM_SURFACE_M:
        share = float(hidden_shares(points, normals, candidate_m[None], cells=FINE_CELLS, spacing_m=spacing)[0])
        # The file's own origin needs only be about as good as the best of thousands of tried positions.
        if share <= 1.5 * best_share + 0.01:
            best_share, best = share, candidate_m
    if best_share > MAX_HIDDEN_SHARE:
        return SensorEstimate(None, best_share, best_share, np.inf, 0.0)
    elsewhere = [share for share, position in refined if np.linalg.norm(position - best) > max(1.0, 1.5 * step)]
    runner_up = min(elsewhere, default=1.0)
    positions = np.concatenate([positions for positions, _ in trials] or [best[None]])
    all_shares = np.concatenate([shares for _, shares in trials] or [np.array([best_share])])
    as_good = all_shares <= 1.2 * best_share + 0.002
    spread = float(np.sqrt(np.mean(np.sum((positions[as_good] - best) ** 2, axis=1)))) if as_good.any() else 0.0
    confidence = float(np.clip((runner_up - best_share) / (runner_up + 0.01), 0.0, 1.0))
    return SensorEstimate(np.asarray(best, dtype=np.float64), best_share, runner_up, spread, confidence)


def _distinct(positions: Array, shares: Array, *, apart_m: float, most: int) -> list[int]:
    """Pick the positions with the smallest shares that lie apart from each other."""
    chosen: list[int] = []
    for k in np.argsort(shares, kind="stable"):
        if all(np.linalg.norm(positions[k] - positions[j]) > apart_m for j in chosen):
            chosen.append(int(k))
            if len(chosen) == most:
                break
    return chosen


_COMPASS = np.array(
    [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
    + [[a, b, c] for a in (-0.6, 0.6) for b in (-0.6, 0.6) for c in (-0.6, 0.6)],
    dtype=np.float64,
)


def _refine(
    points: Points,
    normals: Points,
    tree: "cKDTree[None]",
    start: tuple[Vector3, float, float],
    trials: list[tuple[Array, Array]],
) -> tuple[float, Vector3]:
    """Walk downhill from `start` (position, first step, spacing) in ever smaller steps: a count has no derivative."""
    best, step, spacing_m = start
    best_share = float(hidden_shares(points, normals, best[None], cells=FINE_CELLS, spacing_m=spacing_m)[0])
    while step > 0.04:
        around = best + step * _COMPASS
        nearest = np.asarray(tree.query(around)[0])
        around = around[(nearest > NEAREST_SURFACE_M[0]) & (nearest < NEAREST_SURFACE_M[1])]
        if len(around):
            shares = hidden_shares(points, normals, around, cells=FINE_CELLS, spacing_m=spacing_m)
            trials.append((around, shares))
            k = int(np.argmin(shares))
            if shares[k] < best_share:
                best, best_share = around[k], float(shares[k])
                continue
        step *= 0.5
    return best_share, best
