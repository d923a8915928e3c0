"""The allowed heights of the slope filter, learned from terrain whose ground is known (Vosselman 2000)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64

from algorithms.arrays import Array, Flags, Points
from algorithms.errors import InvalidInputError
from algorithms.progress import Progress, ProgressSection
from algorithms.terrain.filters.slope import added_slopes
from algorithms.terrain.low_points import low_points
from algorithms.terrain.neighbours import sorted_into_cells
from algorithms.terrain.neighbours_kernels import drops_by_distance
from algorithms.terrain.options import SlopeFilter

RINGS = 30
"""In which the height over the lowest point is looked at, one allowed height a ring."""
MOST_POINTS = 20_000
"""Points of each terrain that are classified."""
SWEEPS = 20
OFFSETS_M, TANGENTS = (0.15, 0.3, 0.5, 0.8), np.geomspace(0.05, 2.0, 15)
"""Of the straight lines to begin with."""
LEAST_POINTS = 100
"""Of ground, and of objects."""
CELLS_ALONG_RADIUS = 5


@dataclass(frozen=True, eq=False)
class LabelledTerrain:
    """A cloud of which one knows what lies on the ground."""

    points: Points
    """(n, 3) [m]."""
    ground: Flags
    """(n,)."""

    def selected(self, which: Flags) -> "LabelledTerrain":
        """Keep some points."""
        return LabelledTerrain(self.points[which], self.ground[which])


def learned_slope(
    terrains: Sequence[LabelledTerrain], options: SlopeFilter, cell_m: float, progress: Progress
) -> SlopeFilter:
    """Learn the allowed heights with which the filter puts the fewest points into the wrong class.

    A point is ground if in every ring around it the lowest point lies below it by no more than the ring's height.
    From the best straight line on, one height after the other is set where the fewest points are wrong, never below
    that of a ring inside nor above that of one outside, until nothing changes.

    Parameters
    ----------
    terrains
        What is known.
    options
        Radius, and whether slopes of a rough model are added.
    cell_m
        Edge of the cells of that model [m].
    progress
        Of reading the terrains.

    Returns
    -------
    The filter with `allowed_m`.

    Raises
    ------
    InvalidInputError
        Too few points of either class.
    """
    # points far below are no part of what the filter sees
    terrains = [each.selected(~low_points(each.points)) for each in terrains]
    chosen = [np.arange(0, len(each.points), max(1, -(-len(each.points) // MOST_POINTS))) for each in terrains]
    ground = np.concatenate([each.ground[which] for each, which in zip(terrains, chosen, strict=True)])
    for count, what in ((int(ground.sum()), "ground"), (int((~ground).sum()), "objects")):
        if count < LEAST_POINTS:
            raise InvalidInputError("training", f"it has {count} points of {what}", f"give at least {LEAST_POINTS}")
    drops = np.concatenate(
        [
            _drops(each.points, which, options, cell_m, ProgressSection(progress, k / len(terrains), 1.0))
            for k, (each, which) in enumerate(zip(terrains, chosen, strict=True))
        ]
    )
    middles = (np.arange(RINGS) + 0.5) * (options.radius_m / RINGS)
    lines = [offset + tangent * middles for offset in OFFSETS_M for tangent in TANGENTS]
    errors = [int(((drops <= line).all(axis=1) != ground).sum()) for line in lines]
    heights = fewest_errors(drops, ground, lines[int(np.argmin(errors))])
    # from the middles of the rings to their borders
    borders = np.concatenate([heights[:1], 0.5 * (heights[1:] + heights[:-1]), heights[-1:]])
    return replace(options, allowed_m=tuple(borders.tolist()))


def fewest_errors(
    drops: Float64[Array, "m rings"], ground: Bool[Array, "m"], start: Float64[Array, "rings"]
) -> Float64[Array, "rings"]:
    """Give heights that do not fall from ring to ring, and by which the fewest points are in the wrong class.

    Parameters
    ----------
    drops
        Heights of points over the lowest in each ring [m]; minus infinity where there is none.
    ground
        Which are on the ground.
    start
        Heights to begin with [m].
    """
    heights = start.copy()
    order = np.argsort(drops, axis=0)
    over = (drops > heights).sum(axis=1)
    for _ in range(SWEEPS):
        before = heights.copy()
        for ring in range(len(heights)):
            own = drops[:, ring]
            others = over - (own > heights[ring])
            asked = order[:, ring]
            asked = asked[(others[asked] == 0) & np.isfinite(own[asked])]
            # wrong with a height just at each of the points: ground over it, objects not over it
            right = np.where(ground[asked], -1, 1)
            wrong = np.concatenate([[0], np.cumsum(right)])
            limits = np.concatenate([own[asked], [np.inf]])
            low = heights[ring - 1] if ring else 0.0
            high = heights[ring + 1] if ring + 1 < len(heights) else np.inf
            first, last = np.searchsorted(own[asked], [low, high], side="right")
            best = first + int(np.argmin(wrong[first : last + 1]))
            # between the last point that passes and the first that does not
            below = max(low, limits[best - 1]) if best > 0 else low
            heights[ring] = 0.5 * (below + min(high, limits[best])) if np.isfinite(min(high, limits[best])) else below
            over = others + (own > heights[ring])
        if np.array_equal(before, heights):
            break
    return heights


def _drops(
    points: Points, wanted: Array, options: SlopeFilter, cell_m: float, progress: Progress
) -> Float64[Array, "m rings"]:
    extra = added_slopes(points, options, cell_m, progress)
    cells = sorted_into_cells(points, options.radius_m / CELLS_ALONG_RADIUS)
    found = drops_by_distance(
        cells.points, cells.cells, cells.starts, cells.grid.columns, cells.grid.cell_m, options.radius_m / RINGS, RINGS,
        np.argsort(cells.order)[wanted], extra[cells.order],
    )  # fmt: skip
    return np.where(np.isnan(found), -np.inf, found)
