"""Every shift at once: surface correlated with surface, and with the space that the other scan saw to be empty.

Pairs of lines and planes propose what is likely; where two scans share little, the right pose may be none of it: a
strip of wall seen through a door gives no plane that both scans know. But once a rotation is assumed, how much surface
lies on surface, and how much stands where the other instrument looked through, are correlations of rasters, and Fourier
transforms give them for all shifts. Of each rotation the best peaks go on, so "no other place fits" rests on all shifts
at the rotations tried, but for the size of a cell (MATH 5.4).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import fft

from algorithms.arrays import Array, Matrix3, Points, Vector3
from algorithms.matching.plane_triples import LEAST_SINE, OffsetVotes
from algorithms.matching.votes import Motions, joined
from algorithms.scans.point_blocks import over_blocks
from algorithms.scans.surface_index import SurfaceIndex

MOST_ROTATIONS = 24
"""A building of right angles looks alike in so many."""
LEAST_CELL_M = 0.3
"""Smallest cell of the rasters [m]."""
MOST_CELLS = 1_000_000
"""Cells grow until the transforms have no more than about so many..."""
MOST_PADDED, GROWTH = 8_000_000, 1.2
"""...and, by this factor, until they have no more than so many with the free border, which is most of what is long and
narrow."""
BORDER = 10
"""Cells of free border along each axis, of both scans together."""
SHAPE_STEP = 8
"""Cells along an axis are a multiple of it."""
MOST_PEAKS = 40
"""So many shifts go on for each rotation."""
MOST_CORNERED = 20
"""So many of all are tried from the corners of their cell as well."""
MARGIN_M, MARGIN_RELATIVE = 0.4, 0.03
"""How much nearer than seen a cell's centre must be to be empty [m], and relative to the range."""
FREE_SHARE, PENALTY = 0.03, 10.0
"""Share of what can be judged that may stand in free space, and what each further percent costs in percent of the
support; the cells are coarse, so this is gentler than the final score."""
DIRECTION_CREDIT = 0.1
"""Share of the mean support that each direction is credited with, as the final score does: ground and one facade may be
all that two scans share."""
LEAST_SCORE = 0.002
"""Shifts of a lower score are none."""
ROUNDING = 1e-4
"""Scores that differ by a smaller share are equal: the transforms are in single precision."""


@dataclass(frozen=True, eq=False)
class _Turned:
    """A scan in the frame of the rasters."""

    scan: SurfaceIndex
    turn: Matrix3
    """Frame of the rasters from the scan's."""
    points: Points
    normals: Points

    @staticmethod
    def of(scan: SurfaceIndex, turn: Matrix3) -> "_Turned":
        """Turn a scan."""
        return _Turned(
            scan, turn, np.ascontiguousarray(scan.points @ turn.T), np.ascontiguousarray(scan.normals @ turn.T)
        )


@dataclass(frozen=True, eq=False)
class _Raster:
    """One scan on a raster, (nx, ny, nz) cells."""

    low_m: Vector3
    facing: Array
    """(6, nx, ny, nz) surface by the axis and side it faces."""
    free: Array
    """(nx, ny, nz) space that was looked through."""
    counts: Array
    """(3,) cells of surface along each axis, one at least."""


@dataclass(frozen=True, eq=False)
class _Transforms:
    """What all turns of the source are compared with: transforms of the target."""

    raster: _Raster
    wide: Array
    """(6, ...) surface, and the cells beside it, by the axis and side it faces."""
    surface: Array
    """All of it, each cell for itself."""
    free: Array


