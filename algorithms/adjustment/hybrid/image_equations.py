"""Image points of photos that are stations themselves or carried by a scanner (MATH 6.1)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from algorithms.adjustment.hybrid.observations import Block, Observations, Stacked
from algorithms.adjustment.hybrid.state import Kind, State
from algorithms.arrays import Array, Flags, Indices
from algorithms.geometry.rotations import cross_matrices


@dataclass(frozen=True, eq=False)
class ImageObservations(Observations):
    """Single image coordinates [px], x to the right and y up."""

    stations: Indices
    """(n,) the photo's own pose, or that of the scanner which carries the camera."""
    mounts: Indices
    """(n,) 0 for photos that are stations themselves."""
    cameras: Indices
    """(n,)."""
    points: Indices
    """(n,)."""
    components: Indices
    """(n,) 0: x, 1: y."""
    values: Array
    """(n, 2) measured; both are needed where distortion corrects what was measured."""
    backward: Flags
    """(n,) whether the distortion corrects the measured point (Brown) instead of displacing the ideal one."""

    @property
    def places(self) -> Sequence[tuple[Kind, Indices]]:
        """Give the unknowns that take part (MATH 6.1)."""
        return (
            (Kind.POSE, self.stations),
            (Kind.MOUNT, self.mounts),
            (Kind.CAMERA, self.cameras),
            (Kind.POINT, self.points),
        )

    def in_cameras(self, state: State) -> tuple[Array, Array]:
        """Give the points in the frames of stations and of cameras, (n, 3) each (MATH 6.1)."""
        arms = state.points[self.points] - state.positions[self.stations]
        local = np.einsum("nji,nj->ni", state.rotations[self.stations], arms)
        from_mount = local - state.mount_positions[self.mounts]
        return local, np.einsum("nji,nj->ni", state.mount_rotations[self.mounts], from_mount)

    def stacked(self, state: State) -> Stacked:
        """Compute -c x/z, -c y/z with distortion, minus what was measured (MATH 6.1)."""
        n = np.arange(len(self))
        local, seen = self.in_cameras(state)
        camera = state.cameras[self.cameras]
        c = camera[:, 0]
        depth = -seen[:, 2]
        depth = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
        ideal = c[:, None] * seen[:, :2] / depth[:, None]
        by_seen = np.zeros((len(self), 2, 3))
        by_seen[:, 0, 0] = by_seen[:, 1, 1] = c / depth
        by_seen[:, :, 2] = ideal / depth[:, None]
        from_centre = self.values - camera[:, 1:3]
        place = np.where(self.backward[:, None], from_centre, ideal)
        added, by_place, by_terms = distortion(place, camera)
        forward = ~self.backward
        residuals = ideal - from_centre + np.where(forward[:, None], added, -added)
        full = np.where(forward[:, None, None], np.eye(2) + by_place, np.eye(2))
        by_seen = full @ by_seen
        by_camera = np.zeros((len(self), 2, camera.shape[1]))
        by_camera[:, :, 0] = np.einsum("nij,nj->ni", full, ideal) / c[:, None]
        by_camera[:, :, 1:3] = np.where(forward[:, None, None], np.eye(2), np.eye(2) + by_place)
        by_camera[:, :, 3:] = np.where(forward[:, None, None], by_terms, -by_terms)
        row = by_seen[n, self.components][:, None, :]
        by_local = row @ np.swapaxes(state.mount_rotations[self.mounts], 1, 2)
        by_point = by_local @ np.swapaxes(state.rotations[self.stations], 1, 2)
        by_pose = np.concatenate([by_local @ cross_matrices(local), -by_point], axis=2)
        by_mount = np.concatenate([row @ cross_matrices(seen), -by_local], axis=2)
        return Stacked(
            residuals[n, self.components][:, None],
            (
                Block(Kind.POSE, self.stations, by_pose),
                Block(Kind.MOUNT, self.mounts, by_mount),
                Block(Kind.CAMERA, self.cameras, by_camera[n, self.components][:, None, :]),
                Block(Kind.POINT, self.points, by_point),
            ),
        )

    def metres(self, state: State) -> Array:
        """Give the size of a pixel at the object (MATH 6.1)."""
        _, seen = self.in_cameras(state)
        return np.asarray(np.abs(seen[:, 2]) / state.cameras[self.cameras, 0])[:, None]


def distortion(place: Array, camera: Array) -> tuple[Array, Array, Array]:
    """Compute the distortion at places (n, 2) from the principal point.

    dx = x (A1 r² + A2 r⁴ + A3 r⁶) + B1 (r² + 2x²) + 2 B2 x y + C1 x + C2 y,
    dy = y (A1 r² + A2 r⁴ + A3 r⁶) + B2 (r² + 2y²) + 2 B1 x y (MATH 6.1).

    Returns
    -------
    (n, 2) distortion, (n, 2, 2) derivatives by the place, (n, 2, 7) derivatives by A1, A2, A3, B1, B2, C1, C2.
    """
    x, y = place.T
    a1, a2, a3, b1, b2, c1, c2 = camera[:, 3:10].T
    r2 = x * x + y * y
    radial = r2 * (a1 + r2 * (a2 + r2 * a3))
    slope = a1 + r2 * (2.0 * a2 + 3.0 * r2 * a3)  # by r²
    zero = np.zeros_like(x)
    terms = np.stack([
        np.stack([x * r2, x * r2**2, x * r2**3, r2 + 2 * x * x, 2 * x * y, x, y], axis=1),
        np.stack([y * r2, y * r2**2, y * r2**3, 2 * x * y, r2 + 2 * y * y, zero, zero], axis=1),
    ], axis=1)  # fmt: skip
    by_place = np.empty((len(x), 2, 2))
    by_place[:, 0, 0] = radial + 2 * x * x * slope + 6 * b1 * x + 2 * b2 * y + c1
    by_place[:, 0, 1] = 2 * x * y * slope + 2 * b1 * y + 2 * b2 * x + c2
    by_place[:, 1, 0] = 2 * x * y * slope + 2 * b2 * x + 2 * b1 * y
    by_place[:, 1, 1] = radial + 2 * y * y * slope + 6 * b2 * y + 2 * b1 * x
    added = np.stack([
        x * radial + b1 * (r2 + 2 * x * x) + 2 * b2 * x * y + c1 * x + c2 * y,
        y * radial + b2 * (r2 + 2 * y * y) + 2 * b1 * x * y,
    ], axis=1)  # fmt: skip
    return added, by_place, terms
