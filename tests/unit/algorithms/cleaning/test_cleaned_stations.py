"""Steps are counted, what moved is found in the other station's free space, and nothing left is an error."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.cleaning.cleaned_stations import CleanedStations, PlacedScan, clean_stations, placed
from algorithms.cleaning.options import BestView, BoxCrop, CleaningOptions, MovedObjects
from algorithms.errors import InvalidInputError
from algorithms.progress import NoProgress
from algorithms.simulation import office
from algorithms.simulation.materials import WOOD
from algorithms.simulation.parts import box
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scene import scene_from_parts
from algorithms.simulation.stations import station_pose

SCANNER = VirtualScanner(rows=250, columns=600)
VISITOR = ((10.8, 1.8, 0.05), (11.2, 2.2, 1.8))
"""Stands in the room while the first station measures, and has left when the second does."""


@pytest.fixture(scope="module")
def stations() -> list[PlacedScan]:
    room = [*office._outer_walls(), *office._partitions(), *office._furniture()]
    poses = [station_pose((10.9, 4.4, 1.6), 0.8), station_pose((12.3, 3.2, 1.6), 3.5)]
    out = []
    for number, (pose, parts) in enumerate(zip(poses, ([*room, box(*VISITOR, WOOD)], room), strict=True)):
        scan = scan_scene(scene_from_parts("room", parts, []), pose, SCANNER, np.random.default_rng(number))
        out.append(placed(scan, pose, np.zeros(3)))
    return out


def clean(stations: list[PlacedScan], options: CleaningOptions) -> CleanedStations:
    return clean_stations(stations, np.zeros(3), options, NoProgress())


def of_visitor(points: np.ndarray) -> np.ndarray:
    low, high = np.array(VISITOR)
    return ((points > low + 0.02 * np.array([-1, -1, 1])) & (points < high + 0.02)).all(axis=1)


def test_who_has_left_is_taken_out_and_the_room_stays(stations: list[PlacedScan]) -> None:
    cleaned = clean(stations, CleaningOptions(comet_tails=False, moved_objects=MovedObjects()))
    before, after = stations[0].points(), cleaned.stations[0].points
    visitor = of_visitor(before)
    assert visitor.sum() > 300
    assert of_visitor(after).sum() < 0.1 * visitor.sum()
    lost = len(before) - len(after) - (visitor.sum() - of_visitor(after).sum())
    assert lost < 0.005 * len(before)
    assert len(cleaned.stations[1].points) > 0.995 * len(stations[1].scan)


def test_who_has_left_is_marked_where_nothing_is_to_be_taken_out(stations: list[PlacedScan]) -> None:
    cleaned = clean(stations, CleaningOptions(comet_tails=False, moved_objects=MovedObjects(remove=False)))
    assert len(cleaned.stations[0].numbers) == len(stations[0].scan)
    marked = cleaned.stations[0].moved
    assert marked[of_visitor(cleaned.stations[0].points)].mean() > 0.9
    assert sum(step.marked for step in cleaned.steps) == sum(int(each.moved.sum()) for each in cleaned.stations)


def test_the_best_view_raises_the_cosine_of_the_beams_and_leaves_no_hole(stations: list[PlacedScan]) -> None:
    cleaned = clean(stations, CleaningOptions(comet_tails=False, best_view=BestView(0.1)))
    kept = sum(len(each.numbers) for each in cleaned.stations)
    everything = np.concatenate([each.points() for each in stations])
    left = np.concatenate([each.points for each in cleaned.stations])
    assert kept < 0.95 * len(everything)
    cubes = [len(np.unique(np.floor(points / 0.2), axis=0)) for points in (everything, left)]
    assert cubes[1] > 0.97 * cubes[0]


def test_a_box_without_any_point_is_refused_with_the_number_of_points(stations: list[PlacedScan]) -> None:
    with pytest.raises(InvalidInputError, match="none of the"):
        clean(stations, CleaningOptions(box=BoxCrop((900.0, 0.0, 0.0), (901.0, 1.0, 1.0))))


def test_far_projects_are_cleaned_as_near_ones(stations: list[PlacedScan]) -> None:
    far = np.array([500_000.0, 5_600_000.0, 0.0])
    pose = RigidTransform.from_components(far + np.array([10.9, 4.4, 1.6]), stations[0].common_from_scan.rotation)
    moved = placed(stations[0].scan, pose, far)
    np.testing.assert_allclose(moved.points(), stations[0].points(), atol=1e-6)