def correlated_motions(votes: Sequence[OffsetVotes], target: SurfaceIndex, source: SurfaceIndex) -> Motions:
    """Find, for each rotation that planes propose, the shifts at which most surface meets and least is contradicted.

    Costs about 0.06 s of one processor for each rotation, whatever the scans.

    Parameters
    ----------
    votes
        Rotations as of `plane_triples.offset_votes`, the most likely first.
    target, source
        The two scans.

    Returns
    -------
    Motions with their scores as votes; exact to about half a cell, the leading ones also at the corners of theirs.
    """
    axes = _axes(votes)
    rotations = [each.rotation for each in votes[:MOST_ROTATIONS]]
    if axes is None or not rotations:
        return Motions.empty()
    frame = _upright(axes)
    axes, ours = axes @ frame.T, _Turned.of(target, frame)
    theirs = [_Turned.of(source, frame @ rotation) for rotation in rotations]
    extents = [np.ptp(ours.points, axis=0) + np.ptp(each.points, axis=0) for each in theirs]
    cell = max(_fitting_cell(each) for each in extents)
    shapes = [_padded_shape(each, cell) for each in extents]
    alike = {shape: [each for each, own in zip(theirs, shapes, strict=True) if own == shape] for shape in shapes}
    found = joined([joined(_at_turns(ours, some, axes, cell, shape)) for shape, some in alike.items()])
    found = joined([found, _between_cells(found, cell)])
    turned_back = np.ascontiguousarray(frame.T @ found.rotations)
    return Motions(turned_back, np.ascontiguousarray(found.translations_m @ frame), found.votes)


def _at_turns(
    target: _Turned, sources: Sequence[_Turned], axes: Array, cell_m: float, shape: tuple[int, ...]
) -> list[Motions]:
    """Give the best shifts of a scan in each of its turns, on rasters of one shape."""
    raster = _raster(target, axes, cell_m)
    # a cell's width is all that is known of a place, so the target is one wider on every side
    wide = _marked(target, axes, cell_m, raster.low_m, raster.free.shape, reach=1)
    ours = _Transforms(
        raster,
        _transformed(wide, shape),
        _transformed(raster.facing.sum(axis=0)[None], shape)[0],
        _transformed(raster.free[None], shape)[0],
    )

    def work(start: int, end: int) -> list[Motions]:
        return [_correlated(ours, _raster(each, axes, cell_m), each.turn, cell_m, shape) for each in sources[start:end]]

    return [motions for part in over_blocks(work, len(sources), least=1) for motions in part]


def _upright(axes: Array) -> Matrix3:
    """Give the rotation into the frame nearest to three directions, (3, 3): rasters along the walls are the smallest.

    How a scan lies in its own frame then matters to nothing.
    """
    left, _, right = np.linalg.svd(axes)
    frame = left @ right
    return np.asarray(frame * np.sign(np.linalg.det(frame)))


def _fitting_cell(extents: Array) -> float:
    """Give the edge of the cells [m] for extents of both scans together, (3,) [m]: what they need stays bounded."""
    cell = max(LEAST_CELL_M, float(np.prod(extents / MOST_CELLS ** (1.0 / 3.0)) ** (1.0 / 3.0)))
    while float(np.prod(extents / cell + BORDER)) > MOST_PADDED:
        cell *= GROWTH
    return cell


def _padded_shape(extents_m: Array, cell_m: float) -> tuple[int, ...]:
    """Give the cells along each axis for extents of both scans together, (3,) [m].

    In steps, so that few shapes serve all turns: the target is transformed for each of them.
    """
    cells = SHAPE_STEP * np.ceil((extents_m / cell_m + BORDER) / SHAPE_STEP)
    return tuple(fft.next_fast_len(int(count), real=True) for count in cells)


def _between_cells(found: Motions, cell_m: float) -> Motions:
    """Give the leading shifts again, half a cell off along all axes.

    In a large hall cells are half a metre, and from a corner of one a rack settles on its neighbour's boards.
    """
    best = np.argsort(-found.votes, kind="stable")[:MOST_CORNERED]
    corners = cell_m * (np.array(list(product((0.0, 1.0), repeat=3))) - 0.5)
    return Motions(
        np.repeat(found.rotations[best], len(corners), axis=0),
        (found.translations_m[best][:, None] + corners).reshape(-1, 3),
        np.repeat(found.votes[best], len(corners)),
    )


def _axes(votes: Sequence[OffsetVotes]) -> Array | None:
    """Give three independent directions that the surfaces of the target face; None when there are no two."""
    for each in votes:
        if len(each.axes) == 3:
            return each.axes
    for each in votes:
        if len(each.axes) == 2:
            third = np.cross(each.axes[0], each.axes[1])
            length = float(np.linalg.norm(third))
            if length > LEAST_SINE:
                return np.vstack([each.axes, third / length])
    return None


