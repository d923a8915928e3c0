"""Faces of a roof from the cells of its plan: united, with borders straight and corners where the planes meet."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from algorithms.arrays import Array, Points
from algorithms.deviations.signed_distances import inside_polygon
from algorithms.errors import InvalidInputError
from algorithms.roofs.partition import DividedPlan, area_of
from algorithms.roofs.planes import RoofPlane

MERGED_M = 0.02
"""Corners nearer than this on one side are one."""
MOST_MOVE_M = 0.5
"""A corner is moved so far at most to where its borders meet."""
STRAIGHT = 0.02
"""Borders that turn by less are straight [rad]."""
STEADY = 0.1
"""Two borders that cross at a smaller sine do not tell where along them."""
ROUNDS = 16
ADJUSTMENTS = 3
TOGETHER_M = 1e-3
"""Heights of planes that meet are one to so much."""
LEAST_WEIGHT = 1e-6
MOST_STRAIN = 12.0
"""So far a plane is adjusted at most, squared in its own standard deviations: three parameters by chance, 99 %."""

Faces = Sequence[tuple[int, Sequence[Array]]]
"""The plane of each face, and its rings of corners: the outer one anticlockwise first, then holes clockwise."""
RIM = -1
"""Instead of a plane outside the plan."""


def faces_of(
    plan: DividedPlan, planes: Sequence[RoofPlane], points: Points, labels: Array, outline: Array, joined_m: float
) -> tuple[Array, Faces, Sequence[RoofPlane]]:
    """Unite cells to faces, and let their planes meet in corners.

    Parameters
    ----------
    plan
        The cells.
    planes
        The planes.
    points, labels
        (n, 3) points of the roof, and the plane of each, -1 for none.
    outline
        (k, 2) corners of the plan, which stay where they are [m].
    joined_m
        Planes whose heights at a corner differ by less meet there [m].

    Returns
    -------
    Corners (c, 2), the faces, and the planes that have any, adjusted to meet.

    Raises
    ------
    InvalidInputError
        The faces do not bound one another.
    """
    used = np.unique(plan.planes)
    numbers = np.full(len(planes) + 1, -1, dtype=np.int64)
    numbers[used] = np.arange(len(used))
    labels = numbers[labels]
    seen = [planes[k] for k in used.tolist()]
    united = _united(DividedPlan(plan.corners, plan.cells, numbers[plan.planes]))
    meeting: Sequence[RoofPlane] = seen
    for _ in range(ADJUSTMENTS):
        borders = _Borders(plan.corners, united, meeting, len(outline), joined_m)
        settled, kept = _settled(borders, borders.nodes())
        corners, faces = _merged(settled, kept, len(outline))
        meeting = _met(seen, meeting, corners, faces, points, labels, joined_m)
    corners, faces = _with_crossings(corners, faces, meeting, joined_m)
    return corners, faces, meeting


def _met(
    seen: Sequence[RoofPlane],
    planes: Sequence[RoofPlane],
    corners: Array,
    faces: Faces,
    points: Points,
    labels: Array,
    joined_m: float,
) -> Sequence[RoofPlane]:
    """Adjust planes to their points so that those that meet at a corner have one height there."""
    middle = np.append(points[:, :2].mean(axis=0), 0.0)
    size = 3 * len(seen)
    own_normal, at_seen = np.zeros((size, size)), np.zeros(size)
    for k, plane in enumerate(seen):
        own = points[labels == k] - middle
        design = np.column_stack([own[:, :2], np.ones(len(own))]) / plane.noise_m
        parts = design.T @ design + LEAST_WEIGHT * np.eye(3)
        if plane.level:
            parts[:2, :2] += np.eye(2) / TOGETHER_M**2
        own_normal[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = parts
        at_seen[3 * k : 3 * k + 3] = plane.parameters + np.array([0.0, 0.0, plane.parameters @ middle])
    meetings: list[tuple[float, Array]] = []
    for corner, those in _planes_at(faces).items():
        for group in _groups(corners[corner], those, planes, joined_m):
            rows = np.zeros((len(group) - 1, size))
            for row, ((_, one), (_, other)) in zip(rows, pairwise(group), strict=True):
                row[3 * one : 3 * one + 3] = np.append(corners[corner] - middle[:2], 1.0) / TOGETHER_M
                row[3 * other : 3 * other + 3] = -row[3 * one : 3 * one + 3]
            if len(rows):
                meetings.append((group[-1][0] - group[0][0], rows))
    meetings.sort(key=lambda each: each[0])
    solution: Array = at_seen
    while meetings:
        rows = np.concatenate([rows for _, rows in meetings])
        solution = np.linalg.solve(own_normal + rows.T @ rows, own_normal @ at_seen)
        change = (solution - at_seen).reshape(-1, 3)
        strain = np.einsum(
            "ki,kij,kj->k", change, np.array([own_normal[j : j + 3, j : j + 3] for j in range(0, size, 3)]), change
        )
        if strain.max() <= MOST_STRAIN:
            break
        meetings.pop()  # planes do not meet there after all
        solution = at_seen
    parameters = solution.reshape(-1, 3).copy()
    parameters[:, 2] -= parameters @ middle
    met = []
    for k, plane in enumerate(seen):
        own = points[labels == k]
        off = own[:, 2] - own[:, :2] @ parameters[k, :2] - parameters[k, 2]
        met.append(
            replace(plane, parameters=parameters[k], rms_m=float(np.sqrt(np.mean(off**2))) if len(off) else plane.rms_m)
        )
    return met


def _planes_at(faces: Faces) -> Mapping[int, set[int]]:
    found: dict[int, set[int]] = {}
    for plane, rings in faces:
        for ring in rings:
            for corner in ring.tolist():
                found.setdefault(corner, set()).add(plane)
    return found


def _groups(
    corner: Array, those: set[int], planes: Sequence[RoofPlane], joined_m: float
) -> Sequence[Sequence[tuple[float, int]]]:
    """Return the planes at a corner that meet in it, each with its height, upward."""
    heights = sorted((float(planes[k].heights(corner[None])[0]), k) for k in those)
    groups: list[list[tuple[float, int]]] = []
    for each in heights:
        if groups and each[0] - groups[-1][-1][0] <= joined_m:
            groups[-1].append(each)
        else:
            groups.append([each])
    return groups


def heights_at(
    corners: Array, faces: Faces, planes: Sequence[RoofPlane], joined_m: float
) -> Mapping[tuple[int, int], float]:
    """Return the height of each face's plane at each of its corners, one where planes meet; by corner and plane [m]."""
    heights = {}
    for corner, those in _planes_at(faces).items():
        for group in _groups(corners[corner], those, planes, joined_m):
            level = float(np.mean([height for height, _ in group]))
            heights.update({(corner, plane): level for _, plane in group})
    return heights


