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
    """Store what the steps before the adjustment of all stations leave; give the arguments of that and the report.

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
    features = [
        store_features(files, f"features/{name}.npz", block, number, templates, surface_points)
        for number, name in enumerate(block.names)
    ]
    pairs = [
        store_pair(files, JOB, number, tuple(block.names[k] for k in stations), links.get(stations), templates)
        for number, stations in enumerate(tried)
    ]
    inputs = {
        "stations": [{"name": name, "scan": {"file": f"f-{name}", "index": 0}} for name in block.names],
        "method": {"method": "auto"},
    }
    points = [{"sha256": "ab", "index": number, "name": name} for number, name in enumerate(block.names)]
    return {"job_id": JOB, "inputs": inputs, "features": features, "pairs": pairs, "viewer_points": points}


def store_features(
    files: StepFiles, key: str, block: CityBlock, number: int, templates: Templates, surface_points: int
) -> Json:
    """Store the features of a station; give the output of the step `features`."""
    rough = block.surfaces[number]
    points = rough[np.linspace(0, len(rough) - 1, surface_points).astype(np.int64)]
    normals, labels = np.tile([0.0, 0.0, 1.0], (len(points), 1)), np.full(len(points), -1, np.int32)
    own = replace(
        templates.features,
        planes=block.features[number].planes,
        surface=SurfaceSample(points, normals, labels, 0.3),
        origin_m=np.zeros(3),
    )
    _put(files, key, lambda path: save_features(path, own))
    counts = {"points": 10, "lines": 1, "planes": 2, "cylinders": 0, "noise_std_m": 0.002}
    counted = {"station": block.names[number], **counts}
    return {"features": key, "sha256": "ab", "counts": counted, "timings_s": {"read": 0.5}}


def store_pair(
    files: StepFiles,
    job_id: str,
    number: int | str,
    names: tuple[str, ...],
    link: StationLink | None,
    templates: Templates,
) -> Json:
    """Store a pair (target, source), whose registration is given or failed; give the output of `register-pair`."""
    target, source = names
    document = pair_between(templates.pair, target, source, link)
    pair, kept = f"jobs/{job_id}/pairs/{number}.json", f"jobs/{job_id}/links/{number}.npz"
    files.write_bytes(pair, document.model_dump_json(by_alias=True).encode())
    if link is not None:
        _put(files, kept, lambda path: save_link(path, link))
    stored = None if link is None else kept
    cost = {"seconds": 2.0, "peak_memory_bytes": None, "centre_m": [0.0, 0.0, 0.0]}
    return {"pair": pair, "status": document.status, "target": target, "source": source, "link": stored, **cost}


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
