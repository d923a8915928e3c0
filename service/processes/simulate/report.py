"""Write what a planned network would give: the result document, the truth, and a plan of the links."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Points
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.poses import PoseEstimate
from algorithms.simulation.instruments import INSTRUMENTS
from algorithms.simulation.scanning import range_std_m
from schemas.results.registration_result import Artifact, Pair
from schemas.results.simulation_result import (
    ExpectedPair,
    SimulatedInstrument,
    SimulatedPhoto,
    SimulatedStation,
    SimulationDocument,
)
from schemas.values.poses import PoseStd
from service.names.pair_statuses import IN_PLACE
from service.ports import Json, StepContext
from service.processes.simulate.links_drawing import links_drawing
from service.processes.simulate.scanning import scanner_of
from service.use_cases.documents.pose_documents import matrix_rows, pose_document
from service.use_cases.steps.output_files import artifact, output_file

NEAR_M = 0.5
"""Points with a point of the other scan so near overlap (Dold, Ripperda and Brenner 2007)."""
TYPICAL_M, GREY = 10.0, 0.5
"""Range and reflectance for which the noise of an instrument is told."""


@dataclass(frozen=True, eq=False)
class _Found:
    """What came out for a station in the frame of the first one."""

    estimate: PoseEstimate | None
    truth: RigidTransform
    status: str


def _as_listed(photo: Json) -> Json:
    """Give a photo as a request of `register` or `calibrate-mount` lists it: with its stated pose."""
    return {"file": photo["file"], "camera": photo["camera"], "scan_from_camera": photo["stated_scan_from_camera"]}


def report_simulation(context: StepContext, arguments: Json) -> Json:
    """Write the result document and the downloads beside the scans."""
    job_id, inputs, stations = arguments["job_id"], arguments["inputs"], arguments["stations"]
    setups = arguments["scene"]["setups"]
    poses = [RigidTransform.from_matrix(np.array(setup["world_from_scan"])) for setup in setups]
    names = [setup["name"] for setup in setups]
    pairs = None if arguments["pairs"] is None else _pairs_of(context, arguments["pairs"])
    network = _network_of(context, arguments["network"])
    found = _found_poses(names, poses, pairs, network)
    expected = [] if pairs is None else list(_expected_pairs(context, names, stations, pairs, network))
    documents = [
        _station(station, pose, None if pairs is None else each)
        for station, pose, each in zip(stations, poses, found, strict=True)
    ]
    listed = [Artifact(**each) for station in stations for each in station["artifacts"]]
    truth = {name: matrix_rows(pose) for name, pose in zip(names, poses, strict=True)}
    texts = {"truth.json": ("application/json", json.dumps(truth, indent=1))}
    if inputs["photos"] is not None:
        photos = [{"name": each["name"], "photos": list(map(_as_listed, each["photos"]))} for each in stations]
        texts["photos.json"] = ("application/json", json.dumps({"stations": photos}, indent=1))
    if pairs is not None:
        texts["links.svg"] = ("image/svg+xml", links_drawing(setups, expected))
    listed += _texts(context, job_id, texts)
    registered = [each.expected_status for each in documents]
    document = SimulationDocument(
        scene=arguments["scene"]["scene"],
        triangles=arguments["scene"]["triangles"],
        instrument=_instrument(inputs),
        stations=documents,
        pairs=expected,
        connected=None if pairs is None else "unregistered" not in registered,
        seed=inputs["seed"],
        remarks=[note for station in stations for note in station["notes"]],
        artifacts=listed,
    )
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"stations": len(documents)}


def _texts(context: StepContext, job_id: str, texts: Mapping[str, tuple[str, str]]) -> Iterator[Artifact]:
    for name, (media_type, text) in texts.items():
        with output_file(context, job_id, name) as path:
            path.write_text(text, encoding="utf-8")
        yield artifact(context, job_id, name, media_type)


def _pairs_of(context: StepContext, outputs: Sequence[Json]) -> list[Pair]:
    return [Pair.model_validate_json(context.blobs.local_path(output["pair"]).read_bytes()) for output in outputs]


def _network_of(context: StepContext, key: str | None) -> Json | None:
    return None if key is None else json.loads(context.blobs.local_path(key).read_bytes())


def _instrument(inputs: Json) -> SimulatedInstrument:
    scanner, known = scanner_of(inputs), INSTRUMENTS[inputs["instrument"]]
    typical = range_std_m(scanner, np.array([TYPICAL_M]), np.array([1.0]), np.array([GREY]))
    beams = scanner.rows * scanner.columns
    return SimulatedInstrument(
        name=known.name,
        title=known.title,
        source=known.source,
        step_gon=scanner.column_step_rad * GON_PER_RAD,
        range_std_m=float(typical[0]),
        footprint_at_50m_m=scanner.beam_exit_diameter_m + 50.0 * scanner.beam_divergence_rad,
        max_range_m=scanner.max_range_m,
        points_at_once=beams,
        minutes=beams * inputs["shots"] / known.points_per_s / 60.0,
    )


def _found_poses(
    names: Sequence[str], poses: Sequence[RigidTransform], pairs: Sequence[Pair] | None, network: Json | None
) -> list[_Found]:
    """Give the pose of every station in the frame of the first as the registration found it, beside the true one."""
    known: dict[str, PoseEstimate] = {}
    if network is not None:
        known = {name: _estimate(pose["matrix"], pose["covariance"]) for name, pose in network["poses"].items()}
    for pair in pairs or () if network is None else ():
        pose = pair.target_from_source
        if pair.status in IN_PLACE and pose is not None and pose.covariance is not None:
            known[pair.source] = _estimate(pose.matrix, pose.covariance)
    found = []
    for name, world_from_scan in zip(names, poses, strict=True):
        truth = poses[0].inv() * world_from_scan
        if name == names[0]:
            found.append(_Found(None, truth, "fixed"))
        else:
            found.append(_Found(known.get(name), truth, "registered" if name in known else "unregistered"))
    return found


def _estimate(matrix: Sequence[Sequence[float]], covariance: Sequence[Sequence[float]]) -> PoseEstimate:
    return PoseEstimate(RigidTransform.from_matrix(np.array(matrix)), np.array(covariance))


def _station(station: Json, pose: RigidTransform, found: _Found | None) -> SimulatedStation:
    estimate = None if found is None else found.estimate
    std: PoseStd | None = None
    point_std = error_gon = error_m = None
    if found is not None and estimate is not None:
        std = pose_document(estimate, target="first", source=station["name"], centroid_m=None).std
        ahead = estimate.target_from_source.apply(np.array([TYPICAL_M, 0.0, 0.0]))
        point_std = float(np.sqrt(np.trace(estimate.position_covariance_m2(ahead))))
        error_gon = float((estimate.rotation * found.truth.rotation.inv()).magnitude()) * GON_PER_RAD
        error_m = float(np.linalg.norm(estimate.translation_m - np.asarray(found.truth.translation)))
    return SimulatedStation(
        name=station["name"],
        world_from_scan=matrix_rows(pose),
        file=station["file"],
        points=station["points"],
        lines=station["lines"],
        planes=station["planes"],
        photos=[
            SimulatedPhoto(
                name=photo["file"],
                scan_from_camera=photo["scan_from_camera"],
                stated_scan_from_camera=photo["stated_scan_from_camera"],
            )
            for photo in station["photos"]
        ],
        expected_status=None if found is None else found.status,
        expected_std=std,
        expected_point_std_m=point_std,
        error_gon=error_gon,
        error_m=error_m,
    )


def _expected_pairs(
    context: StepContext,
    names: Sequence[str],
    stations: Sequence[Json],
    pairs: Sequence[Pair],
    network: Json | None,
) -> Iterator[ExpectedPair]:
    """Give overlaps of all pairs of set-ups, and what the registration made of those that were tried."""
    shares = _overlaps([_sample(context, station["sample"]) for station in stations])
    tried = {(pair.target, pair.source): pair for pair in pairs}
    states = {} if network is None else {(link["target"], link["source"]): link for link in network["network"]["links"]}
    for i, j in combinations(range(len(names)), 2):
        pair = tried.get((names[i], names[j]))
        pose = None if pair is None else pair.target_from_source
        link = states.get((names[i], names[j]), {}).get("state")
        if network is None and pair is not None and pair.status in IN_PLACE:
            link = "uncontrolled"
        yield ExpectedPair(
            target=names[i],
            source=names[j],
            overlap_0_5m=shares[i, j],
            overlap_back_0_5m=shares[j, i],
            status=None if pair is None else pair.status,
            link=link,
            std=None if pose is None else pose.std,
            std_at_centroid_m=None if pose is None else pose.std_at_centroid_m,
            reason=pair.reasons[0] if pair is not None and pair.reasons else "",
        )


def _sample(context: StepContext, key: str) -> Points:
    with np.load(context.blobs.local_path(key), allow_pickle=False) as archive:
        return np.asarray(archive["points"], dtype=np.float64)


def _overlaps(samples: Sequence[Points]) -> dict[tuple[int, int], float]:
    """Give the share of the points of each scan with a point of each other one near, by even samples of both."""
    trees = [cKDTree(points) for points in samples]
    shares = {}
    for i, j in permutations(range(len(samples)), 2):
        distances = trees[j].query(samples[i][::3], distance_upper_bound=NEAR_M)[0]
        shares[i, j] = float(np.isfinite(distances).mean())
    return shares
