"""JAG3D's text files as a network: one file of each type, lines of names and numbers."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

ANGLES = frozenset({"directions", "zenith-angles"})
CIRCLE = 400.0
"""[gon]."""
HALF = 200.0
"""[gon]."""
NEARLY = 1.0
"""Directions in both faces differ from half a circle by twice the collimation error at most [gon]."""
POINTS = frozenset({"reference-points", "stochastic-points", "datum-points", "new-points"})


def network_of_jag3d(files: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Read files as JAG3D imports them: angles in gon, lengths in metres, `#` begins a comment.

    Points are ``name y x z [std ...]`` with y east and x north; observations ``from to value [std]`` or ``from to
    instrument-height target-height value [std]``, standard deviations in the unit of the value. Directions of one file
    and station are one round; they are clockwise there and anticlockwise here. What total stations measure in their
    second face is reduced to the first: zenith angles beyond 200 gon, and directions to a point that differ by 200 gon.

    Parameters
    ----------
    files
        Each with its `type`, its `text`, and the `std` of lines that have none.

    Raises
    ------
    ValueError
        A line of another form, an observation without a standard deviation, or heights where a horizontal distance or
        a height difference between marks is read; each by type and line.
    """
    reading = _Reading()
    # stations take their approximate places from the points
    for number, file in sorted(enumerate(files), key=lambda each: each[1]["type"] not in POINTS):
        for row, line in enumerate(str(file["text"]).splitlines(), 1):
            words = line.partition("#")[0].split()
            if words:
                reading.take(f"{file['type']}, line {row}", str(file["type"]), words, file.get("std"), number)
    return {
        "format": "hybrid-network/1", "stations": list(reading.stations.values()), "points_approx": reading.points,
        "observations": reading.observed,
    }  # fmt: skip


class _Reading:
    def __init__(self) -> None:
        self.points: dict[str, list[float]] = {}
        self.stations: dict[str, dict[str, Any]] = {}
        self._first: dict[tuple[int, str, str], float] = {}
        self.observed: dict[str, list[Any]] = {kind: [] for kind in ("polar", "control", "distances", "heights")}

    def take(self, where: str, kind: str, words: Sequence[str], std: float | None, file: int) -> None:
        """Take one line of a file of a type."""
        names = words[:1] if kind in POINTS else words[:2]
        numbers = _numbers(where, words[len(names) :])
        if kind in POINTS:
            self._point(where, kind, names[0], numbers, std)
            return
        if len(numbers) not in (1, 2, 3, 4):
            raise ValueError(f"jag3d: {where}: `from to value [std]`, with two heights before the value or without")
        heights = numbers[:2] if len(numbers) > 2 else [0.0, 0.0]
        value, *given = numbers[2:] if len(numbers) > 2 else numbers
        sigma = given[0] if given else std
        if sigma is None or not 0.0 < sigma < 1.0:
            told = "has no standard deviation" if sigma is None else f"has {sigma:g} for a standard deviation"
            raise ValueError(f"jag3d: {where} {told}; state it in the line, in {_unit(kind)}, or as `std` of the file")
        readers: Mapping[str, Callable[[], None]] = {
            "directions": lambda: self._direction(names, -value, sigma, file),
            "zenith-angles": lambda: self._sight(names, heights, "zenith", _of_first_face(value), sigma),
            "slope-distances": lambda: self._sight(names, heights, "distance", value, sigma),
            "horizontal-distances": lambda: self._between_marks("distances", names, value, sigma),
            "height-differences": lambda: self._between_marks("heights", names, value, sigma),
        }
        if any(heights) and kind in ("horizontal-distances", "height-differences"):
            raise ValueError(f"jag3d: {where}: {kind} between points above their marks are not read")
        readers[kind]()

    def _point(self, where: str, kind: str, name: str, numbers: Sequence[float], std: float | None) -> None:
        if not 3 <= len(numbers) <= 6:
            raise ValueError(f"jag3d: {where}: a point is `name y x z`, with its standard deviations or without")
        east, north, height = numbers[:3]
        xyz = [east, north, height]
        self.points[name] = xyz
        if kind == "reference-points":
            self.observed["control"].append({"point": name, "xyz": xyz, "held": True})
        elif kind == "stochastic-points":
            stds = list(numbers[3:]) or ([] if std is None else [std])
            if not stds:
                raise ValueError(f"jag3d: {where}: a stochastic point has standard deviations, or its file has `std`")
            # one is that of all three; two are those of the plan and of the height
            y, x, z = (stds[0], stds[0], stds[-1]) if len(stds) < 3 else stds
            covariance = [[y**2, 0.0, 0.0], [0.0, x**2, 0.0], [0.0, 0.0, z**2]]
            self.observed["control"].append({"point": name, "xyz": xyz, "covariance": covariance})

    def _station(self, name: str, at: str, height_m: float, *, oriented: bool) -> str:
        station: dict[str, Any] = {
            "id": name, "type": "scanner", "point": at, "levelled": True, "held": oriented, "height_m": height_m,
        }  # fmt: skip
        if oriented:
            x, y, z = self.points.get(at, [0.0, 0.0, 0.0])
            station["approx"] = {"X": x, "Y": y, "Z": z, "omega": 0.0, "phi": 0.0, "kappa": 0.0}
        self.stations.setdefault(name, station)
        return name

    def _direction(self, names: Sequence[str], value: float, sigma: float, file: int) -> None:
        at = self._station(f"round {file} {names[0]}", names[0], 0.0, oriented=False)
        first = self._first.setdefault((file, names[0], names[1]), value)
        if abs((value - first) % CIRCLE - HALF) < NEARLY:
            value = (value - HALF) % CIRCLE
        self.observed["polar"].append(
            {"station": at, "point": names[1], "horizontal": value, "sigma_horizontal": sigma}
        )

    def _sight(self, names: Sequence[str], heights: Sequence[float], part: str, value: float, sigma: float) -> None:
        if part == "distance" and not any(heights):
            self._between_marks("distances", names, value, sigma, spatial=True)
            return
        at = self._station(f"zenith {names[0]} {heights[0]}", names[0], heights[0], oriented=True)
        entry = {"station": at, "point": names[1], part: value, f"sigma_{part}": sigma, "height_m": heights[1]}
        self.observed["polar"].append(entry)

    def _between_marks(
        self, kind: str, names: Sequence[str], value: float, sigma: float, *, spatial: bool = False
    ) -> None:
        entry: dict[str, Any] = {"from": names[0], "to": names[1], "std": sigma}
        entry |= {"dh": value} if kind == "heights" else {"distance": value}
        if kind == "distances" and not spatial:
            entry["horizontal"] = True
        self.observed[kind].append(entry)


def _of_first_face(zenith: float) -> float:
    """Return a zenith angle as the first face has it [gon]."""
    return CIRCLE - zenith if HALF < zenith < CIRCLE else zenith


def _unit(kind: str) -> str:
    return "gon" if kind in ANGLES else "metres"


def _numbers(where: str, words: Sequence[str]) -> list[float]:
    try:
        return [float(word) for word in words]
    except ValueError:
        raise ValueError(f"jag3d: {where}: {' '.join(words)!r} are no numbers") from None
