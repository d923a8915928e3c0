"""The photos of a station as they were uploaded, for formats that keep images."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from service.formats import read_photo
from service.formats.base import ScanFile
from service.formats.e57_photos import E57PhotoReader, encoded_photo
from service.formats.writers import StationImage
from service.names.content_keys import content_key
from service.ports import Json, StepContext
from service.use_cases.inputs.check_photos import camera_of
from service.use_cases.limits.read_limits import read_limits
from service.use_cases.steps.registered_calls import E57

KINDS = {b"\xff\xd8\xff": "image/jpeg", b"\x89PNG": "image/png"}
NOT_KEPT = "photo {name} is neither JPEG nor PNG, which are all that E57 keeps"
E57_SIGNATURE = b"ASTM-E57"


def images_of(
    context: StepContext, file: ScanFile, index: int, photos: Sequence[Json], format_name: str
) -> tuple[tuple[StationImage, ...], list[str]]:
    """Give the photos that belong to a station, those of its own E57 file among them; and which cannot be kept.

    Parameters
    ----------
    file, index
        The scan.
    photos
        Of the station, as the request has them.
    format_name
        To which they are to be written; only E57 keeps images.
    """
    if format_name != E57:
        return (), []
    found, notes = [], []
    for photo in photos:
        path = context.blobs.local_path(content_key(photo["sha256"]))
        image = _image(context, path, photo)
        if image is None:
            notes.append(NOT_KEPT.format(name=photo["filename"]))
        else:
            found.append(image)
    return (*found, *_own_images(context, file, index, {photo["sha256"] for photo in photos})), notes


def _image(context: StepContext, path: Path, photo: Json) -> StationImage | None:
    """Give a photo with the camera and the mount that the request or its file says."""
    info = read_photo(path, photo["filename"], photo["index"], read_limits(context)).info
    camera = info.camera if photo.get("camera") is None else camera_of(photo["camera"])
    mount = info.scan_from_camera
    if photo.get("scan_from_camera") is not None:
        mount = RigidTransform.from_matrix(np.array(photo["scan_from_camera"], dtype=np.float64))
    with path.open("rb") as stream:
        head = stream.read(len(E57_SIGNATURE))
    if head == E57_SIGNATURE:
        content = partial(encoded_photo, ScanFile(path, photo["filename"]), photo["index"], read_limits(context))
        kind = _kind(content()[:4])
    else:
        content, kind = path.read_bytes, _kind(head)  # type: ignore[assignment]
    if kind is None:
        return None
    name = info.name or photo["filename"]
    return StationImage(name, kind, info.width, info.height, content, camera, mount)


def _own_images(context: StepContext, file: ScanFile, index: int, listed: set[str]) -> tuple[StationImage, ...]:
    """Give the images of the scan's own file that belong to it, unless the request lists photos of that file."""
    with file.path.open("rb") as stream:
        if stream.read(len(E57_SIGNATURE)) != E57_SIGNATURE or file.path.name in listed:
            return ()
    found = []
    for photo in E57PhotoReader().photos(file, read_limits(context)):
        info = photo.info
        if info.refused is not None or info.scan != index:
            continue
        content = partial(encoded_photo, file, info.index, read_limits(context))
        kind = _kind(content()[:4])
        if kind is not None:
            image = StationImage(info.name, kind, info.width, info.height, content, info.camera, info.scan_from_camera)
            found.append(image)
    return tuple(found)


def _kind(head: bytes) -> str | None:
    return next((kind for magic, kind in KINDS.items() if head.startswith(magic)), None)
