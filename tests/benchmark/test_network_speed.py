"""Processor time and memory of the adjustment of all stations, from five to five hundred along a corridor of rooms."""

import resource
import time
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.lines import Lines
from algorithms.geometry.poses import PoseEstimate
from algorithms.network.links import StationLink
from algorithms.network.network_registration import register_network
from algorithms.network.tracks import StationFeatures
from tests.scenes.buildings.plane_rooms import PlaneRooms, plane_rooms, seen_from
from tests.scenes.buildings.station_networks import LINK_STD, NOISE_M
from tests.scenes.lines.line_scenes import LineScene, pose_error

pytestmark = pytest.mark.benchmark

ROOM_M = 6.0
SEEN_ROOMS = 2
"""So many rooms on either side of its own a station sees through doors."""
LINKED = 3
"""Stations so many rooms apart are registered with each other."""
SEEN_SHARE = 0.6
NOTHING = LineScene(np.empty((0, 3)), np.empty((0, 3)))
SECONDS_PER_STATION = 0.1
"""Twice what was measured under shape checks (24 s with 500 stations, 13 s without)."""


def corridor(
    count: int, rng: np.random.Generator
) -> tuple[list[RigidTransform], dict[int, StationFeatures], list[StationLink]]:
    """Let stations see the planes of the rooms around them, each a random part."""
    rooms = [plane_rooms(rng, lines=12, rooms=1, bodies=2, matched_share=1.0) for _ in range(count)]
    poses, features, seen = [], {}, []
    for k in range(count):
        near = range(max(0, k - SEEN_ROOMS), min(count, k + SEEN_ROOMS + 1))
        together = _joined([rooms[q] for q in near], [ROOM_M * q for q in near])
        pose = RigidTransform.from_components([ROOM_M * k + 2.0, 2.0, 1.5], Rotation.random(rng=rng))
        order = np.arange(len(together.normals))
        _, planes = seen_from(together, NOTHING, pose.inv(), order, NOISE_M, rng)
        names = [(q, plane) for q in near for plane in range(len(rooms[q].normals))]
        seen.append({name: place for place, name in enumerate(names) if rng.random() < SEEN_SHARE})
        features[k] = StationFeatures(planes, Lines.empty())
        poses.append(pose)
    return poses, features, _links(poses, seen, rng)


def _joined(rooms: list[PlaneRooms], shifts_m: list[float]) -> PlaneRooms:
    moved = [
        replace(room, middles=room.middles + np.array([x, 0.0, 0.0])) for room, x in zip(rooms, shifts_m, strict=True)
    ]
    names = ("normals", "middles", "axes", "sizes", "matched")
    columns = {name: np.concatenate([getattr(room, name) for room in moved]) for name in names}
    no_edges = {"edges": np.zeros((0, 2), np.int64), "edge_middles": np.zeros((0, 3)), "edge_lengths": np.zeros(0)}
    return PlaneRooms(**columns, **no_edges)


def _links(
    poses: list[RigidTransform], seen: list[dict[tuple[int, int], int]], rng: np.random.Generator
) -> list[StationLink]:
    links = []
    for target in range(len(poses)):
        for source in range(target + 1, min(len(poses), target + LINKED + 1)):
            both = sorted(seen[target].keys() & seen[source].keys())
            pose, error = poses[target].inv() * poses[source], LINK_STD * rng.normal(size=6)
            found = RigidTransform.from_components(
                np.asarray(pose.translation) + error[3:], Rotation.from_rotvec(error[:3]) * pose.rotation
            )
            planes = np.array([[seen[target][name], seen[source][name]] for name in both], dtype=np.int64)
            estimate = PoseEstimate(found, np.diag(LINK_STD**2))
            nothing = np.empty((0, 2), dtype=np.int64)
            links.append(StationLink(target, source, estimate, nothing, planes, np.zeros(3), 3.0, NOISE_M))
    return links


@pytest.mark.parametrize("count", [5, 10, 20, 40, 100, 500])
def test_time_grows_with_the_number_of_stations_and_the_covariance_stays_honest(count: int) -> None:
    poses, features, links = corridor(count, np.random.default_rng(count))
    begun = time.process_time()
    result = register_network(features, links, [f"S{k}" for k in range(count)])
    seconds = time.process_time() - begun
    assert result.joint is not None
    errors = np.concatenate([pose_error(result.joint.pose(k), poses[0].inv() * poses[k]) for k in range(1, count)])
    normalised = float(errors @ result.joint.solution.information.times(errors)) / len(errors)
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"\n{count} stations, {len(links)} pairs, {len(result.joint.tracks)} planes, "
        f"{result.joint.observation_count} conditions: {seconds:.1f} s of one processor, {memory_mb:.0f} MB at most, "
        f"NEES / 6 (n - 1) = {normalised:.3f}"
    )
    low, high = stats.chi2.ppf([0.0005, 0.9995], len(errors)) / len(errors)
    assert low < normalised < high
    assert seconds < 2.0 + SECONDS_PER_STATION * count
