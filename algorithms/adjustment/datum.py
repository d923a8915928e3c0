"""The datum of a network: what defines its frame, and what follows when that is changed (MATH 6.2)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from algorithms.adjustment.unknowns import SIZES, UnknownKind, Unknowns
from algorithms.arrays import Array, Indices
from algorithms.errors import DegenerateGeometryError
from algorithms.geometry.angles import angles_from_rotation, rotation_vector_rates
from algorithms.geometry.rotations import cross_matrices

COMMON_MOTION_SHARE = 0.999
"""A free direction whose length lies in the space of common motions by more than this share is one."""

TAKES_PART = 0.3
"""An unknown takes part in a free direction with more than this share of its largest component."""


@dataclass(frozen=True, eq=False)
class DatumSelection:
    """Unknowns that carry the datum of a free network: the sum of their squared changes is smallest."""

    points: Bool[Array, "points"]
    """Object points."""
    positions: Bool[Array, "poses"]
    """Positions of stations."""
    rotations: Bool[Array, "poses"]
    """Rotation angles ω, φ, κ of stations, a radian counting as a metre (ORIENT's choice)."""

    @staticmethod
    def of_everything(unknowns: Unknowns) -> "DatumSelection":
        """Select all points, positions and rotations, the free network of Haring 2003 (table 4-2)."""
        points, poses = np.ones(len(unknowns.points), dtype=bool), np.ones(len(unknowns.pose_is_fixed), dtype=bool)
        return DatumSelection(points, poses, poses)


def motion_basis(unknowns: Unknowns) -> Float64[Array, "unknowns 6"]:
    """Give B, (u, 6): how the unknowns change with a common motion (3 translations, 3 rotations about the origin).

    Rows of a point [I, -S(X)], of a position [I, -S(t)], of a rotation vector [0, I] (MATH 6.2 with w for the angles).
    """
    basis = np.zeros((unknowns.count, 6))
    for kind, positions in ((UnknownKind.POSE, unknowns.poses.translation), (UnknownKind.POINT, unknowns.points)):
        coordinates = np.asarray(positions)
        first = unknowns.first_columns(kind, np.arange(len(coordinates), dtype=np.int64))
        free = first >= 0
        rows = first[free][:, None] + np.arange(3) + (3 if kind is UnknownKind.POSE else 0)
        basis[rows, :3] = np.eye(3)
        basis[rows, 3:] = -cross_matrices(coordinates[free])
        if kind is UnknownKind.POSE:
            basis[first[free][:, None] + np.arange(3), 3:] = np.eye(3)
    return basis


def free_network_conditions(unknowns: Unknowns, selection: DatumSelection) -> Float64[Array, "unknowns 6"]:
    """Give the columns D = E B of the conditions Dᵀ dx = 0 of a free network (MATH 6.2).

    Parameters
    ----------
    unknowns
        Values at which the network is linearised, none of them fixed.
    selection
        Unknowns whose trace of the covariance is minimised; rotations count by their angles, D = W⁻ᵀ W⁻¹ B there.
    """
    basis = motion_basis(unknowns)
    conditions = np.zeros_like(basis)
    poses = unknowns.first_columns(UnknownKind.POSE, np.arange(len(unknowns.pose_is_fixed), dtype=np.int64))
    for k in np.flatnonzero(selection.positions & (poses >= 0)):
        rows = slice(poses[k] + 3, poses[k] + 6)
        conditions[rows] = basis[rows]
    for k in np.flatnonzero(selection.rotations & (poses >= 0)):
        rows = slice(poses[k], poses[k] + 3)
        omega, phi, _ = angles_from_rotation(unknowns.poses.rotation[int(k)])
        rates = np.linalg.inv(rotation_vector_rates(float(omega), float(phi)))
        conditions[rows] = rates.T @ rates @ basis[rows]
    points = unknowns.first_columns(UnknownKind.POINT, np.arange(len(unknowns.points), dtype=np.int64))
    for first in points[selection.points & (points >= 0)]:
        conditions[first : first + 3] = basis[first : first + 3]
    return conditions


def held_columns(unknowns: Unknowns, columns: Indices) -> Float64[Array, "unknowns held"]:
    """Give the conditions that keep single unknowns at their start values: a minimal datum, or control (MATH 6.2).

    Parameters
    ----------
    unknowns
        The unknowns.
    columns
        (k,) columns of those that are held.
    """
    conditions = np.zeros((unknowns.count, len(columns)))
    conditions[columns, np.arange(len(columns))] = 1.0
    return conditions


def s_transformation(
    basis: Float64[Array, "unknowns defect"], conditions: Float64[Array, "unknowns defect"]
) -> Float64[Array, "unknowns unknowns"]:
    """Give S = I - B (FᵀB)⁻¹ Fᵀ, which carries dx and Q = S Q Sᵀ over to the datum Fᵀ dx = 0 (MATH 6.2; Baarda).

    Residuals, sigma0, redundancy numbers and detectable errors stay as they are.

    Raises
    ------
    DegenerateGeometryError
        When the conditions do not fix every motion.
    """
    crossed = conditions.T @ basis
    values = np.linalg.svd(crossed / np.linalg.norm(conditions, axis=0)[:, None], compute_uv=False)
    if values[-1] < 1e-12 * values[0]:
        raise DegenerateGeometryError(
            basis.shape[1] - 1, ("a common motion",), advice="hold more coordinates, or others"
        )
    return np.asarray(np.eye(len(basis)) - basis @ np.linalg.solve(crossed, conditions.T))


def free_unknowns(unknowns: Unknowns, null_space: Float64[Array, "unknowns free"]) -> tuple[str, ...]:
    """Say in words which unknowns are free (MATH 5.3); stations and points by their numbers from 0.

    Parameters
    ----------
    unknowns
        Values of the unknowns.
    null_space
        (u, k) directions that change no observation.
    """
    common = np.linalg.qr(motion_basis(unknowns))[0]
    if np.linalg.norm(common.T @ null_space) ** 2 > COMMON_MOTION_SHARE * np.linalg.norm(null_space) ** 2:
        return ("a common motion of all stations and points: the datum",)
    names = []
    for kind, word, count in (
        (UnknownKind.POSE, "station", len(unknowns.pose_is_fixed)),
        (UnknownKind.POINT, "point", len(unknowns.points)),
    ):
        first = unknowns.first_columns(kind, np.arange(count, dtype=np.int64))
        sizes = np.array([np.abs(null_space[c : c + SIZES[kind]]).max() if c >= 0 else 0.0 for c in first])
        names += [f"{word} {k}" for k in np.flatnonzero(sizes > TAKES_PART * np.abs(null_space).max())]
    return tuple(names)
