"""Compiled loops of a tree of boxes about triangles."""

from typing import Any

import numpy as np
from numba import njit

from algorithms.arrays import Array

LEAF = 2
"""Most triangles of a leaf."""
LANES = 16
"""Rays of a packet."""
BINS = 16
"""Places along the longest axis where a node may be split."""
DEEPEST = 64
"""Levels of the tree; deeper nodes become leaves of more triangles."""
TINY = 1e-200
"""Stands for a zero component of a direction, so that its reciprocal is finite."""
ON_RIM = 1e-12
"""A ray that passes beside a triangle by less than this share of its edges meets it: no gaps between neighbours."""
OUTWARD = 1.0 + 1e-14
"""Boxes are left so much later: more than the rounding of the slab test (Ize 2013)."""


@njit(cache=True, nogil=True)
def build_tree(corners: Array, order: Array, boxes: Array, links: Array) -> Any:  # pragma: no cover - compiled
    """Write the tree over triangles and return its number of nodes.

    Nodes are split where the surface area heuristic expects least work (Wald 2007, doi:10.1109/RT.2007.4342588).

    Parameters
    ----------
    corners
        (t, 3, 3) corners of the triangles.
    order
        (t,) numbers of the triangles, which are put in the order of the leaves.
    boxes
        (m, 6) least and largest coordinates of the nodes, to be filled; m is at least 2 t.
    links
        (m, 2) per node: first child and 0, or first place in `order` and number of triangles; to be filled.
    """
    middles = np.empty((corners.shape[0], 3))
    for k in range(corners.shape[0]):
        for a in range(3):
            low = min(corners[k, 0, a], corners[k, 1, a], corners[k, 2, a])
            middles[k, a] = 0.5 * (low + max(corners[k, 0, a], corners[k, 1, a], corners[k, 2, a]))
    stack = np.empty((2 * DEEPEST + 2, 4), dtype=np.int64)
    stack[0] = 0, 0, corners.shape[0], 0
    left, nodes = 1, 1
    while left:
        left -= 1
        node, start, end, depth = stack[left]
        _bound(corners, order, start, end, boxes[node])
        middle = start
        if end - start > LEAF and depth < DEEPEST:
            middle = _split(corners, middles, order, start, end)
        if middle in (start, end):
            links[node] = start, end - start
            continue
        links[node] = nodes, 0
        stack[left] = nodes, start, middle, depth + 1
        stack[left + 1] = nodes + 1, middle, end, depth + 1
        left, nodes = left + 2, nodes + 2
    return nodes


@njit(cache=True, nogil=True)
def _bound(corners: Array, order: Array, start: int, end: int, box: Array) -> Any:  # pragma: no cover - compiled
    """Write the box about the triangles at start..end."""
    box[:3], box[3:] = np.inf, -np.inf
    for k in range(start, end):
        for c in range(3):
            for a in range(3):
                box[a] = min(box[a], corners[order[k], c, a])
                box[a + 3] = max(box[a + 3], corners[order[k], c, a])


