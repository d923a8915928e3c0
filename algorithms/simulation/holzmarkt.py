"""A square and the street that leaves it, as in the comparison of registration methods by Dold, Ripperda and Brenner.

Their scans of "Am Holzmarkt" in Hannover (2007) are not public. The drawn place has what they say of it: twenty set-ups
about 5 m apart, twelve upright and eight tilted beside some of these ("a"), a scanner Riegl LMS-Z360i, and overlaps
with the first set-up that fall from four fifths to a fiftieth. Between the set-ups people walk and cars drive.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.simulation.curved_parts import bush, tube
from algorithms.simulation.materials import CONCRETE, FOLIAGE, STEEL, TEXTILE, WOOD
from algorithms.simulation.parts import Part, box
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scene import Scene, scene_from_parts
from algorithms.simulation.street_square import ground, lamp, parked_car, row_of_houses, set_up_by_hand

UPRIGHT = tuple(str(k) for k in range(1, 13))
TILTED = ("3a", "5a", "6a", "8a", "9a", "10a", "11a", "12a")
SET_UPS = tuple(sorted((*UPRIGHT, *TILTED), key=lambda name: (int(name.rstrip("a")), name)))
"""Names of all set-ups, in the paper's order."""
PRINTED_OVERLAPS: Mapping[str, float] = MappingProxyType(
    {
        "2": 0.831, "3": 0.777, "3a": 0.733, "4": 0.688, "5": 0.630, "5a": 0.597, "6": 0.505, "6a": 0.545, "7": 0.507,
        "8": 0.436, "8a": 0.457, "9": 0.273, "9a": 0.288, "10": 0.162, "10a": 0.114, "11": 0.099, "11a": 0.122,
        "12": 0.036, "12a": 0.023,
    }
)  # fmt: skip
"""Overlaps with set-up 1 in the paper's table 1."""
WALK_M: tuple[tuple[float, float], ...] = (
    (-21.0, 1.5), (-16.1, 0.6), (-11.2, 1.6), (-6.3, 0.7), (-1.4, 1.5), (3.5, 0.6),
    (8.4, 1.2), (13.3, 0.3), (18.2, 0.9), (22.9, 2.4), (26.6, 5.7), (28.6, 10.3),
)  # fmt: skip
"""Where the upright set-ups stand: across the square, then round the bend of the street."""
BESIDE_M = (0.9, -0.8)
"""Where the tilted ones stand, from the upright ones."""
HEIGHTS_M = (14.0, 19.0)
"""Eaves of the houses."""
STALLS_M = (
    (-25.5, 6.0), (-18.0, 5.6), (-13.0, 6.2), (-4.0, 5.4), (1.0, 5.8), (6.5, 5.6),
    (-23.0, -3.6), (-15.0, -4.0), (-9.5, -5.0), (-4.0, -4.2), (2.0, -4.6), (9.0, -3.0),
)  # fmt: skip
"""Where the stalls of the market stand, on both sides of the way."""
BENT_RAD = 0.09
"""Largest turn of a row of fronts from the drawn direction: no two of an old town are parallel."""
LMS_Z360I = VirtualScanner(
    rows=750,
    columns=3000,
    lowest_rad=float(np.deg2rad(-50.0)),
    highest_rad=float(np.deg2rad(40.0)),
    max_range_m=200.0,
    min_range_m=1.0,
    range_noise_std_m=0.012,
    angle_noise_std_rad=20e-6,
    beam_divergence_rad=2e-3,
    beam_exit_diameter_m=0.01,
    reach_reflectance=0.8,
)
"""The data sheet that the sources print: 90 by 360 degrees in steps of 0.12, 12 mm for a single shot, 200 m at four
fifths of reflectance."""


@dataclass(frozen=True, eq=False)
class SetUp:
    """One set-up and what stood about while it was scanned."""

    name: str
    """As in the paper's tables; an "a" at the end says that it is tilted."""
    scene: Scene
    """The place with its people and cars of the moment; its one station is the set-up."""

    @property
    def world_from_scan(self) -> RigidTransform:
        """The true pose."""
        return self.scene.stations[0]

    @property
    def tilted(self) -> bool:
        """Whether the scanner leans."""
        return self.name.endswith("a")


def holzmarkt_scene() -> Scene:
    """Build the place with its twenty set-ups and nobody about."""
    rng = np.random.default_rng(2007)
    parts = _place(rng)
    return scene_from_parts("holzmarkt", parts, tuple(_set_up_pose(name, rng) for name in SET_UPS))


def holzmarkt(rng: np.random.Generator) -> Iterator[SetUp]:
    """Build the set-ups one after the other, each with its own people and cars.

    Parameters
    ----------
    rng
        Draws the houses, the headings and tilts, and who passes; another generator gives another place of this kind.
    """
    parts = _place(rng)
    for name in SET_UPS:
        pose = _set_up_pose(name, rng)
        place = np.asarray(pose.translation)[:2]
        moving = [*_people(place, rng), *_traffic(place, rng)]
        yield SetUp(name, scene_from_parts(f"holzmarkt-{name}", [*parts, *moving], (pose,)))


