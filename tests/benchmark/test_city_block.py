"""Choice of pairs, loops, pose graph and adjustment of a simulated city, from ten to five thousand stations.

    TIELINE_RECORD=1 uv run pytest -n0 -s -m benchmark tests/benchmark/test_city_block.py

Environment: TIELINE_BLOCK, numbers of stations with commas between (10,100,1000,5000 by default). Each size runs in a
process of its own, without shape checks; the registrations of pairs are drawn, not computed (`city_block`).
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(3600)]

COUNTS = [int(count) for count in os.environ.get("TIELINE_BLOCK", "10,100,1000,5000").split(",")]
PARTS = ("choice", "loops of rounds", "loops", "graph", "joint", "fusion", "network")
MOST_S, MOST_MB = 300.0, 4096.0
"""For 5000 stations: choice, graph and adjustment, of one processor; peak of the whole process."""
LARGE = 1000
"""From so many stations on four pairs are tried for each at most."""
FITTED_FROM = 100
"""Fewer stations take fixed costs only."""


PICTURE = Path(__file__).with_name("city_block_growth.svg")
WIDTH, HEIGHT, MARGIN = 640, 420, 60
COLOURS = ("#1b6ca8", "#c44536", "#e09f3e", "#5c8d4d", "#6b4c9a", "#3d3d3d", "#000000")


def growth_drawing(rows: list[dict[str, Any]], exponent: float) -> str:
    """Draw processor seconds of each part against the number of stations, both logarithmic, as SVG."""
    counts = [row["stations"] for row in rows]
    seconds = {
        part: [(row["stations"], row["seconds"][part]) for row in rows if row["seconds"].get(part, 0.0) > 0.0]
        for part in PARTS
    }
    values = [value for points in seconds.values() for _, value in points]
    low, high = np.floor(np.log10(min(values))), np.ceil(np.log10(max(values)))
    first, last = np.log10(min(counts)), np.log10(max(counts))

    def at(count: float, value: float) -> tuple[float, float]:
        x = MARGIN + (np.log10(count) - first) / max(last - first, 1e-9) * (WIDTH - 3 * MARGIN)
        y = HEIGHT - MARGIN - (np.log10(value) - low) / (high - low) * (HEIGHT - 2 * MARGIN)
        return round(float(x), 1), round(float(y), 1)

    size = f'width="{WIDTH}" height="{HEIGHT}"'
    drawn = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" font-size="12">',
        f'<rect {size} fill="#fff"/>',
        f'<text x="{MARGIN}" y="24">Processor seconds against stations; all of it grows as n^{exponent:.2f}</text>',
    ]
    for power in range(int(low), int(high) + 1):
        x, y = at(counts[0], 10.0**power)
        drawn.append(
            f'<path d="M{x},{y}H{WIDTH - 2 * MARGIN}" stroke="#ddd"/><text x="8" y="{y + 4}">1e{power} s</text>'
        )
    for count in counts:
        x, y = at(count, 10.0**low)
        drawn.append(f'<text x="{x}" y="{y + 20}" text-anchor="middle">{count}</text>')
    for colour, (part, points) in zip(COLOURS, seconds.items(), strict=True):
        line = " ".join(f"{x},{y}" for x, y in (at(*point) for point in points))
        drawn.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"/>')
        if points:
            x, y = at(*points[-1])
            drawn.append(f'<text x="{x + 6}" y="{y + 4}" fill="{colour}">{part}</text>')
    return "\n".join([*drawn, "</svg>", ""])


def of_size(count: int) -> dict[str, Any]:
    """Run one size in its own process."""
    child = Path(__file__).with_name("city_block_child.py")
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, str(child), str(count)]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True, timeout=3000, env=environment)
    figures: dict[str, Any] = json.loads(done.stdout)
    return figures


def test_a_city_of_thousands_of_stations_is_registered_in_minutes() -> None:
    rows = [of_size(count) for count in COUNTS]
    for row in rows:
        seconds = row["seconds"]
        print(
            f"\n{row['stations']} stations, {row['planes']:.1f} planes each: {row['tried']} pairs tried in "
            f"{row['rounds']} rounds ({row['tried'] / row['stations']:.2f} a station), {row['links']} accepted, "
            f"{row['misleading']} wrong in no loop and left out; of the others {row['wrong']} wrong, "
            f"{row['wrong_used']} used, {row['good_rejected']} good ones rejected\n"
            f"{row['connected']} stations in the frame ({row['connected'] / row['stations']:.1%}; "
            f"{row['reachable']} if all pairs were tried), of these {row['wrong_poses']} wrong by more than 5 cm; "
            f"{row['left_out']} open to planes, {row['tracks']} planes, {row['conditions']} conditions, "
            f"{row['removed']} features removed\n"
            f"processor seconds: {', '.join(f'{part} {seconds[part]:.2f}' for part in PARTS if part in seconds)}; "
            f"peak {row['peak_mb']:.0f} MB\n"
            f"largest error {1e3 * row['largest_error_m']:.1f} mm, NEES of each station "
            f"{row['nees_of_each']:.3f}, of all together {row['nees_together'] or float('nan'):.3f}, variance factor "
            f"{row['variance_factor']:.2f}"
        )
    fitted = [row for row in rows if row["stations"] >= FITTED_FROM]
    if len(fitted) > 1:
        logs = np.log([row["stations"] for row in fitted])
        for part in PARTS:
            spent = np.log([max(row["seconds"].get(part, 0.0), 1e-3) for row in fitted])
            print(f"{part} grows as n^{np.polyfit(logs, spent, 1)[0]:.2f}")
        whole = [
            row["seconds"]["choice"] + row["seconds"]["loops of rounds"] + row["seconds"]["network"] for row in fitted
        ]
        exponent = float(np.polyfit(logs, np.log(whole), 1)[0])
        print(f"all of it grows as n^{exponent:.2f}: {PICTURE.name}")
        if os.environ.get("TIELINE_RECORD"):
            PICTURE.write_text(growth_drawing(rows, exponent))
    for row in rows:
        whole = sum(row["seconds"].get(part, 0.0) for part in ("choice", "loops of rounds", "network"))
        assert whole < MOST_S
        assert row["peak_mb"] < MOST_MB
        assert row["stations"] < LARGE or row["tried"] <= 4 * row["stations"]
        assert row["stations"] < LARGE or row["connected"] > 0.9 * row["reachable"]
        assert row["largest_error_m"] < 0.05
        assert row["wrong_used"] == 0
        if row["nees_together"] is not None:
            degrees = 6 * (row["connected"] - 1)
            low, high = stats.chi2.ppf([0.0005, 0.9995], degrees) / degrees
            assert low < row["nees_together"] < high
