"""Ground plans from points alone: what stands above the terrain and is made of planes (Rottensteiner's first steps).

A surface model less a terrain model tells what is high, local planes tell roofs from trees (Jansa and Stanek 2003). The
outlines are squared to their own main direction.
"""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import binary_closing, binary_dilation, binary_opening, label
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Flags, Points
from algorithms.errors import InvalidInputError
from algorithms.progress import NoProgress
from algorithms.roofs.options import RoofOptions
from algorithms.roofs.partition import area_of
from algorithms.roofs.planes import noise_of, small_planes
from algorithms.roofs.surroundings import share_above
from algorithms.terrain.cell_heights import cells_over, heights_on
from algorithms.terrain.filters.opening import opened_terrain

CELL_SPACINGS = 1.5
PLANE_SHARE = 0.25
"""Of the points of a cell on a roof so many lie in local planes; at ridges and eaves fewer, in trees hardly any."""
LARGEST_BUILDING_M, STEEPEST_GROUND = 60.0, 0.15
"""What is narrower and stands out of the lowest points by more than this slope times half its width is no terrain."""
LEAST_RIM = 0.5
"""A plan stands above its surroundings along so much of its rim."""
CORNER_CELLS = 1.5
"""Corners of a rim count that lie so many cells off the line of the others."""
LEAST_SIDE_CELLS = 2.0
RIM_CELLS, AROUND_CELLS = 2, 4
"""High points so near to local planes are of the roof; points so near are looked at for its sides."""
TURNS_DEG = (8.0, 1.0), (1.0, 0.1)
"""Within so much of the first direction, in such steps, the one whose sides part high points best is sought."""
REACH_CELLS = 2.0
"""A side is moved at most so many cells."""
OUTERMOST = 0.98
"""The place of a side is this quantile of the points beside it."""


