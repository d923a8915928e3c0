"""Chunks of LAZ files: what is declared is compared with the file's length before the library allocates for it."""

import struct
from itertools import accumulate
from typing import BinaryIO

from service.formats.base import ScanFile

SMALLEST_CHUNK_BYTES = 20
"""A chunk begins with one whole point, and the shortest point has 20 bytes."""
LAYERED = 3
"""Compressor of the point formats 6 and later, which stores each attribute apart."""
LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
"""Layers of an item by its type: POINT14, RGB14, RGBNIR14, WAVEPACKET14."""
EXTRA_BYTES = 14
"""Type of the item BYTE14, which has one layer for each byte."""


def check_chunk_table(file: ScanFile, data_offset: int) -> None:
    """Refuse a table of chunks that cannot be: lazrs would allocate for it and abort the process.

    Raises
    ------
    UnreadableFileError
        It lies outside the file, or holds more chunks than the file can.
    """
    with file.path.open("rb") as stream:
        stream.seek(data_offset)
        start = stream.read(8)
        offset = struct.unpack("<q", start)[0] if len(start) == 8 else 0
        if offset == -1:  # written by a stream: the offset stands at the end
            stream.seek(file.size - 8)
            offset = struct.unpack("<q", stream.read(8))[0]
        if not data_offset + 8 <= offset <= file.size - 8:
            raise file.unreadable(f"the table of LAZ chunks cannot be at byte {offset}", f"byte {data_offset}")
        stream.seek(offset)
        _, chunks = struct.unpack("<II", stream.read(8))
    if chunks * SMALLEST_CHUNK_BYTES > file.size:
        raise file.unreadable(f"{chunks} LAZ chunks do not fit a file of {file.size} bytes", f"byte {offset}")


def check_layers(file: ScanFile, data_offset: int, record: bytes) -> None:
    """Refuse layers that are longer than their chunk: lazrs would allocate up to 4 GB for each.

    Parameters
    ----------
    data_offset
        Where the points begin [byte].
    record
        Content of the LASzip record of the header.

    Raises
    ------
    UnreadableFileError
        A layer or a chunk is longer than what it is in.
    """
    import lazrs  # type: ignore[import-not-found, import-untyped, unused-ignore]

    if len(record) < 34:
        raise file.unreadable("the LASzip record is cut off", "header")
    compressor, number = struct.unpack_from("<H", record)[0], struct.unpack_from("<H", record, 32)[0]
    if compressor != LAYERED:
        return
    items = [struct.unpack_from("<HHH", record, 34 + 6 * k) for k in range(number) if len(record) >= 40 + 6 * k]
    layers = sum(size if kind == EXTRA_BYTES else LAYERS.get(kind, 0) for kind, size, _ in items)
    head_bytes = sum(size for _, size, _ in items) + 4
    with file.path.open("rb") as stream:
        stream.seek(data_offset)
        lengths = [length for _, length in lazrs.read_chunk_table(stream, lazrs.LazVlr(record))]
        starts = accumulate(lengths, initial=data_offset + 8)
        for place, length in zip(starts, lengths, strict=False):
            if place + length > file.size or head_bytes + 4 * layers > length:
                raise file.unreadable(f"a LAZ chunk of {length} bytes does not fit", f"byte {place}")
            if head_bytes + _layer_bytes(stream, place + head_bytes, layers) > length:
                raise file.unreadable("the layers of a LAZ chunk are longer than the chunk", f"byte {place}")


def _layer_bytes(stream: BinaryIO, place: int, layers: int) -> int:
    """Give the bytes of the layers' lengths and of the layers."""
    stream.seek(place)
    return 4 * layers + int(sum(struct.unpack(f"<{layers}I", stream.read(4 * layers))))
