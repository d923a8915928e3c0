"""Divide a ground plan among roof planes by lines that pay: planes' intersections, and jumps along sides of the plan.

The lines cut the plan into cells that have corners and sides in common by number, never by place, so that the faces
made of them meet edge to edge. A minimum cut gives planes to cells: points off their plane cost, and so do walls.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import mapbox_earcut
import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_flow
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Flags, Points, Scalars
from algorithms.roofs.planes import TOLERANCE, RoofPlane

SAME_M = 5e-3
"""A line goes through corners that it passes so near."""
OFF = 0.5 * TOLERANCE**2
"""What a point costs at most: half its squared distance in standard deviations."""
LEAST_GAIN = 3.0
"""A line brings so many points to their plane, or a quarter of those of the smallest face."""
MOST_LINES, MOST_POINTS = 80, 6000
WALL, HIGH_M, BORDER = 6.0, 0.3, 0.05
"""Cost of a square metre of wall between faces as far as it is not higher than this, and of a metre of border."""
RELABELLED, REACH_M = 2, 0.5
"""Borders so near to where their planes meet are sought there as well."""
SWEEPS, ASCENTS = 4, 4
FINE = 1000.0
"""Steps of a cost: flows are whole numbers."""
NEAR = 8
"""One plane lies beside another where it is among so many next points."""
SAME_DIRECTION = 0.02


@dataclass(frozen=True, eq=False)
class DividedPlan:
    """A plan cut into convex cells, each of one plane."""

    corners: Array
    """(c, 2) of the cells; those of the plan first, in its order [m]."""
    cells: Sequence[Sequence[int]]
    """Corners of each, anticlockwise; neighbours have both ends of their common side in common."""
    planes: Array
    """(cells,) which plane each has."""


@dataclass(eq=False)
class _Cut:
    """A plan while it is cut, and the points over it."""

    corners: Array
    cells: list[list[int]]
    places: Array
    costs: Array
    """(n, planes) of each point."""
    of_point: Array
    """(n,) cell."""

    def sums(self, right: Flags | None = None) -> Array:
        """Sum the costs of all planes over cells, or over their two parts, those left of a line first."""
        groups, count = self.of_point, len(self.cells)
        if right is not None:
            groups, count = groups + len(self.cells) * right, 2 * count
        rows = csr_array((np.ones(len(groups)), (groups, np.arange(len(groups)))), shape=(count, len(groups)))
        return np.asarray(rows @ self.costs)

    def gain(self, line: Array) -> float:
        """Return what the cells cost less when a line cuts them."""
        both = self.sums(self.places @ line[:2] + line[2] > 0.0).min(axis=1)
        return float(np.sum(self.sums().min(axis=1)) - np.sum(both))

    def cut(self, line: Array) -> None:
        """Cut all cells that a line (unit normal, offset) goes through; a side that it cuts has one corner there."""
        apart = self.corners @ line[:2] + line[2]
        signs = np.where(np.abs(apart) < SAME_M, 0.0, np.sign(apart))
        crossings: dict[tuple[int, int], int] = {}
        added: list[Array] = []
        for cell in self.cells:
            for here, there in _sides(cell):
                key = (min(here, there), max(here, there))
                if signs[here] * signs[there] < 0.0 and key not in crossings:
                    crossings[key] = len(self.corners) + len(added)
                    share = apart[here] / (apart[here] - apart[there])
                    added.append(self.corners[here] + share * (self.corners[there] - self.corners[here]))
        if added:
            self.corners = np.vstack([self.corners, added])
            signs = np.append(signs, np.zeros(len(added)))
        right = self.places @ line[:2] + line[2] > 0.0
        cells: list[list[int]] = []
        of_point = np.empty_like(self.of_point)
        for number, cell in enumerate(self.cells):
            mine = self.of_point == number
            full = [
                each
                for here, there in _sides(cell)
                for each in (here, crossings.get((min(here, there), max(here, there))))
                if each is not None
            ]
            parts = _halves(full, signs)
            if len(parts) == 1:
                of_point[mine] = len(cells)
            else:
                of_point[mine & right] = len(cells)
                of_point[mine & ~right] = len(cells) + 1
            cells += parts
        self.cells, self.of_point = cells, of_point


def _sides(ring: Sequence[int]) -> list[tuple[int, int]]:
    return [*pairwise(ring), (ring[-1], ring[0])]


def _halves(cell: list[int], signs: Array) -> list[list[int]]:
    """Cut a ring at its corners on a line: the part of positive signs first; the ring itself where nothing is cut."""
    own = signs[cell]
    off = np.flatnonzero(own)
    turns = np.flatnonzero(own[off] != np.roll(own[off], 1))
    if len(turns) != 2:
        return [cell]
    first = int(off[turns[0]] if own[off[turns[0]]] > 0.0 else off[turns[1]])
    ring = [*cell[first:], *cell[:first]]
    own = np.roll(own, -first)
    plus, minus = np.flatnonzero(own > 0.0), np.flatnonzero(own < 0.0)
    # of several corners on the line in a row, the inner ones are of the part beyond
    one = [ring[-1], *ring[: plus[-1] + 2]] if own[-1] == 0.0 else [*ring[: plus[-1] + 2]]
    return [one, ring[plus[-1] + 1 :]] if len(minus) else [cell]


def divided(
    outline: Array, planes: Sequence[RoofPlane], points: Points, labels: Array, least_points: int,
    least_area_m2: float,
) -> DividedPlan:  # fmt: skip
    """Divide a plan.

    Parameters
    ----------
    outline
        (k, 2) corners of the plan, anticlockwise [m].
    planes
        The planes.
    points, labels
        (n, 3) all points of the roof, and the plane of each, -1 for none.
    least_points, least_area_m2
        Of the smallest face.
    """
    step = max(1, len(points) // MOST_POINTS)
    points, labels = points[::step], labels[::step]
    off = np.abs(points[:, 2:] - np.column_stack([plane.heights(points) for plane in planes]))
    off /= np.array([plane.noise_m for plane in planes])
    costs = np.minimum(0.5 * off**2, OFF)
    cells = _convex_parts(outline)
    plan = _Cut(outline, cells, points[:, :2], costs, _cell_of(points[:, :2], outline, cells))
    crossing = _intersections(planes, points, labels)
    least = OFF * max(LEAST_GAIN, 0.25 * least_points / step)
    for _ in range(MOST_LINES):
        # a box beside a ridge gains as well: jumps are sought in what intersections leave
        gain, lines = max(((plan.gain(line), [line]) for line in crossing), key=_first, default=(0.0, []))
        if gain < least:
            gain, lines = max(_jumps(plan, outline, labels), key=_first, default=(0.0, []))
        if gain < least:
            break
        for line in lines:
            plan.cut(line)
    chosen = _labelled(plan, planes, labels)
    for _ in range(RELABELLED):
        lines = _missed(plan, planes, chosen)
        if not lines:
            break
        for line in lines:
            plan.cut(line)
        chosen = _labelled(plan, planes, labels)
    return DividedPlan(plan.corners, plan.cells, _without_slivers(plan, planes, chosen, least_area_m2))


def _first(proposal: tuple[float, list[Array]]) -> float:
    return proposal[0]


def _convex_parts(outline: Array) -> list[list[int]]:
    """Cut a plan into triangles, anticlockwise, unless it is convex."""
    ahead, back = np.roll(outline, -1, axis=0) - outline, outline - np.roll(outline, 1, axis=0)
    if (back[:, 0] * ahead[:, 1] - back[:, 1] * ahead[:, 0] > 0.0).all():
        return [list(range(len(outline)))]
    triangles = mapbox_earcut.triangulate_float64(
        np.ascontiguousarray(outline), np.array([len(outline)], dtype=np.uint32)
    ).reshape(-1, 3)
    return [each if area_of(outline[each]) > 0.0 else each[::-1] for each in triangles.astype(np.int64).tolist()]


def _cell_of(places: Array, corners: Array, cells: Sequence[Sequence[int]]) -> Array:
    """Return the convex cell in which each place lies, or lies least outside."""
    outside = []
    for cell in cells:
        starts, ways = corners[cell], np.roll(corners[cell], -1, axis=0) - corners[cell]
        normals = np.column_stack([ways[:, 1], -ways[:, 0]]) / np.linalg.norm(ways, axis=1)[:, None]
        outside.append((places @ normals.T - np.einsum("ij,ij->i", starts, normals)).max(axis=1))
    return np.asarray(np.argmin(np.array(outside), axis=0))


def _intersections(planes: Sequence[RoofPlane], points: Points, labels: Array) -> list[Array]:
    """Return the lines in which planes that lie beside one another meet, seen from above."""
    known = np.flatnonzero(labels >= 0)
    _, near = cKDTree(points[known, :2]).query(points[known, :2], k=min(NEAR, len(known)))
    beside = labels[known][np.asarray(near).reshape(len(known), -1)]
    pairs = np.unique(
        np.sort(np.column_stack([np.repeat(beside[:, 0], beside.shape[1]), beside.ravel()]), axis=1), axis=0
    )
    lines = []
    for one, other in pairs.tolist():
        line = planes[one].parameters - planes[other].parameters
        if one != other and (steep := float(np.hypot(line[0], line[1]))) > 1e-3:
            lines.append(line / steep)
    return lines


def _jumps(plan: _Cut, outline: Array, labels: Array) -> list[tuple[float, list[Array]]]:
    """Propose for every plane the box along sides of the plan in which it, for the cells' planes, gains most."""
    present = plan.sums().argmin(axis=1)[plan.of_point]
    own = plan.costs[np.arange(len(labels)), present]
    proposals = []
    for turn in _frames(outline):
        turned = plan.places @ turn
        for k in range(plan.costs.shape[1]):
            gains = own - plan.costs[:, k]
            seeds = (gains > 0.5 * OFF) & (labels == k)
            if np.sum(gains[seeds]) < OFF * LEAST_GAIN:
                continue
            box = _largest_part(turned[seeds])
            gain = 0.0
            for _ in range(ASCENTS):
                before = gain
                for axis in (0, 1):
                    within = (turned[:, 1 - axis] >= box[0, 1 - axis]) & (turned[:, 1 - axis] <= box[1, 1 - axis])
                    if not within.any():
                        break
                    gain, box[0, axis], box[1, axis] = _best_stretch(turned[within, axis], gains[within])
                if gain <= before:
                    break
            lines = [
                np.array([*turn[:, axis], -box[end, axis]]) for axis in (0, 1) for end in (0, 1)
                if np.isfinite(box[end, axis])
            ]  # fmt: skip
            proposals.append((gain, lines))
    return proposals


