"""Units of coordinate reference systems, through PROJ."""

from typing import Any, TypeAlias

from schemas.values.units import METRE, Unit
from service.formats.units import DeclaredUnit, UnknownUnit, unit_of

LONGEST_WKT = 100_000
Axis: TypeAlias = tuple[str, str, float]
"""Direction, name of the unit, and its length in metres, or its angle."""
ANGLES = ("degree", "radian", "grad", "gon", "arc-second", "arc-minute")


def unit_of_crs(definition: str | int, source: str) -> DeclaredUnit | UnknownUnit | None:
    """Give the unit of a coordinate reference system.

    Parameters
    ----------
    definition
        WKT of either version, or the EPSG code.
    source
        Where it stands, for messages.

    Returns
    -------
    `UnknownUnit` for angles and for what PROJ does not understand, None where nothing is defined.
    """
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    if isinstance(definition, str):
        definition = definition[:LONGEST_WKT].strip(" \0\r\n\t")
        if not definition:
            return None
    try:
        crs = CRS.from_epsg(definition) if isinstance(definition, int) else CRS.from_wkt(definition)
        axes = [(str(axis.direction), str(axis.unit_name), float(axis.unit_conversion_factor)) for axis in _axes(crs)]
        where = f"{source} '{crs.name[:60]}'"
    except CRSError:
        return UnknownUnit("a system that PROJ does not understand", source)
    return _unit_of_axes(axes, where)


def _unit_of_axes(axes: list[Axis], where: str) -> DeclaredUnit | UnknownUnit | None:
    level = [axis for axis in axes if axis[0] not in {"up", "down"}]
    upright = [axis for axis in axes if axis[0] in {"up", "down"}]
    if not level and not upright:
        return None
    angle = next((name for _, name, _ in level if name.lower().startswith(ANGLES)), None)
    if angle is not None:
        return UnknownUnit("degrees" if angle.lower().startswith("degree") else angle, where)
    units = [_unit(axis) for axis in level] or [METRE]
    if any(unit != units[0] for unit in units):
        return UnknownUnit("axes of different units", where)
    return DeclaredUnit(units[0], _unit(upright[0]) if upright else units[0], where)


def _axes(crs: Any) -> list[Any]:
    """Give the axes of the system in which the coordinates are; one that is bound to another one is itself."""
    if crs.is_bound and crs.source_crs is not None:
        return _axes(crs.source_crs)
    if crs.sub_crs_list:
        return [axis for part in crs.sub_crs_list for axis in _axes(part)]
    return list(crs.axis_info)


def _unit(axis: Axis) -> Unit:
    return unit_of(axis[2], axis[1])
