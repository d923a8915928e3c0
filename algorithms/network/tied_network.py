"""All stations of a job with their targets, what scans say of them, and control: which point is which, one adjustment.

Stations that scans register together are one group with one set of points. Groups are laid on each other, and on the
control, by three points or more in common, by names or distances (`common_points`); then everything is adjusted at once
(`adjust_tied_stations`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.hybrid.closed_forms import robust_similarity, spread_in_plane
from algorithms.adjustment.hybrid.joint_poses import JointPoses, joint_poses
from algorithms.adjustment.hybrid.tied_results import TiedAdjustment
from algorithms.adjustment.hybrid.tied_stations import KnownPoints, SeenPoints, TiedStations, adjust_tied_stations
from algorithms.arrays import Array, Flags
from algorithms.errors import TooFewCorrespondencesError
from algorithms.geometry.point_sets import PointSet
from algorithms.geometry.poses import PoseEstimate
from algorithms.targets.common_points import TargetSet, common_points

LEAST_COMMON = 3
LARGEST_SIGMA0 = 5.0
"""Standard deviations that promise more than so many times too much are no longer a matter of precision."""
UPRIGHT = np.cos(np.radians(3.0))
"""Cosine of the lean within which instruments stand upright: a tribrach is levelled better, a hand's set-up hardly."""
MIRROR, MIRRORED_STDS = np.array([1.0, -1.0, 1.0]), 5.0
MIRRORED = (
    "the control is the mirror image of what the stations see: north and east are swapped (`control_axes` says which "
    "comes first), or another axis is turned round, such as heights that count downwards"
)
SAME_SIGMAS, LEAST_SAME_M = 4.0, 0.005
"""Points of registered stations within so many standard deviations, and at least so far, may be the same target."""


@dataclass(frozen=True, eq=False)
class RegisteredGroup:
    """Stations that scans register together."""

    base: int
    """Station in whose reduced frame the poses are."""
    poses: Mapping[int, RigidTransform]
    """Base from station of the others."""
    covariance: Array
    """(6 k, 6 k) of these poses in their order."""

    @property
    def stations(self) -> tuple[int, ...]:
        """All of them, the base first."""
        return (self.base, *self.poses)

    def estimate(self, station: int) -> PoseEstimate:
        """Give the pose of one station with its own covariance."""
        if station == self.base:
            return PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))
        own = slice(6 * list(self.poses).index(station), 6 * list(self.poses).index(station) + 6)
        return PoseEstimate(self.poses[station], self.covariance[own, own])


@dataclass(frozen=True, eq=False)
class KnownTargets:
    """Points with known coordinates, relative to an origin near them."""

    targets: TargetSet
    is_check: Flags
    """(m,) True for those that take no part."""


@dataclass(frozen=True, eq=False)
class TiedNetwork:
    """Adjusted stations, and which target is which point."""

    stations: tuple[int, ...]
    """Numbers of the stations in the order of the adjustment."""
    adjustment: TiedAdjustment
    in_control_frame: bool
    points: Mapping[tuple[int, int], int]
    """Number of the point of a target, by station and number of the target there; single ones are missing."""
    observations: Mapping[tuple[int, int], int]
    """Number of the observation in `adjustment.seen` likewise."""
    control: Mapping[int, int]
    """Number of the point of a control or check point that stations see."""
    control_observations: Mapping[int, int]
    """Number of the observation in `adjustment.control` of a control point."""
    scanned: tuple[tuple[int, ...], ...]
    """Numbers of the stations of each observation in `adjustment.scans`."""
    remarks: tuple[str, ...]


@dataclass(eq=False)
class _World:
    """Points and groups that were placed so far."""

    coordinates: list[Array] = field(default_factory=list)
    covariances: list[Array] = field(default_factory=list)
    names: list[str | None] = field(default_factory=list)
    members: list[list[tuple[int, int]]] = field(default_factory=list)
    """Station and target of each point."""
    poses: dict[int, RigidTransform] = field(default_factory=dict)

    def as_set(self) -> TargetSet:
        return TargetSet(
            tuple(self.names),
            PointSet(np.array(self.coordinates).reshape(-1, 3), np.array(self.covariances).reshape(-1, 3, 3)),
        )

    def move(self, motion: RigidTransform) -> None:
        turn = motion.rotation.as_matrix()
        self.coordinates = [motion.apply(each) for each in self.coordinates]
        self.covariances = [turn @ each @ turn.T for each in self.covariances]
        self.poses = {station: motion * pose for station, pose in self.poses.items()}


