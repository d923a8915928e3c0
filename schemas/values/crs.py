"""Coordinate reference systems in requests."""

import re
from typing import Annotated, Any, TypeAlias

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

LONGEST = 20_000
"""Characters of a definition."""
SURE = 70
"""Confidence, in percent, of PROJ that a system is the one of an EPSG code: unit, datum and projection are the same."""
UNIT_IN_NAME = re.compile(r"\s*\((ft|ftUS|US survey feet|feet|foot)\)", re.IGNORECASE)
GEOCENTRIC = "GEOCCS["
"""How WKT 1 of geocentric coordinates begins."""

HEIGHTS_NEEDED = (
    "transform it to a projected system with heights (such as UTM, with `pdal translate in.laz out.laz reprojection "
    "--filters.reprojection.out_srs=EPSG:25832+7837`) and send that, or give a pose `world_from_scan` to a frame with "
    "z upwards"
)


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


def metre_wkt_1(definition: str) -> str:
    """Return the WKT 1 of the system in which coordinates are after their conversion to metres.

    A system in feet becomes the one of the same datum and projection in metres: with its EPSG code, where there is one.

    Parameters
    ----------
    definition
        ``EPSG:2227``, a compound such as ``EPSG:2227+6360``, or WKT of either version.

    Raises
    ------
    UnusableCrsError
        Nobody knows it, its coordinates are angles, or WKT 1 cannot say it.
    """
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        crs = CRS.from_user_input(definition.strip())
        if crs.is_geocentric:
            return str(crs.to_wkt("WKT1_GDAL"))
        document = crs.to_json_dict()
        if not _to_metres(document):
            return wkt_1(definition)
        crs = CRS.from_json_dict(document)
        parts = crs.sub_crs_list or [crs]
        codes = [part.to_epsg(min_confidence=SURE) for part in parts]
        text = wkt_1("EPSG:" + "+".join(map(str, codes)) if None not in codes else crs.to_wkt())
    except CRSError:
        raise UnusableCrsError("no coordinate reference system that PROJ knows in metres") from None
    return text


def geocentric_wkt(code: int) -> str:
    """Return the WKT 1 of geocentric coordinates on the datum of a geographic or geocentric system.

    Parameters
    ----------
    code
        EPSG code of that system.

    Raises
    ------
    UnusableCrsError
        There is none of this code.
    """
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        document, cartesian = CRS.from_epsg(code).to_json_dict(), CRS.from_epsg(4978).to_json_dict()
        document |= {"type": "GeodeticCRS", "coordinate_system": cartesian["coordinate_system"]}
        document.pop("id", None)
        return str(CRS.from_json_dict(document).to_wkt("WKT1_GDAL"))
    except CRSError:
        raise UnusableCrsError(f"PROJ knows no geographic system EPSG:{code}") from None


def _to_metres(document: dict[str, Any]) -> bool:
    """Replace units of length of a system in PROJJSON by metres; tell whether there were others."""
    parts = [*document.get("components", []), *([document["source_crs"]] if "source_crs" in document else [])]
    changed = sum(map(_to_metres, parts)) > 0  # all of them, not only up to the first
    for axis in document.get("coordinate_system", {}).get("axis", []):
        unit = axis.get("unit", "metre")
        if isinstance(unit, dict) and unit["type"] == "LinearUnit" and unit["conversion_factor"] != 1.0:
            axis["unit"], changed = "metre", True
    if changed:
        document.pop("id", None)
        short = UNIT_IN_NAME.sub("", document.get("name", ""))
        document["name"] = short if short != document.get("name") else f"{short} in metres"
    return changed


def _usable(definition: str) -> str:
    try:
        wkt_1(definition)
    except UnusableCrsError as fault:
        raise PydanticCustomError("crs", "{why}", {"why": str(fault)}) from None
    return definition


StatedCrs: TypeAlias = Annotated[str, Field(min_length=1, max_length=LONGEST), AfterValidator(_usable)]
"""A projected system in metres: ``EPSG:25832``, with heights ``EPSG:25832+7837``, or its WKT."""
