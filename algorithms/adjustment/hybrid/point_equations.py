"""Points observed without an instrument, fictitious observations, observed unknowns (G-07, G-08)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from algorithms.adjustment.hybrid.observations import Block, Observations, Stacked
from algorithms.adjustment.hybrid.scanner_equations import azk_and_rates, opk_and_rates, wrapped
from algorithms.adjustment.hybrid.state import SIZES, Kind, State
from algorithms.arrays import Array, Flags, Indices
from algorithms.geometry.lines import bases_of


@dataclass(frozen=True, eq=False)
class Control(Observations):
    """Known coordinates of points with their covariance."""

    points: Indices
    """(n,)."""
    values: Array
    """(n, 3) known [m]."""

    @property
    def places(self) -> Sequence[tuple[Kind, Indices]]:
        """Give the unknowns that take part (MATH 6.1)."""
        return ((Kind.POINT, self.points),)

    def stacked(self, state: State) -> Stacked:
        """Compute X minus what is known (MATH 6.1)."""
        jacobian = np.broadcast_to(np.eye(3), (len(self), 3, 3))
        return Stacked(state.points[self.points] - self.values, (Block(Kind.POINT, self.points, jacobian),))


@dataclass(frozen=True, eq=False)
class BetweenPoints(Observations):
    """What is observed from one point to another and does not change when both are shifted."""

    starts: Indices
    """(n,) points."""
    ends: Indices
    """(n,) points."""
    values: Array
    """Observed [m]: (n, 3) coordinate differences, (n,) of the others."""

    @property
    def places(self) -> Sequence[tuple[Kind, Indices]]:
        """Give the unknowns that take part (MATH 6.1)."""
        return ((Kind.POINT, self.starts), (Kind.POINT, self.ends))

    def _stacked(self, residuals: Array, by_end: Array) -> Stacked:
        """Stack residuals (n, d) and their derivatives by the ends (n, d, 3); those by the starts are opposite."""
        return Stacked(residuals, (Block(Kind.POINT, self.starts, -by_end), Block(Kind.POINT, self.ends, by_end)))


@dataclass(frozen=True, eq=False)
class Differences(BetweenPoints):
    """Coordinate differences X2 - X1 in the world with their covariance, as satellite baselines are."""

    def stacked(self, state: State) -> Stacked:
        """Compute X2 - X1 minus what was observed (MATH 6.1)."""
        gaps = state.points[self.ends] - state.points[self.starts] - self.values
        return self._stacked(gaps, np.broadcast_to(np.eye(3), (len(self), 3, 3)))


@dataclass(frozen=True, eq=False)
class Distances(BetweenPoints):
    """Distances between points."""

    flat: Flags
    """(n,) True for horizontal distances."""

    def stacked(self, state: State) -> Stacked:
        """Compute |X2 - X1| minus what was observed (MATH 6.1)."""
        arms = state.points[self.ends] - state.points[self.starts]
        arms[self.flat, 2] = 0.0
        lengths = np.maximum(np.linalg.norm(arms, axis=1), np.finfo(np.float64).tiny)
        return self._stacked((lengths - self.values)[:, None], (arms / lengths[:, None])[:, None, :])


@dataclass(frozen=True, eq=False)
class HeightDifferences(BetweenPoints):
    """Differences of Z between points."""

    def stacked(self, state: State) -> Stacked:
        """Compute Z2 - Z1 minus what was observed (MATH 6.1)."""
        row = np.broadcast_to(np.array([[0.0, 0.0, 1.0]]), (len(self), 1, 3))
        differences = state.points[self.ends, 2] - state.points[self.starts, 2]
        return self._stacked((differences - self.values)[:, None], row)


@dataclass(frozen=True, eq=False)
class InPlane(Observations):
    """Fictitious: points lie in a common plane, n·X = d (H-15, G-07)."""

    planes: Indices
    """(n,)."""
    points: Indices
    """(n,)."""
    is_form: ClassVar[bool] = True

    @property
    def places(self) -> Sequence[tuple[Kind, Indices]]:
        """Give the unknowns that take part (MATH 6.1)."""
        return ((Kind.PLANE, self.planes), (Kind.POINT, self.points))

    def stacked(self, state: State) -> Stacked:
        """Compute n·X - d; with n + E a it changes by X·E a (MATH 6.1)."""
        normals, points = state.normals[self.planes], state.points[self.points]
        by_plane = np.empty((len(self), 1, 3))
        by_plane[:, 0, :2] = np.einsum("ni,nij->nj", points, bases_of(normals))
        by_plane[:, 0, 2] = -1.0
        return Stacked(
            (np.einsum("ni,ni->n", normals, points) - state.offsets[self.planes])[:, None],
            (Block(Kind.PLANE, self.planes, by_plane), Block(Kind.POINT, self.points, normals[:, None, :])),
        )


@dataclass(frozen=True, eq=False)
class OnLine(Observations):
    """Fictitious: points lie on a common straight line, Eᵀ (X - c) = 0 (H-15)."""

    lines: Indices
    """(n,)."""
    points: Indices
    """(n,)."""
    is_form: ClassVar[bool] = True

    @property
    def places(self) -> Sequence[tuple[Kind, Indices]]:
        """Give the unknowns that take part (MATH 6.1)."""
        return ((Kind.LINE, self.lines), (Kind.POINT, self.points))

    def stacked(self, state: State) -> Stacked:
        """Compute the two distances across the line; a tilt moves them by the distance along it (MATH 6.1)."""
        directions = state.directions[self.lines]
        across = np.swapaxes(bases_of(directions), 1, 2)
        arms = state.points[self.points] - state.anchors[self.lines]
        along = np.einsum("ni,ni->n", directions, arms)
        by_line = np.zeros((len(self), 2, 4))
        by_line[:, :, :2] = -along[:, None, None] * np.eye(2)
        by_line[:, :, 2:] = -np.eye(2)
        return Stacked(
            np.einsum("nij,nj->ni", across, arms),
            (Block(Kind.LINE, self.lines, by_line), Block(Kind.POINT, self.points, across)),
        )


ANGLES = {"omega": 0, "phi": 1, "kappa": 2, "alpha": 3, "zeta": 4, "kappa_azk": 5}
"""Places of angles in `ObservedUnknowns.places_in_block` of poses and mounts; coordinates X, Y, Z are 6, 7, 8."""


@dataclass(frozen=True, eq=False)
class ObservedUnknowns(Observations):
    """Single unknowns with a known or expected value (G-08): coordinates, angles, camera and instrument parameters."""

    kind: Kind
    """Kind of all of them."""
    numbers: Indices
    """(n,) of the blocks."""
    parameters: Indices
    """(n,) place in the block; of poses and mounts `ANGLES` and 6, 7, 8 for X, Y, Z."""
    values: Array
    """(n,) observed."""

    @property
    def places(self) -> Sequence[tuple[Kind, Indices]]:
        """Give the unknowns that take part (MATH 6.1)."""
        return ((self.kind, self.numbers),)

    def stacked(self, state: State) -> Stacked:
        """Compute the present value minus the observed one (MATH 6.1)."""
        n = np.arange(len(self))
        if self.kind in {Kind.POSE, Kind.MOUNT}:
            jacobian = np.zeros((len(self), 1, SIZES[self.kind]))
            of_pose = self.kind is Kind.POSE
            rotations = (state.rotations if of_pose else state.mount_rotations)[self.numbers]
            positions = (state.positions if of_pose else state.mount_positions)[self.numbers]
            (opk, opk_rates), (azk, azk_rates) = opk_and_rates(rotations), azk_and_rates(rotations)
            present = np.concatenate([opk, azk, positions], axis=1)[n, self.parameters]
            rates = np.concatenate([opk_rates, azk_rates], axis=1)
            angular = self.parameters < 6
            jacobian[angular, 0, :3] = rates[n[angular], self.parameters[angular]]
            jacobian[~angular, 0, self.parameters[~angular] - 3] = 1.0
            residuals = np.where(angular, wrapped(present - self.values), present - self.values)
        else:
            values = {Kind.POINT: state.points, Kind.CAMERA: state.cameras, Kind.SCANNER: state.scanners}[self.kind]
            residuals = values[self.numbers, self.parameters] - self.values
            # cameras of a calibration have the parameters of their own lens
            jacobian = np.zeros((len(self), 1, values.shape[1]))
            jacobian[n, 0, self.parameters] = 1.0
        return Stacked(residuals[:, None], (Block(self.kind, self.numbers, jacobian),))