def _united(plan: DividedPlan) -> Faces:
    faces: list[tuple[int, Sequence[Array]]] = []
    for plane in np.unique(plan.planes).tolist():
        sides: dict[tuple[int, int], bool] = {}
        for cell, own in zip(plan.cells, plan.planes, strict=True):
            if own == plane:
                for start, end in _sides(cell):
                    if (end, start) in sides:
                        del sides[end, start]
                    else:
                        sides[start, end] = True
        faces += [(plane, rings) for rings in _nested(plan.corners, _chained(plan.corners, list(sides)))]
    return faces


def _sides(ring: Sequence[int] | Array) -> list[tuple[int, int]]:
    row = [int(each) for each in ring]
    return [*pairwise(row), (row[-1], row[0])]


class _Borders:
    """The sides of faces, seen from above, with what lies left and right of each."""

    def __init__(self, corners: Array, faces: Faces, planes: Sequence[RoofPlane], fixed: int, joined_m: float) -> None:
        self.corners, self.faces, self.planes, self.fixed, self.joined_m = corners, faces, planes, fixed, joined_m
        self.left = {side: plane for plane, rings in faces for ring in rings for side in _sides(ring)}
        self.beside: dict[int, list[int]] = {}
        for start, end in self.left:
            for here, there in ((start, end), (end, start)):
                row = self.beside.setdefault(here, [])
                if there not in row:
                    row.append(there)
        self.heights = np.column_stack([plane.heights(corners) for plane in planes])

    def pair(self, start: int, end: int) -> tuple[int, int]:
        """Return the planes left and right of a side, the smaller number first; RIM outside the plan."""
        one, other = self.left.get((start, end), RIM), self.left.get((end, start), RIM)
        return min(one, other), max(one, other)

    def meets(self, start: int, end: int) -> bool:
        """Check whether the planes of a side meet along it."""
        one, other = self.pair(start, end)
        if one == RIM:
            return False
        apart = self.heights[[start, end], one] - self.heights[[start, end], other]
        line = self.planes[one].parameters - self.planes[other].parameters
        return bool((np.abs(apart) <= self.joined_m).all() and np.hypot(line[0], line[1]) > 1e-3)

    def way(self, start: int, end: int) -> Array:
        """Return the direction of a side, (2,), unit."""
        way = self.corners[end] - self.corners[start]
        return np.asarray(way / max(float(np.hypot(*way)), 1e-12))

    def nodes(self) -> set[int]:
        """Return the corners that borders end at or turn at; those of the plan among them."""
        found = set()
        for corner, row in self.beside.items():
            if len(row) != 2:
                found.add(corner)
                continue
            one, other = row
            ahead, back = self.way(corner, one), self.way(corner, other)
            turns = abs(float(ahead[0] * back[1] - ahead[1] * back[0])) >= STRAIGHT
            meets = self.meets(corner, one)
            changes = self.pair(corner, one) != self.pair(corner, other) or meets != self.meets(corner, other)
            if changes or (turns and not meets):
                found.add(corner)
        return found

    def line(self, start: int, onward: int, nodes: set[int]) -> tuple[Array, float]:
        """Return unit normal and offset of the line on which the border from a node along a side lies."""
        one, other = self.pair(start, onward)
        if self.meets(start, onward):
            line = self.planes[one].parameters - self.planes[other].parameters
            return np.asarray(line[:2]), float(line[2])
        before, here = start, onward
        while here not in nodes:
            row = self.beside[here]
            before, here = here, row[0] if row[1] == before else row[1]
        if here == start:
            here = onward
        way = self.way(start, here)
        normal = np.array([-way[1], way[0]])
        return normal, -float(normal @ self.corners[start])


