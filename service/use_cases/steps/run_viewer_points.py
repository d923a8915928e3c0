"""Put the points of a scan into the order in which a viewer loads them, unless an earlier job already did."""

import json
import math
import shutil
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from algorithms.progress import Progress, ProgressSection
from service.names.content_keys import content_key
from service.names.feature_keys import viewer_points_of_step
from service.ports import Json, StepContext
from service.use_cases.limits.free_space import require_free_space
from service.use_cases.limits.read_limits import read_limits

if TYPE_CHECKING:
    from algorithms.scans.scan import Scan
    from service.formats.writers import PointPiece, StationCloud

MOST_POINTS = 2_000_000
"""Of a scan; of larger ones every n-th point is shown: a screen has not more pixels, and a job should not wait long."""
BYTES_IN_BETWEEN = 80
"""About what a point takes on the disk while they are sorted, the blocks included."""


def write_points_of_scan(context: StepContext, arguments: Json) -> Json:
    """Write the blocks of points of one scan and the list of them; memory does not grow with their number.

    Raises
    ------
    InsufficientStorageError
        The disk has no room for it.
    """
    from service.formats.base import ScanFile
    from service.formats.streaming import stream_scan

    keys = viewer_points_of_step(arguments)
    if context.blobs.exists(keys[1]):
        return {}
    path = context.blobs.local_path(content_key(arguments["sha256"]))
    file = ScanFile(path, arguments["filename"], arguments.get("columns") or "", arguments.get("unit") or "")
    section = ProgressSection(context.progress, 0.0, 0.3)
    cloud = stream_scan(file, arguments["index"], read_limits(context), section)
    points = 0 if cloud.facts is None else cloud.facts.points
    shown = every_nth(cloud, math.ceil(points / MOST_POINTS))
    store_viewer_points(context, shown, points, keys, ProgressSection(context.progress, 0.3, 1.0))
    return {}


def store_points_of_scan(context: StepContext, arguments: Json, scan: "Scan", progress: Progress) -> None:
    """Write the blocks of points of a scan that is in memory, unless an earlier job already did.

    Parameters
    ----------
    context, arguments
        Of the step.
    scan
        All points that its file holds under this index.
    progress
        Is told how far it is.

    Raises
    ------
    InsufficientStorageError
        The disk has no room for it.
    """
    from service.formats.writers.base import cloud_of, surveyed

    keys = viewer_points_of_step(arguments)
    if not context.blobs.exists(keys[1]):
        shown = every_nth(surveyed(cloud_of(replace(scan, grid=None))), math.ceil(len(scan) / MOST_POINTS))
        store_viewer_points(context, shown, len(scan), keys, progress)


def store_viewer_points(
    context: StepContext, cloud: "StationCloud", points: int, keys: tuple[str, str], progress: Progress
) -> None:
    """Write the blocks of points of a cloud and the list of them.

    Parameters
    ----------
    context
        Of the step.
    cloud
        What is shown.
    points
        How many may lie on the disk while they are sorted.
    keys
        Of the blob of the blocks, and of that of the list.
    progress
        Is told how far it is.

    Raises
    ------
    InsufficientStorageError
        The disk has no room for it.
    """
    from service.formats.writers.viewer_points import write_viewer_points

    blocks, listed = keys
    scratch = context.blobs.scratch()
    try:
        require_free_space(scratch, context.limits.get("min_free_bytes", 0), BYTES_IN_BETWEEN * points)
        found = write_viewer_points(scratch / "blocks", cloud, progress)
        context.blobs.put_file(blocks, scratch / "blocks")
        context.blobs.write_bytes(listed, json.dumps(found).encode())  # the last: where it is, the blocks are
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def every_nth(cloud: "StationCloud", nth: int) -> "StationCloud":
    """Keep every n-th point."""
    if nth <= 1:
        return cloud

    def pieces() -> "Iterator[PointPiece]":
        first = 0
        for piece in cloud.pieces():
            kept = slice(first, None, nth)
            first = (first - len(piece.points)) % nth
            yield replace(
                piece,
                points=piece.points[kept],
                intensity=None if piece.intensity is None else piece.intensity[kept],
                color=None if piece.color is None else piece.color[kept],
                row=None if piece.row is None else piece.row[kept],
                column=None if piece.column is None else piece.column[kept],
                scalars={name: values[kept] for name, values in piece.scalars.items()},
            )

    return replace(cloud, pieces=pieces)
