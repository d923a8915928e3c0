"""Plane models under constraints: vertical, parallel, orthogonal planes adjusted together, and their corners.

The source models a plinth by planes of which some are forced to be vertical, and intersects them (Haring 2003, 5.3.2).
Here all planes are adjusted together as Gauss-Helmert model with constraints (Mikhail 1976): condition of a point x of
plane i is n_i · (x - c_i) - b_i = 0, of which all three coordinates are observed with one standard deviation. Since the
derivatives to the coordinates are n_i, of unit length, every condition has that variance, and only moments of the
points are needed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.linalg import qr, solve

from algorithms.arrays import Array, Matrix, Matrix3, Vector, Vector3
from algorithms.errors import DegenerateGeometryError, InvalidInputError, NotConvergedError
from algorithms.geometry.lines import bases_of
from algorithms.meshing.options import PlaneRelation

ITERATIONS = 50
SETTLED = 1e-12
"""Largest step of a normal [rad] and of a shift, in extents of its plane."""
DEPENDENT = 0.05
"""Constraints whose derivatives follow from others to this share are repetitions, which planes that do not keep them
yet show only as far as they keep them. In the end all must hold, also those left out."""
LEAST_PLANE_POINTS = 4
FLATTEST_CORNER = 1e-6
"""Three normals that span a smaller volume meet in no point."""


@dataclass(frozen=True)
class PlaneConstraint:
    """One constraint."""

    relation: PlaneRelation
    one: int
    """Number of a plane."""
    other: int = -1
    """Of the other one; of no meaning for `vertical`."""


@dataclass(frozen=True, eq=False)
class PlaneModel:
    """Planes that keep their constraints."""

    normals: Float64[Array, "k 3"]
    """(k, 3) unit normals."""
    centroids: Float64[Array, "k 3"]
    """(k, 3) a point of each plane, next to the centroid of its points [m]."""
    bases: Float64[Array, "k 3 2"]
    """(k, 3, 2) columns E1, E2 across the normal."""
    covariance: Matrix
    """(3k, 3k) of (a1, a2, b) of all planes: n -> n + E a, c -> c + n b [rad, m], with the estimated variance."""
    std_m: float
    """Of a point across its plane, estimated [m]."""
    redundancy: int
    rms_m: Float64[Array, "k"]
    """(k,) of the points of each plane [m]."""
    iterations: int


def adjusted_planes(points: Sequence[Array], constraints: Sequence[PlaneConstraint]) -> PlaneModel:
    """Adjust planes together.

    Parameters
    ----------
    points
        (n_i, 3) points of each plane, all of one standard deviation [m].
    constraints
        What they must keep; repetitions do no harm.

    Raises
    ------
    InvalidInputError
        A plane has fewer than four points, or a constraint joins what is far from keeping it.
    DegenerateGeometryError
        The points of a plane lie on one line.
    NotConvergedError
        The iteration did not settle, as with constraints that contradict each other.
    """
    few = [k for k, each in enumerate(points) if len(each) < LEAST_PLANE_POINTS]
    if few:
        raise InvalidInputError("planes", f"plane {few[0]} has {len(points[few[0]])} points", "four or more")
    counts = np.array([len(each) for each in points])
    centroids = np.array([each.mean(axis=0) for each in points])
    scatters = np.array([(each - mean).T @ (each - mean) for each, mean in zip(points, centroids, strict=True)])
    values, vectors = np.linalg.eigh(scatters)
    for k, spread in enumerate(values):
        if spread[1] <= 1e-12 * spread[2]:
            raise DegenerateGeometryError(2, [f"plane {k} turned about the line of its points"], parameters=3)
    normals, shifts = vectors[:, :, 0].copy(), np.zeros(len(points))
    extents = np.sqrt(values[:, 2] / counts)
    iterations = 0
    for _ in range(ITERATIONS):
        iterations += 1
        bases = bases_of(normals)
        normal, right = _normal_equations(normals, bases, shifts, scatters, counts)
        misses, jacobian = constraint_values(normals, bases, constraints)
        chosen = _independent(jacobian)
        step = _constrained_step(normal, right, jacobian[chosen], misses[chosen])
        turned = normals + np.einsum("kij,kj->ki", bases, step.reshape(-1, 3)[:, :2])
        normals = turned / np.linalg.norm(turned, axis=1)[:, None]
        shifts += step.reshape(-1, 3)[:, 2]
        last = float(max(np.abs(step.reshape(-1, 3)[:, :2]).max(), np.abs(step.reshape(-1, 3)[:, 2] / extents).max()))
        if last < SETTLED and np.abs(misses).max(initial=0.0) < 1e-9:
            break
    else:
        raise NotConvergedError("the planes under their constraints", ITERATIONS, last)
    bases = bases_of(normals)
    squares = np.einsum("ki,kij,kj->k", normals, scatters, normals) + counts * shifts**2
    normal, _ = _normal_equations(normals, bases, shifts, scatters, counts)
    _, jacobian = constraint_values(normals, bases, constraints)
    jacobian = jacobian[_independent(jacobian)]
    redundancy = int(counts.sum()) - 3 * len(points) + len(jacobian)
    variance = float(squares.sum()) / redundancy
    return PlaneModel(
        normals=normals,
        centroids=centroids + shifts[:, None] * normals,
        bases=bases,
        covariance=variance * _constrained_inverse(normal, jacobian),
        std_m=float(np.sqrt(variance)),
        redundancy=redundancy,
        rms_m=np.sqrt(squares / counts),
        iterations=iterations,
    )


def constraint_values(
    normals: Float64[Array, "k 3"], bases: Float64[Array, "k 3 2"], constraints: Sequence[PlaneConstraint]
) -> tuple[Vector, Matrix]:
    """Give by how much each constraint is missed, (c,), and the derivatives (c, 3k) to (a1, a2, b) of all planes.

    Vertical: n · z. Orthogonal: n_i · n_j. Parallel: n_i · e for both directions e of the other plane, which are held
    fixed in n_i and turn with n_j: ∂(n_i · E_j)/∂a_j = - (n_i · n_j).
    """
    misses: list[float] = []
    rows: list[Array] = []

    def add(miss: float, parts: dict[int, Array]) -> None:
        row = np.zeros(3 * len(normals))
        for plane, part in parts.items():
            row[3 * plane : 3 * plane + 2] = part
        misses.append(miss)
        rows.append(row)

    for each in constraints:
        i, j = each.one, each.other
        if each.relation is PlaneRelation.VERTICAL:
            add(float(normals[i, 2]), {i: bases[i, 2]})
        elif each.relation is PlaneRelation.ORTHOGONAL:
            add(float(normals[i] @ normals[j]), {i: bases[i].T @ normals[j], j: bases[j].T @ normals[i]})
        else:
            for axis in range(2):
                way = bases[j, :, axis]
                turn = np.zeros(2)
                turn[axis] = -float(normals[i] @ normals[j])
                add(float(normals[i] @ way), {i: bases[i].T @ way, j: turn})
    return np.array(misses), np.array(rows).reshape(len(rows), 3 * len(normals))


def corner_of(model: PlaneModel, planes: tuple[int, int, int]) -> tuple[Vector3, Matrix3]:
    """Intersect three planes: the corner (3,) [m] and its covariance (3, 3) [m²].

    From n_i · (x - c_i) = b_i - (x - c_i) · E_i a_i the derivatives of x follow.

    Raises
    ------
    DegenerateGeometryError
        Two of them are parallel, or all to one line.
    """
    which = list(planes)
    normals, centroids, bases = model.normals[which], model.centroids[which], model.bases[which]
    if abs(np.linalg.det(normals)) < FLATTEST_CORNER:
        raise DegenerateGeometryError(2, ["along the line to which the three planes are parallel"], parameters=3)
    corner = solve(normals, np.einsum("ij,ij->i", normals, centroids))
    right = np.zeros((3, model.covariance.shape[0]))
    for row, plane in enumerate(which):
        right[row, 3 * plane : 3 * plane + 2] = -bases[row].T @ (corner - centroids[row])
        right[row, 3 * plane + 2] = 1.0
    jacobian = solve(normals, right)
    return corner, np.asarray(jacobian @ model.covariance @ jacobian.T)


def _normal_equations(
    normals: Array, bases: Array, shifts: Array, scatters: Array, counts: Array
) -> tuple[Array, Array]:
    """Sum JᵀJ and -Jᵀr of r = n · (x - c) - b over the points, from their moments; J = ((x - c)ᵀE, -1)."""
    size = 3 * len(normals)
    normal, right = np.zeros((size, size)), np.zeros(size)
    for k in range(len(normals)):
        part = slice(3 * k, 3 * k + 2)
        normal[part, part] = bases[k].T @ scatters[k] @ bases[k]
        normal[3 * k + 2, 3 * k + 2] = counts[k]
        right[part] = -bases[k].T @ scatters[k] @ normals[k]
        right[3 * k + 2] = -counts[k] * shifts[k]
    return normal, right


def _independent(jacobian: Matrix) -> Array:
    """Give rows from which all others follow: of a box every face stands across four others, three would do."""
    if not len(jacobian):
        return np.empty(0, dtype=np.int64)
    _, upper, order = qr(jacobian.T, mode="economic", pivoting=True)
    sizes = np.abs(np.diag(upper))
    return np.sort(order[: int((sizes > DEPENDENT * sizes[0]).sum())])


def _constrained_step(normal: Array, right: Array, jacobian: Array, misses: Array) -> Array:
    count = len(jacobian)
    whole = np.block([[normal, jacobian.T], [jacobian, np.zeros((count, count))]])
    return np.asarray(solve(whole, np.concatenate([right, -misses]), assume_a="sym"))[: len(right)]


def _constrained_inverse(normal: Array, jacobian: Array) -> Array:
    """Give the cofactors of unknowns under constraints: the upper left block of the bordered inverse."""
    count, size = len(jacobian), len(normal)
    whole = np.block([[normal, jacobian.T], [jacobian, np.zeros((count, count))]])
    unit = np.eye(size + count, size)
    cofactors = np.asarray(solve(whole, unit, assume_a="sym"))[:size]
    return np.asarray(0.5 * (cofactors + cofactors.T))
