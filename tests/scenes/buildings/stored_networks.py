"""A network of many stations as its steps store it: features, pairs, links, without a scan and without a search."""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from algorithms.features.scan_features import ScanFeatures, SurfaceSample
from algorithms.network.links import StationLink
from schemas.results.registration_result import Pair
from service.ports import Json, StepFiles
from service.use_cases.documents.pose_documents import pose_document
from service.use_cases.steps.feature_store import save_features
from service.use_cases.steps.link_store import save_link
from tests.scenes.buildings.city_block import CityBlock

JOB = "city"


@dataclass(frozen=True)
class Templates:
    """What is the same of all stations and pairs."""

    features: ScanFeatures
    """Of a scan, without its planes and surface."""
    pair: Pair
    """With correspondences; names and pose are put in."""


def neighbours(block: CityBlock, nearest: int = 5) -> list[tuple[int, int]]:
    """Pair every station with those nearest to it: some three pairs for each."""
    places = np.array([pose.translation for pose in block.poses])
    _, near = cKDTree(places).query(places, nearest + 1)
    return sorted(
        {(min(k, other), max(k, other)) for k, row in enumerate(near.tolist()) for other in row if other != k}
    )


def store_network(
    files: StepFiles,
    block: CityBlock,
    tried: Sequence[tuple[int, int]],
    templates: Templates,
    *,
    surface_points: int,
    rng: np.random.Generator,
) -> Json:
    """Store what the steps before the adjustment of all stations have left; give the arguments of that and the report.

    Parameters
    ----------
    files
        Where it is stored.
    block
        The stations.
    tried
        Pairs; those that see enough in common are accepted, the others rejected.
    templates
        What stations and pairs are made from.
    surface_points
        Points of each station's surface.
    rng
        Of the registrations.
    """
    links = {link.stations: link for link in block.registered(tried, rng)}
    names, features, pairs = block.names, [], []
    for number, name in enumerate(names):
        rough = block.surfaces[number]
        points = rough[np.linspace(0, len(rough) - 1, surface_points).astype(np.int64)]
        surface = SurfaceSample(
            points, np.tile([0.0, 0.0, 1.0], (len(points), 1)), np.full(len(points), -1, np.int32), 0.3
        )
        own = replace(templates.features, planes=block.features[number].planes, surface=surface, origin_m=np.zeros(3))
        key = f"features/{name}.npz"
        _put(files, key, lambda path, own=own: save_features(path, own))
        counts = {"station": name, "points": 10, "lines": 1, "planes": 2, "cylinders": 0, "noise_std_m": 0.002}
        features.append({"features": key, "sha256": "ab", "counts": counts, "timings_s": {"read": 0.5}})
    for number, stations in enumerate(tried):
        link, (target, source) = links.get(stations), (names[k] for k in stations)
        document = pair_between(templates.pair, target, source, link)
        pair, kept = f"jobs/{JOB}/pairs/{number}.json", f"jobs/{JOB}/links/{number}.npz"
        files.write_bytes(pair, document.model_dump_json(by_alias=True).encode())
        if link is not None:
            _put(files, kept, lambda path, link=link: save_link(path, link))
        pairs.append(
            {
                "pair": pair,
                "status": document.status,
                "target": target,
                "source": source,
                "link": None if link is None else kept,
            }
        )
    inputs = {
        "stations": [{"name": name, "scan": {"file": f"f-{name}", "index": 0}} for name in names],
        "method": {"method": "auto"},
    }
    points = [{"sha256": "ab", "index": number, "name": name} for number, name in enumerate(names)]
    return {"job_id": JOB, "inputs": inputs, "features": features, "pairs": pairs, "viewer_points": points}


def adjusting(arguments: Json) -> Json:
    """Give the arguments of `adjust-network` from those of the report."""
    return {
        "job_id": arguments["job_id"],
        "names": [station["name"] for station in arguments["inputs"]["stations"]],
        "features": [output["features"] for output in arguments["features"]],
        "pairs": arguments["pairs"],
        "method": arguments["inputs"]["method"],
        "ties": False,
    }


def pair_between(template: Pair, target: str, source: str, link: StationLink | None) -> Pair:
    """Give the document of a pair; without a link nothing was found."""
    if link is None:
        nothing: dict[str, Any] = dict.fromkeys(("target_from_source", "adjustment", "accuracy", "rank_report"))
        nothing |= {"correspondences": [], "outliers": [], "weak_directions": []}
        found = {"status": "rejected", "reasons": ["too little in common"], **nothing}
    else:
        pose = pose_document(link.target_from_source, target=target, source=source, centroid_m=link.centroid_m)
        found = {"status": "accepted", "reasons": [], "target_from_source": pose}
        found["correspondences"] = [
            entry.model_copy(update={"target_line": f"{target}/L{k + 1}", "source_line": f"{source}/L{k + 1}"})
            for k, entry in enumerate(template.correspondences)
        ]
    return template.model_copy(update={"target": target, "source": source, **found})


def _put(files: StepFiles, key: str, write: Callable[[Any], None]) -> None:
    scratch = files.scratch()
    try:
        write(scratch / "stored.npz")
        files.put_file(key, scratch / "stored.npz")
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
