"""Size of a JPEG, PNG or TIFF image from its first bytes, before anything is decoded: a small file may claim much."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import starmap

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_SIGNATURE = b"\xff\xd8\xff"
PNG_CHUNK_FRAME = 12
"""Bytes of length, name and checksum around the content of a chunk."""
TIFF_SIGNATURES = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers that begin a frame and tell its size; the three left out are tables and an extension."""
JPEG_ALONE = frozenset(range(0xD0, 0xD8)) | {0x01}
"""Markers without a length."""
TIFF_WIDTH, TIFF_HEIGHT, TIFF_BITS, TIFF_TILE_WIDTH, TIFF_TILE_HEIGHT = 256, 257, 258, 322, 323
TIFF_WHOLE = {1: "B", 3: "H", 4: "I", 16: "Q"}
"""Types of whole numbers, by their code in the file."""
MAX_TIFF_ENTRIES = 4096
MAX_BITS = 16


@dataclass(frozen=True)
class ImageHeader:
    """What the first bytes tell."""

    format: str
    width: int
    height: int
    decoded_pixels: int
    """So many pixels must be held in memory to decode it: of a tiled TIFF perhaps more than the image has."""


class ImageHeaderError(ValueError):
    """Say that the header is damaged, cut off, or of a kind that is not read."""


def image_format(head: bytes) -> str | None:
    """Name the image format that begins with these bytes; None for anything else."""
    if head.startswith(JPEG_SIGNATURE):
        return "JPEG"
    if head.startswith(PNG_SIGNATURE):
        return "PNG"
    return "TIFF" if head.startswith(TIFF_SIGNATURES) else None


def image_header(data: bytes) -> ImageHeader:
    """Read the size of an image.

    Raises
    ------
    ImageHeaderError
        These bytes are no JPEG, PNG or TIFF, or their header is damaged.
    """
    kind = image_format(data)
    try:
        if kind == "JPEG":
            return _jpeg(data)
        if kind == "PNG":
            return _png(data)
        if kind == "TIFF":
            return _tiff(data)
    except (struct.error, IndexError):
        raise ImageHeaderError(f"the header of the {kind} image is cut off") from None
    raise ImageHeaderError("this is no JPEG, PNG or TIFF image")


def check_chunks(data: bytes) -> None:
    """Refuse a PNG image with a chunk that is longer than the file: OpenCV allocates for it before it reads.

    Raises
    ------
    ImageHeaderError
        The image is damaged or cut off.
    """
    place, name = len(PNG_SIGNATURE), b""
    while name != b"IEND" and place + PNG_CHUNK_FRAME <= len(data):
        length, name = struct.unpack_from(">I4s", data, place)
        if place + PNG_CHUNK_FRAME + length > len(data):
            raise ImageHeaderError(f"the PNG image is damaged or cut off: a chunk of {length} bytes at byte {place}")
        place += PNG_CHUNK_FRAME + length


def _jpeg(data: bytes) -> ImageHeader:
    place = 2
    while True:
        if data[place] != 0xFF:
            raise ImageHeaderError(f"damaged JPEG: no marker at byte {place}")
        marker = data[place + 1]
        if marker == 0xFF:  # filling
            place += 1
        elif marker in JPEG_ALONE:
            place += 2
        elif marker in JPEG_FRAMES:
            height, width = struct.unpack_from(">HH", data, place + 5)
            return _header("JPEG", width, height, data[place + 4])
        elif marker in {0xD9, 0xDA}:
            raise ImageHeaderError(f"damaged JPEG: the image data begin without a frame header at byte {place}")
        else:
            place += 2 + struct.unpack_from(">H", data, place + 2)[0]


def _png(data: bytes) -> ImageHeader:
    length, name, width, height, bits = struct.unpack_from(">I4sIIB", data, len(PNG_SIGNATURE))
    if name != b"IHDR" or length != 13:
        raise ImageHeaderError("damaged PNG: the first chunk is not the header")
    return _header("PNG", width, height, bits)


def _tiff(data: bytes) -> ImageHeader:
    order = "<" if data[:2] == b"II" else ">"
    big = data[2:4] in {b"+\0", b"\0+"}
    start = struct.unpack_from(order + ("Q" if big else "I"), data, 8 if big else 4)[0]
    count = struct.unpack_from(order + ("Q" if big else "H"), data, start)[0]
    if not 1 <= count <= MAX_TIFF_ENTRIES:
        raise ImageHeaderError(f"damaged TIFF: the directory declares {count} entries")
    start += 8 if big else 2
    size = 20 if big else 12
    tags: Mapping[int, int] = dict(starmap(_tiff_entry, ((data, start + k * size, order, big) for k in range(count))))
    if TIFF_WIDTH not in tags or TIFF_HEIGHT not in tags:
        raise ImageHeaderError("damaged TIFF: the directory tells no image size")
    width, height = tags[TIFF_WIDTH], tags[TIFF_HEIGHT]
    tile = tags.get(TIFF_TILE_WIDTH, 0) * tags.get(TIFF_TILE_HEIGHT, 0)
    return _header("TIFF", width, height, tags.get(TIFF_BITS, 1), tile)


def _tiff_entry(data: bytes, place: int, order: str, big: bool) -> tuple[int, int]:
    """Give tag and first value; 0 for values that are no whole numbers."""
    tag, kind = struct.unpack_from(order + "HH", data, place)
    length = struct.unpack_from(order + ("Q" if big else "I"), data, place + 4)[0]
    if kind not in TIFF_WHOLE:
        return tag, 0
    at, room = place + (12 if big else 8), 8 if big else 4
    if length * struct.calcsize(TIFF_WHOLE[kind]) > room:
        at = struct.unpack_from(order + ("Q" if big else "I"), data, at)[0]
    return tag, struct.unpack_from(order + TIFF_WHOLE[kind], data, at)[0]


def _header(kind: str, width: int, height: int, bits: int, tile: int = 0) -> ImageHeader:
    if width == 0 or height == 0:
        raise ImageHeaderError(f"the {kind} image has {width} by {height} pixels")
    if bits > MAX_BITS:
        raise ImageHeaderError(f"the {kind} image has {bits} bits a channel, at most {MAX_BITS} are read")
    return ImageHeader(kind, width, height, max(width * height, tile))
