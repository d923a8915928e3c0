"""What a reader of photos is, and what it hands over."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

from jaxtyping import UInt8
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array
from algorithms.geometry.cameras import Camera
from service.formats.base import ReadLimits, ScanFile

BROWN = "brown"
"""Name of the camera model in documents."""


@dataclass(frozen=True)
class PhotoInfo:
    """What a file document tells about one photo."""

    index: int
    """Number of the photo in its file, from 0."""
    name: str
    width: int
    height: int
    camera: Camera | None = None
    """Interior orientation, where the file tells it."""
    scan_from_camera: RigidTransform | None = None
    """Pose of the camera (x right, y down, z forward) in the frame of a scan of the same file."""
    scan: int | None = None
    """Number of that scan; given together with `scan_from_camera`."""
    refused: str | None = None
    """Why the photo cannot be used at all."""
    remarks: tuple[str, ...] = ()
    """What the file does not tell, or not in a usable way."""

    def to_json(self) -> dict[str, Any]:
        """Give the members as plain JSON values, camera and pose as a request may repeat them."""
        pose = self.scan_from_camera
        return {
            "index": self.index,
            "name": self.name,
            "width": self.width,
            "height": self.height,
            "camera": None if self.camera is None else camera_document(self.camera),
            "scan_from_camera": None if pose is None else pose.as_matrix().tolist(),
            "scan": self.scan,
            "refused": self.refused,
            "remarks": list(self.remarks),
        }


@dataclass(frozen=True, eq=False)
class Photo:
    """One photo of a file."""

    info: PhotoInfo
    image: UInt8[Array, "h w 3"] | None
    """RGB as stored, not turned; None when the photo is refused."""


class PhotoReader(Protocol):
    """A file format that holds photos."""

    @property
    def extensions(self) -> tuple[str, ...]:
        """Endings of file names, lower case, with the dot."""
        ...

    def format_of(self, head: bytes) -> str | None:
        """Name the format of a file that begins with these bytes; None if this reader does not read it."""
        ...

    def holds_scans(self, file: ScanFile) -> bool:
        """Tell whether the file holds scans beside its photos."""
        ...

    def photos(self, file: ScanFile, limits: ReadLimits, wanted: int | None = None) -> Iterator[Photo]:
        """Yield the photos of a file in order, or only the one wanted (nothing if there is no such photo).

        Raises
        ------
        UnreadableFileError
            The file breaks its own format.
        FileTooLargeError
            A photo exceeds `limits`.
        """
        ...


def camera_document(camera: Camera) -> dict[str, Any]:
    """Give a camera as it stands in documents and requests."""
    names = ("width", "height", "fx", "fy", "cx", "cy", "k1", "k2", "k3", "p1", "p2")
    return {"model": BROWN, **{name: getattr(camera, name) for name in names}}
