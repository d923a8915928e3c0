"""Fresh E57 (ASTM E2807): points in the scan frame, poses, grids, images."""

import errno
import os
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from algorithms.arrays import Array
from algorithms.progress import Progress
from service.formats.e57_photos import DISTORTION_URI
from service.formats.writers.base import CloudFacts, PointPiece, StationCloud, Written
from service.formats.writers.e57_images import DISTORTION_PREFIX, add_images, is_distorted
from service.formats.writers.e57_values import set_numbers, set_pose
from service.formats.writers.placed import placed, scalar_of
from service.formats.writers.whole_files import is_full, whole_file

RECORDS_AT_ONCE = 1 << 19
AXES = ("X", "Y", "Z")
CHANNELS = ("Red", "Green", "Blue")
SCALARS_PREFIX, SCALARS_URI = "tieline", "urn:tieline:e57-fields"
"""Extension of the fields that the standard does not have."""
BUFFER_TYPES = {"f4": "f", "f8": "d"}


@final
@dataclass(frozen=True)
class E57Writer:
    """Write E57: float64 full coordinates, grid as row and column, intensity, colour, pose, images.

    The scan frame of E57 has the instrument in its origin; a sensor elsewhere is not written.
    """

    name: str = "e57"
    ending: str = ".e57"
    media_type: str = "application/octet-stream"

    def write(self, path: Path, clouds: Sequence[StationCloud], progress: Progress) -> Written:
        """Write stations into one file, each with its pose."""
        everything = placed(clouds)
        total, done = max(1, everything.points), 0
        with whole_file(path) as partial, _created(partial) as image_file:
            from pye57 import libe57

            root = image_file.root()
            if everything.scalars:
                image_file.extensionsAdd(SCALARS_PREFIX, SCALARS_URI)
            if any(is_distorted(image) for cloud in clouds for image in cloud.images):
                image_file.extensionsAdd(DISTORTION_PREFIX, DISTORTION_URI)
            if everything.crs_wkt:
                root.set("coordinateMetadata", libe57.StringNode(image_file, everything.crs_wkt))
            data = libe57.VectorNode(image_file, True)
            root.set("data3D", data)
            images = libe57.VectorNode(image_file, True)
            root.set("images2D", images)
            for number, cloud in enumerate(everything.clouds):
                guid = _guid(f"{number} {cloud.name} {everything.points}")
                points, fields = _begin_scan(image_file, data, cloud, guid)
                for piece in _written(image_file, points, fields, cloud):
                    progress.report(min(1.0, done / total), f"writing {cloud.name}")
                    done += piece
                add_images(image_file, images, cloud, guid)
        return Written(everything.points)


@contextmanager
def _created(path: Path) -> Iterator[Any]:
    """Create an E57 file and close it; what was written is thrown away where that fails."""
    from pye57 import libe57

    image_file = libe57.ImageFile(str(path), "w")
    try:
        image_file.extensionsAdd("", libe57.E57_V1_0_URI)
        root = image_file.root()
        root.set("formatName", libe57.StringNode(image_file, "ASTM E57 3D Imaging Data File"))
        root.set("guid", libe57.StringNode(image_file, _guid(path.name)))
        root.set("versionMajor", libe57.IntegerNode(image_file, libe57.E57_FORMAT_MAJOR))
        root.set("versionMinor", libe57.IntegerNode(image_file, libe57.E57_FORMAT_MINOR))
        root.set("e57LibraryVersion", libe57.StringNode(image_file, libe57.E57_LIBRARY_ID))
        yield image_file
        image_file.close()
    except libe57.E57Exception as fault:
        if is_full(fault):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)) from fault
        raise
    finally:
        image_file.cancel()  # does nothing where it was closed


def _guid(of: str) -> str:
    """Give a GUID that is the same for the same content."""
    return f"{{{uuid.uuid5(uuid.NAMESPACE_URL, 'urn:tieline:' + of)}}}"


def _begin_scan(image_file: Any, data: Any, cloud: StationCloud, guid: str) -> tuple[Any, dict[str, Array]]:
    """Describe a scan; give the node of its points and an empty buffer for each of its fields."""
    from pye57 import libe57

    node = libe57.StructureNode(image_file)
    node.set("guid", libe57.StringNode(image_file, guid))
    node.set("name", libe57.StringNode(image_file, cloud.name))
    if cloud.facts is not None and cloud.facts.points:
        set_numbers(image_file, node, _limits(cloud, cloud.facts))
    if cloud.world_from_scan is not None:
        set_pose(image_file, node, cloud.world_from_scan)
    prototype, buffers = _fields(image_file, cloud)
    points = libe57.CompressedVectorNode(image_file, prototype, libe57.VectorNode(image_file, True))
    node.set("points", points)
    data.append(node)
    return points, buffers


