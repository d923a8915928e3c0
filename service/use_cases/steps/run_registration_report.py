"""Put the pairs of a `register` job together: poses in the common frame, comparison, downloads."""

import json
from collections.abc import Mapping, Sequence

from schemas.requests.report_options import ReportOptions
from schemas.results.control_result import ControlResult
from schemas.results.network import Network
from schemas.results.registration_result import (
    Artifact,
    FeatureCount,
    Pair,
    RegisteredFile,
    RegistrationDocument,
)
from schemas.results.scene import StoredScene
from schemas.results.tolerance_check import ToleranceCheck
from service.names.feature_keys import viewer_points_of_step
from service.names.result_lists import comes_in_pages
from service.names.scene_keys import scene_key
from service.ports import Json, StepContext
from service.settings import Settings
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
from service.use_cases.reports.figures import document_figures
from service.use_cases.reports.method_files import method_files
from service.use_cases.reports.report_page import ReportFrame, report_page
from service.use_cases.reports.result_lines import ScanLines, lines_dxf, lines_ply, registered_lines
from service.use_cases.reports.result_tables_csv import correspondences_csv, matrix_text, pairs_csv, poses_csv
from service.use_cases.steps.feature_store import load_features
from service.use_cases.steps.method_results import compared_methods
from service.use_cases.steps.report_parts import (
    compared_poses,
    listed_download,
    printed_report,
    provenance_document,
    stored_pair,
)
from service.use_cases.steps.reported_poses import (
    PairsInNetwork,
    StationPose,
    overall_status,
    placed_stations,
    relative_to_first,
)
from service.use_cases.steps.run_paged_report import list_in_pages, report_large_network

MOST_WHOLE = Settings.model_fields["max_whole_stations"].default
"""Of a step that is told no limits."""


def report_registration(context: StepContext, arguments: Json) -> Json:
    """Write the result document and the downloads of a job; of a large network lists in its place."""
    job_id, inputs = arguments["job_id"], arguments["inputs"]
    network, tied = (
        None if stored is None else json.loads(context.blobs.local_path(stored).read_bytes())
        for stored in (arguments.get("network"), arguments.get("tied"))
    )
    names = [station["name"] for station in inputs["stations"]]
    most = context.limits.get("max_whole_stations", MOST_WHOLE)
    if network is not None and comes_in_pages(len(names), len(arguments["pairs"]), most):
        return report_large_network(context, arguments, network, tied)
    in_network = PairsInNetwork.of(network, arguments["features"])
    pairs = [in_network.judged(stored_pair(context, output)) for output in arguments["pairs"]]
    poses = placed_stations(names, pairs, network, tied)
    relative = relative_to_first(poses, tied)
    stations = [pose.station for pose in poses]
    scans, shown, fits = {}, {}, feature_fits(pairs)
    for output in arguments["features"]:
        name, features = output["counts"]["station"], load_features(context.blobs.local_path(output["features"]))
        scans[name], shown[name] = ScanLines.of_features(features), scene_station(name, features, fits)
    comparison, summary = compared_poses(relative, inputs.get("reference"))
    methods = compared_methods(context, arguments, pairs)
    joined = None if network is None else Network.model_validate(network["network"])
    timings = [output["timings_s"] for output in arguments["features"]] + [pair.timings_s for pair in pairs]
    document = RegistrationDocument(
        status=overall_status(stations),
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
        provenance=provenance_document(inputs, arguments["features"], timings),
    )
    files = {**_downloads(document, scans), **method_files(methods)}
    frame = ReportFrame(ReportOptions.model_validate(inputs.get("report") or {}), job_id, arguments.get("created"))
    estimates = {pose.station.name: pose.estimate for pose in poses if pose.estimate is not None}
    files |= printed_report(report_page(document, scans, estimates, frame), frame)
    artifacts = [listed_download(job_id, name, media, len(content)) for name, (media, content) in files.items()]
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
    job_id, key = arguments["job_id"], arguments["result"]
    stored = context.blobs.local_path(key).read_bytes()
    files = [RegisteredFile(**file) for output in arguments["written"] for file in output["files"]]
    if (large := json.loads(stored)).get("lists"):
        list_in_pages(context, job_id, large, files)
        return {"status": large["status"]}
    document = RegistrationDocument.model_validate_json(stored)
    before = [each for each in document.artifacts if each.name not in {"result.json", *(file.name for file in files)}]
    added = [Artifact(**{name: getattr(file, name) for name in Artifact.model_fields}) for file in files]
    document = document.model_copy(update={"registered": files, "artifacts": [*before, *added]})
    document, data = _with_itself(document, job_id)
    for name in (f"jobs/{job_id}/artifacts/result.json", key):
        context.blobs.write_bytes(name, data)
    return {"status": document.status}


def _downloads(document: RegistrationDocument, scans: Mapping[str, ScanLines]) -> dict[str, tuple[str, bytes]]:
    """Make the downloads beside the result itself: media type and content by name."""
    figures, pairs = document_figures(document), document.pairs
    stations = figures.stations
    lines = registered_lines(document.stations, scans, pairs)
    files = {
        "poses.csv": ("text/csv", poses_csv(stations).encode()),
        "pairs.csv": ("text/csv", pairs_csv(figures.pairs).encode()),
        "correspondences.csv": ("text/csv", correspondences_csv(pairs).encode()),
        "lines.ply": ("application/octet-stream", lines_ply(lines)),
        "lines.dxf": ("image/vnd.dxf", lines_dxf(lines)),
        "pairs.json": ("application/json", json.dumps([pair.model_dump(by_alias=True) for pair in pairs]).encode()),
    }
    placed = [station for station in stations if station.matrix is not None]
    return files | {f"{station.name}.txt": ("text/plain", matrix_text(station).encode()) for station in placed}


def _with_itself(document: RegistrationDocument, job_id: str) -> tuple[RegistrationDocument, bytes]:
    """List the document among its own downloads: its length counts the digits of its length."""
    others, size = document.artifacts, 0
    while True:
        artifacts = [*others, listed_download(job_id, "result.json", "application/json", size)]
        listed = document.model_copy(update={"artifacts": artifacts})
        data = listed.model_dump_json(by_alias=True).encode()
        if len(data) == size:
            return listed, data
        size = len(data)
