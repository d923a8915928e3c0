"""Adjust all stations of a `register` job at once."""

import json
import shutil
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np

from algorithms.arrays import Vector3
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.poses import PoseEstimate
from algorithms.network.links import StationLink
from algorithms.network.network_registration import NetworkRegistration, register_network
from algorithms.network.surface_control import SurfaceControl
from algorithms.network.track_observations import TrackKind
from algorithms.network.tracks import StationFeatures
from schemas.requests.scanner_options import ScannerOptions
from service.names.pair_statuses import IN_PLACE
from service.ports import Json, StepContext
from service.use_cases.documents.instrument_documents import (
    errors_taken_off,
    instrument_search,
    instruments_document,
    is_applied,
)
from service.use_cases.documents.network_documents import network_document
from service.use_cases.steps.feature_store import load_features
from service.use_cases.steps.link_store import load_link
from service.use_cases.steps.run_pair import method_of
from service.use_cases.steps.station_targets import target_set

KEPT_IN_MEMORY = 24
"""Scans whose surfaces are kept while stations are tested against each other."""


def adjust_network(context: StepContext, arguments: Json) -> Json:
    """Find the poses of all stations from the pairs in place, and store them with the figures of the network."""
    names: list[str] = arguments["names"]
    links, doubtful = (
        # targets are adjusted with all stations later
        [link for link in stored_links(context, arguments["pairs"], names, statuses) if not link.of_targets]
        for statuses in (IN_PLACE, ("doubtful",))
    )
    inputs: Json = arguments.get("inputs", {})
    context.progress.report(0.0, "loading features")
    features: dict[int, StationFeatures] = {}
    origins: dict[int, Vector3] = {}
    for number in sorted({0, *(station for link in (*links, *doubtful) for station in link.stations)}):
        loaded = _features_of(context, arguments, number)
        targets = target_set(inputs.get("targets", {}).get(names[number]), loaded.origin_m)
        features[number], origins[number] = StationFeatures.of_features(loaded, targets), loaded.origin_m
    context.progress.report(0.3, "adjusting all stations")
    control = SurfaceControl(lru_cache(KEPT_IN_MEMORY)(lambda number: _features_of(context, arguments, number)))
    options = method_of(arguments["method"]).adjustment
    asked = inputs.get("scanner")
    scanner = None if asked is None else ScannerOptions.model_validate(asked)
    search = None if scanner is None or not scanner.asks else instrument_search(scanner, names)
    result = register_network(features, links, names, options, doubtful=doubtful, control=control, instruments=search)
    network = network_document(result, links, doubtful, names)
    if scanner is not None and result.instruments is not None:
        network = network.model_copy(update={"instruments": instruments_document(result, scanner, names)})
    document = {
        "network": network.model_dump(by_alias=True),
        "poses": _poses(result, features, origins, names),
    }
    key = f"jobs/{arguments['job_id']}/network.json"
    context.blobs.write_bytes(key, json.dumps(document).encode())
    applied = scanner is not None and is_applied(result, scanner)
    # the covariance of all poses together, of n² elements, is for targets and control only
    needed = arguments.get("ties", True)
    return {
        "network": key,
        "poses": _stored_poses(context, arguments["job_id"], result, applied=applied) if needed else None,
    }


def _stored_poses(context: StepContext, job_id: str, result: NetworkRegistration, *, applied: bool) -> str:
    """Keep the poses between the reduced frames with their joint covariance, for targets and control.

    With them the errors of the instruments that were taken off the poses, to be taken off the targets too.
    """
    stations = [0, *(station for station in result.poses if station != 0)]
    key = f"jobs/{job_id}/network.npz"
    scratch = context.blobs.scratch()
    try:
        np.savez(
            scratch / "network.npz",
            stations=np.array(stations, dtype=np.int64),
            matrices=np.array([result.poses[station].target_from_source.as_matrix() for station in stations]),
            covariance=np.zeros((0, 0)) if result.covariances is None else result.covariances.together(),
            instrument_errors=np.array([errors_taken_off(result, station, applied=applied) for station in stations]),
        )
        context.blobs.put_file(key, scratch / "network.npz")
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return key


def _features_of(context: StepContext, arguments: Json, number: int) -> ScanFeatures:
    return load_features(context.blobs.local_path(arguments["features"][number]))


def stored_links(
    context: StepContext, pairs: Sequence[Json], names: Sequence[str], statuses: Sequence[str]
) -> list[StationLink]:
    """Load what pairs of some statuses left for the network.

    Parameters
    ----------
    context
        Of the step.
    pairs
        Outputs of the pairs.
    names
        Of all stations, in order.
    statuses
        Theirs.
    """
    place = {name: number for number, name in enumerate(names)}
    return [
        load_link(context.blobs.local_path(pair["link"]), place[pair["target"]], place[pair["source"]])
        for pair in pairs
        if pair["link"] is not None and pair["status"] in statuses
    ]


def _poses(
    result: NetworkRegistration,
    features: Mapping[int, StationFeatures],
    origins: Mapping[int, Vector3],
    names: Sequence[str],
) -> Json:
    """Give the poses between full coordinates, covariances, and where the features of each station are."""
    poses, adjusted = {}, _adjusted_places(result, features)
    for station, reduced in result.poses.items():
        pose = reduced.moved_to_origins(origins[0], origins[station])
        poses[names[station]] = {
            "matrix": pose.target_from_source.as_matrix().tolist(),
            "covariance": pose.covariance.tolist(),
            "centroid_m": _centroid(reduced, adjusted.get(station), origins[0]),
            "a_posteriori": result.variance_factor > 1.0,
        }
    return poses


def _adjusted_places(result: NetworkRegistration, features: Mapping[int, StationFeatures]) -> dict[int, list[Vector3]]:
    """Give where the features of each station in the adjustment are, in its reduced frame."""
    found: dict[int, list[Vector3]] = {}
    for track in () if result.joint is None else result.joint.tracks:
        for station, number in track.members:
            seen = features[station]
            places = seen.planes.centroids if track.kind is TrackKind.PLANE else seen.lines.anchors
            found.setdefault(station, []).append(places[number])
    return found


def _centroid(pose: PoseEstimate, places: Sequence[Vector3] | None, origin_m: Vector3) -> list[float] | None:
    """Give the centroid of a station's features in the adjustment, in the full coordinates of the first station."""
    if places is None:
        return None
    centroid = pose.target_from_source.apply(np.mean(places, axis=0)) + origin_m
    return [float(coordinate) for coordinate in centroid]
