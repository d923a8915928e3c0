"""Tracks as observations of the adjustment engine (MATH 6.4)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations.feature_tracks import FeatureTracks, MountShare
from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.adjustment.observations.point_point import PointPoint
from algorithms.adjustment.observations.relative_poses import RelativePoses
from algorithms.arrays import Array
from algorithms.geometry.lines import Lines, lines_from_arrays
from algorithms.geometry.planes import Planes
from algorithms.geometry.point_sets import PointSet
from algorithms.network.tracks import Member, StationFeatures


class TrackKind(StrEnum):
    """What the members of a track are."""

    PLANE = "plane"
    LINE = "line"
    POINT = "point"
    """A survey target."""


@dataclass(frozen=True)
class Track:
    """An object of the building and the features that show it."""

    kind: TrackKind
    members: tuple[Member, ...]
    """Of different stations; the others are compared to the first one."""


@dataclass(frozen=True, eq=False)
class TrackGroup:
    """Tracks of one kind and one number of members."""

    numbers: tuple[int, ...]
    """Which of the given tracks they are."""
    observations: FeatureTracks


class TrackLayout:
    """The features of all stations of an adjustment, laid out so that tracks become observations.

    Parameters
    ----------
    features
        Of each station, in its reduced frame.
    stations
        In the order of their poses among the unknowns; the first one is fixed.
    tracks
        All that will be asked for, or more.
    """

    def __init__(
        self, features: Mapping[int, StationFeatures], stations: Sequence[int], tracks: Sequence[Track]
    ) -> None:
        self._place = {station: k for k, station in enumerate(stations)}
        self._planes = Planes.joined([features[station].planes for station in stations])
        self._first_plane = _starts([len(features[station].planes) for station in stations])
        self._first_line = _starts([len(features[station].lines) for station in stations])
        self._first_point = _starts([len(features[station].targets) for station in stations])
        sets = [features[station].targets.points for station in stations]
        self._points = PointSet(
            np.concatenate([each.coordinates for each in sets]), np.concatenate([each.covariances for each in sets])
        )
        mounts = _mounts_in(features, tracks)
        self._mount_covariances = [features[station].photo_covariances[photo] for station, photo in mounts]
        numbers = {mount: len(stations) + k for k, mount in enumerate(mounts)}
        columns = [_line_columns(features[station], station, numbers) for station in stations]
        anchors, directions, bases, covariances, extents, self._line_mounts, self._by_mounts = (
            np.concatenate(parts) for parts in zip(*columns, strict=True)
        )
        self._lines = lines_from_arrays(anchors, directions, covariances, extents, bases=bases)

    @property
    def mount_count(self) -> int:
        """Number of mounts of photos whose errors are unknowns; their poses come after those of the stations."""
        return len(self._mount_covariances)

    def mount_observations(self) -> RelativePoses:
        """Observe each mount's error as zero, with the mount's covariance (MATH 2.5)."""
        count = self.mount_count
        return RelativePoses(
            np.zeros(count, dtype=np.int64),
            len(self._place) + np.arange(count, dtype=np.int64),
            RigidTransform.identity(count),
            np.array(self._mount_covariances),
        )

    def grouped(self, tracks: Sequence[Track]) -> list[TrackGroup]:
        """Lay tracks out as observations, by kind and number of members.

        Parameters
        ----------
        tracks
            Each with two members or more.
        """
        sorted_in: dict[tuple[TrackKind, int], list[int]] = {}
        for number, track in enumerate(tracks):
            sorted_in.setdefault((track.kind, len(track.members)), []).append(number)
        return [
            TrackGroup(tuple(numbers), self._observations(kind, [tracks[k].members for k in numbers]))
            for (kind, _), numbers in sorted(sorted_in.items())
        ]

    def _observations(self, kind: TrackKind, members: Sequence[tuple[Member, ...]]) -> FeatureTracks:
        stations = np.array([[self._place[station] for station, _ in entry] for entry in members], dtype=np.int64)
        first = {
            TrackKind.PLANE: self._first_plane,
            TrackKind.LINE: self._first_line,
            TrackKind.POINT: self._first_point,
        }[kind]
        rows = first[stations] + np.array([[number for _, number in entry] for entry in members], dtype=np.int64)
        k = rows.shape[1]
        targets, sources = np.repeat(rows[:, 0], k - 1), rows[:, 1:].ravel()
        pairs = np.repeat(np.arange(len(sources), dtype=np.int64)[:, None], 2, axis=1)
        if kind is TrackKind.PLANE:
            planes = PlanePlane(
                self._planes.without_boundaries(targets), self._planes.without_boundaries(sources), pairs
            )
            return FeatureTracks(stations, planes, tuple(self._planes.covariances[rows[:, j]] for j in range(k)))
        if kind is TrackKind.POINT:
            points = PointPoint(self._points[targets], self._points[sources], pairs)
            return FeatureTracks(stations, points, tuple(self._points.covariances[rows[:, j]] for j in range(k)))
        lines = LineLine(self._lines[targets], self._lines[sources], pairs)
        return FeatureTracks(
            stations, lines, tuple(self._lines.covariances[rows[:, j]] for j in range(k)), self._shares(rows)
        )

    def _shares(self, rows: Array) -> tuple[MountShare, ...]:
        """Give what members share with the mounts of the photos that show them."""
        shares = []
        for member in range(rows.shape[1]):
            for which in range(self._line_mounts.shape[1]):
                mounts = self._line_mounts[rows[:, member], which]
                if (mounts >= 0).any():
                    # lines of no photo refer to the fixed station, with derivatives that are zero
                    numbers = np.maximum(mounts, 0)
                    shares.append(MountShare(member, numbers, self._by_mounts[rows[:, member], which]))
        return tuple(shares)


def largest_first(kind: TrackKind, members: Sequence[Member], features: Mapping[int, StationFeatures]) -> Track:
    """Give the track whose first member is the largest piece, of targets the most precise one.

    The others are compared to it; chosen so, the linearisation does not depend on how stations are numbered.
    """

    def size(member: Member) -> float:
        station, number = member
        of_station = features[station]
        if kind is TrackKind.POINT:
            return -float(np.trace(of_station.targets.points.covariances[number]))
        sizes = of_station.planes.areas_m2 if kind is TrackKind.PLANE else of_station.lines.lengths
        return float(sizes[number])

    return Track(kind, tuple(sorted(members, key=lambda member: (-size(member), member))))


def _starts(counts: Sequence[int]) -> Array:
    return np.concatenate([[0], np.cumsum(counts[:-1])]).astype(np.int64)


def _mounts_in(features: Mapping[int, StationFeatures], tracks: Sequence[Track]) -> list[tuple[int, int]]:
    """Give station and photo of all mounts that lines of tracks depend on."""
    found: set[tuple[int, int]] = set()
    for track in tracks:
        if track.kind is TrackKind.LINE:
            for station, number in track.members:
                lines = features[station].lines
                found |= {
                    (station, int(photos[number]))
                    for photos in (lines.photos, lines.second_photos)
                    if photos is not None and photos[number] >= 0
                }
    return sorted(found)


def _line_columns(
    features: StationFeatures, station: int, mounts: Mapping[tuple[int, int], int]
) -> tuple[Array, Array, Array, Array, Array, Array, Array]:
    """Give a station's lines column by column, the mounts they depend on (n, 2), and how (n, 2, 4, 6).

    The covariances come without the part of those mounts.
    """
    lines: Lines = features.lines
    count = len(lines)
    numbers, by_mounts = np.full((count, 2), -1, dtype=np.int64), np.zeros((count, 2, 4, 6))
    covariances = lines.covariances.copy()
    for which, (photos, jacobians) in enumerate(
        ((lines.photos, lines.photo_jacobians), (lines.second_photos, lines.second_photo_jacobians))
    ):
        if photos is None or jacobians is None:
            continue
        for photo in np.unique(photos[photos >= 0]).tolist():
            number = mounts.get((station, photo))
            if number is None:
                continue
            shown = photos == photo
            numbers[shown, which] = number
            by_mount = jacobians[shown]
            by_mounts[shown, which] = by_mount
            mount = features.photo_covariances[photo]
            covariances[shown] -= by_mount @ mount @ np.swapaxes(by_mount, 1, 2)
    return lines.anchors, lines.directions, lines.bases, covariances, lines.extents, numbers, by_mounts
