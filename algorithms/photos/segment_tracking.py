"""Where a straight edge starts and ends: section 4.1.3 of M. Lichtenstein's dissertation (Aachen 2011).

The line is followed step by step and compared with the photo. `track_lines` compares it with the edge pixels of the
binary image, as the dissertation does; `walk_along` with the grey values, once the line is known to a part of a pixel.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Flags, Indices, Scalars
from algorithms.geometry.cameras import Camera
from algorithms.photos.canny import EdgeImage
from algorithms.photos.edge_profile import locate
from algorithms.photos.images import GreyImage
from algorithms.photos.line_fit import EdgeLines, noise_variances, patches_at
from algorithms.photos.options import EdgeOptions
from algorithms.photos.segment_tracking_kernels import follow_lines

SAME_DIRECTION = float(np.cos(np.deg2rad(22.5)))
"""Least cosine between the gradient and the normal of a line to which the edge pixel belongs."""
STEP_PX = 4.0
"""Length of the steps in which lines are followed through the grey values [px]."""
LONGEST_EXTENSION_PX = 48.0
"""Lines are followed so far beyond the ends they came with [px]."""
EXTENSION = 0.5
"""And no further than this part of their length: the direction of short pieces is uncertain."""
LEAST_CONTRAST = 0.4
"""The edge goes on where the contrast is at least this part of the whole edge's."""
LARGEST_SHIFT_PX = 0.6
"""The edge goes on where it lies no further from the line, three standard deviations of its place added."""
LARGEST_DOUBT_PX = 0.3


def track_lines(
    image: EdgeImage,
    normals_rad: Scalars,
    distances_px: Scalars,
    *,
    gap_px: int,
    least_px: float,
    across_px: int = 1,
) -> Float64[Array, "pieces 4"]:
    """Follow lines x cos φ + y sin φ = r through the edge pixels and give the pieces that lie on them.

    Parameters
    ----------
    image
        Binary image of the edges, and the gradients: pixels of edges that only cross the line do not count.
    normals_rad, distances_px
        (m,) φ and r of the lines.
    gap_px
        So many steps without edge pixels end a piece.
    least_px
        Shorter pieces are left out.
    across_px
        Edge pixels so far beside the line count.

    Returns
    -------
    x and y of start and end of the pieces, those of one line in their order.
    """
    return np.asarray(
        follow_lines(
            image.edges, image.gx, image.gy, normals_rad, distances_px, gap_px, least_px, across_px, SAME_DIRECTION
        )
    )


def inside_photo(
    lines: EdgeLines, owners: Indices, positions: Scalars, grey: GreyImage, camera: Camera | None
) -> Flags:
    """Tell which places along lines lie in the photo."""
    ideal = lines.centres[owners] + positions[:, None] * lines.directions[owners]
    limit = np.array([grey.shape[1], grey.shape[0]]) - 1.5
    if camera is None or not camera.distorts:
        return np.asarray(np.all((ideal >= 0.5) & (ideal <= limit), axis=1))
    rays = (ideal - np.array([camera.cx, camera.cy])) / np.array([camera.fx, camera.fy])
    inside = np.hypot(rays[:, 0], rays[:, 1]) < camera.max_radius
    image = camera.image_from_ideal(ideal[inside])
    inside[inside] = np.all((image >= 0.5) & (image <= limit), axis=1)
    return np.asarray(inside)


def walk_along(grey: GreyImage, lines: EdgeLines, camera: Camera | None, options: EdgeOptions) -> EdgeLines:
    """Follow every line through the grey values, inside and beyond its ends, and give start and end where the edge is.

    The edge is there where a step of `STEP_PX` shows a good part of the line's contrast, with the same sign, and lies
    on the line. Of the runs of such steps, interrupted by at most `max_gap_px`, the one with the most steps between the
    old ends is taken, and every other one that is long enough there to be an edge by itself; lines without any vanish.
    """
    if len(lines) == 0:
        return lines
    counts = np.ceil((lines.lengths + 2.0 * LONGEST_EXTENSION_PX) / STEP_PX).astype(np.int64)
    owners = np.repeat(np.arange(len(lines)), counts)
    rank = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    positions = lines.extents[owners, 0] - LONGEST_EXTENSION_PX + (rank + 0.5) * STEP_PX
    beyond = np.maximum(lines.extents[owners, 0] - positions, positions - lines.extents[owners, 1])
    near = beyond < EXTENSION * lines.lengths[owners]
    owners, rank, positions = owners[near], rank[near], positions[near]
    inside = inside_photo(lines, owners, positions, grey, camera)
    owners, rank, positions = owners[inside], rank[inside], positions[inside]
    placed = patches_at(lines, owners, positions, np.full(len(owners), STEP_PX), camera)
    points = locate(grey, placed.patches, lines.widths, lines.half_widths, "gaussian")
    between = (positions > lines.extents[owners, 0]) & (positions < lines.extents[owners, 1])
    inner = np.bincount(owners[between], points.contrasts[between], len(lines))
    typical = inner / np.maximum(np.bincount(owners[between], minlength=len(lines)), 1)
    noise = noise_variances(points, owners, len(lines))[owners]
    doubt = np.sqrt(noise / np.maximum(points.information, 1e-12))
    good = (
        (points.information > 0.0)
        & (typical[owners] > 0.0)
        & (points.contrasts > LEAST_CONTRAST * typical[owners])
        & (np.abs(points.shifts) < LARGEST_SHIFT_PX + 3.0 * np.minimum(doubt, LARGEST_DOUBT_PX))
    )
    # of the step in which the edge ends only the part that shows its contrast
    owners, rank, positions, between = owners[good], rank[good], positions[good], between[good]
    missing = STEP_PX * (1.0 - np.clip(points.contrasts[good] / typical[owners], 0.0, 1.0))
    steps = int(options.max_gap_px // STEP_PX) + 1
    breaks = (np.diff(owners) != 0) | (np.diff(rank) > steps)
    run = np.concatenate([[0], np.cumsum(breaks)])[: len(owners)]
    weight = np.bincount(run, between.astype(np.float64))
    run_owner = owners[np.searchsorted(run, np.arange(len(weight)))]
    best = np.lexsort((-weight, run_owner))
    longest = np.concatenate([[True], np.diff(run_owner[best]) != 0])[: len(best)]
    best = best[(longest & (weight[best] > 0.0)) | (STEP_PX * weight[best] >= options.min_length_px)]
    first, last = np.searchsorted(run, best, side="left"), np.searchsorted(run, best, side="right") - 1
    start = positions[first] - 0.5 * STEP_PX + missing[first]
    end = positions[last] + 0.5 * STEP_PX - missing[last]
    longer = end > start
    return replace(lines[run_owner[best]][longer], extents=np.column_stack([start, end])[longer])
