"""Files to which clouds are written: one writer per format."""

from collections.abc import Sequence
from pathlib import Path

from algorithms.progress import NoProgress
from algorithms.scans.scan import ScalarField, Scan
from service.errors import UnwritableError
from service.formats.writers.base import (
    CloudFacts,
    PointPiece,
    ScanWriter,
    StationCloud,
    StationImage,
    Written,
    cloud_of,
    surveyed,
)
from service.formats.writers.copc import CopcWriter
from service.formats.writers.e57 import E57Writer
from service.formats.writers.las import LazWriter
from service.formats.writers.pcd import PcdWriter
from service.formats.writers.ply import PlyWriter
from service.formats.writers.ptx import PtxWriter
from service.formats.writers.text import PtsWriter, XyzWriter

SCAN_WRITERS: tuple[ScanWriter, ...] = (
    E57Writer(), LazWriter(), CopcWriter(), PlyWriter(), PcdWriter(), PtxWriter(), PtsWriter(), XyzWriter(),
)  # fmt: skip

__all__ = [
    "SCAN_WRITERS",
    "CloudFacts",
    "PointPiece",
    "ScalarField",
    "ScanWriter",
    "StationCloud",
    "StationImage",
    "Written",
    "cloud_of",
    "surveyed",
    "write_scans",
    "writer_of",
]


def writer_of(name: str) -> ScanWriter:
    """Give the writer of a format.

    Raises
    ------
    UnwritableError
        There is none of that name.
    """
    for writer in SCAN_WRITERS:
        if writer.name == name:
            return writer
    raise UnwritableError(name, f"no format of that name is written; there are {_names()}")


def write_scans(path: Path, scans: Sequence[Scan]) -> Written:
    """Write scans that are in memory into one file, in the format that its name says.

    Raises
    ------
    UnwritableError
        No format has that ending, or the format cannot hold the scans.
    """
    endings = sorted(SCAN_WRITERS, key=lambda writer: -len(writer.ending))
    for writer in endings:
        if path.name.lower().endswith(writer.ending):
            return writer.write(path, [cloud_of(scan) for scan in scans], NoProgress())
    raise UnwritableError(path.name, f"no format has this ending; there are {_names()}")


def _names() -> str:
    return ", ".join(writer.name for writer in SCAN_WRITERS)
