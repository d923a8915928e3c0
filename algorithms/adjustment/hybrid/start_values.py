"""Start values of a whole network by successive activation: stations from points, points from stations (H-17, H-18)."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.adjustment.hybrid.closed_forms import (
    intersections,
    relative_orientation,
    resection,
    robust_similarity,
    spread_in_plane,
)
from algorithms.adjustment.hybrid.estimation import estimate
from algorithms.adjustment.hybrid.network import Network
from algorithms.adjustment.hybrid.point_equations import InPlane, ObservedUnknowns, OnLine
from algorithms.adjustment.hybrid.scanner_equations import Tilts
from algorithms.adjustment.hybrid.sights import Sight, horizontal_angles, sights_of
from algorithms.adjustment.hybrid.start_frames import onto_expected_coordinates, with_fitted_forms
from algorithms.adjustment.hybrid.state import Kind, State
from algorithms.arrays import Array
from algorithms.progress import NoProgress, Progress

REFINED_ROWS = 20_000
"""Smaller networks are adjusted, as far as they are active, whenever some stations were added."""
QUIET = 3.0
"""Residuals of so many standard deviations count half while the network grows: gross errors are among them."""
ROUNDS_OF_REFINING = 2


@dataclass(frozen=True, eq=False)
class Started:
    """Start values of everything that could be placed."""

    state: State
    points_placed: Array
    poses_placed: Array
    how: str
    """`given`, or what was found by which means."""


def complete_start(
    network: Network,
    start: State,
    points_known: Array,
    poses_known: Array,
    mounts_known: Array,
    photos: Array,
    levelled: Array,
    progress: Progress | None = None,
) -> Started:
    """Find what is missing of the start values (Haring 2003).

    Parameters
    ----------
    network
        Observations.
    start
        Values, meaningful where they are known.
    points_known, poses_known, mounts_known
        Which are.
    photos
        (p,) stations that are photos.
    levelled
        (p,) stations whose tilts are zero.
    progress
        Hears of every new station.
    """
    chain = _Chain(network, start, points_known, poses_known, mounts_known, photos, levelled, progress or NoProgress())
    return chain.run()


class _Chain:
    def __init__(
        self,
        network: Network,
        start: State,
        points_known: Array,
        poses_known: Array,
        mounts_known: Array,
        photos: Array,
        levelled: Array,
        progress: Progress,
    ) -> None:
        self.network, self.state, self.progress = network, start, progress
        self.points, self.poses, self.mounts = points_known.copy(), poses_known.copy(), mounts_known.copy()
        self.photos, self.levelled = photos, levelled
        columns = network.layout.columns
        point_of = {int(c): k for k, c in enumerate(columns[Kind.POINT][:, 0]) if c >= 0}
        self.at_point = np.array(
            [point_of.get(int(c), -1) if c >= 0 else -1 for c in columns[Kind.POSE][:, 3]], dtype=np.int64
        )
        self.sights = list(sights_of(network, start))
        self.horizontals = list(horizontal_angles(network))

    def run(self) -> Started:
        everything = bool(self.points.all() and self.poses.all() and self.mounts.all())
        how = "given"
        if not everything:
            given = replace(self.state), self.points.copy()
            how = (
                "given ones, and what was missing from common points"
                if self.points.any() or self.poses.any()
                else ("from common points")
            )
            self._grow()
            if not self._complete() and not self._any_station_was_given(given[1]):
                self._start_anew(given)
            self._place_the_rest()
        self.state = with_fitted_forms(self.network, self.state)
        return Started(self.state, self.points, self.poses, how)

    def _any_station_was_given(self, points: Array) -> bool:
        # stations that grew from given points, or were given, fix the frame already
        return bool(self.poses.any()) and bool(points.any() or self.poses.any())

    def _complete(self) -> bool:
        return bool(self.poses.all())

    def _start_anew(self, given: tuple[State, Array]) -> None:
        """Begin with one station's own frame, and carry everything onto what is known in the end."""
        reference, known = given
        self.points = np.zeros_like(known)
        if not self._first_station():
            self.points = known.copy()
            return
        self._grow()
        common = known & self.points
        if common.sum() >= 3 and spread_in_plane(reference.points[common]):
            scale, rotation, shift = robust_similarity(
                self.state.points[common], reference.points[common], with_scale=not self._has_scale()
            )
            self._move(Rotation.from_matrix(rotation).as_rotvec(), shift, scale)
        elif common.any():
            upright = robust_similarity(self.state.points[common], reference.points[common], upright=True)
            self._move(Rotation.from_matrix(upright[1]).as_rotvec(), upright[2], 1.0)
        else:
            motion = onto_expected_coordinates(self.network, self.state, self.points)
            if motion is not None:
                self._move(*motion, 1.0)
        missing = known & ~self.points
        points = self.state.points.copy()
        points[missing] = reference.points[missing]
        self.state, self.points = replace(self.state, points=points), self.points | known

    def _move(self, rotation_vector: Array, shift: Array, scale: float) -> None:
        self.state = self.state.moved_together(shift, rotation_vector, scale)

    def _has_scale(self) -> bool:
        return any(sight.spatial for sight in self.sights)

    def _grow(self) -> None:
        """Place points from stations and stations from points, the best connected first, until nothing more comes."""
        failed: set[int] = set()
        next_refining = 2
        while True:
            fresh = self._place_points()
            if fresh:
                failed.clear()
            self._mounts_from_photos()
            candidates = self._candidates(failed)
            placed = False
            for k in candidates:
                if self._place_station(self.sights[k]):
                    placed = True
                    break
                failed.add(k)
            if not placed:
                placed = self._orient_centred_stations()
            if not placed:
                return
            done = float(self.poses.mean()) if len(self.poses) else 1.0
            self.progress.report(done, f"start values: {int(self.poses.sum())} of {len(self.poses)} stations")
            self._place_points()
            if int(self.poses.sum()) >= next_refining:
                self._refine()
                next_refining = int(1.3 * int(self.poses.sum())) + 1

    def _candidates(self, failed: set[int]) -> list[int]:
        found = []
        for k, sight in enumerate(self.sights):
            if k in failed or self.poses[sight.pose] or not (sight.spatial or sight.is_photo):
                continue
            if sight.mount and not self.mounts[sight.mount] and sight.is_photo:
                continue
            common = len(np.unique(sight.points[self.points[sight.points]]))
            least = (2 if self.levelled[sight.pose] else 3) if sight.spatial else 4
            if common >= least:
                found.append((common + (1000 if sight.spatial else 0), k))
        return [k for _, k in sorted(found, key=lambda each: (-each[0], each[1]))]

    def _place_station(self, sight: Sight) -> bool:
        known = self.points[sight.points]
        points = self.state.points[sight.points[known]]
        rotations, positions = self.state.rotations.copy(), self.state.positions.copy()
        if sight.spatial:
            upright = bool(self.levelled[sight.pose])
            if not upright and not spread_in_plane(points):
                return False
            _, rotation, shift = robust_similarity(sight.local[known], points, upright=upright)
        else:
            pose = self._resected(sight)
            if pose is None:
                return False
            rotation, shift = pose
            if sight.mount:
                carried = self.state.mount_rotations[sight.mount]
                rotation = rotation @ carried.T
                shift = shift - rotation @ self.state.mount_positions[sight.mount]
        rotations[sight.pose], positions[sight.pose] = rotation, shift
        self._keep_pose(sight.pose, rotations, positions)
        return True

    def _keep_pose(self, pose: int, rotations: Array, positions: Array) -> None:
        points = self.state.points
        at = self.at_point[pose]
        if at >= 0:
            if self.points[at]:
                positions[pose] = points[at] + (self.state.positions[pose] - self.state.points[at])
            else:
                points = points.copy()
                points[at] = positions[pose] - (self.state.positions[pose] - self.state.points[at])
                self.points[at] = True
        self.state = replace(self.state, rotations=rotations, positions=positions, points=points)
        self.poses[pose] = True

    def _resected(self, sight: Sight) -> tuple[Array, Array] | None:
        known = self.points[sight.points]
        if sight.ideal is None or known.sum() < 4:
            return None
        found = resection(sight.ideal[known], self.state.points[sight.points[known]])
        return None if found is None else found[:2]

    def _mounts_from_photos(self) -> None:
        """Find unknown mounts where a photo and its carrier are known."""
        for sight in self.sights:
            if not sight.is_photo or self.mounts[sight.mount] or not self.poses[sight.pose]:
                continue
            pose = self._resected(sight)
            if pose is None:
                continue
            back = self.state.rotations[sight.pose].T
            rotations, positions = self.state.mount_rotations.copy(), self.state.mount_positions.copy()
            rotations[sight.mount] = back @ pose[0]
            positions[sight.mount] = back @ (pose[1] - self.state.positions[sight.pose])
            self.state = replace(self.state, mount_rotations=rotations, mount_positions=positions)
            self.mounts[sight.mount] = True

    def _orient_centred_stations(self) -> bool:
        """Turn levelled stations that stand at known points by their horizontal angles."""
        for pose, points, angles in self.horizontals:
            at = self.at_point[pose]
            if self.poses[pose] or at < 0 or not self.points[at] or not self.levelled[pose]:
                continue
            known = self.points[points]
            if not known.any():
                continue
            position = self.state.points[at]
            arms = self.state.points[points[known]] - position
            turns = np.exp(1j * (np.arctan2(arms[:, 1], arms[:, 0]) - angles[known]))
            middle = turns[np.argmin([np.abs(turns - t).sum() for t in turns])]
            rotations, positions = self.state.rotations.copy(), self.state.positions.copy()
            rotations[pose] = Rotation.from_euler("Z", float(np.angle(middle))).as_matrix()
            self._keep_pose(pose, rotations, positions)
            return True
        return False

    def _place_points(self) -> bool:
        """Place points from stations that are known: from coordinates in their frames, or by intersection."""
        seen: dict[bool, list[tuple[Array, Array, Array]]] = {True: [], False: []}
        for sight in self.sights:
            if not self.poses[sight.pose] or (sight.is_photo and not self.mounts[sight.mount]):
                continue
            fresh = ~self.points[sight.points]
            rotation, position = self.state.rotations[sight.pose], self.state.positions[sight.pose]
            if sight.is_photo:
                position = position + rotation @ self.state.mount_positions[sight.mount]
                rotation = rotation @ self.state.mount_rotations[sight.mount]
            turned = sight.local[fresh] @ rotation.T
            seen[sight.spatial].append((sight.points[fresh], np.broadcast_to(position, turned.shape), turned))
        points, placed = self.state.points.copy(), False
        for spatial, place in ((True, _middles), (False, intersections)):
            if seen[spatial]:
                numbers, origins, vectors = (np.concatenate(part) for part in zip(*seen[spatial], strict=True))
                waiting = ~self.points[numbers]
                if not waiting.any():
                    continue
                found, places = place(numbers[waiting], origins[waiting], vectors[waiting])
                points[found], self.points[found] = places, True
                placed |= len(found) > 0
        self.state = replace(self.state, points=points)
        self._stations_at_points()
        return placed

    def _stations_at_points(self) -> None:
        """Keep stations above their points where only the point was known."""
        waiting = np.flatnonzero((self.at_point >= 0) & ~self.poses)
        if len(waiting):
            positions = self.state.positions.copy()
            known = waiting[self.points[self.at_point[waiting]]]
            positions[known] = self.state.points[self.at_point[known]]
            self.state = replace(self.state, positions=positions)

    def _first_station(self) -> bool:
        """Let a station that sees the most define the frame; of photos alone the pair with the most common points."""
        spatial = [s for s in self.sights if s.spatial]
        if spatial:
            first = max(spatial, key=lambda s: len(np.unique(s.points)))
            tilts = self._tilt_of(first.pose)
            rotations, positions = self.state.rotations.copy(), self.state.positions.copy()
            rotations[first.pose], positions[first.pose] = tilts, np.zeros(3)
            self.state = replace(self.state, rotations=rotations, positions=positions)
            self.poses[first.pose] = True
            return True
        seen = [s for s in self.sights if s.ideal is not None and not s.mount]
        pairs = sorted(
            ((len(np.intersect1d(a.points, b.points)), i, j)
             for i, a in enumerate(seen) for j, b in enumerate(seen) if i < j),
            key=lambda each: (-each[0], each[1], each[2]),
        )  # fmt: skip
        for common, i, j in pairs[:20]:
            if common < 6:
                return False
            if self._oriented_pair(seen[i], seen[j]):
                return True
        return False

    def _oriented_pair(self, first: Sight, second: Sight) -> bool:
        if first.ideal is None or second.ideal is None:
            return False
        _, at, other = np.intersect1d(first.points, second.points, return_indices=True)
        pose = relative_orientation(first.ideal[at], second.ideal[other])
        if pose is None:
            return False
        rotations, positions = self.state.rotations.copy(), self.state.positions.copy()
        rotations[first.pose], positions[first.pose] = np.eye(3), np.zeros(3)
        rotations[second.pose], positions[second.pose] = pose
        self.state = replace(self.state, rotations=rotations, positions=positions)
        self.poses[[first.pose, second.pose]] = True
        return True

    def _tilt_of(self, pose: int) -> Array:
        angles = np.zeros(3)
        for each in self.network.observations:
            if isinstance(each, Tilts):
                for k in np.flatnonzero(each.stations == pose):
                    angles[each.components[k]] = each.values[k]
        return np.asarray(Rotation.from_euler("XYZ", angles).as_matrix())

    def _refine(self) -> None:
        """Adjust what is active with quiet weights (H-18): errors must not grow along the chain."""
        if len(self.network.block_of_row) > REFINED_ROWS:
            return
        active = self._active_blocks()
        if not active.any():
            return
        for _ in range(ROUNDS_OF_REFINING):
            residuals = self.network.linearised(self.state).residuals
            sizes = self.network.sizes
            squares = np.bincount(self.network.block_of_row, np.square(residuals), len(sizes)) / sizes
            weights = np.where(active, 1.0 / (1.0 + squares / QUIET**2), 0.0)[self.network.block_of_row]
            found = estimate(self.network, self.state, weights, 4, rough=True)
            before = float(weights @ np.square(residuals))
            if not np.isfinite(found.omega) or found.omega > before:
                return
            self.state = found.state

    def _active_blocks(self) -> Array:
        known = {Kind.POINT: self.points, Kind.POSE: self.poses, Kind.MOUNT: self.mounts}
        active = np.ones(len(self.network.sizes), dtype=bool)
        for k, each in enumerate(self.network.observations):
            span = slice(int(self.network.first_blocks[k]), int(self.network.first_blocks[k]) + len(each))
            if isinstance(each, InPlane | OnLine | ObservedUnknowns):
                active[span] = False
                continue
            for kind, numbers in each.places:
                if kind in known:
                    active[span] &= known[kind][numbers]
        return active

    def _place_the_rest(self) -> None:
        """Put points that no form places near those with which they are observed: the adjustment moves them."""
        if self.points.all() or not self.points.any():
            return
        points = self.state.points.copy()
        spread = float(np.std(points[self.points], axis=0).max()) or 1.0
        rng = np.random.default_rng(len(points))
        for _ in range(len(points)):
            missing = ~self.points
            if not missing.any():
                break
            near: dict[int, list[Array]] = {}
            for each in self.network.observations:
                ends = [numbers for kind, numbers in each.places if kind is Kind.POINT]
                if len(ends) != 2:
                    continue
                for a, b in ((0, 1), (1, 0)):
                    for k in np.flatnonzero(missing[ends[a]] & self.points[ends[b]]):
                        near.setdefault(int(ends[a][k]), []).append(points[ends[b][k]])
            if not near:
                break
            for point, places in near.items():
                points[point] = np.mean(places, axis=0) + 0.1 * spread * rng.normal(size=3)
                self.points[point] = True
        points[~self.points] = points[self.points].mean(axis=0)
        self.state = replace(self.state, points=points)
        self._stations_at_points()


def _middles(numbers: Array, origins: Array, vectors: Array) -> tuple[Array, Array]:
    """Give for each point the mean of two places, of more the one that is nearest to most."""
    found, of = np.unique(numbers, return_inverse=True)
    order = np.argsort(of, kind="stable")
    places = np.zeros((len(found), 3))
    for k, rows in enumerate(np.split(order, np.cumsum(np.bincount(of, minlength=len(found)))[:-1])):
        own = origins[rows] + vectors[rows]
        if len(own) > 2:
            apart = np.linalg.norm(own[:, None] - own[None], axis=2)
            own = own[[int(np.argmin(np.median(apart, axis=1)))]]
        places[k] = own.mean(axis=0)
    return found, places
