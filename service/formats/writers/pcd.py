"""PCD 0.7 in binary."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np

from algorithms.progress import Progress
from service.formats.writers.base import StationCloud, Written
from service.formats.writers.placed import PlacedClouds, in_world, placed, scalar_of
from service.formats.writers.whole_files import whole_file

NEAREST_FAR_M = 1000.0
"""Within so many metres of the origin float32 keeps 0.03 mm, beyond it float64 is written [m]."""
NO_GRIDS = "the points are in the world frame: PCD keeps no pose of a station, only where the instrument stood"
DOUBLE = "the coordinates are stored with 8 bytes, which keep 0.1 mm far from the origin; PCL's own point types read 4"


@final
@dataclass(frozen=True)
class PcdWriter:
    """Write binary PCD: coordinates in float32 where that keeps 0.1 mm, else float64; VIEWPOINT is the instrument."""

    name: str = "pcd"
    ending: str = ".pcd"
    media_type: str = "application/octet-stream"

    def write(self, path: Path, clouds: Sequence[StationCloud], progress: Progress) -> Written:
        """Write stations into one file in the world frame."""
        everything = placed(clouds, with_stations=len(clouds) > 1)
        far = float(np.abs(everything.bounds_m()).max(initial=0.0)) > NEAREST_FAR_M
        columns = _columns(everything, "f8" if far else "f4")
        with whole_file(path) as partial, partial.open("wb") as stream:
            stream.write(_header(everything, columns))
            for _, cloud, piece in everything.pieces(progress):
                table = np.zeros(len(piece), dtype=[(name, f"<{kind}") for name, kind in columns])
                for axis, values in zip("xyz", in_world(cloud, piece, np.zeros(3)).T, strict=True):
                    table[axis] = values
                if piece.intensity is not None:
                    table["intensity"] = piece.intensity
                if piece.color is not None:
                    red, green, blue = piece.color.T.astype(np.uint32)
                    table["rgb"] = (red << 16 | green << 8 | blue).view(np.float32)  # as PCL packs colours
                for scalar in everything.scalars:
                    table[scalar.name] = scalar_of(piece, scalar)
                stream.write(table.data)
        return Written(everything.points, (NO_GRIDS, DOUBLE) if far else (NO_GRIDS,))


def _columns(clouds: PlacedClouds, coordinates: str) -> list[tuple[str, str]]:
    columns = [(axis, coordinates) for axis in "xyz"]
    if clouds.has_color:
        columns.append(("rgb", "f4"))
    if clouds.has_intensity:
        columns.append(("intensity", "f4"))
    return columns + [(scalar.name, scalar.kind) for scalar in clouds.scalars]


def _header(clouds: PlacedClouds, columns: Sequence[tuple[str, str]]) -> bytes:
    lines = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        "FIELDS " + " ".join(name for name, _ in columns),
        "SIZE " + " ".join(kind[1] for _, kind in columns),
        "TYPE " + " ".join(kind[0].upper() for _, kind in columns),
        "COUNT " + " ".join("1" for _ in columns),
        f"WIDTH {clouds.points}",
        "HEIGHT 1",
        "VIEWPOINT " + _viewpoint(clouds.clouds),
        f"POINTS {clouds.points}",
        "DATA binary",
    ]
    return ("\n".join(lines) + "\n").encode("ascii")


def _viewpoint(clouds: Sequence[StationCloud]) -> str:
    """Give where the instrument stood and how it was turned; of several stations there is none."""
    if len(clouds) != 1 or clouds[0].sensor_in_scan_m is None:
        return "0 0 0 1 0 0 0"
    pose = clouds[0].pose
    numbers = [
        *pose.apply(clouds[0].sensor_in_scan_m).tolist(),
        *pose.rotation.as_quat(canonical=True, scalar_first=True).tolist(),
    ]
    return " ".join(f"{number:.12g}" for number in numbers)
