"""The unit that a LAS file declares: its coordinate reference system as WKT or as GeoTIFF keys."""

import struct
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from schemas.values.crs import UnusableCrsError, geocentric_wkt, metre_wkt_1
from schemas.values.units import Unit
from service.formats.base import ScanFile
from service.formats.crs_units import LONGEST_WKT, unit_of_crs
from service.formats.units import DeclaredUnit, UnknownUnit, unit_of

PROJECTION = b"LASF_Projection"
WKT, KEYS, DOUBLES = 2112, 34735, 34736
MOST_RECORDS = 1000
LONGEST_RECORD = 65535
EXTENDED_RECORD = struct.Struct("<2x16sHQ32x")
"""Reserved, user, number, length, description (LAS 1.4 R15, table 30)."""
MODEL, GEOGRAPHIC, PROJECTED, LINEAR_UNIT, LINEAR_SIZE = 1024, 2048, 3072, 3076, 3077
VERTICAL, VERTICAL_UNIT = 4096, 4099
IS_GEOGRAPHIC = 2
IS_GEOCENTRIC = 3
WGS_84 = 4326
USER_DEFINED = 32767
LINEAR_UNITS = {
    9001: (1.0, "metre"),
    9002: (0.3048, "foot"),
    9003: (1200.0 / 3937.0, "US survey foot"),
    9004: (0.3048006, "modified American foot"),
    9005: (0.3047972654, "Clarke's foot"),
    9006: (0.3047995, "Indian foot"),
    9036: (1000.0, "kilometre"),
    1025: (0.001, "millimetre"),
    1033: (0.01, "centimetre"),
}
"""Codes of units in GeoTIFF and EPSG -> metres and name."""
WKT_1_BEGINS = ("PROJCS[", "COMPD_CS[", "GEOCCS[")
NOT_KEPT = "the coordinate reference system of the file is not kept"
VLR_CRS, VLR_KEYS = "the coordinate reference system of its header", "the GeoTIFF keys of its header"


@dataclass(frozen=True)
class _Record:
    number: int
    content: bytes


def las_unit(file: ScanFile, records: Iterable[Any]) -> DeclaredUnit | UnknownUnit | None:
    """Find the unit of a LAS file; None where it declares none.

    Parameters
    ----------
    file
        The file, whose header was checked.
    records
        The variable-length records of its header, as laspy gives them.
    """
    found = _records(file, records)
    if WKT in found:
        unit = unit_of_crs(found[WKT].decode("utf-8", "replace"), VLR_CRS)
        if unit is not None:
            return unit
    return _unit_of_keys(_keys(found)) if KEYS in found else None


def las_crs(file: ScanFile, records: Iterable[Any]) -> tuple[str | None, str]:
    """Return the coordinate reference system of a LAS file in metres as WKT 1, or None and why it cannot be kept.

    Parameters
    ----------
    file
        The file, whose header was checked.
    records
        The variable-length records of its header, as laspy gives them.
    """
    try:
        return _crs_of(_records(file, records))
    except UnusableCrsError as fault:
        return None, f"{NOT_KEPT}: {fault}"


def _crs_of(found: Mapping[int, bytes]) -> tuple[str | None, str]:
    definition = found[WKT].decode("utf-8", "replace").strip("\0 \n") if WKT in found else ""
    if not definition and KEYS in found:
        keys = _keys(found)
        if keys.get(MODEL) == IS_GEOCENTRIC:
            return geocentric_wkt(int(keys.get(GEOGRAPHIC, WGS_84))), ""
        codes = [int(code) for key in (PROJECTED, VERTICAL) if 0 < (code := keys.get(key, 0)) < USER_DEFINED]
        if not codes or keys.get(PROJECTED) is None:
            return None, f"{NOT_KEPT}: its GeoTIFF keys name no EPSG code"
        definition = "EPSG:" + "+".join(map(str, codes))
    if not definition:
        return None, ""
    text = metre_wkt_1(definition)
    # a definition that nothing changes stays as its writer wrote it
    is_same = definition.startswith(WKT_1_BEGINS) and unit_of_crs(definition, "") == unit_of_crs(text, "")
    return definition if is_same else text, ""


