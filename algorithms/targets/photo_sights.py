"""Where a photo should show a target, and how."""

from dataclasses import dataclass, replace

import numpy as np

from algorithms.arrays import Array, Vector3
from algorithms.geometry.rotations import cross_matrices
from algorithms.photos.station_photo import StationPhoto
from algorithms.targets.found import FoundTarget
from algorithms.targets.options import TargetKind
from algorithms.targets.tangent_plane import TangentPlane, plane_basis

WINDOW_SIGMAS = 4.0
LARGEST_WINDOW_PX = 1500.0
"""A larger window says that the mount is not known."""
SMALLEST_PX = {TargetKind.BOARD: 8.0, TargetKind.RETRO_SQUARE: 5.0}
"""Flat targets, which take so many pixels across at least. How bright a round one is depends on where the light comes
from, and draws its outline to that side.
"""
RIM = 0.3
"""So much of its size around a target takes part, and at least so many pixels:"""
RIM_PX = 3.0
STEEPEST = float(np.cos(np.deg2rad(75.0)))
LEAST_AGREEMENT, MOST_UNEXPLAINED, LEAST_CONTRAST = 0.95, 1.3, 5.0
"""The target explains so much of the brightness, or leaves less than so many times the photo's noise of a contrast of
more than so many times that."""


@dataclass(frozen=True, eq=False)
class Sight:
    """A target as the camera should see it."""

    photo: StationPhoto
    grey: Array
    noise: float
    """Standard deviation of a pixel [grey levels]."""
    target: FoundTarget
    plane: TangentPlane
    """In the frame of the camera."""
    expected_px: Array
    """(2,) where scan, mount and camera have it."""
    own_covariance_px2: Array
    """(2, 2) of that, by the target alone."""
    by_mount: Array
    """(2, 6) derivatives of that by the mount [px/rad, px/m]."""

    @property
    def covariance_px2(self) -> Array:
        """Give the covariance (2, 2) of the expected place: the target's and the mount's."""
        return np.asarray(self.own_covariance_px2 + self.by_mount @ self.photo.mount_covariance @ self.by_mount.T)

    @property
    def pixel_m(self) -> float:
        """Size of a pixel at the target [m]."""
        return float(self.plane.centre_m[2]) / float(np.sqrt(self.photo.camera.fx * self.photo.camera.fy))

    @property
    def size_px(self) -> float:
        """Size of the target in the photo, not foreshortened [px]."""
        return self.target.size_m / self.pixel_m

    @property
    def rim_m(self) -> float:
        """Width of the rim that takes part [m]."""
        return max(RIM * self.target.size_m, RIM_PX * self.pixel_m)

    @property
    def hindrance(self) -> str | None:
        """Say why the target cannot be measured in this photo; None where nothing hinders it."""
        smallest, half = SMALLEST_PX[self.target.kind], 0.5 * self.size_px + RIM_PX
        low, high = half, np.array(self.grey.shape[::-1]) - 1 - half
        window = WINDOW_SIGMAS * float(np.sqrt(np.diag(self.covariance_px2).max()))
        checks = (
            (
                bool(np.any((self.expected_px < low) | (self.expected_px > high))),
                "it is cut off by the rim of the photo",
            ),
            (self.size_px < smallest, f"it is only {self.size_px:.1f} px wide, {smallest:.0f} are needed"),
            (window > LARGEST_WINDOW_PX, f"its window is {window:.0f} px wide: state the mount better"),
        )
        return next((reason for hinders, reason in checks if hinders), None)

    def clear(self, rms: float, contrast: float) -> bool:
        """Tell whether nothing but noise is left of a target that is seen clearly, however weak it is."""
        return rms < MOST_UNEXPLAINED * self.noise and abs(contrast) > LEAST_CONTRAST * self.noise

    def places(self, pixels: Array) -> Array:
        """Give where the rays of pixels (n, 2) meet the target's plane (n, 2) about its centre [m]."""
        rays = self.photo.camera.rays_from_ideal(self.photo.camera.ideal_from_image(pixels))
        return self.plane.met_by(rays)[0]

    def at(self, image_px: Array) -> "Sight":
        """Move the target across the ray to where a pixel (2,) has it, at the same depth."""
        ray = self.photo.camera.rays_from_ideal(self.photo.camera.ideal_from_image(image_px[None, :]))[0]
        centre = ray * (float(self.plane.centre_m[2]) / float(ray[2]))
        old = self.plane
        plane = TangentPlane(centre, old.normal, old.basis, 0.0, 0.0, told=old.told)
        return replace(self, plane=plane)


def sight_of(photo: StationPhoto, grey: Array, noise: float, target: FoundTarget, origin_m: Vector3) -> Sight | str:
    """Give what is expected of a target in a photo, or why it cannot be seen there."""
    if target.kind not in SMALLEST_PX:
        return "it is round, and light from one side would draw its outline there: photos measure flat targets"
    camera = photo.camera
    turn = photo.scan_from_camera.rotation.as_matrix()
    arm = target.centre_m + origin_m - np.asarray(photo.scan_from_camera.translation)
    centre = arm @ turn
    if not camera.projectable(centre[None, :])[0]:
        return ""
    image = camera.image_from_camera(centre[None, :])[0]
    facing = -arm / np.linalg.norm(arm) if target.normal is None else target.normal
    normal = facing @ turn
    if float(normal @ centre) > -STEEPEST * float(np.linalg.norm(centre)):
        return "the camera sees it at more than 75 degrees or from behind"
    plane = TangentPlane(centre, normal, plane_basis(normal), 0.0, 0.0, told=target.normal is not None)
    ideal = camera.ideal_from_camera(centre[None, :])
    by_camera = camera.image_jacobians(ideal)[0] @ camera.projection_jacobians(centre[None, :])[0]
    by_scan = by_camera @ turn.T
    own = by_scan @ target.covariance_m2 @ by_scan.T
    # a camera that is turned and moved by a little sees the point turned and moved back
    by_mount = by_scan @ np.hstack([cross_matrices(arm[None, :])[0], -np.eye(3)])
    sight = Sight(photo, grey, noise, target, plane, image, own, by_mount)
    return sight.hindrance or sight if camera.inside(image[None, :])[0] else ""
