"""ASTM E57 (E2807), read field by field through libE57 so that unknown extension fields do no harm."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Points
from schemas.values.units import METRE
from service.errors import UnreadableFileError
from service.formats.base import RECORDS_AT_ONCE, LargeScan, ReadLimits, RefusedScan, ScanFile, ScanRecords
from service.formats.crs_units import unit_of_crs
from service.formats.e57_nodes import faults_named, instrument_of, number_of, opened, pose_of
from service.formats.finishing import check_count, check_packing, colors_8bit, times_of
from service.formats.units import DeclaredUnit, UnknownUnit, not_understood

CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
COLOR = ("colorRed", "colorGreen", "colorBlue")
CELL = ("rowIndex", "columnIndex")
TIME, TIME_INVALID = "timeStamp", "isTimeStampInvalid"
INVALID = {"cartesianInvalidState": CARTESIAN, "sphericalInvalidState": SPHERICAL}
# pye57 fills buffers of type 'l' (numpy's int64 on Linux) with a wrong stride; 'q' is as wide and works.
BUFFER_TYPES = {
    "intensity": "f",
    **dict.fromkeys(COLOR, "f"),
    **dict.fromkeys(CELL, "q"),
    **dict.fromkeys(INVALID, "h"),
    TIME: "d",
    TIME_INVALID: "h",
}


@final
@dataclass(frozen=True)
class E57Reader:
    """Read E57: several scans, grids, poses, Cartesian or spherical coordinates. Images: `E57PhotoReader`."""

    name: str = "E57"
    extensions: tuple[str, ...] = (".e57",)
    signed: bool = True

    def sniff(self, head: bytes) -> bool:
        """Tell whether the file carries the E57 signature."""
        return head.startswith(b"ASTM-E57")

    def complaint(self, head: bytes) -> str:  # noqa: ARG002 - a signature tells no more
        """Say no more than that the signature is missing."""
        return ""

    def scans(
        self, file: ScanFile, limits: ReadLimits, wanted: int | None = None
    ) -> Iterator[ScanRecords | RefusedScan | LargeScan]:
        """Yield the scans of a file in order, or only the one wanted."""
        with opened(file) as image_file:
            with faults_named(file, "the file's structure"):
                data = _scan_nodes(file, image_file, limits)
                said = _said_of_units(image_file)
            for index in range(len(data)) if wanted is None else [wanted] if 0 <= wanted < len(data) else []:
                found: ScanRecords | RefusedScan | LargeScan
                try:
                    with faults_named(file, f"scan {index}"):
                        found = _read_scan(file, image_file, data[index], index, limits)
                    if isinstance(found, ScanRecords):
                        found = replace(found, **said)
                except UnreadableFileError as fault:
                    found = RefusedScan(index, _name_of(data, index), fault)
                yield found

    def pieces(self, file: ScanFile, limits: ReadLimits, index: int) -> Iterator[ScanRecords]:
        """Yield one scan piece by piece."""
        with opened(file) as image_file:
            with faults_named(file, "the file's structure"):
                data = _scan_nodes(file, image_file, limits)
                said = _said_of_units(image_file)
            if not 0 <= index < len(data):
                return
            with faults_named(file, f"scan {index}"):
                plan = _plan(file, data[index], index, limits)
                for columns in _filled(image_file, plan):
                    yield replace(_records(data[index], index, plan, columns), times_s=None, **said)


def _scan_nodes(file: ScanFile, image_file: Any, limits: ReadLimits) -> Any:
    from pye57 import libe57

    root = image_file.root()
    data = root["data3D"] if root.isDefined("data3D") else None
    if isinstance(data, libe57.VectorNode) and len(data) > 0:
        if len(data) > limits.max_scans:
            raise file.unreadable(f"the file declares {len(data)} scans, at most {limits.max_scans} are read", "data3D")
        return data
    images = len(root["images2D"]) if root.isDefined("images2D") else 0
    raise file.unreadable(f"the E57 file holds no scan, only {images} image(s)" if images else "no scan", "data3D")


@dataclass(frozen=True, eq=False)
class _Plan:
    """What of a scan is read."""

    points_node: Any
    count: int
    fields: list[str]
    coordinates: tuple[str, str, str]
    largest_color: float | None


def _plan(file: ScanFile, node: Any, index: int, limits: ReadLimits) -> _Plan:
    """Look at what a scan declares before anything is allocated for it."""
    from pye57 import libe57

    place = f"scan {index}"
    points_node = node["points"]
    if not isinstance(points_node, libe57.CompressedVectorNode):
        raise file.unreadable("'points' is not a compressed vector", place)
    count = int(points_node.childCount())
    if count == 0:
        raise file.unreadable("the scan holds no points", place)
    prototype = libe57.StructureNode(points_node.prototype())
    present = {prototype.get(i).elementName() for i in range(prototype.childCount())}
    coordinates = CARTESIAN if present.issuperset(CARTESIAN) else SPHERICAL
    if not present.issuperset(coordinates):
        raise file.unreadable("the scan has neither Cartesian nor spherical coordinates", f"{place}, prototype")
    bits = sum(_bits(prototype[name]) for name in present)
    if bits == 0:
        raise file.unreadable("no field of the scan can vary: all points are equal", f"{place}, prototype")
    check_count(file, count, bits / 8, limits, place)
    check_packing(file, count, place)
    optional = {name for name in BUFFER_TYPES if INVALID.get(name, coordinates) == coordinates}
    fields = [*coordinates, *sorted(present & optional)]
    largest = _largest_color(node, prototype) if present.issuperset(COLOR) else None
    return _Plan(points_node, count, fields, coordinates, largest)


def _read_scan(file: ScanFile, image_file: Any, node: Any, index: int, limits: ReadLimits) -> ScanRecords | LargeScan:
    plan = _plan(file, node, index, limits)
    if plan.count > limits.at_once:
        return LargeScan(index, plan.count)
    columns = _Columns(plan.count, plan.fields, plan.largest_color)
    filled = _fill(image_file, plan.points_node, plan.fields, columns)
    if filled != plan.count:
        place = f"scan {index}, record {filled}"
        raise file.unreadable(f"the point data end after {filled} of {plan.count} records", place)
    return _records(node, index, plan, columns)


def _records(node: Any, index: int, plan: _Plan, columns: "_Columns") -> ScanRecords:
    pose = pose_of(node)
    structured = columns.row is not None and columns.column is not None
    return ScanRecords(
        index=index,
        points=columns.points if plan.coordinates == CARTESIAN else _cartesian(columns.points),
        name=_name(node),
        valid=columns.valid,
        row=columns.row,
        column=columns.column,
        intensity=columns.intensity,
        color=columns.color,
        times_s=None if columns.times is None else times_of(columns.times),
        # An identity pose says nothing: writers put it on any cloud. A grid, angles or a real pose speak of a set-up.
        sensor_in_scan_m=np.zeros(3) if structured or plan.coordinates == SPHERICAL or _moves(pose) else None,
        world_from_scan=pose,
        instrument=instrument_of(node),
    )


def _name(node: Any) -> str:
    return str(node["name"].value()) if node.isDefined("name") else ""


def _name_of(data: Any, index: int) -> str:
    """Give the name of a scan that may be damaged; empty where it cannot be read."""
    from pye57 import libe57

    try:
        return _name(data[index])
    except (libe57.E57Exception, RuntimeError, ValueError, TypeError):
        return ""


def _said_of_units(image_file: Any) -> dict[str, Any]:
    """Tell whether the coordinate reference system of the file contradicts the metres of the standard."""
    root = image_file.root()
    text = str(root["coordinateMetadata"].value()) if root.isDefined("coordinateMetadata") else ""
    unit = unit_of_crs(text, "the coordinate reference system of the file (coordinateMetadata)")
    if unit is None:
        return {}
    if isinstance(unit, DeclaredUnit) and unit.name == METRE.name:
        return {"unit": unit}
    if isinstance(unit, UnknownUnit) and not unit.is_angle:
        return {"warnings": (not_understood(unit),)}
    return {
        "open_unit": f"{unit.source} is in {unit.words}, but E57 has coordinates in metres by its standard: state "
        'with the scan in which `unit` they are, such as "m"; transform angles to a projected system'
    }


class _Columns:
    """The arrays of one scan, filled piece by piece from small buffers."""

    def __init__(self, count: int, fields: list[str], largest_color: float | None) -> None:
        self.points = np.empty((count, 3))
        self.intensity = np.empty(count, dtype=np.float32) if "intensity" in fields else None
        self.color = np.empty((count, 3), dtype=np.uint8) if largest_color is not None else None
        self.row = np.empty(count, dtype=np.int32) if "rowIndex" in fields else None
        self.column = np.empty(count, dtype=np.int32) if "columnIndex" in fields else None
        self.valid = np.empty(count, dtype=np.bool_) if any(name in fields for name in INVALID) else None
        self.times = np.empty(count) if TIME in fields else None
        self._largest_color = largest_color

    def take(self, piece: dict[str, Array], start: int, stop: int) -> None:
        """Copy what the buffers hold into records start … stop."""
        length = stop - start
        for axis, name in enumerate(CARTESIAN if "cartesianX" in piece else SPHERICAL):
            self.points[start:stop, axis] = piece[name][:length]
        if self.intensity is not None:
            self.intensity[start:stop] = piece["intensity"][:length]
        if self.color is not None and self._largest_color is not None:
            channels = np.stack([piece[name][:length] for name in COLOR], axis=1)
            self.color[start:stop] = colors_8bit(channels, self._largest_color)
        for name, target in zip(CELL, (self.row, self.column), strict=True):
            if target is not None:
                number = piece[name][:length]
                if np.abs(number).max() >= 1 << 30:
                    raise ValueError(f"{name} of {np.abs(number).max()} is absurd")
                target[start:stop] = number
        if self.valid is not None:
            state = next(piece[name] for name in INVALID if name in piece)
            self.valid[start:stop] = state[:length] == 0
        if self.times is not None:
            self.times[start:stop] = piece[TIME][:length]
            if TIME_INVALID in piece:
                self.times[start:stop][piece[TIME_INVALID][:length] != 0] = np.nan


def _fill(image_file: Any, points_node: Any, fields: list[str], columns: _Columns) -> int:
    total, filled = len(columns.points), 0
    for got, piece in _read(image_file, points_node, fields, total):
        columns.take(piece, filled, min(filled + got, total))
        filled += got
    return filled


def _filled(image_file: Any, plan: _Plan) -> Iterator[_Columns]:
    """Give the records of a scan piece by piece.

    Raises
    ------
    ValueError
        They end before the last.
    """
    filled = 0
    for got, piece in _read(image_file, plan.points_node, plan.fields, plan.count):
        columns = _Columns(got, plan.fields, plan.largest_color)
        columns.take(piece, 0, got)
        filled += got
        yield columns
    if filled != plan.count:
        raise ValueError(f"the point data end after {filled} of {plan.count} records")


def _read(image_file: Any, points_node: Any, fields: list[str], total: int) -> Iterator[tuple[int, dict[str, Array]]]:
    """Give the buffers of the fields each time they are filled, with the number of records in them."""
    from pye57 import libe57

    capacity = min(RECORDS_AT_ONCE, total)
    piece = {name: np.empty(capacity, dtype=BUFFER_TYPES.get(name, "d")) for name in fields}
    buffers = libe57.VectorSourceDestBuffer()
    for name, array in piece.items():
        buffers.append(libe57.SourceDestBuffer(image_file, name, array, capacity, True, True))
    reader = points_node.reader(buffers)
    filled = 0
    while filled < total and (got := int(reader.read())) > 0:
        yield got, piece
        filled += got
    reader.close()


def _bits(node: Any) -> int:
    """Bits a record spends on this field."""
    from pye57 import libe57

    if isinstance(node, libe57.FloatNode):
        return 32 if node.precision() == libe57.E57_SINGLE else 64
    if isinstance(node, libe57.IntegerNode | libe57.ScaledIntegerNode):
        return int(node.maximum() - node.minimum()).bit_length()
    return 0


def _largest_color(node: Any, prototype: Any) -> float:
    from pye57 import libe57

    field = prototype["colorRed"]
    if isinstance(field, libe57.IntegerNode) and 0 < field.maximum() <= 65535:
        return float(field.maximum())
    if node.isDefined("colorLimits") and node["colorLimits"].isDefined("colorRedMaximum"):
        largest = number_of(node["colorLimits"]["colorRedMaximum"])
        if math.isfinite(largest) and largest > 0:
            return largest
    return 255.0


def _cartesian(polar: Points) -> Points:
    """Turn (range, azimuth, elevation) into (x, y, z) as E57 defines them (ASTM E2807, 8.4.4)."""
    distance, azimuth, elevation = polar.T
    horizontal = distance * np.cos(elevation)
    return np.column_stack([horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), distance * np.sin(elevation)])


def _moves(pose: RigidTransform | None) -> bool:
    return pose is not None and not np.allclose(pose.as_matrix(), np.eye(4), atol=1e-9)
