"""What became of the lines of photos in a pair: counted, and those that carry nothing named."""

from dataclasses import replace

import numpy as np
import pytest

from algorithms.adjustment.line_adjustment import adjust_lines
from algorithms.adjustment.mount_errors import MountError
from algorithms.features.photo_lines.projection_options import EdgeRejection, SpaceEdgeKind
from algorithms.features.scan_features import PhotoEdges, ScanFeatures
from algorithms.geometry.line_motion import moved_lines
from algorithms.geometry.lines import Lines, LineSource, lines_from_arrays
from algorithms.geometry.poses import PoseEstimate
from algorithms.registration.base import FineRegistration
from schemas.results.registration_result import PhotoLineCounts
from service.use_cases.documents.line_counts import line_counts
from service.use_cases.documents.pair_documents import photo_line_counts
from tests.unit.service.use_cases.documents.test_pair_documents import MIXED, POSE, STD, noisy
from tests.unit.service.use_cases.steps.test_feature_store import some_features

N = len(MIXED)
FROM_PHOTO = np.arange(N) >= 4
MOVED, LONELY = 7, N - 1
"""A line that moved by 5 cm between the photos, as a shadow does, and one that only the target's photo shows."""


def with_photo(lines: Lines) -> ScanFeatures:
    sources = np.where(FROM_PHOTO, int(LineSource.PHOTO_EDGE), int(LineSource.PLANE_INTERSECTION)).astype(np.int32)
    kinds = np.where(FROM_PHOTO, int(SpaceEdgeKind.SURFACE_EDGE), -1).astype(np.int32)
    counts = np.array([N])
    edges = PhotoEdges(
        counts, counts, counts, np.zeros((1, len(EdgeRejection)), dtype=np.int64), np.zeros((N, 3)), kinds
    )
    photos = np.where(FROM_PHOTO, 0, -1).astype(np.int32)
    seen = replace(lines, sources=sources, photos=photos, photo_jacobians=np.zeros((N, 4, 6)))
    return replace(some_features(), lines=seen, photo_edges=edges, photo_covariances=np.eye(6)[None])


@pytest.fixture(scope="module")
def pair() -> tuple[FineRegistration, ScanFeatures, ScanFeatures]:
    rng = np.random.default_rng(1)
    lines = lines_from_arrays(
        rng.uniform(-3, 3, size=(N, 3)),
        np.array(MIXED, dtype=np.float64),
        np.tile(STD**2 * np.eye(4), (N, 1, 1)),
        np.tile([-1.0, 1.0], (N, 1)),
    )
    target, source = noisy(moved_lines(lines, POSE), rng), noisy(lines, rng)
    target.anchors[MOVED] += 0.05 * target.bases[MOVED, :, 0]
    pairs = np.repeat(np.arange(LONELY, dtype=np.int64)[:, None], 2, axis=1)
    adjustment = adjust_lines(target, source, pairs, POSE)
    pose = PoseEstimate(POSE, np.eye(6))
    fine = FineRegistration(pairs, np.empty((0, 2), dtype=np.int64), adjustment, pose, np.zeros(3))
    return fine, with_photo(target), with_photo(source)


@pytest.fixture(scope="module")
def counts(pair: tuple[FineRegistration, ScanFeatures, ScanFeatures]) -> PhotoLineCounts:
    found = photo_line_counts(*pair, target="A", source="B")
    assert found is not None
    return found


def test_lines_of_every_source_are_counted_at_both_stations(
    pair: tuple[FineRegistration, ScanFeatures, ScanFeatures],
) -> None:
    found = line_counts(*pair, target="A", source="B")
    rows = [(each.station, each.source, each.found, each.matched, each.used, each.removed) for each in found]
    of_station = [
        ("plane-intersection", 4, 4, 4, 0),
        ("cylinder-axis", 0, 0, 0, 0),
        ("photo-edge", N - 4, N - 5, N - 6, 1),
    ]
    assert rows == [(station, *row) for station in "AB" for row in of_station]


def test_without_photos_only_lines_of_scans_are_counted() -> None:
    found = line_counts(None, some_features(), some_features(), target="A", source="B")
    assert [each.source for each in found] == ["plane-intersection", "cylinder-axis"] * 2
    assert sum(each.matched + each.used + each.removed for each in found) == 0


def test_lines_of_photos_are_counted_by_what_became_of_them(counts: PhotoLineCounts) -> None:
    assert (counts.target_found, counts.source_found) == (N - 4, N - 4)
    assert (counts.matched, counts.used, counts.removed) == (N - 5, N - 6, 1)


def test_a_moved_line_is_named_as_removed_on_both_sides(counts: PhotoLineCounts) -> None:
    removed = [(each.line, each.surface, each.photo) for each in counts.unused if each.state == "removed"]
    assert removed == [(f"A/L{MOVED + 1}", "surface-edge", 0), (f"B/L{MOVED + 1}", "surface-edge", 0)]


def test_a_line_without_partner_is_named_as_unmatched(counts: PhotoLineCounts) -> None:
    assert [each.line for each in counts.unused if each.state == "unmatched"] == [f"A/L{N}", f"B/L{N}"]


def test_all_are_unmatched_where_no_pose_was_found() -> None:
    features = with_photo(
        lines_from_arrays(np.zeros((N, 3)), np.tile([1.0, 0, 0], (N, 1)), np.zeros((N, 4, 4)), np.zeros((N, 2)))
    )
    found = photo_line_counts(None, features, features, target="A", source="B")
    assert found is not None
    assert (found.matched, len(found.unused)) == (0, 2 * (N - 4))


def test_stations_without_photos_have_no_counts() -> None:
    assert photo_line_counts(None, some_features(), some_features(), target="A", source="B") is None


def test_a_wrong_mount_is_told_with_its_station_and_size(
    pair: tuple[FineRegistration, ScanFeatures, ScanFeatures],
) -> None:
    fine, target, source = pair
    error = np.array([0.0, 0.002, 0.0, 0.0, 0.0, 0.03])
    wrong = MountError((1, 0), 99.0, 22.5, 120.0, 80.0, error, np.diag([1e-8] * 3 + [1e-6] * 3))
    adjustment = replace(fine.adjustment, mount_errors=(wrong,))
    found = photo_line_counts(replace(fine, adjustment=adjustment), target, source, target="A", source="B")
    assert found is not None
    (told,) = found.wrong_mounts
    assert (told.station, told.photo, told.statistic, told.critical) == ("B", 0, 99.0, 22.5)
    assert (told.global_statistic, told.global_critical) == (120.0, 80.0)
    figures = (told.rotation_gon, told.rotation_std_gon, told.translation_m)
    assert figures == pytest.approx((0.002 * 200 / np.pi, 1e-4 * 200 / np.pi, 0.03))
