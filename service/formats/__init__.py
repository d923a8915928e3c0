"""Files that hold scans or photos: which reader serves a file, what is in it, and one scan or photo of it."""

from dataclasses import dataclass, replace
from pathlib import Path, PurePath

import numpy as np

from algorithms.scans.scan import Scan
from service.errors import UnreadableFileError
from service.formats.base import LargeScan, ReadLimits, RefusedScan, ScanFile, ScanInfo, ScanReader, ScanRecords
from service.formats.e57 import E57Reader
from service.formats.e57_photos import E57PhotoReader
from service.formats.finishing import finish, refused_info, scan_info, with_reading
from service.formats.images import ImageReader
from service.formats.las import LasReader
from service.formats.meshes import mesh_format, read_mesh
from service.formats.pcd import PcdReader
from service.formats.photo import Photo, PhotoInfo, PhotoReader
from service.formats.ply import PlyReader
from service.formats.point_selection import USUAL_POINTS, PointSelection
from service.formats.ptx import PtxReader
from service.formats.text import TextReader
from service.formats.text_layout import HEAD_BYTES

SCAN_READERS: tuple[ScanReader, ...] = (
    E57Reader(), PlyReader(), PcdReader(), LasReader(), PtxReader(), TextReader(),
)  # fmt: skip
PHOTO_READERS: tuple[PhotoReader, ...] = (ImageReader(), E57PhotoReader())

KNOWN_STRANGERS = {
    b"\xff\xd8\xff": "a JPEG image",
    b"\x89PNG": "a PNG image",
    b"PK\x03\x04": "a ZIP archive",
    b"\x1f\x8b": "a gzip archive",
    b"%PDF": "a PDF document",
    b"II*\0": "a TIFF image",
    b"MM\0*": "a TIFF image",
    b"<!DOCTYPE": "a web page",
    b"<html": "a web page",
}
NO_LIMITS = ReadLimits()

__all__ = [
    "PHOTO_READERS",
    "SCAN_READERS",
    "FileContents",
    "Photo",
    "PhotoInfo",
    "PhotoReader",
    "ReadLimits",
    "ScanInfo",
    "ScanReader",
    "inspect_file",
    "inspect_upload",
    "read_photo",
    "read_scan",
    "reader_for",
    "reader_of",
]


@dataclass(frozen=True)
class FileContents:
    """What an uploaded file holds."""

    format: str
    kind: str
    """scan, photo or mesh; a file with both of the first, or vertices that can be used as a scan, is a scan."""
    scans: tuple[ScanInfo, ...]
    photos: tuple[PhotoInfo, ...]


def inspect_upload(path: Path, filename: str, limits: ReadLimits = NO_LIMITS, columns: str = "") -> FileContents:
    """Describe every scan, photo or mesh of a file, having read every point and decoded every pixel.

    Parameters
    ----------
    path, filename
        The stored file, and what its owner calls it.
    limits
        How much it may ask for.
    columns
        What its owner says the columns of a text table are; other formats say that themselves.

    Raises
    ------
    UnreadableFileError
        The file holds neither a usable scan nor a usable photo nor a mesh.
    FileTooLargeError
        A scan has more points, or an image file more pixels, than `limits` allow.
    """
    file = ScanFile(path, filename, columns)
    head = _head(path)
    reader = _photo_reader(file, head)
    photos = () if reader is None else tuple(photo.info for photo in reader.photos(file, limits))
    usable = any(photo.refused is None for photo in photos)
    if reader is not None and photos and not reader.holds_scans(file):
        if not usable:
            why = "; ".join(dict.fromkeys(photo.refused or "" for photo in photos))
            raise file.unreadable(f"the file holds no scan, and no image that can be used: {why}", "photo 0")
        return FileContents(reader.format_of(head) or "", "photo", (), photos)
    mesh = mesh_format(path, filename)
    try:
        if mesh is None or mesh == "ply":
            return FileContents(reader_of(file).name, "scan", inspect_file(path, filename, limits, columns), photos)
    except UnreadableFileError as unread:
        if mesh is None:
            raise
        try:
            read_mesh(path, filename)
        except UnreadableFileError:
            raise unread from None  # neither a scan nor a mesh: what the reader of scans saw says where
    else:
        read_mesh(path, filename)
    return FileContents(mesh.upper(), "mesh", (), ())


def read_photo(path: Path, filename: str, index: int = 0, limits: ReadLimits = NO_LIMITS) -> Photo:
    """Read one photo of a file.

    Raises
    ------
    UnreadableFileError
        The file cannot be used, or holds no usable photo under that index.
    FileTooLargeError
        The photo has more pixels than `limits` allow.
    """
    file = ScanFile(path, filename)
    reader = _photo_reader(file, _head(path))
    for photo in () if reader is None else reader.photos(file, limits, index):
        if photo.info.refused is not None:
            raise file.unreadable(photo.info.refused, f"photo {index}")
        return photo
    raise file.unreadable("the file holds no photo under this index", f"photo {index}")


