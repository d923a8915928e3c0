"""Put the pairs of a large network together: rows of lists that are read page by page, and a report of the worst."""

import io
import json
import shutil
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from heapq import nsmallest
from operator import itemgetter

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.features.scan_features import ScanFeatures
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
from schemas.results.result_lists import NetworkCounts
from schemas.results.scene import ScenePages, StoredScene
from schemas.results.tolerance_check import StationPrecision
from service.formats.ply_edges_writer import Segments, write_ply_edges
from service.names.feature_keys import viewer_points_of_step
from service.names.result_lists import placed_key
from service.names.scene_keys import SCENE_PAIRS, SCENE_POINTS, SCENE_STATIONS, scene_key
from service.ports import Json, StepContext
from service.use_cases.documents.scene_documents import (
    FeatureFit,
    note_fits,
    scene_control,
    scene_pair,
    scene_station,
    with_pose,
    with_targets,
)
from service.use_cases.documents.tolerance_documents import station_precision, tolerance_check
from service.use_cases.reports.figures import (
    PICKED_OF_PAIR,
    PairFigures,
    StationFigures,
    document_figures,
    pair_figures,
)
from service.use_cases.reports.network_extract import (
    MOST_PAIRS,
    NetworkPicture,
    NetworkReport,
    concern,
    report_of_network,
)
from service.use_cases.reports.report_page import ReportFrame
from service.use_cases.reports.result_lines import ScanLines, lines_of_station
from service.use_cases.reports.result_tables_csv import matrix_text, poses_csv
from service.use_cases.steps.feature_store import load_features
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
from service.use_cases.steps.result_rows import RowWriter, without_lists

OF_PAIRS, OF_STATIONS = 0.5, 0.9
"""How far the step is after its pairs, and after its stations; the rest is the report."""
Download = tuple[str, bytes]


@dataclass(eq=False)
class _Digest:
    """What is kept of all pairs while their rows are written: little of each."""

    pairs: list[Pair] = field(default_factory=list)
    """Without pose, adjustment and correspondences."""
    rows: list[PairFigures] = field(default_factory=list)
    """What is to be looked at first comes first."""
    worst: list[tuple[tuple[int, float], int, Pair]] = field(default_factory=list)
    """Those whose protocols stand in the report: how much they concern, number, pair."""
    fits: dict[str, FeatureFit] = field(default_factory=dict)
    timings_s: Counter[str] = field(default_factory=Counter)


def report_large_network(context: StepContext, arguments: Json, network: Json, tied: Json | None) -> Json:
    """Write the rows of stations, pairs and the like, the document without them, and the downloads.

    Memory is that of the poses of all stations, of the network, and of a few figures for each pair; features and pairs
    are read one after the other.

    Parameters
    ----------
    context, arguments
        As of `report_registration`.
    network, tied
        What the adjustments of all stations stored.
    """
    job_id, inputs = arguments["job_id"], arguments["inputs"]
    writer = RowWriter(context.blobs, job_id)
    joined = Network.model_validate(network["network"])
    names = [station["name"] for station in inputs["stations"]]
    digest = _digest_of_pairs(context, arguments, network, joined, writer)
    poses = placed_stations(names, digest.pairs, network, tied)
    relative = relative_to_first(poses, tied)
    control = None if tied is None else ControlResult.model_validate(tied["control"])
    shown = _StationsShown(digest.fits, control, NetworkPicture(len(names)), inputs.get("tolerance"), writer)
    listed = [_write_lines(context, job_id, shown.read_all(context, arguments["features"], poses, relative))]
    digest.fits.clear()
    stations = [pose.station for pose in poses]
    comparison, summary = compared_poses(relative, inputs.get("reference"))
    timings = [output["timings_s"] for output in arguments["features"]]
    whole = RegistrationDocument(
        status=overall_status(stations),
        stations=stations,
        pairs=digest.pairs,
        network=joined,
        control=control,
        tolerance=tolerance_check(inputs.get("tolerance"), shown.precisions, stations, digest.pairs, joined),
        features=[FeatureCount(**output["counts"]) for output in arguments["features"]],
        comparison=comparison,
        comparison_summary=summary,
        artifacts=[],
        provenance=provenance_document(inputs, arguments["features"], [*timings, digest.timings_s]),
    )
    _write_lists(whole, writer)
    frame = ReportFrame(ReportOptions.model_validate(inputs.get("report") or {}), job_id, arguments.get("created"))
    context.progress.report(OF_STATIONS, "writing the report")
    files = _downloads(document_figures(whole).stations) | _report(
        context, arguments, whole, digest, shown.picture, frame
    )
    for name, (media, content) in files.items():
        context.blobs.write_bytes(f"jobs/{job_id}/artifacts/{name}", content)
        listed.append(listed_download(job_id, name, media, len(content)))
    _write_scene(context, arguments, whole, tied, writer)
    writer.finish()
    _write_document(context, job_id, whole, listed, writer)
    return {"status": whole.status}


