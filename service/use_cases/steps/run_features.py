"""Read a scan and extract its features, or tell what a file holds."""

import shutil
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from pydantic import TypeAdapter

from algorithms.features.options import FeatureOptions
from algorithms.features.photo_lines.projection_options import (
    EdgeRejection,
)
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.lines import LineSource
from algorithms.matching.options import MatchingOptions
from algorithms.progress import NoProgress, ProgressSection
from algorithms.scans.scan import Scan
from schemas.values.text_columns import checked_columns
from service.names.content_keys import content_key
from service.names.feature_keys import features_of_step
from service.ports import Json, StepContext
from service.use_cases.limits.read_limits import read_limits
from service.use_cases.steps.feature_store import load_features, save_features

SEED = 0
"""Every computation draws from a generator with this seed: the same input gives the same answer."""


def inspect_uploaded_file(context: StepContext, arguments: Json) -> Json:
    """Tell format, kind, scans and photos of an uploaded file.

    Raises
    ------
    UnreadableFileError
        The file is no scan that can be registered and no photo.
    """
    from service.formats import inspect_upload

    path, filename = context.blobs.local_path(arguments["key"]), arguments["filename"]
    stated = arguments.get("columns") or ""
    found = inspect_upload(path, filename, read_limits(context), checked_columns(stated) if stated else "")
    return {
        "format": found.format,
        "kind": found.kind,
        "scans": [scan.to_json() for scan in found.scans],
        "photos": [photo.to_json() for photo in found.photos],
    }


def extract_features_with_kernels(context: StepContext, arguments: Json) -> Json:
    """Extract the features of one scan; compile the kernels first where nobody did before."""
    from service.use_cases.steps.kernels import ensure_compiled

    ensure_compiled(context.progress)
    return extract_features_of_scan(context, arguments)


def extract_features_of_scan(context: StepContext, arguments: Json) -> Json:
    """Extract the features of one scan, unless an earlier job already did; give their key and counts."""
    key = features_of_step(arguments)
    timings = {"read": 0.0, "features": 0.0}
    if context.blobs.exists(key):
        features = load_features(context.blobs.local_path(key))
    else:
        features, timings = _extracted(context, arguments)
        scratch = context.blobs.scratch()
        try:
            save_features(scratch / "features.npz", features)
            context.blobs.put_file(key, scratch / "features.npz")
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
    return {
        "features": key,
        "sha256": arguments["sha256"],
        "filename": arguments["filename"],
        "instrument": arguments.get("instrument"),
        "photos": [photo["sha256"] for photo in arguments.get("photos", [])],
        "photo_names": [photo["filename"] for photo in arguments.get("photos", [])],
        "counts": {
            "station": arguments["name"],
            "points": features.point_count,
            "lines": len(features.lines),
            "planes": len(features.planes),
            "cylinders": len(features.cylinders),
            "noise_std_m": features.noise_std_m,
            "left_out_points": features.far_point_count,
            "instrument_std_m": features.sensor_std_m,
            "warnings": [*arguments.get("warnings", []), *station_warnings(features)],
            **rounding_document(features),
            **photo_counts(features, arguments.get("photos", [])),
        },
        "timings_s": timings,
    }


def station_warnings(features: ScanFeatures) -> list[str]:
    """Say what the reader of a result should know of one scan: points left out, and doubts of its unit."""
    words = []
    if features.far_point_count:
        from algorithms.scans.far_points import far_points_in_words

        words.append(far_points_in_words(features.far_point_count, features.farthest_m))
    return [*words, *features.warnings]


def rounding_document(features: ScanFeatures) -> Json:
    """Say what the coordinates of a scan are rounded to."""
    rounding = features.rounding
    if rounding is None:
        return {}
    return {
        "coordinate_step_m": rounding.steps_m.tolist(),
        "range_step_m": rounding.range_step_m if rounding.range_step_m > 0.0 else None,
        "coordinate_slices": rounding.uneven,
    }


