"""Ground and objects by any filter, and how filters agree."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from algorithms.arrays import Flags, Points
from algorithms.errors import InvalidInputError
from algorithms.progress import Progress
from algorithms.terrain.filters.block_min import block_min
from algorithms.terrain.filters.dual_rank import dual_rank
from algorithms.terrain.filters.hierarchical import hierarchical
from algorithms.terrain.filters.hull import hull
from algorithms.terrain.filters.local_plane import local_plane
from algorithms.terrain.filters.majority import majority
from algorithms.terrain.filters.mdl import mdl
from algorithms.terrain.filters.membrane import membrane
from algorithms.terrain.filters.opening import opening
from algorithms.terrain.filters.quantile import quantile
from algorithms.terrain.filters.robust import robust
from algorithms.terrain.filters.slope import slope
from algorithms.terrain.filters.spline import spline
from algorithms.terrain.filters.tin import tin
from algorithms.terrain.low_points import low_points
from algorithms.terrain.options import TerrainFilter

LEAST_POINTS = 10
"""Of a cloud."""
FILTERS: Mapping[str, Callable[[Points, Any, float, Progress], Flags]] = {
    "opening": opening,
    "slope": slope,
    "tin": tin,
    "robust": robust,
    "hierarchical": hierarchical,
    "dual-rank": dual_rank,
    "block-min": block_min,
    "quantile": quantile,
    "membrane": membrane,
    "local-plane": local_plane,
    "spline": spline,
    "hull": hull,
    "mdl": mdl,
    "majority": majority,
}
"""What each filter of `TerrainFilter` runs."""


@dataclass(frozen=True, eq=False)
class Ground:
    """What the points of a cloud lie on."""

    ground: Flags
    """(n,) True for the ground."""
    low: Flags
    """(n,) True for points far below it."""


def ground_of(points: Points, chosen: TerrainFilter, cell_m: float, progress: Progress) -> Ground:
    """Tell the points on the ground from those on objects and from those below.

    Parameters
    ----------
    points
        (n, 3), z upwards [m].
    chosen
        The filter.
    cell_m
        Edge of the cells [m].
    progress
        Of the filter.

    Raises
    ------
    InvalidInputError
        Too few points, too many cells, or no ground was found.
    """
    if len(points) < LEAST_POINTS:
        raise InvalidInputError("terrain", f"{len(points)} points make no terrain", "give more points")
    low = low_points(points)
    kept = np.flatnonzero(~low)
    ground = np.zeros(len(points), dtype=np.bool_)
    ground[kept] = FILTERS[chosen.name](points[kept], chosen, cell_m, progress)
    if not ground.any():
        raise InvalidInputError("terrain", f"the filter '{chosen.name}' found no ground", "take another one")
    return Ground(ground, low)


def kappa(first: Flags, second: Flags) -> float:
    """Give Cohen's kappa of two classifications: 1 where they agree, 0 where they agree as by chance."""
    n = len(first)
    observed = float((first == second).mean())
    one, other = float(first.sum()) / n, float(second.sum()) / n
    expected = one * other + (1.0 - one) * (1.0 - other)
    return 1.0 if expected == 1.0 else (observed - expected) / (1.0 - expected)


@dataclass(frozen=True)
class FilterRow:
    """What one filter says beside another."""

    name: str
    ground: int
    """Points on the ground."""
    kappa: float
    """Agreement with the chosen filter."""
    only_here: int
    """Points that it alone of the two calls ground."""
    only_chosen: int
    """Points that the chosen filter alone calls ground."""


def row_beside(name: str, found: Ground, chosen: Ground) -> FilterRow:
    """Compare the ground of a filter with that of the chosen one."""
    return FilterRow(
        name=name,
        ground=int(found.ground.sum()),
        kappa=kappa(found.ground, chosen.ground),
        only_here=int((found.ground & ~chosen.ground).sum()),
        only_chosen=int((chosen.ground & ~found.ground).sum()),
    )
