"""One way of writing stations into one LAZ, in a process of its own; prints seconds of the processor and memory."""

import json
import resource
import sys
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.progress import NoProgress
from service.formats.base import ScanFile
from service.formats.streaming import stream_scan
from service.formats.writers import writer_of
from service.formats.writers.las_records import LasLayout
from service.formats.writers.placed import placed


def poses(count: int) -> list[RigidTransform]:
    """Stations 15 m apart in national coordinates."""
    return [
        RigidTransform.from_components(
            [500_000.0 + 15.0 * k, 5_400_000.0, 300.0], Rotation.from_rotvec([0.0, 0.0, 0.3 * k])
        )
        for k in range(count)
    ]


def by_tieline(file: Path, target: Path, count: int) -> None:
    """Read an E57 file once for each station and write all points in the world frame."""
    clouds = [
        replace(stream_scan(ScanFile(file, file.name)), name=f"S{k}", world_from_scan=pose)
        for k, pose in enumerate(poses(count))
    ]
    writer_of("laz").write(target, clouds, NoProgress())


def by_laspy(file: Path, target: Path, count: int) -> None:
    """Write records that are ready in memory, and do nothing else: those of the first station, again and again."""
    clouds = placed([replace(stream_scan(ScanFile(file, file.name)), world_from_scan=poses(1)[0])], with_stations=True)
    layout = LasLayout.of(clouds, "a")
    header = laspy.LasHeader(point_format=layout.point_format, version="1.4")
    header.scales, header.offsets = np.full(3, 1e-4), layout.offset_m
    header.add_extra_dim(laspy.ExtraBytesParams("station", "u2"))
    dtype = header.point_format.dtype()
    pieces = [
        laspy.PackedPointRecord(layout.records(*each).view(dtype), header.point_format)
        for each in clouds.pieces(NoProgress())
    ]
    begun = resource.getrusage(resource.RUSAGE_SELF)
    with laspy.open(target, mode="w", header=header) as writer:
        for _ in range(count):
            for piece in pieces:
                writer.write_points(piece)
    report(begun.ru_utime + begun.ru_stime)


def by_writer(file: Path, target: Path, count: int) -> None:
    """Write pieces that are in memory: all that the writer does, and nothing of what reading takes."""
    cloud = stream_scan(ScanFile(file, file.name))
    pieces = list(cloud.pieces())
    clouds = [
        replace(cloud, pieces=lambda: iter(pieces), name=f"S{k}", world_from_scan=pose)
        for k, pose in enumerate(poses(count))
    ]
    begun = resource.getrusage(resource.RUSAGE_SELF)
    writer_of("laz").write(target, clouds, NoProgress())
    report(begun.ru_utime + begun.ru_stime)


def report(before_s: float = 0.0) -> None:
    """Print what this process has used since then."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    print(json.dumps({"processor_s": used.ru_utime + used.ru_stime - before_s, "peak_bytes": used.ru_maxrss * 1024}))


if __name__ == "__main__":
    way, source, path, stations = sys.argv[1:]
    if way == "tieline":
        begun = resource.getrusage(resource.RUSAGE_SELF)
        by_tieline(Path(source), Path(path), int(stations))
        report(begun.ru_utime + begun.ru_stime)
    else:
        (by_laspy if way == "laspy" else by_writer)(Path(source), Path(path), int(stations))
