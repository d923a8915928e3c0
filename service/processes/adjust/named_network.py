"""A network with the names that a request gave its parts."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from algorithms.adjustment.hybrid.network import Network
from algorithms.adjustment.hybrid.state import CAMERA_PARAMETERS, SCANNER_PARAMETERS, Kind, State
from algorithms.arrays import Array, Flags, Indices, Vector3
from algorithms.geometry.angles import GON_PER_RAD

COORDINATES = ("X", "Y", "Z")
ANGULAR = {"horizontal", "zenith", "omega", "phi", "kappa", "alpha", "zeta", "collimation", "trunnion", "zenith_index"}
PLACES = {
    Kind.POINT: ("X", "Y", "Z"),
    Kind.PLANE: ("tilt 1", "tilt 2", "distance"),
    Kind.LINE: ("tilt 1", "tilt 2", "shift 1", "shift 2"),
    Kind.POSE: ("rotation x", "rotation y", "rotation z", "X", "Y", "Z"),
    Kind.MOUNT: ("rotation x", "rotation y", "rotation z", "X", "Y", "Z"),
    Kind.CAMERA: CAMERA_PARAMETERS,
    Kind.SCANNER: SCANNER_PARAMETERS,
}


@dataclass(eq=False)
class RowLabels:
    """What each row of the network is called."""

    types: list[str] = field(default_factory=list)
    stations: list[str | None] = field(default_factory=list)
    scans: list[str | None] = field(default_factory=list)
    points: list[str | None] = field(default_factory=list)
    components: list[str] = field(default_factory=list)

    def add(self, kind: str, station: str | None, scan: str | None, point: str | None, component: str) -> None:
        """Name one more row."""
        self.types.append(kind)
        self.stations.append(station)
        self.scans.append(scan)
        self.points.append(point)
        self.components.append(component)

    def __len__(self) -> int:
        return len(self.types)


@dataclass(frozen=True, eq=False)
class NamedNetwork:
    """A network, start values as far as they are known, and names."""

    network: Network
    start: State
    points_known: Flags
    """(n,) whether start values are given."""
    poses_known: Flags
    """(p,)."""
    mounts_known: Flags
    """(k,) the first, that of free photos, is."""
    points: Sequence[str]
    stations: Sequence[str]
    photos: Flags
    """(p,) whether a station is a photo."""
    carried: Mapping[str, tuple[str, str]]
    """For photos on scanners: carrier and mount."""
    names: Mapping[Kind, Sequence[str]]
    """Names of all blocks of unknowns."""
    rows: RowLabels
    groups: Indices
    """(blocks,) group of each."""
    group_names: Sequence[str]
    origin_m: Vector3
    """World coordinates of the origin to which all coordinates of the network are relative."""
    fictitious: Flags
    """(blocks,) observations that were not measured: planes, lines, datum and expected values."""
    levelled: Flags
    """(p,) stations whose tilts are zero."""
    checks: Mapping[str, Array]
    """Known coordinates of check points, (3,) in the world."""

    def objects(self) -> Iterator[tuple[str, str, Indices]]:
        """Give kind, name and rows of every point, scan and photo."""
        rows = np.arange(len(self.rows), dtype=np.int64)
        measured = ~self.fictitious[self.network.block_of_row]
        kinds: list[tuple[str, list[str | None]]] = [
            ("point", self.rows.points),
            ("scan", [self._scan(k) for k in range(len(self.rows))]),
            ("photo", [self._photo(k) for k in range(len(self.rows))]),
        ]
        for kind, labels in kinds:
            named = np.array([label is not None for label in labels]) & measured
            if not named.any():
                continue
            texts = np.array([label or "" for label in labels])
            kept = rows[named]
            names, of = np.unique(texts[named], return_inverse=True)
            order = np.argsort(of, kind="stable")
            for name, part in zip(names, np.split(kept[order], np.cumsum(np.bincount(of))[:-1]), strict=True):
                yield kind, str(name), part

    def _scan(self, k: int) -> str | None:
        station, scan = self.rows.stations[k], self.rows.scans[k]
        if station is None or self.rows.types[k] not in {"polar", "coordinates"}:
            return None
        return station if scan is None else f"{station}/{scan}"

    def _photo(self, k: int) -> str | None:
        return self.rows.stations[k] if self.rows.types[k] == "image" else None

    def unknown_name(self, column: int) -> str:
        """Name an unknown."""
        kinds, blocks, places = self.network.layout.owners()
        kind = Kind(int(kinds[column]))
        return f"{self.names[kind][int(blocks[column])]}.{PLACES[kind][int(places[column])]}"


def unit_of(component: str) -> tuple[float, str]:
    """Give factor and unit in which a component is reported."""
    if component in ANGULAR:
        return GON_PER_RAD, "gon"
    return 1.0, "m"


def find_unknown(name: str, parameter: str, numbers: Mapping[Kind, Mapping[str, int]]) -> tuple[Kind, int]:
    """Find what an observed unknown is.

    Raises
    ------
    KeyError
        There is none of that name with such a parameter.
    """
    for kind, parameters in (
        (Kind.POSE, (*COORDINATES, "omega", "phi", "kappa", "alpha", "zeta")),
        (Kind.POINT, COORDINATES),
        (Kind.MOUNT, (*COORDINATES, "omega", "phi", "kappa", "alpha", "zeta")),
        (Kind.CAMERA, CAMERA_PARAMETERS),
        (Kind.SCANNER, SCANNER_PARAMETERS),
    ):
        if name and name in numbers[kind] and parameter in parameters:
            return kind, numbers[kind][name]
    raise KeyError(name)
