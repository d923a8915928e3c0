"""Pairs of scans with known truth, of every kind that a verdict is asked about, drawn from a number."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.features.scan_features import ScanFeatures
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.symmetric_scenes import SYMMETRIC_SCENES
from tests.scenes.buildings.distorted_scans import DISTORTIONS
from tests.scenes.buildings.drawn_stations import (
    ALL_BUILDINGS,
    WHOLE_SCENES,
    DrawnStation,
    drawn_stations,
    looked_at,
    stations_among_things,
)

SEED = 390
"""Of all draws; benchmarks use other ones."""


@dataclass(frozen=True, eq=False)
class DrawnPair:
    """Two scans of one place, or of two."""

    family: str
    """Why it was drawn, see `FAMILIES`."""
    building: str
    """Kind of building; of two kinds, both with a slash between."""
    target: ScanFeatures
    source: ScanFeatures
    truth: RigidTransform | None
    """Target from source between the reduced frames; None: two places."""


def _pairs(family: str, building: str, stations: list[DrawnStation]) -> Iterator[DrawnPair]:
    for target, source in combinations(stations, 2):
        truth = target.world_from_reduced.inv() * source.world_from_reduced
        yield DrawnPair(family, building, target.features, source.features, truth)


def _regular(number: int, rng: np.random.Generator) -> Iterator[DrawnPair]:
    kinds = [*ALL_BUILDINGS, *WHOLE_SCENES]
    kind = kinds[number % len(kinds)]
    yield from _pairs("regular", kind, drawn_stations(kind, rng))


def _things(number: int, rng: np.random.Generator) -> Iterator[DrawnPair]:
    kinds = list(ALL_BUILDINGS)
    kind = kinds[number % len(kinds)]
    yield from _pairs("things", kind, stations_among_things(kind, rng, things=int(rng.integers(3, 25))))


def _noisy(number: int, rng: np.random.Generator) -> Iterator[DrawnPair]:
    kinds = [*WHOLE_SCENES, *ALL_BUILDINGS]
    kind = kinds[number % len(kinds)]
    scanner = VirtualScanner(rows=400, columns=960, range_noise_std_m=float(rng.uniform(0.005, 0.02)))
    yield from _pairs("noisy", kind, drawn_stations(kind, rng, scanner=scanner))


def _coarse(number: int, rng: np.random.Generator) -> Iterator[DrawnPair]:
    kinds = [*WHOLE_SCENES, *ALL_BUILDINGS]
    kind = kinds[number % len(kinds)]
    rows = int(rng.integers(180, 300))
    yield from _pairs(
        "coarse", kind, drawn_stations(kind, rng, scanner=VirtualScanner(rows=rows, columns=rows * 12 // 5))
    )


def _different(number: int, rng: np.random.Generator) -> Iterator[DrawnPair]:
    kinds = list(ALL_BUILDINGS)
    here = kinds[number % len(kinds)]
    there = here if number % 4 else kinds[int(rng.integers(len(kinds)))]
    stations = [drawn_stations(kind, rng, count=2) for kind in (here, there)]
    building = here if here == there else f"{here}/{there}"
    for target, source in product(*stations):
        yield DrawnPair("different", building, target.features, source.features, None)


def _symmetric(number: int, rng: np.random.Generator) -> Iterator[DrawnPair]:
    names = list(SYMMETRIC_SCENES)
    name = names[number % len(names)]
    scene = SYMMETRIC_SCENES[name](rng, (0, 1, 2, 4)[number // len(names) % 4])
    scans = simulate_stations(scene, scene.stations, VirtualScanner(rows=300, columns=720), rng)
    yield from _pairs("symmetric", name, looked_at(scene.stations, scans, rng))


def _distorted(number: int, rng: np.random.Generator) -> Iterator[DrawnPair]:
    """Scale, stretch, bend or round the first scan: its place is right still, its pose as good as that allows."""
    kinds = [*WHOLE_SCENES, *ALL_BUILDINGS]
    kind = kinds[number % len(kinds)]
    ways = ["rounded", *DISTORTIONS]
    way = ways[number // len(kinds) % len(ways)]
    factor = 1.0 + float(rng.choice([-1.0, 1.0]) * rng.uniform(0.001, 0.02))
    step_m = float(rng.uniform(0.002, 0.03))

    def distorted(points: np.ndarray) -> np.ndarray:
        return step_m * np.round(points / step_m) if way == "rounded" else DISTORTIONS[way](points, factor)

    yield from _pairs("distorted", kind, drawn_stations(kind, rng, distorted=distorted))


FAMILIES: dict[str, Callable[[int, np.random.Generator], Iterator[DrawnPair]]] = {
    "regular": _regular,
    "things": _things,
    "noisy": _noisy,
    "coarse": _coarse,
    "different": _different,
    "symmetric": _symmetric,
    "distorted": _distorted,
}


def drawn_pairs(family: str, number: int) -> Iterator[DrawnPair]:
    """Draw the pairs of a family with a number, always the same."""
    yield from FAMILIES[family](number, np.random.default_rng([SEED, list(FAMILIES).index(family), number]))
