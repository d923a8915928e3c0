"""Write buildings as CityJSON 2.0 and as OBJ."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from algorithms.arrays import Vector3
from algorithms.roofs.building import BuildingModel
from service.formats.mesh_writers import OBJ_DIGITS

STEP_M = 0.001
"""CityJSON's coordinates are whole numbers of millimetres."""
DETAIL = "2.2"
"""Roof faces and their walls, without overhangs (Biljecki, Ledoux and Stoter 2016)."""


@dataclass(frozen=True, eq=False)
class NamedBuilding:
    """A building with its name and attributes."""

    name: str
    model: BuildingModel
    attributes: Mapping[str, Any]


@dataclass(frozen=True)
class CityWriter:
    """One format."""

    ending: str
    media_type: str
    write: Callable[[Path, Sequence[NamedBuilding], Vector3, str | None], None]
    """Writes buildings whose vertices are in the world less an origin [m], and its reference system, WKT 1."""


def write_city_json(
    path: Path, buildings: Sequence[NamedBuilding], origin_m: Vector3, crs_wkt: str | None = None
) -> None:
    """Write CityJSON 2.0 (OGC 20-072r5): a solid with semantic surfaces each building."""
    vertices: list[list[int]] = []
    objects = {}
    for building in buildings:
        model = building.model
        first = len(vertices)
        vertices += np.rint(model.vertices / STEP_M).astype(np.int64).tolist()
        kinds = [surface.kind for surface in model.surfaces]
        shell = [[(ring + first).tolist() for ring in surface.rings] for surface in model.surfaces]
        objects[building.name] = {
            "type": "Building",
            "attributes": dict(building.attributes),
            "geometry": [
                {
                    "type": "Solid",
                    "lod": DETAIL,
                    "boundaries": [shell],
                    "semantics": {
                        "surfaces": [{"type": kind} for kind in kinds],
                        "values": [list(range(len(kinds)))],
                    },
                }
            ],
        }
    document = {
        "type": "CityJSON",
        "version": "2.0",
        "transform": {"scale": [STEP_M] * 3, "translate": origin_m.tolist()},
        "CityObjects": objects,
        "vertices": vertices,
    }
    system = None if crs_wkt is None else _system_url(crs_wkt)
    if system is not None:
        document["metadata"] = {"referenceSystem": system}
    path.write_text(json.dumps(document, ensure_ascii=False), encoding="utf-8")


def _system_url(crs_wkt: str) -> str | None:
    """Return the address of a reference system as CityJSON wants it; None where it has no EPSG code."""
    from pyproj import CRS

    code = CRS.from_wkt(crs_wkt).to_epsg()
    return None if code is None else f"https://www.opengis.net/def/crs/EPSG/0/{code}"


def write_city_obj(
    path: Path, buildings: Sequence[NamedBuilding], origin_m: Vector3, crs_wkt: str | None = None
) -> None:
    """Write OBJ in full coordinates, one object of triangles each building."""
    first = 1
    with path.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write("# metres, world, z up\n")
        if crs_wkt is not None:
            stream.write(f"# crs {' '.join(crs_wkt.split())}\n")
        for building in buildings:
            stream.write(f"o {building.name.replace(' ', '_')}\n")
            np.savetxt(stream, building.model.mesh.vertices + origin_m, fmt="v" + 3 * f" %.{OBJ_DIGITS}f")
            np.savetxt(stream, building.model.mesh.triangles + first, fmt="f %d %d %d")
            first += len(building.model.mesh.vertices)


CITY_WRITERS: Mapping[str, CityWriter] = {
    "city.json": CityWriter(".city.json", "application/city+json", write_city_json),
    "obj": CityWriter(".obj", "model/obj", write_city_obj),
}