def reader_for(path: Path, filename: str) -> ScanReader:
    """Choose the reader of a file by its content, and see that its name does not contradict.

    Raises
    ------
    UnreadableFileError
        The file is empty, of an unsupported format, or its content is not what its name says.
    """
    file = ScanFile(path, filename)
    head = _head(path)
    if not head:
        raise file.unreadable("the file is empty", "byte 0")
    extension = PurePath(filename).suffix.lower()
    by_name = next((reader for reader in SCAN_READERS if extension in reader.extensions), None)
    by_content = next((reader for reader in SCAN_READERS if reader.sniff(head)), None)
    if by_content is not None and (by_name is by_content or not extension or (by_name is None and by_content.signed)):
        return by_content
    seen = f"it looks like {_kind(head, by_content)}"
    if by_name is not None:
        why = by_name.complaint(head) if by_content is None else ""
        detail = f"the name says {by_name.name}, but the content is not {by_name.name}; {seen}"
        raise file.unreadable(f"{detail}: {why}" if why else detail, "byte 0")
    readers: tuple[ScanReader | PhotoReader, ...] = (*SCAN_READERS, ImageReader())
    supported = ", ".join(ending for reader in readers for ending in reader.extensions)
    what = f"files named *{extension[:20]} are not supported" if extension else "the format is not supported"
    raise file.unreadable(f"{what}; supported are {supported}", "byte 0")


def inspect_file(path: Path, filename: str, limits: ReadLimits = NO_LIMITS, columns: str = "") -> tuple[ScanInfo, ...]:
    """Describe every scan of a file, having read every point: one that is called usable can be registered.

    Raises
    ------
    UnreadableFileError
        The file, or every scan of it, cannot be used.
    FileTooLargeError
        A scan has more points than `limits` allow.
    """
    file = ScanFile(path, filename, columns)
    found: list[ScanInfo] = []
    faults: list[UnreadableFileError] = []
    with np.errstate(all="ignore"):  # absurd numbers are found by looking at them, not by a warning
        reader = reader_of(file)
        for records in reader.scans(file, limits):
            told = _told(file, reader, limits, records)
            if isinstance(told, RefusedScan):
                faults.append(told.error)
                told = refused_info(told)
            found.append(told)
    if not found:
        raise file.unreadable("the file holds no points", "scan 0")
    if len(faults) == len(found):
        raise faults[0]
    return tuple(found)


def read_scan(
    path: Path,
    filename: str,
    index: int = 0,
    limits: ReadLimits = NO_LIMITS,
    *,
    columns: str = "",
    unit: str = "",
    selection: PointSelection = USUAL_POINTS,
    attributes: bool = False,
) -> Scan:
    """Read one scan of a file: metres, float64 relative to a stored origin, scan frame.

    Parameters
    ----------
    path, filename
        The stored file, and what its owner calls it.
    index
        Number of the scan in the file.
    limits
        How much it may ask for.
    columns
        What the columns of a text table are; empty: as found.
    unit
        In which unit the coordinates are; empty: as the file says, else metres.
    selection
        Points that are used, of formats that tell flags, classes and returns.
    attributes
        Whether further numbers of the points and the coordinate reference system are read.

    Raises
    ------
    UnreadableFileError
        The file cannot be used, or holds no usable scan under that index.
    FileTooLargeError
        The scan has more points than `limits` allow.
    """
    file = ScanFile(path, filename, columns, unit, selection, attributes)
    with np.errstate(all="ignore"):
        for records in reader_of(file).scans(file, replace(limits, at_once=limits.max_points), index):
            if isinstance(records, RefusedScan):
                raise records.error
            if isinstance(records, ScanRecords):
                return finish(file, records)
    raise file.unreadable("the file holds no points under this index", f"scan {index}")


def reader_of(file: ScanFile) -> ScanReader:
    """Choose the reader of a file, whose owner may have said that it is a text table.

    Raises
    ------
    UnreadableFileError
        The file is empty, of an unsupported format, or not what its owner says.
    """
    if file.columns and PurePath(file.filename).suffix.lower() in TextReader().extensions:
        return TextReader()  # lines of names that nobody knows may come first
    reader = reader_for(file.path, file.filename)
    if file.columns and not isinstance(reader, TextReader):
        raise file.unreadable(
            f"`columns` says what a text table holds, but this is {reader.name}, which says it itself"
        )
    return reader


def _told(
    file: ScanFile, reader: ScanReader, limits: ReadLimits, records: ScanRecords | RefusedScan | LargeScan
) -> ScanInfo | RefusedScan:
    if isinstance(records, RefusedScan):
        return records
    if isinstance(records, LargeScan):
        from service.formats.surveyed import surveyed_info

        try:
            return surveyed_info(file, reader, limits, records)
        except UnreadableFileError as error:
            return RefusedScan(records.index, "", error)
    count = len(records.points)
    try:
        scan = finish(file, records)
    except UnreadableFileError as error:
        return RefusedScan(records.index, records.name, error)
    return with_reading(scan_info(records.index, scan, count - len(scan)), records)


def _photo_reader(file: ScanFile, head: bytes) -> PhotoReader | None:
    """Choose the reader of a file's photos by its content; None: it holds none.

    Raises
    ------
    UnreadableFileError
        The file is called like an image and is none.
    """
    extension = PurePath(file.filename).suffix.lower()
    reader = next((each for each in PHOTO_READERS if each.format_of(head)), None)
    if extension in ImageReader().extensions and head and not isinstance(reader, ImageReader):
        by_content = next((each for each in SCAN_READERS if each.sniff(head)), None)
        seen = f"it looks like {_kind(head, by_content)}"
        raise file.unreadable(f"the name says an image, but the content is no JPEG, PNG or TIFF; {seen}", "byte 0")
    if isinstance(reader, ImageReader) and any(extension in each.extensions for each in SCAN_READERS):
        return None
    return reader


def _head(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(HEAD_BYTES)


def _kind(head: bytes, by_content: ScanReader | None) -> str:
    if by_content is not None:
        return by_content.name
    return next((kind for magic, kind in KNOWN_STRANGERS.items() if head.startswith(magic)), "no format known here")