def projection_behind_points(file: ScanFile) -> Iterator[tuple[str, int, str, bytes]]:
    """Yield user, number, description and content of the records of the reference system that stand after the points.

    Records too long for the header, whose lengths have 16 bits, are left out.
    """
    for record in _extended(file):
        if len(record.content) <= LONGEST_RECORD:
            yield PROJECTION.decode(), record.number, "", record.content


def _records(file: ScanFile, records: Iterable[Any]) -> dict[int, bytes]:
    of_header = [_Record(int(each.record_id), _content(each)) for each in records if _is_projection(each)]
    return {record.number: record.content for record in (*_extended(file), *of_header)}


def _is_projection(record: Any) -> bool:
    return bool(str(record.user_id).strip("\0 ") == PROJECTION.decode())


def _content(record: Any) -> bytes:
    content = getattr(record, "record_data", None)
    return bytes(content) if content is not None else bytes(record.record_data_bytes())


def _extended(file: ScanFile) -> Iterator[_Record]:
    """Read the records behind the points; laspy trusts their lengths, which may be damaged."""
    with file.path.open("rb") as stream:
        head = stream.read(247)
        if len(head) < 247 or head[25] < 4:
            return
        place, count = struct.unpack_from("<QI", head, 235)
        for _ in range(min(count, MOST_RECORDS)):
            if place < 375 or place + EXTENDED_RECORD.size > file.size:
                return
            stream.seek(place)
            user, number, length = EXTENDED_RECORD.unpack(stream.read(EXTENDED_RECORD.size))
            place += EXTENDED_RECORD.size + length
            if place > file.size:
                return
            if user.rstrip(b"\0 ") == PROJECTION and length <= LONGEST_WKT:
                yield _Record(number, stream.read(length))


def _keys(found: Mapping[int, bytes]) -> dict[int, float]:
    """Give the GeoTIFF keys with numbers (OGC 19-008, 7.1)."""
    content, doubles = found[KEYS], found.get(DOUBLES, b"")
    keys: dict[int, float] = {}
    for at in range(8, len(content) - 7, 8):
        key, place, count, value = struct.unpack_from("<HHHH", content, at)
        if place == 0:
            keys[key] = value
        elif place == DOUBLES and count == 1 and 8 * value + 8 <= len(doubles):
            keys[key] = struct.unpack_from("<d", doubles, 8 * value)[0]
    return keys


def _unit_of_keys(keys: Mapping[int, float]) -> DeclaredUnit | UnknownUnit | None:
    if keys.get(MODEL) == IS_GEOGRAPHIC or (MODEL not in keys and GEOGRAPHIC in keys and PROJECTED not in keys):
        return UnknownUnit("degrees", VLR_KEYS)
    level = _linear(keys, LINEAR_UNIT, keys.get(LINEAR_SIZE))
    system = _system(keys.get(PROJECTED)) if level is None else None
    if isinstance(system, UnknownUnit):
        return system
    if system is not None:
        level = system.horizontal
    upright = _linear(keys, VERTICAL_UNIT, None)
    if upright is None and isinstance(vertical := _system(keys.get(VERTICAL)), DeclaredUnit):
        upright = vertical.vertical
    level = upright if level is None else level
    if level is None:
        return None
    source = system.source if system is not None else VLR_KEYS
    return DeclaredUnit(level, level if upright is None else upright, source)


def _linear(keys: Mapping[int, float], key: int, size: float | None) -> Unit | None:
    code = keys.get(key)
    if code in LINEAR_UNITS:
        return unit_of(*LINEAR_UNITS[int(code)])
    if size is not None and 0.0 < size < 1e6:
        return unit_of(size, "a unit of its own")
    return None


def _system(code: float | None) -> DeclaredUnit | UnknownUnit | None:
    """Look a system up by its EPSG code."""
    if code is None or not 0 < code < USER_DEFINED:
        return None
    return unit_of_crs(int(code), VLR_KEYS)
