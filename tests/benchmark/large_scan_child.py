"""A very large scan as the service treats it, in a process of its own: inspected, read in part, features extracted."""

import json
import resource
import sys
import time
from pathlib import Path

import numpy as np

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.progress import NoProgress
from service.formats import inspect_file
from service.formats.base import RECORDS_IN_MEMORY
from service.formats.thinned import read_thinned_scan


def main(file: Path) -> None:
    begun = time.perf_counter()
    (info,) = inspect_file(file, file.name)
    inspected = time.perf_counter()
    at_inspection = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    scan, words = read_thinned_scan(file, file.name, 0, info.points + info.dropped, RECORDS_IN_MEMORY)
    read = time.perf_counter()
    features = extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))
    found = {
        "points": info.points,
        "inspected_s": inspected - begun,
        "read_s": read - inspected,
        "features_s": time.perf_counter() - read,
        "planes": len(features.planes),
        "words": words,
        "inspection_bytes": 1024 * at_inspection,
        "bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
