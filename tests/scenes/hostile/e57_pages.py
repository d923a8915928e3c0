"""E57 files as bytes: pages of 1024 bytes that end with a checksum, and an XML section somewhere in them."""

import struct

PAGE_BYTES, CONTENT_BYTES = 1024, 1020
POLYNOMIAL = 0x82F63B78
HEADER_BYTES = 48


def _table() -> tuple[int, ...]:
    entries = []
    for number in range(256):
        value = number
        for _ in range(8):
            value = (value >> 1) ^ (POLYNOMIAL if value & 1 else 0)
        entries.append(value)
    return tuple(entries)


CRC = _table()


def checksum(content: bytes) -> bytes:
    """Give the CRC-32C of a page's content as it stands behind it (ASTM E2807, 9.3)."""
    value = 0xFFFFFFFF
    for byte in content:
        value = CRC[(value ^ byte) & 255] ^ (value >> 8)
    return (value ^ 0xFFFFFFFF).to_bytes(4, "big")


def with_right_checksums(damaged: bytes, original: bytes) -> bytes:
    """Renew the checksum of every page that was changed, so that the damage gets past it."""
    pages = bytearray(damaged)
    for start in range(0, len(pages) - PAGE_BYTES + 1, PAGE_BYTES):
        if pages[start : start + PAGE_BYTES] != original[start : start + PAGE_BYTES]:
            pages[start + CONTENT_BYTES : start + PAGE_BYTES] = checksum(pages[start : start + CONTENT_BYTES])
    return bytes(pages)


def xml_of(file: bytes) -> str:
    """Give the XML section."""
    start, length = struct.unpack_from("<QQ", file, 24)
    return _logical(file)[_logical_place(start) :][:length].decode()


def with_xml(file: bytes, xml: str | bytes, declared: int | None = None) -> bytes:
    """Put another XML section in the place of the old one, which is the last section of files that libE57 writes."""
    new = xml.encode() if isinstance(xml, str) else xml
    (start,) = struct.unpack_from("<Q", file, 24)
    logical = bytearray(_logical(file)[: _logical_place(start)] + new)
    logical += bytes(-len(logical) % CONTENT_BYTES)
    pages = len(logical) // CONTENT_BYTES
    struct.pack_into("<Q", logical, 16, pages * PAGE_BYTES)
    struct.pack_into("<Q", logical, 32, len(new) if declared is None else declared)
    parts = [bytes(logical[k * CONTENT_BYTES : (k + 1) * CONTENT_BYTES]) for k in range(pages)]
    return b"".join(part + checksum(part) for part in parts)


def _logical(file: bytes) -> bytes:
    return b"".join(file[start : start + CONTENT_BYTES] for start in range(0, len(file), PAGE_BYTES))


def _logical_place(physical: int) -> int:
    return physical - physical // PAGE_BYTES * (PAGE_BYTES - CONTENT_BYTES)
