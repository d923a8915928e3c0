"""Meshes are read as they are, and files that hold none are refused with the reason."""

from pathlib import Path

import numpy as np
import pytest

from algorithms.deviations.rasters import Grid
from service.errors import UnreadableFileError
from service.formats import inspect_upload
from service.formats.meshes import read_mesh
from service.formats.writers.esri_grid import esri_ascii

FAR = np.array([500_000.1234, 5_800_000.5678, 300.0])
CORNERS = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 2.0]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
"""A tetrahedron that looks outwards."""


def obj_text(shift: np.ndarray) -> str:
    corners = [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in (CORNERS + shift).tolist()]
    faces = [f"f {a}/1/1 {b}/1/1 {c}/1/1" for a, b, c in (FACES + 1).tolist()]
    return "\n".join(["mtllib ../outside.mtl", "o part", *corners, "vt 0 0", "vn 0 0 1", *faces, ""])


def stl_text() -> str:
    triangles = [
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in CORNERS[face].tolist())
        + "endloop\nendfacet\n"
        for face in FACES
    ]
    return f"solid part\n{''.join(triangles)}endsolid part\n"


def stl_bytes() -> bytes:
    records = np.zeros(len(FACES), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    records["corners"] = CORNERS[FACES]
    return bytes(80) + len(FACES).to_bytes(4, "little") + records.tobytes()


def ply_text() -> str:
    header = (
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n"
        "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    )
    corners = "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS.tolist())
    return header + corners + "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES.tolist())


def volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("part.obj", obj_text(np.zeros(3)).encode()),
        ("part.stl", stl_text().encode()),
        ("binary.stl", stl_bytes()),
        ("part.ply", ply_text().encode()),
    ],
)
def test_each_format_gives_the_same_body(tmp_path: Path, name: str, content: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    mesh, dropped = read_mesh(path, name)
    assert (len(mesh.vertices), len(mesh.triangles), dropped) == (4, 4, 0)
    assert volume(mesh.vertices, mesh.triangles) == pytest.approx(4.0)
    found = inspect_upload(path, name)
    assert found.kind == ("scan" if name.endswith(".ply") else "mesh")  # the vertices of PLY are points as well


def test_coordinates_of_500_km_keep_a_tenth_of_a_millimetre(tmp_path: Path) -> None:
    path = tmp_path / "far.obj"
    path.write_text(obj_text(FAR))
    mesh, _ = read_mesh(path, "far.obj")
    expected = (CORNERS + FAR)[np.lexsort((CORNERS + FAR).T[::-1])]
    assert np.abs(mesh.vertices - expected).max() < 1e-4


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("empty.obj", b"", "no triangle"),
        ("points.obj", b"v 0 0 0\nv 1 0 0\n", "no triangle"),
        ("short.obj", b"v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "that can be read"),
        ("missing.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 9\n", ""),
        ("nonsense.stl", b"nothing of the kind", "no triangle"),
        ("cut.stl", stl_bytes()[:120], ""),
        ("not-finite.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "finite"),
        ("cut.ply", ply_text().encode()[:-30], ""),
    ],
)
def test_what_is_no_mesh_is_refused_with_its_name(tmp_path: Path, name: str, content: bytes, why: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(UnreadableFileError, match=f"{name}.*{why}"):
        read_mesh(path, name)


def test_files_of_other_kinds_are_no_meshes(tmp_path: Path) -> None:
    path = tmp_path / "scan.e57"
    path.write_bytes(b"x")
    with pytest.raises(UnreadableFileError, match="meshes are read from"):
        read_mesh(path, "scan.e57")


def test_a_grid_is_written_from_north_to_south_with_its_corner() -> None:
    values = np.array([[1.0, 2.0], [np.nan, 4.5]])
    lines = esri_ascii(values, Grid(10.0, 20.0, 0.5, 2, 2), (1000.0, 0.0)).decode().splitlines()
    assert lines[:6] == [
        "ncols 2", "nrows 2", "xllcorner 1010.000000", "yllcorner 20.000000", "cellsize 0.5", "NODATA_value -9999",
    ]  # fmt: skip
    assert lines[6:] == ["-9999 4.5", "1 2"]
