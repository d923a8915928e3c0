"""Time and memory of the report step of large networks, each size in a process of its own.

    TIELINE_REPORTED=1000,5000 uv run pytest -n0 -s -m benchmark tests/benchmark/test_large_report.py

Features and pairs are stored as their steps would (`large_report_child`): each station with its five nearest ones.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(3600)]

COUNTS = [int(count) for count in os.environ.get("TIELINE_REPORTED", "1000,5000").split(",")]
CHILD = Path(__file__).with_name("large_report_child.py")
MOST_MB = 1000.0
"""Of the process of the report, libraries included."""


def run(mode: str, count: int, folder: Path) -> dict[str, Any]:
    """Store or report a network in its own process."""
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, str(CHILD), mode, str(count), str(folder)]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True, timeout=3000, env=environment)
    figures: dict[str, Any] = json.loads(done.stdout)
    return figures


def test_the_report_of_thousands_of_stations_takes_little_memory(tmp_path: Path) -> None:
    rows = {}
    for count in COUNTS:
        folder = tmp_path / str(count)
        folder.mkdir()
        stored, rows[count] = run("store", count, folder), run("report", count, folder)
        row = rows[count]
        print(
            f"\n{count} stations: report {row['seconds']:.0f} s of processor, peak {row['peak_mb']:.0f} MB (libraries "
            f"{row['before_mb']:.0f} MB), {row['written_mb']:.0f} MB written, document {row['document_kb']:.0f} kB, "
            f"report.html {row['report_kb']:.0f} kB; adjustment before {stored['adjusted_s']:.0f} s, "
            f"{stored['peak_mb']:.0f} MB\n{row['registered']}"
        )
    if len(rows) > 1:
        for name, values in (
            ("seconds", [row["seconds"] for row in rows.values()]),
            ("memory beyond the libraries", [row["peak_mb"] - row["before_mb"] for row in rows.values()]),
        ):
            print(f"{name} grow as n^{np.polyfit(np.log(list(rows)), np.log(values), 1)[0]:.2f}")
    for count, row in rows.items():
        assert row["peak_mb"] < MOST_MB
        assert row["paged"] == (count > 500)
