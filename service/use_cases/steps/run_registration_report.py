"""Put the pairs of a `register` job together: poses in the common frame, comparison, downloads."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from urllib.parse import quote

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.geometry.poses import PoseEstimate
from schemas.requests.report_options import ReportOptions
from schemas.results.comparison import ComparedParameter, StationComparison
from schemas.results.control_result import ControlResult
from schemas.results.network import Network
from schemas.results.registration_result import (
    Artifact,
    FeatureCount,
    Pair,
    Provenance,
    RegisteredFile,
    RegistrationDocument,
    Station,
)
from schemas.results.scene import StoredScene
from schemas.results.tolerance_check import ToleranceCheck
from schemas.values.poses import Pose
from service.names.feature_keys import viewer_points_of_step
from service.names.scene_keys import scene_key
from service.ports import Json, StepContext
from service.use_cases.documents.comparison_documents import comparison_documents
from service.use_cases.documents.pose_documents import fixed_pose_document, pose_document
from service.use_cases.documents.scene_documents import (
    feature_fits,
    scene_control,
    scene_pair,
    scene_stages,
    scene_station,
    with_pose,
    with_targets,
)
from service.use_cases.documents.tolerance_documents import station_precision, tolerance_check
from service.use_cases.reports.method_files import method_files
from service.use_cases.reports.report_page import ReportFrame, report_page
from service.use_cases.reports.report_pdf import can_print, report_pdf
from service.use_cases.reports.result_lines import ScanLines, lines_dxf, lines_ply, registered_lines
from service.use_cases.reports.result_tables_csv import correspondences_csv, poses_csv
from service.use_cases.steps.feature_store import load_features
from service.use_cases.steps.method_results import compared_methods
from service.use_cases.steps.run_features import SEED
from service.use_cases.steps.run_lines_report import input_files, software
from service.use_cases.steps.run_pair import method_of

STATUSES = ("accepted", "doubtful", "ambiguous", "degenerate", "rejected")
"""Of pairs, the most promising first."""


@dataclass(frozen=True)
class StationPose:
    """A station's pose in the common frame, or why it has none."""

    station: Station
    estimate: PoseEstimate | None


def report_registration(context: StepContext, arguments: Json) -> Json:
    """Write the result document and the downloads of a job."""
    job_id, inputs = arguments["job_id"], arguments["inputs"]
    stored = arguments.get("network")
    network = None if stored is None else json.loads(context.blobs.local_path(stored).read_bytes())
    found = [
        Pair.model_validate_json(context.blobs.local_path(output["pair"]).read_bytes()) for output in arguments["pairs"]
    ]
    pairs = _with_warnings(_judged_by_loops(found, network), arguments["features"])
    stored = arguments.get("tied")
    tied = None if stored is None else json.loads(context.blobs.local_path(stored).read_bytes())
    names = [station["name"] for station in inputs["stations"]]
    poses = _station_poses(names, pairs, network) if tied is None else _tied_poses(names, pairs, network, tied)
    relative = _relative_to_first(poses, tied)
    stations = [pose.station for pose in poses]
    scans, shown, fits = {}, {}, feature_fits(pairs)
    for output in arguments["features"]:
        name, features = output["counts"]["station"], load_features(context.blobs.local_path(output["features"]))
        scans[name], shown[name] = ScanLines.of_features(features), scene_station(name, features, fits)
    unregistered = sum(station.status == "unregistered" for station in stations)
    others = len(stations) - any(station.status == "fixed" for station in stations)
    comparison, summary = (
        (None, None) if inputs.get("reference") is None else _comparison(relative, inputs["reference"])
    )
    methods = compared_methods(context, arguments, pairs)
    files = {**_downloads(stations, pairs, scans), **method_files(methods)}
    joined = None if network is None else Network.model_validate(network["network"])
    document = RegistrationDocument(
        status=_overall(others, unregistered),
        stations=stations,
        pairs=pairs,
        network=joined,
        method_comparison=methods,
        control=None if tied is None else ControlResult.model_validate(tied["control"]),
        tolerance=_tolerance(inputs.get("tolerance"), relative, scans, pairs, joined),
        features=[FeatureCount(**output["counts"]) for output in arguments["features"]],
        comparison=comparison,
        comparison_summary=summary,
        artifacts=[],
        provenance=_provenance(inputs, arguments["features"], pairs),
    )
    frame = ReportFrame(ReportOptions.model_validate(inputs.get("report") or {}), job_id, arguments.get("created"))
    files |= _reports(document, scans, poses, frame)
    artifacts = [_artifact(job_id, name, media, len(content)) for name, (media, content) in files.items()]
    document = document.model_copy(update={"artifacts": artifacts})
    document, data = _with_itself(document, job_id)
    for name, (_, content) in {**files, "result.json": ("", data)}.items():
        context.blobs.write_bytes(f"jobs/{job_id}/artifacts/{name}", content)
    scene = StoredScene(
        stations=[with_targets(with_pose(shown[each.name], each), document.control) for each in stations],
        control=scene_control(document.control, {} if tied is None else tied.get("places") or {}),
        stages=scene_stages(stations, pairs),
        pairs=[scene_pair(pair) for pair in pairs],
        points=[viewer_points_of_step(each) for each in arguments.get("viewer_points", [])],
    )
    context.blobs.write_bytes(scene_key(job_id), scene.model_dump_json(by_alias=True).encode())
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", data)
    return {"status": document.status}


