"""Find the straight edges of one photo and write the result of `detect-edges`."""

import math
import time
from typing import Any, cast

import numpy as np
from pydantic import TypeAdapter

from algorithms.arrays import Array
from algorithms.photos.options import EdgeOptions
from algorithms.photos.segments import ImageSegments
from schemas.results.edges_result import DetectedEdge, DetectedPhoto, EdgeCount, EdgesDocument, EdgesProvenance, Pixel
from schemas.results.registration_result import Artifact
from service.formats import read_photo
from service.formats.photo import camera_document
from service.formats.writers.csv_table import csv_text
from service.names.content_keys import content_key
from service.ports import Json, StepContext
from service.use_cases.inputs.check_photos import camera_of
from service.use_cases.limits.read_limits import read_limits
from service.use_cases.steps.run_lines_report import software

GON = 200.0 / math.pi
CSV_COLUMNS = (
    *("name", "start_x_px", "start_y_px", "end_x_px", "end_y_px", "raw_start_x_px", "raw_start_y_px", "raw_end_x_px"),
    *("raw_end_y_px", "centre_x_px", "centre_y_px", "direction_x", "direction_y", "length_px", "angle_std_gon"),
    *("offset_std_px", "angle_offset_covariance_rad_px", "contrast", "blur_px", "points"),
)


def detect_edges_of_photo(context: StepContext, arguments: Json) -> Json:
    """Detect, and store result document and downloads."""
    from algorithms.photos.detector import detect_edges
    from service.use_cases.reports.edges_drawing import edges_png

    reference = arguments["inputs"]["photo"]
    options = TypeAdapter(EdgeOptions).validate_python(arguments["inputs"]["edges"])
    started = time.perf_counter()
    context.progress.report(0.0, "reading")
    path = context.blobs.local_path(content_key(arguments["sha256"]))
    photo = read_photo(path, arguments["filename"], reference["index"], read_limits(context))
    if photo.image is None:  # pragma: no cover - such a photo is refused by `read_photo`
        raise AssertionError
    read = time.perf_counter()
    camera = photo.info.camera if reference.get("camera") is None else camera_of(reference["camera"])
    segments = detect_edges(photo.image, camera, options, progress=context.progress)
    detected = time.perf_counter()
    job_id = arguments["job_id"]
    edges = edge_documents(segments)
    files = {
        "overlay.png": ("image/png", edges_png(photo.image, segments)),
        "segments.csv": ("text/csv", edges_csv(edges).encode()),
    }
    document = EdgesDocument(
        photo=DetectedPhoto(
            file=reference["file"],
            index=reference["index"],
            name=photo.info.name,
            width=photo.info.width,
            height=photo.info.height,
            camera=None if camera is None else camera_document(camera),
        ),
        counts=edge_count(edges, options.max_segments),
        edges=edges,
        artifacts=[
            Artifact(name=name, type=media, bytes=len(data), href=f"/jobs/{job_id}/artifacts/{name}")
            for name, (media, data) in files.items()
        ],
        provenance=EdgesProvenance(
            software=software(),
            edges=arguments["inputs"]["edges"],
            sha256=arguments["sha256"],
            timings_s={"read": read - started, "edges": detected - read},
        ),
    )
    for name, (_, data) in files.items():
        context.blobs.write_bytes(f"jobs/{job_id}/artifacts/{name}", data)
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"edges": len(edges)}


def edge_documents(segments: ImageSegments) -> list[DetectedEdge]:
    """Describe every edge, in their order; numbers start at 1."""
    ends, raw_ends = segments.ends, segments.raw_ends
    return [
        DetectedEdge(
            name=f"E{k + 1}",
            start_px=_pixel(ends[k, 0]),
            end_px=_pixel(ends[k, 1]),
            raw_start_px=_pixel(raw_ends[k, 0]),
            raw_end_px=_pixel(raw_ends[k, 1]),
            centre_px=_pixel(segments.centres[k]),
            direction=_pixel(segments.directions[k]),
            length_px=float(segments.lengths[k]),
            covariance=(_pixel(segments.covariances[k, 0]), _pixel(segments.covariances[k, 1])),
            angle_std_gon=math.sqrt(segments.covariances[k, 0, 0]) * GON,
            offset_std_px=math.sqrt(segments.covariances[k, 1, 1]),
            contrast=float(segments.contrasts[k]),
            blur_px=float(segments.widths_px[k]),
            points=int(segments.point_counts[k]),
        )
        for k in range(len(segments))
    ]


def edge_count(edges: list[DetectedEdge], most: int) -> EdgeCount:
    """Count the edges and tell what is typical of them."""
    return EdgeCount(
        edges=len(edges),
        truncated=len(edges) >= most,
        total_length_px=math.fsum(edge.length_px for edge in edges),
        median_offset_std_px=float(np.median([edge.offset_std_px for edge in edges])) if edges else None,
        median_angle_std_gon=float(np.median([edge.angle_std_gon for edge in edges])) if edges else None,
    )


def edges_csv(edges: list[DetectedEdge]) -> str:
    """Give the edges as a table, one row each."""
    rows = []
    for edge in edges:
        pixels = (edge.start_px, edge.end_px, edge.raw_start_px, edge.raw_end_px, edge.centre_px, edge.direction)
        figures: tuple[Any, ...] = (
            edge.length_px,
            edge.angle_std_gon,
            edge.offset_std_px,
            edge.covariance[0][1],
            edge.contrast,
            edge.blur_px,
            edge.points,
        )
        rows.append([edge.name, *(value for pixel in pixels for value in pixel), *figures])
    return csv_text(CSV_COLUMNS, rows)


def _pixel(values: Array) -> Pixel:
    return cast("Pixel", tuple(float(value) for value in values))
