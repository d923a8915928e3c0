"""Several methods on the same two stations, from the command line to the table."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.e2e.running.command_line import tieline
from tests.e2e.running.running_service import RunningService
from tests.e2e.running.virtual_scans import first_from_second


@pytest.mark.slow
def test_methods_are_laid_side_by_side_and_the_answer_is_that_of_the_jobs_own(
    service: RunningService, house: list[Path], tmp_path: Path
) -> None:
    first, second = (path.stem for path in house)
    known = tmp_path / "known.json"
    known.write_text(json.dumps({first: np.eye(4).tolist(), second: first_from_second("house").as_matrix().tolist()}))
    asked = ("--compare-methods", "planes-triples,icp-point", "--reference", known)
    done = tieline("register", *house, *asked, "--url", service.url, "--output", tmp_path / "kept")
    assert done.returncode == 0, done.stderr
    assert "methods side by side" in done.stdout
    result = json.loads((tmp_path / "kept" / "result.json").read_text())
    rows = {row["method"]: row for row in result["method_comparison"]["rows"]}
    assert list(rows) == ["auto", "planes-triples", "icp-point"]
    assert rows["auto"]["pose"]["matrix"] == result["pairs"][0]["target_from_source"]["matrix"]
    for row in rows.values():
        assert row["mark"] == "accepted"
        assert row["difference_to_reference"]["shift_m"] < 0.005
        assert row["seconds"] > 0.0
        assert row["peak_memory_bytes"] is None or row["peak_memory_bytes"] > 50e6
    assert rows["icp-point"]["own_figures"]["convergence"]
    for name in ("methods.csv", "methods-matrix.csv", "methods.svg"):
        assert (tmp_path / "kept" / name).stat().st_size > 0
    assert "Methods side by side" in (tmp_path / "kept" / "report.html").read_text()
