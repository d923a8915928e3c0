"""PLY in binary: full coordinates in float64."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from algorithms.arrays import Array
from algorithms.progress import Progress
from service.formats.writers.base import StationCloud, Written
from service.formats.writers.placed import PlacedClouds, in_world, placed, scalar_of
from service.formats.writers.whole_files import whole_file

WORDS = {
    "f8": "double", "f4": "float", "u1": "uchar", "i1": "char",
    "u2": "ushort", "i2": "short", "u4": "uint", "i4": "int",
}  # fmt: skip
COLORS = ("red", "green", "blue")
NO_POSES = "the points are in the world frame: PLY has no place for poses and grids"


@final
@dataclass(frozen=True)
class PlyWriter:
    """Write binary little-endian PLY: float64 coordinates, intensity in float32, colours, further numbers."""

    name: str = "ply"
    ending: str = ".ply"
    media_type: str = "application/octet-stream"

    def write(self, path: Path, clouds: Sequence[StationCloud], progress: Progress) -> Written:
        """Write stations into one file in the world frame."""
        everything = placed(clouds, with_stations=len(clouds) > 1)
        columns = _columns(everything)
        with whole_file(path) as partial, partial.open("wb") as stream:
            stream.write(_header(everything, columns))
            for _, cloud, piece in everything.pieces(progress):
                table = np.zeros(len(piece), dtype=[(name, f"<{kind}") for name, kind in columns])
                for axis, values in zip("xyz", in_world(cloud, piece, np.zeros(3)).T, strict=True):
                    table[axis] = values
                if piece.intensity is not None:
                    table["intensity"] = piece.intensity
                if piece.color is not None:
                    for channel, name in enumerate(COLORS):
                        table[name] = piece.color[:, channel]
                for scalar in everything.scalars:
                    table[scalar.name] = scalar_of(piece, scalar)
                _append(stream, table)
        return Written(everything.points, (NO_POSES,) if _lose_poses(clouds) else ())


def _columns(clouds: PlacedClouds) -> list[tuple[str, str]]:
    columns = [("x", "f8"), ("y", "f8"), ("z", "f8")]
    if clouds.has_intensity:
        columns.append(("intensity", "f4"))
    if clouds.has_color:
        columns += [(name, "u1") for name in COLORS]
    return columns + [(scalar.name, scalar.kind) for scalar in clouds.scalars]


def _header(clouds: PlacedClouds, columns: Sequence[tuple[str, str]]) -> bytes:
    lines = ["ply", "format binary_little_endian 1.0"]
    if clouds.crs_wkt:
        lines.append(f"comment crs {' '.join(clouds.crs_wkt.split())}")
    lines.append(f"element vertex {clouds.points}")
    lines += [f"property {WORDS[kind]} {name}" for name, kind in columns]
    return ("\n".join([*lines, "end_header"]) + "\n").encode("ascii", "replace")


def _append(stream: Any, table: Array) -> None:
    stream.write(table.data)


def _lose_poses(clouds: Sequence[StationCloud]) -> bool:
    return any(cloud.world_from_scan is not None or cloud.rows is not None for cloud in clouds)