def _settled(borders: _Borders, nodes: set[int]) -> tuple[Array, Faces]:
    """Leave out corners between nodes, and move nodes to where their borders meet, if faces stay simple."""
    nodes = set(nodes)
    moved = {node: _meeting(borders, node, nodes) for node in nodes if node >= borders.fixed}
    for _ in range(ROUNDS):
        corners = borders.corners.copy()
        for node, place in moved.items():
            corners[node] = place
        wrong: set[int] = set()
        faces: list[tuple[int, Sequence[Array]]] = []
        for plane, rings in borders.faces:
            kept = [np.array([each for each in ring.tolist() if each in nodes], dtype=np.int64) for ring in rings]
            if all(len(ring) >= 3 for ring in kept) and _simple(corners, kept):
                faces.append((plane, kept))
            else:
                wrong |= {int(each) for ring in rings for each in ring}
        if not wrong:
            return corners, faces
        if wrong & set(moved):
            for node in wrong:
                moved.pop(node, None)
        else:
            nodes |= wrong
    return borders.corners, borders.faces


def _meeting(borders: _Borders, node: int, nodes: set[int]) -> Array:
    """Return the place nearest to all lines on which the borders at a node lie."""
    place = borders.corners[node]
    rows, rest = [], []
    for onward in borders.beside[node]:
        normal, offset = borders.line(node, onward, nodes)
        length = float(np.hypot(*normal))
        # the rim is where it is; of others the steeper meeting is better known
        weight = 100.0 if borders.pair(node, onward)[0] == RIM else 1.0
        rows.append(weight * normal / length)
        rest.append(-weight * (normal @ place + offset) / length)
    u, s, vt = np.linalg.svd(np.array(rows), full_matrices=False)
    told = s > STEADY * min(float(s[0]), 1.0)
    move = vt.T[:, told] @ ((u.T @ np.array(rest))[told] / s[told])
    return np.asarray(place + move) if np.hypot(*move) <= MOST_MOVE_M else place


