"""Spline surfaces can be read again from their files, and are the same."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import NdBSpline

from algorithms.meshing.spline_patches import CylinderPatch, HeightFieldPatch, SplinePatch, fitted_patch
from service.formats.spline_writers import write_iges, write_json

ORIGIN_M = np.array([500_000.0, 5_600_000.0, 100.0])
AT = np.random.default_rng(0).uniform(0.0, 1.0, (50, 2))


@pytest.fixture(scope="module")
def patches() -> list[SplinePatch]:
    """A wavy rectangle and a column."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0.0, 2.0, (2, 2000))
    waves = np.column_stack([x, y, 0.1 * np.sin(3.0 * x)])
    square = HeightFieldPatch(np.zeros(3), np.array([2.0, 0.0, 0.0]), np.array([0.0, 2.0, 0.0]), 1.0)
    column = CylinderPatch(np.zeros(3), np.array([0.0, 0.0, 2.0]), np.eye(3)[0], 0.0, 2.0 * np.pi, 0.1, 2.0)
    around = np.column_stack([np.cos(np.pi * x), np.sin(np.pi * x), y])
    return [fitted_patch(waves, square, 3, 0.0, 16), fitted_patch(around, column, 2, 0.0, 16)]


def test_json_holds_knots_and_control_points_of_the_same_surface(tmp_path: Path, patches: list[SplinePatch]) -> None:
    write_json(tmp_path / "patches.json", ["wall", "column"], patches, ORIGIN_M)
    document = json.loads((tmp_path / "patches.json").read_text())
    for each, patch in zip(document["patches"], patches, strict=True):
        found = NdBSpline((each["knots_u"], each["knots_v"]), np.array(each["control_m"]), (each["degree"],) * 2)(AT)
        np.testing.assert_allclose(found, patch.at(*AT.T) + ORIGIN_M, atol=1e-8)


def test_iges_holds_the_same_surface(tmp_path: Path, patches: list[SplinePatch]) -> None:
    write_iges(tmp_path / "patches.igs", ["wall", "column"], patches, ORIGIN_M)
    rows = (tmp_path / "patches.igs").read_text().splitlines()
    assert {len(row) for row in rows} == {80}
    directory = [row for row in rows if row[72] == "D"]
    parameters = [row[:64] for row in rows if row[72] == "P"]
    for number, patch in enumerate(patches):
        kind, first, count = (int(each) for each in (directory[2 * number][:8], directory[2 * number][8:16],
                                                     directory[2 * number + 1][24:32]))  # fmt: skip
        text = "".join(row.rstrip() for row in parameters[first - 1 : first - 1 + count])
        assert kind == 128
        assert text.endswith(";")
        values = [float(each.replace("D", "e")) for each in text[:-1].split(",")]
        _, k1, k2, m1, m2 = (int(each) for each in values[:5])
        a, b = k1 + m1 + 2, k2 + m2 + 2
        size = (k1 + 1) * (k2 + 1)
        knots_u, knots_v = np.array(values[10 : 10 + a]), np.array(values[10 + a : 10 + a + b])
        start = 10 + a + b + size
        control = np.array(values[start : start + 3 * size]).reshape(k2 + 1, k1 + 1, 3).swapaxes(0, 1)
        assert values[start + 3 * size :] == [0.0, 1.0, 0.0, 1.0]
        assert set(values[10 + a + b : start]) == {1.0}
        found = NdBSpline((knots_u, knots_v), np.ascontiguousarray(control), (m1, m2))(AT)
        np.testing.assert_allclose(found, patch.at(*AT.T) + ORIGIN_M, atol=1e-8)
    assert rows[-1][:32] == f"S{1:7d}G{sum(row[72] == 'G' for row in rows):7d}D{4:7d}P{len(parameters):7d}"
