"""Images of ASTM E57 (E2807) files as photos: interior orientation, distortion, pose.

Principal points of E57 count from the outer corner of the top left pixel, so that pixel centres lie at halves: libE57
(Coordinate systems, libe57.org/bestCoordinates.html) has (0, 0) in the top left corner and one image plane for all
representations; a panorama's Ximage = imageWidth / 2 - azimuth / pixelWidth runs from 0 to imageWidth over the full
circle, which are the outer borders and not pixel centres. A pinhole image has Ximage = principalPointX - (x / z)
focalLength / pixelWidth there, and six such images of 90 degrees close to a cube only with the principal point at
imageWidth / 2. The extension for lens distortion names OpenCV's parameters, which count from the pixel's centre.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, final

from scipy.spatial.transform import RigidTransform

from algorithms.errors import InvalidInputError
from algorithms.geometry.camera_mounts import CameraAxes, scan_from_camera_with_axes
from algorithms.geometry.cameras import Camera
from service.errors import FileTooLargeError, UnreadableFileError
from service.formats.base import ReadLimits, ScanFile
from service.formats.e57_nodes import faults_named, number_of, opened, pose_of
from service.formats.images import MAX_BYTES_PER_PIXEL, ImageError, decoded
from service.formats.photo import Photo, PhotoInfo

PINHOLE, VISUAL = "pinholeRepresentation", "visualReferenceRepresentation"
UNSUPPORTED = {
    "sphericalRepresentation": "a spherical panorama: straight edges are not straight in it; only pinhole images and "
    "plain pictures are used",
    "cylindricalRepresentation": "a cylindrical panorama: straight edges are not straight in it; only pinhole images "
    "and plain pictures are used",
}
DISTORTION_URI = "http://www.libe57.org/E57_LEICA_Camera_Distortion.txt"
"""Extension with the parameters of OpenCV's camera model."""
RATIONAL = ("K4", "K5", "K6")
CENTRE_FROM_CORNER_PX = 0.5
"""E57 counts from the corner of the first pixel, this project and OpenCV from its centre [px]."""


@final
@dataclass(frozen=True)
class E57PhotoReader:
    """Read the images of E57 files, panoramas only as refused."""

    extensions: tuple[str, ...] = (".e57",)

    def format_of(self, head: bytes) -> str | None:
        """Name the format by its signature."""
        return "E57" if head.startswith(b"ASTM-E57") else None

    def holds_scans(self, file: ScanFile) -> bool:
        """Tell whether the file holds scans beside its images."""
        with opened(file) as image_file, faults_named(file, "data3D"):
            root = image_file.root()
            return bool(root.isDefined("data3D") and len(root["data3D"]) > 0)

    def photos(self, file: ScanFile, limits: ReadLimits, wanted: int | None = None) -> Iterator[Photo]:
        """Yield the images of a file in order, or only the one wanted; one that cannot be used says why."""
        with opened(file) as image_file:
            with faults_named(file, "images2D"):
                root = image_file.root()
                images = root["images2D"] if root.isDefined("images2D") else []
                if len(images) > limits.max_scans:
                    raise ValueError(f"{len(images)} images are declared, at most {limits.max_scans} are read")
                scans = _scan_poses(root)
                prefix = _distortion_prefix(image_file)
            for index in range(len(images)) if wanted is None else [wanted] if 0 <= wanted < len(images) else []:
                try:
                    with faults_named(file, f"photo {index}"):
                        info = _info(images[index], index, scans, prefix)
                        photo = _with_pixels(file, images[index], info, limits)
                except UnreadableFileError as fault:  # the scans and the other images stay usable
                    photo = Photo(PhotoInfo(index, "", 0, 0, refused=fault.reason), None)
                yield photo


def encoded_photo(file: ScanFile, index: int, limits: ReadLimits) -> bytes:
    """Give an image of a file as it is stored there, JPEG or PNG.

    Raises
    ------
    UnreadableFileError
        There is none under that index.
    FileTooLargeError
        It is too large to be a photo.
    """
    place = f"photo {index}"
    with opened(file) as image_file, faults_named(file, place):
        node = image_file.root()["images2D"][index]
        parts = node[PINHOLE] if node.isDefined(PINHOLE) else node[VISUAL]
        return _blob(file, parts, place, limits)


def _scan_poses(root: Any) -> dict[str, tuple[int, RigidTransform]]:
    """Give number and pose of every scan by its guid; without a pose a scan lies in the common frame."""
    found = {}
    for index in range(len(root["data3D"]) if root.isDefined("data3D") else 0):
        node = root["data3D"][index]
        guid = str(node["guid"].value()) if node.isDefined("guid") else f"scan {index}"
        pose = pose_of(node)
        found[guid] = (index, RigidTransform.identity() if pose is None else pose)
    return found


def _distortion_prefix(image_file: Any) -> str | None:
    for number in range(int(image_file.extensionsCount())):
        if image_file.extensionsUri(number) == DISTORTION_URI:
            return str(image_file.extensionsPrefix(number))
    return None


