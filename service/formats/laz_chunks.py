"""Chunks of LAZ files: what is declared is compared with the file's length before the library allocates for it."""

import struct
from collections.abc import Sequence
from typing import BinaryIO

from service.formats.base import ScanFile

SMALLEST_CHUNK_BYTES = 20
"""A chunk begins with one whole point, and the shortest point has 20 bytes."""
CHUNKED, LAYERED = 2, 3
"""Compressors of the point formats up to 5, and of those from 6 on, which stores each attribute apart."""
VARIABLE = 0xFFFFFFFF
"""Stands for the number of points in a chunk where each has its own, which the table tells."""
LARGEST_CHUNK = 1_000_000
"""Chunks of more points are not read side by side; 50 000 are usual."""
RECORD = struct.Struct("<H10xI16xH")
"""Of the LASzip record compressor, points in a chunk and number of items."""
ITEM = struct.Struct("<HHH")
"""Type, bytes and version of an item."""
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


def check_compression(file: ScanFile, data_offset: int, point_bytes: int, count: int, record: bytes) -> bool:
    """Refuse what the LASzip record and the table of chunks declare and the file cannot hold.

    lazrs would allocate for it, up to gigabytes, and abort the process where memory does not suffice. Its parallel
    reader allocates for whole chunks, so that these must be small.

    Parameters
    ----------
    data_offset
        Where the points begin [byte].
    point_bytes, count
        Length of a point's record by the header, and how many there are.
    record
        Content of the LASzip record of the header.

    Returns
    -------
    Whether the chunks can be read side by side.

    Raises
    ------
    UnreadableFileError
        The compressor is not known; the parts of a point are not as long as its record; there are not as many chunks as
        the points take; a chunk is longer than the file, or a layer than its chunk.
    """
    import lazrs  # type: ignore[import-not-found, import-untyped, unused-ignore]

    if len(record) < RECORD.size:
        raise file.unreadable("the LASzip record is cut off", "header")
    compressor, chunk_points, number = RECORD.unpack_from(record)
    items = [ITEM.unpack_from(record, RECORD.size + ITEM.size * k) for k in range(number) if _holds(record, k)]
    if compressor not in {CHUNKED, LAYERED}:
        raise file.unreadable(f"LAZ compressor {compressor} is not supported, {CHUNKED} and {LAYERED} are", "header")
    head_bytes = sum(size for _, size, _ in items)
    if head_bytes != point_bytes:
        raise file.unreadable(f"the items of a point have {head_bytes} bytes and its record {point_bytes}", "header")
    if chunk_points == 0:
        raise file.unreadable("LAZ chunks of no points", "header")
    with file.path.open("rb") as stream:
        stream.seek(data_offset)
        table = lazrs.read_chunk_table(stream, lazrs.LazVlr(record))
        held = sum(points for points, _ in table)
        if count > held:
            raise file.unreadable(f"LAZ chunks of {held} points in all cannot hold {count}", "header")
        layers = _layers_of(items) if compressor == LAYERED else 0
        place, left = data_offset + 8, count
        for points, length in table:
            if left <= 0 and length == 0:
                continue  # some writers end with an empty chunk
            left -= points
            if place + length > file.size or head_bytes + (4 + 4 * layers if layers else 0) > length:
                raise file.unreadable(f"a LAZ chunk of {length} bytes does not fit", f"byte {place}")
            if layers and head_bytes + 4 + _layer_bytes(stream, place + head_bytes + 4, layers) > length:
                raise file.unreadable("the layers of a LAZ chunk are longer than the chunk", f"byte {place}")
            place += length
    exact = held - count < (1 if chunk_points == VARIABLE else chunk_points)
    return exact and len(table) > 1 and max(points for points, _ in table) <= LARGEST_CHUNK


def _holds(record: bytes, item: int) -> bool:
    return len(record) >= RECORD.size + ITEM.size * (item + 1)


def _layers_of(items: Sequence[tuple[int, int, int]]) -> int:
    return sum(size if kind == EXTRA_BYTES else LAYERS.get(kind, 0) for kind, size, _ in items)


def _layer_bytes(stream: BinaryIO, place: int, layers: int) -> int:
    """Give the bytes of the layers' lengths and of the layers."""
    stream.seek(place)
    return 4 * layers + int(sum(struct.unpack(f"<{layers}I", stream.read(4 * layers))))