@njit(cache=True, nogil=True)
def _split(  # noqa: C901, PLR0912 - calls would not be inlined
    corners: Array, middles: Array, order: Array, start: int, end: int
) -> Any:  # pragma: no cover - compiled
    """Put the triangles at start..end in two groups and return where the second begins; `start` for no split."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for k in range(start, end):
        for a in range(3):
            low[a] = min(low[a], middles[order[k], a])
            high[a] = max(high[a], middles[order[k], a])
    best, best_axis, best_bin = np.inf, -1, 0
    counts, boxes = np.zeros(BINS, dtype=np.int64), np.empty((BINS, 6))
    costs, box = np.empty(BINS), np.empty(6)
    for axis in range(3):
        if not high[axis] > low[axis]:
            continue
        scale = BINS / (high[axis] - low[axis])
        counts[:], boxes[:, :3], boxes[:, 3:] = 0, np.inf, -np.inf
        for k in range(start, end):
            b = min(BINS - 1, int((middles[order[k], axis] - low[axis]) * scale))
            counts[b] += 1
            for c in range(3):
                for a in range(3):
                    boxes[b, a] = min(boxes[b, a], corners[order[k], c, a])
                    boxes[b, a + 3] = max(boxes[b, a + 3], corners[order[k], c, a])
        box[:3], box[3:] = np.inf, -np.inf
        count = 0
        for b in range(BINS - 1):
            count += counts[b]
            _join(box, boxes[b])
            costs[b] = count * _half_area(box)
        box[:3], box[3:] = np.inf, -np.inf
        count = 0
        for b in range(BINS - 2, -1, -1):
            count += counts[b + 1]
            _join(box, boxes[b + 1])
            cost = costs[b] + count * _half_area(box)
            if 0 < count < end - start and cost < best:
                best, best_axis, best_bin = cost, axis, b
    if best_axis < 0:
        return start
    scale = BINS / (high[best_axis] - low[best_axis])
    i, j = start, end - 1
    while i <= j:
        if min(BINS - 1, int((middles[order[i], best_axis] - low[best_axis]) * scale)) <= best_bin:
            i += 1
        else:
            order[i], order[j] = order[j], order[i]
            j -= 1
    return i


@njit(cache=True, nogil=True)
def _join(box: Array, other: Array) -> Any:  # pragma: no cover - compiled
    """Make a box larger by another one."""
    for a in range(3):
        box[a] = min(box[a], other[a])
        box[a + 3] = max(box[a + 3], other[a + 3])


@njit(cache=True, nogil=True)
def _half_area(box: Array) -> Any:  # pragma: no cover - compiled
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return x * y + y * z + z * x if x >= 0.0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _enters(box: Array, ray: Any, farthest: float) -> Any:  # pragma: no cover - compiled
    """Return where a ray enters a box, inf where it does not before `farthest`."""
    ox, oy, oz, ix, iy, iz = ray
    x0, x1 = (box[0] - ox) * ix, (box[3] - ox) * ix
    y0, y1 = (box[1] - oy) * iy, (box[4] - oy) * iy
    z0, z1 = (box[2] - oz) * iz, (box[5] - oz) * iz
    near = max(min(x0, x1), min(y0, y1), min(z0, z1), 0.0)
    far = min(max(x0, x1), max(y0, y1), max(z0, z1)) * OUTWARD
    return near if near <= min(far, farthest) else np.inf


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _meets(t: Array, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float) -> Any:  # pragma: no cover
    """Return where along a ray it meets a triangle (Möller and Trumbore 1997), inf where it does not."""
    px, py, pz = dy * t[8] - dz * t[7], dz * t[6] - dx * t[8], dx * t[7] - dy * t[6]
    det = t[3] * px + t[4] * py + t[5] * pz
    inverse = 1.0 / det
    sx, sy, sz = ox - t[0], oy - t[1], oz - t[2]
    u = (sx * px + sy * py + sz * pz) * inverse
    qx, qy, qz = sy * t[5] - sz * t[4], sz * t[3] - sx * t[5], sx * t[4] - sy * t[3]
    v = (dx * qx + dy * qy + dz * qz) * inverse
    inside = u >= -ON_RIM and v >= -ON_RIM and u + v <= 1.0 + ON_RIM  # false where the ray lies in the plane
    return (t[6] * qx + t[7] * qy + t[8] * qz) * inverse if inside else np.inf


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _reciprocal(d: float) -> Any:  # pragma: no cover - compiled
    return 1.0 / d if abs(d) > TINY else np.copysign(1.0 / TINY, d)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "nsz", "reassoc"})  # a minimum of lanes, no NaN
def _packet_enters(boxes: Array, node: int, rays: Array, best: Array) -> Any:  # pragma: no cover - compiled
    """Return where the first ray of a packet enters a box before its `best`, inf where none does."""
    x, y, z = boxes[node, 0], boxes[node, 1], boxes[node, 2]
    xx, yy, zz = boxes[node, 3], boxes[node, 4], boxes[node, 5]
    first = np.inf
    for w in range(LANES):
        x0, x1 = (x - rays[0, w]) * rays[6, w], (xx - rays[0, w]) * rays[6, w]
        y0, y1 = (y - rays[1, w]) * rays[7, w], (yy - rays[1, w]) * rays[7, w]
        z0, z1 = (z - rays[2, w]) * rays[8, w], (zz - rays[2, w]) * rays[8, w]
        near = max(min(x0, x1), min(y0, y1), min(z0, z1), 0.0)
        far = min(max(x0, x1), max(y0, y1), max(z0, z1)) * OUTWARD
        first = min(first, near if near <= min(far, best[w]) else np.inf)
    return first


@njit(cache=True, nogil=True, error_model="numpy")
def _packet_meets(
    t: Array, number: int, rays: Array, best: Array, triangles: Array
) -> Any:  # pragma: no cover - compiled
    """Write where the rays of a packet meet a triangle before their `best` (Möller and Trumbore 1997)."""
    ax, ay, az, ux, uy, uz, vx, vy, vz = t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8]
    for w in range(LANES):
        dx, dy, dz = rays[3, w], rays[4, w], rays[5, w]
        px, py, pz = dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx
        inverse = 1.0 / (ux * px + uy * py + uz * pz)
        sx, sy, sz = rays[0, w] - ax, rays[1, w] - ay, rays[2, w] - az
        u = (sx * px + sy * py + sz * pz) * inverse
        qx, qy, qz = sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux
        v = (dx * qx + dy * qy + dz * qz) * inverse
        along = (vx * qx + vy * qy + vz * qz) * inverse
        inside = (u >= -ON_RIM) & (v >= -ON_RIM) & (u + v <= 1.0 + ON_RIM) & (along > 0.0)  # not where it lies in it
        nearer = inside & ((along < best[w]) | ((along == best[w]) & (number < triangles[w])))
        best[w] = along if nearer else best[w]
        triangles[w] = number if nearer else triangles[w]


@njit(cache=True, nogil=True, error_model="numpy")
def first_hits(  # noqa: C901 - one loop over packets
    tree: Any, origins: Array, directions: Array, start: int, end: int, found: Array
) -> Any:  # pragma: no cover - compiled
    """Write the triangle that rays start..end meet first, -1 for none; of two at one place the lower number.

    Neighbouring rays of a scan take the same way through the tree: they go in packets, in which the compiler does
    several at once.

    Parameters
    ----------
    tree
        Boxes and links of the nodes, (t, 9) triangles in the order of the leaves as corner and two sides, and their
        numbers.
    origins, directions
        (n, 3) of the rays; one row of `origins` is that of all.
    found
        (n,) to be filled.
    """
    boxes, links, sides, order = tree
    stack, entries = np.empty(DEEPEST + 2, dtype=np.int64), np.empty(DEEPEST + 2)
    rays, best, triangles = np.empty((9, LANES)), np.empty(LANES), np.empty(LANES, dtype=np.int64)
    step = 1 if origins.shape[0] > 1 else 0
    for begin in range(start, end, LANES):
        for w in range(LANES):
            k = min(begin + w, end - 1)
            for a in range(3):
                rays[a, w], rays[a + 3, w] = origins[k * step, a], directions[k, a]
                rays[a + 6, w] = _reciprocal(directions[k, a])
        best[:], triangles[:] = np.inf, -1
        left, stack[0], entries[0] = 1, 0, 0.0
        while left:
            left -= 1
            if not entries[left] <= best.max():
                continue
            node = stack[left]
            first, count = links[node, 0], links[node, 1]
            for i in range(first, first + count):
                _packet_meets(sides[i], order[i], rays, best, triangles)
            if count:
                continue
            one = _packet_enters(boxes, first, rays, best)
            other = _packet_enters(boxes, first + 1, rays, best)
            second = 1 if one <= other else 0  # the nearer one is looked at next
            if max(one, other) < np.inf:
                stack[left], entries[left] = first + second, max(one, other)
                left += 1
            if min(one, other) < np.inf:
                stack[left], entries[left] = first + 1 - second, min(one, other)
                left += 1
        for w in range(min(LANES, end - begin)):
            found[begin + w] = triangles[w]


@njit(cache=True, nogil=True, error_model="numpy")
def meets_any(
    tree: Any, origins: Array, directions: Array, near: float, far: float, start: int, end: int, found: Array
) -> Any:  # pragma: no cover - compiled
    """Write whether rays start..end meet a triangle between `near` and `far`, in units of the directions.

    Parameters as of `first_hits`; one row of `directions` is that of all.
    """
    boxes, links, sides, _ = tree
    stack = np.empty(DEEPEST + 2, dtype=np.int64)
    step = 1 if origins.shape[0] > 1 else 0
    turn = 1 if directions.shape[0] > 1 else 0
    for k in range(start, end):
        ox, oy, oz = origins[k * step, 0], origins[k * step, 1], origins[k * step, 2]
        dx, dy, dz = directions[k * turn, 0], directions[k * turn, 1], directions[k * turn, 2]
        ray = (ox, oy, oz, _reciprocal(dx), _reciprocal(dy), _reciprocal(dz))
        left, stack[0], hit = 1, 0, False
        while left and not hit:
            left -= 1
            node = stack[left]
            if _enters(boxes[node], ray, far) == np.inf:
                continue
            first, count = links[node, 0], links[node, 1]
            for i in range(first, first + count):
                along = _meets(sides[i], ox, oy, oz, dx, dy, dz)
                hit = hit or (near <= along <= far and along < np.inf)
            if not count:
                stack[left], stack[left + 1] = first, first + 1
                left += 2
        found[k] = hit


@njit(cache=True, nogil=True, error_model="numpy")
def crossed_triangles(
    tree: Any, origins: Array, directions: Array, start: int, end: int, counts: Array, found: Array
) -> Any:  # pragma: no cover - compiled
    """Count the triangles that segments start..end cross between their ends; write them where there is room.

    Parameters
    ----------
    tree, origins, directions
        As of `first_hits`; a segment ends at origin + direction.
    counts
        (n + 1,) its number of triangles is added at each segment's next place; where `found` has room, the first place
        of each segment.
    found
        (m,) the triangles, to be filled; empty to count only.
    """
    boxes, links, sides, order = tree
    stack = np.empty(DEEPEST + 2, dtype=np.int64)
    for k in range(start, end):
        ox, oy, oz = origins[k, 0], origins[k, 1], origins[k, 2]
        dx, dy, dz = directions[k, 0], directions[k, 1], directions[k, 2]
        ray = (ox, oy, oz, _reciprocal(dx), _reciprocal(dy), _reciprocal(dz))
        left, stack[0], number = 1, 0, 0
        while left:
            left -= 1
            node = stack[left]
            if _enters(boxes[node], ray, 1.0) == np.inf:
                continue
            first, count = links[node, 0], links[node, 1]
            for i in range(first, first + count):
                if 0.0 < _meets(sides[i], ox, oy, oz, dx, dy, dz) < 1.0:
                    if found.shape[0]:
                        found[counts[k] + number] = order[i]
                    number += 1
            if not count:
                stack[left], stack[left + 1] = first, first + 1
                left += 2
        if not found.shape[0]:
            counts[k + 1] = number


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _box_distance2(box: Array, x: float, y: float, z: float) -> Any:  # pragma: no cover - compiled
    dx = max(box[0] - x, x - box[3], 0.0)
    dy = max(box[1] - y, y - box[4], 0.0)
    dz = max(box[2] - z, z - box[5], 0.0)
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True, error_model="numpy")
def _distance2(t: Array, x: float, y: float, z: float) -> Any:  # pragma: no cover - compiled
    """Return the squared distance of a point from a triangle (Ericson 2005, 5.1.5)."""
    px, py, pz = x - t[0], y - t[1], z - t[2]
    ab_ab = t[3] * t[3] + t[4] * t[4] + t[5] * t[5]
    ab_ac = t[3] * t[6] + t[4] * t[7] + t[5] * t[8]
    ac_ac = t[6] * t[6] + t[7] * t[7] + t[8] * t[8]
    d1, d2 = t[3] * px + t[4] * py + t[5] * pz, t[6] * px + t[7] * py + t[8] * pz
    d3, d4 = d1 - ab_ab, d2 - ab_ac
    d5, d6 = d1 - ab_ac, d2 - ac_ac
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    v, w = 0.0, 0.0
    if d1 <= 0.0 and d2 <= 0.0:
        pass
    elif d3 >= 0.0 and d4 <= d3:
        v = 1.0
    elif d6 >= 0.0 and d5 <= d6:
        w = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / ab_ab
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / ac_ac
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        v, w = vb / (va + vb + vc), vc / (va + vb + vc)
    dx, dy, dz = px - v * t[3] - w * t[6], py - v * t[4] - w * t[7], pz - v * t[5] - w * t[8]
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True, error_model="numpy")
def nearest_triangles(
    tree: Any, points: Array, start: int, end: int, found: Array
) -> Any:  # pragma: no cover - compiled
    """Write the triangle nearest to points start..end, of several equally near ones that of the lowest number."""
    boxes, links, sides, order = tree
    stack, distances = np.empty(DEEPEST + 2, dtype=np.int64), np.empty(DEEPEST + 2)
    for k in range(start, end):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        best, best_triangle = np.inf, order[0]
        left, stack[0], distances[0] = 1, 0, 0.0
        while left:
            left -= 1
            if distances[left] > best:
                continue
            node = stack[left]
            first, count = links[node, 0], links[node, 1]
            for i in range(first, first + count):
                distance = _distance2(sides[i], x, y, z)
                if distance < best or (distance == best and order[i] < best_triangle):
                    best, best_triangle = distance, order[i]
            if count:
                continue
            one, other = _box_distance2(boxes[first], x, y, z), _box_distance2(boxes[first + 1], x, y, z)
            second = 1 if one <= other else 0
            stack[left], distances[left] = first + second, max(one, other)
            stack[left + 1], distances[left + 1] = first + 1 - second, min(one, other)
            left += 2
        found[k] = best_triangle
