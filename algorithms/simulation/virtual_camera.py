"""The virtual camera's data sheet, and where it sits on the scanner."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Vector3
from algorithms.errors import InvalidInputError
from algorithms.geometry.camera_mounts import CameraAxes, scan_from_camera_with_axes, scan_from_mounted_camera
from algorithms.geometry.cameras import Camera


def scanner_camera(scale: float = 1.0) -> Camera:
    """Give a six megapixel camera with a 14 mm lens, field of view 80° by 58°; `scale` makes its photos smaller."""
    columns, rows = round(3008 * scale), round(2000 * scale)
    return Camera(
        width=columns,
        height=rows,
        fx=1792.4 * scale,
        fy=1793.1 * scale,
        # Pixel coordinates count from the centre of the corner pixel, sizes from its rim.
        cx=(1510.3 + 0.5) * scale - 0.5,
        cy=(995.9 + 0.5) * scale - 0.5,
        k1=-0.104,
        k2=0.098,
        k3=-0.021,
        p1=3e-4,
        p2=-5e-4,
    )


def top_mount(
    forward_m: float = 0.05, left_m: float = 0.0, up_m: float = 0.24, down_rad: float = 0.0
) -> RigidTransform:
    """Give M_mount of a camera on top of the scanner's head.

    Parameters
    ----------
    forward_m, left_m, up_m
        Projection centre in the scan frame, at head angle 0 along its x, y and z axes [m].
    down_rad
        How far the camera looks below the scanner's horizon.

    Returns
    -------
    camera from scan at head angle 0, where the camera looks along the scanner's x axis.
    """
    head = RigidTransform.from_components([forward_m, left_m, up_m], Rotation.from_rotvec([0.0, down_rad, 0.0]))
    return scan_from_camera_with_axes(head, CameraAxes.FORWARD_LEFT_UP).inv()


@dataclass(frozen=True)
class VirtualCamera:
    """Options of a camera on the scanner.

    Grey levels follow the light linearly unless a gamma is given: a gamma moves the middle of strong edges towards
    their dark side. Noise is independent from pixel to pixel and from colour to colour, as of a sensor with three
    colours in every pixel.
    """

    camera: Camera = field(default_factory=scanner_camera)
    """Interior orientation, taken as errorless."""
    mount: RigidTransform = field(default_factory=top_mount)
    """M_mount: camera from scan at head angle 0."""
    blur_px: float = 0.6
    """Standard deviation of the lens's point image, besides the square pixel."""
    exposure: float = 1.1
    """Share of the full scale that a white face turned to the sun reaches; what is beyond 1 burns out."""
    vignetting: float = 0.1
    """Share of the light lost in the corners, growing with the square of the distance from the principal point."""
    read_noise: float = 0.8
    """Standard deviation of the noise that is always there [grey levels]."""
    shot_noise: float = 0.02
    """Variance of the noise of light, per grey level [grey levels]."""
    gamma: float = 1.0
    """Grey = 255 (share of full scale)^(1/gamma); 2.2 is usual for finished pictures."""
    edge_samples: int = 34
    """Rays through pixels at edges; one elsewhere."""

    def __post_init__(self) -> None:
        """Refuse what no camera can have."""
        for name in ("blur_px", "vignetting", "read_noise", "shot_noise"):
            if not getattr(self, name) >= 0.0:
                raise InvalidInputError("virtual camera", f"{name} is {getattr(self, name)}", "0 or more")
        for name in ("exposure", "gamma"):
            if not getattr(self, name) > 0.0:
                raise InvalidInputError("virtual camera", f"{name} is {getattr(self, name)}", "above 0")
        if self.vignetting >= 1.0:
            raise InvalidInputError("virtual camera", f"vignetting is {self.vignetting}", "below 1")
        if self.edge_samples < 1:
            raise InvalidInputError("virtual camera", f"{self.edge_samples} rays through pixels at edges", "1 or more")

    def scan_from_camera(self, cop_rad: float) -> RigidTransform:
        """Give the camera's pose when the head has turned by an angle (see `scan_from_mounted_camera`)."""
        return scan_from_mounted_camera(self.mount, cop_rad)


def head_angle_towards(world_from_scan: RigidTransform, point_m: Vector3) -> float:
    """Give the head angle at which a camera that looks along the head turns to a point (3,) of the world [rad]."""
    x, y, _ = world_from_scan.inv().apply(point_m)
    return float(np.arctan2(y, x))
