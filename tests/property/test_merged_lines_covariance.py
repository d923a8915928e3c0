"""The covariance of merged lines is honest though scan and photos measured their surfaces with the same points."""

import numpy as np
import pytest

from algorithms.features.photo_lines.merged_lines import MergedLines, merge_lines
from algorithms.features.photo_lines.projection_options import MergeOptions
from algorithms.geometry.line_differences import line_differences
from tests.scenes.lines.merged_line_scenes import DrawnStation, drawn_station

pytestmark = pytest.mark.slow

DRAWS = 200
EXACT = MergeOptions(alpha=1e-12, max_distance_m=1.0, rounding_std_m=0.0)
CASES = {"scan and photo": (1, True), "scan and two photos": (2, True), "two photos": (2, False)}


def merged(station: DrawnStation, options: MergeOptions = EXACT) -> MergedLines:
    result = merge_lines(station.cloud, station.parts, station.mounts, options)
    assert len(result.lines) == 1
    return result


def normalised(station: DrawnStation, result: MergedLines) -> float:
    error, _ = line_differences(result.lines, station.true)
    return float(error[0] @ np.linalg.solve(result.lines.covariances[0], error[0]))


@pytest.mark.parametrize("case", CASES)
def test_merged_lines_have_a_normalised_error_of_four(case: str) -> None:
    rng = np.random.default_rng(1)
    squares = []
    for _ in range(DRAWS):
        station = drawn_station(rng, CASES[case][0], seen=CASES[case][1])
        squares.append(normalised(station, merged(station)))
    # 2.5 times sqrt(8 / 200)
    assert np.mean(squares) == pytest.approx(4.0, abs=0.5)


def test_lines_merged_without_regard_to_common_points_would_promise_too_much() -> None:
    """The scenes would show it if the surface were counted twice."""
    rng = np.random.default_rng(2)
    squares = []
    for _ in range(DRAWS):
        station = drawn_station(rng, 2, seen=False, mount_std=(1e-6, 1e-6))
        naive = [
            type(part)(
                part.lines, part.segment_numbers, part.kinds, part.plane_normals, part.mount_jacobians,
                np.zeros_like(part.surface_covariances), part.rejected_numbers, part.rejected_reasons,
            )
            for part in station.parts
        ]  # fmt: skip
        result = merge_lines(station.cloud, naive, station.mounts, EXACT)
        squares.append(normalised(station, result))
    assert np.mean(squares) > 4.5


@pytest.mark.parametrize("case", CASES)
def test_a_merged_line_is_never_less_certain_than_the_best_of_its_records(case: str) -> None:
    rng = np.random.default_rng(3)
    for _ in range(60):
        station = drawn_station(rng, CASES[case][0], seen=CASES[case][1], mount_std=(10.0 ** rng.uniform(-6, -3),) * 2)
        result = merged(station)
        alone = [merge_lines(station.cloud, [], [], EXACT)] if len(station.cloud) else []
        none = station.cloud[:0]
        alone += [merge_lines(none, [p], [m], EXACT) for p, m in zip(station.parts, station.mounts, strict=True)]
        ends = np.stack(result.lines.end_points)[:, 0]
        best = min(mean_variance(one, ends) for one in alone)
        # the ends of lines that are tilted by 1e-3 against each other differ by about 1e-6 of their length
        assert mean_variance(result, ends) <= best * (1.0 + 1e-4)


def mean_variance(result: MergedLines, places: np.ndarray) -> float:
    """The mean variance across the only line at places (k, 3)."""
    lines, total = result.lines, 0.0
    for s in (places - lines.anchors[0]) @ lines.directions[0]:
        transfer = np.hstack([s * np.eye(2), np.eye(2)])
        total += float(np.trace(transfer @ lines.covariances[0] @ transfer.T)) / len(places)
    return total


@pytest.mark.parametrize("case", CASES)
def test_causes_explain_the_whole_covariance_of_merged_lines(case: str) -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        station = drawn_station(rng, CASES[case][0], seen=CASES[case][1])
        lines = merged(station).lines
        assert lines.private_covariances is not None
        total = lines.private_covariances[0].copy()
        if lines.parents[0, 0] >= 0:
            for k in range(2):
                part = lines.parent_jacobians[0, :, 3 * k : 3 * k + 3]
                total += part @ station.planes[lines.parents[0, k]] @ part.T
        for numbers, derivatives in (
            (lines.photos, lines.photo_jacobians),
            (lines.second_photos, lines.second_photo_jacobians),
        ):
            if numbers[0] >= 0:
                total += derivatives[0] @ station.mounts[numbers[0]] @ derivatives[0].T
        np.testing.assert_allclose(total, lines.covariances[0], rtol=1e-7, atol=1e-16)


@pytest.mark.parametrize("case", CASES)
def test_private_covariances_of_merged_lines_are_positive(case: str) -> None:
    rng = np.random.default_rng(5)
    for _ in range(40):
        station = drawn_station(rng, CASES[case][0], seen=CASES[case][1])
        values = np.linalg.eigvalsh(merged(station).lines.private_covariances[0])
        assert values[0] >= -1e-15 * values[-1]


def test_merged_lines_allow_for_rounded_edges() -> None:
    """Photo and planes may show the edge a millimetre apart: then the mean counts on it, and is on the safe side."""
    rng = np.random.default_rng(6)
    squares = []
    rounded = MergeOptions(alpha=1e-12, max_distance_m=1.0)
    for _ in range(DRAWS):
        station = drawn_station(rng, 1)
        squares.append(normalised(station, merged(station, rounded)))
    # sqrt(8 / 200) = 0.2
    assert np.mean(squares) < 4.6