def _digest_of_pairs(
    context: StepContext, arguments: Json, network: Json, joined: Network, writer: RowWriter
) -> _Digest:
    """Write the row of every pair, and keep what the stations and the report need of it."""
    digest, in_network = _Digest(), PairsInNetwork.of(network, arguments["features"])
    states, outputs = {(link.target, link.source): link for link in joined.links}, arguments["pairs"]
    ranked: list[tuple[tuple[int, float], int, PairFigures]] = []
    for number, output in enumerate(outputs):
        context.progress.report(OF_PAIRS * number / len(outputs), f"pair {number + 1} of {len(outputs)}")
        pair = in_network.judged(stored_pair(context, output))
        writer.add("pairs", pair)
        writer.add(SCENE_PAIRS, scene_pair(pair))
        note_fits(digest.fits, pair)
        digest.timings_s.update(pair.timings_s)
        link = states.get((pair.target, pair.source))
        picked = pair.model_dump(by_alias=True, include=PICKED_OF_PAIR)
        row = pair_figures(picked, None if link is None else link.model_dump(), alone=False)
        looked_at = concern(link, row.std_worst_m)
        ranked.append((looked_at, number, row))
        digest.pairs.append(_stripped(pair))
        digest.worst = nsmallest(MOST_PAIRS, [*digest.worst, (looked_at, number, pair)], key=itemgetter(0, 1))
    digest.rows = [row for _, _, row in sorted(ranked, key=itemgetter(0, 1))]
    return digest


def _stripped(pair: Pair) -> Pair:
    """Keep of a pair who and what became of it."""
    nothing = dict.fromkeys(("target_from_source", "coarse", "adjustment", "accuracy", "rank_report", "overlap"))
    return Pair(
        target=pair.target,
        source=pair.source,
        status=pair.status,
        reasons=pair.reasons[:1],
        correspondences=[],
        plane_correspondences=[],
        outliers=[],
        weak_directions=[],
        timings_s={},
        **nothing,
    )


@dataclass(eq=False)
class _StationsShown:
    """Read the features of each station once: its part of the scene and of the pictures, its precision, its lines."""

    fits: Mapping[str, FeatureFit]
    control: ControlResult | None
    picture: NetworkPicture
    tolerance: Json | None
    writer: RowWriter
    precisions: list[StationPrecision] = field(default_factory=list)
    """Of all stations but the first, which carries the frame."""

    def read_all(
        self,
        context: StepContext,
        outputs: Sequence[Json],
        poses: Sequence[StationPose],
        relative: Sequence[StationPose],
    ) -> Iterator[Segments]:
        """Give the lines of each registered station in the world frame with their colours, and note the rest."""
        for number, (output, in_world, to_first) in enumerate(zip(outputs, poses, relative, strict=True)):
            share = OF_PAIRS + (OF_STATIONS - OF_PAIRS) * number / len(outputs)
            context.progress.report(share, f"station {number + 1} of {len(outputs)}")
            station = in_world.station
            features: ScanFeatures = load_features(context.blobs.local_path(output["features"]))
            shown = with_targets(with_pose(scene_station(station.name, features, self.fits), station), self.control)
            self.writer.add(SCENE_STATIONS, shown)
            scan = ScanLines.of_features(features)
            self.picture.add(station, scan)
            if number > 0:
                self.precisions.append(
                    station_precision(station.name, to_first.estimate, scan.surface_m, scan.origin_m, self.tolerance)
                )
            if station.world_from_scan is not None:
                pose = RigidTransform.from_matrix(np.array(station.world_from_scan.matrix))
                states = {line.id: line.state for line in shown.lines}
                lines = lines_of_station(station.name, scan, pose, states)
                yield lines.starts, lines.ends, lines.colors


def _write_lines(context: StepContext, job_id: str, parts: Iterator[Segments]) -> Artifact:
    """Write the lines of all stations as they come."""
    scratch, name = context.blobs.scratch(), "lines.ply"
    try:
        write_ply_edges(scratch / name, parts)
        size = (scratch / name).stat().st_size
        context.blobs.put_file(f"jobs/{job_id}/artifacts/{name}", scratch / name)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return listed_download(job_id, name, "application/octet-stream", size)


def _write_lists(whole: RegistrationDocument, writer: RowWriter) -> None:
    """Write the rows of what the document has as a list; those of the pairs are there already."""
    network, tolerance = whole.network, whole.tolerance
    writer.add_all("stations", whole.stations)
    writer.add_all("pairs", ())
    writer.add_all("features", whole.features)
    writer.add_all("inputs", whole.provenance.inputs)
    if network is not None:
        writer.add_all("links", network.links)
        writer.add_all("loops", network.loops)
        if network.adjustment is not None:
            writer.add_all("removed", network.adjustment.removed)
            writer.add_all("left-out", (json.dumps(name).encode() for name in network.adjustment.left_out))
    if tolerance is not None:
        writer.add_all("precisions", tolerance.stations)
        writer.add_all("reasons", tolerance.reasons)
    if whole.comparison is not None:
        writer.add_all("comparison", whole.comparison)
    if whole.comparison_summary is not None:
        writer.add_all("comparison-summary", whole.comparison_summary)


