"""Buildings come back from CityJSON and OBJ with their volume, 500 km from the origin too."""

import json
from pathlib import Path

import numpy as np
import pytest

from algorithms.deviations.triangles import condition_of
from algorithms.meshing.reconstruction import enclosed_volume
from algorithms.roofs.building import BuildingSurface, triangulated
from service.formats.city_writers import CITY_WRITERS, NamedBuilding
from service.formats.meshes import read_mesh
from tests.unit.algorithms.roofs.test_buildings import RECTANGLE, hip, modelled

ORIGIN_M = np.array([500_000.0, 5_600_000.0, 100.0])


@pytest.fixture(scope="module")
def building() -> NamedBuilding:
    return NamedBuilding("House 1", modelled(RECTANGLE, hip), {"measuredHeight": 8.8})


def test_city_json_is_a_solid_whose_surfaces_say_what_they_are(tmp_path: Path, building: NamedBuilding) -> None:
    path = tmp_path / "buildings.city.json"
    CITY_WRITERS["city.json"].write(path, [building, NamedBuilding("Other", building.model, {})], ORIGIN_M)
    document = json.loads(path.read_text())
    assert (document["type"], document["version"]) == ("CityJSON", "2.0")
    place = document["transform"]
    vertices = np.array(document["vertices"]) * place["scale"]
    assert place["translate"] == ORIGIN_M.tolist()
    for each in document["CityObjects"].values():
        (solid,) = each["geometry"]
        (shell,) = solid["boundaries"]
        assert len(shell) == len(solid["semantics"]["values"][0])
        kinds = [solid["semantics"]["surfaces"][k]["type"] for k in solid["semantics"]["values"][0]]
        assert [kinds.count(kind) for kind in ("GroundSurface", "RoofSurface")] == [1, 4]
        # hips meet the eaves a little beside the plan's corners, and part walls there
        assert 4 <= kinds.count("WallSurface") <= 8
        surfaces = [BuildingSurface("", [np.array(ring) for ring in face], None) for face in shell]
        mesh = triangulated(vertices, surfaces)
        assert condition_of(mesh).is_closed
        # rounding moves no corner, and so no place of a face, by more than half a unit along each axis
        corners = mesh.vertices[mesh.triangles]
        areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        most = areas.sum() * 0.5 * float(np.linalg.norm(place["scale"]))
        assert enclosed_volume(mesh) == pytest.approx(building.model.volume_m3, abs=most)


def test_obj_has_the_same_body(tmp_path: Path, building: NamedBuilding) -> None:
    path = tmp_path / "buildings.obj"
    CITY_WRITERS["obj"].write(path, [building], ORIGIN_M)
    mesh, _ = read_mesh(path, path.name)
    assert enclosed_volume(mesh) == pytest.approx(building.model.volume_m3, rel=1e-5)
    assert mesh.vertices.mean(axis=0) == pytest.approx(ORIGIN_M, abs=20.0)