def _frames(outline: Array) -> list[Array]:
    """Return the turns (2, 2) whose columns are the directions of the plan's sides, right-angled ones once."""
    ways = np.roll(outline, -1, axis=0) - outline
    lengths = np.hypot(*ways.T)
    frames: list[Array] = []
    for way in (ways / lengths[:, None])[np.argsort(-lengths)]:
        if all(np.min(np.abs(way @ frame)) > SAME_DIRECTION for frame in frames):
            frames.append(np.column_stack([way, [-way[1], way[0]]]))
    return frames


def _largest_part(places: Array) -> Array:
    """Return the ends (2, 2) of the largest cluster of places, linked over twice their spacing."""
    distances, _ = cKDTree(places).query(places, k=min(4, len(places)))
    reach = 3.0 * float(np.median(np.asarray(distances).reshape(len(places), -1)[:, -1])) + SAME_M
    pairs = cKDTree(places).query_pairs(reach, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(places), len(places)))
    _, parts = connected_components(graph, directed=False)
    largest = places[parts == np.argmax(np.bincount(parts))]
    return np.array([largest.min(axis=0), largest.max(axis=0)])


def _best_stretch(along: Scalars, gains: Scalars) -> tuple[float, float, float]:
    """Return the stretch with the largest sum of gains; its ends are infinite where no point lies beyond."""
    order = np.argsort(along)
    along = along[order]
    total = np.append(0.0, np.cumsum(gains[order]))
    lowest = np.minimum.accumulate(total)
    end = int(np.argmax(total - lowest))
    start = int(np.argmin(total[: end + 1]))
    low = -np.inf if start == 0 else 0.5 * float(along[start - 1] + along[start])
    high = np.inf if end == len(along) else 0.5 * float(along[end - 1] + along[end])
    return float(total[end] - total[start]), low, high