def tied_network(
    targets: Mapping[int, TargetSet], groups: Sequence[RegisteredGroup], control: KnownTargets | None, first: int = 0
) -> TiedNetwork:
    """Find which target is which, lay all on each other and on the control, and adjust everything at once.

    Parameters
    ----------
    targets
        Of the stations that have some, in their reduced frames.
    groups
        What scans say; no station is in two of them. Stations in none stand for themselves.
    control
        Known points; None: the first station carries the frame.
    first
        That station.

    Raises
    ------
    TooFewCorrespondencesError
        Too few control points are seen.
    DegenerateGeometryError
        The points leave a pose free.
    """
    grouped = {station for group in groups for station in group.stations}
    alone = [
        RegisteredGroup(station, {}, np.zeros((0, 0)))
        for station in sorted({first, *targets})
        if station not in grouped
    ]
    parts = sorted([*groups, *alone], key=lambda group: (first not in group.stations, group.stations))
    sets = [_points_of(group, targets) for group in parts]
    holds = control is not None and bool((~control.is_check).any())
    world, placed, remarks, why = _World(), set[int](), list[str](), ""
    for seed in range(len(parts) if holds else 1):
        world, placed = _grown(parts, sets, [seed], _copied(sets[seed]))
        if control is None or not holds:
            break
        why = _onto_control(world, control)
        if not why:
            world, placed = _grown(parts, sets, sorted(placed), world)
            break
    if holds and why:
        raise TooFewCorrespondencesError(0, LEAST_COMMON, f"control points among the targets ({why})")
    if control is not None and not holds:
        why = _onto_control(world, control)
        remarks += [f"the check points are not found among the targets: {why}"] if why else []
    return _adjusted(world, [parts[k] for k in sorted(placed)], targets, control, holds=holds, remarks=remarks)


def doubts_of_control(tied: TiedNetwork, control: KnownTargets) -> tuple[str, ...]:
    """Return why the control does not place the stations, in words; empty where it does.

    Most of it was left out, residuals lie far beyond all standard deviations, or its mirror image fits better.

    Parameters
    ----------
    tied
        From `tied_network`, with control.
    control
        As it was given there.
    """
    found = tied.adjustment
    used, given = int(found.control.used.sum()), len(found.control.used)
    if not given:
        return ()
    doubts = []
    if given > LEAST_COMMON and 2 * used <= given:
        doubts.append(f"only {used} of {given} control points agree with each other and the scans")
    if found.sigma0 is not None and found.sigma0 > LARGEST_SIGMA0:
        doubts.append(f"the residuals are {found.sigma0:.3g} times what the standard deviations promise")
    numbers = np.array(list(tied.control_observations), dtype=np.int64)
    known = control.targets.points[numbers]
    seen = found.points[[tied.control[number] for number in numbers.tolist()]]
    scale, turn, shift = robust_similarity(seen * MIRROR, known.coordinates)
    missed = np.linalg.norm((scale * seen * MIRROR) @ turn.T + shift - known.coordinates, axis=1)
    stds = np.sqrt(np.trace(known.covariances, axis1=1, axis2=2))
    agreeing = int((missed <= MIRRORED_STDS * stds + LEAST_SAME_M).sum())
    # three points have two poses, mirrored and not; in one of them instruments stand upright, or would but for heights
    # that count downwards or axes in another order
    axes = np.array([pose.rotation.as_matrix()[:, 2] for pose in found.poses])
    leans = bool((axes[:, 2] < UPRIGHT).all())
    stands = bool((np.abs((axes * MIRROR) @ turn.T).max(axis=1) > UPRIGHT).all())
    if agreeing > used or (agreeing == used and leans and stands):
        doubts.insert(0, MIRRORED)
    return tuple(doubts)