def _place(rng: np.random.Generator) -> list[Part]:
    """Build the houses round the square and along the bent street, and what stands there always."""
    rows = (
        ((-36.0, 20.0), (12.0, 17.5)),
        ((12.0, 17.5), (13.0, 5.2)),
        ((13.0, 5.2), (21.0, 6.4)),
        ((21.0, 6.4), (24.0, 11.0)),
        ((24.0, 11.0), (29.0, 38.0)),
        ((40.0, 36.0), (34.0, 7.0)),
        ((34.0, 7.0), (25.5, -3.4)),
        ((25.5, -3.4), (12.5, -4.6)),
        ((12.5, -4.6), (11.5, -19.0)),
        ((11.5, -19.0), (-33.0, -16.0)),
        ((-33.0, -16.0), (-36.0, 20.0)),
    )
    parts = [part for start, end in rows for part in row_of_houses(start, _bent(start, end, rng), rng, HEIGHTS_M)]
    parts += ground(-60.0, 80.0)
    for x, y in ((-27.0, 11.0), (-14.0, -10.0), (2.0, 11.5), (7.0, -9.0), (19.0, 5.2), (23.5, -1.8), (32.5, 12.5)):
        parts += lamp(x + float(rng.uniform(-0.5, 0.5)), y + float(rng.uniform(-0.5, 0.5)))
    x, y = -9.0 + float(rng.uniform(-1.0, 1.0)), 8.5 + float(rng.uniform(-1.0, 1.0))
    parts += [
        tube((x, y, 0.0), (x, y, 0.8), 1.9, CONCRETE),
        tube((x, y, 0.8), (x, y, 3.4), 0.25, CONCRETE),
        box((4.0, -14.5, 0.0), (7.0, -12.0, 2.8), STEEL, turn_rad=float(rng.uniform(-0.4, 0.4))),
    ]
    for x, y in STALLS_M:
        parts += _stall(x + float(rng.uniform(-0.6, 0.6)), y + float(rng.uniform(-0.6, 0.6)), rng)
    for x, y in ((-25.0, -8.5), (-18.5, -11.5), (0.5, -10.0), (-21.0, 13.0), (-4.0, 14.5), (6.0, 13.0)):
        parts += [
            tube((x, y, 0.0), (x + 0.1, y, 3.4), 0.18, WOOD),
            bush((x, y, 4.8), (2.0, 1.9, 1.8), FOLIAGE, rng),
        ]
    for x, y, heading in ((-30.0, -4.0, 1.5), (-24.0, 15.5, 0.0), (17.0, -3.2, 0.08), (29.3, 3.0, 0.9)):
        parts += parked_car(x, y, rng, heading)
    return parts


def _stall(x: float, y: float, rng: np.random.Generator) -> list[Part]:
    """Put up a stall: a table with walls on three sides of a counter, and a roof."""
    turn = float(rng.uniform(-0.35, 0.35))
    width, depth = float(rng.uniform(1.1, 1.7)), float(rng.uniform(0.7, 1.1))
    return [
        box((x - width, y - depth, 0.0), (x + width, y + depth, 1.0), WOOD, turn_rad=turn),
        box((x - width, y - 0.05, 1.0), (x + width, y + 0.05, 2.3), WOOD, turn_rad=turn),
        box((x - width - 0.3, y - depth - 0.3, 2.3), (x + width + 0.3, y + depth + 0.3, 2.38), TEXTILE, turn_rad=turn),
    ]


def _bent(start: tuple[float, float], end: tuple[float, float], rng: np.random.Generator) -> tuple[float, float]:
    """Turn a row of fronts a little about its start."""
    angle = float(rng.uniform(-BENT_RAD, BENT_RAD))
    x, y = end[0] - start[0], end[1] - start[1]
    return start[0] + x * np.cos(angle) - y * np.sin(angle), start[1] + x * np.sin(angle) + y * np.cos(angle)


def _set_up_pose(name: str, rng: np.random.Generator) -> RigidTransform:
    x, y = WALK_M[int(name.rstrip("a")) - 1]
    heading = float(rng.uniform(0.0, 2.0 * np.pi))
    if not name.endswith("a"):
        return set_up_by_hand((x, y), heading, None, rng)
    tilt = float(rng.uniform(25.0, 60.0) * rng.choice((-1.0, 1.0)))
    return set_up_by_hand((x + BESIDE_M[0], y + BESIDE_M[1]), heading, (tilt, float(rng.uniform(-15.0, 15.0))), rng)


def _people(place: np.ndarray, rng: np.random.Generator) -> list[Part]:
    """Let some passers-by stand about, none nearer to the scanner than two metres."""
    people: list[Part] = []
    for _ in range(int(rng.integers(8, 16))):
        x, y = (place + rng.normal(0.0, 9.0, 2)).tolist()
        if np.hypot(x - place[0], y - place[1]) > 2.0:
            people.append(bush((x, y, 0.86), (0.25, 0.22, 0.86), TEXTILE, rng, corners=60))
    return people


def _traffic(place: np.ndarray, rng: np.random.Generator) -> list[Part]:
    """Let some cars be on their way through the square."""
    cars: list[Part] = []
    for _ in range(int(rng.integers(1, 4))):
        x, y = float(rng.uniform(-28.0, 6.0)), float(rng.choice((-4.5, 5.5))) + float(rng.normal(0.0, 0.3))
        if np.hypot(x - place[0], y - place[1]) > 3.5:
            cars += parked_car(x, y, rng)
    return cars
