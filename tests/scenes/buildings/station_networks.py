"""Networks of stations in the same rooms, without a scanner: planes, edges and pipes with exactly known noise."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.poses import PoseEstimate
from algorithms.network.links import StationLink
from algorithms.network.tracks import StationFeatures
from tests.scenes.buildings.plane_rooms import PlaneRooms, plane_rooms, seen_from
from tests.scenes.lines.line_scenes import LineScene, generic_lines, random_motion

LINK_STD = np.array([1e-4, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3])
"""Of the registrations of pairs: rotation vector [rad], translation [m]."""
NOISE_M = 0.004
PIPES = 4


@dataclass(frozen=True, eq=False)
class StationNetwork:
    """Stations, what they see, and their registrations."""

    poses: tuple[RigidTransform, ...]
    """True world_from_station."""
    features: dict[int, StationFeatures]
    plane_numbers: tuple[np.ndarray, ...]
    """For each station the number of each true plane among its own."""
    links: tuple[StationLink, ...]

    @property
    def names(self) -> list[str]:
        return [f"S{k}" for k in range(len(self.poses))]

    def true_pose(self, station: int, base: int = 0) -> RigidTransform:
        """Give the pose of a station in another one's frame."""
        return self.poses[base].inv() * self.poses[station]

    def with_links(self, *stations: tuple[int, int]) -> "StationNetwork":
        """Keep the registrations between the given stations only."""
        kept = {frozenset(pair) for pair in stations}
        return replace(self, links=tuple(link for link in self.links if frozenset(link.stations) in kept))

    def with_wrong_link(self, target: int, source: int, turn_rad: float, shift_m: float) -> "StationNetwork":
        """Let one registration be wrong by a turn about the target's z axis and a shift along its x axis."""
        wrong = RigidTransform.from_components([shift_m, 0.0, 0.0], Rotation.from_rotvec([0.0, 0.0, turn_rad]))
        return replace(
            self,
            links=tuple(
                replace(
                    link,
                    target_from_source=PoseEstimate(
                        wrong * link.target_from_source.target_from_source, link.target_from_source.covariance
                    ),
                )
                if link.stations == (target, source)
                else link
                for link in self.links
            ),
        )

    def renumbered(self, order: list[int]) -> "StationNetwork":
        """Give the same network with station order[k] as number k, and each registration the other way round."""
        place = {station: k for k, station in enumerate(order)}
        return StationNetwork(
            tuple(self.poses[station] for station in order),
            {k: self.features[station] for k, station in enumerate(order)},
            tuple(self.plane_numbers[station] for station in order),
            tuple(
                replace(
                    link,
                    target=place[link.source],
                    source=place[link.target],
                    target_from_source=link.target_from_source.inverse(),
                    lines=link.lines[:, ::-1],
                    planes=link.planes[:, ::-1],
                    centroid_m=link.target_from_source.target_from_source.inv().apply(link.centroid_m),
                )
                for link in reversed(self.links)
            ),
        )

    def moved(self, rng: np.random.Generator) -> "StationNetwork":
        """Give the same network with every station's frame moved by any motion of its own."""
        motions = [random_motion(rng) for _ in self.poses]
        features = {
            k: StationFeatures(_moved_planes(seen.planes, motions[k]), _moved_lines(seen.lines, motions[k]))
            for k, seen in self.features.items()
        }
        links = tuple(
            replace(
                link,
                target_from_source=PoseEstimate(motions[link.target], np.zeros((6, 6)))
                .after(link.target_from_source)
                .after(PoseEstimate(motions[link.source].inv(), np.zeros((6, 6)))),
                centroid_m=motions[link.target].apply(link.centroid_m),
            )
            for link in self.links
        )
        poses = tuple(pose * motion.inv() for pose, motion in zip(self.poses, motions, strict=True))
        return replace(self, poses=poses, features=features, links=links)


def station_network(
    rng: np.random.Generator, stations: int = 6, *, seen_share: float = 0.75, noise_m: float = NOISE_M
) -> StationNetwork:
    """Let stations see rooms with pipes; every two are registered by what both see.

    Parameters
    ----------
    rng
        Of all randomness.
    stations
        How many.
    seen_share
        Share of the planes, edges and pipes that each station can match.
    noise_m
        Standard deviation of points.
    """
    rooms = plane_rooms(rng, lines=40, rooms=3, bodies=3)
    pipes = generic_lines(rng, PIPES)
    return network_in(rooms, pipes, rng, stations, seen_share=seen_share, noise_m=noise_m)


def network_in(
    rooms: PlaneRooms,
    pipes: LineScene,
    rng: np.random.Generator,
    stations: int,
    *,
    seen_share: float,
    noise_m: float,
) -> StationNetwork:
    """Let stations see given rooms and pipes."""
    poses, features, numbers, planes_seen, lines_seen = [], {}, [], [], []
    for k in range(stations):
        station_from_world = random_motion(rng, 3.0)
        order = rng.permutation(len(rooms.normals))
        lines, planes = seen_from(rooms, pipes, station_from_world, order, noise_m, rng)
        poses.append(station_from_world.inv())
        features[k] = StationFeatures(planes, lines)
        numbers.append(order)
        planes_seen.append(rooms.matched & (rng.random(len(rooms.normals)) < seen_share))
        lines_seen.append(rng.random(len(lines)) < seen_share)
    links = []
    for target in range(stations):
        for source in range(target + 1, stations):
            both = np.flatnonzero(planes_seen[target] & planes_seen[source])
            planes = np.stack([numbers[target][both], numbers[source][both]], axis=1).astype(np.int64)
            both = np.flatnonzero(lines_seen[target] & lines_seen[source])
            pose = poses[target].inv() * poses[source]
            error = LINK_STD * rng.normal(size=6)
            found = RigidTransform.from_components(
                np.asarray(pose.translation) + error[3:], Rotation.from_rotvec(error[:3]) * pose.rotation
            )
            centroids = features[target].planes.centroids
            links.append(
                StationLink(
                    target,
                    source,
                    PoseEstimate(found, np.diag(LINK_STD**2)),
                    np.repeat(both[:, None], 2, axis=1).astype(np.int64),
                    planes,
                    centroids.mean(axis=0),
                    float(np.sqrt(np.square(centroids - centroids.mean(axis=0)).sum(axis=1).mean())),
                    noise_m,
                )
            )
    return StationNetwork(tuple(poses), features, tuple(numbers), tuple(links))


def _moved_planes(planes, motion):
    rotation = motion.rotation.as_matrix()
    return replace(
        planes,
        normals=planes.normals @ rotation.T,
        centroids=motion.apply(planes.centroids),
        bases=rotation @ planes.bases,
    )


def _moved_lines(lines, motion):
    rotation = motion.rotation.as_matrix()
    return replace(
        lines,
        directions=lines.directions @ rotation.T,
        anchors=motion.apply(lines.anchors),
        bases=rotation @ lines.bases,
    )
