"""Set-ups drawn at random in buildings of all kinds; each scan is moved by a random motion before it is looked at."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Points
from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.scan_features import ScanFeatures
from algorithms.progress import NoProgress
from algorithms.scans.scan import Scan
from algorithms.simulation.materials import WOOD
from algorithms.simulation.parts import Part, box
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scene import Scene, scene_from_parts
from algorithms.simulation.scenes import SCENES
from algorithms.simulation.stations import station_pose
from tests.scenes.buildings.floor_plans import FLOOR_PLANS
from tests.scenes.buildings.random_setups import places_about_stations
from tests.scenes.buildings.regular_buildings import BUILDINGS, Place
from tests.scenes.buildings.repetitive_buildings import REPETITIVE_BUILDINGS
from tests.scenes.buildings.turned_buildings import TURNED_BUILDINGS

ALL_BUILDINGS = BUILDINGS | REPETITIVE_BUILDINGS | TURNED_BUILDINGS | FLOOR_PLANS
WHOLE_SCENES = ("office", "house", "pipe_hall", "street_square")
"""Scenes of the simulator, which stand as they are: only the set-ups are drawn."""
SCANNER = VirtualScanner(rows=400, columns=960)


@dataclass(frozen=True, eq=False)
class DrawnStation:
    """A scan as registration sees it."""

    features: ScanFeatures
    world_from_reduced: RigidTransform
    """True pose of the reduced frame."""


def building_of(kind: str, rng: np.random.Generator) -> tuple[Scene, list[Part], Callable[[], Place]]:
    """Give a scene, its parts (none of a scene of the simulator), and a function that draws a place in it."""
    if kind in WHOLE_SCENES:
        scene = SCENES[kind]()
        return scene, [], places_about_stations(scene, rng)
    parts, place = ALL_BUILDINGS[kind](rng)
    return scene_from_parts(kind, parts, []), parts, place


def station_at(place: Place, rng: np.random.Generator) -> RigidTransform:
    """Set an instrument up by hand at a place: a height, any heading, half a degree of tilt."""
    x, y, *floor = place
    height = sum(floor) + rng.uniform(1.4, 1.9)
    return station_pose((x, y, height), rng.uniform(0, 2 * np.pi), *rng.normal(0, 0.01, 2))


def drawn_stations(
    kind: str,
    rng: np.random.Generator,
    *,
    scanner: VirtualScanner = SCANNER,
    count: int = 3,
    distorted: Callable[[Points], Points] | None = None,
) -> list[DrawnStation]:
    """Scan a building of a kind from some places; of the first scan the points are distorted about its instrument."""
    scene, _, place = building_of(kind, rng)
    stations = [station_at(place(), rng) for _ in range(count)]
    scans = list(simulate_stations(scene, stations, scanner, rng))
    if distorted is not None:
        scans[0] = replace(scans[0], points=distorted(scans[0].points))
    return looked_at(stations, scans, rng)


def stations_among_things(
    kind: str, rng: np.random.Generator, *, scanner: VirtualScanner = SCANNER, things: int, count: int = 3
) -> list[DrawnStation]:
    """Scan a building from some places; about them stand things, each scan others: furniture, people, cars."""
    _, parts, place = building_of(kind, rng)
    stations = [station_at(place(), rng) for _ in range(count)]
    scans = []
    for station in stations:
        about = [_thing(stations[k % count].translation, rng) for k in range(things)]
        scene = scene_from_parts(kind, [*parts, *about], [])
        scans += list(simulate_stations(scene, [station], scanner, rng))
    return looked_at(stations, scans, rng)


def looked_at(
    stations: Sequence[RigidTransform], scans: Iterator[Scan] | Sequence[Scan], rng: np.random.Generator
) -> list[DrawnStation]:
    """Move each scan by a random motion and extract its features."""
    looked = []
    for station, scan in zip(stations, scans, strict=True):
        motion = RigidTransform.from_components(rng.uniform(-30.0, 30.0, 3), Rotation.random(random_state=rng))
        sensor = motion.apply(np.zeros(3) if scan.sensor_m is None else scan.sensor_m)
        moved = replace(scan, points=np.ascontiguousarray(motion.apply(scan.points)), sensor_m=sensor, grid=None)
        features = extract_features(moved, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))
        reduced = RigidTransform.from_translation(features.origin_m)
        looked.append(DrawnStation(features, station * motion.inv() * reduced))
    return looked


def _thing(eye: np.ndarray, rng: np.random.Generator) -> Part:
    """Put a box of the size of a chair to that of a car on the floor, 1.5 to 8 m from an instrument."""
    size = rng.uniform((0.3, 0.3, 0.4), (2.5, 1.2, 2.0))
    away, side = rng.uniform(1.5, 8.0), rng.uniform(0.0, 2 * np.pi)
    x, y, z = eye[0] + away * np.cos(side), eye[1] + away * np.sin(side), eye[2] - 1.6
    low, high = (x, y, z), (x + size[0], y + size[1], z + size[2])
    return box(low, high, WOOD, turn_rad=float(rng.uniform(0, np.pi)))
