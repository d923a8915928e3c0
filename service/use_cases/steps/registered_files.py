"""Write registered scans as files: the same E57 with new poses, another format, or poses alone."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Matrix6
from algorithms.geometry.poses import PoseEstimate
from algorithms.progress import ProgressSection
from algorithms.quality.position_std import PositionStd
from schemas.results.registration_result import RegisteredFile
from service.errors import InvalidRequestError
from service.formats.base import ScanFile
from service.formats.point_selection import ALL_POINTS, USUAL_POINTS
from service.formats.streaming import stream_scan
from service.formats.writers import PointPiece, ScalarField, StationCloud, Written, writer_of
from service.formats.writers.base import STANDARD_DEVIATION
from service.formats.writers.csv_table import joined_tables
from service.formats.writers.e57_write_back import write_back
from service.formats.writers.poses import POSE_FORMATS, StationPose, riscan
from service.names.content_keys import content_key
from service.ports import Json, StepContext
from service.use_cases.limits.read_limits import read_limits
from service.use_cases.reports.figures import StationFigures, station_figures
from service.use_cases.reports.result_tables_csv import matrix_text, poses_csv
from service.use_cases.steps.cleaned_clouds import CLEANED, cleaned_frame
from service.use_cases.steps.job_poses import result_with_stations
from service.use_cases.steps.output_files import artifact, output_file
from service.use_cases.steps.placed_stations import world_crs
from service.use_cases.steps.projected_clouds import WorldSystem, world_system
from service.use_cases.steps.registered_calls import E57, POSES
from service.use_cases.steps.registered_images import images_of

E57_SIGNATURE = b"ASTM-E57"
STD_FIELD = ScalarField(STANDARD_DEVIATION, "std of position, 3-D [mm]", "f4")
BYTES_PER_POINT = 24
"""About what a point takes in a file, for the room that is asked for beforehand."""
MEDIA_BY_ENDING = {".json": "application/json", ".csv": "text/csv"}
KEEPS_FLAGS = ("laz", "copc")
"""Formats in which withheld points and noise are marked as such."""
NAMES_SYSTEM = ("laz", "copc", "e57", "ply")
"""Formats that name a coordinate reference system."""
SAME_FILE = "the uploaded file with other poses: points, images and all else are as they were, byte for byte"
NO_NOISE = "the standard deviations have no part for the noise of the ranges: nobody told it (`range_std_m`)"


@dataclass(frozen=True, eq=False)
class _Placed:
    """A station of the request with what is known of its pose."""

    name: str
    file: ScanFile
    scan: Json
    photos: Sequence[Json]
    estimate: PoseEstimate | None
    """None: the coordinates of the file are those of the world."""
    is_known: bool
    """Whether its pose came with a covariance."""
    range_std_m: float | None

    @property
    def covariance(self) -> Matrix6 | None:
        """Of the pose; None: unknown."""
        return None if self.estimate is None or not self.is_known else self.estimate.covariance

    @property
    def pose(self) -> RigidTransform:
        """World from scan."""
        return RigidTransform.identity() if self.estimate is None else self.estimate.target_from_source


def write_registered(context: StepContext, arguments: Json) -> Json:
    """Write one file, or several of poses or of cleaned stations, and describe them.

    Raises
    ------
    InvalidRequestError
        Standard deviations are wanted of a station whose pose has no covariance.
    UnwritableError
        The format cannot hold the points.
    InsufficientStorageError
        The disk is full; nothing remains.
    """
    options = arguments["options"]
    stations, left_out = _placed(context, arguments)
    files: list[RegisteredFile] = []
    if stations:
        result = None if arguments.get("result") is None else _document(context, arguments["result"])
        taken_from = [] if result is not None else [_document(context, key) for key in arguments["reads"]]
        system = world_system(options, result, taken_from)
        files = _writing(options)(context, arguments, stations, system)
    return {"files": [file.model_dump(mode="json") for file in files], "left_out": left_out}


def _writing(options: Json) -> Callable[[StepContext, Json, Sequence[_Placed], WorldSystem], list[RegisteredFile]]:
    """Give what writes such files."""
    if options["format"] == POSES:
        return _write_poses
    return _write_points if options["cleaning"] is None else _write_cleaned


def _write_poses(
    context: StepContext, arguments: Json, stations: Sequence[_Placed], system: WorldSystem
) -> list[RegisteredFile]:
    """Write the poses in all formats, each kind with its own ending."""
    poses = [StationPose(each.name, each.pose, each.covariance) for each in stations]
    is_left_handed = bool(arguments["options"]["left_handed"])
    job_id, found = arguments["job_id"], []
    own = _figures(context, arguments)
    for kind, give in POSE_FORMATS.items():
        files = riscan(poses, is_left_handed=is_left_handed) if kind == "riscan" else give(poses)
        for name, content in _with_figures(files, own).items():
            safe = "".join(c if c.isalnum() or c in "._-" else "_" for c in name)
            context.blobs.write_bytes(f"jobs/{job_id}/artifacts/{safe}", content)
            media = MEDIA_BY_ENDING.get(Path(name).suffix, "text/plain")
            found.append(_described(context, job_id, safe, media, POSES, stations, Written(0, system.notes)))
    return found


def _figures(context: StepContext, arguments: Json) -> list[StationFigures]:
    """Pick the figures of the stations of the job's own result; none where the request has the poses."""
    if arguments.get("result") is None:
        return []
    document = _document(context, arguments["result"])
    return station_figures({**document, "stations": _entries(context, arguments, "stations")})