def _reports(
    document: RegistrationDocument, scans: Mapping[str, ScanLines], poses: Sequence[StationPose], frame: ReportFrame
) -> dict[str, tuple[str, bytes]]:
    """Make the report as page, and of that page the PDF where this machine can."""
    estimates = {pose.station.name: pose.estimate for pose in poses if pose.estimate is not None}
    page = report_page(document, scans, estimates, frame)
    files = {"report.html": ("text/html", page.encode())}
    if can_print():
        footer = " · ".join(
            text for text in (frame.messages("report.title"), frame.options.project, frame.job_id) if text
        )
        files["report.pdf"] = (
            "application/pdf",
            report_pdf(page, frame.messages, footer=footer, created=frame.created),
        )
    return files


def _tolerance(
    asked: Json | None,
    poses: Sequence[StationPose],
    scans: Mapping[str, ScanLines],
    pairs: Sequence[Pair],
    network: Network | None,
) -> ToleranceCheck:
    precisions = [
        station_precision(
            pose.station.name,
            pose.estimate,
            scans[pose.station.name].surface_m,
            scans[pose.station.name].origin_m,
            asked,
        )
        for pose in poses[1:]
    ]
    return tolerance_check(asked, precisions, [pose.station for pose in poses], pairs, network)


def list_registered(context: StepContext, arguments: Json) -> Json:
    """Add the files with the registered scans, which are written from the result document, to that document."""
    job_id = arguments["job_id"]
    key = arguments["result"]
    document = RegistrationDocument.model_validate_json(context.blobs.local_path(key).read_bytes())
    files = [RegisteredFile(**file) for output in arguments["written"] for file in output["files"]]
    before = [each for each in document.artifacts if each.name not in {"result.json", *(file.name for file in files)}]
    added = [Artifact(**{name: getattr(file, name) for name in Artifact.model_fields}) for file in files]
    document = document.model_copy(update={"registered": files, "artifacts": [*before, *added]})
    document, data = _with_itself(document, job_id)
    for name in (f"jobs/{job_id}/artifacts/result.json", key):
        context.blobs.write_bytes(name, data)
    return {"status": document.status}


def _tied_poses(names: Sequence[str], pairs: Sequence[Pair], network: Json | None, tied: Json) -> list[StationPose]:
    """Give the poses from the adjustment with targets and control; where there is none, those of the scans.

    Without poses in the frame that was asked for the first station carries the frame, and the result says why.
    """
    if tied["poses"] is None:
        return _station_poses(names, pairs, network)
    found = []
    for name in names:
        pose = tied["poses"].get(name)
        if name == tied["fixed"]:
            fixed = Station(name=name, status="fixed", world_from_scan=fixed_pose_document(name))
            found.append(StationPose(fixed, PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))))
        elif pose is None:
            why = _why_not(name, pairs)
            station = Station(name=name, status="unregistered", reason=why, world_from_scan=None)
            found.append(StationPose(station, None))
        else:
            registered = _registered(name, _stored(pose), None, a_posteriori=pose["a_posteriori"])
            doubt = registered.station.model_copy(update={"reason": tied["contradicted"].get(name)})
            found.append(replace(registered, station=doubt))
    return found


