"""The step of `calibrate-mount`: read the photos, find the mounts, describe, store."""

import json
import math
import time
from dataclasses import dataclass

import numpy as np
from pydantic import TypeAdapter
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Matrix6
from algorithms.calibration.edge_images import EdgePhoto, StationEdges, moved_mounts
from algorithms.calibration.edge_options import EdgeCalibrationOptions
from algorithms.calibration.natural_edges import EdgeCalibration, mounts_from_edges
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.cameras import Camera
from algorithms.photos.options import EdgeOptions
from algorithms.progress import NoProgress
from schemas.results.mounts_result import MountsDocument, MountsProvenance
from schemas.results.registration_result import Artifact
from service.ports import Json, StepContext
from service.processes.calibrate_mount.documents import (
    corrected_photo,
    mount_document,
    mount_std_of,
    photo_documents,
    stated_mount,
)
from service.use_cases.steps.feature_store import load_features
from service.use_cases.steps.run_lines_report import software
from service.use_cases.steps.station_photos import read_station_photo

PHOTO_LIST = "photos.json"


@dataclass(frozen=True, eq=False)
class ReadPhotos:
    """The photos of all stations in their order, with what was requested of them."""

    photos: list[EdgePhoto]
    stated: list[RigidTransform]
    """Poses in the frames of the scans' files."""
    requested: list[Json]
    names: list[str]
    mounts: list[str]
    """Names of the mounts."""
    std: list[Matrix6]
    """(6, 6) of the stated poses, in the axes of the camera."""


def calibrate_mount(context: StepContext, arguments: Json) -> Json:
    """Find the mounts, and store result document and photo list."""
    inputs, job_id = arguments["inputs"], arguments["job_id"]
    started = time.perf_counter()
    features = [load_features(context.blobs.local_path(each["features"])) for each in arguments["features"]]
    edges = [edges_of(each) for each in features]
    read = _read_photos(context, arguments, features)
    done_reading = time.perf_counter()
    context.progress.report(0.8, "comparing edges")
    options = TypeAdapter(EdgeCalibrationOptions).validate_python(inputs["search"])
    done = mounts_from_edges(edges, read.photos, options)
    document = mounts_document(done, read, edges, inputs)
    document.provenance.sha256 = arguments["scans"]
    document.provenance.timings_s.update(
        read=done_reading - started, compare=time.perf_counter() - done_reading,
        features=math.fsum(sum(each["timings_s"].values()) for each in arguments["features"]),
    )  # fmt: skip
    data = json.dumps(photo_list(document, read, inputs, arguments["features"]), indent=1).encode()
    context.blobs.write_bytes(f"jobs/{job_id}/artifacts/{PHOTO_LIST}", data)
    href = f"/jobs/{job_id}/artifacts/{PHOTO_LIST}"
    document.artifacts = [Artifact(name=PHOTO_LIST, type="application/json", bytes=len(data), href=href)]
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"mounts": [each.status for each in document.mounts]}


def edges_of(features: ScanFeatures) -> StationEdges:
    """Keep the lines where two planes meet."""
    between = np.flatnonzero((features.lines.parents >= 0).all(axis=1))
    return StationEdges(features.lines[between], features.planes.covariances)


def _read_photos(context: StepContext, arguments: Json, features: list[ScanFeatures]) -> ReadPhotos:
    from algorithms.photos.detector import detect_edges

    inputs = arguments["inputs"]
    options = TypeAdapter(EdgeOptions).validate_python(inputs["edges"])
    read = ReadPhotos([], [], [], [], [], [])
    cameras: dict[Camera, int] = {}
    total, number = sum(len(photos) for photos in arguments["photos"]), 0
    for k, (station, photos) in enumerate(zip(inputs["stations"], arguments["photos"], strict=True)):
        for j, photo in enumerate(photos):
            context.progress.report(0.8 * number / total, f"edges of {photo['filename']}")
            found = read_station_photo(photo, context)
            mount = cameras.setdefault(found.camera, len(cameras)) if inputs["mounts"] == "camera" else number
            if mount == len(read.mounts):
                named = f"{station['name']} {j + 1}" if inputs["mounts"] == "photo" else f"camera {mount + 1}"
                read.mounts.append(named)
            pose = found.scan_from_camera
            reduced = RigidTransform.from_components(np.asarray(pose.translation) - features[k].origin_m, pose.rotation)
            segments = detect_edges(found.image, found.camera, options, progress=NoProgress())
            read.photos.append(EdgePhoto(k, mount, segments, found.camera, reduced))
            read.stated.append(pose)
            read.requested.append(photo)
            read.names.append(f"{station['name']} {j + 1}")
            read.std.append(mount_std_of(photo))
            number += 1
    return read


def mounts_document(done: EdgeCalibration, read: ReadPhotos, edges: list[StationEdges], inputs: Json) -> MountsDocument:
    """Describe what was found, without downloads."""
    mounts = []
    for k, (found, name) in enumerate(zip(done.mounts, read.mounts, strict=True)):
        own = [q for q, photo in enumerate(read.photos) if photo.mount == k]
        names = [read.names[q] for q in own]
        stated = stated_mount(read.requested[own[0]])
        mounts.append(mount_document(found, name, names, stated, max((read.std[q] for q in own), key=np.trace), inputs))
    corrections = [
        moved_mounts(stated, done.mounts[photo.mount].error) if mounts[photo.mount].status == "wrong" else stated
        for photo, stated in zip(read.photos, read.stated, strict=True)
    ]
    lines = [len(each.lines) for each in edges]
    remarks = [
        f"{station['name']}: the scan has no edge where two planes meet"
        for station, count in zip(inputs["stations"], lines, strict=True)
        if count == 0
    ]
    if not done.converged:
        remarks.append("the adjustment did not settle: take the corrections for a first step and run again with them")
    return MountsDocument(
        mounts=mounts,
        photos=photo_documents(done, [photo.station for photo in read.photos], read.requested, inputs, corrections),
        lines=lines,
        variance_factor=done.variance_factor,
        redundancy=done.redundancy,
        artifacts=[],
        remarks=remarks,
        provenance=MountsProvenance(
            software=software(),
            options={key: value for key, value in inputs.items() if key != "stations"},
            sha256=[],
            timings_s={},
        ),
    )


def photo_list(document: MountsDocument, read: ReadPhotos, inputs: Json, features: list[Json]) -> Json:
    """Give the photo list with corrected poses, files by the names they were uploaded with."""
    stations = []
    for k, station in enumerate(inputs["stations"]):
        own = [q for q, photo in enumerate(read.photos) if photo.station == k]
        photos = [
            corrected_photo(read.requested[q], document.photos[q], document.mounts[read.photos[q].mount]) for q in own
        ]
        scan = {**station["scan"], "file": features[k]["filename"]}
        stations.append({"name": station["name"], "scan": scan, "photos": photos})
    return {"stations": stations}
