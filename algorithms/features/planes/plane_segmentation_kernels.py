"""Compiled loops of plane segmentation: growing regions over cells, and labelling cells."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array
from algorithms.scans.normals_kernels import smallest_axis

STEPS = 1 << 16
"""Qualities of seeds are told apart in so many steps, which are sorted by counting."""


@njit(cache=True, nogil=True)
def write_pieces(
    moments: Array,
    normals: Array,
    residuals: Array,
    widths: Array,
    sensor: Array,
    flatness: float,
    cap: float,
    noise: float,
    least_share: float,
    limits: tuple[float, float],
    start: int,
    end: int,
    pieces: Array,
    steps: Array,
) -> None:
    """Write what region growing reads of the cells from `start` to `end`, a row of (m, 8) each.

    These are the normal (zero unless the cell is flat), the mean, how far it may lie off a plane, and its weight; one
    row is one line of the cache. `steps` gets the quality of flat cells as seeds, from 0 (best), and `STEPS` for
    others. The noise across a surface is that of ranges times the cosine of incidence, at least `least_share`, where
    the sensor is known (not nan); the limit is the root of the squares of limits[0] times noise and of limits[1].
    """
    known = not math.isnan(sensor[0])
    for cell in range(start, end):
        flat = residuals[cell] < flatness * widths[cell]
        steps[cell] = int(residuals[cell] / widths[cell] * ((STEPS - 1) / flatness)) if flat else STEPS
        across = noise
        if known:
            dot = 0.0
            square = 0.0
            for a in range(3):
                ray = moments[cell, 1 + a] - sensor[a]
                dot += ray * normals[cell, a]
                square += ray * ray
            cosine = abs(dot) / max(math.sqrt(square), 1e-9) if flat else 0.0
            across = noise * min(max(cosine, least_share), 1.0)
        for a in range(3):
            pieces[cell, a] = normals[cell, a] if flat else 0.0
            pieces[cell, 3 + a] = moments[cell, 1 + a]
        pieces[cell, 6] = math.hypot(limits[0] * across, limits[1])
        pieces[cell, 7] = min(moments[cell, 0], cap)


@njit(cache=True, nogil=True)
def ordered_seeds(steps: Array) -> Array:
    """List the flat cells by their quality as seeds, the best first, of equals the first."""
    starts = np.zeros(STEPS + 2, dtype=np.int64)
    for step in steps:
        starts[step + 1] += 1
    for k in range(STEPS):
        starts[k + 1] += starts[k]
    out = np.empty(starts[STEPS], dtype=np.int32)
    for cell in range(steps.shape[0]):
        step = steps[cell]
        if step < STEPS:
            out[starts[step]] = cell
            starts[step] += 1
    return out


@njit(cache=True, nogil=True)
def grow_regions(  # noqa: C901, PLR0915 - one compiled loop
    order: Array, pieces: Array, neighbours: Array, cos_limit: float, min_cells: int
) -> tuple[Array, int]:
    """Grow regions of cells that lie on one plane, in the given order of seeds; `pieces` as `write_pieces` gives them.

    A cell joins when its normal agrees with the region's plane and its mean lies on it within the cell's limit; the
    plane is fitted anew whenever the region has grown by a quarter. Regions below `min_cells` are dissolved. Returns
    labels and the number of regions.
    """
    m = pieces.shape[0]
    labels = np.full(m, -1, dtype=np.int32)
    stack = np.empty(m, dtype=np.int32)
    count = 0
    for seed in order:
        if labels[seed] >= 0:
            continue
        ox, oy, oz = pieces[seed, 3], pieces[seed, 4], pieces[seed, 5]
        nx, ny, nz = pieces[seed, 0], pieces[seed, 1], pieces[seed, 2]
        d = 0.0
        w = sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
        refit_at = 12
        size = 0
        stack[0] = seed
        labels[seed] = count
        top = 1
        head = 0
        while head < top:  # breadth first: the region stays compact while its plane is still uncertain
            cell = stack[head]
            head += 1
            size += 1
            f = pieces[cell, 7]
            x = pieces[cell, 3] - ox
            y = pieces[cell, 4] - oy
            z = pieces[cell, 5] - oz
            w += f
            sx += f * x
            sy += f * y
            sz += f * z
            xx += f * x * x
            xy += f * x * y
            xz += f * x * z
            yy += f * y * y
            yz += f * y * z
            zz += f * z * z
            if size >= refit_at:
                refit_at = size + max(12, size // 4)
                ax, ay, az = sx / w, sy / w, sz / w
                _, _, _, ux, uy, uz = smallest_axis(
                    xx / w - ax * ax,
                    xy / w - ax * ay,
                    xz / w - ax * az,
                    yy / w - ay * ay,
                    yz / w - ay * az,
                    zz / w - az * az,
                )
                dot = ux * nx + uy * ny + uz * nz
                if abs(dot) > 0.8:
                    sign = 1.0 if dot > 0 else -1.0
                    nx, ny, nz = sign * ux, sign * uy, sign * uz
                    d = nx * ax + ny * ay + nz * az
            for k in range(neighbours.shape[1]):
                other = neighbours[cell, k]
                if other < 0 or labels[other] >= 0:
                    continue
                dot = pieces[other, 0] * nx + pieces[other, 1] * ny + pieces[other, 2] * nz
                if abs(dot) < cos_limit:
                    continue
                gap = (pieces[other, 3] - ox) * nx + (pieces[other, 4] - oy) * ny + (pieces[other, 5] - oz) * nz - d
                if abs(gap) > pieces[other, 6]:
                    continue
                labels[other] = count
                stack[top] = other
                top += 1
        if size < min_cells:
            for i in range(top):
                labels[stack[i]] = -1
        else:
            count += 1
    return labels, count


@njit(cache=True, nogil=True)
def dilate_labels(
    labels: Array,
    moments: Array,
    neighbours: Array,
    normals: Array,
    centroids: Array,
    tolerances: Array,
    start: int,
    end: int,
    out: Array,
) -> None:
    """Write the label of the neighbouring plane they lie on best to cells from `start` to `end` that have none."""
    for cell in range(start, end):
        if labels[cell] >= 0:
            continue
        best = 1.0
        for k in range(neighbours.shape[1]):
            other = neighbours[cell, k]
            if other < 0 or labels[other] < 0:
                continue
            p = labels[other]
            gap = 0.0
            for a in range(3):
                gap += (moments[cell, 1 + a] - centroids[p, a]) * normals[p, a]
            gap = abs(gap) / tolerances[p]
            if gap < best:
                best = gap
                out[cell] = p


@njit(cache=True, nogil=True)
def touching_labels(labels: Array, neighbours: Array, start: int, end: int, touch: Array) -> None:
    """Mark which regions touch at the cells from `start` to `end`, directly or across one of them without a label.

    The marks go into `touch`, (count, count) bool; every block writes the same mark.
    """
    around = np.empty(neighbours.shape[1], dtype=np.int32)
    for cell in range(start, end):
        found = 0
        for k in range(neighbours.shape[1]):
            other = neighbours[cell, k]
            if other < 0 or labels[other] < 0:
                continue
            known = False
            for i in range(found):
                known = known or around[i] == labels[other]
            if not known:
                around[found] = labels[other]
                found += 1
        for i in range(found):
            if labels[cell] >= 0:
                touch[labels[cell], around[i]] = True
                touch[around[i], labels[cell]] = True
            else:
                for j in range(found):
                    touch[around[i], around[j]] = True


@njit(cache=True, nogil=True)
def candidate_labels(labels: Array, neighbours: Array, width: int, start: int, end: int, only: Array) -> Array:
    """List the different labels of each cell from `start` to `end` and its neighbours, own first.

    Writes (m,) int32: the label where there is but one, -1 for none, -2 - q for those in row q of what is returned:
    (rows, width) int32, -1 padded.
    """
    several = np.full((64, width), -1, dtype=np.int32)
    rows = 0
    found = np.empty(width, dtype=np.int32)
    for cell in range(start, end):
        only[cell] = -1
        count = 0
        for k in range(-1, neighbours.shape[1]):
            other = cell if k < 0 else neighbours[cell, k]
            if other < 0 or labels[other] < 0 or count == width:
                continue
            label = labels[other]
            known = False
            for i in range(count):
                known = known or found[i] == label
            if not known:
                found[count] = label
                count += 1
        if count == 1:
            only[cell] = found[0]
        elif count > 1:
            if rows == several.shape[0]:
                wider = np.full((2 * rows, width), -1, dtype=np.int32)
                wider[:rows] = several
                several = wider
            several[rows, :count] = found[:count]
            only[cell] = -2 - rows
            rows += 1
    return several[:rows].copy()


@njit(cache=True, nogil=True)
def shift_rows(only: Array, rows: int, start: int, end: int) -> None:
    """Let what `candidate_labels` wrote for the cells from `start` to `end` point so many rows further on."""
    for cell in range(start, end):
        if only[cell] < -1:
            only[cell] -= rows


@njit(cache=True, nogil=True)
def renumber_labels(labels: Array, numbers: Array, start: int, end: int) -> None:
    """Give the cells from `start` to `end` the new numbers of their regions, in place."""
    for cell in range(start, end):
        if labels[cell] >= 0:
            labels[cell] = numbers[labels[cell]]


@njit(cache=True, nogil=True)
def incidences(positions: Array, normals: Array, sensor: Array) -> Array:
    """Give the cosines, without sign, at which surfaces are met from the sensor, (n,); 0 where there is no normal."""
    out = np.empty(positions.shape[0])
    for i in range(positions.shape[0]):
        dot = 0.0
        square = 0.0
        for a in range(3):
            ray = positions[i, a] - sensor[a]
            dot += ray * normals[i, a]
            square += ray * ray
        out[i] = abs(dot) / max(math.sqrt(square), 1e-9)
    return out


@njit(cache=True, nogil=True)
def agreements(labels: Array, pieces: Array, region_normals: Array, start: int, end: int) -> Array:
    """Add the scalar products of the normals of cells, which begin the rows of `pieces`, with their region's, (k,)."""
    out = np.zeros(region_normals.shape[0])
    for cell in range(start, end):
        p = labels[cell]
        if p >= 0:
            for a in range(3):
                out[p] += pieces[cell, a] * region_normals[p, a]
    return out
