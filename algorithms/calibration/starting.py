"""Start values of a calibration: principal distance, poses or mount, and targets that are not known (H-17)."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.adjustment.hybrid.closed_forms import PHOTO_AXES, intersections, resection
from algorithms.adjustment.hybrid.state import State
from algorithms.arrays import Array
from algorithms.calibration.target_field import HeadMount, TargetField
from algorithms.errors import InvalidInputError

TRIED = tuple(np.geomspace(0.4, 5.0, 10))
"""Principal distances that are tried, in longer sides of the photo."""
TRIED_PHOTOS = 3
TRIED_POINTS = 8
LEAST_POINTS = 4


def start_of(field: TargetField) -> State:
    """Find start values of everything.

    Raises
    ------
    InvalidInputError
        A photo could not be placed, and which.
    """
    parameters = field.parameters.copy()
    if not np.isfinite(parameters[0]):
        parameters = _with_distance(field, _principal_distance(field))
    return _placed(field, parameters)


def _with_distance(field: TargetField, distance: float) -> Array:
    started = field.lens.started(distance, field.width, field.height)
    given = np.isfinite(field.parameters)
    return np.where(given, field.parameters, started)


def _principal_distance(field: TargetField) -> float:
    """Take that with which photos of known targets fit best; the adjustment does the rest."""
    groups = _groups(field, field.known)
    groups = sorted(groups, key=lambda rows: -len(rows[1]))[:TRIED_PHOTOS]
    if not groups:
        raise InvalidInputError("principal distance", "no photo shows four known targets", "give a start value")
    best, least = 0.0, np.inf
    for share in TRIED:
        distance = share * max(field.width, field.height)
        parameters = _with_distance(field, distance)
        misfit = 0.0
        for _, rows, points in groups:
            chosen = np.unique(np.linspace(0, len(rows) - 1, TRIED_POINTS).astype(int))
            found = resection(_ideal(field, parameters, rows[chosen]), points[chosen])
            misfit += np.inf if found is None else found[2] * distance
        if misfit < least:
            best, least = distance, misfit
    if not np.isfinite(least):
        raise InvalidInputError("principal distance", "no photo could be placed with any", "give a start value")
    return best


def _groups(field: TargetField, known: Array) -> list[tuple[int, Array, Array]]:
    """Give photo, rows and points of what can be resected; a camera on a head is one photo of turned points."""
    usable = known[field.points]
    if field.mount is not None:
        rows = np.flatnonzero(usable)
        turned = Rotation.from_euler("Z", -field.mount.angles_rad[field.photos[rows], None]).apply(
            field.targets[field.points[rows]]
        )
        return [(0, rows, turned)] if len(rows) >= LEAST_POINTS else []
    found = []
    for photo in range(len(field.photo_names)):
        rows = np.flatnonzero(usable & (field.photos == photo))
        if len(rows) >= LEAST_POINTS:
            found.append((photo, rows, field.targets[field.points[rows]]))
    return found


def _ideal(field: TargetField, parameters: Array, rows: Array) -> Array:
    """Give image points without distortion over the principal distance, in the axes of photogrammetry."""
    rays = field.lens.rays(field.images[rows], parameters)
    return np.asarray(rays[:, :2] * np.array([1.0, -1.0]))


def _placed(field: TargetField, parameters: Array) -> State:
    chain = _Chain(field, parameters)
    if field.mount is not None:
        chain.find_mount(field.mount)
    chain.grow()
    chain.require_everything()
    return State(
        points=np.nan_to_num(chain.targets), rotations=chain.rotations, positions=chain.positions,
        cameras=np.append(parameters, np.zeros(field.bends))[None], mount_rotations=chain.mount_rotations,
        mount_positions=chain.mount_positions, scanners=np.zeros((1, 4)),
    )  # fmt: skip


class _Chain:
    """Photos from known targets, targets from known photos."""

    def __init__(self, field: TargetField, parameters: Array) -> None:
        photos = len(field.photo_names)
        self.field, self.parameters = field, parameters
        self.targets, self.known = field.targets.copy(), field.known.copy()
        self.rotations, self.positions = np.tile(np.eye(3), (photos, 1, 1)), np.zeros((photos, 3))
        self.mount_rotations, self.mount_positions = np.eye(3)[None], np.zeros((1, 3))
        self.placed = np.zeros(photos, dtype=bool)
        rays = field.lens.rays(field.images, parameters)
        self.directions = rays / np.linalg.norm(rays, axis=1, keepdims=True)

    def find_mount(self, mount: HeadMount) -> None:
        turn, place = mount.rotation, mount.position
        if turn is None or place is None:
            groups = _groups(self.field, self.known)
            found = resection(_ideal(self.field, self.parameters, groups[0][1]), groups[0][2]) if groups else None
            if found is None:
                raise InvalidInputError(
                    "mount", "it cannot be found from the known targets in the photos", "give a start value"
                )
            turn, place = found[0] @ PHOTO_AXES, found[1]
        self.mount_rotations, self.mount_positions = np.array([np.eye(3), turn]), np.array([np.zeros(3), place])
        self.rotations = Rotation.from_euler("Z", mount.angles_rad[:, None]).as_matrix()
        self.placed[:] = True

    def grow(self) -> None:
        before = -1
        while self.placed.sum() + self.known.sum() != before:
            before = self.placed.sum() + self.known.sum()
            if self.field.mount is None:
                self._place_photos()
            self._place_targets()

    def _place_photos(self) -> None:
        for photo, rows, points in _groups(replace(self.field, targets=self.targets), self.known):
            found = None if self.placed[photo] else resection(_ideal(self.field, self.parameters, rows), points)
            if found is not None:
                self.rotations[photo], self.positions[photo] = found[0] @ PHOTO_AXES, found[1]
                self.placed[photo] = True

    def _place_targets(self) -> None:
        turns, places = self.rotations, self.positions
        if self.field.mount is not None:
            turns, places = turns @ self.mount_rotations[1], places + turns @ self.mount_positions[1]
        fresh = self.placed[self.field.photos] & ~self.known[self.field.points]
        if fresh.any():
            at = self.field.photos[fresh]
            directions = np.einsum("nij,nj->ni", turns[at], self.directions[fresh])
            numbers, where = intersections(self.field.points[fresh], places[at], directions)
            self.targets[numbers], self.known[numbers] = where, True

    def require_everything(self) -> None:
        photos = [name for name, placed in zip(self.field.photo_names, self.placed, strict=True) if not placed]
        if photos:
            raise InvalidInputError(
                "photos", f"no start values were found for {', '.join(photos[:10])}",
                "show four targets that are known or that other photos show",
            )  # fmt: skip
        lost = [self.field.target_names[k] for k in np.unique(self.field.points[~self.known[self.field.points]])]
        if lost:
            raise InvalidInputError(
                "targets", f"no start values were found for {', '.join(lost[:10])}",
                "show them from directions that differ by more than two degrees",
            )  # fmt: skip
