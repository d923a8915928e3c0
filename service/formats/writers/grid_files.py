"""Files of grids that name reference system and unit: ESRI ASCII with `.prj` and `.aux.xml`, or GeoTIFF."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal
from xml.sax.saxutils import escape

from algorithms.deviations.rasters import Grid, GridValues
from service.formats.writers.esri_grid import esri_ascii
from service.formats.writers.geotiff import GridSystem, geotiff

Files = dict[str, tuple[str, bytes]]
"""Media type and content by name."""


@dataclass(frozen=True)
class GridFrame:
    """Where the cells of grids lie, and how their files are written."""

    grid: Grid
    corner_m: tuple[float, float]
    """What was subtracted from the places of the grid [m]."""
    crs_wkt: str | None = None
    """Coordinate reference system in metres, WKT 1; None: not known."""
    wanted: Literal["asc", "geotiff"] = "asc"


def grid_files(stem: str, values: GridValues, frame: GridFrame, unit: str) -> Files:
    """Return a grid in the format that is wanted, with the files that belong beside it.

    Parameters
    ----------
    stem
        Name of the file without its ending.
    values
        One for each cell; NaN: no data.
    frame
        The cells.
    unit
        Of the values, such as ``m``.
    """
    system = None if frame.crs_wkt is None else grid_system(frame.crs_wkt)
    if frame.wanted == "geotiff":
        content = geotiff(values, frame.grid, frame.corner_m, system, unit)
        return {f"{stem}.tif": ("image/tiff; application=geotiff", content)}
    files = {f"{stem}.asc": ("text/plain", esri_ascii(values, frame.grid, frame.corner_m))}
    if system is not None:
        files[f"{stem}.prj"] = ("text/plain", system.esri_wkt.encode())
        files[f"{stem}.asc.aux.xml"] = ("application/xml", _auxiliary(system, unit).encode())
    return files


@lru_cache(maxsize=16)
def grid_system(crs_wkt: str) -> GridSystem:
    """Return what files of grids say of a coordinate reference system in WKT 1."""
    from pyproj import CRS

    crs = CRS.from_wkt(crs_wkt)
    parts = crs.sub_crs_list or [crs]
    level = next(part for part in parts if not part.is_vertical)
    upright = next((part for part in parts if part.is_vertical), None)
    level = level.source_crs if level.is_bound and level.source_crs is not None else level
    return GridSystem(
        name=crs.name,
        wkt=crs_wkt,
        esri_wkt=str(level.to_wkt("WKT1_ESRI")),
        code=level.to_epsg(),
        vertical_code=None if upright is None else upright.to_epsg(),
    )


def _auxiliary(system: GridSystem, unit: str) -> str:
    """Return the sidecar that GDAL and ArcGIS read beside a raster."""
    return (
        f'<PAMDataset>\n  <SRS dataAxisToSRSAxisMapping="1,2">{escape(system.wkt)}</SRS>\n'
        f'  <PAMRasterBand band="1">\n    <UnitType>{escape(unit)}</UnitType>\n  </PAMRasterBand>\n</PAMDataset>\n'
    )