def found_outlines(
    points: Points, options: RoofOptions, least_area_m2: float
) -> tuple[Sequence[Array], Sequence[float]]:
    """Find ground plans.

    Parameters
    ----------
    points
        (n, 3) of a site with its ground; x and y near the origin [m].
    options
        What counts as a roof.
    least_area_m2
        Smaller plans are left out [m²].

    Returns
    -------
    Outlines (k, 2) [m], and the height of the ground at each [m]; largest first.

    Raises
    ------
    InvalidInputError
        Nothing stands above the ground that is large and plane enough.
    """
    spacing, _ = cKDTree(points[:, :2]).query(points[:: max(1, len(points) // 2000), :2], k=7)
    cell = CELL_SPACINGS * float(np.median(np.asarray(spacing)[:, -1])) * np.sqrt(np.pi / 7.0)
    grid = cells_over(points, cell)
    flat = grid.cells_of(points)
    terrain = opened_terrain(points, grid, 0.5 * LARGEST_BUILDING_M, STEEPEST_GROUND, NoProgress())
    above = points[:, 2] - heights_on(terrain, grid, points)
    high = above > options.least_height_m
    _, plane = small_planes(points, options, noise_of(points[high], options))
    size = grid.rows * grid.columns
    counts = np.bincount(flat, minlength=size)
    roofs = np.bincount(flat, high & plane, minlength=size) >= PLANE_SHARE * np.maximum(counts, 1)
    # a roof at the border of the points is none the less whole
    mask = np.pad((roofs & (counts > 0)).reshape(grid.shape), 2)
    mask = binary_opening(binary_closing(mask, np.ones((3, 3), dtype=np.bool_)), np.ones((3, 3), dtype=np.bool_))
    parts, count = label(mask[2:-2, 2:-2])
    found: list[tuple[Array, float]] = []
    for number in range(1, count + 1):
        part = (parts == number).ravel()
        wide = (
            binary_dilation(part.reshape(grid.shape), np.ones((2 * RIM_CELLS + 1,) * 2, dtype=np.bool_)).ravel()[flat]
            & high
        )
        around = binary_dilation(part.reshape(grid.shape), iterations=AROUND_CELLS).ravel()[flat]
        outline = _outline(points[wide, :2], points[around, :2], high[around], cell)
        if outline is None or abs(area_of(outline)) < least_area_m2:
            continue
        share = share_above(points, outline, options.least_height_m)
        if share is None or share >= LEAST_RIM:
            here = part[flat]
            found.append((outline, float(np.median(points[here, 2] - above[here]))))
    if not found:
        raise InvalidInputError("plans", f"no roof of {least_area_m2:g} m² or more stands above the ground")
    found.sort(key=lambda each: -abs(area_of(each[0])))
    return [outline for outline, _ in found], [ground for _, ground in found]


def _outline(places: Array, around: Array, high: Flags, cell_m: float) -> Array | None:
    """Return the squared outline of one building [m]; None where nothing square is left.

    Parameters
    ----------
    places
        (n, 2) points of it [m].
    around, high
        (m, 2) all points there and beside, and which are above the ground.
    cell_m
        Size of cells [m].
    """
    import cv2

    (_, _), (_, _), degrees = cv2.minAreaRect(places.astype(np.float32))
    angle = float(np.radians(degrees))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = places @ turn
    low = turned.min(axis=0) - 2.0 * cell_m
    rows = ((turned - low) / cell_m).astype(np.int64)
    mask = np.zeros((rows.max(axis=0) + 3).tolist(), dtype=np.bool_)
    mask[rows[:, 0], rows[:, 1]] = True
    mask = binary_opening(binary_closing(mask, np.ones((3, 3), dtype=np.bool_)), np.ones((3, 3), dtype=np.bool_))
    rims, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not rims:
        return None
    # contours run through the middles of cells, x being the column
    corners = cv2.approxPolyDP(max(rims, key=len), CORNER_CELLS, closed=True)[:, 0, ::-1].astype(np.float64) + 0.5
    if len(corners) < 4:
        return None
    corners = corners if area_of(corners) > 0.0 else corners[::-1]
    squared = _squared(corners, np.hypot(*(np.roll(corners, -1, axis=0) - corners).T))
    if squared is None:
        return None
    squared = squared * cell_m + low
    middle = squared.mean(axis=0)
    seen = around @ turn - middle
    fitted, _ = _fitted(squared - middle, seen, high, cell_m)
    more = np.eye(2)
    for reach, step in TURNS_DEG:
        angles = np.radians(np.arange(-reach, reach + 0.5 * step, step))
        turns = [more @ np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for a in angles]
        parted = np.array([_fitted(fitted, seen @ each, high, cell_m)[1] for each in turns])
        best = np.flatnonzero(parted == parted.max())
        more = turns[int(best[len(best) // 2])]
    fitted, _ = _fitted(fitted, seen @ more, high, cell_m)
    return np.asarray((fitted @ more.T + middle) @ turn.T)


def _fitted(corners: Array, places: Array, high: Flags, cell_m: float) -> tuple[Array, float]:
    """Move each side of a right-angled outline to where it parts high points from the others best; how well it does."""
    moved, parted = corners.copy(), 0.0
    for k in range(len(corners)):
        start, end = corners[k], corners[(k + 1) % len(corners)]
        along = int(abs(end[0] - start[0]) < abs(end[1] - start[1]))
        across = 1 - along
        # of an outline that runs anticlockwise the outside is to the right
        outward = np.sign(end[along] - start[along]) * (1.0 if across == 0 else -1.0)
        apart = outward * (places[:, across] - start[across])
        beside = (places[:, along] > min(start[along], end[along])) & (places[:, along] < max(start[along], end[along]))
        reach = REACH_CELLS * cell_m
        beside &= np.abs(apart) < reach
        if not high[beside].any():
            continue
        if high[beside].all():  # no ground was seen: evenly spread, the outermost lies by its rest before the side
            side = (float(np.quantile(apart[beside], OUTERMOST)) + reach) / OUTERMOST - reach
        else:
            order = np.argsort(apart[beside])
            ways = apart[beside][order]
            inside = np.append(0, np.cumsum(np.where(high[beside][order], 1, -1)))
            best = np.flatnonzero(inside == inside.max())
            parted += float(inside.max() - inside[-1])
            cut = best[len(best) // 2]
            side = 0.5 * float(ways[max(cut - 1, 0)] + ways[min(cut, len(ways) - 1)])
        moved[k, across] = moved[(k + 1) % len(corners), across] = start[across] + outward * side
    return moved, parted


def _squared(corners: Array, lengths: Array) -> Array | None:
    """Replace sides by ones along the axes: those of one direction in a row become one, at their mean."""
    sides = np.roll(corners, -1, axis=0) - corners
    along_x = np.abs(sides[:, 0]) >= np.abs(sides[:, 1])
    middles = 0.5 * (corners + np.roll(corners, -1, axis=0))
    kept = lengths >= LEAST_SIDE_CELLS
    order = np.flatnonzero(kept)
    if len(order) < 4:
        return None
    groups: list[list[int]] = []
    for k in order.tolist():
        if groups and along_x[groups[-1][-1]] == along_x[k]:
            groups[-1].append(k)
        else:
            groups.append([k])
    if len(groups) > 1 and along_x[groups[0][0]] == along_x[groups[-1][0]]:
        groups[0] = groups.pop() + groups[0]
    if len(groups) < 4:
        return None
    places = [
        float(np.average(middles[group, 1 if along_x[group[0]] else 0], weights=lengths[group])) for group in groups
    ]
    out = []
    for k, group in enumerate(groups):
        here, there = places[k], places[(k + 1) % len(groups)]
        out.append([there, here] if along_x[group[0]] else [here, there])
    return np.array(out)
