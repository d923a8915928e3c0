"""Whole, small files of every format that is read: what hostile files are made from."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from algorithms.scans.scan import Scan, ScanGrid
from service.formats.writers import write_scans
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


def whole_files(folder: Path) -> Mapping[str, bytes]:
    """Write one file of each kind, and give their contents by name."""
    for name, write in WRITERS.items():
        write(folder / name)
    return {name: (folder / name).read_bytes() for name in WRITERS}
