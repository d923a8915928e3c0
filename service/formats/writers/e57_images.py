"""Images of stations in fresh E57 files: pinhole representation, distortion, pose."""

from typing import Any

from algorithms.geometry.camera_mounts import CameraAxes, camera_from_axes
from algorithms.geometry.cameras import Camera
from service.formats.e57_photos import CENTRE_FROM_CORNER_PX
from service.formats.writers.base import StationCloud, StationImage
from service.formats.writers.e57_values import set_numbers, set_pose

PIXEL_M = 5e-6
"""Height of a pixel; E57 wants one beside the focal length, only their ratio counts [m]."""
DISTORTION_PREFIX = "cv"
CONTENTS = {"image/jpeg": "jpegImage", "image/png": "pngImage"}
DISTORTION = {"K1": "k1", "K2": "k2", "K3": "k3", "P1": "p1", "P2": "p2"}


def add_images(image_file: Any, images: Any, cloud: StationCloud, scan_guid: str) -> None:
    """Add the photos of a station to the images of a file, with their poses in the file's common frame."""
    from pye57 import libe57

    for number, image in enumerate(cloud.images):
        node = libe57.StructureNode(image_file)
        node.set("guid", libe57.StringNode(image_file, f"{scan_guid[:-1]}-{number}}}"))
        node.set("name", libe57.StringNode(image_file, image.name))
        node.set("associatedData3DGuid", libe57.StringNode(image_file, scan_guid))
        if image.scan_from_camera is not None:
            camera_from_e57 = camera_from_axes(CameraAxes.RIGHT_UP_BACKWARD)
            set_pose(image_file, node, cloud.pose * image.scan_from_camera * camera_from_e57)
        _set_representation(image_file, node, image)
        if image.camera is not None and is_distorted(image):
            _set_distortion(image_file, node, image.camera)
        images.append(node)
        content = image.content()
        blob = node[_representation(image)][CONTENTS[image.media_type]]
        blob.write(content, 0, len(content))


def is_distorted(image: StationImage) -> bool:
    """Tell whether the extension for lens distortion is needed."""
    return image.camera is not None and any(getattr(image.camera, name) for name in DISTORTION.values())


def _representation(image: StationImage) -> str:
    return "visualReferenceRepresentation" if image.camera is None else "pinholeRepresentation"


def _set_representation(image_file: Any, node: Any, image: StationImage) -> None:
    from pye57 import libe57

    values: dict[str, float] = {"imageHeight": image.height, "imageWidth": image.width}
    camera = image.camera
    if camera is not None:
        values |= {
            "focalLength": camera.fy * PIXEL_M,
            "pixelWidth": camera.fy * PIXEL_M / camera.fx,
            "pixelHeight": PIXEL_M,
            "principalPointX": camera.cx + CENTRE_FROM_CORNER_PX,
            "principalPointY": camera.cy + CENTRE_FROM_CORNER_PX,
        }
    set_numbers(image_file, node, {_representation(image): values})
    blob = libe57.BlobNode(image_file, len(image.content()))
    node[_representation(image)].set(CONTENTS[image.media_type], blob)


def _set_distortion(image_file: Any, node: Any, camera: Camera) -> None:
    """Write the extension with OpenCV's parameters, which count pixels from their centres."""
    values = {key: float(getattr(camera, name)) for key, name in DISTORTION.items()}
    values |= {"FX": camera.fx, "FY": camera.fy, "CX": camera.cx, "CY": camera.cy}
    numbers = {f"{DISTORTION_PREFIX}:CV_{key}": value for key, value in values.items()}
    set_numbers(image_file, node, {f"{DISTORTION_PREFIX}:distortion": numbers})
