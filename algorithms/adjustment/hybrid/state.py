"""Values of all unknowns of a hybrid network, and which columns of the normal equations they have."""

from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.arrays import Array, Vector3
from algorithms.geometry.lines import bases_of


class Kind(IntEnum):
    """Kinds of blocks of unknowns, in the order of their columns."""

    POINT = 0
    """Coordinates."""
    PLANE = 1
    """Two tilts of the normal, and the distance from the origin."""
    LINE = 2
    """Two tilts of the direction, and two shifts across it."""
    POSE = 3
    """Rotation vector in the station's own axes, and position in the world."""
    MOUNT = 4
    """The same of a camera in the frame of its scanner."""
    CAMERA = 5
    """Interior orientation, `CAMERA_PARAMETERS`."""
    SCANNER = 6
    """Instrument errors, `SCANNER_PARAMETERS`."""


CAMERA_PARAMETERS = ("c", "x0", "y0", "A1", "A2", "A3", "B1", "B2", "C1", "C2")
"""Principal distance and point [px], radial (px⁻², px⁻⁴, px⁻⁶), tangential (px⁻¹) distortion, affinity and shear."""
SCANNER_PARAMETERS = ("distance_offset", "collimation", "trunnion", "zenith_index")
"""Addition constant [m], collimation error, error of the trunnion axis, index error of the zenith angle [rad]."""
SIZES = {
    Kind.POINT: 3,
    Kind.PLANE: 3,
    Kind.LINE: 4,
    Kind.POSE: 6,
    Kind.MOUNT: 6,
    Kind.CAMERA: len(CAMERA_PARAMETERS),
    Kind.SCANNER: len(SCANNER_PARAMETERS),
}


@dataclass(frozen=True, eq=False)
class State:
    """Values of the unknowns; coordinates are relative to an origin near the network."""

    points: Array
    """(n, 3) object points [m]."""
    rotations: Array
    """(p, 3, 3) of the stations: world from station."""
    positions: Array
    """(p, 3) of the stations in the world [m]."""
    cameras: Array
    """(c, 10) `CAMERA_PARAMETERS`."""
    mount_rotations: Array
    """(k, 3, 3) station from camera; the first is the identity of photos that are stations themselves."""
    mount_positions: Array
    """(k, 3) of the cameras in the frame of their stations [m]."""
    scanners: Array
    """(s, 4) `SCANNER_PARAMETERS`; the first is the scanner without errors."""
    normals: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(q, 3) unit normals of planes."""
    offsets: Array = field(default_factory=lambda: np.zeros(0))
    """(q,) distances of planes from the origin [m]."""
    directions: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(l, 3) unit directions of lines."""
    anchors: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(l, 3) a point of each line [m]."""

    def count(self, kind: Kind) -> int:
        """Give the number of blocks of a kind (MATH 1.4)."""
        return len(
            {
                Kind.POINT: self.points,
                Kind.PLANE: self.normals,
                Kind.LINE: self.directions,
                Kind.POSE: self.positions,
                Kind.MOUNT: self.mount_positions,
                Kind.CAMERA: self.cameras,
                Kind.SCANNER: self.scanners,
            }[kind]
        )

    def moved(self, layout: "Layout", step: Array) -> "State":
        """Apply a step (u,): R <- R Exp(w), t <- t + dt, X <- X + dX; fixed unknowns stay (MATH 1.4)."""
        of = {kind: _spread(step, layout.columns[kind]) for kind in Kind}
        directions, anchors = self.directions, self.anchors
        if len(directions):
            bases = bases_of(directions)
            anchors = anchors + np.einsum("nij,nj->ni", bases, of[Kind.LINE][:, 2:])
            directions = _unit(directions + np.einsum("nij,nj->ni", bases, of[Kind.LINE][:, :2]))
        normals = self.normals
        if len(normals):
            normals = _unit(normals + np.einsum("nij,nj->ni", bases_of(normals), of[Kind.PLANE][:, :2]))
        return replace(
            self,
            points=self.points + of[Kind.POINT],
            rotations=self.rotations @ _exp(of[Kind.POSE][:, :3]),
            positions=self.positions + of[Kind.POSE][:, 3:],
            cameras=self.cameras + of[Kind.CAMERA],
            mount_rotations=self.mount_rotations @ _exp(of[Kind.MOUNT][:, :3]),
            mount_positions=self.mount_positions + of[Kind.MOUNT][:, 3:],
            scanners=self.scanners + of[Kind.SCANNER],
            normals=normals,
            offsets=self.offsets + of[Kind.PLANE][:, 2],
            directions=directions,
            anchors=anchors,
        )

    def moved_together(self, shift: Vector3, rotation_vector: Vector3, scale: float = 1.0) -> "State":
        """Move everything by X <- scale R X + shift with R = Exp(rotation vector) (MATH 1.4)."""
        turn = Rotation.from_rotvec(rotation_vector).as_matrix()
        normals = self.normals @ turn.T
        return replace(
            self,
            points=scale * self.points @ turn.T + shift,
            rotations=turn @ self.rotations,
            positions=scale * self.positions @ turn.T + shift,
            mount_positions=scale * self.mount_positions,
            normals=normals,
            offsets=scale * self.offsets + normals @ shift,
            directions=self.directions @ turn.T,
            anchors=scale * self.anchors @ turn.T + shift,
        )

    def photo_frames(self, stations: Array, mounts: Array) -> tuple[Array, Array]:
        """Give rotations and positions, world from camera, of cameras carried by stations (MATH 1.4)."""
        base = self.rotations[stations]
        rotations = base @ self.mount_rotations[mounts]
        positions = np.einsum("nij,nj->ni", base, self.mount_positions[mounts]) + self.positions[stations]
        return rotations, positions


@dataclass(frozen=True, eq=False)
class Layout:
    """Columns of the free unknowns."""

    columns: dict[Kind, Array]
    """For each kind (n, size) columns, -1 for what is constant."""
    count: int
    """Number of columns."""

    @staticmethod
    def of(free: dict[Kind, Array], at_points: Array) -> "Layout":
        """Give every free unknown its number (MATH 1.4).

        Parameters
        ----------
        free
            For each kind (n, size) True where it is unknown.
        at_points
            (p,) number of the point at which a station stands, -1 for none: both share their unknowns.
        """
        columns, first = {}, 0
        for kind in Kind:
            mask = free[kind]
            numbers = np.full(mask.shape, -1, dtype=np.int64)
            numbers[mask] = first + np.arange(int(mask.sum()))
            columns[kind] = numbers
            first += int(mask.sum())
            if kind is Kind.POSE:
                shared = at_points >= 0
                numbers[shared, 3:] = columns[Kind.POINT][at_points[shared]]
        return Layout(columns, first)

    def owners(self) -> tuple[Array, Array, Array]:
        """Give for each column its kind, block and place in the block; shared ones are those of points (MATH 1.4)."""
        kinds, blocks, places = (np.full(self.count, -1, dtype=np.int64) for _ in range(3))
        for kind in reversed(Kind):
            numbers = self.columns[kind]
            block, place = np.nonzero(numbers >= 0)
            at = numbers[block, place]
            kinds[at], blocks[at], places[at] = int(kind), block, place
        return kinds, blocks, places


def _spread(step: Array, columns: Array) -> Array:
    padded = np.append(step, 0.0)
    return np.asarray(padded[columns])


def _exp(vectors: Array) -> Array:
    if len(vectors) == 0:
        return np.zeros((0, 3, 3))
    return np.asarray(Rotation.from_rotvec(vectors).as_matrix())


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