def _with_figures(files: Mapping[str, bytes], own: Sequence[StationFigures]) -> dict[str, bytes]:
    """Write what the job's own result says of the stations into the files that its report has by the same names."""
    if not own:
        return dict(files)
    texts = {f"{station.name}.txt": matrix_text(station).encode() for station in own if station.matrix is not None}
    found = {name: texts.get(name, content) for name, content in files.items()}
    if "poses.csv" in found:
        table = joined_tables(poses_csv(own), found["poses.csv"].decode(), "station", "name")
        found["poses.csv"] = table.encode()
    if "poses.json" in found:
        frame = {"frame": own[0].frame, "crs": next((station.system for station in own if station.system), None)}
        found["poses.json"] = (json.dumps({**frame, **json.loads(found["poses.json"])}, indent=1) + "\n").encode()
    return found


def _write_points(
    context: StepContext, arguments: Json, stations: Sequence[_Placed], system: WorldSystem
) -> list[RegisteredFile]:
    options, job_id = arguments["options"], arguments["job_id"]
    writer = writer_of(options["format"])
    name = f"{arguments['stem']}{writer.ending}"
    if _can_write_back(options, stations):
        source = stations[0].file
        with output_file(context, job_id, name, source.size) as path:
            poses = {station.scan["index"]: station.pose for station in stations}
            written = write_back(source, path, poses, context.progress, system.crs_wkt)
        written = Written(written.points, (SAME_FILE, *written.notes, *system.notes))
    else:
        reading = ProgressSection(context.progress, 0.0, 0.3)
        clouds, notes = [], []
        for number, station in enumerate(stations):
            cloud, said = _cloud(context, station, options, ProgressSection(reading, *_share(number, len(stations))))
            clouds.append(cloud)
            notes += said
        crs_wkt, why_none = world_crs([cloud.crs_wkt for cloud in clouds], [cloud.pose for cloud in clouds])
        notes += [why_none] if why_none and system.crs_wkt is None and not system.notes else []
        clouds = [replace(cloud, crs_wkt=crs_wkt) for cloud in clouds]
        points = sum(cloud.facts.points for cloud in clouds if cloud.facts is not None)
        with output_file(context, job_id, name, BYTES_PER_POINT * points) as path:
            clouds = [system.cloud(cloud) for cloud in clouds]
            written = writer.write(path, clouds, ProgressSection(context.progress, 0.3, 1.0))
        if options["format"] not in NAMES_SYSTEM and any(cloud.crs_wkt for cloud in clouds):
            notes.append(f"the coordinate reference system is not in the file: {writer.name} has no place for it")
        written = Written(written.points, tuple(dict.fromkeys((*written.notes, *notes, *system.notes))))
    return [_described(context, job_id, name, writer.media_type, options["format"], stations, written)]


