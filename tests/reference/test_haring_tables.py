"""Haring's mean standard deviations (tables 4-6, 4-7 and 4-8) beside those of simulated networks of his layout.

His observations are not printed; the open network has nine of his ten stations and 16 of his 22 photos, the network of
scans alone all twenty scans with as many observations as he used.
"""

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from algorithms.progress import NoProgress
from schemas.requests.adjust_inputs import AdjustInputs
from schemas.results.adjust_result import AdjustDocument
from service.processes.adjust.adjusting import adjusted_document

VECTORS = Path(__file__).parents[2].parent / "shared" / "data" / "vectors"
HELD = [["401", "XYZ"], ["402", "YZ"], ["403", "Z"]]
GROUPS = {
    "points_object_mm": lambda p: p.id < "300" or p.id > "400",
    "points_periphery_mm": lambda p: "300" < p.id < "400",
    "points_all_mm": lambda p: bool(p.id),
}
TABLES = {"4-6": ("open_hybrid_input", 0.01), "4-7": ("open_hybrid_input", None), "4-8": ("ref_scans_only_input", None)}
TOLERANCE = 0.35
"""Share by which other noise, one station and six photos less change a mean standard deviation."""


def read(name: str) -> dict[str, Any]:
    path = VECTORS / f"{name}.json"
    if not path.exists():
        pytest.skip(f"test vectors not found: {path}")
    return json.loads(path.read_text())


@cache
def means(table: str) -> dict[str, list[float]]:
    source, std = TABLES[table]
    network = read(source)
    datum = {"type": "free"} if std is None else {"type": "minimal", "held": HELD, "std_m": std}
    inputs = AdjustInputs.model_validate({"network": network, "datum": datum, "gross_errors": "none"})
    document: AdjustDocument = adjusted_document(inputs.model_dump(mode="json"), "job", NoProgress())[0]
    scans = [s for s in document.stations if s.type == "scanner"]
    photos = [s for s in document.stations if s.type == "photo"]
    found = {"scans_mm": [s.std_xyz_m for s in scans], "scans_mgon": [s.std_gon for s in scans]}
    if photos:
        found |= {"photos_mm": [s.std_xyz_m for s in photos], "photos_mgon": [s.std_gon for s in photos]}
    for name, chosen in GROUPS.items():
        found[name] = [p.std_m for p in document.points if chosen(p)]
    return {name: (1000.0 * np.mean(values, axis=0)).tolist() for name, values in found.items()}


@pytest.mark.parametrize("table", TABLES)
def test_mean_standard_deviations_are_those_of_haring_but_for_the_layout(table: str) -> None:
    printed = read("marc_anton")["tables"][table]
    print(f"\ntable {table}: printed | here")
    for name, ours in means(table).items():
        theirs = printed[name]
        print(f"{name:22s}", *(f"{value:8.1f}" for value in theirs), " | ", *(f"{value:8.1f}" for value in ours))
        np.testing.assert_allclose(ours, theirs, rtol=TOLERANCE, atol=0.3)
