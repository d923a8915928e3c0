"""Lines of numbers, as ascii formats share them."""

import re
import warnings
from collections.abc import Iterable
from typing import Any

import numpy as np

from algorithms.arrays import Array
from service.formats.base import ScanFile

LONGEST_LINE_BYTES = 1 << 20


def refuse_long_lines(file: ScanFile) -> None:
    """Refuse lines that no table has: a line is held in memory as a whole, and its numbers as objects.

    Raises
    ------
    UnreadableFileError
        A line has more than a megabyte.
    """
    before = 0
    with file.path.open("rb") as stream:
        while len(block := stream.read(LONGEST_LINE_BYTES)) == LONGEST_LINE_BYTES:
            if b"\n" not in block:
                raise file.unreadable(f"a line of more than {LONGEST_LINE_BYTES} bytes", f"byte {before}")
            before += len(block)


def read_table(
    file: ScanFile,
    lines: Iterable[bytes] | Iterable[str],
    first_line: int,
    *,
    dtype: Any = np.float64,
    delimiter: str | None = None,
    columns: list[int] | None = None,
    comment: str | None = None,
) -> Array:
    """Read lines of numbers strictly: a word that is no number, or a line of another length, is an error.

    Parameters
    ----------
    lines
        An open file, or an iterator over some of its lines.
    first_line
        Line number of the first of them in the file, from 1; for messages.
    dtype
        float64 gives (n, columns); a structured type gives (n,) records.
    columns
        Columns to take, when not all.

    Raises
    ------
    UnreadableFileError
        With the line where reading stopped, as far as it is known.
    """
    structured = np.dtype(dtype).names is not None
    try:
        with warnings.catch_warnings():
            # numpy warns of a table without lines; every caller counts the lines it got
            warnings.simplefilter("ignore", UserWarning)
            return np.loadtxt(
                lines,
                dtype=dtype,
                comments=comment,
                delimiter=delimiter,
                usecols=columns,
                encoding="latin-1",
                ndmin=1 if structured else 2,
            )
    except (ValueError, OverflowError) as fault:
        reason = str(fault).split(";")[0].rstrip(".")
        row = re.search(r" at row (\d+)", reason)
        # numpy counts rows from 0 when a word is wrong, from 1 when the number of columns is
        before = first_line - 1 if "columns changed" in reason else first_line
        place = f"line {before + int(row[1])}" if row else f"after line {first_line - 1}"
        raise file.unreadable(
            f"not a table of numbers: {reason.replace(row[0], '') if row else reason}", place
        ) from fault
