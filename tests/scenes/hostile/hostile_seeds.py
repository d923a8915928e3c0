"""Whole, small files of every format that is read: what hostile files are made from."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from algorithms.deviations.rasters import Grid
from algorithms.deviations.triangles import Mesh
from algorithms.scans.scan import Scan, ScanGrid
from service.formats.mesh_writers import write_ply
from service.formats.writers import write_scans
from service.formats.writers.geotiff import geotiff
from tests.unit.service.formats.test_formats_e57_photos import Picture, written

ROWS, COLUMNS = 14, 20
COUNT = ROWS * COLUMNS
WIDTH, HEIGHT = 48, 36


def some_scan() -> Scan:
    rng = np.random.default_rng(20)
    return Scan(
        points=rng.uniform(-20.0, 20.0, (COUNT, 3)),
        origin_m=np.zeros(3),
        grid=ScanGrid(index=np.arange(COUNT, dtype=np.int32).reshape(ROWS, COLUMNS)),
        intensity=rng.random(COUNT).astype(np.float32),
        color=rng.integers(0, 256, (COUNT, 3)).astype(np.uint8),
    )


def write_e57_with_photos(path: Path) -> None:
    written(path, [Picture(scan=0), Picture(kind="visualReferenceRepresentation")])


def write_las(path: Path, point_format: int) -> None:
    data = laspy.LasData(laspy.LasHeader(point_format=point_format, version="1.4"))
    data.x, data.y, data.z = some_scan().points.T
    data.write(path)


def write_pcd(path: Path, encoding: str) -> None:
    points = some_scan().points.astype("<f4")
    header = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {COLUMNS}\nHEIGHT {ROWS}\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS {COUNT}\nDATA {encoding}\n"
    )
    if encoding == "ascii":
        body = "\n".join(" ".join(map(str, point)) for point in points.tolist()).encode()
    elif encoding == "binary":
        body = points.tobytes()
    else:
        plain = points.T.tobytes()
        packed = b"".join(bytes([len(plain[i : i + 32]) - 1]) + plain[i : i + 32] for i in range(0, len(plain), 32))
        body = len(packed).to_bytes(4, "little") + len(plain).to_bytes(4, "little") + packed
    path.write_bytes(header.encode() + body)


def write_text(path: Path, delimiter: str, head: str) -> None:
    lines = [delimiter.join(f"{number:.3f}" for number in point) for point in some_scan().points]
    path.write_text(head + "\n".join(lines) + "\n")


def write_ascii_ply(path: Path) -> None:
    axes = "".join(f"property double {axis}\n" for axis in "xyz")
    write_text(path, " ", f"ply\nformat ascii 1.0\nelement vertex {COUNT}\n{axes}end_header\n")


def write_big_endian_ply(path: Path) -> None:
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    head = f"ply\nformat binary_big_endian 1.0\nelement vertex {COUNT}\n{axes}end_header\n"
    path.write_bytes(head.encode() + some_scan().points.astype(">f4").tobytes())


def write_image(path: Path, *settings: int) -> None:
    import cv2

    rng = np.random.default_rng(21)
    depth: Any = np.uint16 if path.stem == "deep" else np.uint8
    image = rng.integers(0, 200, (HEIGHT, WIDTH, 3)).astype(depth)
    path.write_bytes(bytes(cv2.imencode(path.suffix, image, list(settings))[1]))


def _image(*settings: int) -> Callable[[Path], None]:
    return lambda path: write_image(path, *settings)


PROGRESSIVE_JPEG = (2, 1)
LZW, DEFLATE, PLAIN = (259, 5), (259, 8), (259, 1)
WRITERS: Mapping[str, Callable[[Path], None]] = {
    "grid.e57": lambda path: write_scans(path, [some_scan(), some_scan()]),
    "photos.e57": write_e57_with_photos,
    "grid.ptx": lambda path: write_scans(path, [some_scan(), some_scan()]),
    "binary.ply": lambda path: write_scans(path, [some_scan()]),
    "swapped.ply": write_big_endian_ply,
    "ascii.ply": write_ascii_ply,
    "binary.pcd": lambda path: write_pcd(path, "binary"),
    "ascii.pcd": lambda path: write_pcd(path, "ascii"),
    "compressed.pcd": lambda path: write_pcd(path, "binary_compressed"),
    "old.las": lambda path: write_las(path, 3),
    "new.las": lambda path: write_las(path, 7),
    "old.laz": lambda path: write_las(path, 3),
    "new.laz": lambda path: write_las(path, 7),
    "points.xyz": lambda path: write_text(path, " ", f"{COUNT}\n"),
    "names.csv": lambda path: write_text(path, ",", "x,y,z\n"),
    "flat.jpg": _image(),
    "waves.jpg": _image(*PROGRESSIVE_JPEG),
    "flat.png": _image(),
    "deep.png": _image(),
    "plain.tif": _image(*PLAIN),
    "words.tif": _image(*LZW),
    "deflated.tif": _image(*DEFLATE),
}


def some_mesh() -> Mesh:
    """Give a box with a roof: triangles, and edges that are not shared."""
    corners = np.array([[x, y, z] for x in (0.0, 4.0) for y in (0.0, 3.0) for z in (0.0, 2.5)])
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [1, 5, 7]]
    return Mesh(corners, np.array(faces, dtype=np.int64))


def write_polygons(path: Path) -> None:
    corners = "".join(f"v {x} {y} 0.5\nvn 0 0 1\n" for x, y in ((0, 0), (4, 0), (4, 3), (2, 1), (0, 3)))
    faces = "f -5//-5 -4//-4 -3//-3 -2//-2 -1//-1\nf 1 2 3\n"
    path.write_text(f"mtllib a.mtl\no wall\n{corners}usemtl stone\n{faces}")


def write_polygon_ply(path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 5\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    head += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    path.write_text(head + "0 0 0\n4 0 0\n4 3 0\n2 1 0\n0 3 0\n5 0 1 2 3 4\n3 0 1 2\n")


def write_stl(path: Path) -> None:
    mesh = some_mesh()
    corners = mesh.vertices[mesh.triangles].astype("<f4")
    facets = b"".join(bytes(12) + triangle.tobytes() + bytes(2) for triangle in corners)
    path.write_bytes(b"box".ljust(80) + len(corners).to_bytes(4, "little") + facets)


def write_ascii_stl(path: Path) -> None:
    mesh = some_mesh()
    facets = "".join(
        "facet normal 0 0 1\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in mesh.vertices[triangle])
        + "endloop\nendfacet\n" for triangle in mesh.triangles
    )  # fmt: skip
    path.write_text(f"solid box\n{facets}endsolid box\n")


def write_heights(path: Path) -> None:
    heights = np.add.outer(np.arange(9.0), 0.1 * np.arange(7.0))
    path.write_bytes(geotiff(heights, Grid(0.0, 0.0, 0.5, *heights.shape), (700_000.0, 5_300_000.0)))


def write_city(path: Path) -> None:
    corners = [[x, y, z] for z in (0, 2500) for x, y in ((0, 0), (4000, 0), (4000, 3000), (0, 3000))]
    rings = [[3, 2, 1, 0], [4, 5, 6, 7], *([k, (k + 1) % 4, (k + 1) % 4 + 4, k + 4] for k in range(4))]
    solid = {"type": "Solid", "lod": "2", "boundaries": [[[ring] for ring in rings]]}
    scale = {"scale": [0.001, 0.001, 0.001], "translate": [0.0, 0.0, 0.0]}
    city = {"type": "CityJSON", "version": "2.0", "transform": scale, "vertices": corners}
    path.write_text(json.dumps({**city, "CityObjects": {"A": {"type": "Building", "geometry": [solid]}}}))


MESH_WRITERS: Mapping[str, Callable[[Path], None]] = {
    "polygons.obj": write_polygons,
    "binary.stl": write_stl,
    "ascii.stl": write_ascii_stl,
    "faces.ply": lambda path: write_ply(path, some_mesh(), np.zeros(3), None),
    "polygons.ply": write_polygon_ply,
}
"""Apart, so that damaged files keep their numbers."""
MADE_HERE: Mapping[str, Callable[[Path], None]] = {
    "heights.tif": write_heights,
    "city.json": write_city,
}
"""What this service writes and does not read: it is refused as what it is not."""


def whole_files(folder: Path, writers: Mapping[str, Callable[[Path], None]] = WRITERS) -> Mapping[str, bytes]:
    """Write one file of each kind, and give their contents by name."""
    for name, write in writers.items():
        write(folder / name)
    return {name: (folder / name).read_bytes() for name in writers}
