"""A crash at any dealing with the disk, while files are uploaded, shared, removed, leaves nothing that stays wrong."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.service


def test_a_crash_at_any_moment_mends_itself(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.integration.crash_points", str(tmp_path)],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=True,
    )
    report = json.loads(done.stdout)
    assert report["wrong"] == {}, done.stderr[-3000:]
    assert report["ended"] == 0
    assert report["points"] > 50
