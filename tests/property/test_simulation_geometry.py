"""What holds for every scene, wall and pose."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.simulation.materials import PLASTER
from algorithms.simulation.parts import box, moved
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scene import scene_from_parts
from algorithms.simulation.stations import station_pose
from algorithms.simulation.walls import sheet_cells

PARTS = [
    box((-3.0, -4.0, -1.5), (5.0, 4.0, 2.0), PLASTER),
    box((1.0, 1.0, -1.5), (2.0, 1.7, -0.3), PLASTER, turn_rad=0.3),
]
STATION = station_pose((0.2, -0.3, 0.1), 0.4, 0.05, -0.02)
SCANNER = VirtualScanner(rows=20, columns=48, mixed_pixels=False)

unit = st.floats(-1.0, 1.0)


@settings(max_examples=25)
@given(st.tuples(unit, unit, unit), st.tuples(unit, unit, unit), st.sampled_from([10.0, 500_000.0]))
def test_moving_scene_and_station_together_changes_no_measurement(
    turn: tuple[float, float, float], shift: tuple[float, float, float], reach_m: float
) -> None:
    motion = RigidTransform.from_components(reach_m * np.array(shift), Rotation.from_rotvec(3.0 * np.array(turn)))
    here = scan_scene(scene_from_parts("room", PARTS, []), STATION, SCANNER, np.random.default_rng(3))
    there = scan_scene(
        scene_from_parts("room", moved(PARTS, motion), []), motion * STATION, SCANNER, np.random.default_rng(3)
    )
    assert len(here) == len(there)
    differences = np.linalg.norm(here.points - there.points, axis=1)
    # Double precision at 500 km is 1e-10 m, amplified by slanting incidence; a beam on an edge may pick the other face.
    assert np.quantile(differences, 0.99) < 1e-7


@st.composite
def rows_of_openings(draw: st.DrawFn) -> list[tuple[float, float, float, float]]:
    """Openings in up to three storeys, none overlapping."""
    holes = []
    for storey in range(draw(st.integers(0, 3))):
        cuts = sorted(draw(st.lists(st.floats(0.1, 9.9), min_size=2, max_size=6, unique=True)))
        low = 1.0 + 2.0 * storey + draw(st.floats(0.0, 0.5))
        high = low + draw(st.floats(0.2, 1.4))
        holes += [(a, b, low, high) for a, b in zip(cuts[::2], cuts[1::2], strict=False)]
    return holes


@given(rows_of_openings(), st.floats(0.1, 9.9), st.floats(0.0, 5.0))
def test_the_cells_of_a_gable_wall_cover_it_without_its_openings(
    holes: list[tuple[float, float, float, float]], ridge: float, rise: float
) -> None:
    top = np.array([[0.0, 7.5], [ridge, 7.5 + rise], [10.0, 7.5]])
    area = sum(_area(cell) for cell in sheet_cells(top, 0.5, holes))
    expected = 70.0 + 5.0 * rise - sum((b - a) * (d - c) for a, b, c, d in holes)
    # Rounding of a few dozen products.
    np.testing.assert_allclose(area, expected, atol=1e-9)


def _area(ring: np.ndarray) -> float:
    x, y = ring.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


@settings(max_examples=10)
@given(st.integers(0, 2**31), st.floats(1e-4, 5e-3))
def test_noise_never_moves_a_point_off_its_nominal_ray(seed: int, std_m: float) -> None:
    scanner = replace(SCANNER, range_noise_std_m=std_m)
    quiet = replace(SCANNER, range_noise_std_m=0.0)
    scene = scene_from_parts("room", PARTS, [])
    noisy, true = (scan_scene(scene, STATION, s, np.random.default_rng(seed)) for s in (scanner, quiet))
    cross = np.cross(noisy.points, true.points)
    assert np.abs(cross).max() < 1e-12 * 100.0