@dataclass(frozen=True, eq=False)
class _Borders:
    """Where cells meet, and what it costs when they have different planes."""

    one: Array
    other: Array
    lengths: Scalars
    heights: Array
    """(borders, 2, planes) at both ends [m]."""

    def cost(self, first: Array, second: Array) -> Scalars:
        """Return the cost of each border for planes on its two sides."""
        rows = np.arange(len(self.one))
        apart = np.minimum(np.abs(self.heights[rows, :, first] - self.heights[rows, :, second]), HIGH_M).mean(axis=1)
        return np.where(first != second, self.lengths * (WALL * apart + BORDER), 0.0)


def _borders(plan: _Cut, planes: Sequence[RoofPlane]) -> _Borders:
    sides = {side: k for k, cell in enumerate(plan.cells) for side in _sides(cell)}
    found = [
        (k, sides[end, start], start, end) for (start, end), k in sides.items() if (end, start) in sides and start < end
    ]
    one, other, start, end = np.array(found, dtype=np.int64).reshape(-1, 4).T
    heights = np.column_stack([plane.heights(plan.corners) for plane in planes])
    lengths = np.hypot(*(plan.corners[end] - plan.corners[start]).T)
    return _Borders(one, other, lengths, np.stack([heights[start], heights[end]], axis=1))


