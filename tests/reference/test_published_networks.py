"""Networks that others adjusted: GNU Gama's, a seven-parameter transformation, a scanner's calibration."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from algorithms.adjustment.hybrid.closed_forms import similarity
from algorithms.progress import NoProgress
from schemas.requests.adjust_inputs import AdjustInputs
from schemas.results.adjust_result import AdjustDocument
from service.processes.adjust.adjusting import adjusted_document
from tests.scenes.gama_networks import gama_answer

OPEN = Path(__file__).parents[2].parent / "shared" / "data" / "adj_open"


def adjusted(network: dict[str, Any], **options: Any) -> AdjustDocument:
    inputs = AdjustInputs.model_validate({"network": network, "gross_errors": "none"} | options)
    return adjusted_document(inputs.model_dump(mode="json"), "job", NoProgress())[0]


def existing(path: Path) -> Path:
    if not path.exists():
        pytest.skip(f"data not found: {path}")
    return path


@pytest.mark.parametrize(
    ("name", "held"),
    [
        ("krumm__3D__Caspary", True),
        ("krumm__3D__Wolf_3D_DistanceVerticalAngle_fix", True),
        ("krumm__3D__Wolf_SpatialPolygonTraverse_fix", True),
        ("sim__from-to-dh", True),
        ("ctu__2020-barta-phase_0-1TK", False),
        ("ctu__2020-barta-phase_0-2TK", False),
    ],
)
def test_spatial_networks_of_gama_have_gamas_answer(name: str, held: bool) -> None:
    path = existing(OPEN / "gama" / f"{name}.gkf")
    document = adjusted(
        {"format": "gama-local", "xml": path.read_text()}, datum={"type": "control" if held else "free"}
    )
    points, squares, freedom, prior = gama_answer(path)
    assert document.redundancy == freedom
    assert document.omega == pytest.approx(squares / prior**2, rel=1e-6, abs=1e-9)
    found = {p.id: p.xyz_m for p in document.points}
    common = [key for key in points if key in found]
    ours, theirs = np.array([found[k] for k in common]), np.array([points[k] for k in common])
    if not held:
        _, rotation, shift = similarity(ours, theirs)
        ours = ours @ rotation.T + shift
    np.testing.assert_allclose(ours, theirs, atol=2e-6)  # as printed


def test_the_seven_parameter_transformation_of_stuttgart_is_the_published_one() -> None:
    data = json.loads(existing(OPEN / "helmert" / "stuttgart7.json").read_text())
    source, target = np.array(data["source"]), np.array(data["target"])
    scale, rotation, shift = similarity(source, target, with_scale=True)
    assert scale == pytest.approx(1.00000558252, abs=1e-11)
    np.testing.assert_allclose(shift, [641.8804, 68.6553, 416.3982], atol=1e-4)
    misses = target - (scale * source @ rotation.T + shift)
    assert np.sqrt(np.sum(misses**2) / (3 * len(source) - 7)) == pytest.approx(0.0772, abs=5e-5)


def test_the_errors_of_a_simulated_scanner_are_recovered_within_three_standard_deviations() -> None:
    """Lichti's model 2007: a0 = -4 mm, b1 = 1 mrad, b2 = -1 mrad, c0 = -2 mrad of the elevation."""
    folder = existing(OPEN / "ppe_tls" / "Testdata_1")
    known = table(folder / "OPs" / "PPE_TLS_T1_OP.txt")
    gon = 200.0 / np.pi
    stds = {"horizontal": 0.01, "zenith": 0.01, "distance": 0.001}
    polar = []
    for k in (1, 2):
        for number, (x, y, z) in table(folder / "Scans" / f"PPE_TLS_T1_Scan{k}.dat").items():
            values = np.arctan2(y, x) * gon, np.arctan2(np.hypot(x, y), z) * gon, np.linalg.norm([x, y, z])
            entry: dict[str, Any] = {"station": f"S{k}", "point": number}
            for name, value in zip(stds, values, strict=True):
                entry |= {name: float(value), f"sigma_{name}": stds[name]}
            polar.append(entry)
    network = {
        "format": "hybrid-network/1",
        "stations": [{"id": "S1", "scanner": "T"}, {"id": "S2", "scanner": "T"}],
        "scanners": [{"id": "T", "unknown": ["distance_offset", "collimation", "trunnion", "zenith_index"]}],
        "observations": {
            "polar": polar,
            "control": [{"point": number, "xyz": xyz, "held": True} for number, xyz in known.items()],
        },
    }
    document = adjusted(network, datum={"type": "control"}, variance_components=True)
    truth = {"distance_offset": -0.004, "collimation": 1e-3 * gon, "trunnion": -1e-3 * gon, "zenith_index": 2e-3 * gon}
    found = {p.parameter: p for p in document.parameters}
    for name, value in truth.items():
        assert abs(found[name].value - value) < 3.0 * (found[name].std or 0.0), name
        assert found[name].significant


def table(path: Path) -> dict[str, list[float]]:
    """Read rows of a number and three coordinates."""
    rows = [line.split() for line in path.read_text().splitlines() if re.match(r"\s*\d+\s+-?\d+\.\d", line)]
    return {row[0]: [float(word) for word in row[1:4]] for row in rows}
