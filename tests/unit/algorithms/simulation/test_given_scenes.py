"""Scenes of planes with outlines and of meshes, and the instruments that look at them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.errors import InvalidInputError
from algorithms.simulation.given_scenes import GivenPlane, scene_of_mesh, scene_of_planes, triangles_of_outline
from algorithms.simulation.instruments import INSTRUMENTS
from algorithms.simulation.materials import CONCRETE, PAINT
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.stations import station_pose

SQUARE = np.array([[-5.0, 4.0, -5.0], [5.0, 4.0, -5.0], [5.0, 4.0, 5.0], [-5.0, 4.0, 5.0]])
EXACT = VirtualScanner(rows=60, columns=240, range_noise_std_m=0.0, angle_noise_std_rad=0.0, mixed_pixels=False)
EXACT = replace(EXACT, intensity_noise=0.0)


def area(corners: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.1])
def test_an_outline_with_re_entrant_corners_is_covered_once(turn: float) -> None:
    flat = np.array([[0, 0], [4, 0], [4, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]], dtype=float)
    turned = Rotation.from_rotvec([turn, 0.3, -turn]).apply(np.column_stack([flat, np.zeros(8)]))
    corners = turned + np.array([7.0, 1.0, 2.0])
    for ring in (corners, corners[::-1]):
        triangles = triangles_of_outline(ring, "wall")
        assert area(ring, triangles) == pytest.approx(12.0 - 2.0)


def test_corners_on_a_straight_side_are_allowed() -> None:
    ring = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], dtype=float)
    assert area(ring, triangles_of_outline(ring, "floor")) == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("ring", "why"),
    [
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], "no area"),
        ([[0, 0, 0], [1, 0, 0], [1, 1, 0.4], [0, 1, 0]], "one plane"),
        ([[0, 0, 0], [3, 3, 0], [3, 0, 0], [0, 1, 0]], "crosses itself"),
    ],
)
def test_outlines_that_bound_nothing_are_refused_by_name(ring: list[list[float]], why: str) -> None:
    with pytest.raises(InvalidInputError, match=why) as caught:
        triangles_of_outline(np.array(ring, dtype=float), "north wall")
    assert "north wall" in str(caught.value)


def test_a_scan_of_a_given_plane_lies_on_it() -> None:
    scene = scene_of_planes("one", [GivenPlane("wall", SQUARE, PAINT)])
    pose = station_pose((0.3, -1.0, 0.2), 0.4)
    scan = scan_scene(scene, pose, EXACT, np.random.default_rng(0))
    world = pose.apply(scan.points)
    assert len(world) > 500
    np.testing.assert_allclose(world[:, 1], 4.0, atol=1e-9)
    assert np.abs(world[:, [0, 2]]).max() <= 5.0 + 1e-6


def test_a_mesh_gives_what_its_planes_give() -> None:
    triangles = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int64)
    scans = [
        scan_scene(scene, RigidTransform.identity(), EXACT, np.random.default_rng(0))
        for scene in (
            scene_of_mesh("m", SQUARE, triangles, CONCRETE),
            scene_of_planes("p", [GivenPlane("w", SQUARE, CONCRETE)]),
        )
    ]
    np.testing.assert_allclose(scans[0].points, scans[1].points, atol=1e-12)


def test_the_intensity_follows_the_radar_equation_where_the_instrument_does_not_take_the_distance_out() -> None:
    scene = scene_of_planes("one", [GivenPlane("wall", SQUARE, PAINT)])
    scan = scan_scene(
        scene, RigidTransform.identity(), replace(EXACT, intensity_reference_m=10.0), np.random.default_rng(0)
    )
    ranges = np.linalg.norm(scan.points, axis=1)
    cosines = 4.0 / ranges
    assert scan.intensity is not None
    np.testing.assert_allclose(scan.intensity, PAINT.reflectance * cosines * (10.0 / ranges) ** 2, rtol=1e-5)


def test_haze_shortens_the_reach() -> None:
    far = SQUARE * [40.0, 25.0, 40.0]
    scene = scene_of_planes("far", [GivenPlane("wall", far, PAINT)])
    clear, haze = (
        len(scan_scene(scene, RigidTransform.identity(), scanner, np.random.default_rng(0)))
        for scanner in (EXACT, replace(EXACT, attenuation_db_per_km=60.0))
    )
    assert haze < clear


@pytest.mark.parametrize("instrument", INSTRUMENTS.values(), ids=lambda each: each.name)
def test_instruments_take_a_step_as_fine_as_they_can_and_no_finer(instrument) -> None:  # type: ignore[no-untyped-def]
    scanner = instrument.with_step(0.01)
    assert scanner.column_step_rad == pytest.approx(0.01, rel=0.01)
    with pytest.raises(InvalidInputError):
        instrument.with_step(0.5 * instrument.finest_step_rad)


def test_the_mean_of_four_shots_of_the_z360i_has_the_printed_six_millimetres() -> None:
    instrument = INSTRUMENTS["riegl-lms-z360i"]
    assert instrument.scanner.range_noise_std_m == pytest.approx(0.012)
    assert instrument.with_step(None, shots=4).range_noise_std_m == pytest.approx(0.006)
    assert 1e2 * 10.0 * instrument.scanner.beam_divergence_rad == pytest.approx(2.0)
