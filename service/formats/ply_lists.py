"""PLY elements with lists: where each record begins, and its numbers without the lists."""

import struct
from collections.abc import Iterator, Sequence

import numpy as np

from algorithms.arrays import Array

Property = tuple[str, str, str | None]
"""Name, type of the value, type of the count before a list; None: no list."""
LONGEST_LIST = 1 << 20


class RecordsEndError(Exception):
    """Say that the records do not fit the file."""


def plain(properties: Sequence[Property]) -> list[tuple[str, str]]:
    """Give the properties that are no lists."""
    return [(name, kind) for name, kind, counted in properties if counted is None]


def read_records(data: Array, start: int, count: int, properties: Sequence[Property], order: str) -> tuple[Array, int]:
    """Read binary records; give their numbers without the lists, and where the next element begins.

    Parameters
    ----------
    data
        (bytes,) the file.
    start
        Where the first record begins.
    count
        Records.
    properties
        Of the element.
    order
        `<` or `>`.

    Raises
    ------
    RecordsEndError
        The file ends before, or a list is absurd.
    """
    lengths = _first_lengths(data, start, properties, order) if count else []
    dtype = _dtype(properties, order, lengths)
    end = start + count * dtype.itemsize
    if end <= len(data):
        table = data[start:end].view(dtype)
        counts = [f"count of {name}" for name, _, counted in properties if counted is not None]
        if all((table[name] == length).all() for name, length in zip(counts, lengths, strict=True)):
            return table, end
    return _walked(data, start, count, properties, order)


def without_lists(lines: Iterator[bytes], properties: Sequence[Property]) -> Iterator[bytes]:
    """Leave the lists out of lines of text.

    Raises
    ------
    ValueError
        A list is longer than its line.
    """
    for line in lines:
        words, kept, at = line.split(), [], 0
        for _, _, counted in properties:
            if at >= len(words):
                raise ValueError(f"a line of {len(words)} numbers is too short")
            if counted is None:
                kept.append(words[at])
                at += 1
            else:
                at += 1 + int(words[at])
        if at != len(words):
            raise ValueError(f"a line of {len(words)} numbers does not fit the lists in it")
        yield b" ".join(kept) + b"\n"


def _dtype(properties: Sequence[Property], order: str, lengths: Sequence[int]) -> np.dtype[np.void]:
    left, fields = list(lengths), []
    for name, kind, counted in properties:
        if counted is None:
            fields.append((name, order + kind))
        else:
            fields.append((f"count of {name}", order + counted))
            fields.append((f"list {name}", f"V{np.dtype(kind).itemsize * left.pop(0)}"))
    return np.dtype(fields)


def _first_lengths(data: Array, start: int, properties: Sequence[Property], order: str) -> list[int]:
    lengths, at = [], start
    for _, kind, counted in properties:
        if counted is None:
            at += np.dtype(kind).itemsize
        else:
            length, at = _list_end(data, at, kind, counted, order)
            lengths.append(length)
    return lengths


def _list_end(data: Array, at: int, kind: str, counted: str, order: str) -> tuple[int, int]:
    """Give the length of a list that begins at a place, and where it ends."""
    size = np.dtype(counted).itemsize
    if at + size > len(data):
        raise RecordsEndError(f"byte {at}")
    length = int(data[at : at + size].view(order + counted)[0])
    if not 0 <= length <= LONGEST_LIST:
        raise RecordsEndError(f"byte {at}")
    return length, at + size + length * np.dtype(kind).itemsize


def _walked(data: Array, start: int, count: int, properties: Sequence[Property], order: str) -> tuple[Array, int]:
    """Go from record to record, where lists differ in length."""
    content, at = memoryview(np.ascontiguousarray(data).data), start
    numbers = np.dtype([(name, order + kind) for name, kind in plain(properties)])
    kept = bytearray()
    steps = _steps(properties, order)
    for _ in range(count):
        for size, counter, item in steps:
            if counter is None:
                kept += content[at : at + size]
                at += size
            else:
                if at + counter.size > len(content):
                    raise RecordsEndError(f"byte {at}")
                length = int(counter.unpack_from(content, at)[0])
                if not 0 <= length <= LONGEST_LIST:
                    raise RecordsEndError(f"byte {at}")
                at += counter.size + length * item
        if at > len(content):
            raise RecordsEndError(f"byte {len(content)}")
    return np.frombuffer(bytes(kept), dtype=numbers) if numbers.itemsize else np.zeros(count, dtype=numbers), at


def _steps(properties: Sequence[Property], order: str) -> list[tuple[int, struct.Struct | None, int]]:
    """Give what is to be done with each record: bytes to keep, or a list of items to pass over."""
    codes = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d"}
    steps: list[tuple[int, struct.Struct | None, int]] = []
    for _, kind, counted in properties:
        size = np.dtype(kind).itemsize
        if counted is not None:
            steps.append((0, struct.Struct(order + codes[counted]), size))
        elif steps and steps[-1][1] is None:
            steps[-1] = (steps[-1][0] + size, None, 0)
        else:
            steps.append((size, None, 0))
    return steps