def _simple(corners: Array, rings: Sequence[Array]) -> bool:
    """Check whether rings run the right way round and no two sides of them cross."""
    for number, ring in enumerate(rings):
        area = area_of(corners[ring])
        if (area <= 0.0) == (number == 0):
            return False
    sides = np.array([side for ring in rings for side in _sides(ring)])
    a, b = corners[sides[:, 0]], corners[sides[:, 1]]

    def turn(p: Array, q: Array, r: Array) -> Array:
        one, other = q - p, r - p
        return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])

    p, q = a[:, None], b[:, None]
    r, s = a[None], b[None]
    crossing = (turn(p, q, r) * turn(p, q, s) < 0.0) & (turn(r, s, p) * turn(r, s, q) < 0.0)
    return not crossing.any()


def _merged(corners: Array, faces: Faces, fixed: int) -> tuple[Array, Faces]:
    """Unite the ends of sides that are too short, unless a ring would pass a corner twice."""
    corners = corners.copy()
    refused: set[tuple[int, int]] = set()
    while True:
        short = [
            (float(np.hypot(*(corners[end] - corners[start]))), min(start, end), max(start, end))
            for _, rings in faces for ring in rings for start, end in _sides(ring)
        ]  # fmt: skip
        short = [each for each in sorted(short) if each[0] < MERGED_M and each[1:] not in refused and each[2] >= fixed]
        if not short:
            return corners, faces
        _, kept, gone = short[0]
        place = corners[kept] if kept < fixed else 0.5 * (corners[kept] + corners[gone])
        trial_corners = corners.copy()
        trial_corners[kept] = place
        trial: list[tuple[int, Sequence[Array]]] = []
        good = True
        for plane, rings in faces:
            left = [_replaced(ring, gone, kept) for ring in rings]
            if len(left[0]) < 3:
                continue  # a splinter
            left = [left[0], *(ring for ring in left[1:] if len(ring) >= 3)]
            good &= all(len(set(ring.tolist())) == len(ring) for ring in left) and _simple(trial_corners, left)
            trial.append((plane, left))
        if good:
            corners, faces = trial_corners, trial
        else:
            refused.add((kept, gone))


def _replaced(ring: Array, gone: int, kept: int) -> Array:
    row = np.where(ring == gone, kept, ring)
    return np.asarray(row[row != np.roll(row, 1)])


def _with_crossings(corners: Array, faces: Faces, planes: Sequence[RoofPlane], joined_m: float) -> tuple[Array, Faces]:
    """Put a corner into sides along which one plane passes from below the other to above it."""
    left = {side: plane for plane, rings in faces for ring in rings for side in _sides(ring)}
    added: list[Array] = []
    middles: dict[tuple[int, int], int] = {}
    for (start, end), one in left.items():
        other = left.get((end, start))
        if other is None or start > end:
            continue
        apart = planes[one].heights(corners[[start, end]]) - planes[other].heights(corners[[start, end]])
        if apart[0] * apart[1] < 0.0 and np.abs(apart).min() > joined_m:
            share = apart[0] / (apart[0] - apart[1])
            middles[start, end] = middles[end, start] = len(corners) + len(added)
            added.append(corners[start] + share * (corners[end] - corners[start]))
    if not added:
        return corners, faces
    longer = [
        (plane, [
            np.array([k for start, end in _sides(ring) for k in (start, middles.get((start, end), -1)) if k >= 0])
            for ring in rings
        ])
        for plane, rings in faces
    ]  # fmt: skip
    return np.vstack([corners, added]), longer


def outline_of(corners: Array, faces: Faces) -> Sequence[Sequence[Array]]:
    """Return the rings (k,) of corners that bound all faces together, as those of one."""
    sides = [side for _, rings in faces for ring in rings for side in _sides(ring)]
    inner = set(sides)
    return _nested(corners, _chained(corners, [(start, end) for start, end in sides if (end, start) not in inner]))


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


def _nested(corners: Array, rings: list[list[int]]) -> list[Sequence[Array]]:
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