def _downloads(stations: Sequence[StationFigures]) -> dict[str, Download]:
    """Make the poses as a table, and as a matrix for each station, packed: thousands of files are of nobody's use."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for station in stations:
            if station.matrix is not None:
                # the same job gives the same bytes: no time of writing
                archive.writestr(zipfile.ZipInfo(f"{station.name}.txt"), matrix_text(station))
    return {
        "poses.csv": ("text/csv", poses_csv(stations).encode()),
        "matrices.zip": ("application/zip", packed.getvalue()),
    }


def _report(
    context: StepContext,
    arguments: Json,
    whole: RegistrationDocument,
    digest: _Digest,
    picture: NetworkPicture,
    frame: ReportFrame,
) -> dict[str, Download]:
    """Make the report of what a person reads of thousands of stations."""
    features = {output["counts"]["station"]: output["features"] for output in arguments["features"]}

    def scan_of(name: str) -> ScanLines:
        return ScanLines.of_features(load_features(context.blobs.local_path(features[name])))

    report = NetworkReport(whole, digest.rows, [pair for _, _, pair in digest.worst], picture, scan_of)
    return printed_report(report_of_network(report, frame), frame)


def _write_scene(
    context: StepContext, arguments: Json, whole: RegistrationDocument, tied: Json | None, writer: RowWriter
) -> None:
    """Write what a viewer shows of any few stations; their features stand in rows."""
    place = {station.name: number for number, station in enumerate(whole.stations)}
    for each in arguments.get("viewer_points", []):
        writer.add(SCENE_POINTS, json.dumps(viewer_points_of_step(each)).encode())
    scene = StoredScene(
        stations=[],
        control=scene_control(whole.control, {} if tied is None else tied.get("places") or {}),
        stages=[],
        pairs=[],
        points=[],
        pages=ScenePages(
            stations=len(place),
            clouds=writer.counts[SCENE_POINTS],
            pairs=[(place[pair.target], place[pair.source]) for pair in whole.pairs],
        ),
    )
    context.blobs.write_bytes(scene_key(arguments["job_id"]), scene.model_dump_json(by_alias=True).encode())


def _write_document(
    context: StepContext, job_id: str, whole: RegistrationDocument, listed: Sequence[Artifact], writer: RowWriter
) -> None:
    """Write the document without its lists, and beside it what later steps need of all stations at once."""
    network = whole.network
    counts = NetworkCounts(
        frame=next((each.name for each in whole.stations if each.status == "fixed"), "control"),
        stations=dict(Counter(each.status for each in whole.stations)),
        pairs=dict(Counter(each.status for each in whole.pairs)),
        links={} if network is None else dict(Counter(each.state for each in network.links)),
        loops=0 if network is None else len(network.loops),
        open_loops=0 if network is None else sum(not each.passed for each in network.loops),
    )
    placed = {
        "stations": [each.model_dump(mode="json", by_alias=True) for each in whole.stations],
        "features": [each.model_dump(mode="json", by_alias=True) for each in whole.features],
    }
    context.blobs.write_bytes(placed_key(job_id), json.dumps(placed).encode())
    lists = writer.described()
    rest = whole.model_copy(
        update={
            "stations": [],
            "pairs": [],
            "features": [],
            "lists": lists,
            "counts": counts,
            "artifacts": list(listed),
        }
    )
    _write_with_itself(context, job_id, without_lists(json.loads(rest.model_dump_json(by_alias=True)), lists))


def list_in_pages(context: StepContext, job_id: str, document: Json, files: Sequence[RegisteredFile]) -> None:
    """Add files with registered scans to the lists of a large network, whose document is given."""
    writer = RowWriter(context.blobs, job_id)
    writer.add_all("registered", files)
    writer.finish()
    lists = {name: each.model_dump() for name, each in writer.described().items()}
    _write_with_itself(context, job_id, {**document, "lists": {**document["lists"], **lists}})


def _write_with_itself(context: StepContext, job_id: str, document: Json) -> None:
    """Write the document without lists as result, and as a download that is listed in it."""
    others = [each for each in document["artifacts"] if each["name"] != "result.json"]
    data, size = b"", -1
    while len(data) != size:  # its length counts the digits of its length
        size = len(data)
        itself = listed_download(job_id, "result.json", "application/json", size).model_dump()
        data = json.dumps({**document, "artifacts": [*others, itself]}).encode()
    for name in (f"jobs/{job_id}/artifacts/result.json", f"jobs/{job_id}/result.json"):
        context.blobs.write_bytes(name, data)
