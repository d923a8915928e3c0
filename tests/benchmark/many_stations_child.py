"""Register many stations step by step as a job does, in one process: `many_stations_child.py scans.json`.

Prints one line of JSON: processor seconds of each part, pairs tried and accepted, poses, and the peak of memory.
"""

import json
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from peer_child import peak_memory_mb
from peer_methods import tieline_method

from algorithms.features.extraction import extract_features
from algorithms.features.scan_features import ScanFeatures
from algorithms.network.candidate_pairs import Tried, first_pairs, next_pairs
from algorithms.network.links import StationLink
from algorithms.network.loop_closure import examine_loops
from algorithms.network.network_registration import register_network
from algorithms.network.pose_graph import chained_parts
from algorithms.network.similarity import appearance, likeness
from algorithms.network.surface_control import MOST_POINTS, SurfaceControl
from algorithms.network.tracks import StationFeatures
from algorithms.progress import NoProgress
from algorithms.registration.base import PairStatus, RegistrationProblem
from service.formats import read_scan
from service.use_cases.steps.link_store import link_of
from service.use_cases.steps.run_features import SEED


class Clock:
    """Processor seconds by part."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.process_time()

    def note(self, part: str) -> None:
        """Add what went by since the last note to a part."""
        now = time.process_time()
        self.seconds[part] = self.seconds.get(part, 0.0) + now - self._last
        self._last = now


def features_of(path: Path) -> ScanFeatures:
    """Read a scan and extract its features."""
    scan = read_scan(path, path.name)
    return extract_features(scan, tieline_method().features, progress=NoProgress(), rng=np.random.default_rng(SEED))


def register_all(paths: Sequence[Path]) -> dict[str, object]:
    """Register stations: features, then pairs in rounds, then one adjustment."""
    clock = Clock()
    features = [features_of(path) for path in paths]
    clock.note("features")
    names = [path.stem for path in paths]
    alike = likeness([appearance(scan.planes) for scan in features])
    surfaces = [
        np.ascontiguousarray(scan.surface.points[:: max(len(scan.surface.points) // MOST_POINTS, 1)])
        for scan in features
    ]
    tried: list[tuple[int, int]] = []
    links: dict[PairStatus, list[StationLink]] = {status: [] for status in PairStatus}
    chosen = first_pairs(alike)
    clock.note("choice")
    rounds = 0
    while chosen:
        rounds += 1
        for target, source in chosen:
            problem = RegistrationProblem(features[target], features[source])
            result = tieline_method().register(problem, progress=NoProgress())
            if result.fine is not None:
                link = link_of(result.fine, problem.target, problem.source)
                status = PairStatus.ACCEPTED if result.status.in_place else result.status
                links[status].append(replace(link, target=target, source=source))
        tried += chosen
        clock.note("pairs")
        chosen = next_pairs(alike, surfaces, _known(links[PairStatus.ACCEPTED], names, tried))
        clock.note("choice")
    result = register_network(
        {number: StationFeatures.of_features(scan) for number, scan in enumerate(features)},
        links[PairStatus.ACCEPTED],
        names,
        tieline_method().adjustment,
        doubtful=links[PairStatus.DOUBTFUL],
        control=SurfaceControl(features.__getitem__),
    )
    clock.note("network")
    origins = [scan.origin_m for scan in features]
    poses = {
        station: pose.moved_to_origins(origins[0], origins[station]).target_from_source.as_matrix().tolist()
        for station, pose in result.poses.items()
    }
    return {
        "tried": len(tried),
        "rounds": rounds,
        "accepted": len(links[PairStatus.ACCEPTED]),
        "planes": float(np.mean([len(scan.planes) for scan in features])),
        "seconds": clock.seconds,
        "poses": poses,
        "peak_mb": peak_memory_mb(),
    }


def _known(links: Sequence[StationLink], names: Sequence[str], tried: Sequence[tuple[int, int]]) -> Tried:
    """Chain what is consistent, part by part of the network."""
    rejected = examine_loops(links, names).rejected
    used = [link for number, link in enumerate(links) if number not in rejected]
    parts, poses = chained_parts(used, len(names))
    return Tried(tried, [link.stations for link in used], poses, parts)


def main(job: Path) -> None:
    """Register the scans for warming up, then the others on the clock."""
    scans = json.loads(job.read_text())
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # libraries print to file 1 as well
    register_all([Path(path) for path in scans["warm_up"]])
    print(json.dumps(register_all([Path(path) for path in scans["stations"]])), file=out, flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
