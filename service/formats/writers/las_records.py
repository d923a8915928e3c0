"""Points as the records of LAS 1.4, which LAZ and COPC share."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from algorithms.arrays import Array, Vector3
from algorithms.scans.scan import ScalarField
from service.errors import UnwritableError
from service.formats import las_attributes as own
from service.formats.intensities import LARGEST_16_BIT, is_rescaled, sixteen_bit, unit_intensities
from service.formats.writers.base import PointPiece, StationCloud
from service.formats.writers.placed import PlacedClouds, in_world, scalar_of

SCALE_M = 1e-4
"""Resolution of the coordinates [m]."""
WITH_INFRARED, WITH_COLOR, PLAIN = 8, 7, 6
"""Point formats of LAS 1.4."""
STATIONS_USER, STATIONS_RECORD = "tieline", 1
"""The record with the names of the stations, as JSON."""
MOST_RETURNS = 15
"""Largest number in the bits of a return."""
FLAG_BITS = {
    **{field.name: bit for bit, field in enumerate(own.FLAGS)},
    own.CHANNEL.name: 4,
    own.DIRECTION.name: 6,
    own.EDGE.name: 7,
}
"""Bit at which each field stands in the byte of the flags (LAS 1.4 R15, table 16)."""
LAS_KINDS = {"u1": 1, "i1": 2, "u2": 3, "i2": 4, "u4": 5, "i4": 6, "f4": 9, "f8": 10}
"""Types of extra bytes (LAS 1.4 R15, table 24)."""


@dataclass(frozen=True, eq=False)
class LasLayout:
    """How the points of a file are stored."""

    point_format: int
    offset_m: Vector3
    """Near the data, whole metres [m]."""
    scalars: tuple[ScalarField, ...]
    """Extra bytes."""
    is_standard_time: bool = False
    """Whether times are adjusted standard GPS times, not of a week."""

    @staticmethod
    def of(clouds: PlacedClouds, what: str) -> "LasLayout":
        """Choose the layout for some clouds.

        Raises
        ------
        UnwritableError
            The points are so far apart that 32 bits do not reach from one to the other.
        """
        low_m, high_m = clouds.bounds_m()
        offset_m = np.round(0.5 * (low_m + high_m))
        half_m = float((0.5 * (high_m - low_m)).max()) + 1.0
        if half_m > SCALE_M * (2**31 - 1):
            raise UnwritableError(
                what, f"the points lie {2 * half_m / 1000:.0f} km apart; 32 bits of 0.1 mm reach 429 km"
            )
        names = {field.name for field in clouds.scalars}
        places = {field.name for field in own.OWN_FIELDS}
        is_standard_time = own.ADJUSTED_TIME.name in names
        if is_standard_time:
            places -= {own.WEEK_TIME.name}  # a file tells one kind of time
        extra = tuple(field for field in clouds.scalars if field.name not in places)
        plain = WITH_COLOR if clouds.has_color else PLAIN
        chosen = WITH_INFRARED if own.INFRARED.name in names else plain
        return LasLayout(chosen, offset_m, extra, is_standard_time)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of a record (LAS 1.4 R15, tables 15 and 16)."""
        fields: list[tuple[str, str]] = [
            ("X", "<i4"), ("Y", "<i4"), ("Z", "<i4"), ("intensity", "<u2"), ("returns", "u1"), ("flags", "u1"),
            ("classification", "u1"), ("user_data", "u1"), ("scan_angle", "<i2"), ("point_source_id", "<u2"),
            ("gps_time", "<f8"),
        ]  # fmt: skip
        if self.point_format >= WITH_COLOR:
            fields += [("red", "<u2"), ("green", "<u2"), ("blue", "<u2")]
        if self.point_format >= WITH_INFRARED:
            fields += [("nir", "<u2")]
        return np.dtype(fields + [(f"extra_{field.name}", f"<{field.kind}") for field in self.scalars])

    def records(self, number: int, cloud: StationCloud, piece: PointPiece) -> Array:
        """Give the records of a piece.

        Parameters
        ----------
        number
            Of the station, from 0: the `point_source_id` of points that have none of their own is one more.
        cloud, piece
            The station and its points.
        """
        records = np.zeros(len(piece), dtype=self.dtype)
        steps = in_world(cloud, piece, self.offset_m)
        steps /= SCALE_M
        np.rint(steps, out=steps)
        for axis, name in enumerate("XYZ"):
            records[name] = steps[:, axis]
        if piece.intensity is not None:
            limits = None if cloud.facts is None else cloud.facts.intensity_limits
            shares = unit_intensities(piece.intensity, limits, sixteen_bit(limits, cloud.intensity_scale))
            records["intensity"] = np.rint(shares * LARGEST_16_BIT)
        if piece.color is not None and self.point_format >= WITH_COLOR:
            for channel, (name, deep) in enumerate(zip(("red", "green", "blue"), own.COLORS_16, strict=True)):
                colors = piece.scalars.get(deep.name)
                records[name] = piece.color[:, channel].astype(np.uint16) * own.TO_16_BIT if colors is None else colors
        records["point_source_id"] = min(number + 1, 65535)
        self._put_attributes(records, piece)
        for field in self.scalars:
            records[f"extra_{field.name}"] = scalar_of(piece, field)
        return records

    def _put_attributes(self, records: Array, piece: PointPiece) -> None:
        """Write what records have a place for."""
        returns, count = (scalar_of(piece, field) for field in (own.RETURN_NUMBER, own.RETURNS))
        records["returns"] = np.minimum(returns, MOST_RETURNS) | (np.minimum(count, MOST_RETURNS) << 4)
        for name, bit in FLAG_BITS.items():
            if name in piece.scalars:
                records["flags"] |= np.asarray(piece.scalars[name], dtype=np.uint8) << bit
        for field in (own.CLASSIFICATION, own.USER_DATA, own.SOURCE, own.INFRARED):
            if field.name in piece.scalars and field.name in (records.dtype.names or ()):
                records[field.name] = piece.scalars[field.name]
        if own.SCAN_ANGLE.name in piece.scalars:
            records["scan_angle"] = np.rint(piece.scalars[own.SCAN_ANGLE.name] / own.ANGLE_STEP_DEG)
        time = own.ADJUSTED_TIME if self.is_standard_time else own.WEEK_TIME
        if time.name in piece.scalars:
            records["gps_time"] = piece.scalars[time.name]


def is_stretched_to_16_bits(cloud: StationCloud) -> bool:
    """Check whether records hold other intensities than the cloud."""
    limits = None if cloud.facts is None else cloud.facts.intensity_limits
    return is_rescaled(limits, sixteen_bit(limits, cloud.intensity_scale), LARGEST_16_BIT)


def names_record(clouds: Sequence[StationCloud]) -> bytes:
    """Give the names of the stations by their number, as JSON; cut to what a record holds."""
    names = [cloud.name for cloud in clouds]
    while len(content := json.dumps({"stations": names}).encode()) > 65535:
        names = names[: len(names) // 2]
    return content
