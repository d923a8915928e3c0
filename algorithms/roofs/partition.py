"""Divide a ground plan among roof planes: at their intersections, and at jumps where they do not meet."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import mapbox_earcut
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Points
from algorithms.deviations.signed_distances import inside_polygon
from algorithms.errors import InvalidInputError
from algorithms.roofs.planes import RoofPlane

SAME_M = 1e-4
"""Corners nearer than this are one."""
LEAST_CELL_M2 = 1e-6
MIXED = 0.8
"""A cell of whose points fewer belong to one plane holds a jump."""
LEAST_IN_CELL = 8
MOST_JUMPS = 8
NEAREST = 5
"""A cell without points is labelled by so many next to its middle."""


@dataclass(frozen=True, eq=False)
class PlanCell:
    """A convex part of the plan that one plane covers."""

    corners: Array
    """(k, 2) anticlockwise [m]."""
    plane: int


def divided(outline: Array, planes: Sequence[RoofPlane], places: Array, labels: Array) -> Sequence[PlanCell]:
    """Divide a plan.

    Parameters
    ----------
    outline
        (k, 2) corners of the plan, anticlockwise [m].
    planes
        The planes.
    places, labels
        (n, 2) points that have a plane, and which one.

    Returns
    -------
    Cells that cover the plan once and meet edge to edge.
    """
    cells = convex_parts(outline)
    for one, other in combinations(range(len(planes)), 2):
        line = planes[one].parameters - planes[other].parameters
        if np.hypot(line[0], line[1]) > 1e-3:
            cells = [part for cell in cells for part in halves(cell, line)]
    tree = cKDTree(places)
    for _ in range(MOST_JUMPS):
        jump = _jump(cells, outline, places, labels)
        if jump is None:
            break
        cells = [part for cell in cells for part in halves(cell, jump)]
    return [PlanCell(cell, _label(cell, places, labels, tree)) for cell in cells]


def without_slivers(cells: Sequence[PlanCell], least_area_m2: float) -> Sequence[PlanCell]:
    """Give faces smaller than `least_area_m2` to the neighbour with which they have most of their border in common.

    Intersections of three planes hardly ever meet in one point, so that splinters lie about every corner of a roof.
    """
    corners, rows = _numbered(cells)
    sides = {(start, end): k for k, row in enumerate(rows) for start, end in zip(row, [*row[1:], row[0]], strict=True)}
    areas = np.array([area_of(cell.corners) for cell in cells])
    planes = np.array([cell.plane for cell in cells])
    borders = [
        (k, sides[end, start], float(np.hypot(*(corners[end] - corners[start]))))
        for (start, end), k in sides.items()
        if (end, start) in sides
    ]
    one, other = (np.array([border[k] for border in borders], dtype=np.int64) for k in (0, 1))
    lengths = np.array([border[2] for border in borders])
    for _ in range(len(cells)):
        same = planes[one] == planes[other]
        graph = coo_array((np.ones(int(same.sum())), (one[same], other[same])), shape=(len(cells), len(cells)))
        _, parts = connected_components(graph, directed=False)
        sizes = np.bincount(parts, areas)
        for part in np.argsort(sizes):
            out = (parts[one] == part) & ~same
            if sizes[part] < least_area_m2 and out.any():
                shared = np.bincount(planes[other[out]], lengths[out])
                planes[parts == part] = int(np.argmax(shared))
                break
        else:
            break
    return [PlanCell(cell.corners, int(plane)) for cell, plane in zip(cells, planes, strict=True)]


def convex_parts(outline: Array) -> list[Array]:
    """Cut a plan into triangles, anticlockwise."""
    triangles = mapbox_earcut.triangulate_float64(
        np.ascontiguousarray(outline), np.array([len(outline)], dtype=np.uint32)
    ).reshape(-1, 3)
    return [_anticlockwise(outline[triangle]) for triangle in triangles]


def halves(cell: Array, line: Array) -> list[Array]:
    """Cut a convex polygon (k, 2) by a line a x + b y + c = 0; parts without area are left out."""
    norm = float(np.hypot(line[0], line[1]))
    apart = (cell @ line[:2] + line[2]) / norm
    apart[np.abs(apart) < SAME_M] = 0.0
    if (apart >= 0.0).all() or (apart <= 0.0).all():
        return [cell]
    parts: list[list[Array]] = [[], []]
    for k in range(len(cell)):
        here, there = apart[k], apart[(k + 1) % len(cell)]
        if here >= 0.0:
            parts[0].append(cell[k])
        if here <= 0.0:
            parts[1].append(cell[k])
        if here * there < 0.0:
            crossing = cell[k] + here / (here - there) * (cell[(k + 1) % len(cell)] - cell[k])
            parts[0].append(crossing)
            parts[1].append(crossing)
    return [np.array(part) for part in parts if len(part) >= 3 and area_of(np.array(part)) > LEAST_CELL_M2]


def area_of(corners: Array) -> float:
    """Give the area of a polygon (k, 2), positive when it runs anticlockwise [m²]."""
    x, y = (corners - corners[0]).T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _anticlockwise(corners: Array) -> Array:
    return corners if area_of(corners) > 0.0 else corners[::-1]


def _label(cell: Array, places: Array, labels: Array, tree: cKDTree) -> int:
    inside = labels[inside_polygon(places, cell)]
    if len(inside) < LEAST_IN_CELL:
        _, nearest = tree.query(cell.mean(axis=0), k=min(NEAREST, len(places)))
        inside = labels[np.atleast_1d(nearest)]
    return int(np.argmax(np.bincount(inside)))


def _jump(cells: Sequence[Array], outline: Array, places: Array, labels: Array) -> Array | None:
    """Find the line, along a side of the plan, that parts the planes best in the cell in which most are mixed."""
    worst, chosen = 0.0, None
    for cell in cells:
        inside = inside_polygon(places, cell)
        counts = np.bincount(labels[inside], minlength=1)
        wrong = float(counts.sum() - counts.max(initial=0))
        if counts.sum() >= LEAST_IN_CELL and counts.max() < MIXED * counts.sum() and wrong > worst:
            worst, chosen = wrong, inside
    if chosen is None:
        return None
    own, which = places[chosen], labels[chosen]
    main = which == np.argmax(np.bincount(which))
    sides = np.roll(outline, -1, axis=0) - outline
    normals = np.column_stack([-sides[:, 1], sides[:, 0]]) / np.linalg.norm(sides, axis=1)[:, None]
    best, line = worst, None
    for normal in normals:
        along = own @ normal
        order = np.argsort(along)
        before = np.cumsum(main[order])[:-1]
        steps = np.arange(1, len(order))
        right = np.maximum(before + (~main).sum() - (steps - before), steps - before + main.sum() - before)
        k = int(np.argmax(right))
        if len(order) - right[k] < best:
            best = float(len(order) - right[k])
            line = np.array([*normal, -0.5 * (along[order[k]] + along[order[k + 1]])])
    # a line that leaves half of the mixture is no jump
    return line if best < 0.5 * worst else None


def rings_of(cells: Sequence[PlanCell]) -> tuple[Array, Sequence[tuple[int, Sequence[Array]]]]:
    """Unite the cells of each plane that touch.

    Returns
    -------
    Corners (c, 2), and for each face the number of its plane and its rings of corners: the outer one anticlockwise
    first, then those of holes clockwise.
    """
    corners, rows = _numbered(cells)
    faces: list[tuple[int, Sequence[Array]]] = []
    for plane in sorted({cell.plane for cell in cells}):
        sides: dict[tuple[int, int], bool] = {}
        for cell, row in zip(cells, rows, strict=True):
            if cell.plane == plane:
                for start, end in zip(row, [*row[1:], row[0]], strict=True):
                    if (end, start) in sides:
                        del sides[end, start]
                    else:
                        sides[start, end] = True
        faces += [(plane, rings) for rings in _faces(corners, _chained(corners, list(sides)))]
    return corners, _without_straight_corners(corners, faces)


def outline_of(corners: Array, faces: Sequence[tuple[int, Sequence[Array]]]) -> Sequence[Sequence[Array]]:
    """Give the rings (k,) of corners that bound all faces together, as `rings_of` gives those of one."""
    sides = [
        side
        for _, rings in faces
        for ring in rings
        for side in zip(ring.tolist(), np.roll(ring, -1).tolist(), strict=True)
    ]
    inner = set(sides)
    return _faces(corners, _chained(corners, [(start, end) for start, end in sides if (end, start) not in inner]))


def _without_straight_corners(
    corners: Array, faces: Sequence[tuple[int, Sequence[Array]]]
) -> Sequence[tuple[int, Sequence[Array]]]:
    """Leave out the corners at which no face turns: lines that parted cells of one face left them."""
    needed = np.zeros(len(corners), dtype=np.bool_)
    for _, rings in faces:
        for ring in rings:
            there, back = (corners[np.roll(ring, step)] - corners[ring] for step in (-1, 1))
            across = there[:, 0] * back[:, 1] - there[:, 1] * back[:, 0]
            # two sides and the height of their triangle: how far the corner lies from the line of its neighbours
            apart = np.abs(across) / np.maximum(np.linalg.norm(there - back, axis=1), SAME_M)
            needed[ring[(apart > 3.0 * SAME_M) | (np.einsum("ij,ij->i", there, back) > 0.0)]] = True
    return [(plane, [ring[needed[ring]] for ring in rings]) for plane, rings in faces]


def _numbered(cells: Sequence[PlanCell]) -> tuple[Array, list[list[int]]]:
    """Unite equal corners, and put corners of neighbours that lie on a side into it."""
    stacked: Points | Array = np.concatenate([cell.corners for cell in cells])
    groups = cKDTree(stacked).query_ball_point(stacked, 2.0 * SAME_M)
    first = np.array([min(group) for group in groups])
    first = first[first]
    kept, numbers = np.unique(first, return_inverse=True)
    corners = stacked[kept]
    rows, start = [], 0
    for cell in cells:
        row = numbers[start : start + len(cell.corners)].tolist()
        start += len(cell.corners)
        full: list[int] = []
        for here, there in zip(row, [*row[1:], row[0]], strict=True):
            if here == there:
                continue
            way = corners[there] - corners[here]
            length = float(np.hypot(*way))
            apart = corners - corners[here]
            along = apart @ way / length
            across = np.abs(apart @ np.array([-way[1], way[0]])) / length
            between = np.flatnonzero((across < 2.0 * SAME_M) & (along > SAME_M) & (along < length - SAME_M))
            full += [here, *(k for k in between[np.argsort(along[between])].tolist() if k not in {here, there})]
        rows.append(full)
    return corners, rows


def _chained(corners: Array, sides: list[tuple[int, int]]) -> list[list[int]]:
    """Chain sides to rings; where several go on, the one that turns most to the left, so that rings do not cross."""
    onward: dict[int, list[int]] = {}
    for start, end in sides:
        onward.setdefault(start, []).append(end)
    rings = []
    for first in list(onward):
        while onward[first]:
            ring = [first, onward[first].pop()]
            while ring[-1] != first:
                choices = onward.get(ring[-1])
                if not choices:
                    raise InvalidInputError(
                        "plan", "the faces found over it do not meet edge to edge", "try another `neighbourhood_m`"
                    )
                back = corners[ring[-2]] - corners[ring[-1]]
                turn = [_angle(corners[k] - corners[ring[-1]], back) for k in choices]
                ring.append(choices.pop(int(np.argmin(turn))))
            rings.append(ring[:-1])
    return rings


def _angle(way: Array, back: Array) -> float:
    """Turn from a way, anticlockwise, to the way back, in (0, 2π]; the smallest keeps the inside to the left."""
    angle = float(np.arctan2(way[0] * back[1] - way[1] * back[0], way @ back))
    return angle if angle > 0.0 else angle + 2.0 * np.pi


def _faces(corners: Array, rings: list[list[int]]) -> list[Sequence[Array]]:
    """Put rings that run clockwise into the ring that they are holes of."""
    areas = [area_of(corners[ring]) for ring in rings]
    outer = [[np.array(ring)] for ring, area in zip(rings, areas, strict=True) if area > 0.0]
    for ring, area in zip(rings, areas, strict=True):
        if area < 0.0:
            middle = corners[ring[:2]].mean(axis=0)[None]
            holders = [face for face in outer if inside_polygon(middle, corners[face[0]])[0]]
            if holders:
                min(holders, key=lambda face: area_of(corners[face[0]])).append(np.array(ring))
    return list(outer)