def _stored(pose: Json) -> PoseEstimate:
    return PoseEstimate(RigidTransform.from_matrix(np.array(pose["matrix"])), np.array(pose["covariance"]))


def _relative_to_first(poses: Sequence[StationPose], tied: Json | None) -> Sequence[StationPose]:
    """Give the poses in the frame of the first station, for what is told relative to it."""
    if tied is None or tied["poses"] is None or tied["relative"] is None:
        return poses
    told = {name: _stored(pose) for name, pose in tied["relative"].items()}
    return [StationPose(pose.station, told.get(pose.station.name)) for pose in poses]


def _overall(stations: int, unregistered: int) -> str:
    if unregistered == 0:
        return "registered"
    return "not-registered" if unregistered == stations else "partly-registered"


def _station_poses(names: Sequence[str], pairs: Sequence[Pair], network: Json | None) -> list[StationPose]:
    """Give the poses from the adjustment of all stations, of two stations that of their pair."""
    known = _pair_poses(names, pairs) if network is None else _network_poses(names, network)
    fixed = Station(name=names[0], status="fixed", world_from_scan=fixed_pose_document(names[0]))
    poses = [StationPose(fixed, PoseEstimate(RigidTransform.identity(), np.zeros((6, 6))))]
    for name in names[1:]:
        if name in known:
            poses.append(known[name])
        else:
            station = Station(name=name, status="unregistered", reason=_why_not(name, pairs), world_from_scan=None)
            poses.append(StationPose(station, None))
    return poses


def _pair_poses(names: Sequence[str], pairs: Sequence[Pair]) -> dict[str, StationPose]:
    """Give the pose of the second of two stations from their pair."""
    for pair in pairs:
        own = pair.target_from_source
        if pair.status != "accepted" or own is None or names[0] not in {pair.target, pair.source}:
            continue
        name, is_direct = (pair.source, True) if pair.target == names[0] else (pair.target, False)
        estimate = _estimate(own) if is_direct else _estimate(own).inverse()
        centroid = own.std_at_centroid_m.point_m if is_direct and own.std_at_centroid_m else None
        return {name: _registered(name, estimate, centroid, a_posteriori=own.covariance_sigma0 == "a-posteriori")}
    return {}


def _network_poses(names: Sequence[str], network: Json) -> dict[str, StationPose]:
    """Give the poses that the adjustment of all stations stored."""
    return {
        name: _registered(
            name,
            PoseEstimate(RigidTransform.from_matrix(np.array(pose["matrix"])), np.array(pose["covariance"])),
            pose["centroid_m"],
            a_posteriori=pose["a_posteriori"],
        )
        for name, pose in network["poses"].items()
        if name != names[0]
    }


def _registered(
    name: str, estimate: PoseEstimate, centroid_m: Sequence[float] | None, *, a_posteriori: bool
) -> StationPose:
    document = pose_document(
        estimate,
        target="world",
        source=name,
        centroid_m=None if centroid_m is None else np.array(centroid_m),
        a_posteriori=a_posteriori,
    )
    return StationPose(Station(name=name, status="registered", world_from_scan=document), estimate)


def _estimate(pose: Pose) -> PoseEstimate:
    return PoseEstimate(RigidTransform.from_matrix(np.array(pose.matrix)), np.array(pose.covariance))


def _judged_by_loops(pairs: Sequence[Pair], network: Json | None) -> list[Pair]:
    """Take back the acceptance of pairs that contradict others."""
    if network is None:
        return list(pairs)
    rejected = {
        (link["target"], link["source"]): link["reason"]
        for link in network["network"]["links"]
        if link["state"] == "rejected"
    }
    return [
        pair
        if (reason := rejected.get((pair.target, pair.source))) is None or pair.status != "accepted"
        else pair.model_copy(update={"status": "rejected", "reasons": [reason, *pair.reasons]})
        for pair in pairs
    ]


