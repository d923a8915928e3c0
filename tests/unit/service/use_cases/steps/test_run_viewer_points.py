"""Of large scans every n-th point is shown, across the pieces in which they are read, or of those in memory."""

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from algorithms.progress import NoProgress
from algorithms.scans.scan import Scan
from service.formats.writers import PointPiece, StationCloud, write_scans
from service.names.feature_keys import viewer_points_of_step
from service.ports import StepContext
from service.use_cases.steps import run_viewer_points
from service.use_cases.steps.run_features import read_stored_scan
from service.use_cases.steps.run_viewer_points import every_nth, store_points_of_scan, write_points_of_scan
from tests.doubles.memory import MemoryBlobStore

SHA256 = "5" * 64


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


@pytest.mark.parametrize("ending", [".e57", ".laz", ".ply", ".xyz"])
def test_points_of_a_scan_in_memory_are_those_of_its_file(
    ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_viewer_points, "MOST_POINTS", 700)
    rng = np.random.default_rng(1)
    points = rng.uniform(-8.0, 8.0, (2000, 3))
    intensity = rng.uniform(0.0, 1.0, 2000).astype(np.float32)
    write_scans(tmp_path / f"a{ending}", [Scan(points=points, origin_m=np.zeros(3), intensity=intensity)])
    blobs = MemoryBlobStore()
    context = StepContext(blobs, NoProgress(), {"max_points": 10_000, "max_photo_pixels": 10_000})
    blobs.put_file(f"files/{SHA256}", tmp_path / f"a{ending}")
    arguments = {"sha256": SHA256, "filename": f"a{ending}", "index": 0}
    store_points_of_scan(context, arguments, read_stored_scan(context, arguments), NoProgress())
    write_points_of_scan(context, {**arguments, "owner": "another"})
    in_memory, streamed = (
        [blobs.local_path(key).read_bytes() for key in viewer_points_of_step({**arguments, "owner": owner})]
        for owner in ("", "another")
    )
    assert in_memory == streamed
