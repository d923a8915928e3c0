"""Run 2: the same patches in all strips that see their places (Kager 2003, 2.2)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Flags, Indices, Matrices3, Points, Scalars
from algorithms.strips.candidates import Candidates
from algorithms.strips.options import PatchOptions
from algorithms.strips.patch_kernels import fit_planes
from algorithms.strips.strip import Strip

OFF_MIDDLE = 0.5
"""Middles of a patch's points are not further off its place than this share of its radius."""
LEAST_WIDTH = 0.2
"""Least rms extent of the points, over the radius."""
LEAST_STD_M = 0.01
"""Points that near a plane are no outliers, however little the others scatter [m]."""


@dataclass(frozen=True, eq=False)
class PointCells:
    """A strip's points by cells in plan."""

    order: Int64[Array, "n"]
    starts: Int64[Array, "cells"]
    x0: float
    y0: float
    edge_m: float
    columns: int
    rows: int
    fullest: int
    """Points of three by three cells at most."""

    @staticmethod
    def of(points: Points, edge_m: float) -> "PointCells":
        """Sort points into cells. O(n)."""
        low = points[:, :2].min(axis=0)
        cells = np.floor((points[:, :2] - low) / edge_m).astype(np.int64)
        columns, rows = (int(cells[:, k].max()) + 1 for k in range(2))
        numbers = cells[:, 1] * columns + cells[:, 0]
        counts = np.bincount(numbers, minlength=rows * columns)
        order = np.argsort(numbers, kind="stable").astype(np.int64)
        starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        around = np.pad(counts.reshape(rows, columns), 1)
        blocks = np.lib.stride_tricks.sliding_window_view(around, (3, 3))
        fullest = max(int(blocks.sum(axis=(2, 3)).max()), 1)
        return PointCells(order, starts, float(low[0]), float(low[1]), edge_m, columns, rows, fullest)

    def occupied(self, places: Points) -> Flags:
        """Tell in whose cells there are points (k,)."""
        column = np.floor((places[:, 0] - self.x0) / self.edge_m).astype(np.int64)
        row = np.floor((places[:, 1] - self.y0) / self.edge_m).astype(np.int64)
        inside = (column >= 0) & (row >= 0) & (column < self.columns) & (row < self.rows)
        cells = np.where(inside, row * self.columns + column, 0)
        return np.asarray(inside & (self.starts[cells + 1] > self.starts[cells]))


@dataclass(frozen=True, eq=False)
class Ties:
    """Patches as strips see them: k observations of planes, each by four anchor points (MATH 12.2)."""

    patches: Int64[Array, "k"]
    """(k,) number of each one's patch."""
    strips: Int64[Array, "k"]
    """(k,) number of the strip that sees it so."""
    anchors_m: Float64[Array, "k 4 3"]
    """On the strip's own plane, at the rms distances of its points along their main axes [m]."""
    times_s: Float64[Array, "k 4"]
    """When the strip was there [s]."""
    std_m: Scalars
    """(k,) of the mean of the four along the normal, and of their two tilts at the anchors [m]."""
    points: Int64[Array, "k"]
    """(k,) points in the plane."""
    rms_m: Scalars
    """(k,) standard deviation of a point [m]."""
    lag_m: Scalars
    """(k,) half of the distance along the normal between both directions of the mirror; NaN where there is one only."""
    lag_std_m: Scalars

    def __len__(self) -> int:
        return len(self.patches)

    def selected(self, which: Array) -> "Ties":
        """Keep some."""
        return Ties(
            self.patches[which], self.strips[which], self.anchors_m[which], self.times_s[which], self.std_m[which],
            self.points[which], self.rms_m[which], self.lag_m[which], self.lag_std_m[which],
        )  # fmt: skip