def _missed(plan: _Cut, planes: Sequence[RoofPlane], chosen: Array) -> list[Array]:
    """Return the lines in which planes meet that have a border near them, but not there."""
    borders = _borders(plan, planes)
    missed: dict[tuple[int, int], Array] = {}
    for k in np.flatnonzero(chosen[borders.one] != chosen[borders.other]).tolist():
        one, other = sorted((int(chosen[borders.one[k]]), int(chosen[borders.other[k]])))
        line = planes[one].parameters - planes[other].parameters
        steep = float(np.hypot(line[0], line[1]))
        if steep <= 1e-3:
            continue
        apart = np.abs(borders.heights[k, :, one] - borders.heights[k, :, other]) / steep
        if SAME_M < apart.max() <= REACH_M:
            missed[one, other] = line / steep
    return list(missed.values())


def _labelled(plan: _Cut, planes: Sequence[RoofPlane], labels: Array) -> Array:
    """Assign planes to cells by moves that spread one plane each (Boykov, Veksler and Zabih 2001)."""
    sums = plan.sums()
    chosen: Array = sums.argmin(axis=1)
    empty = np.bincount(plan.of_point, minlength=len(plan.cells)) == 0
    known = labels >= 0
    if empty.any() and known.any():
        middles = np.array([plan.corners[cell].mean(axis=0) for cell in plan.cells])
        _, nearest = cKDTree(plan.places[known]).query(middles[empty])
        chosen[empty] = labels[known][nearest]
    borders = _borders(plan, planes)
    if len(borders.one) == 0 or len(planes) == 1:
        return chosen
    for _ in range(SWEEPS):
        before = chosen
        for k in range(len(planes)):
            chosen = _spread(chosen, k, sums, borders)
        if (before == chosen).all():
            break
    return chosen


def _spread(chosen: Array, k: int, sums: Array, borders: _Borders) -> Array:
    """Let plane k take the cells whose change to it costs least together."""
    count = len(chosen)
    one, other = borders.one, borders.other
    spread = np.full(len(one), k)
    stay, first, second = (
        borders.cost(*each) for each in ((chosen[one], chosen[other]), (chosen[one], spread), (spread, chosen[other]))
    )  # first: the other changes alone; second: the one alone
    change = sums[:, k] - sums[np.arange(count), chosen]
    change = change + np.bincount(one, second - stay, minlength=count) - np.bincount(other, second, minlength=count)
    # what one side keeps and the other gives up costs the rest
    rest = np.maximum(first + second - stay, 0.0)
    source, sink = count, count + 1
    cells = np.arange(count)
    rows = np.concatenate([np.full(count, source), cells, one])
    columns = np.concatenate([cells, np.full(count, sink), other])
    values = np.concatenate([np.maximum(change, 0.0), np.maximum(-change, 0.0), rest])
    graph = csr_array((np.rint(FINE * values).astype(np.int32), (rows, columns)), shape=(count + 2, count + 2))
    graph.sum_duplicates()
    flow = maximum_flow(graph, source, sink).flow
    left = csr_array(graph - flow)
    left.data = np.maximum(left.data, 0)
    left.eliminate_zeros()
    kept = breadth_first_order(left, source, return_predecessors=False)
    changed = np.ones(count + 2, dtype=np.bool_)
    changed[kept] = False
    return np.where(changed[:count], k, chosen)


def _without_slivers(plan: _Cut, planes: Sequence[RoofPlane], chosen: Array, least_area_m2: float) -> Array:
    """Assign faces smaller than a least area to the plane beside them that costs least."""
    borders = _borders(plan, planes)
    areas = np.array([area_of(plan.corners[cell]) for cell in plan.cells])
    sums, chosen = plan.sums(), chosen.copy()
    for _ in range(len(areas)):
        same = chosen[borders.one] == chosen[borders.other]
        pairs = (borders.one[same], borders.other[same])
        graph = coo_array((np.ones(len(pairs[0])), pairs), shape=(len(areas), len(areas)))
        _, parts = connected_components(graph, directed=False)
        sizes = np.bincount(parts, areas)
        for part in np.argsort(sizes):
            mine = parts == part
            across = ~same & (mine[borders.one] | mine[borders.other])
            if sizes[part] >= least_area_m2 or not across.any():
                continue
            beside = np.unique(np.append(chosen[borders.one[across]], chosen[borders.other[across]]))
            trials = [(np.where(mine, k, chosen), k) for k in beside.tolist() if k != chosen[mine][0]]
            costs = [
                sums[mine, k].sum() + borders.cost(trial[borders.one], trial[borders.other])[across].sum()
                for trial, k in trials
            ]
            chosen = trials[int(np.argmin(costs))][0]
            break
        else:
            break
    return chosen


def area_of(corners: Array) -> float:
    """Give the area of a polygon (k, 2), positive when it runs anticlockwise [m²]."""
    x, y = (corners - corners[0]).T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
