"""The covariance of merged lines is honest, mounts included."""

import numpy as np

from algorithms.features.merged_lines import merge_lines
from algorithms.features.projected_edges import ProjectedEdges
from algorithms.features.projection_options import MergeOptions
from algorithms.geometry.line_differences import line_differences, lines_moved
from algorithms.geometry.lines import lines_from_arrays

DRAWS = 150
MOUNT_STD = np.array([2e-4] * 3 + [1e-3] * 3)
EVERYTHING = MergeOptions(combination="weighted", alpha=1e-12, max_distance_m=1.0)


def line(anchor, direction, covariance):
    return lines_from_arrays(np.array([anchor]), np.array([direction]), covariance[None], np.array([[-1.0, 1.0]]))


def disturbed(true, by_mount, mount_error, rng):
    """A record of the true line with its private error and the mount's."""
    own = rng.multivariate_normal(np.zeros(4), true.covariances[0])
    return lines_moved(true, (own + by_mount @ mount_error)[None])


def part_of(lines, by_mount):
    none = np.empty(0, dtype=np.int64)
    return ProjectedEdges(
        lines, np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int32), np.array([[0.0, 0.0, 1.0]]), by_mount[None],
        np.zeros((1, 4, 4)), none, none.astype(np.int32),
    )  # fmt: skip


def drawn(rng):
    """Scan and two photos see one line from pieces 0.8 m apart; the merged line and the true one."""
    covariances = [m @ m.T for m in rng.normal(size=(3, 4, 4)) * np.array([2e-4, 2e-4, 3e-4, 3e-4])[None, :, None]]
    direction = np.array([0.3, 0.1, 0.95])
    direction /= np.linalg.norm(direction)
    trues = [
        line(np.array([5.0, 1.0, 0.5]) + s * direction, direction, c)
        for s, c in zip((0, 0.4, -0.4), covariances, strict=True)
    ]
    by_mounts = rng.normal(size=(3, 4, 6))
    errors = rng.normal(size=(3, 6)) * MOUNT_STD
    cloud = disturbed(trues[0], np.zeros((4, 6)), errors[0], rng)
    photos = [part_of(disturbed(trues[k], by_mounts[k], errors[k], rng), by_mounts[k]) for k in (1, 2)]
    merged = merge_lines(cloud, photos, [np.diag(MOUNT_STD**2)] * 2, EVERYTHING)
    assert len(merged.lines) == 1
    return trues[0], merged


def test_weighted_means_have_a_normalised_error_of_four():
    rng = np.random.default_rng(1)
    squares = []
    for _ in range(DRAWS):
        true, merged = drawn(rng)
        error, _ = line_differences(merged.lines, true)
        squares.append(float(error[0] @ np.linalg.solve(merged.lines.covariances[0], error[0])))
    # 4 +- 0.23
    assert 3.3 < np.mean(squares) < 4.7


def test_contradictions_fit_the_covariance_of_lines_and_mounts():
    rng = np.random.default_rng(2)
    squares = []
    for _ in range(DRAWS):
        note = drawn(rng)[1].contradictions
        # the first contradiction is that of the first photo and the scan
        covariance = note.covariances[0] + note.jacobians[0] @ np.diag(np.tile(MOUNT_STD**2, 2)) @ note.jacobians[0].T
        squares.append(note.differences[0] @ np.linalg.solve(covariance, note.differences[0]))
    assert 3.3 < np.mean(squares) < 4.7
