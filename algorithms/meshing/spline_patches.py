"""Tensor-product B-spline patches over height fields and cylinders, with knots where the fit misses the points.

The source describes a surface by NURBS patches of low degree over rectangles, each as near to the measured data as it
can be, and finds that a grid refined everywhere costs more than the triangles do (Haring 2003, 5.4 and 5.5). Here the
rectangles are given, weights are 1, and a strip between two knots is halved only where the misfit in it is significant.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float64
from scipy.interpolate import BSpline
from scipy.sparse import csc_array, csr_array, diags_array, eye_array, kron
from scipy.sparse.linalg import splu

from algorithms.arrays import Array, Flags, OtherPoints, Points, Scalars, Vector3
from algorithms.deviations.triangles import Mesh
from algorithms.errors import InvalidInputError
from algorithms.probabilities import f_sf

STARTING_SPANS = 4
"""Along each side."""
LEAST_POINTS = 30
"""Of a patch."""
POINTS_PER_COEFFICIENT = 4.0
"""Fewer points on average, and no knot is added."""
STIFFNESS = 1e-6
"""Weight of squared second differences of the coefficients over the mean weight of one: spans gaps, moves nothing."""
SIGNIFICANCE = 1e-4
"""Of the test whether a strip is missed."""
PARTS = 3
"""Each span is looked at in so many parts, both ways."""
ROUNDS = 12
FULL_TURN = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class HeightFieldPatch:
    """A rectangle over which heights are fitted."""

    corner_m: Vector3
    side_u_m: Vector3
    """(3,) first side [m]."""
    side_v_m: Vector3
    """(3,) second side, across the first [m]."""
    reach_m: float
    """Points farther from the rectangle than this take no part [m]."""


@dataclass(frozen=True, eq=False)
class CylinderPatch:
    """A part of a cylinder about which distances from its axis are fitted."""

    start_m: Vector3
    """(3,) where the axis begins [m]."""
    end_m: Vector3
    """(3,) where it ends [m]."""
    towards: Vector3
    """(3,) direction from the axis in which angle 0 lies; need not stand across the axis."""
    from_rad: float
    to_rad: float
    """Angles about the axis between which the patch lies, right-handed; a full turn closes it [rad]."""
    least_radius_m: float
    largest_radius_m: float
    """Points nearer to the axis, or farther from it, take no part [m]."""

    @property
    def closed(self) -> bool:
        """Whether it goes all around."""
        return bool(np.isclose(self.to_rad - self.from_rad, FULL_TURN))


Patch = HeightFieldPatch | CylinderPatch


@dataclass(frozen=True, eq=False)
class _Flat:
    """Points in the rectangle of a patch."""

    u: Scalars
    v: Scalars
    """In [0, 1]."""
    values: Array
    """(n, k) what is fitted: heights, or places across the axis [m]."""
    outward: Array
    """(n, k) unit direction in which the misfit counts."""


@dataclass(frozen=True, eq=False)
class SplinePatch:
    """A fitted patch: S(u, v) = Σ N_i(u) N_j(v) P_ij, a NURBS surface of weights 1."""

    degree: int
    knots_u: Array
    knots_v: Array
    """From 0 to 1; of a side that closes, beyond both."""
    control_m: Float64[Array, "a b 3"]
    """(a, b, 3) control points [m]."""
    closed_u: bool
    """Whether it closes along u."""
    points: int
    """That took part."""
    rms_m: float
    """Of the distances of the points from it [m]."""
    std_m: float
    """Standard deviation of a point, from these and the redundancy [m]."""
    surface_std_m: float
    """Standard deviation of the surface at its points, root mean square [m]; of points that err independently."""
    misfit_m: float
    """Root mean square of the mean distances in parts of the spans, less what noise explains [m]."""
    missed_spans: int
    """Strips between two knots in which the misfit is still significant."""
    distances_m: Scalars
    """(points,) signed, positive along the height or away from the axis [m]."""

    def at(self, u: Scalars, v: Scalars) -> Points:
        """Evaluate it at n parameters in [0, 1]: (n, 3) [m]."""
        design = _design(u, v, self.knots_u, self.knots_v, self.degree)
        return np.asarray(design @ self.control_m.reshape(-1, 3))


def fitted_patch(points: OtherPoints, patch: Patch, degree: int, tolerance_m: float, most_spans: int) -> SplinePatch:
    """Fit a patch by least squares, halving strips of it where it misses the points.

    In each round the residuals are averaged in parts of the spans. A strip between two knots is halved when the means
    in it scatter more than the points within the parts explain (analysis of variance, F test at 1e-4) and their root
    mean square exceeds the tolerance.

    Parameters
    ----------
    points
        (n, 3) all points [m].
    patch
        Rectangle or cylinder.
    degree
        Of the splines, 1 to 5.
    tolerance_m
        Misfits below this are left [m]; 0: only noise decides.
    most_spans
        Largest number of spans along a side.

    Raises
    ------
    InvalidInputError
        The patch has no extent, or too few points.
    """
    flat = _in_patch(points, patch)
    if len(flat.u) < LEAST_POINTS:
        raise InvalidInputError("patches", f"{len(flat.u)} points lie in it", f"{LEAST_POINTS} or more are needed")
    closed = isinstance(patch, CylinderPatch) and patch.closed
    breaks_u, breaks_v = (np.linspace(0.0, 1.0, STARTING_SPANS + 1) for _ in range(2))
    coefficients, outs = _solved(flat, breaks_u, breaks_v, degree, closed=closed)
    for _ in range(ROUNDS):
        missed_u, missed_v, misfit = _missed(flat, outs, breaks_u, breaks_v, tolerance_m)
        finer_u = _halved(breaks_u, missed_u, most_spans)
        finer_v = _halved(breaks_v, missed_v, most_spans)
        size = (len(finer_u) + degree) * (len(finer_v) + degree)
        if len(finer_u) + len(finer_v) == len(breaks_u) + len(breaks_v) or size * POINTS_PER_COEFFICIENT > len(flat.u):
            break
        breaks_u, breaks_v = finer_u, finer_v
        coefficients, outs = _solved(flat, breaks_u, breaks_v, degree, closed=closed)
    missed_u, missed_v, misfit = _missed(flat, outs, breaks_u, breaks_v, tolerance_m)
    knots_u, knots_v = _knots(breaks_u, degree, closed=closed), _knots(breaks_v, degree, closed=False)
    unknowns = (len(breaks_u) - 1 + (0 if closed else degree)) * (len(breaks_v) - 1 + degree)
    redundancy = max(len(outs) - unknowns, 1)
    std = float(np.sqrt(np.sum(outs**2) / redundancy))
    return SplinePatch(
        degree=degree,
        knots_u=knots_u,
        knots_v=knots_v,
        control_m=_control_points(patch, coefficients, knots_u, knots_v, degree),
        closed_u=closed,
        points=len(outs),
        rms_m=float(np.sqrt(np.mean(outs**2))),
        std_m=std,
        surface_std_m=std * float(np.sqrt(unknowns / len(outs))),  # the mean of the hat matrix's diagonal
        misfit_m=misfit,
        missed_spans=int(missed_u.sum() + missed_v.sum()),
        distances_m=outs,
    )


def tessellated(patch: SplinePatch, per_span: int) -> Mesh:
    """Lay triangles over a patch, `per_span` squares along each side of a span, its normals along u x v."""
    u, v = (_parameters(knots, patch.degree, per_span) for knots in (patch.knots_u, patch.knots_v))
    rows, columns = np.meshgrid(u, v, indexing="ij")
    vertices = patch.at(rows.ravel(), columns.ravel())
    if patch.closed_u:
        vertices = vertices[: -len(v)]
    first = np.arange(len(u) - 1)[:, None] * len(v) + np.arange(len(v) - 1)
    following = first + len(v)
    corners = np.stack([first, following, following + 1, first + 1], axis=-1).reshape(-1, 4) % len(vertices)
    return Mesh(vertices, np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]]))


def _parameters(knots: Array, degree: int, per_span: int) -> Array:
    breaks = np.unique(knots[degree : len(knots) - degree])
    parts = [np.linspace(a, b, per_span, endpoint=False) for a, b in pairwise(breaks)]
    return np.concatenate([*parts, [1.0]])


def _in_patch(points: OtherPoints, patch: Patch) -> _Flat:
    """Give the points in a patch by parameters and by what is fitted."""
    if isinstance(patch, HeightFieldPatch):
        length_u, length_v = float(np.linalg.norm(patch.side_u_m)), float(np.linalg.norm(patch.side_v_m))
        apart = points - patch.corner_m
        u, v = apart @ patch.side_u_m / length_u**2, apart @ patch.side_v_m / length_v**2
        heights = apart @ _upward(patch)
        used = _within(u) & _within(v) & (np.abs(heights) <= patch.reach_m)
        return _Flat(u[used], v[used], heights[used, None], np.ones((int(used.sum()), 1)))
    axis, x, y, length = _frame(patch)
    apart = points - patch.start_m
    across = np.column_stack([apart @ x, apart @ y])
    radii = np.hypot(*across.T)
    turn = (np.arctan2(across[:, 1], across[:, 0]) - patch.from_rad) % FULL_TURN
    u, v = turn / (patch.to_rad - patch.from_rad), apart @ axis / length
    used = _within(u) & _within(v) & (radii >= patch.least_radius_m) & (radii <= patch.largest_radius_m)
    values = across[used]
    return _Flat(u[used], v[used], values, values / np.maximum(radii[used], np.finfo(np.float64).tiny)[:, None])


def _within(share: Array) -> Flags:
    return np.asarray((share >= 0.0) & (share <= 1.0))


def _upward(patch: HeightFieldPatch) -> Vector3:
    normal = np.cross(patch.side_u_m, patch.side_v_m)
    return np.asarray(normal / np.linalg.norm(normal))


def _frame(patch: CylinderPatch) -> tuple[Vector3, Vector3, Vector3, float]:
    """Give the axis, the directions of angle 0 and of a right angle, and the length [m]."""
    way = patch.end_m - patch.start_m
    length = float(np.linalg.norm(way))
    axis = way / length
    x = patch.towards - (patch.towards @ axis) * axis
    size = float(np.linalg.norm(x))
    if size <= 1e-6 * float(np.linalg.norm(patch.towards)):
        raise InvalidInputError("patches", "its `towards` lies along the axis", "a direction across it")
    x = x / size
    return axis, x, np.cross(axis, x), length


def _knots(breaks: Array, degree: int, *, closed: bool) -> Array:
    """Give the knots of a side, clamped at its ends or, where it closes, repeated with period 1."""
    if not closed:
        return np.concatenate([np.zeros(degree), breaks, np.ones(degree)])
    before, after = breaks[:-1][-degree:] - 1.0, breaks[1:][:degree] + 1.0
    return np.concatenate([before, breaks, after])


def _design(u: Scalars, v: Scalars, knots_u: Array, knots_v: Array, degree: int) -> csr_array:
    """Give the (n, a b) values of the basis functions, those of v running faster."""
    rows = [csr_array(BSpline.design_matrix(each, knots, degree)) for each, knots in ((u, knots_u), (v, knots_v))]
    n, width = len(u), degree + 1
    values = [each.data.reshape(n, width) for each in rows]
    columns = [each.indices.reshape(n, width).astype(np.int64) for each in rows]
    size_v = rows[1].shape[1]
    data = (values[0][:, :, None] * values[1][:, None, :]).ravel()
    where = (columns[0][:, :, None] * size_v + columns[1][:, None, :]).ravel()
    starts = np.arange(n + 1) * width**2
    return csr_array((data, where, starts), shape=(n, rows[0].shape[1] * size_v))


def _solved(flat: _Flat, breaks_u: Array, breaks_v: Array, degree: int, *, closed: bool) -> tuple[Array, Scalars]:
    """Fit the coefficients (a, b, k) [m], and give the misfits (n,) outward [m]."""
    knots_u, knots_v = _knots(breaks_u, degree, closed=closed), _knots(breaks_v, degree, closed=False)
    design = _design(flat.u, flat.v, knots_u, knots_v, degree)
    size_u, size_v = len(knots_u) - degree - 1, len(knots_v) - degree - 1
    free_u = len(breaks_u) - 1 if closed else size_u
    around = csr_array((np.ones(size_u), (np.arange(size_u), np.arange(size_u) % free_u)), shape=(size_u, free_u))
    unite = kron(around, eye_array(size_v), format="csr")
    united = csr_array(design @ unite)
    bends = [_second_differences(free_u), _second_differences(size_v)]
    stiff = kron(bends[0], eye_array(size_v)) + kron(eye_array(free_u), bends[1])
    normal = united.T @ united
    weight = STIFFNESS * float(normal.diagonal().mean())
    factor = splu(csc_array(normal + weight * stiff + 1e-9 * weight * eye_array(free_u * size_v)))
    coefficients = unite @ factor.solve(np.asarray(united.T @ flat.values))
    outs = np.einsum("ij,ij->i", flat.values - design @ coefficients, flat.outward)
    return coefficients.reshape(size_u, size_v, -1), outs


def _second_differences(size: int) -> csr_array:
    rows = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(max(size - 2, 1), size))
    return csr_array(rows.T @ rows)


def _missed(
    flat: _Flat, outs: Scalars, breaks_u: Array, breaks_v: Array, tolerance_m: float
) -> tuple[Array, Array, float]:
    """Tell which strips along u and v are missed, and give the misfit of all [m]."""
    parts_u, parts_v = (PARTS * (len(each) - 1) for each in (breaks_u, breaks_v))
    i = _part_of(flat.u, breaks_u)
    j = _part_of(flat.v, breaks_v)
    cells = i * parts_v + j
    counts = np.bincount(cells, minlength=parts_u * parts_v).reshape(parts_u, parts_v)
    sums = np.bincount(cells, outs, counts.size).reshape(counts.shape)
    squares = np.bincount(cells, outs**2, counts.size).reshape(counts.shape)
    between = sums**2 / np.maximum(counts, 1)
    within = squares - between
    noise = float(within.sum()) / max(float((counts - (counts > 0)).sum()), 1.0)
    missed = []
    for axis in (0, 1):
        own = [_of_strips(np.sum(each, axis=1 - axis)) for each in (between, within, counts > 0, counts)]
        strip_between, strip_within, cells_in, points_in = own
        free = np.maximum(points_in - cells_in, 1)
        ratio = (strip_between / np.maximum(cells_in, 1)) / np.maximum(strip_within / free, np.finfo(np.float64).tiny)
        apart = np.sqrt(np.maximum(strip_between - cells_in * strip_within / free, 0.0) / np.maximum(points_in, 1))
        significant = f_sf(ratio, np.maximum(cells_in, 1), free) < SIGNIFICANCE
        missed.append(significant & (apart > tolerance_m))
    misfit = float(np.sqrt(max(between.sum() - noise * (counts > 0).sum(), 0.0) / len(outs)))
    return missed[0], missed[1], misfit


def _of_strips(values: Array) -> Array:
    return np.asarray(values.reshape(-1, PARTS).sum(axis=1))


def _part_of(places: Scalars, breaks: Array) -> Array:
    span = np.clip(np.searchsorted(breaks, places, side="right") - 1, 0, len(breaks) - 2)
    share = (places - breaks[span]) / (breaks[span + 1] - breaks[span])
    return np.asarray(PARTS * span + np.clip((PARTS * share).astype(np.int64), 0, PARTS - 1))


def _halved(breaks: Array, missed: Array, most: int) -> Array:
    """Halve the strips that are missed, the widest first, until there are as many as may be."""
    widths = np.diff(breaks)
    chosen = np.flatnonzero(missed)
    chosen = chosen[np.argsort(-widths[chosen], kind="stable")][: max(most - len(widths), 0)]
    return np.sort(np.concatenate([breaks, breaks[chosen] + 0.5 * widths[chosen]]))


def _control_points(patch: Patch, coefficients: Array, knots_u: Array, knots_v: Array, degree: int) -> Array:
    """Lay the coefficients into space: along linear parameters control points lie at the means of their knots."""
    along_u, along_v = (_greville(knots, degree) for knots in (knots_u, knots_v))
    if isinstance(patch, HeightFieldPatch):
        return np.asarray(
            patch.corner_m
            + along_u[:, None, None] * patch.side_u_m
            + along_v[None, :, None] * patch.side_v_m
            + coefficients * _upward(patch)
        )
    axis, x, y, length = _frame(patch)
    across = coefficients @ np.stack([x, y])
    return np.asarray(patch.start_m + across + along_v[None, :, None] * (length * axis))


def _greville(knots: Array, degree: int) -> Array:
    sums: Sequence[Array] = [knots[k : len(knots) - degree - 1 + k] for k in range(1, degree + 1)]
    return np.asarray(np.mean(sums, axis=0))
