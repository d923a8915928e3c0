"""Compiled loops of the cylinder search: local hypotheses, growing over cells, least squares."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array
from algorithms.scans.normals_kernels import smallest_axis


@njit(cache=True, nogil=True)
def _frame(d: Array) -> tuple[Array, Array]:
    """Give two unit vectors across d."""
    k = 0
    for a in range(3):
        if abs(d[a]) < abs(d[k]):
            k = a
    e1 = np.zeros(3)  # unit vector k x d
    e1[(k + 1) % 3] = -d[(k + 2) % 3]
    e1[(k + 2) % 3] = d[(k + 1) % 3]
    e1 /= math.sqrt(e1[0] ** 2 + e1[1] ** 2 + e1[2] ** 2)
    e2 = np.empty(3)
    for a in range(3):
        i, j = (a + 1) % 3, (a + 2) % 3
        e2[a] = d[i] * e1[j] - d[j] * e1[i]
    return e1, e2


@njit(cache=True, nogil=True)
def adjust_cylinder(points: Array, c: Array, d: Array, r: float, iterations: int, huber: float) -> Array:  # noqa: PLR0915 - one compiled loop
    """Fit a cylinder geometrically (distance to axis minus radius) by Gauss-Newton with Huber weights.

    Five parameters: two tilts and two shifts of the axis across itself, and the radius. `c` and `d` are changed in
    place, c stays the foot of the points' mean. Returns the row (radius, rms distance, largest last step) and the rms.
    """
    n = points.shape[0]
    mean = np.zeros(3)
    for i in range(n):
        mean += points[i]
    mean /= n
    c += np.sum((mean - c) * d) * d
    step = np.inf
    rms = 0.0
    for _ in range(iterations):
        e1, e2 = _frame(d)
        total = 0.0
        n1 = nu = nv = nuu = nuv = nvv = su = sv = suu = suv = svv = ssuu = ssuv = ssvv = 0.0
        g0 = g1 = g2 = g3 = g4 = 0.0
        for i in range(n):
            x = points[i, 0] - c[0]
            y = points[i, 1] - c[1]
            z = points[i, 2] - c[2]
            s = x * d[0] + y * d[1] + z * d[2]
            u = x * e1[0] + y * e1[1] + z * e1[2]
            v = x * e2[0] + y * e2[1] + z * e2[2]
            q = math.sqrt(u * u + v * v)
            if q <= 0.0:
                continue
            misfit = q - r
            u /= q
            v /= q
            total += misfit * misfit
            # the row of the Jacobian is (s u, s v, u, v, 1)
            w = 1.0 if abs(misfit) <= huber else huber / abs(misfit)
            wm = w * misfit
            wu = w * u
            wv = w * v
            n1 += w
            nu += wu
            nv += wv
            nuu += wu * u
            nuv += wu * v
            nvv += wv * v
            su += s * wu
            sv += s * wv
            suu += s * wu * u
            suv += s * wu * v
            svv += s * wv * v
            ssuu += s * s * wu * u
            ssuv += s * s * wu * v
            ssvv += s * s * wv * v
            g0 += wm * s * u
            g1 += wm * s * v
            g2 += wm * u
            g3 += wm * v
            g4 += wm
        N = np.array(
            [
                [ssuu, ssuv, suu, suv, su],
                [ssuv, ssvv, suv, svv, sv],
                [suu, suv, nuu, nuv, nu],
                [suv, svv, nuv, nvv, nv],
                [su, sv, nu, nv, n1],
            ]
        )
        g = np.array([g0, g1, g2, g3, g4])
        trace = ssuu + ssvv + nuu + nvv + n1
        for a in range(5):
            N[a, a] += 1e-14 * trace  # keeps a hopeless hypothesis solvable; it fails the later tests
        x5 = np.linalg.solve(N, g)
        c += x5[2] * e1 + x5[3] * e2
        d += x5[0] * e1 + x5[1] * e2
        d /= np.sqrt(np.sum(d * d))
        c += np.sum((mean - c) * d) * d
        r += x5[4]
        rms = math.sqrt(total / n)
        step = np.max(np.abs(x5))
        if step < 1e-10 or not 0.0 < r < 1e3:
            break
    return np.array([r, rms, step])


@njit(cache=True, nogil=True)
def axis_misfits(points: Array, chosen: Array, c: Array, d: Array, r: float) -> Array:
    """Give how far the chosen points are from a cylinder, (len(chosen),) [m]."""
    out = np.empty(len(chosen))
    for k in range(len(chosen)):
        i = chosen[k]
        x = points[i, 0] - c[0]
        y = points[i, 1] - c[1]
        z = points[i, 2] - c[2]
        s = x * d[0] + y * d[1] + z * d[2]
        x -= s * d[0]
        y -= s * d[1]
        z -= s * d[2]
        out[k] = abs(math.sqrt(x * x + y * y + z * z) - r)
    return out


@njit(cache=True, nogil=True)
def _gather(seed: int, normals: Array, neighbours: Array, labels: Array, mark: Array, stamp: int, room: Array) -> int:
    """Collect cells around a seed over steps of less than 40 degrees between normals, breadth first."""
    room[0] = seed
    mark[seed] = stamp
    found = 1
    head = 0
    while head < found < room.shape[0]:
        cell = room[head]
        head += 1
        for k in range(neighbours.shape[1]):
            other = neighbours[cell, k]
            if other < 0 or mark[other] == stamp or labels[other] >= 0:
                continue
            dot = 0.0
            square = 0.0
            for a in range(3):
                dot += normals[cell, a] * normals[other, a]
                square += normals[other, a] ** 2
            if square < 0.5 or abs(dot) < 0.76:
                continue
            mark[other] = stamp
            room[found] = other
            found += 1
            if found == room.shape[0]:
                break
    return found


@njit(cache=True, nogil=True)
def _hypothesis(members: Array, means: Array, normals: Array, c: Array, d: Array) -> float:
    """Guess axis and radius from a patch of cells: axis across all normals, circle by the algebraic fit of Kasa.

    Writes c and d, returns the radius; 0 when the normals do not turn enough to tell, -1 when they turn about more
    than one axis.
    """
    n = members.shape[0]
    xx = xy = xz = yy = yz = zz = 0.0
    for i in members:
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        xx += x * x
        xy += x * y
        xz += x * z
        yy += y * y
        yz += y * z
        zz += z * z
    l1, l2, _, ax, ay, az = smallest_axis(xx / n, xy / n, xz / n, yy / n, yz / n, zz / n)
    if l2 < 0.008:
        return 0.0
    if l1 > 0.25 * l2:
        return -1.0
    d[0] = ax
    d[1] = ay
    d[2] = az
    e1, e2 = _frame(d)
    origin = means[members[0]]
    N = np.zeros((3, 3))
    g = np.zeros(3)
    row = np.ones(3)
    for i in members:
        row[0] = 0.0
        row[1] = 0.0
        for a in range(3):
            row[0] += (means[i, a] - origin[a]) * e1[a]
            row[1] += (means[i, a] - origin[a]) * e2[a]
        square = row[0] ** 2 + row[1] ** 2
        for a in range(3):
            g[a] += row[a] * square
            for b in range(3):
                N[a, b] += row[a] * row[b]
    ridge = 1e-12 * (N[0, 0] + N[1, 1] + N[2, 2])
    for a in range(3):
        N[a, a] += ridge
    x = np.linalg.solve(N, g)
    u = 0.5 * x[0]
    v = 0.5 * x[1]
    square = x[2] + u * u + v * v
    for a in range(3):
        c[a] = origin[a] + u * e1[a] + v * e2[a]
    return math.sqrt(square) if square > 0 else 0.0


@njit(cache=True, nogil=True)
def _misfit(members: Array, means: Array, c: Array, d: Array, r: float) -> float:
    """Give the rms distance of cells from a cylinder."""
    total = 0.0
    for i in members:
        x = means[i, 0] - c[0]
        y = means[i, 1] - c[1]
        z = means[i, 2] - c[2]
        s = x * d[0] + y * d[1] + z * d[2]
        total += (math.sqrt(max(x * x + y * y + z * z - s * s, 0.0)) - r) ** 2
    return math.sqrt(total / members.shape[0])


@njit(cache=True, nogil=True)
def _grow(
    seed: int, means: Array, normals: Array, neighbours: Array, labels: Array,
    c: Array, d: Array, r: float, tolerance: float, mark: Array, stamp: int, room: Array,
) -> int:  # fmt: skip
    """Collect the connected cells that lie on a cylinder with normals across its axis."""
    room[0] = seed
    mark[seed] = stamp
    found = 1
    head = 0
    while head < found:
        cell = room[head]
        head += 1
        for k in range(neighbours.shape[1]):
            other = neighbours[cell, k]
            if other < 0 or mark[other] == stamp or labels[other] >= 0:
                continue
            mark[other] = stamp
            x = means[other, 0] - c[0]
            y = means[other, 1] - c[1]
            z = means[other, 2] - c[2]
            s = x * d[0] + y * d[1] + z * d[2]
            x -= s * d[0]
            y -= s * d[1]
            z -= s * d[2]
            q = math.sqrt(x * x + y * y + z * z)
            if abs(q - r) > tolerance or q <= 0.0:
                continue
            nx, ny, nz = normals[other, 0], normals[other, 1], normals[other, 2]
            if nx * nx + ny * ny + nz * nz > 0.5 and abs(nx * x + ny * y + nz * z) < 0.85 * q:
                continue
            room[found] = other
            found += 1
    return found


@njit(cache=True, nogil=True)
def search_cylinders(  # noqa: C901, PLR0912, PLR0915 - one compiled loop
    seeds: Array, means: Array, normals: Array, neighbours: Array,
    sizes: Array, min_radius: float, max_radius: float, noise: float, min_cells: int,
) -> tuple[Array, Array]:  # fmt: skip
    """Find cylinders among cells: a hypothesis per seed at several patch sizes, grown and fitted in turns.

    Returns labels of the cells (m,), -1 for none, and rows (k, 8): point on the axis, direction, radius, rms.
    """
    m = means.shape[0]
    labels = np.full(m, -1, dtype=np.int32)
    tried = np.zeros(m, dtype=np.bool_)
    mark = np.full(m, -1, dtype=np.int64)
    room = np.empty(m + 1, dtype=np.int64)
    stamp = 0
    rows = np.empty((64, 8))
    count = 0
    c = np.empty(3)
    d = np.empty(3)
    for seed in seeds:
        if labels[seed] >= 0 or tried[seed]:
            continue
        best = 0
        flat = 0
        for size in sizes:
            stamp += 1
            found = _gather(seed, normals, neighbours, labels, mark, stamp, room[:size])
            if found < 12:
                break
            stride = 1 + found // 160
            r = _hypothesis(room[:found:stride], means, normals, c, d)
            flat = found if r == 0.0 else 0
            if r < 0.0:
                break  # clutter; a larger patch of it is no better
            if r < 0.7 * min_radius or r > 1.3 * max_radius:
                continue
            if _misfit(room[:found:stride], means, c, d, r) > max(2.0 * noise, 0.08 * r):
                continue
            previous = 0
            fit = np.array([r, np.inf, np.inf])
            for _ in range(8):
                tolerance = max(3.0 * noise, 0.1 * r)
                stamp += 1
                found = _grow(seed, means, normals, neighbours, labels, c, d, r, tolerance, mark, stamp, room)
                if found < min_cells or found <= previous:
                    break
                previous = found
                fit = adjust_cylinder(means[room[:found]], c, d, r, 6, noise + 0.02 * r)
                r = fit[0]
                if not 0.7 * min_radius <= r <= 1.3 * max_radius:
                    break
            if min_radius <= r <= max_radius and found >= min_cells and fit[1] < max(2.0 * noise, 0.06 * r):
                best = found
                break
        if best == 0:
            # neighbours of a hopeless seed see the same patch
            tried[seed] = True
            for i in range(min(flat, sizes[0])):
                tried[room[i]] = True
            for k in range(neighbours.shape[1]):
                if neighbours[seed, k] >= 0:
                    tried[neighbours[seed, k]] = True
            continue
        for i in range(best):
            labels[room[i]] = count
        if count == rows.shape[0]:
            wider = np.empty((2 * count, 8))
            wider[:count] = rows
            rows = wider
        rows[count, :3] = c
        rows[count, 3:6] = d
        rows[count, 6] = r
        rows[count, 7] = fit[1]
        count += 1
    return labels, rows[:count].copy()
