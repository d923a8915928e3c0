"""Points of one scan for a viewer in a browser: an octree of raw blocks, of which it loads what it shows.

A file of blocks, one after the other, and a list of them. A block holds the points of a node: first their coordinates
relative to the middle of the node (float32 x, y, z [m]), then four bytes each: intensity, red, green, blue. Coordinates
are those of the scan's own frame, so that a pose is one matrix of the viewer and no point is written again for it.
"""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from algorithms.arrays import Array, Vector3
from algorithms.progress import Progress, ProgressSection
from algorithms.scans.octree import Key
from service.formats.writers.base import POINTS_AT_ONCE, StationCloud, surveyed
from service.formats.writers.octree_spool import OctreeShape, octree_nodes

FORMAT = "tieline-points/1"
SHAPE = OctreeShape(most_in_leaf=40_000, cell_levels=6)
"""64 cells a side: the root of a scan has some ten thousand points, and 20 of them are a picture."""
BYTES_PER_POINT = 16
MARGIN_M = 1e-3
INTENSITY_SHARES = (0.01, 0.99)
"""Intensities below and above these shares become black and white: single reflectors must not darken all else."""
SAMPLED = 200_000
"""Intensities by which these are found."""
RECORD = np.dtype([("xyz", "<f8", 3), ("intensity", "<f4"), ("rgb", "u1", 3), ("spare", "u1")])


def write_viewer_points(path: Path, cloud: StationCloud, progress: Progress) -> dict[str, Any]:
    """Write the blocks of a scan; give the list of them.

    Parameters
    ----------
    path
        File of the blocks. Two more files, of 32 bytes a point, lie beside it in between.
    cloud
        The scan; its pose does not count. It is read once (twice, where its extent is not known).
    progress
        Is told how far it is.

    Returns
    -------
    ``format``, ``points``, ``low_m`` (corner of the root, full coordinates of the scan frame [m]), ``side_m`` (of the
    root [m]), ``has_intensity``, ``has_color``, ``intensity_limits`` (what became 0 and 255; null without intensities),
    and ``nodes``, the coarsest first: level, x, y, z (cell of that level), first byte, number of points.
    """
    known = surveyed(cloud)
    with tempfile.TemporaryFile(dir=path.parent) as raw, tempfile.TemporaryFile(dir=path.parent) as spool:
        limits = _copied(known, raw, ProgressSection(progress, 0.0, 0.4))
        root = _Root.around(known)
        points = _RawPoints(raw, root)
        nodes = octree_nodes(points, spool, SHAPE, ProgressSection(progress, 0.4, 0.7))
        section = ProgressSection(progress, 0.7, 1.0)
        total, done, first_byte, entries = max(1, points.count), 0, 0, []
        with path.open("wb") as out:
            for key, records in nodes:
                out.write(_block(key, records, root, limits))
                entries.append([*key, first_byte, len(records)])
                first_byte += BYTES_PER_POINT * len(records)
                done += len(records)
                section.report(done / total, "points for the viewer")
    return {
        "format": FORMAT,
        "points": done,
        "low_m": (root.low_m + known.origin_m).tolist(),
        "side_m": root.side_m,
        "has_intensity": known.has_intensity,
        "has_color": known.has_color,
        "intensity_limits": None if limits is None else list(limits),
        "nodes": sorted(entries),
    }


@dataclass(frozen=True, eq=False)
class _Root:
    """The cube of the root, relative to the origin of the cloud."""

    low_m: Vector3
    side_m: float

    @staticmethod
    def around(cloud: StationCloud) -> "_Root":
        if cloud.facts is None:  # pragma: no cover - it was surveyed
            raise ValueError("the extent of the cloud is not known")
        low_m, high_m = cloud.facts.low_m - cloud.origin_m, cloud.facts.high_m - cloud.origin_m
        side_m = float((high_m - low_m).max()) + 2.0 * MARGIN_M
        return _Root(0.5 * (low_m + high_m - side_m), side_m)

    def middle_m(self, key: Key) -> Vector3:
        """Give the middle of a node."""
        level, *cell = key
        return self.low_m + (np.array(cell, dtype=np.float64) + 0.5) * (self.side_m / 2.0**level)


@dataclass(frozen=True, eq=False)
class _RawPoints:
    """The points as they came, from the file that they were copied to."""

    raw: BinaryIO
    root: _Root

    @property
    def dtype(self) -> np.dtype[Any]:
        return RECORD

    @property
    def count(self) -> int:
        return self.raw.seek(0, 2) // RECORD.itemsize

    def pieces(self, progress: Progress) -> Iterator[Array]:
        total = max(1, self.count)
        for start in range(0, total, POINTS_AT_ONCE):
            progress.report(start / total, "points for the viewer")
            self.raw.seek(start * RECORD.itemsize)
            records = np.frombuffer(self.raw.read(POINTS_AT_ONCE * RECORD.itemsize), dtype=RECORD)
            if len(records):
                yield records

    def cells(self, records: Array, level: int) -> Array:
        scaled = (records["xyz"] - self.root.low_m) * (2.0**level / self.root.side_m)
        return np.asarray(np.clip(scaled, 0.0, 2.0**level - 1.0)).astype(np.int64)


def _copied(cloud: StationCloud, raw: BinaryIO, progress: Progress) -> tuple[float, float] | None:
    """Copy the points to a file; give the limits between which intensities are shown, None without intensities."""
    total, done, samples = 1 if cloud.facts is None else max(1, cloud.facts.points), 0, []
    step = max(1, total // SAMPLED)
    for piece in cloud.pieces():
        records = np.zeros(len(piece), dtype=RECORD)
        records["xyz"] = piece.points
        if piece.intensity is not None:
            records["intensity"] = np.nan_to_num(piece.intensity)
            samples.append(records["intensity"][::step].copy())
        if piece.color is not None:
            records["rgb"] = piece.color
        raw.write(records.tobytes())
        done += len(piece)
        progress.report(done / total, "points for the viewer")
    raw.flush()
    if not samples:
        return None
    low, high = np.quantile(np.concatenate(samples).astype(np.float64), INTENSITY_SHARES).tolist()
    return low, high if high > low else low + 1.0


def _block(key: Key, records: Array, root: _Root, limits: tuple[float, float] | None) -> bytes:
    channels = np.zeros((len(records), 4), dtype=np.uint8)
    if limits is not None:
        share = (records["intensity"].astype(np.float64) - limits[0]) / (limits[1] - limits[0])
        channels[:, 0] = np.rint(np.clip(share, 0.0, 1.0) * 255.0)
    channels[:, 1:] = records["rgb"]
    return b"".join(((records["xyz"] - root.middle_m(key)).astype("<f4").tobytes(), channels.tobytes()))
