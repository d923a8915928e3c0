"""Attributes of LAS points beside place, intensity and colour: classes, returns, flags, times, angles, extra bytes."""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from algorithms.arrays import Array
from algorithms.scans.scan import ScalarField
from service.formats.point_selection import OLD_FORMATS, overlapping

ANGLE_STEP_DEG = 0.006
"""Step of scan angles in point formats 6 to 10 (LAS 1.4 R15, table 15)."""
CLASSIFICATION = ScalarField("classification", "class of LAS", "u1")
RETURN_NUMBER = ScalarField("return_number", "number of the return", "u1", absent=1)
RETURNS = ScalarField("number_of_returns", "returns of the pulse", "u1", absent=1)
SCAN_ANGLE = ScalarField("scan_angle_deg", "scan angle [deg]")
SOURCE = ScalarField("point_source_id", "point source, the flight line", "u2")
USER_DATA = ScalarField("user_data", "user data", "u1")
WEEK_TIME = ScalarField("gps_time", "GPS time [s]", "f8")
ADJUSTED_TIME = ScalarField("adjusted_gps_time", "GPS time minus 1e9 s [s]", "f8")
"""Standard time, where `gps_time` counts from the begin of a week (LAS 1.4 R15, global encoding)."""
INFRARED = ScalarField("nir", "near infrared", "u2")
FLAGS = tuple(
    ScalarField(name, description, "u1")
    for name, description in (
        ("synthetic", "1: synthetic"),
        ("key_point", "1: key point"),
        ("withheld", "1: withheld"),
        ("overlap", "1: overlap of strips"),
    )
)
CHANNEL = ScalarField("scanner_channel", "channel of the scanner", "u1")
DIRECTION = ScalarField("scan_direction_flag", "direction of the mirror", "u1")
EDGE = ScalarField("edge_of_flight_line", "1: edge of the flight line", "u1")
COLORS_16 = tuple(ScalarField(f"{name}_16", f"{name} in 16 bits", "u2") for name in ("red", "green", "blue"))
"""Colours whose lower bits say something."""
OWN_FIELDS = (
    CLASSIFICATION, RETURN_NUMBER, RETURNS, SCAN_ANGLE, SOURCE, USER_DATA, WEEK_TIME, ADJUSTED_TIME, INFRARED, *FLAGS,
    CHANNEL, DIRECTION, EDGE, *COLORS_16,
)  # fmt: skip
"""Fields for which records of LAS have a place."""
KINDS = {"u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"}
"""Types of extra bytes that are kept."""
TO_16_BIT = 257
"""Colours of 8 bits in 16."""
LONGEST_NAME = 32
"""Characters of the name of an extra byte."""
TAKEN = {
    *(field.name for field in OWN_FIELDS),
    *("x", "y", "z", "intensity", "red", "green", "blue", "row", "column", "return_number", "scan_angle", "synthetic"),
}
"""Names that columns of some format have already."""
STATION = "station"
"""Number of the station, which files of this service have and get anew."""


def attributes_of(chunk: Any, header: Any) -> Iterator[tuple[ScalarField, Array]]:
    """Yield the attributes (n,) of points that say something: not all are as where there is no such attribute.

    Parameters
    ----------
    chunk, header
        Point record and header of laspy.
    """
    for field, values in _found(chunk, header):
        if len(values) and (values != field.absent).any():
            yield field, values.astype(field.kind)


def lost_attributes(header: Any) -> list[str]:
    """Return what a file has of each point and nobody keeps."""
    lost = [f"{each.name} (64-bit integers)" for each in _extra(header) if _kind(each) not in KINDS]
    if "wavepacket_offset" in header.point_format.dimension_names:
        lost.append("waveforms")
    return lost


def _found(chunk: Any, header: Any) -> Iterator[tuple[ScalarField, Array]]:
    names, is_old = set(chunk.point_format.standard_dimension_names), chunk.point_format.id < OLD_FORMATS
    classes = np.asarray(chunk["classification"])
    yield CLASSIFICATION, classes
    for field in (RETURN_NUMBER, RETURNS):
        # zero is no number of a return: writers leave it where they do not count
        yield field, np.maximum(np.asarray(chunk[field.name]), 1)
    angle = np.asarray(chunk["scan_angle_rank"], dtype=np.float64) if is_old else chunk["scan_angle"] * ANGLE_STEP_DEG
    yield SCAN_ANGLE, np.asarray(angle)
    if "gps_time" in names:
        standard = int(header.global_encoding.gps_time_type) == 1
        yield ADJUSTED_TIME if standard else WEEK_TIME, np.asarray(chunk["gps_time"])
    for field in (SOURCE, USER_DATA, INFRARED, *FLAGS, CHANNEL, DIRECTION, EDGE):
        if is_old and field.name == "overlap":
            yield field, overlapping(chunk, classes)
        elif field.name in names:
            yield field, np.asarray(chunk[field.name])
    if "red" in names:
        channels = [np.asarray(chunk[name]) for name in ("red", "green", "blue")]
        if any((each % TO_16_BIT).any() for each in channels) and max(int(each.max()) for each in channels) > 255:
            yield from zip(COLORS_16, channels, strict=True)
    yield from _extra_bytes(chunk, header)


def _extra_bytes(chunk: Any, header: Any) -> Iterator[tuple[ScalarField, Array]]:
    taken, titles = set(TAKEN), set()
    for dimension in _extra(header):
        kind = _kind(dimension)
        if kind not in KINDS or dimension.name == STATION:
            continue
        values = np.asarray(chunk[dimension.name]).reshape(len(chunk), -1)
        for element in range(values.shape[1]):
            title = str(dimension.name)
            if values.shape[1] > 1:
                title = f"{title[: LONGEST_NAME - 4]}_{element}"
            plain, number = re.sub(r"[^a-z0-9_]", "_", title.lower())[: LONGEST_NAME - 4] or "extra", 1
            name = plain
            while name in taken:
                number += 1
                name = f"{plain}_{number}"
            taken.add(name)
            if not title.isascii() or title.lower() in TAKEN or title in titles:
                title = ""
            titles.add(title)
            described = str(dimension.description).encode("ascii", "replace").decode()[:32]
            yield ScalarField(name, described, kind, title=title), values[:, element]


def _extra(header: Any) -> list[Any]:
    return list(header.point_format.extra_dimensions)


def _kind(dimension: Any) -> str:
    """Return the type of numpy in which real values of extra bytes are kept."""
    return "f8" if dimension.is_scaled else str(dimension.dtype.base.str[1:]) if dimension.dtype is not None else ""
