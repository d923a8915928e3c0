"""The unknowns of an adjustment: poses of stations and object points, some of them fixed (MATH 1.4, 6)."""

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Indices


class UnknownKind(StrEnum):
    """What a block of unknowns describes, and so how many numbers it has."""

    POSE = "pose"
    """Six: rotation vector on the left [rad], translation [m], in the axes of the common frame."""
    POINT = "point"
    """Three coordinates in the common frame [m]."""


SIZES = {UnknownKind.POSE: 6, UnknownKind.POINT: 3}


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Values of all unknown blocks (MATH 1.4, 6). Columns of the free ones are numbered poses first, then points."""

    poses: RigidTransform
    """(k,) world_from_station."""
    points: Float64[Array, "points 3"]
    """Object points in the world frame [m]."""
    pose_is_fixed: Bool[Array, "poses"]
    """(k,) True for poses that are given, such as that of the station that defines the frame."""
    point_is_fixed: Bool[Array, "points"]
    """True for points that are given."""

    @staticmethod
    def of_pair(target_from_source: RigidTransform) -> "Unknowns":
        """Give the unknowns of two stations, 0 the target, which defines the frame, and 1 the source."""
        return Unknowns(
            RigidTransform.concatenate([RigidTransform.identity(), target_from_source]),
            np.empty((0, 3)),
            np.array([True, False]),
            np.zeros(0, dtype=bool),
        )

    @property
    def count(self) -> int:
        """Number of unknown parameters."""
        return 6 * int((~self.pose_is_fixed).sum()) + 3 * int((~self.point_is_fixed).sum())

    @cached_property
    def rotations(self) -> Float64[Array, "poses 3 3"]:
        """Rotation matrices of all poses."""
        return self._matrices[:, :3, :3]

    @cached_property
    def _matrices(self) -> Float64[Array, "poses 4 4"]:
        """All poses as matrices: arithmetic on transforms takes scipy five times as long, mostly to check them."""
        return np.asarray(self.poses.as_matrix())

    def relative(self, target: int, source: int) -> RigidTransform:
        """Give target_from_source of two stations; computed once."""
        if (target, source) not in self._relative:
            (own, origin), (other, place) = (
                (matrix[:3, :3], matrix[:3, 3]) for matrix in self._matrices[[target, source]]
            )
            relative = np.eye(4)
            relative[:3, :3], relative[:3, 3] = own.T @ other, own.T @ (place - origin)
            self._relative[target, source] = RigidTransform.from_matrix(relative)
        return self._relative[target, source]

    @cached_property
    def _relative(self) -> dict[tuple[int, int], RigidTransform]:
        return {}

    def first_columns(self, kind: UnknownKind, numbers: Indices) -> Indices:
        """Give the first column of each block, -1 for fixed ones.

        Parameters
        ----------
        kind
            Kind of the blocks.
        numbers
            (n,) their numbers among poses or points.
        """
        fixed = self.pose_is_fixed if kind is UnknownKind.POSE else self.point_is_fixed
        start = 0 if kind is UnknownKind.POSE else 6 * int((~self.pose_is_fixed).sum())
        columns = np.where(fixed, -1, start + SIZES[kind] * (np.cumsum(~fixed) - 1))
        return np.asarray(columns[numbers], dtype=np.int64)

    def moved(self, step: Array) -> "Unknowns":
        """Apply a step to the free blocks: R <- Exp(w) R, t <- t + dt, X <- X + dX (MATH 1.4).

        Parameters
        ----------
        step
            (u,) in the order of the columns.
        """
        free, free_points = ~self.pose_is_fixed, ~self.point_is_fixed
        poses = 6 * int(free.sum())
        of_poses = np.zeros((len(free), 6))
        of_poses[free] = step[:poses].reshape(-1, 6)
        points = self.points.copy()
        points[free_points] += step[poses:].reshape(-1, 3)
        matrices = self._matrices.copy()
        matrices[:, :3, :3] = Rotation.from_rotvec(of_poses[:, :3]).as_matrix() @ self.rotations
        matrices[:, :3, 3] += of_poses[:, 3:]
        return replace(self, poses=RigidTransform.from_matrix(matrices), points=points)

    def scales(self, size_m: float) -> Array:
        """Give what a relative change of each parameter refers to: 1 rad for rotations, the size for lengths, (u,)."""
        poses = np.tile([1.0, 1.0, 1.0, size_m, size_m, size_m], int((~self.pose_is_fixed).sum()))
        return np.concatenate([poses, np.full(3 * int((~self.point_is_fixed).sum()), size_m)])
