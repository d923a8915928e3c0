"""Meshes are read as they are, and files that hold none are refused with the reason."""

import time
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.deviations.polygons import triangulated
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
        ("cut-text.stl", stl_text().encode()[:250], "the text"),
        ("open.stl", stl_text().replace("endsolid", "").encode(), "without endsolid"),
        ("four.stl", stl_text().replace("endloop", "vertex 1 1 1\nendloop", 1).encode(), "three corners"),
        ("word.stl", stl_text().replace("vertex 4.0", "vertex " + "x" * 400_000, 1).encode(), "float: b.x{100,200} "),
        ("not-finite.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "finite"),
        ("cut.ply", ply_text().encode()[:-30], ""),
        ("word.obj", b"v 0 0 0." + b"0" * 400_000 + b"\n" + b"v 1 0 0\n" * 100_000, "no triangle"),
        ("digits.obj", b"v 0 0 0\nf 1 1 " + b"0" * 400_000 + b"1\n" + b"f 1 1 1\n" * 100_000, "that can be read"),
        ("letters.obj", b"v 0 0 " + b"x" * 400_000 + b"\nf 1 1 1\n", "float: b.x{100,200} \\(at"),
        ("rim.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf" + b" 1 3 2" * 40_000 + b"\n", "120000 corners"),
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


OUTLINE = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 10.0, 0.0], [5.0, 2.0, 0.0], [0.0, 10.0, 0.0]])
"""A face with a notch, 60 m²."""


def area(vertices: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


def ply_polygons(faces: list[list[int]], kind: str = "ascii") -> bytes:
    header = (
        f"ply\nformat {kind} 1.0\nelement vertex 5\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()
    if kind == "ascii":
        corners = "".join(f"{x} {y} {z}\n" for x, y, z in OUTLINE.tolist())
        return header + (corners + "".join(" ".join(map(str, [len(f), *f])) + "\n" for f in faces)).encode()
    return (
        header
        + OUTLINE.astype("<f8").tobytes()
        + b"".join(bytes([len(f)]) + np.array(f, dtype="<i4").tobytes() for f in faces)
    )


@pytest.mark.parametrize("start", range(5))
@pytest.mark.parametrize("kind", ["obj", "backwards.obj", "ply"])
def test_a_face_with_a_notch_covers_what_it_encloses(tmp_path: Path, kind: str, start: int) -> None:
    ring = np.roll(np.arange(5), start).tolist()
    ring = ring[::-1] if kind == "backwards.obj" else ring
    path = tmp_path / f"notch.{kind}"
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in OUTLINE.tolist())
    text = corners + "f " + " ".join(str(k + 1) for k in ring) + "\n"
    path.write_bytes(ply_polygons([ring]) if kind == "ply" else text.encode())
    mesh, _ = read_mesh(path, path.name)
    assert area(mesh.vertices, mesh.triangles) == pytest.approx(60.0)
    sides = mesh.vertices[mesh.triangles[:, 1:]] - mesh.vertices[mesh.triangles[:, :1]]
    upwards = np.cross(sides[:, 0], sides[:, 1])[:, 2] > 0.0
    assert (upwards == (kind != "backwards.obj")).all()


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian"])
def test_quadrilaterals_with_a_corner_inwards_are_divided_inside(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "quads.ply"
    path.write_bytes(ply_polygons([[1, 2, 3, 0], [3, 4, 0, 1]], kind))
    mesh, _ = read_mesh(path, path.name)
    assert area(mesh.vertices, mesh.triangles) == pytest.approx(35.0 + 35.0)


def test_numbers_that_count_back_count_from_where_the_face_stands(tmp_path: Path) -> None:
    def block(x: float, z: float) -> str:
        corners = [(x, 0, z), (x + 5, 0, z), (x + 5, 10, z), (x, 10, z)]
        return "".join("v {} {} {}\n".format(*each) for each in corners) + "f -4 -3 \\\n-2\nf -4/1 -2/2 -1/3\n"

    path = tmp_path / "blocks.obj"
    path.write_text(block(0.0, 0.0) + "usemtl other\ng part\n" + block(5.0, 1.0))
    mesh, dropped = read_mesh(path, path.name)
    heights = mesh.vertices[mesh.triangles][:, :, 2]
    assert (len(mesh.triangles), dropped) == (4, 0)
    assert (heights.max(axis=1) == heights.min(axis=1)).all()
    assert area(mesh.vertices, mesh.triangles) == pytest.approx(100.0)


def test_a_hundred_thousand_materials_take_no_longer_than_one(tmp_path: Path) -> None:
    path = tmp_path / "many.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n" + "".join(f"usemtl m{k}\nf 1 2 3\n" for k in range(100_000)))
    mesh, _ = read_mesh(path, path.name)
    assert len(mesh.triangles) == 100_000


def test_a_ply_mesh_of_elements_without_end_is_refused_by_its_header(tmp_path: Path) -> None:
    path = tmp_path / "elements.ply"
    elements = "".join(f"element e{k} 0\nproperty int a\n" for k in range(10_000))
    path.write_text(ply_text().replace("end_header", elements + "end_header"))
    with pytest.raises(UnreadableFileError, match="header does not end"):
        inspect_upload(path, path.name)


def test_fifty_thousand_solids_of_stl_take_a_moment(tmp_path: Path) -> None:
    path = tmp_path / "parts.stl"
    facet = "facet normal 0 0 1 OUTER LOOP VERTEX 0 0 0 vertex 1 0 0\nvertex 0 1e0 0\nendloop endfacet"
    path.write_text("".join(f"solid loop {k}\r\n{facet}\r\nendsolid loop {k}\r\n" for k in range(50_000)))
    begun = time.process_time()
    mesh, _ = read_mesh(path, path.name)
    assert time.process_time() - begun < 5.0
    assert len(mesh.triangles) == 50_000


def test_a_hundred_thousand_faces_of_five_corners_take_a_moment(tmp_path: Path) -> None:
    path = tmp_path / "cells.obj"
    path.write_text("v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 2 0\nv -1 1 0\n" + "f 1 2 3 4 5\n" * 100_000)
    begun = time.process_time()
    mesh, _ = read_mesh(path, path.name)
    assert time.process_time() - begun < 5.0
    assert len(mesh.triangles) == 300_000


@pytest.mark.parametrize("seed", range(40))
def test_faces_of_many_corners_are_covered_whichever_corner_they_begin_with(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, 9))
    rim = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(9)]) * rng.uniform(0.3, 1.0, (9, 1))
    following = np.roll(rim, -1, axis=0)
    enclosed = abs(np.cross(rim, following)[:, 2].sum()) / 2.0
    order = np.roll(np.arange(9), seed)[:: 1 - 2 * (seed % 2)]
    triangles = triangulated(Rotation.random(random_state=seed).apply(rim), order, np.array([9]))
    around = np.diff(angles, append=angles[0] + 2.0 * np.pi).max() < np.pi
    assert not around or area(rim, triangles) == pytest.approx(enclosed)
