"""Of large scans every n-th point is shown, across the pieces in which they are read."""

import itertools
from collections.abc import Iterator

import numpy as np
import pytest

from service.formats.writers import PointPiece, StationCloud
from service.use_cases.steps.run_viewer_points import every_nth


@pytest.mark.parametrize("nth", [1, 2, 3, 7, 50])
def test_every_nth_point_is_kept_wherever_pieces_end(nth: int) -> None:
    points = np.random.default_rng(1).normal(size=(101, 3))
    intensity = np.arange(101, dtype=np.float32)
    ends = [0, 5, 5, 30, 33, 101]

    def pieces() -> Iterator[PointPiece]:
        for start, end in itertools.pairwise(ends):
            yield PointPiece(points[start:end], intensity=intensity[start:end])

    cloud = StationCloud(name="S", pieces=pieces, origin_m=np.zeros(3), has_intensity=True, has_color=False)
    kept = list(every_nth(cloud, nth).pieces())
    assert np.array_equal(np.concatenate([piece.points for piece in kept]), points[::nth])
    assert np.array_equal(np.concatenate([piece.intensity for piece in kept]), intensity[::nth])