def same_targets(targets: Mapping[int, TargetSet], group: RegisteredGroup) -> tuple[tuple[tuple[int, int], ...], ...]:
    """Say which targets of stations that scans register together are one point that two of them or more see.

    Parameters
    ----------
    targets
        Of the stations that have some, in their reduced frames; their covariances say how far apart one point may lie.
    group
        The stations.

    Returns
    -------
    Of each such point station and number of its targets, at most one of a station.
    """
    return tuple(tuple(sorted(members)) for members in _points_of(group, targets).members if len(members) > 1)


def _points_of(group: RegisteredGroup, targets: Mapping[int, TargetSet]) -> _World:
    """Merge the targets of stations that scans register together, in the frame of their base."""
    merged = _World()
    for station in group.stations:
        pose = group.estimate(station)
        merged.poses[station] = pose.target_from_source
        own = targets.get(station, TargetSet.none())
        turn = pose.rotation.as_matrix()
        places = pose.target_from_source.apply(own.points.coordinates) if len(own) else np.zeros((0, 3))
        spreads = [
            turn @ covariance @ turn.T + pose.position_covariance_m2(place)
            for place, covariance in zip(places, own.points.covariances, strict=True)
        ]
        same = _same_places(merged, own.names, places, spreads)
        for k, (place, spread) in enumerate(zip(places, spreads, strict=True)):
            _put(merged, same.get(k), place, spread, own.names[k], [(station, k)])
    return merged


def _same_places(known: _World, names: Sequence[str | None], places: Array, spreads: Sequence[Array]) -> dict[int, int]:
    """Say which of the targets are points that are known already: by name, else the nearest of each other."""
    found = {k: known.names.index(name) for k, name in enumerate(names) if name is not None and name in known.names}
    if not known.coordinates or not len(places):
        return found
    apart = np.linalg.norm(places[:, None] - np.array(known.coordinates)[None], axis=2)
    own = np.array([np.trace(each) for each in spreads])
    limits = np.maximum(
        SAME_SIGMAS * np.sqrt(own[:, None] + np.trace(known.covariances, axis1=1, axis2=2)), LEAST_SAME_M
    )
    near = np.where(apart <= limits, apart, np.inf)
    for k, name in enumerate(names):
        best = int(np.argmin(near[k]))
        if k in found or not np.isfinite(near[k, best]) or int(np.argmin(near[:, best])) != k:
            continue
        other = known.names[best]
        if best not in found.values() and (name is None or other is None):
            found[k] = best
    return found


def _put(
    world: _World, at: int | None, place: Array, spread: Array, name: str | None, members: list[tuple[int, int]]
) -> None:
    if at is None:
        world.coordinates.append(place)
        world.covariances.append(spread)
        world.names.append(name)
        world.members.append(list(members))
        return
    world.names[at] = world.names[at] or name
    world.members[at] += members


def _copied(merged: _World) -> _World:
    world = _World()
    world.poses.update(merged.poses)
    for k, place in enumerate(merged.coordinates):
        _put(world, None, place, merged.covariances[k], merged.names[k], merged.members[k])
    return world


def _grown(
    parts: Sequence[RegisteredGroup], sets: Sequence[_World], placed: Sequence[int], world: _World
) -> tuple[_World, set[int]]:
    """Place groups that have three points in common with what is placed, those with the most first."""
    done = set(placed)
    while True:
        found: list[tuple[int, int, Array]] = []
        for k in range(len(parts)):
            if k not in done and len(sets[k].coordinates) >= LEAST_COMMON:
                pairs = common_points(world.as_set(), sets[k].as_set()).pairs
                if len(pairs) >= LEAST_COMMON and spread_in_plane(sets[k].as_set().points.coordinates[pairs[:, 1]]):
                    found.append((-len(pairs), k, pairs))
        if not found:
            return world, done
        _, k, pairs = min(found, key=lambda each: each[:2])
        own = sets[k]
        motion = _motion(own.as_set().points.coordinates[pairs[:, 1]], world.as_set().points.coordinates[pairs[:, 0]])
        turn = motion.rotation.as_matrix()
        at = {int(theirs): int(ours) for ours, theirs in pairs}
        for place in range(len(own.coordinates)):
            _put(
                world, at.get(place), motion.apply(own.coordinates[place]), turn @ own.covariances[place] @ turn.T,
                own.names[place], own.members[place],
            )  # fmt: skip
        world.poses.update({station: motion * pose for station, pose in own.poses.items()})
        done.add(k)