def _write_cleaned(
    context: StepContext, arguments: Json, stations: Sequence[_Placed], system: WorldSystem
) -> list[RegisteredFile]:
    """Write what cleaning leaves of all stations, in as many files as are asked for."""
    options, job_id = arguments["options"], arguments["job_id"]
    writer, placed = writer_of(options["format"]), {station.name: station for station in stations}
    sides = [
        {
            "name": station.name,
            "scan": station.scan,
            "world_from_scan": None if station.estimate is None else {"matrix": station.pose.as_matrix().tolist()},
        }
        for station in stations
    ]
    cleaned = cleaned_frame(context, sides, options["cleaning"], attributes=True)
    clouds, notes, steps = {}, [*cleaned.frame.notes(), *cleaned.cleaned.remarks], cleaned.steps()
    for scan, left in cleaned.stations():
        station = placed[scan.scan.name]
        scalars: dict[str, Array] = {}
        fields: tuple[ScalarField, ...] = ()
        if options["per_point_std"]:
            std = _position_std(station, notes)
            values = std.at(scan.scan.points[left.numbers], scan.scan.origin_m)
            scalars, fields = {STD_FIELD.name: (1000.0 * values).astype(np.float32)}, (STD_FIELD,)
        clouds[station.name] = system.cloud(cleaned.cloud(scan, left, scalars, fields))
    found = []
    for number, file in enumerate(arguments["files"]):
        names = [name for name in file["stations"] if name in clouds]
        if not names:
            continue
        points = sum(step.after for step in steps if step.station in names)
        name = f"{file['stem']}{writer.ending}"
        progress = ProgressSection(context.progress, CLEANED, 1.0)
        with output_file(context, job_id, name, BYTES_PER_POINT * points) as path:
            written = writer.write(
                path,
                [clouds[name] for name in names],
                ProgressSection(progress, *_share(number, len(arguments["files"]))),
            )
        told = Written(written.points, tuple(dict.fromkeys((*written.notes, *notes, *system.notes))))
        described = _described(
            context, job_id, name, writer.media_type, options["format"], [placed[name] for name in names], told
        )
        counts = [step for step in steps if step.station in file["stations"]]
        found.append(described.model_copy(update={"cleaning": counts}))
    return found


def _can_write_back(options: Json, stations: Sequence[_Placed]) -> bool:
    """Tell whether the file stays what it is: one uploaded E57, of which nothing but poses is to be other."""
    if options["format"] != E57 or options["merge"] or options["per_point_std"] or any(s.file.unit for s in stations):
        return False
    with stations[0].file.path.open("rb") as stream:
        return stream.read(len(E57_SIGNATURE)) == E57_SIGNATURE


def _cloud(
    context: StepContext, station: _Placed, options: Json, progress: ProgressSection
) -> tuple[StationCloud, list[str]]:
    """Give the points of a station with its pose, and what is to be said of them."""
    # formats with a place for flags keep all points as they are marked
    selection = ALL_POINTS if options["format"] in KEEPS_FLAGS else USUAL_POINTS
    file = replace(station.file, selection=selection, attributes=True)
    cloud = stream_scan(file, station.scan["index"], read_limits(context), progress)
    images, notes = images_of(context, station.file, station.scan["index"], station.photos, options["format"])
    notes = [*(f"{station.name}: {note}" for note in cloud.notes), *notes]
    cloud = replace(
        cloud,
        name=station.name,
        world_from_scan=None if station.estimate is None else station.pose,
        images=images,
    )
    if not options["per_point_std"]:
        return cloud, notes
    return _with_std(cloud, _position_std(station, notes)), notes


def _position_std(station: _Placed, notes: list[str]) -> PositionStd:
    """Give what tells the standard deviations of a station's points, and note what is not in them."""
    if station.estimate is None or station.range_std_m is None:
        notes.append(NO_NOISE)
    if station.estimate is None:
        raise InvalidRequestError(
            f"`per_point_std` needs the covariance of the pose of '{station.name}', which has no pose in the request"
        )
    return PositionStd(station.estimate, station.range_std_m or 0.0)


