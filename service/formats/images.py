"""JPEG, PNG and TIFF images as photos: pixels only, they tell neither camera nor pose."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import UInt8

from algorithms.arrays import Array
from service.errors import FileTooLargeError
from service.formats.base import ReadLimits, ScanFile
from service.formats.image_header import (
    ImageHeader,
    ImageHeaderError,
    check_chunks,
    image_format,
    image_header,
)
from service.formats.photo import Photo, PhotoInfo

LEAST_SIDE_PX = 8
"""In smaller images no straight edge can be measured."""
MAX_SIDE_PX = 32_000
"""OpenCV addresses pixels with 16 bits in places."""
MAX_BYTES_PER_PIXEL = 16
"""No image needs more, uncompressed with four channels of 16 bits and metadata."""


FREE_PIXELS, MOST_PIXELS_PER_BYTE = 4_000_000, 100
"""An even area takes a JPEG a byte for 85 pixels, and a photo ten times as much; a few may be packed as they like."""


class ImageError(ValueError):
    """Say why bytes are no usable image."""


@final
@dataclass(frozen=True)
class ImageReader:
    """Read files that hold one image; of a TIFF with several pages the first."""

    extensions: tuple[str, ...] = (".jpg", ".jpeg", ".png", ".tif", ".tiff")

    def format_of(self, head: bytes) -> str | None:
        """Name the image format."""
        return image_format(head)

    def holds_scans(self, file: ScanFile) -> bool:  # noqa: ARG002 - the same for every file
        """Tell that there are none."""
        return False

    def photos(self, file: ScanFile, limits: ReadLimits, wanted: int | None = None) -> Iterator[Photo]:
        """Yield the only photo."""
        if wanted not in {None, 0}:
            return
        if file.size > MAX_BYTES_PER_PIXEL * limits.max_pixels:
            raise FileTooLargeError(file.filename, file.size, MAX_BYTES_PER_PIXEL * limits.max_pixels)
        try:
            image = decoded(file.path.read_bytes(), file.filename, limits)
        except ImageError as fault:
            raise file.unreadable(str(fault), "photo 0") from None
        height, width = image.shape[:2]
        yield Photo(PhotoInfo(0, file.filename, width, height), image)


def decoded(data: bytes, name: str, limits: ReadLimits) -> UInt8[Array, "h w 3"]:
    """Decode an image to RGB with 8 bits a channel, having checked its size first.

    The pixels stay as they are stored: a turn that the metadata ask for is not made, because cameras are calibrated in
    stored pixels. Of channels with 16 bits the upper 8 are taken.

    Raises
    ------
    ImageError
        These bytes are no image, or a damaged or cut one.
    FileTooLargeError
        It has more pixels than `limits` allow.
    """
    import cv2

    header = _checked_header(data, name, limits)
    flags = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error as fault:
        raise ImageError(f"the {header.format} image cannot be decoded: {fault.err or fault}") from None
    if image is None:
        raise ImageError(f"the {header.format} image is damaged or cut off: its pixels cannot be decoded")
    if image.shape != (header.height, header.width, 3):
        raise ImageError(
            f"the {header.format} image says {header.width} by {header.height} pixels, "
            f"but {image.shape[1]} by {image.shape[0]} were found"
        )
    return np.asarray(image, dtype=np.uint8)


def _checked_header(data: bytes, name: str, limits: ReadLimits) -> ImageHeader:
    try:
        header = image_header(data)
    except ImageHeaderError as fault:
        raise ImageError(str(fault)) from None
    size = f"the {header.format} image has {header.width} by {header.height} pixels"
    if header.decoded_pixels > limits.max_pixels:
        raise FileTooLargeError(name, header.decoded_pixels, limits.max_pixels, "pixels")
    if min(header.width, header.height) < LEAST_SIDE_PX:
        raise ImageError(f"{size}; at least {LEAST_SIDE_PX} a side are needed")
    if max(header.width, header.height) > MAX_SIDE_PX:
        raise ImageError(f"{size}; at most {MAX_SIDE_PX} a side are read")
    if header.decoded_pixels > FREE_PIXELS + MOST_PIXELS_PER_BYTE * len(data):
        raise ImageError(f"{size} in {len(data)} bytes: no photo is packed so well")
    if header.format == "PNG":
        try:
            check_chunks(data)
        except ImageHeaderError as fault:
            raise ImageError(str(fault)) from None
    return header
