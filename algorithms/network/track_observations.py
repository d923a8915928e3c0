"""Tracks as observations of the adjustment engine (MATH 6.4)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from algorithms.adjustment.observations.feature_tracks import FeatureTracks, TrackPart
from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.arrays import Array
from algorithms.network.tracks import Member, StationFeatures


class TrackKind(StrEnum):
    """What the members of a track are."""

    PLANE = "plane"
    LINE = "line"


@dataclass(frozen=True)
class Track:
    """An object of the building and the features that show it."""

    kind: TrackKind
    members: tuple[Member, ...]
    """Of different stations."""


@dataclass(frozen=True, eq=False)
class TrackGroup:
    """Tracks of one kind and one number of members."""

    numbers: tuple[int, ...]
    """Which of the given tracks they are."""
    observations: FeatureTracks


def grouped_observations(
    tracks: Sequence[Track], features: Mapping[int, StationFeatures], place: Mapping[int, int]
) -> list[TrackGroup]:
    """Lay tracks out as observations, by kind and number of members.

    The others are compared to the first member.

    Parameters
    ----------
    tracks
        Each with two members or more.
    features
        Of each station.
    place
        Number of each station's pose among the unknowns.
    """
    sorted_in: dict[tuple[TrackKind, int], list[int]] = {}
    for number, track in enumerate(tracks):
        sorted_in.setdefault((track.kind, len(track.members)), []).append(number)
    return [
        TrackGroup(tuple(numbers), _observations(kind, [tracks[k].members for k in numbers], features, place))
        for (kind, _), numbers in sorted(sorted_in.items())
    ]


def largest_first(kind: TrackKind, members: Sequence[Member], features: Mapping[int, StationFeatures]) -> Track:
    """Give the track whose first member is the largest piece.

    The others are compared to it; chosen so, the linearisation does not depend on how stations are numbered.
    """

    def size(member: Member) -> float:
        station, number = member
        of_station = features[station]
        sizes = of_station.planes.areas_m2 if kind is TrackKind.PLANE else of_station.lines.lengths
        return float(sizes[number])

    return Track(kind, tuple(sorted(members, key=lambda member: (-size(member), member))))


def _observations(
    kind: TrackKind,
    members: Sequence[tuple[Member, ...]],
    features: Mapping[int, StationFeatures],
    place: Mapping[int, int],
) -> FeatureTracks:
    table = np.array(members, dtype=np.int64)  # (n, k, 2)
    rows: dict[tuple[int, int], list[tuple[int, int, int, int]]] = {}
    for track, entries in enumerate(members):
        base, first = entries[0]
        for slot, (station, number) in enumerate(entries[1:], start=1):
            rows.setdefault((base, station), []).append((first, number, track, slot))
    parts = []
    for (base, station), entries_of_two in rows.items():
        columns = np.array(entries_of_two, dtype=np.int64)
        parts.append(
            TrackPart(_differences(kind, features, base, station, columns[:, :2], place), columns[:, 2], columns[:, 3])
        )
    stations = np.vectorize(place.__getitem__, otypes=[np.int64])(table[:, :, 0])
    covariances = tuple(_covariances(kind, features, table[:, slot]) for slot in range(table.shape[1]))
    return FeatureTracks(stations, tuple(parts), covariances)


def _differences(
    kind: TrackKind,
    features: Mapping[int, StationFeatures],
    base: int,
    station: int,
    pairs: Array,
    place: Mapping[int, int],
) -> LineLine | PlanePlane:
    ours, theirs = features[base], features[station]
    if kind is TrackKind.PLANE:
        return PlanePlane(ours.planes, theirs.planes, pairs, place[base], place[station])
    return LineLine(ours.lines, theirs.lines, pairs, place[base], place[station])


def _covariances(kind: TrackKind, features: Mapping[int, StationFeatures], members: Array) -> Array:
    """Give (n, 3, 3) or (n, 4, 4) of one feature of each track."""
    return np.array(
        [
            (features[s].planes if kind is TrackKind.PLANE else features[s].lines).covariances[k]
            for s, k in members.tolist()
        ]
    )
