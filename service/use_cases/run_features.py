"""Read a scan and extract its features, or tell what a file holds."""

import shutil
import time

import numpy as np
from pydantic import TypeAdapter

from algorithms.features.options import FeatureOptions
from algorithms.features.scan_features import ScanFeatures
from service.formats.base import ReadLimits
from service.ports import Json, StepContext
from service.use_cases.feature_keys import feature_key
from service.use_cases.feature_store import load_features, save_features

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
    found = inspect_upload(path, filename, read_limits(context))
    return {
        "format": found.format,
        "kind": found.kind,
        "scans": [scan.to_json() for scan in found.scans],
        "photos": [photo.to_json() for photo in found.photos],
    }


def extract_features_of_scan(context: StepContext, arguments: Json) -> Json:
    """Extract the features of one scan, unless an earlier job already did; give their key and counts."""
    key = feature_key(arguments["sha256"], arguments["index"], arguments["options"])
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
        "counts": {
            "station": arguments["name"],
            "points": features.point_count,
            "lines": len(features.lines),
            "planes": len(features.planes),
            "cylinders": len(features.cylinders),
            "noise_std_m": features.noise_std_m,
        },
        "timings_s": timings,
    }


def _extracted(context: StepContext, arguments: Json) -> tuple[ScanFeatures, dict[str, float]]:
    from algorithms.features.extraction import extract_features
    from service.formats import read_scan

    options = TypeAdapter(FeatureOptions).validate_python(arguments["options"])
    started = time.perf_counter()
    context.progress.report(0.0, "reading")
    path = context.blobs.local_path(f"files/{arguments['file']}")
    scan = read_scan(path, arguments["filename"], arguments["index"], read_limits(context))
    read = time.perf_counter()
    features = extract_features(scan, options, progress=context.progress, rng=np.random.default_rng(SEED))
    return features, {"read": read - started, "features": time.perf_counter() - read}


def read_limits(context: StepContext) -> ReadLimits:
    """Give what one file may ask for, from the settings."""
    return ReadLimits(max_points=context.limits["max_points"], max_pixels=context.limits["max_photo_pixels"])
