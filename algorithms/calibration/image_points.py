"""Points of a target field in photos, as observations of the hybrid adjustment with any lens model (U-09)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.adjustment.hybrid.observations import Block, Observations, Stacked
from algorithms.adjustment.hybrid.state import Kind, State
from algorithms.arrays import Array, Indices
from algorithms.calibration.lenses import Lens
from algorithms.geometry.rotations import cross_matrices


@dataclass(frozen=True, eq=False)
class TargetImages(Observations):
    """Image points, two coordinates each; all photos have the one camera, number 0.

    Its block of unknowns has the parameters of the lens and then, of a board that is not flat, its bends [m]: a point
    stands higher by their product with the point's shapes.
    """

    stations: Indices
    """(n,) the photo's own pose, or that of the head that carries the camera."""
    mounts: Indices
    """(n,) 0 for photos that are stations themselves."""
    points: Indices
    """(n,)."""
    values: Array
    """(n, 2) columns and rows [px]."""
    lens: Lens
    shapes: Array
    """(points, bends) what a unit of each bend adds to the z of each point; no columns: the targets are where they
    are."""

    @property
    def places(self) -> Sequence[tuple[Kind, Indices]]:
        """Give the unknowns that take part (MATH 6.1)."""
        camera = np.zeros(len(self), dtype=np.int64)
        return (
            (Kind.POSE, self.stations), (Kind.MOUNT, self.mounts), (Kind.CAMERA, camera), (Kind.POINT, self.points)
        )  # fmt: skip

    def seen(self, state: State) -> tuple[Array, Array]:
        """Give the points in the frames of stations and of cameras, (n, 3) each (MATH 6.1)."""
        parameters = len(self.lens.names)
        objects = state.points[self.points]
        if self.shapes.shape[1]:
            objects[:, 2] += self.shapes[self.points] @ state.cameras[0, parameters:]
        arms = objects - state.positions[self.stations]
        local = np.einsum("nji,nj->ni", state.rotations[self.stations], arms)
        from_mount = local - state.mount_positions[self.mounts]
        return local, np.einsum("nji,nj->ni", state.mount_rotations[self.mounts], from_mount)

    def stacked(self, state: State) -> Stacked:
        """Compute the lens's image of the point, minus what was measured (MATH 6.1)."""
        parameters = len(self.lens.names)
        local, seen = self.seen(state)
        found = self.lens.misfit(seen, self.values, state.cameras[0, :parameters])
        by_local = found.by_seen @ np.swapaxes(state.mount_rotations[self.mounts], 1, 2)
        by_point = by_local @ np.swapaxes(state.rotations[self.stations], 1, 2)
        by_pose = np.concatenate([by_local @ cross_matrices(local), -by_point], axis=2)
        by_mount = np.concatenate([found.by_seen @ cross_matrices(seen), -by_local], axis=2)
        by_bends = by_point[:, :, 2:3] * self.shapes[self.points][:, None, :]
        by_camera = np.concatenate([found.by_parameters, by_bends], axis=2)
        return Stacked(
            found.residuals,
            (
                Block(Kind.POSE, self.stations, by_pose),
                Block(Kind.MOUNT, self.mounts, by_mount),
                Block(Kind.CAMERA, np.zeros(len(self), dtype=np.int64), by_camera),
                Block(Kind.POINT, self.points, by_point),
            ),
        )

    def metres(self, state: State) -> Array:
        """Give the size of a pixel at the object (MATH 6.1)."""
        size = np.abs(self.seen(state)[1][:, 2]) / state.cameras[0, 0]
        return np.repeat(size[:, None], 2, axis=1)


@dataclass(frozen=True, eq=False)
class ObservedTurns(Observations):
    """Observed rotations of mounts: the rotation vector about the camera's axes from what was observed."""

    numbers: Indices
    """(n,) of the mounts."""
    values: Array
    """(n, 3, 3)."""

    @property
    def places(self) -> Sequence[tuple[Kind, Indices]]:
        """Give the unknowns that take part (MATH 6.1)."""
        return ((Kind.MOUNT, self.numbers),)

    def stacked(self, state: State) -> Stacked:
        """Compute the vector of R₀ᵀ R, and its derivative by a turn of the camera (MATH 1.4)."""
        turns = np.swapaxes(self.values, 1, 2) @ state.mount_rotations[self.numbers]
        vectors = Rotation.from_matrix(turns).as_rotvec()
        crossed = cross_matrices(vectors)
        # a twelfth is the next term of the inverse of the right Jacobian of Exp; observed mounts are near their values
        by_turn = np.eye(3) + 0.5 * crossed + crossed @ crossed / 12.0
        jacobians = np.concatenate([by_turn, np.zeros((len(self), 3, 3))], axis=2)
        return Stacked(vectors, (Block(Kind.MOUNT, self.numbers, jacobians),))
