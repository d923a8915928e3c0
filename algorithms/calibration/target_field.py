"""What a calibration is made of: targets, photos of them, and what is known beforehand (U-09 to U-12)."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from algorithms.adjustment.hybrid.network import Network
from algorithms.adjustment.hybrid.observations import Observations, variances
from algorithms.adjustment.hybrid.point_equations import ANGLES, Control, ObservedUnknowns
from algorithms.adjustment.hybrid.state import SIZES, Kind, Layout
from algorithms.arrays import Array, Flags, Indices
from algorithms.calibration.image_points import ObservedTurns, TargetImages
from algorithms.calibration.lenses import Lens


@dataclass(frozen=True, eq=False)
class HeadMount:
    """A camera on a scanner's head; the scanner's frame is that of the targets."""

    angles_rad: Array
    """(photos,) head angles."""
    angle_std_rad: float
    """Their standard deviation; 0: they are exact."""
    rotation: Array | None = None
    """(3, 3) head from camera, as far as it is known; None: it is found."""
    position: Array | None = None
    """(3,) of the camera in the frame of the head [m]."""
    rotation_std_rad: float | None = None
    """Of the given rotation about each axis of the camera, as an observation; 0: constant; None: unknown."""
    position_std_m: float | None = None
    """Of each given coordinate, likewise."""


@dataclass(frozen=True, eq=False)
class TargetField:
    """Targets and photos of one camera."""

    lens: Lens
    width: int
    height: int
    parameters: Array
    """(k,) of the lens: constant ones, start values, and observed ones; its first NaN: the principal distance is
    found."""
    unknown: Array
    """(k,) True for those that are estimated."""
    parameter_stds: Array
    """(k,) of given values as observations; inf: none."""
    target_names: Sequence[str]
    targets: Array
    """(n, 3) [m]; NaN where a target is not known."""
    target_covariances: Array
    """(n, 3, 3) [m²]: zero of held targets; NaN of free ones."""
    photo_names: Sequence[str]
    photos: Indices
    """(m,) photo of each image point."""
    points: Indices
    """(m,) target of each image point."""
    images: Array
    """(m, 2) columns and rows [px]."""
    image_stds: Array
    """(m, 2) [px]."""
    mount: HeadMount | None = None
    """None: each photo has a pose of its own."""
    shapes: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(n, bends) as those of `TargetImages`; no rows: the targets are where they are."""

    @property
    def held(self) -> Flags:
        """Tell which targets are exact, (n,)."""
        return np.asarray((self.target_covariances == 0.0).all(axis=(1, 2)))

    @property
    def known(self) -> Flags:
        """Tell which targets are held or observed, (n,)."""
        return np.asarray(np.isfinite(self.target_covariances).all(axis=(1, 2)))

    @property
    def bends(self) -> int:
        """Number of bends of the board."""
        return self.shapes.shape[1] if len(self.shapes) else 0

    def with_photos(self, chosen: Flags) -> "TargetField":
        """Keep some photos and what they show."""
        number = np.cumsum(chosen) - 1
        mount = self.mount and replace(self.mount, angles_rad=self.mount.angles_rad[chosen])
        shown = self.with_points(chosen[self.photos])
        names = [name for name, is_chosen in zip(self.photo_names, chosen, strict=True) if is_chosen]
        return replace(shown, photo_names=names, photos=number[shown.photos], mount=mount)

    def with_points(self, chosen: Flags) -> "TargetField":
        """Keep some image points."""
        return replace(
            self,
            photos=self.photos[chosen],
            points=self.points[chosen],
            images=self.images[chosen],
            image_stds=self.image_stds[chosen],
        )

    def free(self) -> dict[Kind, Array]:
        """Give for each kind of unknowns which are estimated."""
        photos = len(self.photo_names)
        seen = np.zeros(len(self.targets), dtype=bool)
        seen[self.points] = True
        free = {kind: np.zeros((0, SIZES[kind]), dtype=bool) for kind in Kind}
        free[Kind.POINT] = np.repeat((~self.held & (seen | self.known))[:, None], 3, axis=1)
        free[Kind.POSE] = np.ones((photos, 6), dtype=bool)
        free[Kind.MOUNT] = np.zeros((1 if self.mount is None else 2, 6), dtype=bool)
        free[Kind.SCANNER] = np.zeros((1, 4), dtype=bool)
        free[Kind.CAMERA] = np.append(self.unknown, np.ones(self.bends, dtype=bool))[None]
        if self.mount is not None:
            # the head only turns
            free[Kind.POSE][:] = False
            free[Kind.POSE][:, 2] = self.mount.angle_std_rad > 0.0
            free[Kind.MOUNT][1, :3] = self.mount.rotation_std_rad != 0.0
            free[Kind.MOUNT][1, 3:] = self.mount.position_std_m != 0.0
        return free

    def network(self) -> Network:
        """Give the observations and their unknowns."""
        photos = len(self.photo_names)
        mounts = np.full(len(self.photos), 0 if self.mount is None else 1)
        covariances = np.zeros((len(self.photos), 2, 2))
        covariances[:, 0, 0], covariances[:, 1, 1] = np.square(self.image_stds).T
        shapes = self.shapes if len(self.shapes) else np.zeros((len(self.targets), 0))
        parts: list[Observations] = [
            TargetImages(covariances, self.photos, mounts, self.points, self.images, self.lens, shapes)
        ]
        observed = np.flatnonzero(self.known & ~self.held)
        if len(observed):
            parts.append(Control(self.target_covariances[observed], observed, self.targets[observed]))
        prior = np.flatnonzero(self.unknown & np.isfinite(self.parameter_stds))
        if len(prior):
            parts.append(_observed(Kind.CAMERA, 0 * prior, prior, self.parameters[prior], self.parameter_stds[prior]))
        if self.mount is not None:
            parts += self._of_mount(self.mount)
        return Network(tuple(parts), Layout.of(self.free(), np.full(photos, -1)))

    def _of_mount(self, mount: HeadMount) -> list[Observations]:
        parts: list[Observations] = []
        n = len(mount.angles_rad)
        if mount.angle_std_rad > 0.0:
            stds = np.full(n, mount.angle_std_rad)
            places = np.full(n, ANGLES["kappa"])
            parts.append(_observed(Kind.POSE, np.arange(n), places, mount.angles_rad, stds))
        if mount.rotation_std_rad and mount.rotation is not None:
            parts.append(
                ObservedTurns(mount.rotation_std_rad**2 * np.eye(3)[None], np.array([1]), mount.rotation[None])
            )
        if mount.position_std_m and mount.position is not None:
            stds = np.full(3, mount.position_std_m)
            parts.append(_observed(Kind.MOUNT, np.ones(3, dtype=np.int64), np.arange(6, 9), mount.position, stds))
        return parts

    def unknown_names(self) -> list[str]:
        """Name the unknowns in the order of their columns."""
        free = self.free()
        names = []
        for kind in Kind:
            for block, place in np.argwhere(free[kind]):
                names.append(self._name(kind, int(block), int(place)))
        return names

    def _name(self, kind: Kind, block: int, place: int) -> str:
        if kind is Kind.POINT:
            return f"target {self.target_names[block]} {'XYZ'[place]}"
        if kind is Kind.CAMERA:
            return (*self.lens.names, "bend across", "bend along")[place]
        motion = ("rotation x", "rotation y", "rotation z", "X", "Y", "Z")[place]
        if kind is Kind.MOUNT:
            return f"mount {motion}"
        if self.mount is not None:
            return f"head angle of {self.photo_names[block]}"
        return f"photo {self.photo_names[block]} {motion}"


def _observed(kind: Kind, numbers: Array, places: Array, values: Array, stds: Array) -> ObservedUnknowns:
    return ObservedUnknowns(variances(stds), kind, numbers, places, values)