def _with_std(cloud: StationCloud, std: PositionStd) -> StationCloud:
    def pieces() -> Iterator[PointPiece]:
        for piece in cloud.pieces():
            values = (1000.0 * std.at(piece.points, cloud.origin_m)).astype(np.float32)
            yield replace(piece, scalars={**piece.scalars, STD_FIELD.name: values})

    others = [field for field in cloud.scalars if field.name != STD_FIELD.name]
    return replace(cloud, pieces=pieces, scalars=(*others, STD_FIELD))


def _placed(context: StepContext, arguments: Json) -> tuple[list[_Placed], list[Json]]:
    """Find the poses of the stations; those that have none are left out with the reason."""
    options, result = arguments["options"], arguments.get("result")
    known = {} if result is None else _by_name(_entries(context, arguments, "stations"), "name")
    documents = {
        key: result_with_stations(context, key) for key in {s["noise_of"] for s in arguments["stations"]} if key
    }
    own_noise = {} if result is None else _by_name(_entries(context, arguments, "features"), "station")
    found, left_out = [], []
    for station in arguments["stations"]:
        name, given = station["name"], station["world_from_scan"]
        if result is not None:
            of_job = known.get(name, {})
            given = of_job.get("world_from_scan")
            if given is None or given.get("undetermined"):
                left_out.append({"name": name, "reason": of_job.get("reason") or "its pose is not determined"})
                continue
        noise = own_noise.get(name)
        if station["noise_of"] and noise is None:
            noise = _by_name(documents[station["noise_of"]].get("features", []), "station").get(given["station"])
        stated = options["range_std_m"]
        path = context.blobs.local_path(content_key(station["scan"]["sha256"]))
        file = ScanFile(
            path, station["scan"]["filename"], station["scan"].get("columns") or "", station["scan"].get("unit") or ""
        )
        found.append(
            _Placed(
                name,
                file,
                station["scan"],
                station["photos"],
                _estimate(name, given, needs_covariance=bool(options["per_point_std"])),
                given is not None and given.get("covariance") is not None,
                stated if stated is not None else None if noise is None else noise.get("noise_std_m"),
            )
        )
    return found, left_out


def _estimate(name: str, given: Json | None, *, needs_covariance: bool) -> PoseEstimate | None:
    if given is None:
        return None
    covariance = given.get("covariance")
    if covariance is None and needs_covariance:
        raise InvalidRequestError(f"`per_point_std` needs the covariance of the pose of '{name}', which was not given")
    matrix = RigidTransform.from_matrix(np.array(given["matrix"], dtype=np.float64))
    return PoseEstimate(matrix, np.zeros((6, 6)) if covariance is None else np.array(covariance, dtype=np.float64))


def _described(
    context: StepContext,
    job_id: str,
    name: str,
    media_type: str,
    format_name: str,
    stations: Sequence[_Placed],
    written: Written,
) -> RegisteredFile:
    return RegisteredFile(
        **artifact(context, job_id, name, media_type).model_dump(),
        format=format_name,
        stations=[station.name for station in stations],
        points=written.points,
        notes=list(written.notes),
    )


def _document(context: StepContext, key: str) -> Json:
    document: Json = json.loads(context.blobs.local_path(key).read_bytes())
    return document


def _entries(context: StepContext, arguments: Json, name: str) -> list[Json]:
    """Give a list of the result; of a large network the rows that the plan names, those of the stations among them."""
    document = _document(context, arguments["result"])
    if not document.get("lists"):
        entries: list[Json] = document[name]
        return entries
    keys = [key for key in arguments["reads"] if f"/lists/{name}/" in key]
    return [json.loads(row) for key in keys for row in context.blobs.local_path(key).read_bytes().splitlines()]


def _by_name(entries: Sequence[Json], member: str) -> dict[str, Any]:
    return {entry[member]: entry for entry in entries}


def _share(number: int, count: int) -> tuple[float, float]:
    return number / count, (number + 1) / count
