"""The covariance of lines from photos is honest."""

import pytest

from tests.scenes.photos.photo_monte_carlo import EDGES, many


@pytest.fixture(scope="module")
def drawn():
    """Sixty noisy photos and scans."""
    return many(range(60))


def test_all_edges_are_found(drawn):
    assert drawn[0] >= 0.98 * 60 * len(EDGES)


def test_lines_from_photos_have_a_normalised_error_of_four(drawn):
    # 4 +- 0.15 for 360 lines
    assert 3.55 < drawn[1].mean() < 4.45


def test_lines_from_photos_lie_within_three_standard_deviations(drawn):
    assert (drawn[2] < 3.0).mean() >= 0.99
