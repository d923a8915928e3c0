"""Damage done to whole files, from a generator with a fixed seed."""

import re
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from tests.scenes.hostile.e57_pages import with_right_checksums

ABSURD_WORDS = (
    "-1", "0", "1", "2147483647", "2147483648", "4294967295", "9223372036854775807", "9223372036854775808",
    "18446744073709551616", "9" * 300, "9" * 5000, "nan", "inf", "-inf", "1e300", "1e999", "-1e38", "0x10", "1_0",
    "٣", "", "x", "%s", "\0", "../../etc/passwd", "1e-320",
)  # fmt: skip
ABSURD_BYTES = (
    *(struct.pack("<i", number) for number in (-1, -(2**31), 2**31 - 1, 0)),
    *(struct.pack("<q", number) for number in (-1, -(2**63), 2**63 - 1, 0, 2**31, 2**32)),
    *(struct.pack(">I", number) for number in (2**31, 2**32 - 1, 65535)),
    *(struct.pack("<d", number) for number in (np.nan, np.inf, 1e300, -1e300, 5e-324)),
    *(struct.pack("<f", number) for number in (np.nan, np.inf, 3e38)),
    struct.pack("<H", 65535),
    struct.pack(">H", 65535),
    b"\xff" * 32,
    bytes(32),
)
NUMBER = re.compile(rb"[0-9]+(?:\.[0-9]+)?")
HEAD_BYTES = 700
Mutation = Callable[[bytes, np.random.Generator, Sequence[bytes]], bytes]


def _place(length: int, rng: np.random.Generator) -> int:
    """Choose a place, as often in the head as anywhere."""
    reach = min(length, HEAD_BYTES) if rng.random() < 0.5 else length
    return int(rng.integers(0, max(1, reach)))


def cut(content: bytes, rng: np.random.Generator, _others: Sequence[bytes]) -> bytes:
    return content[: _place(len(content), rng)]


def flip_bits(content: bytes, rng: np.random.Generator, _others: Sequence[bytes]) -> bytes:
    changed = bytearray(content)
    for _ in range(int(rng.integers(1, 9))):
        changed[_place(len(content), rng)] ^= 1 << int(rng.integers(0, 8))
    return bytes(changed)


def overwrite(content: bytes, rng: np.random.Generator, _others: Sequence[bytes]) -> bytes:
    changed = bytearray(content)
    for _ in range(int(rng.integers(1, 4))):
        number = ABSURD_BYTES[int(rng.integers(0, len(ABSURD_BYTES)))]
        place = _place(len(content), rng) & (~3 if rng.random() < 0.7 else ~0)
        changed[place : place + len(number)] = number
    return bytes(changed[: len(content)])


def replace_number(content: bytes, rng: np.random.Generator, others: Sequence[bytes]) -> bytes:
    reach = content if rng.random() < 0.3 else content[: _place(len(content), rng) + 64]
    found = list(NUMBER.finditer(reach))
    if not found:
        return overwrite(content, rng, others)
    chosen = found[int(rng.integers(0, len(found)))]
    word = ABSURD_WORDS[int(rng.integers(0, len(ABSURD_WORDS)))].encode()
    return content[: chosen.start()] + word + content[chosen.end() :]


def splice(content: bytes, rng: np.random.Generator, others: Sequence[bytes]) -> bytes:
    other = others[int(rng.integers(0, len(others)))]
    start, length = int(rng.integers(0, len(other))), int(rng.integers(1, 400))
    place = _place(len(content), rng)
    kept = place if rng.random() < 0.5 else place + length
    return content[:place] + other[start : start + length] + content[kept:]


def repeat(content: bytes, rng: np.random.Generator, _others: Sequence[bytes]) -> bytes:
    start, length = _place(len(content), rng), int(rng.integers(1, 600))
    return content[: start + length] + content[start : start + length] * int(rng.integers(1, 20)) + content[start:]


def drop(content: bytes, rng: np.random.Generator, _others: Sequence[bytes]) -> bytes:
    start = _place(len(content), rng)
    return content[:start] + content[start + int(rng.integers(1, 200)) :]


MUTATIONS: tuple[Mutation, ...] = (cut, flip_bits, overwrite, replace_number, replace_number, splice, repeat, drop)


def damaged(files: Mapping[str, bytes], number: int) -> tuple[str, bytes]:
    """Give name and content of damaged file `number`: the same number, the same file."""
    rng = np.random.default_rng([2026, number])
    names = list(files)
    name = names[number % len(names)]
    content = files[name]
    for _ in range(1 if rng.random() < 0.7 else 2):
        content = MUTATIONS[int(rng.integers(0, len(MUTATIONS)))](content, rng, list(files.values())) or b"\0"
    if name.endswith(".e57") and rng.random() < 0.8:
        content = with_right_checksums(content, files[name])
    if name.endswith(".png") and rng.random() < 0.8:
        content = with_right_chunk_sums(content)
    return name, content


def with_right_chunk_sums(content: bytes) -> bytes:
    """Renew the checksums of a PNG's chunks, so that damage gets past them."""
    changed = bytearray(content)
    place = 8
    while place + 12 <= len(changed):
        (length,) = struct.unpack_from(">I", changed, place)
        end = place + 8 + length
        if end + 4 > len(changed):
            break
        struct.pack_into(">I", changed, end, zlib.crc32(changed[place + 4 : end]))
        place = end + 4
    return bytes(changed)