def chosen_seeds(candidates: Sequence[Candidates], cells: Sequence[PointCells], options: PatchOptions) -> Candidates:
    """Choose of the candidates of all strips those that become patches: in two strips or more, and spread out.

    Of each slope and aspect, and each set of strips that overlap there, the best one of a square of `spacing_m`.
    """
    every = Candidates(
        np.concatenate([each.places_m for each in candidates]),
        np.concatenate([each.normals for each in candidates]),
        np.concatenate([each.std_m for each in candidates]),
        np.concatenate([each.classes for each in candidates]),
    )
    seen = np.stack([each.occupied(every.places_m) for each in cells], axis=1)
    shared = np.flatnonzero(seen.sum(axis=1) >= 2)
    if len(shared) == 0:
        return every.selected(shared)
    every, seen = every.selected(shared), seen[shared]
    _, sets = np.unique(seen, axis=0, return_inverse=True)
    squares = np.floor(every.places_m[:, :2] / options.spacing_m).astype(np.int64)
    keys = np.column_stack([squares, every.classes, sets.ravel()])
    order = np.lexsort((every.std_m, *keys.T[::-1]))
    ordered = keys[order]
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    chosen = order[first]
    step = -(-len(chosen) // options.most)
    return every.selected(np.sort(chosen)[::step])


def homologous(
    strips: Sequence[Strip],
    cells: Sequence[PointCells],
    places: Sequence[Points],
    frames: Matrices3,
    radii_m: Scalars,
    options: PatchOptions,
) -> Ties:
    """Fit the planes of patches in every strip, and keep those that can be the same.

    Parameters
    ----------
    strips, cells
        Strips, and their points by cells.
    places
        Of each strip (k, 3): where the reference points of the patches are in it, as far as is known [m].
    frames
        (k, 3, 3) columns e1, e2, normal of the patches.
    radii_m
        (k,) of the patches [m].
    options
        What counts as a patch.

    Returns
    -------
    What strips see; patches that no strip sees are in it nowhere.
    """
    parts = []
    for number, (strip, cell, place) in enumerate(zip(strips, cells, places, strict=True)):
        where = np.flatnonzero(cell.occupied(place))
        if len(where) == 0:
            continue
        senses = np.zeros(len(strip.points), dtype=np.int8) if strip.directions is None else strip.directions
        counts, figures = fit_planes(
            strip.points, strip.times_s, senses, cell.order, cell.starts, cell.x0, cell.y0, cell.edge_m, cell.columns,
            cell.rows, place[where], frames[where], radii_m[where], LEAST_STD_M, cell.fullest,
        )  # fmt: skip
        good = _compatible(counts, figures, radii_m[where], options)
        found = where[good]
        own = _ties(number, found, place[found], frames[found], counts[good], figures[good], options)
        times = times_counted(place[found, :2], radii_m[found])
        parts.append(replace(own, std_m=own.std_m * np.sqrt(times)))
    return joined(parts)


def times_counted(places: Array, radii_m: Scalars) -> Scalars:
    """Give how often the points of each patch (k,) are counted: once, and what others share of it, by areas in plan.

    Patches that overlap have points in common. With variances so many times as large these count once in all, and none
    of the patches is missing where another is wrong.

    Parameters
    ----------
    places
        (k, 2) of middles in plan [m].
    radii_m
        (k,) [m].
    """
    out = np.ones(len(places))
    pairs = cKDTree(places).query_pairs(2.0 * float(radii_m.max(initial=0.0)), output_type="ndarray")
    if len(pairs) == 0:
        return out
    distance = np.hypot(*(places[pairs[:, 0]] - places[pairs[:, 1]]).T)
    r, s = radii_m[pairs].T
    near = distance < r + s
    pairs, r, s = pairs[near], r[near], s[near]
    # a circle inside the other is the limit of the two that touch from inside
    d = np.maximum(distance[near], np.maximum(np.abs(r - s), 1e-9))
    a, b = (np.arccos(np.clip((d**2 + p**2 - q**2) / (2.0 * d * p), -1.0, 1.0)) for p, q in ((r, s), (s, r)))
    lens = r**2 * (a - 0.5 * np.sin(2.0 * a)) + s**2 * (b - 0.5 * np.sin(2.0 * b))
    np.add.at(out, pairs[:, 0], lens / (np.pi * r**2))
    np.add.at(out, pairs[:, 1], lens / (np.pi * s**2))
    return out


def joined(parts: Sequence[Ties]) -> Ties:
    """Put what strips see one after the other."""
    if not parts:
        none = np.zeros(0)
        whole = np.zeros(0, dtype=np.int64)
        return Ties(whole, whole, np.zeros((0, 4, 3)), np.zeros((0, 4)), none, whole, none, none, none)
    names = ("patches", "strips", "anchors_m", "times_s", "std_m", "points", "rms_m", "lag_m", "lag_std_m")
    return Ties(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _compatible(counts: Array, figures: Array, radius: Array, options: PatchOptions) -> Flags:
    used = np.maximum(counts[:, 1], 1)
    uu, uv, vv = figures[:, 8], figures[:, 9], figures[:, 10]
    least = 0.5 * (uu + vv) - np.sqrt(0.25 * (uu - vv) ** 2 + uv**2)
    return np.asarray(
        (counts[:, 1] >= options.least_points)
        & (figures[:, 5] <= options.std_m)
        & (1.0 - used / np.maximum(counts[:, 0], 1) <= options.outlier_share)
        & (np.abs(figures[:, 0]) <= options.max_gap_m)
        & (np.hypot(figures[:, 1], figures[:, 2]) <= np.tan(np.radians(options.max_tilt_deg)))
        & (np.hypot(figures[:, 6], figures[:, 7]) <= OFF_MIDDLE * radius)
        & (least >= (LEAST_WIDTH * radius) ** 2)
    )


def _ties(
    strip: int,
    patches: Indices,
    places: Points,
    frames: Matrices3,
    counts: Array,
    figures: Array,
    options: PatchOptions,
) -> Ties:
    """Put four anchors at the rms distances along the main axes, which weigh as all points do (MATH 12.2)."""
    c0, c1, c2, lag, lag_share, rms, mu, mv, uu, uv, vv, mt, tu, tv = figures.T
    moments = np.stack([np.stack([uu, uv], axis=-1), np.stack([uv, vv], axis=-1)], axis=-2)
    values, axes = np.linalg.eigh(moments)
    arms = axes * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    offsets = np.einsum("kia,ja->kji", arms, signs)
    u, v = offsets[..., 0] + mu[:, None], offsets[..., 1] + mv[:, None]
    w = c0[:, None] + c1[:, None] * u + c2[:, None] * v
    anchors = places[:, None, :] + np.einsum("kij,kaj->kai", frames, np.stack([u, v, w], axis=-1))
    rates = np.linalg.solve(moments, np.stack([tu, tv], axis=-1)[..., None])[..., 0]
    times = mt[:, None] + np.einsum("kji,ki->kj", offsets, rates)
    both = lag_share > 0.0
    return Ties(
        patches=patches.astype(np.int64),
        strips=np.full(len(patches), strip, dtype=np.int64),
        anchors_m=anchors,
        times_s=times,
        std_m=np.sqrt(rms**2 / np.maximum(counts[:, 1], 1) + options.floor_m**2),
        points=counts[:, 1],
        rms_m=rms,
        lag_m=np.where(both, lag, np.nan),
        lag_std_m=np.where(both, rms * np.sqrt(lag_share), np.nan),
    )
