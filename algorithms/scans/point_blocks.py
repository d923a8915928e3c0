"""Passes over many points in blocks, on all processors, with sums that do not depend on how many processors there are.

Compiled kernels release the interpreter's lock, so plain threads suffice. The blocks follow from the number of points
alone, and what they give comes back in their order: adding it up gives the same bytes with one thread and with many.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numba

T = TypeVar("T")
U = TypeVar("U")

LEAST_BLOCK = 1 << 16
"""Fewer points are not worth a block of their own."""
MOST_BLOCKS = 16
"""Sums are kept once per block, so there are not too many."""


def blocks_of(count: int, *, least: int = LEAST_BLOCK, most: int = MOST_BLOCKS) -> list[tuple[int, int]]:
    """Cut 0..count into consecutive ranges (start, end) of at least `least` numbers: 1, 2, 4 ... `most` of them.

    Powers of two share out evenly among processors.
    """
    blocks = min(1 << (max(count // least, 1).bit_length() - 1), most)
    return [(count * i // blocks, count * (i + 1) // blocks) for i in range(blocks)]


def over_blocks(
    work: Callable[[int, int], T], count: int, *, least: int = LEAST_BLOCK, most: int = MOST_BLOCKS
) -> list[T]:
    """Call `work(start, end)` for every block of 0..count and give what it returns, in the order of the blocks.

    Parameters
    ----------
    work
        Calls a compiled kernel. Blocks are worked on at the same time, so it must write only to places of its own.
    count
        Number of points (or rows, or cells).
    least, most
        Least size of a block, and how many there may be (a power of two).
    """
    blocks = blocks_of(count, least=least, most=most)
    threads = min(len(blocks), int(numba.config.NUMBA_NUM_THREADS))  # type: ignore[attr-defined]
    if threads == 1:
        return [work(start, end) for start, end in blocks]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(lambda block: work(*block), blocks))


def side_by_side(first: Callable[[], T], second: Callable[[], U]) -> tuple[T, U]:
    """Make two calls at the same time where loops may use two processors, and give what they return.

    It gains where compiled loops and large arrays are most of the work: what the interpreter does itself takes turns.
    """
    if int(numba.config.NUMBA_NUM_THREADS) == 1:  # type: ignore[attr-defined]
        return first(), second()
    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(second)
        return first(), other.result()
