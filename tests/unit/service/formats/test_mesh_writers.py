"""Meshes come back as they were written, 500 km from the origin too."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from algorithms.deviations.triangles import Mesh
from service.formats.mesh_writers import MESH_WRITERS, Y_UP
from service.formats.meshes import read_mesh

ORIGIN_M = np.array([500_000.0, 5_600_000.0, 100.0])
TETRAHEDRON = Mesh(
    np.array([[0.0, 0.0, 0.0], [0.1234567, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
)
COLORS = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [10, 20, 30]], dtype=np.uint8)


@pytest.mark.parametrize("colors", [None, COLORS])
@pytest.mark.parametrize(("name", "apart_m"), [("ply", 1e-9), ("obj", 6e-6)])
def test_vertices_keep_their_full_coordinates(tmp_path: Path, name: str, apart_m: float, colors: np.ndarray) -> None:
    path = tmp_path / f"mesh.{name}"
    MESH_WRITERS[name].write(path, TETRAHEDRON, ORIGIN_M, colors)
    mesh, dropped = read_mesh(path, path.name)
    assert dropped == 0
    corners = mesh.vertices[mesh.triangles] - ORIGIN_M
    wanted = TETRAHEDRON.vertices[TETRAHEDRON.triangles]
    assert np.abs(corners - wanted).max() < apart_m
    if colors is not None:
        loaded = trimesh.load_mesh(path, process=False, maintain_order=True)
        assert np.abs(loaded.visual.vertex_colors[:, :3].astype(int) - COLORS).max() <= 1


def test_gltf_has_y_upward_and_the_far_origin_in_its_node(tmp_path: Path) -> None:
    path = tmp_path / "mesh.glb"
    MESH_WRITERS["glb"].write(path, TETRAHEDRON, ORIGIN_M, COLORS)
    scene = trimesh.load(path, process=False)
    place, name = scene.graph["mesh"]
    assert np.abs(scene.geometry[name].vertices - TETRAHEDRON.vertices).max() < 1e-7
    assert np.abs(place[:3, :3] - Y_UP[:3, :3]).max() == 0.0
    assert place[:3, 3].tolist() == [500_000.0, 100.0, -5_600_000.0]
    assert (scene.geometry[name].visual.vertex_colors[:, :3] == COLORS).all()
