"""Coordinate reference systems in requests."""

from typing import Annotated, TypeAlias

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

LONGEST = 20_000
"""Characters of a definition."""


class UnusableCrsError(ValueError):
    """Say why coordinates in metres cannot be in a system."""


def wkt_1(definition: str) -> str:
    """Give the WKT 1 of a system, which LAS, COPC and E57 keep.

    Parameters
    ----------
    definition
        ``EPSG:25832``, a compound such as ``EPSG:25832+7837``, or WKT of either version.

    Raises
    ------
    UnusableCrsError
        Nobody knows it, its coordinates are no metres, or WKT 1 cannot say it.
    """
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        crs = CRS.from_user_input(definition.strip())
        parts = crs.sub_crs_list or [crs]
        own = [part.source_crs or part if part.is_bound else part for part in parts]
        axes = [axis for part in own for axis in part.axis_info]
        text = crs.to_wkt("WKT1_GDAL")
    except CRSError:
        raise UnusableCrsError("no coordinate reference system that PROJ knows, such as EPSG:25832") from None
    if crs.is_geographic or crs.is_geocentric:
        raise UnusableCrsError(f"'{crs.name[:60]}' has no plane coordinates; name a projected system")
    strange = next((axis.unit_name for axis in axes if axis.unit_conversion_factor != 1.0), None)
    if strange is not None:
        raise UnusableCrsError(f"'{crs.name[:60]}' is in {strange}, but the coordinates are in metres")
    return str(text)


def _usable(definition: str) -> str:
    try:
        wkt_1(definition)
    except UnusableCrsError as fault:
        raise PydanticCustomError("crs", "{why}", {"why": str(fault)}) from None
    return definition


StatedCrs: TypeAlias = Annotated[str, Field(min_length=1, max_length=LONGEST), AfterValidator(_usable)]
"""A projected system in metres: ``EPSG:25832``, with heights ``EPSG:25832+7837``, or its WKT."""
