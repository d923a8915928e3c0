"""Meshes come back as they were written, 500 km from the origin too."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from algorithms.colouring.balance import no_balance
from algorithms.deviations.triangles import Mesh
from algorithms.meshing.texture import Texture
from service.formats.mesh_writers import MESH_WRITERS, TEXTURED_WRITERS, Y_UP
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


@pytest.fixture
def painted() -> tuple[Mesh, Texture]:
    """Give the tetrahedron with an image whose left half is red and whose right half is blue."""
    image = np.zeros((32, 64, 3), dtype=np.uint8)
    image[:, :32, 0], image[:, 32:, 2] = 200, 200
    left, right = np.array([[4.0, 4.0], [20.0, 4.0], [4.0, 24.0]]), np.array([[40.0, 4.0], [60.0, 4.0], [40.0, 24.0]])
    corners = np.stack([left, right, left, right])
    return TETRAHEDRON, Texture(image, corners, np.array([0, 1, 0, 1]), 1.0, 2, no_balance(2))


@pytest.mark.parametrize("name", ["obj", "glb"])
def test_textured_meshes_show_the_image_on_their_triangles(
    tmp_path: Path, name: str, painted: tuple[Mesh, Texture]
) -> None:
    names = TEXTURED_WRITERS[name](tmp_path, painted[0], ORIGIN_M, painted[1])
    assert sorted(names) == sorted(each.name for each in tmp_path.iterdir())
    scene = trimesh.load_scene(tmp_path / f"mesh.{name}", process=False)
    (mesh,) = scene.geometry.values()
    material = mesh.visual.material
    image = np.asarray(material.image if name == "obj" else material.baseColorTexture)
    assert image.shape[:2] == (32, 64)
    shares = mesh.visual.uv[mesh.faces].mean(axis=1)
    # trimesh has v upward in both
    texels = np.rint(shares * [64, -32] + [-0.5, 31.5]).astype(int)
    found = image[texels[:, 1], texels[:, 0]]
    place, _ = scene.graph[next(iter(scene.graph.nodes_geometry))]
    world = mesh.vertices[mesh.faces] @ place[:3, :3].T + place[:3, 3]
    if name == "glb":
        world = world @ Y_UP[:3, :3]
    order = [int(np.argmin(np.linalg.norm(
        (TETRAHEDRON.vertices[TETRAHEDRON.triangles] + ORIGIN_M).mean(axis=1) - each.mean(axis=0), axis=1)))
        for each in world]  # fmt: skip
    assert sorted(order) == [0, 1, 2, 3]
    wanted = np.array([[200, 0, 0], [0, 0, 200]])[np.array(order) % 2]
    assert np.abs(found[:, :3].astype(int) - wanted).max() < 10
