"""Write scans as E57 (ASTM E2807)."""

import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array
from algorithms.scans.scan import Scan

RECORDS_AT_ONCE = 1 << 19
AXES = ("X", "Y", "Z")
CHANNELS = ("Red", "Green", "Blue")


def write_e57(path: Path, scans: Sequence[Scan]) -> None:
    """Write scans into one E57 file: float64 full coordinates, grid as row and column, intensity, colour, pose.

    The scan frame of E57 has the instrument in its origin; a `sensor_m` elsewhere is not written.
    """
    from pye57 import libe57

    image_file = libe57.ImageFile(str(path), "w")
    try:
        image_file.extensionsAdd("", libe57.E57_V1_0_URI)
        root = image_file.root()
        root.set("formatName", libe57.StringNode(image_file, "ASTM E57 3D Imaging Data File"))
        root.set("guid", libe57.StringNode(image_file, f"{{{uuid.uuid4()}}}"))
        root.set("versionMajor", libe57.IntegerNode(image_file, libe57.E57_FORMAT_MAJOR))
        root.set("versionMinor", libe57.IntegerNode(image_file, libe57.E57_FORMAT_MINOR))
        root.set("e57LibraryVersion", libe57.StringNode(image_file, libe57.E57_LIBRARY_ID))
        data = libe57.VectorNode(image_file, True)
        root.set("data3D", data)
        root.set("images2D", libe57.VectorNode(image_file, True))
        for scan in scans:
            _write_scan(image_file, data, scan)
    finally:
        image_file.close()


def _write_scan(image_file: Any, data: Any, scan: Scan) -> None:
    from pye57 import libe57

    columns = _columns(scan)
    node = libe57.StructureNode(image_file)
    node.set("guid", libe57.StringNode(image_file, f"{{{uuid.uuid4()}}}"))
    node.set("name", libe57.StringNode(image_file, scan.name))
    bounds_m = scan.bounds_m
    limits = {"cartesianBounds": {f"{axis.lower()}Minimum": bounds_m[0, i] for i, axis in enumerate(AXES)}}
    limits["cartesianBounds"] |= {f"{axis.lower()}Maximum": bounds_m[1, i] for i, axis in enumerate(AXES)}
    if scan.intensity is not None:
        limits["intensityLimits"] = {
            "intensityMinimum": float(scan.intensity.min()),
            "intensityMaximum": float(scan.intensity.max()),
        }
    _set_numbers(image_file, node, limits)
    whole: dict[str, dict[str, int]] = {}
    if scan.color is not None:
        whole["colorLimits"] = {f"color{c}{end}": v for c in CHANNELS for end, v in (("Minimum", 0), ("Maximum", 255))}
    if scan.grid is not None:
        whole["indexBounds"] = {
            "rowMinimum": 0,
            "rowMaximum": scan.grid.rows - 1,
            "columnMinimum": 0,
            "columnMaximum": scan.grid.columns - 1,
        }
    _set_numbers(image_file, node, whole)
    if scan.world_from_scan is not None:
        _set_pose(image_file, node, scan.world_from_scan)
    prototype = libe57.StructureNode(image_file)
    for name, column in columns.items():
        prototype.set(name, _field(image_file, name, column))
    points = libe57.CompressedVectorNode(image_file, prototype, libe57.VectorNode(image_file, True))
    node.set("points", points)
    data.append(node)
    _write_columns(image_file, points, columns)


def _columns(scan: Scan) -> dict[str, Array]:
    columns: dict[str, Array] = {f"cartesian{a}": scan.points[:, i] + scan.origin_m[i] for i, a in enumerate(AXES)}
    if scan.intensity is not None:
        columns["intensity"] = scan.intensity
    if scan.color is not None:
        columns |= {f"color{channel}": scan.color[:, i] for i, channel in enumerate(CHANNELS)}
    if scan.grid is not None:
        row, column = np.nonzero(scan.grid.index >= 0)
        number = scan.grid.index[row, column]
        # a point outside the grid cannot be said in E57
        if len(number) == len(scan):
            # 'q', not 'l': pye57 misreads the latter
            columns["rowIndex"] = np.empty(len(scan), dtype="q")
            columns["columnIndex"] = np.empty(len(scan), dtype="q")
            columns["rowIndex"][number], columns["columnIndex"][number] = row, column
    return columns


def _field(image_file: Any, name: str, column: Array) -> Any:
    from pye57 import libe57

    if name.startswith("color"):
        return libe57.IntegerNode(image_file, 0, 0, 255)
    if column.dtype.kind == "i":
        return libe57.IntegerNode(image_file, 0, 0, int(column.max()))
    precision = libe57.E57_SINGLE if column.dtype == np.float32 else libe57.E57_DOUBLE
    low, high = float(column.min()), float(column.max())
    return libe57.FloatNode(image_file, low, precision, low, high)


def _write_columns(image_file: Any, points: Any, columns: dict[str, Array]) -> None:
    from pye57 import libe57

    total = len(columns["cartesianX"])
    capacity = min(RECORDS_AT_ONCE, total)
    piece = {name: np.empty(capacity, dtype=column.dtype) for name, column in columns.items()}
    buffers = libe57.VectorSourceDestBuffer()
    for name, array in piece.items():
        buffers.append(libe57.SourceDestBuffer(image_file, name, array, capacity, True, True))
    writer = points.writer(buffers)
    for start in range(0, total, capacity):
        length = min(capacity, total - start)
        for name, array in piece.items():
            array[:length] = columns[name][start : start + length]
        writer.write(length)
    writer.close()


def _set_pose(image_file: Any, node: Any, pose: RigidTransform) -> None:
    quaternion = dict(zip("wxyz", pose.rotation.as_quat(canonical=True, scalar_first=True), strict=True))
    translation_m = dict(zip("xyz", pose.translation, strict=True))
    from pye57 import libe57

    pose_node = libe57.StructureNode(image_file)
    _set_numbers(image_file, pose_node, {"rotation": quaternion, "translation": translation_m})
    node.set("pose", pose_node)


def _set_numbers(image_file: Any, parent: Any, structures: dict[str, Any]) -> None:
    from pye57 import libe57

    for name, numbers in structures.items():
        structure = libe57.StructureNode(image_file)
        for key, number in numbers.items():
            kind = libe57.IntegerNode if isinstance(number, int) else libe57.FloatNode
            structure.set(key, kind(image_file, number if isinstance(number, int) else float(number)))
        parent.set(name, structure)
