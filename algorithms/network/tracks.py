"""Which features of many stations are one plane or line of the building, or one target (MATH 6.4)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Vector3
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.lines import Lines, LineSource
from algorithms.geometry.planes import Planes
from algorithms.network.links import StationLink
from algorithms.scans.instrument_errors import Sweep
from algorithms.targets.common_points import TargetSet

Member: TypeAlias = tuple[int, int]
"""Station and number of its plane, line or target."""

SAME_NORMAL_COSINE = np.cos(np.radians(15.0))
"""Planes of corresponding edges whose normals differ by more are not each other's partners."""


@dataclass(frozen=True, eq=False)
class StationFeatures:
    """What a network needs of a station's features, in its reduced frame."""

    planes: Planes
    lines: Lines
    photo_covariances: Float64[Array, "photos 6 6"] = field(default_factory=lambda: np.zeros((0, 6, 6)))
    """(q, 6, 6) of the mount of each photo that `Lines.photos` counts (MATH 2.5)."""
    plane_responses: Float64[Array, "p 3 11"] | None = None
    """(p, 3, 11) how planes answer to errors of the instrument and of the tripod (MATH 6.8); None: not known."""
    sensor_m: Vector3 | None = None
    """Where the instrument stood; None: not known."""
    sweep: Sweep | None = None
    """When it looked where; None: not known."""
    targets: TargetSet = field(default_factory=TargetSet.none)
    """Survey targets that were measured there."""

    @staticmethod
    def of_features(features: ScanFeatures, targets: TargetSet | None = None) -> "StationFeatures":
        """Keep planes and lines, and targets of the station, and forget the rest."""
        return StationFeatures(
            planes=features.planes,
            lines=features.lines,
            photo_covariances=features.photo_covariances,
            plane_responses=features.plane_responses,
            sensor_m=features.sensor_m,
            sweep=features.sweep,
            targets=TargetSet.none() if targets is None else targets,
        )


@dataclass(frozen=True, eq=False)
class Tracks:
    """Features that are the same object, station by station."""

    planes: tuple[tuple[Member, ...], ...]
    """Each a plane of the building: members of different stations, two or more."""
    lines: tuple[tuple[Member, ...], ...]
    """The same of lines that are no intersections of planes: pipes, edges of photos."""
    conflicts: int
    """Correspondences that would have made two features of one station the same object; they are not used."""
    edges: int
    """Corresponding intersections of planes, which stand in the network as their planes."""
    lost_edges: int
    """Those of them of which a plane fell to a conflict."""
    points: tuple[tuple[Member, ...], ...] = ()
    """The same of survey targets, where they take part."""


def build_tracks(
    features: Mapping[int, StationFeatures], links: Sequence[StationLink], poses: Mapping[int, RigidTransform]
) -> Tracks:
    """Join corresponding features of registered pairs to objects that many stations see (MATH 6.4).

    An edge is where two planes meet: what its correspondence says, it says through the planes, which therefore
    correspond too. So planes are joined first by their own correspondences, large ones first, then by those of
    edges. A correspondence that would put two features of one station into one object is left out. The result does not
    depend on the order of stations and pairs. O(c log c) for c correspondences.

    Parameters
    ----------
    features
        Of each station.
    links
        Registrations with their correspondences.
    poses
        Start values of the stations' poses in a common frame; they tell which planes of two edges belong together.
    """
    planes = _Joining()
    for _, first, second in sorted(_plane_pairs(features, links), key=lambda entry: entry[0]):
        planes.join(first, second)
    direct = planes.refused
    edges = list(_edge_planes(features, links, poses))
    for _, pairs in sorted(edges, key=lambda entry: entry[0]):
        for first, second in pairs:
            planes.join(first, second)
    lost = sum(any(not planes.together(*pair) for pair in pairs) for _, pairs in edges)
    lines = _Joining()
    for _, first, second in sorted(_line_pairs(features, links), key=lambda entry: entry[0]):
        lines.join(first, second)
    return Tracks(planes.groups(), lines.groups(), direct + lines.refused, len(edges), lost)