def _raster(scan: _Turned, axes: Array, cell_m: float) -> _Raster:
    """Put a turned scan on a raster."""
    from algorithms.matching import surface_correlation_kernels as kernels

    low = scan.points.min(axis=0) - 2.0 * cell_m
    size = tuple(int(extent / cell_m) + 5 for extent in np.ptp(scan.points, axis=0))
    free = np.zeros(size, dtype=np.float32)
    seen = scan.scan
    if seen.knows_free_space:
        kernels.mark_free(
            scan.turn, low, cell_m, seen.nearest_m, seen.sensor_m, seen.cell_rad, MARGIN_M, MARGIN_RELATIVE, free
        )
    facing = _marked(scan, axes, cell_m, low, size, reach=0)
    return _Raster(low, facing, free, np.maximum(facing.reshape(2, 3, -1).sum(axis=(0, 2)), 1.0))


def _marked(scan: _Turned, axes: Array, cell_m: float, low_m: Vector3, size: tuple[int, ...], *, reach: int) -> Array:
    """Mark the cells within reach of surface, by the axis and side it faces: (6, ...)."""
    from algorithms.matching import surface_correlation_kernels as kernels

    surface = np.zeros((6, *size), dtype=np.float32)
    kernels.mark_surface(scan.points, scan.normals, axes, low_m, cell_m, reach, surface)
    return surface


def _transformed(fields: Array, shape: tuple[int, ...]) -> Array:
    """Transform fields (k, ...), with zeros behind them up to a shape, axis by axis: rows of zeros need not be."""
    out = np.zeros((len(fields), *shape[:2], shape[2] // 2 + 1), dtype=np.complex64)
    for each, transform in zip(fields, out, strict=True):
        transform[: len(each)] = fft.fft(fft.rfft(each, shape[2], axis=2), shape[1], axis=1, overwrite_x=True)
        # in place: new memory of this size costs more than the transform
        found = fft.fft(transform, axis=0, overwrite_x=True)
        if not np.may_share_memory(found, transform):
            transform[:] = found
    return out


def _transformed_back(transform: Array, shape: tuple[int, ...]) -> Array:
    """Transform back, (n,) cells of a shape; the transform is used up."""
    return np.asarray(fft.irfft(fft.ifft2(transform, axes=(0, 1), overwrite_x=True), shape[2], axis=2).ravel())


def _correlated(
    ours: _Transforms, theirs: _Raster, rotation: Matrix3, cell_m: float, shape: tuple[int, ...]
) -> Motions:
    """Score all shifts of the turned source, and give the best ones.

    One axis after the other: all transforms of the source at once would take three times the memory.
    """
    from algorithms.matching import surface_correlation_kernels as kernels

    our_counts, their_counts = ours.raster.counts, theirs.counts
    their_surface = np.zeros_like(ours.surface)
    supports = []
    for a, share in enumerate(0.5 / our_counts + 0.5 / their_counts):
        along, against = _transformed(theirs.facing[a::3], shape)
        wide = ours.wide[a].ravel(), ours.wide[a + 3].ravel()
        kernels.meet(*wide, along.ravel(), against.ravel(), np.float32(share), their_surface.ravel())
        supports.append(_transformed_back(along, shape))
    free = _transformed(theirs.free[None], shape)[0]
    kernels.contradict(
        ours.free.ravel(), ours.surface.ravel(), free.ravel(), their_surface.ravel(),
        np.float32(0.5 / their_counts.sum()), np.float32(0.5 / our_counts.sum()),
    )  # fmt: skip
    violation = _transformed_back(free, shape)
    score = np.empty(shape, dtype=np.float32)
    kernels.weigh(
        supports[0],
        supports[1],
        supports[2],
        violation,
        FREE_SHARE,
        PENALTY,
        DIRECTION_CREDIT,
        LEAST_SCORE,
        score.ravel(),
    )
    cells, steps = kernels.peaks(score, LEAST_SCORE, ROUNDING)
    votes = score[tuple(cells.T)].astype(np.float64)
    best = np.argsort(-votes, kind="stable")[:MOST_PEAKS]
    # transforms are periodic: what is beyond the target is a shift the other way
    steps = steps[best] - np.where(cells[best] >= np.array(ours.raster.free.shape), shape, 0)
    return Motions(
        np.broadcast_to(rotation, (len(best), 3, 3)).copy(),
        np.ascontiguousarray(ours.raster.low_m - theirs.low_m + cell_m * steps),
        votes[best],
    )
