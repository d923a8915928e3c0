"""Photos of a station in a request: which, with what camera, and where that camera was."""

from typing import Annotated, Literal, TypeAlias

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

from schemas.values.base import RequestModel
from schemas.values.file_references import FileReference
from schemas.values.rigid_matrix import RigidMatrix

AxesName: TypeAlias = Literal["right-down-forward", "right-up-backward", "forward-left-up"]
"""Values of `algorithms.geometry.camera_mounts.CameraAxes`, which would load scipy into the web process."""
LEAST_FOCAL_PX, MAX_FOCAL_PX = 1e-3, 1e7
MAX_COEFFICIENT = 1e6

Pixels = Annotated[float, Field(ge=-1e6, le=1e6)]
Coefficient = Annotated[float, Field(ge=-MAX_COEFFICIENT, le=MAX_COEFFICIENT)]


class CameraRequest(RequestModel):
    """Interior orientation: pinhole with the distortion of Brown, as OpenCV writes it."""

    model: Literal["brown"] = "brown"
    """The camera model."""
    width: int = Field(ge=1, le=65_536)
    """Columns of the photo as it is stored, without the turn that its metadata may ask for [px]."""
    height: int = Field(ge=1, le=65_536)
    """Rows of the photo as it is stored [px]."""
    fx: float = Field(ge=LEAST_FOCAL_PX, le=MAX_FOCAL_PX)
    """Focal length along the rows [px]."""
    fy: float = Field(ge=LEAST_FOCAL_PX, le=MAX_FOCAL_PX)
    """Focal length along the columns [px]."""
    cx: Pixels
    """Column of the principal point, 0 at the centre of the leftmost pixel [px]."""
    cy: Pixels
    """Row of the principal point, 0 at the centre of the topmost pixel [px]."""
    k1: Coefficient = 0.0
    """Radial distortion, second order."""
    k2: Coefficient = 0.0
    """Radial distortion, fourth order."""
    k3: Coefficient = 0.0
    """Radial distortion, sixth order."""
    p1: Coefficient = 0.0
    """Tangential distortion along y."""
    p2: Coefficient = 0.0
    """Tangential distortion along x."""


class MountStd(RequestModel):
    """How well the pose of the camera on the scanner is known: the error that all lines of a photo share."""

    rotation_gon: float = Field(default=0.02, ge=1e-6, le=50.0)
    """Standard deviation of the rotation about each axis [gon]."""
    translation_m: float = Field(default=0.003, ge=1e-6, le=100.0)
    """Standard deviation of each coordinate of the projection centre [m]."""


class PhotoReference(FileReference):
    """One photo of an uploaded file."""

    index: int = Field(default=0, ge=0, le=1_000_000)
    """Number of the photo in the file, from 0."""
    camera: CameraRequest | None = None
    """Interior orientation; may be left out when the file carries it."""


def _rotation_about_z(matrix: list[list[float]]) -> list[list[float]]:
    if max(abs(matrix[2][0]), abs(matrix[2][1]), abs(matrix[2][2] - 1.0)) > 1e-3:
        raise PydanticCustomError("cop_axis", "the head turns about the scanner's z axis only")
    return matrix


class StationPhoto(PhotoReference):
    """A photo taken from the scanner's station."""

    scan_from_camera: RigidMatrix | None = None
    """Pose of the camera in the scan's frame; may be left out when the file carries it, or `mount` and `cop` are given
    instead."""
    mount: RigidMatrix | None = None
    """M_mount: camera from scan at head angle 0; scan_from_camera = M_COP · M_mount⁻¹."""
    cop: Annotated[RigidMatrix, AfterValidator(_rotation_about_z)] | None = None
    """M_COP: rotation of the head about the scanner's z axis when the photo was taken, as a matrix."""
    cop_gon: float | None = Field(default=None, ge=-800.0, le=800.0)
    """The same as an angle, counter-clockwise seen from above [gon]."""
    camera_axes: AxesName = "right-down-forward"
    """How the camera frame of `scan_from_camera` or `mount` is laid: x, y, z."""
    mount_std: MountStd = Field(default_factory=MountStd)
    """How well that pose is known."""