class _Joining:
    """Union of features, at most one of each station in a group."""

    def __init__(self) -> None:
        self._group: dict[Member, int] = {}
        self._members: dict[int, dict[int, Member]] = {}
        self.refused = 0

    def join(self, first: Member, second: Member) -> None:
        """Make two features one object, unless a station would then see it twice."""
        ours, theirs = (self._group_of(member) for member in (first, second))
        if ours == theirs:
            return
        a, b = self._members[ours], self._members[theirs]
        if a.keys() & b.keys():
            self.refused += 1
            return
        a.update(b)
        for member in b.values():
            self._group[member] = ours
        del self._members[theirs]

    def together(self, first: Member, second: Member) -> bool:
        """Say whether two features are one object."""
        return first in self._group and self._group[first] == self._group.get(second)

    def groups(self) -> tuple[tuple[Member, ...], ...]:
        """Give all objects that two or more stations see."""
        found = (tuple(sorted(group.values())) for group in self._members.values() if len(group) > 1)
        return tuple(sorted(found))

    def _group_of(self, member: Member) -> int:
        if member not in self._group:
            number = len(self._group)
            self._group[member] = number
            self._members[number] = {member[0]: member}
        return self._group[member]


Ranked: TypeAlias = tuple[float, Member, Member]
"""Rank (large features first) and the two features."""


def _plane_pairs(features: Mapping[int, StationFeatures], links: Sequence[StationLink]) -> list[Ranked]:
    pairs: list[Ranked] = []
    for link in links:
        ours, theirs = features[link.target].planes, features[link.source].planes
        pairs += [
            (-float(min(ours.areas_m2[i], theirs.areas_m2[j])), (link.target, i), (link.source, j))
            for i, j in link.planes.tolist()
        ]
    return pairs


def _line_pairs(features: Mapping[int, StationFeatures], links: Sequence[StationLink]) -> list[Ranked]:
    """Give corresponding lines of which at least one is no intersection of planes."""
    pairs: list[Ranked] = []
    for link in links:
        ours, theirs = features[link.target].lines, features[link.source].lines
        pairs += [
            (-float(min(ours.lengths[i], theirs.lengths[j])), (link.target, i), (link.source, j))
            for i, j in link.lines.tolist()
            if not (_is_edge(ours, i) and _is_edge(theirs, j))
        ]
    return pairs


def _edge_planes(
    features: Mapping[int, StationFeatures], links: Sequence[StationLink], poses: Mapping[int, RigidTransform]
) -> list[tuple[float, tuple[tuple[Member, Member], tuple[Member, Member]]]]:
    """Give for each pair of corresponding edges its rank and the two pairs of planes that belong together."""
    found = []
    for link in links:
        ours, theirs = features[link.target], features[link.source]
        turn = poses[link.target].rotation.inv() * poses[link.source].rotation
        normals = turn.apply(theirs.planes.normals)
        for i, j in link.lines.tolist():
            if not (_is_edge(ours.lines, i) and _is_edge(theirs.lines, j)):
                continue
            a, b = ours.lines.parents[i].tolist(), theirs.lines.parents[j].tolist()
            cosines = ours.planes.normals[a] @ normals[b].T
            straight = min(cosines[0, 0], cosines[1, 1])
            crossed = min(cosines[0, 1], cosines[1, 0])
            if max(straight, crossed) < SAME_NORMAL_COSINE:
                continue
            if crossed > straight:
                b = b[::-1]
            pairs = (
                ((link.target, a[0]), (link.source, b[0])),
                ((link.target, a[1]), (link.source, b[1])),
            )
            found.append((-float(min(ours.lines.lengths[i], theirs.lines.lengths[j])), pairs))
    return found


def _is_edge(lines: Lines, number: int) -> bool:
    return bool(lines.sources[number] == LineSource.PLANE_INTERSECTION and (lines.parents[number] >= 0).all())
