"""What a file document tells about a scan that is never whole in memory: every record is read, piece by piece."""

from dataclasses import replace

import numpy as np

from algorithms.scans.content_sums import ContentSums
from service.formats.base import LargeScan, ReadLimits, ScanFile, ScanInfo, ScanReader
from service.formats.finishing import finish, in_metres, none_left, scan_info, with_reading
from service.formats.streaming import Survey, usable
from service.formats.thinned import Thinned

WARNED_OF = 3_000_000
"""Of about so many points it is told what looks wrong with the scan."""


def surveyed_info(file: ScanFile, reader: ScanReader, limits: ReadLimits, large: LargeScan) -> ScanInfo:
    """Describe a large scan as `scan_info` describes others; warnings are of an even part of it.

    Raises
    ------
    UnreadableFileError
        The scan cannot be used.
    """
    place = f"scan {large.index}"
    survey, sums, kept = Survey(), ContentSums(), None
    for piece in reader.pieces(file, limits, large.index):
        kept = Thinned(file, piece, large.records, WARNED_OF) if kept is None else kept
        kept.take(piece)
        measured = usable(in_metres(file, piece, place))
        survey.see(measured)
        sums.add(measured.points, np.zeros(3) if measured.base_m is None else measured.base_m)
    if kept is None or survey.first is None or survey.points == 0:
        none = none_left(survey.left_out) if survey.left_out else "no point of the scan has finite coordinates"
        raise file.unreadable(none, place)
    survey.refuse_absurd(file, place)
    part = scan_info(large.index, finish(file, kept.joined()), 0)
    grid = survey.grid
    whole = replace(
        part,
        points=survey.points,
        dropped=large.records - survey.points,
        structured=grid is not None,
        rows=None if grid is None else grid.rows,
        columns=None if grid is None else grid.columns,
        bounds_m=np.stack([survey.low_m, survey.high_m]),
        has_intensity=survey.has_intensity,
        has_color=survey.has_color,
        content=sums.content,
    )
    read = replace(
        survey.first, gps_time_s=survey.gps_time_s, left_out=survey.left_out, point_sources=survey.point_sources
    )
    return with_reading(whole, read)
