"""Put the points of a scan into the order in which a viewer loads them, unless an earlier job already did."""

import json
import shutil

from algorithms.progress import ProgressSection
from service.names.content_keys import content_key
from service.names.feature_keys import viewer_points_of_step
from service.ports import Json, StepContext
from service.use_cases.limits.free_space import require_free_space
from service.use_cases.limits.read_limits import read_limits

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
    from service.formats.writers.viewer_points import write_viewer_points

    blocks, listed = viewer_points_of_step(arguments)
    if context.blobs.exists(listed):
        return {}
    path = context.blobs.local_path(content_key(arguments["sha256"]))
    file = ScanFile(path, arguments["filename"], arguments.get("columns") or "", arguments.get("unit") or "")
    section = ProgressSection(context.progress, 0.0, 0.3)
    cloud = stream_scan(file, arguments["index"], read_limits(context), section)
    scratch = context.blobs.scratch()
    try:
        points = 0 if cloud.facts is None else cloud.facts.points
        require_free_space(scratch, context.limits.get("min_free_bytes", 0), BYTES_IN_BETWEEN * points)
        found = write_viewer_points(scratch / "blocks", cloud, ProgressSection(context.progress, 0.3, 1.0))
        context.blobs.put_file(blocks, scratch / "blocks")
        context.blobs.write_bytes(listed, json.dumps(found).encode())  # the last: where it is, the blocks are
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return {}
