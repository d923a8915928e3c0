"""E57 files as pages of 1024 bytes that end with a checksum, and an XML section that a header points to."""

import errno
import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from algorithms.progress import Progress
from service.errors import InsufficientStorageError
from service.formats.base import ScanFile
from service.formats.e57_xml import CONTENT_BYTES, PAGE_BYTES, PLACE

HEADER = struct.Struct("<8sIIQQQQ")
"""Signature, version, length of the file, place and length of the XML section, bytes of a page (ASTM E2807, 7)."""
BLOCK_BYTES = 1 << 26
CANNOT_COPY = frozenset((errno.EXDEV, errno.ENOSYS, errno.EINVAL, errno.EOPNOTSUPP, errno.EPERM))
"""The kernel cannot copy between these files by itself."""


def page(content: bytes) -> bytes:
    """Fill up a page and add its checksum, CRC-32C with the most significant byte first (ASTM E2807, 9.3)."""
    import google_crc32c

    filled = content.ljust(CONTENT_BYTES, b"\0")
    return filled + int(google_crc32c.value(filled)).to_bytes(4, "big")


def copy_with_xml(file: ScanFile, target: Path, xml: bytes, progress: Progress) -> None:
    """Copy a file, append another XML section and let the header point to it; all else stays as it is.

    Raises
    ------
    UnreadableFileError
        The header is damaged, or not such as E57 has.
    InsufficientStorageError
        There is no room for the copy.
    """
    length = file.size
    pages = -(-len(xml) // CONTENT_BYTES)
    header = _header(file, length)
    _require_room(target, length + pages * PAGE_BYTES)
    with file.path.open("rb") as source, target.open("w+b") as copy:
        for done in _copied(source, copy, length):
            progress.report(min(1.0, done / length), f"copying {file.filename}")
        copy.seek(length)
        for start in range(0, len(xml), CONTENT_BYTES):
            copy.write(page(xml[start : start + CONTENT_BYTES]))
        signature, major, minor, _, _, _, page_bytes = HEADER.unpack_from(header)
        fields = (signature, major, minor, length + pages * PAGE_BYTES, length, len(xml), page_bytes)
        copy.seek(0)
        copy.write(page(HEADER.pack(*fields) + header[HEADER.size : CONTENT_BYTES]))


def _header(file: ScanFile, length: int) -> bytes:
    """Give the first page, checked: a new checksum must not cover an old damage."""
    with file.path.open("rb") as stream:
        first = stream.read(PAGE_BYTES)
    if len(first) < PAGE_BYTES or page(first[:CONTENT_BYTES]) != first:
        raise file.unreadable("damaged E57: the checksum of the first page is wrong", PLACE)
    *_, declared, _, _, page_bytes = HEADER.unpack_from(first)
    if page_bytes != PAGE_BYTES or declared != length or length % PAGE_BYTES:
        raise file.unreadable(
            f"damaged E57: {declared} bytes in pages of {page_bytes} are declared, the file has {length}", PLACE
        )
    return first


def _require_room(target: Path, needed: int) -> None:
    status = os.statvfs(target.parent)
    if (free := status.f_bavail * status.f_frsize) < needed:
        raise InsufficientStorageError(f"{needed} bytes are needed for {target.name}, {free} are free")


def _copied(source: BinaryIO, copy: BinaryIO, length: int) -> Iterator[int]:
    """Copy bytes, inside the kernel where it can; give how far it is after each block."""
    done = 0
    by_kernel = hasattr(os, "copy_file_range")
    while done < length:
        if by_kernel:
            try:
                moved = os.copy_file_range(source.fileno(), copy.fileno(), min(BLOCK_BYTES, length - done), done, done)
            except OSError as fault:
                if fault.errno not in CANNOT_COPY:
                    raise
                by_kernel = False
                continue
        else:
            source.seek(done)
            copy.seek(done)
            moved = copy.write(source.read(min(BLOCK_BYTES, length - done)))
        if moved == 0:
            raise EOFError(f"the file ends after {done} of {length} bytes")
        done += moved
        yield done