def _info(node: Any, index: int, scans: dict[str, tuple[int, RigidTransform]], prefix: str | None) -> PhotoInfo:
    name = str(node["name"].value()) if node.isDefined("name") else ""
    kind = next((each for each in (PINHOLE, VISUAL, *UNSUPPORTED) if node.isDefined(each)), None)
    if kind is None:
        return PhotoInfo(index, name, 0, 0, refused="the image has no representation that is known here")
    width, height = (int(number_of(node[kind][side])) for side in ("imageWidth", "imageHeight"))
    if kind in UNSUPPORTED:
        return PhotoInfo(index, name, width, height, refused=UNSUPPORTED[kind])
    remarks: list[str] = []
    camera = None
    if kind == PINHOLE:
        try:
            camera = _camera(node[kind], _distortion(node, prefix), width, height)
        except InvalidInputError as fault:
            remarks.append(f"the file gives no usable interior orientation: {fault}")
    else:
        remarks.append("a plain picture: the file does not tell its interior orientation")
    scan, pose = _placed(node, scans, remarks)
    return PhotoInfo(index, name, width, height, camera, pose, scan, remarks=tuple(remarks))


def _camera(node: Any, distortion: dict[str, float], width: int, height: int) -> Camera:
    """Give the interior orientation in pixels; E57 stores it in metres and pixels.

    Raises
    ------
    InvalidInputError
        No camera can have these parameters.
    """
    focal_m = number_of(node["focalLength"])
    sizes_m = [number_of(node[side]) for side in ("pixelWidth", "pixelHeight")]
    fx, fy = (focal_m / size if size > 0.0 else math.nan for size in sizes_m)
    cx, cy = (number_of(node[f"principalPoint{axis}"]) - CENTRE_FROM_CORNER_PX for axis in "XY")
    if distortion.get("FX", 0.0) > 0.0 and distortion.get("FY", 0.0) > 0.0:
        fx, fy, cx, cy = (distortion.get(key, 0.0) for key in ("FX", "FY", "CX", "CY"))
    if any(distortion.get(key, 0.0) for key in RATIONAL):
        raise InvalidInputError("camera", "its distortion has the coefficients k4 to k6", "k1 k2 k3 p1 p2 are read")
    k1, k2, k3, p1, p2 = (distortion.get(key, 0.0) for key in ("K1", "K2", "K3", "P1", "P2"))
    return Camera(width, height, fx, fy, cx, cy, k1, k2, k3, p1, p2)


def _distortion(node: Any, prefix: str | None) -> dict[str, float]:
    """Read the extension for lens distortion, keys without their ``CV_``."""
    name = f"{prefix}:distortion"
    if prefix is None or not node.isDefined(name):
        return {}
    keys = ("K1", "K2", "K3", *RATIONAL, "P1", "P2", "FX", "FY", "CX", "CY")
    child = node[name]
    return {key: number_of(child[f"{prefix}:CV_{key}"]) for key in keys if child.isDefined(f"{prefix}:CV_{key}")}


def _placed(
    node: Any, scans: dict[str, tuple[int, RigidTransform]], remarks: list[str]
) -> tuple[int | None, RigidTransform | None]:
    """Give the scan that an image belongs to, and the camera's pose in its frame; add why there is none."""
    world_from_camera = pose_of(node)
    if world_from_camera is None:
        remarks.append("the file does not tell the pose of the camera")
        return None, None
    guid = str(node["associatedData3DGuid"].value()) if node.isDefined("associatedData3DGuid") else None
    if guid is None and len(scans) == 1:
        guid = next(iter(scans))
    if guid not in scans:
        remarks.append("the file does not tell to which scan the image belongs")
        return None, None
    index, world_from_scan = scans[guid]
    # the camera frame of E57 looks along -z, x to the right of the image
    pose = world_from_scan.inv() * world_from_camera
    return index, scan_from_camera_with_axes(pose, CameraAxes.RIGHT_UP_BACKWARD)


def _with_pixels(file: ScanFile, node: Any, info: PhotoInfo, limits: ReadLimits) -> Photo:
    """Decode the image; one that cannot be decoded is refused, the rest of the file stays usable."""
    if info.refused is not None:
        return Photo(info, None)
    parts = node[PINHOLE] if node.isDefined(PINHOLE) else node[VISUAL]
    place = f"{file.filename}, photo {info.index},"
    try:
        image = decoded(_blob(file, parts, place, limits), place, limits)
    except (ImageError, FileTooLargeError) as fault:
        return Photo(_refused(info, str(fault)), None)
    height, width = image.shape[:2]
    if (width, height) != (info.width, info.height):
        why = f"the image has {width} by {height} pixels, the file says {info.width} by {info.height}"
        return Photo(_refused(info, why), None)
    return Photo(info, image)


def _blob(file: ScanFile, parts: Any, place: str, limits: ReadLimits) -> bytes:
    name = next((each for each in ("jpegImage", "pngImage") if parts.isDefined(each)), None)
    if name is None:
        raise ImageError("there is neither a JPEG nor a PNG image")
    count = int(parts[name].byteCount())
    if count > MAX_BYTES_PER_PIXEL * limits.max_pixels:
        raise FileTooLargeError(place, count, MAX_BYTES_PER_PIXEL * limits.max_pixels)
    if count > file.size:
        raise ImageError(f"the image is declared with {count} bytes, the whole file has {file.size}")
    data = bytearray(count)
    if count:
        parts[name].read(data, 0, count)
    return bytes(data)


def _refused(info: PhotoInfo, why: str) -> PhotoInfo:
    return PhotoInfo(info.index, info.name, info.width, info.height, refused=why)