def _with_warnings(pairs: Sequence[Pair], features: Sequence[Json]) -> list[Pair]:
    """Add to the reasons of each pair what is to be said of how its scans were read."""
    said = {output["counts"]["station"]: output["counts"].get("warnings", []) for output in features}
    return [
        pair.model_copy(
            update={"reasons": list(dict.fromkeys([*pair.reasons, *said[pair.target], *said[pair.source]]))}
        )
        for pair in pairs
    ]


def _why_not(name: str, pairs: Sequence[Pair]) -> str:
    tried = [pair for pair in pairs if name in {pair.target, pair.source}]
    if not tried:
        return "no pair with this station was tried"
    counts = ", ".join(f"{count} {status}" for status, count in Counter(pair.status for pair in tried).items())
    if any(pair.status == "accepted" for pair in tried):
        return f"connected only to stations that are not connected to the first one ({counts})"
    nearest = min(tried, key=lambda pair: STATUSES.index(pair.status))
    other = nearest.source if nearest.target == name else nearest.target
    reason = f"; with {other}: {nearest.reasons[0]}" if nearest.reasons else ""
    return f"no pair was accepted ({counts}){reason}"


def _comparison(
    poses: Sequence[StationPose], reference: Json
) -> tuple[list[ComparedParameter], list[StationComparison]]:
    estimates = {pose.station.name: pose.estimate for pose in poses[1:] if pose.estimate is not None}
    return comparison_documents(poses[0].station.name, estimates, reference)


def _provenance(inputs: Json, features: Sequence[Json], pairs: Sequence[Pair]) -> Provenance:
    timings: Counter[str] = Counter()
    for part in [output["timings_s"] for output in features] + [pair.timings_s for pair in pairs]:
        timings.update(part)
    method = method_of(inputs["method"])
    return Provenance(
        software=software(),
        method={
            "method": method.name,
            "requested": inputs["method"]["method"],
            **asdict(method),
            **(
                {"photo_lines": inputs["photo_lines"]} if any(each.get("photos") for each in inputs["stations"]) else {}
            ),
        },
        seed=SEED,
        inputs=[
            file
            for station, output in zip(inputs["stations"], features, strict=True)
            for file in input_files(station, output)
        ],
        timings_s=dict(timings),
    )


def _downloads(
    stations: Sequence[Station], pairs: Sequence[Pair], scans: Mapping[str, ScanLines]
) -> dict[str, tuple[str, bytes]]:
    """Make the downloads beside the result itself: media type and content by name."""
    lines = registered_lines(stations, scans, pairs)
    files = {
        "poses.csv": ("text/csv", poses_csv(stations).encode()),
        "correspondences.csv": ("text/csv", correspondences_csv(pairs).encode()),
        "lines.ply": ("application/octet-stream", lines_ply(lines)),
        "lines.dxf": ("image/vnd.dxf", lines_dxf(lines)),
        "pairs.json": ("application/json", json.dumps([pair.model_dump(by_alias=True) for pair in pairs]).encode()),
    }
    for station in stations:
        if station.world_from_scan is not None:
            rows = [" ".join(repr(v) for v in row) for row in station.world_from_scan.matrix]
            files[f"{station.name}.txt"] = ("text/plain", ("\n".join(rows) + "\n").encode())
    return files


def _artifact(job_id: str, name: str, media_type: str, size: int) -> Artifact:
    return Artifact(name=name, type=media_type, bytes=size, href=f"/jobs/{job_id}/artifacts/{quote(name)}")


def _with_itself(document: RegistrationDocument, job_id: str) -> tuple[RegistrationDocument, bytes]:
    """List the document among its own downloads: its length counts the digits of its length."""
    others, size = document.artifacts, 0
    while True:
        artifacts = [*others, _artifact(job_id, "result.json", "application/json", size)]
        listed = document.model_copy(update={"artifacts": artifacts})
        data = listed.model_dump_json(by_alias=True).encode()
        if len(data) == size:
            return listed, data
        size = len(data)
