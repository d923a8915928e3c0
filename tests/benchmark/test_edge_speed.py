"""Speed of edge detection in photos of six million pixels, beside OpenCV's own detector in the same run."""

import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from edge_images import find, rectangles

pytestmark = pytest.mark.benchmark
COURTYARD = Path(__file__).resolve().parents[3] / "shared" / "data" / "photo_hku_a"
SIZE = (3000, 2000)


def measure(name, grey):
    """Print seconds of both detectors and give the ratio of their processor times, the better of two runs."""
    find(grey[:300, :300].copy())
    ours, theirs = [], []
    for _ in range(2):
        wall, processor = time.perf_counter(), time.process_time()
        cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(grey)
        theirs.append((time.perf_counter() - wall, time.process_time() - processor))
        wall, processor = time.perf_counter(), time.process_time()
        edges = find(grey)
        ours.append((time.perf_counter() - wall, time.process_time() - processor))
    (wall, processor), (their_wall, their_processor) = min(ours), min(theirs)
    print(
        f"\n{name}: {len(edges)} edges in {wall:.2f} s (processor {processor:.2f} s); opencv's detector without any "
        f"measurement {their_wall:.2f} s (processor {their_processor:.2f} s); ratio {processor / their_processor:.2f}"
    )
    return processor / their_processor


def test_a_rendered_photo_takes_no_more_than_three_and_a_half_times_the_time_of_opencv():
    photo = rectangles(np.random.default_rng(1), size=SIZE, across=20, contrast=(15.0, 100.0))
    ratio = measure("rendered photo, 1600 edges", photo.image)
    assert ratio <= 3.5


@pytest.mark.skipif(not COURTYARD.exists(), reason="real photos are not here: ../shared/data/photo_hku_a")
def test_photos_of_a_courtyard_take_no_more_than_three_and_a_half_times_the_time_of_opencv():
    parts = [cv2.imread(str(p), cv2.IMREAD_GRAYSCALE) for p in sorted(COURTYARD.glob("*.png"))]
    rows = [np.hstack([parts[(i + j) % len(parts)] for j in range(3)]) for i in range(2)]
    ratio = measure("courtyard", np.ascontiguousarray(np.vstack(rows)[: SIZE[1], : SIZE[0]]))
    assert ratio <= 3.5