def _onto_control(world: _World, control: KnownTargets) -> str:
    """Move everything onto the known points, which join it; give what hinders that, or nothing."""
    common = common_points(control.targets, world.as_set())
    if len(common) < LEAST_COMMON:
        return f"{len(common)} in common, {common.reason}"
    known = control.targets.points.coordinates[common.pairs[:, 0]]
    if not spread_in_plane(known):
        return "those in common lie on one line, which leaves the turn about it free"
    world.move(_motion(world.as_set().points.coordinates[common.pairs[:, 1]], known))
    at = {int(ours): int(theirs) for ours, theirs in common.pairs}
    for number, name in enumerate(control.targets.names):
        points = control.targets.points
        # a known point is a member of itself: station -1
        _put(world, at.get(number), points.coordinates[number], points.covariances[number], name, [(-1, number)])
        if number in at:
            world.names[at[number]] = name
    return ""


def _motion(points: Array, onto: Array) -> RigidTransform:
    _, rotation, shift = robust_similarity(points, onto)
    return RigidTransform.from_components(shift, Rotation.from_matrix(rotation))


def _adjusted(
    world: _World,
    groups: Sequence[RegisteredGroup],
    targets: Mapping[int, TargetSet],
    control: KnownTargets | None,
    *,
    holds: bool,
    remarks: Sequence[str],
) -> TiedNetwork:
    told = {station for members in world.members for station, _ in members}
    groups = [group for group in groups if group.poses or group.base in told]
    stations = tuple(station for group in groups for station in group.stations)
    at = {station: k for k, station in enumerate(stations)}
    points: dict[tuple[int, int], int] = {}
    of_control: dict[int, int] = {}
    rows: list[tuple[int, int, int, int]] = []
    for members in world.members:
        seen = [(station, target) for station, target in members if station in at]
        known = [number for station, number in members if station == -1]
        if not seen or (len(seen) < 2 and not known):
            continue
        number = len(set(points.values()))
        for station, target in seen:
            points[station, target] = number
            rows.append((at[station], number, station, target))
        of_control.update(dict.fromkeys(known, number))
    chosen = [k for k in of_control if holds and control is not None and not control.is_check[k]]
    known_points = KnownPoints.none()
    if control is not None and chosen:
        picked = control.targets.points[np.array(chosen, dtype=np.int64)]
        numbers = np.array([of_control[k] for k in chosen], dtype=np.int64)
        known_points = KnownPoints(numbers, picked.coordinates, picked.covariances)
    seen_points = SeenPoints(
        np.array([row[0] for row in rows], dtype=np.int64),
        np.array([row[1] for row in rows], dtype=np.int64),
        np.array([targets[s].points.coordinates[t] for _, _, s, t in rows]).reshape(-1, 3),
        np.array([targets[s].points.covariances[t] for _, _, s, t in rows]).reshape(-1, 3, 3),
    )
    scans = tuple(_observed(group, at) for group in groups if group.poses)
    found = adjust_tied_stations(
        TiedStations(seen_points, known_points, scans), [world.poses[station] for station in stations]
    )
    return TiedNetwork(
        stations=stations,
        adjustment=found,
        in_control_frame=holds,
        points=points,
        observations={(station, target): k for k, (_, _, station, target) in enumerate(rows)},
        control=of_control,
        control_observations={number: k for k, number in enumerate(chosen)},
        scanned=tuple(group.stations for group in groups if group.poses),
        remarks=tuple(remarks),
    )


def _observed(group: RegisteredGroup, at: Mapping[int, int]) -> JointPoses:
    poses = {at[station]: pose for station, pose in group.poses.items()}
    return joint_poses(at[group.base], poses, group.covariance)
