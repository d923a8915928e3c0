"""Choose pairs of a simulated city, register and adjust them, in one process: `city_block_child.py stations`.

Prints one line of JSON: processor seconds of each part, pairs, connected stations, errors against the truth, and the
peak of memory. What a registration of a pair costs is not measured here: it is drawn from what both stations see.
"""

import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from peer_child import peak_memory_mb
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform

from algorithms.network import network_registration
from algorithms.network.candidate_pairs import Tried, first_pairs, most_pairs, next_pairs
from algorithms.network.links import StationLink
from algorithms.network.loop_closure import examine_loops
from algorithms.network.network_registration import NetworkRegistration
from algorithms.network.pose_graph import chained_parts, connected_stations
from algorithms.network.similarity import appearance, likeness
from tests.scenes.buildings.city_block import CityBlock, city_block
from tests.scenes.lines.line_scenes import pose_error

WRONG_SHARE = 0.01
FEATURE_SHARE = 0.7
"""Of the information of a registration; the rest stands for surfaces, so that both adjustments are mixed."""
MOST_ROUNDS = 12
"""As the plan of a job allows."""
WRONG_M = 1.0
WRONG_POSE_M = 0.05
NEAR_M = 45.0
"""Farther apart no two stations see enough in common."""
PARTS = {"examine_loops": "loops", "adjust_pose_graph": "graph", "_adjusted": "joint", "fused_stations": "fusion"}


class Clock:
    """Processor seconds by part."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def timed(self, part: str, work: Callable[..., Any]) -> Callable[..., Any]:
        """Give a function that notes its time."""

        def noting(*arguments: Any, **named: Any) -> Any:
            begun = time.process_time()
            result = work(*arguments, **named)
            self.seconds[part] = self.seconds.get(part, 0.0) + time.process_time() - begun
            return result

        return noting


def grown(block: CityBlock, clock: Clock) -> tuple[list[StationLink], int, int]:
    """Try pairs in rounds as a job does; give the accepted registrations, and how many pairs in how many rounds."""
    rng, n = np.random.default_rng(2), len(block.poses)
    described = clock.timed("choice", lambda: likeness([appearance(block.features[k].planes) for k in range(n)]))
    alike = described()
    tried: list[tuple[int, int]] = []
    links: list[StationLink] = []
    fresh, rounds = clock.timed("choice", first_pairs)(alike), 0
    while fresh and rounds < MOST_ROUNDS:
        rounds += 1
        tried += fresh
        links += block.registered(fresh, rng, wrong_share=WRONG_SHARE)
        rejected = clock.timed("loops of rounds", examine_loops)(links, block.names).rejected
        used = [link for number, link in enumerate(links) if number not in rejected]
        parts, poses = clock.timed("choice", chained_parts)(used, n)
        known = Tried(tried, [link.stations for link in used], poses, parts)
        fresh = clock.timed("choice", next_pairs)(alike, block.surfaces, known)
    return [replace(link, feature_share=FEATURE_SHARE) for link in links], len(tried), rounds


def without_misleading(block: CityBlock, links: list[StationLink]) -> list[StationLink]:
    """Leave wrong registrations out that no loop controls: free space tells them (`SurfaceControl`)."""
    while True:
        verdict = examine_loops(links, block.names)
        misleading = {number for number in verdict.uncontrolled if is_wrong(block, links[number])}
        if not misleading:
            return links
        links = [link for number, link in enumerate(links) if number not in misleading]


def reachable(block: CityBlock) -> int:
    """Give how many stations would hold together with the first one if all pairs were tried."""
    places = np.array([pose.translation for pose in block.poses])
    pairs = sorted((min(pair), max(pair)) for pair in cKDTree(places).query_pairs(NEAR_M))
    return len(connected_stations(block.registered(pairs, np.random.default_rng(3)), 0))


def is_wrong(block: CityBlock, link: StationLink) -> bool:
    """Say whether a registration is not the truth."""
    truth = block.poses[link.target].inv() * block.poses[link.source]
    away = np.asarray(link.target_from_source.target_from_source.translation) - np.asarray(truth.translation)
    return bool(np.linalg.norm(away) > WRONG_M)


def judged(block: CityBlock, links: list[StationLink], result: NetworkRegistration) -> dict[str, object]:
    """Compare poses with the truth."""
    used = [link for number, link in enumerate(links) if number not in result.loops.rejected]
    stations = sorted(result.poses)
    base = block.poses[0].inv()

    def error(pose: RigidTransform, station: int) -> np.ndarray:
        return np.asarray(pose_error(pose, base * block.poses[station]))

    own = [error(result.poses[k].target_from_source, k) for k in stations[1:]]
    each = [e @ np.linalg.solve(result.poses[k].covariance, e) / 6.0 for e, k in zip(own, stations[1:], strict=True)]
    joint = result.joint
    together = None
    if joint is not None:
        stacked = np.concatenate([error(joint.solution.unknowns.poses[k], s) for k, s in enumerate(joint.stations)][1:])
        together = float(stacked @ joint.solution.information.times(stacked)) / len(stacked)
    away = np.abs(np.array(own)[:, 3:]).max(axis=1, initial=0.0)
    return {
        "wrong_poses": int((away > WRONG_POSE_M).sum()),
        "reachable": reachable(block),
        "largest_error_m": float(np.abs(np.array(own)[:, 3:]).max(initial=0.0)),
        "nees_of_each": float(np.mean(each)),
        "nees_together": together,
        "wrong": sum(is_wrong(block, link) for link in links),
        "wrong_used": sum(is_wrong(block, link) for link in used if link.target in result.poses),
        "good_rejected": sum(not is_wrong(block, links[k]) for k in result.loops.rejected),
    }


def main(stations: int) -> None:
    """Do it all once for few stations, which compiles what is to be compiled, then on the clock."""
    figures: dict[str, object] = {}
    for count in (80, stations):
        block, clock = city_block(count, np.random.default_rng(count)), Clock()
        accepted, tried, rounds = grown(block, clock)
        links = without_misleading(block, accepted)
        kept = {name: getattr(network_registration, name) for name in PARTS}
        for name, part in PARTS.items():
            setattr(network_registration, name, clock.timed(part, kept[name]))
        result = clock.timed("network", network_registration.register_network)(block.features, links, block.names)
        for name, work in kept.items():
            setattr(network_registration, name, work)
        joint, peak_mb = result.joint, peak_memory_mb()
        figures = {
            "stations": count,
            "planes": float(np.mean([len(numbers) for numbers in block.seen])),
            "tried": tried,
            "bound": most_pairs(count),
            "rounds": rounds,
            "links": len(accepted),
            "misleading": len(accepted) - len(links),
            "connected": len(result.poses),
            "uncontrolled": len(result.uncontrolled),
            "tracks": 0 if joint is None else len(joint.tracks),
            "removed": 0 if joint is None else len(joint.removed),
            "conditions": 0 if joint is None else joint.observation_count,
            "variance_factor": result.variance_factor,
            "left_out": len(result.left_out),
            "remarks": result.remarks,
            "seconds": clock.seconds,
            "peak_mb": peak_mb,
            **judged(block, links, result),
        }
    print(json.dumps(figures))


if __name__ == "__main__":
    main(int(sys.argv[1]))
