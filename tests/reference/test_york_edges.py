"""Edges in photos of buildings beside hand-annotated ones, and beside OpenCV's detector on the same photos."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.scenes.photos.edge_images import find

YORK = Path(__file__).resolve().parents[3] / "shared" / "data" / "york_a"
LEAST_PX = 20.0
"""Shorter segments, annotated or found, are not compared."""
NEAR_PX, NEAR_RAD = 2.0, np.deg2rad(2.0)

pytestmark = pytest.mark.skipif(not YORK.exists(), reason="annotated photos are not here: ../shared/data/york_a")


def covered(segments, others):
    """Give the part of each segment (n, 4) that runs within 2 px and 2 degrees of some of the others, (n,)."""
    start, end = others[:, :2], others[:, 2:]
    lengths = np.linalg.norm(end - start, axis=1)
    along = (end - start) / lengths[:, None]
    out = np.zeros(len(segments))
    for k, segment in enumerate(segments):
        size = np.linalg.norm(segment[2:] - segment[:2])
        direction = (segment[2:] - segment[:2]) / size
        alike = np.abs(along @ direction) > np.cos(NEAR_RAD)
        points = segment[:2] + np.linspace(0.0, 1.0, int(size) + 2)[:, None] * (segment[2:] - segment[:2])
        relative = points[:, None] - start[alike]
        place = np.einsum("pni,ni->pn", relative, along[alike])
        beside = np.abs(relative[..., 0] * along[alike, 1] - relative[..., 1] * along[alike, 0])
        near = (beside <= NEAR_PX) & (place >= -NEAR_PX) & (place <= lengths[alike] + NEAR_PX)
        out[k] = near.any(axis=1).mean()
    return out


def long_ones(segments):
    return segments[np.linalg.norm(segments[:, 2:] - segments[:, :2], axis=1) >= LEAST_PX]


def scores(found, annotated):
    """Recall and precision: segments of which more than half is covered; then by length."""
    recall, precision = covered(long_ones(annotated), found), covered(found, annotated)
    weights = [np.linalg.norm(s[:, 2:] - s[:, :2], axis=1) for s in (long_ones(annotated), found)]
    return [
        np.mean(recall > 0.5),
        np.mean(precision > 0.5),
        np.average(recall, weights=weights[0]),
        np.average(precision, weights=weights[1]),
    ]


@pytest.fixture(scope="module")
def table():
    """Scores of all photos, (photos, 4), by detector."""
    rows = {"tieline": [], "opencv lsd": []}
    for truth in sorted(YORK.glob("*_gt.txt")):
        (path,) = (p for p in YORK.glob(f"{truth.stem.removesuffix('_gt')}.*") if p.suffix in {".jpg", ".png"})
        grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        annotated = np.loadtxt(truth)
        raw = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(grey)[0].reshape(-1, 4).astype(np.float64)
        rows["opencv lsd"].append(scores(long_ones(raw), annotated))
        rows["tieline"].append(scores(find(grey, min_length_px=LEAST_PX).raw_ends.reshape(-1, 4), annotated))
    means = {name: np.mean(values, axis=0) for name, values in rows.items()}
    for name, (recall, precision, by_length, precision_by_length) in means.items():
        print(
            f"\n{name}: recall {recall:.3f}, precision {precision:.3f}; "
            f"by length {by_length:.3f}, {precision_by_length:.3f} (means of {len(rows[name])} photos)",
            end="",
        )
    return means


def test_as_many_annotated_edges_are_found_as_by_opencv(table):
    assert table["tieline"][0] >= table["opencv lsd"][0]


def test_found_edges_are_annotated_as_often_as_those_of_opencv(table):
    assert table["tieline"][1] >= table["opencv lsd"][1]


def test_more_of_the_annotated_length_is_found_than_by_opencv(table):
    assert table["tieline"][2] >= table["opencv lsd"][2]
