"""Points of several stations in the world frame, for formats that have no place for poses."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from algorithms.arrays import Array, Points, Vector3
from algorithms.progress import Progress
from algorithms.scans.scan import ScalarField
from service.formats.writers.base import STATION, PointPiece, StationCloud, surveyed

STATION_FIELD = ScalarField(STATION, "number of the station, from 0", "u2")


@dataclass(frozen=True, eq=False)
class PlacedClouds:
    """Clouds whose facts are known, and what a file for all of them needs."""

    clouds: tuple[StationCloud, ...]
    scalars: tuple[ScalarField, ...]
    """Of all clouds, each name once."""

    @property
    def points(self) -> int:
        """Number of points of all clouds."""
        return sum(cloud.facts.points for cloud in self.clouds if cloud.facts is not None)

    @property
    def has_intensity(self) -> bool:
        """Whether any cloud has intensities; those without get zeros."""
        return any(cloud.has_intensity for cloud in self.clouds)

    @property
    def has_color(self) -> bool:
        """Whether any cloud has colours; those without get black."""
        return any(cloud.has_color for cloud in self.clouds)

    @property
    def crs_wkt(self) -> str | None:
        """Coordinate reference system of the world frame."""
        return next((cloud.crs_wkt for cloud in self.clouds if cloud.crs_wkt), None)

    def bounds_m(self) -> tuple[Vector3, Vector3]:
        """Give a box around all points in the world frame [m]; that of the turned boxes, not the smallest."""
        corners = np.concatenate([_corners(cloud) for cloud in self.clouds])
        return corners.min(axis=0), corners.max(axis=0)

    def pieces(self, progress: Progress) -> Iterator[tuple[int, StationCloud, PointPiece]]:
        """Give all pieces with the number and the cloud of their station, and tell how far they are."""
        total, done = max(self.points, 1), 0
        for number, cloud in enumerate(self.clouds):
            for piece in cloud.pieces():
                progress.report(done / total, f"writing {cloud.name}" if cloud.name else "writing")
                if len(piece):
                    yield number, cloud, piece
                done += len(piece)


def placed(clouds: Sequence[StationCloud], *, with_stations: bool = False) -> PlacedClouds:
    """Survey clouds and collect their fields.

    Parameters
    ----------
    clouds
        Stations of one file.
    with_stations
        Whether each point gets the number of its station.
    """
    scalars = {field.name: field for cloud in clouds for field in cloud.scalars}
    if with_stations:
        numbered = tuple(_numbered(cloud, number) for number, cloud in enumerate(clouds))
        return PlacedClouds(tuple(map(surveyed, numbered)), (STATION_FIELD, *scalars.values()))
    return PlacedClouds(tuple(map(surveyed, clouds)), tuple(scalars.values()))


def in_world(cloud: StationCloud, piece: PointPiece, base_m: Vector3) -> Points:
    """Give the points in the world frame minus `base_m` [m].

    Large numbers are subtracted from each other before they meet the points: far origins cost no digits.
    """
    pose = cloud.pose
    shift_m = pose.rotation.apply(cloud.origin_m) + (pose.translation - base_m)
    if cloud.world_from_scan is None:
        return np.asarray(piece.points + shift_m)
    rotation = pose.rotation.as_matrix()
    placed_points = np.empty_like(piece.points)
    # column by column: a product of n by 3 with 3 by 3 costs more in threads than in work
    for axis in range(3):
        column = piece.points[:, 0] * rotation[axis, 0]
        column += piece.points[:, 1] * rotation[axis, 1]
        column += piece.points[:, 2] * rotation[axis, 2]
        column += shift_m[axis]
        placed_points[:, axis] = column
    return placed_points


def scalar_of(piece: PointPiece, scalar: ScalarField) -> Array:
    """Give the numbers of a field, those of points without it where the station has none."""
    values = piece.scalars.get(scalar.name)
    return np.full(len(piece), scalar.absent, scalar.kind) if values is None else np.asarray(values, scalar.kind)


def _numbered(cloud: StationCloud, number: int) -> StationCloud:
    def pieces() -> Iterator[PointPiece]:
        for piece in cloud.pieces():
            stations = np.full(len(piece), number, dtype=np.uint16)
            yield replace(piece, scalars={**piece.scalars, STATION: stations})

    return replace(cloud, pieces=pieces, scalars=(*cloud.scalars, STATION_FIELD))


def _corners(cloud: StationCloud) -> Points:
    facts = surveyed(cloud).facts
    if facts is None or facts.points == 0:
        return np.zeros((0, 3))
    sides = np.array([facts.low_m, facts.high_m])
    corners = np.array([[sides[i, 0], sides[j, 1], sides[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    return np.asarray(cloud.pose.apply(corners))