def photo_counts(features: ScanFeatures, photos: Sequence[Json]) -> Json:
    """Count what the photos of a station gave; `photos` as they were requested."""
    found = features.photo_edges
    if found is None:
        return {"photo_edges": 0, "photos": []}
    reasons = [reason for reason in EdgeRejection if reason is not EdgeRejection.NONE]
    return {
        "photo_edges": int((features.lines.sources == LineSource.PHOTO_EDGE).sum()),
        "photos": [
            {
                "file": photo["file"],
                "index": photo["index"],
                "segments": int(found.segment_counts[q]),
                "projected": int(found.projected_counts[q]),
                "merged": int(found.merged_counts[q]),
                "rejected": {reason.label: int(found.rejection_counts[q, reason]) for reason in reasons},
            }
            for q, photo in enumerate(photos)
        ],
    }


def _extracted(context: StepContext, arguments: Json) -> tuple[ScanFeatures, dict[str, float]]:
    from algorithms.features.extraction import extract_features
    from algorithms.matching.symmetries import with_symmetries
    from algorithms.scans.far_points import without_far_points
    from algorithms.scans.scale_plausibility import scale_warnings

    options = TypeAdapter(FeatureOptions).validate_python(arguments["options"])
    started = time.perf_counter()
    context.progress.report(0.0, "reading")
    whole, thinned = _scan_in_memory(context, arguments)
    read = time.perf_counter() - started
    if arguments.get("shown") and not thinned:
        from service.use_cases.steps.run_viewer_points import store_points_of_scan

        store_points_of_scan(context, arguments, whole, NoProgress())
    begun = time.perf_counter()
    scan, far = without_far_points(whole)
    del whole
    references = arguments.get("photos", [])
    section = ProgressSection(context.progress, 0.0, 0.5 if references else 1.0)
    features = extract_features(scan, options, progress=section, rng=np.random.default_rng(SEED))
    features = replace(
        features,
        far_point_count=len(far),
        farthest_m=far.farthest_m,
        warnings=(*thinned, *scale_warnings(scan.points, scan.sensor_m, np.random.default_rng(SEED))),
    )
    timings = {"read": read, "features": time.perf_counter() - begun}
    if references:
        from service.use_cases.steps.station_photos import with_photo_lines

        begun = time.perf_counter()
        section = ProgressSection(context.progress, 0.5, 1.0)
        options_of_photos = arguments.get("photo_options", {})
        features = with_photo_lines(features, scan, references, options_of_photos, context, section)
        timings["photos"] = time.perf_counter() - begun
    begun = time.perf_counter()
    features = with_symmetries(features, MatchingOptions())
    timings["features"] += time.perf_counter() - begun
    return features, timings


def _scan_in_memory(context: StepContext, arguments: Json) -> tuple[Scan, tuple[str, ...]]:
    """Read a scan, or so much of a very large one as memory has room for, and say in words how much."""
    from service.formats.base import RECORDS_IN_MEMORY
    from service.formats.thinned import read_thinned_scan

    records = arguments.get("records") or 0
    if records <= RECORDS_IN_MEMORY:
        return read_stored_scan(context, arguments), ()
    scan, words = read_thinned_scan(
        context.blobs.local_path(content_key(arguments["sha256"])),
        arguments["filename"],
        arguments["index"],
        records,
        RECORDS_IN_MEMORY,
        read_limits(context),
        columns=arguments.get("columns") or "",
        unit=arguments.get("unit") or "",
    )
    return scan, (words,)


def read_stored_scan(context: StepContext, arguments: Json, *, attributes: bool = False) -> Scan:
    """Read a scan by `sha256`, `filename` and `index`, with `columns`, `unit` and `selection` as they were stated.

    Its further numbers, which nothing is computed from, are read where `attributes` says so.
    """
    from service.formats import read_scan
    from service.formats.point_selection import PointSelection

    return read_scan(
        context.blobs.local_path(content_key(arguments["sha256"])),
        arguments["filename"],
        arguments["index"],
        read_limits(context),
        columns=arguments.get("columns") or "",
        unit=arguments.get("unit") or "",
        selection=PointSelection.of(arguments.get("selection")),
        attributes=attributes,
    )