def _limits(cloud: StationCloud, facts: CloudFacts) -> dict[str, dict[str, float]]:
    sides = (("Minimum", facts.low_m), ("Maximum", facts.high_m))
    bounds = {f"{axis.lower()}{end}": float(side[k]) for end, side in sides for k, axis in enumerate(AXES)}
    limits: dict[str, dict[str, float]] = {"cartesianBounds": bounds}
    if facts.intensity_limits is not None:
        low, high = facts.intensity_limits
        limits["intensityLimits"] = {"intensityMinimum": low, "intensityMaximum": high}
    if cloud.has_color:
        limits["colorLimits"] = {f"color{c}{end}": v for c in CHANNELS for end, v in (("Minimum", 0), ("Maximum", 255))}
    if cloud.rows is not None and cloud.columns is not None:
        ends = {"rowMinimum": 0, "rowMaximum": cloud.rows - 1, "columnMinimum": 0, "columnMaximum": cloud.columns - 1}
        limits["indexBounds"] = {name: int(end) for name, end in ends.items()}
    return limits


def _fields(image_file: Any, cloud: StationCloud) -> tuple[Any, dict[str, Array]]:
    from pye57 import libe57

    facts = cloud.facts
    prototype = libe57.StructureNode(image_file)
    buffers: dict[str, Array] = {}

    def add(name: str, kind: str, node: Any) -> None:
        prototype.set(name, node)
        buffers[name] = np.empty(RECORDS_AT_ONCE, dtype=kind)

    for axis, name in enumerate(AXES):
        low, high = (0.0, 0.0) if facts is None else (float(facts.low_m[axis]), float(facts.high_m[axis]))
        # bounds from reduced coordinates may be off by a rounding
        slack = 1e-6
        node = libe57.FloatNode(image_file, low, libe57.E57_DOUBLE, low - slack, high + slack)
        add(f"cartesian{name}", "d", node)
    if cloud.has_intensity:
        low, high = (0.0, 1.0) if facts is None or facts.intensity_limits is None else facts.intensity_limits
        add("intensity", "f", libe57.FloatNode(image_file, low, libe57.E57_SINGLE, low, high))
    if cloud.has_color:
        for channel in CHANNELS:
            add(f"color{channel}", "u1", libe57.IntegerNode(image_file, 0, 0, 255))
    if cloud.rows is not None and cloud.columns is not None:
        # 'q', not 'l': pye57 misreads the latter
        add("rowIndex", "q", libe57.IntegerNode(image_file, 0, 0, cloud.rows - 1))
        add("columnIndex", "q", libe57.IntegerNode(image_file, 0, 0, cloud.columns - 1))
    for scalar in cloud.scalars:
        precision = libe57.E57_SINGLE if scalar.kind == "f4" else libe57.E57_DOUBLE
        kind = BUFFER_TYPES.get(scalar.kind)
        name = f"{SCALARS_PREFIX}:{scalar.name}"
        if kind is not None:
            add(name, kind, libe57.FloatNode(image_file, 0.0, precision))
        else:
            limits = np.iinfo(np.dtype(scalar.kind))
            add(name, "q", libe57.IntegerNode(image_file, 0, int(limits.min), int(limits.max)))
    return prototype, buffers


def _written(image_file: Any, points: Any, fields: dict[str, Array], cloud: StationCloud) -> Iterator[int]:
    """Write the points of a scan; give the number of each portion."""
    from pye57 import libe57

    buffers = libe57.VectorSourceDestBuffer()
    for name, array in fields.items():
        buffers.append(libe57.SourceDestBuffer(image_file, name, array, len(array), True, True))
    writer = points.writer(buffers)
    try:
        for piece in cloud.pieces():
            for start in range(0, len(piece), RECORDS_AT_ONCE):
                length = min(RECORDS_AT_ONCE, len(piece) - start)
                for name, column in _columns(cloud, piece, slice(start, start + length)).items():
                    fields[name][:length] = column
                writer.write(length)
                yield length
        writer.close()
    finally:
        # libE57 crashes where an open writer outlives its file
        if writer.isOpen():
            with suppress(libe57.E57Exception):
                writer.close()


def _columns(cloud: StationCloud, piece: PointPiece, part: slice) -> dict[str, Array]:
    points = piece.points[part]
    columns: dict[str, Array] = {f"cartesian{a}": points[:, i] + cloud.origin_m[i] for i, a in enumerate(AXES)}
    if cloud.has_intensity:
        columns["intensity"] = np.zeros(len(points)) if piece.intensity is None else piece.intensity[part]
    if cloud.has_color:
        color = np.zeros((len(points), 3), dtype=np.uint8) if piece.color is None else piece.color[part]
        columns |= {f"color{channel}": color[:, i] for i, channel in enumerate(CHANNELS)}
    if cloud.rows is not None and piece.row is not None and piece.column is not None:
        columns["rowIndex"], columns["columnIndex"] = piece.row[part], piece.column[part]
    for scalar in cloud.scalars:
        columns[f"{SCALARS_PREFIX}:{scalar.name}"] = scalar_of(piece, scalar)[part]
    return columns
