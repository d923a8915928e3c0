"""LAZ 1.4 through laspy and lazrs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from algorithms.progress import Progress
from service.formats.writers.base import StationCloud, Written
from service.formats.writers.las_records import (
    SCALE_M,
    STATIONS_RECORD,
    STATIONS_USER,
    LasLayout,
    is_stretched_to_16_bits,
    names_record,
)
from service.formats.writers.placed import PlacedClouds, placed
from service.formats.writers.whole_files import whole_file

STRETCHED = "intensities were brought to the 16 bits of LAS"
DATE_OFFSET = 90
"""Day and year in the header; zero: not said (LAS 1.4 R15, table 3)."""
NO_POSES = "the points are in the world frame: LAS has no place for poses and grids"


@final
@dataclass(frozen=True)
class LazWriter:
    """Write LAZ 1.4: steps of 0.1 mm from an offset near the data, WKT, each point's station as extra bytes."""

    name: str = "laz"
    ending: str = ".laz"
    media_type: str = "application/vnd.laszip"

    def write(self, path: Path, clouds: Sequence[StationCloud], progress: Progress) -> Written:
        """Write stations into one file in the world frame."""
        import laspy

        all_clouds = placed(clouds, with_stations=True)
        layout = LasLayout.of(all_clouds, path.name)
        header = _header(all_clouds, layout)
        with whole_file(path) as partial, partial.open("wb") as stream:
            with laspy.LasWriter(stream, header, do_compress=True, closefd=False) as writer:
                for number, cloud, piece in all_clouds.pieces(progress):
                    records = layout.records(number, cloud, piece)
                    packed = laspy.PackedPointRecord(records.view(header.point_format.dtype()), header.point_format)
                    writer.write_points(packed)
            # the same points give the same file, whenever they are written
            stream.seek(DATE_OFFSET)
            stream.write(bytes(4))
        return Written(all_clouds.points, las_notes(all_clouds))


def las_notes(clouds: PlacedClouds) -> tuple[str, ...]:
    """Say what LAS changes."""
    stretched = any(is_stretched_to_16_bits(cloud) for cloud in clouds.clouds)
    return (NO_POSES, STRETCHED) if stretched else (NO_POSES,)


def _header(clouds: PlacedClouds, layout: LasLayout) -> Any:
    import laspy
    from laspy.vlrs.known import WktCoordinateSystemVlr

    header = laspy.LasHeader(point_format=layout.point_format, version="1.4")
    header.scales, header.offsets = np.full(3, SCALE_M), layout.offset_m
    header.generating_software = "tieline"
    for field in layout.scalars:
        name = field.title or field.name
        header.add_extra_dim(laspy.ExtraBytesParams(name, field.kind, description=field.description))
    if layout.is_standard_time:
        header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    if clouds.crs_wkt:
        header.vlrs.append(WktCoordinateSystemVlr(clouds.crs_wkt))
        header.global_encoding.wkt = True
    header.vlrs.append(laspy.VLR(STATIONS_USER, STATIONS_RECORD, "names of stations", names_record(clouds.clouds)))
    return header
