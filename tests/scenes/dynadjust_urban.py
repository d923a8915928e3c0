"""DynAdjust's urban network in the layout of `adjust`, and what DynAdjust made of it.

The world is topocentric in the middle of the network: x east, y north, z up. The vertical axis of each instrument is
held, inclined to the normal of the ellipsoid by the deflection of the vertical; its heading is free where the
measurement does not tell it. Differences of height are reduced to those of Z, and a length at sea level to that between
the points, with given places; so are coordinates that are held. Geoid heights are those of the result. The cluster of
four points known to 20 arc seconds is taken without the correlations (0.0006) between them.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.arrays import Array
from tests.scenes.ellipsoids import GRS80, east_north_up, pose

EXACT_M, EXACT_DEG = 1e-6, 1e-7
"""Standard deviations of what is held: coordinates (DynAdjust's own), and vertical axes."""
ORIGIN = "origin"
HEIGHTS = ("InstHeight", "TargHeight")
AXES = ("latitude", "longitude", "height")
EAST_NORTH_UP = (1, 0, 2)
"""Which coordinate of the world latitude, longitude and height are."""
ZENITH_SIGN = -1.0
"""DynAdjust 1.0.3 applied deflections to zenith distances the wrong way round (its issue 160), to others rightly."""
RADIUS_M = 6.37e6
"""Of the earth, to reduce a length of 54 m by 40 m of height."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """A measurement that takes part."""

    kind: str
    stations: tuple[str, ...]
    entry: ET.Element

    def number(self, key: str) -> float:
        """Give a number; 0 where there is none."""
        return float(self.entry.findtext(key) or 0.0)

    @property
    def angle(self) -> float:
        """Give a measured angle [degree]."""
        return _degrees(self.number("Value"))


@dataclass(frozen=True, eq=False)
class PublishedMeasurement:
    """A component of a measurement in DynAdjust's result."""

    kind: str
    stations: tuple[str, ...]
    component: str
    correction: float
    """Adjusted minus measured, arc seconds or metres."""
    statistic: float
    """Correction over its standard deviation."""


@dataclass(frozen=True, eq=False)
class PublishedStation:
    """A station in DynAdjust's result."""

    undulation_m: float
    xyz_m: Array
    """(3,) geocentric."""
    std_m: Array
    """(3,) east, north, up."""


@dataclass(frozen=True, eq=False)
class UrbanNetwork:
    """The network in its folder."""

    folder: Path

    @cached_property
    def measurements(self) -> list[Measurement]:
        """Give all that take part, in the order of the file."""
        return [
            Measurement(
                entry.findtext("Type") or "",
                tuple(name for key in ("First", "Second", "Third") if (name := entry.findtext(key))),
                entry,
            )
            for entry in self._root("msr").iter("DnaMeasurement")
            if not entry.findtext("Ignore")
        ]

    @cached_property
    def stations(self) -> dict[str, PublishedStation]:
        """Give the adjusted stations."""
        found = {}
        for line in self._result.split("Adjusted Coordinates")[1].splitlines()[5:]:
            if line.strip():
                words = [float(word) for word in line[20:].split()[3:11]]
                found[line[:20].strip()] = PublishedStation(
                    words[1] - words[0], np.array(words[2:5]), np.array(words[5:])
                )
        return found

    @cached_property
    def published(self) -> list[PublishedMeasurement]:
        """Give the components of all measurements of the result, in its order."""
        table = self._result.split("Adjusted Measurements")[1].split("Adjusted Coordinates")[0].splitlines()
        heading = next(line for line in table if line.startswith("M Station"))
        ends = {name: heading.index(name) + len(name) for name in ("Adjusted", "Correction", "Corr. SD", "N-stat")}
        return [
            PublishedMeasurement(
                line[0],
                tuple(name for k in (2, 22, 42) if (name := line[k : k + 20].strip())),
                line[62:68].strip(),
                float(line[ends["Adjusted"] : ends["Correction"]]),
                float(line[ends["Corr. SD"] : ends["N-stat"]]),
            )
            for line in table[table.index(heading) + 2 :]
            if line.strip()
        ]

    @cached_property
    def given_places(self) -> dict[str, Array]:
        """Give latitude, longitude [degree] and ellipsoidal height [m] before the adjustment."""
        from pyproj import Proj

        plane, found = Proj("+proj=utm +zone=55 +south +ellps=GRS80"), {}
        for name, words in self._station_rows:
            east, north, height = map(float, words[2:5])
            longitude, latitude = plane(east, north, inverse=True)
            found[name] = np.array([latitude, longitude, height + self.stations[name].undulation_m])
        return found

    @cached_property
    def constraints(self) -> dict[str, str]:
        """Give C(onstrained) or F(ree) for east, north and height of each station."""
        return {name: words[0] for name, words in self._station_rows}

    @cached_property
    def deflections(self) -> dict[str, Array]:
        """Give the deflections of the vertical, in the meridian and in the prime vertical [degree]."""
        rows = [line.split() for line in (self.folder / "urban-network.geo").read_text().splitlines()[1:]]
        return {row[0]: np.array(row[2:4], dtype=np.float64) / 3600.0 for row in rows}

    @cached_property
    def _result(self) -> str:
        return (self.folder / "urban.phased.adj.expected").read_text()

    @property
    def _station_rows(self) -> list[tuple[str, list[str]]]:
        """Give the given stations; the file as XML has their norths less by 0.1 mm."""
        lines = (self.folder / "urban-network.stn").read_text().splitlines()
        return [(line[:20].strip(), line[20:].split()) for line in lines if line[:1] not in "!*"]

    def _root(self, kind: str) -> ET.Element:
        return ET.parse(self.folder / f"urban-network{kind}.xml").getroot()  # noqa: S314 - this project's data folder


class UrbanTranslation:
    """The network in the layout of `adjust`, with reductions at given places."""

    def __init__(self, urban: UrbanNetwork, places: Mapping[str, Array]) -> None:
        self.urban, self.places = urban, places
        centre = np.mean(list(urban.given_places.values()), axis=0)
        self.centre, self.axes = GRS80.xyz(centre), east_north_up(*centre[:2])
        self.world = {name: self.to_world(GRS80.xyz(place)) for name, place in places.items()}
        self.approx = dict(self.world)
        self.stations: list[dict[str, Any]] = []
        self.observed: dict[str, list[dict[str, Any]]] = {
            kind: [] for kind in ("polar", "distances", "heights", "vectors", "tilts", "unknowns")
        }
        for number, each in enumerate(urban.measurements):
            self._translate(str(number), each)
        self._hold()

    def to_world(self, xyz: Array) -> Array:
        """Carry geocentric coordinates to the world."""
        return np.asarray((xyz - self.centre) @ self.axes)

    def from_world(self, xyz: Array) -> Array:
        """Carry coordinates of the world to geocentric ones."""
        return np.asarray(xyz @ self.axes.T + self.centre)

    @property
    def network(self) -> dict[str, Any]:
        """Give the request; the group of an observation is the number of its measurement."""
        control = [{"point": ORIGIN, "xyz": [0.0, 0.0, 0.0], "held": True}]
        return {
            "format": "hybrid-network/1",
            "units": {"angle": "deg"},
            "stations": self.stations,
            "points_approx": {name: xyz.tolist() for name, xyz in self.approx.items()},
            "observations": self.observed | {"control": control},
        }

    def _translate(self, number: str, each: Measurement) -> None:
        first, *others = each.stations
        between = {"from": first, "to": others[0] if others else "", "group": number, "sigma": each.number("StdDev")}
        value = each.number("Value")
        if each.kind == "G":
            part = each.entry.find("GPSBaseline")
            gap = _numbers(part, "X", "Y", "Z") @ self.axes
            self._vector(first, others[0], gap, self.axes.T @ _covariance(part) @ self.axes, number)
        elif each.kind == "Y":
            for point, part in zip(each.entry.iter("First"), each.entry.iter("Clusterpoint"), strict=True):
                self._coordinates(point.text or "", part, number)
        elif each.kind == "S":
            # DynAdjust has both heights along the normal of the first station
            end = self._above(others[0], round(each.number(HEIGHTS[1]) - each.number(HEIGHTS[0]), 6), first)
            self.observed["distances"].append(between | {"to": end, "distance": value})
        elif each.kind == "M":
            self.observed["distances"].append(between | {"distance": value + self._above_sea(first, others[0])})
        elif each.kind == "L":
            difference = value + self._undulation(others[0]) - self._undulation(first)
            bend = self._bend(others[0]) - self._bend(first)
            self.observed["heights"].append(between | {"difference": difference + bend})
        elif each.kind == "H":
            difference = value + self._undulation(first) + self._bend(first)
            self.observed["heights"].append(between | {"from": ORIGIN, "to": first, "difference": difference})
        else:
            self._angle(number, each)

    def _angle(self, number: str, each: Measurement) -> None:
        first, second, *third = each.stations
        std = each.number("StdDev") / 3600.0
        axes = self._plumb(first, {"B": 0.0, "V": ZENITH_SIGN}.get(each.kind, 1.0))
        station: dict[str, Any] = {"id": number, "point": first}
        sight: dict[str, Any] = {"station": number, "point": second, "group": number}
        if each.kind in "VZ":
            station["point"] = self._above(first, each.number(HEIGHTS[0]))
            sight["point"] = self._above(second, each.number(HEIGHTS[1]))
            zenith = each.angle if each.kind == "V" else 90.0 - each.angle
            self.observed["polar"].append(sight | {"zenith": zenith, "sigma_zenith": std})
        elif each.kind in "KB":
            self.observed["polar"].append(sight | {"horizontal": 90.0 - each.angle, "sigma_horizontal": std})
        else:
            omega, phi, _ = Rotation.from_matrix(axes).as_euler("XYZ", degrees=True)
            tilt = {"omega": omega, "phi": phi, "sigma_omega": EXACT_DEG, "sigma_phi": EXACT_DEG}
            self.observed["tilts"].append({"station": number} | tilt)
            arm = axes.T @ (self.world[second] - self.world[first])
            axes = axes @ Rotation.from_euler("Z", np.arctan2(arm[1], arm[0])).as_matrix()
            for point, horizontal in ((second, 0.0), (third[0], -each.angle)):
                direction = {"horizontal": horizontal, "sigma_horizontal": std / np.sqrt(2.0)}
                self.observed["polar"].append(sight | {"point": point} | direction)
        at = self.approx[station["point"]]
        self.stations.append(station | {"held": each.kind != "A", "approx": pose(axes, at)})

    def _coordinates(self, name: str, part: ET.Element | None, number: str) -> None:
        """Take latitude, longitude and height, far off and badly known, along the axes of the place."""
        latitude, longitude, height = _numbers(part, "X", "Y", "Z")
        measured = np.array([_degrees(latitude), _degrees(longitude), height + self._undulation(name)])
        rates = self.axes.T @ GRS80.rates(self.places[name])
        gap = self.world[name] + rates @ (measured - self.places[name])
        in_degrees = np.diag([np.degrees(1.0), np.degrees(1.0), 1.0])
        covariance = rates @ in_degrees @ _covariance(part) @ in_degrees @ rates.T
        self._vector(ORIGIN, name, gap, covariance, number)

    def _hold(self) -> None:
        """Hold longitude, latitude and height of stations, as east, north and up, where the others are."""
        for name, letters in self.urban.constraints.items():
            held = [
                AXES.index(axis)
                for axis, letter in zip(("longitude", "latitude", "height"), letters, strict=True)
                if letter == "C"
            ]
            place = self.places[name].copy()
            place[held] = self.urban.given_places[name][held]
            xyz = self.to_world(GRS80.xyz(place))
            for k in held:
                axis = EAST_NORTH_UP[k]
                expected = {"unknown": f"{name}.{'XYZ'[axis]}", "value": float(xyz[axis]), "sigma": EXACT_M}
                self.observed["unknowns"].append(expected)

    def _above(self, name: str, height: float, along: str | None = None) -> str:
        """Give the name of what stands above a station along the normal of the ellipsoid there, or at another one."""
        if not height:
            return name
        along = along or name
        above = f"{name} + {height} along {along}"
        if above not in self.approx:
            up = self.axes.T @ east_north_up(*self.places[along][:2])[:, 2] * height
            self.approx[above] = self.world[name] + up
            self._vector(name, above, up, EXACT_M**2 * np.eye(3))
        return above

    def _vector(self, start: str, end: str, gap: Array, covariance: Array, group: str = "heights") -> None:
        entry = {"from": start, "to": end, "xyz": gap.tolist(), "covariance": covariance.tolist(), "group": group}
        self.observed["vectors"].append(entry)

    def _plumb(self, name: str, sign: float = 1.0) -> Array:
        """Give the axes east, north and along the plumb line as columns in the world."""
        latitude, longitude = self.places[name][:2]
        north, east = sign * self.urban.deflections[name]
        return np.asarray(
            self.axes.T @ east_north_up(latitude + north, longitude + east / np.cos(np.radians(latitude)))
        )

    def _undulation(self, name: str) -> float:
        return self.urban.stations[name].undulation_m

    def _bend(self, name: str) -> float:
        """Give Z minus the height above the ellipsoid."""
        return float(self.world[name][2] - self.places[name][2])

    def _above_sea(self, first: str, second: str) -> float:
        """Give the distance between two points minus the arc at sea level below them."""
        low, high = (self.places[name][2] - self._undulation(name) for name in (first, second))
        slope = float(np.linalg.norm(self.world[second] - self.world[first]))
        return slope - np.sqrt((slope**2 - (high - low) ** 2) / (1.0 + low / RADIUS_M) / (1.0 + high / RADIUS_M))


def _degrees(packed: float) -> float:
    """Read ddd.mmssss."""
    text = f"{abs(packed):.10f}"
    whole, rest = text.split(".")
    size = int(whole) + int(rest[:2]) / 60.0 + float(f"{rest[2:4]}.{rest[4:]}") / 3600.0
    return -size if packed < 0.0 else size


def _numbers(part: ET.Element | None, *keys: str) -> Array:
    assert part is not None
    return np.array([float(part.findtext(key) or "nan") for key in keys])


def _covariance(part: ET.Element | None) -> Array:
    xx, xy, xz, yy, yz, zz = _numbers(part, *(f"Sigma{pair}" for pair in ("XX", "XY", "XZ", "YY", "YZ", "ZZ")))
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
