"""SNAP's regression networks as far as their observation types are ours, and what SNAP made of them.

SNAP is the adjustment of Land Information New Zealand; the folder's SOURCE.md describes files and codes. The world is
the geocentric frame of the ellipsoid.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from algorithms.arrays import Array
from tests.scenes.ellipsoids import INTERNATIONAL, degrees, east_north_up, pose

REFRACTION = 0.075
"""SNAP's default; it lessens zenith distances by this times the angle between the verticals of both ends."""
ORIGIN = "origin"
ANGLE = r"(\d+) (\d+) ([\d.]+)"


@dataclass(frozen=True, eq=False)
class SnapStation:
    """An adjusted station of a listing."""

    place: Array
    """(3,) latitude and longitude [degree], height [m]."""
    ellipse_m: tuple[float, float]
    """Semi-axes of the error ellipse."""
    height_std_m: float


@dataclass(frozen=True, eq=False)
class SnapListing:
    """A listing of SNAP."""

    text: str

    @staticmethod
    def of(folder: Path, name: str) -> "SnapListing":
        """Read a listing."""
        return SnapListing(_text(folder / "check" / name / f"{name}.lst"))

    def figure(self, label: str) -> float:
        """Give a figure of the summary of the solution."""
        return float(self.text.split(f"{label}:")[1].split()[0])

    def stations(self) -> dict[str, SnapStation]:
        """Give all stations that were adjusted."""
        pattern = re.compile(
            rf"^ (\w+) +{ANGLE} ([NS]) +\S+ +([\d.]+) .*\n +{ANGLE} ([EW]) +\S+ +([\d.]+) .*\n +(\S+) +\S+ +([\d.]+)$",
            re.MULTILINE,
        )
        found = {}
        for code, *latitude, major, d, m, s, sign, minor, height, std in pattern.findall(self.text):
            place = np.array([degrees(*latitude), degrees(d, m, s, sign), float(height)])
            found[code] = SnapStation(place, (float(major), float(minor)), float(std))
        return found

    def gnss_stds(self) -> dict[str, Array]:
        """Give standard deviations (3,) of the calculated X, Y, Z of GNSS points [m]."""
        found, lines = {}, self.text.splitlines()
        for k, line in enumerate(lines):
            if re.match(r"\w+ +GX", line):
                rows = [re.sub(r"^\w+ +GX\*?", "", row).split() for row in lines[k : k + 3]]
                found[line.split()[0]] = np.array([float(row[3]) for row in rows])
        return found

    def residuals(self) -> dict[tuple[str, str, str], tuple[float, float, float | None]]:
        """Give terrestrial residuals: observed minus calculated, its standard deviation, and their ratio."""
        value = r"(?:\d+ \d+ [\d.]+|[\d.]+) +[\d.]+"
        row = re.compile(rf"^(\w+) +(\w+) +(SD|AZ|ZD) +{value} +{value} +(\S+) +(\S+) +(\S+)", re.MULTILINE)
        return {
            (start, end, code): (float(miss), float(std), None if ratio == "-" else float(ratio))
            for start, end, code, miss, std, ratio in row.findall(self.text)
        }

    def gnss_sets(self) -> list[dict[str, Any]]:
        """Give the sets of GNSS points: line of the data file, stations, who is used, misclosures, covariance."""
        blocks = re.findall(r"BEGIN_JSON obs_equation_\d+\n(.*?)END_JSON", self.text, re.DOTALL)
        last = json.loads(blocks[-1])
        return [
            {
                "line": each["source"]["lineno"],
                "stations": [last["parameters"][row["columns"][0] - 1].split(":")[0] for row in each["obs"][::3]],
                "used": np.array([row["useobs"] for row in each["obs"][::3]]),
                "misses": np.array([row["value"] for row in each["obs"]]).reshape(-1, 3),
                "covariance": np.array(each["cvr"]),
            }
            for each in last["obs_equations"]
        ]


def gnss_network(folder: Path, name: str, places: str, data: str) -> dict[str, Any]:
    """Translate observed coordinates: vectors from a held origin, with the covariances of the listing.

    What the points of a set have in common is a shift of its own, zero with that covariance.

    Raises
    ------
    ValueError
        No common shift explains the covariances between the points of a set.
    """
    approx = _approximate(folder, places)
    lines = _text(folder / "in" / f"{data}.dat").splitlines()
    origin = np.round(next(iter(approx.values())))
    vectors = []
    for number, each in enumerate(SnapListing.of(folder, name).gnss_sets()):
        used, count = np.flatnonzero(each["used"]), len(each["stations"])
        values = _values(lines[each["line"] - 1 :], each["stations"])
        blocks = each["covariance"].reshape(count, 3, count, 3).swapaxes(1, 2)
        start, shared = ORIGIN, np.zeros((3, 3))
        if len(used) > 1:
            start, shared = f"shift {number}", blocks[used[0], used[1]]
            others = blocks[used[:, None], used][~np.eye(len(used), dtype=bool)]
            if not np.allclose(others, shared, rtol=0.0, atol=1e-8 * np.abs(shared).max()):
                raise ValueError(f"{name}: the points of set {number} have no common shift")
            vectors.append(_vector(ORIGIN, start, np.zeros(3), shared))
            approx[start] = origin
        vectors += [_vector(start, each["stations"][k], values[k] - origin, blocks[k, k] - shared) for k in used]
    return _network(approx, {ORIGIN: origin}, vectors=vectors)


def session_network(folder: Path, name: str) -> dict[str, Any]:
    """Translate sets of simultaneous baselines: every antenna has half of their covariance and its centring error.

    What the baselines of a set have in common is the antenna from which they start.
    """
    approx = _approximate(folder, name)
    command, data = _text(folder / "in" / f"{name}.snp"), _text(folder / "in" / f"{name}.dat")
    centring = {
        code: np.array([flat, flat, up], dtype=np.float64)
        for flat, up, codes in re.findall(r"offset_error (\S+) (\S+) m using_stations (.+)", command)
        for code in codes.split()
    }
    scatter = 1e-3 * np.array(re.findall(r"gb_enu_error (\S+) (\S+) (\S+) mm", data)[0], dtype=np.float64)
    antennas = {
        code: _turned(xyz, scatter**2 / 2.0 + centring.get(code, np.zeros(3)) ** 2) for code, xyz in approx.items()
    }
    vectors = []
    for first, rest in re.findall(r"^(\w+)\n((?:\w+ +-?[\d.]+ +-?[\d.]+ +-?[\d.]+\n)+)", data, re.MULTILINE):
        start = f"antenna at {first}"
        vectors.append(_vector(first, start, np.zeros(3), antennas[first]))
        approx[start] = approx[first]
        for code, *gap in (row.split() for row in rest.splitlines()):
            vectors.append(_vector(start, code, np.array(gap, dtype=np.float64), antennas[code]))
    held = re.findall(r"^fix (.+)$", command, re.MULTILINE)[0].split()
    return _network(approx, {code: approx[code] for code in held}, vectors=vectors)


def traverse_network(folder: Path, name: str, adjusted: Mapping[str, Array] | None = None) -> dict[str, Any]:
    """Translate slope distances, azimuths and zenith distances: stations whose attitude is that of their place.

    Parameters
    ----------
    folder, name
        Of the network.
    adjusted
        Geocentric coordinates at which the verticals are taken; null: the given ones.
    """
    approx = _approximate(folder, name)
    at = approx | dict(adjusted or {})
    axes = {code: east_north_up(*INTERNATIONAL.geodetic(xyz)[:2]) for code, xyz in at.items()}
    distances, polar = [], []
    row = re.compile(r"^(\w+) (\w+) (\S+) (\S+) (\S+) (\S+) (\S+) (\S+) *$", re.MULTILINE)
    for start, end, distance, std, azimuth, azimuth_std, zenith, zenith_std in row.findall(
        _text(folder / "in" / f"{name}.dat")
    ):
        bend = REFRACTION * np.degrees(np.arccos(axes[start][:, 2] @ axes[end][:, 2]))
        distances.append({"from": start, "to": end, "distance": float(distance), "sigma": float(std)})
        polar.append(
            {
                "station": f"at {start}", "point": end,
                "horizontal": 90.0 - float(azimuth), "sigma_horizontal": float(azimuth_std),
                "zenith": float(zenith) + float(bend), "sigma_zenith": float(zenith_std),
            }
        )  # fmt: skip
    stations = [
        {"id": f"at {code}", "point": code, "held": True, "approx": pose(axes[code], at[code])}
        for code in dict.fromkeys(each["station"].removeprefix("at ") for each in polar)
    ]
    first = next(iter(approx))
    return _network(approx, {first: approx[first]}, stations=stations, distances=distances, polar=polar)


def _network(
    approx: Mapping[str, Array], held: Mapping[str, Array], *, stations: Sequence[Any] = (), **observations: Any
) -> dict[str, Any]:
    control = [{"point": code, "xyz": xyz.tolist(), "held": True} for code, xyz in held.items()]
    return {
        "format": "hybrid-network/1",
        "units": {"angle": "deg"},
        "stations": list(stations),
        "points_approx": {code: xyz.tolist() for code, xyz in approx.items()},
        "observations": observations | {"control": control},
    }


def _approximate(folder: Path, name: str) -> dict[str, Array]:
    row = re.compile(rf"^(\w+) +{ANGLE} ([NS]) +{ANGLE} ([EW]) +(-?[\d.]+)", re.MULTILINE)
    return {
        code: INTERNATIONAL.xyz([degrees(d, m, s, side), degrees(e, n, t, half), float(height)])
        for code, d, m, s, side, e, n, t, half, height in row.findall(_text(folder / "in" / f"{name}.crd"))
    }


def _values(lines: Sequence[str], stations: Sequence[str]) -> list[Array]:
    """Find the next coordinates of each of the stations, X, Y, Z [m]."""
    row = re.compile(r"^\s*(?:\* *)?(\w+)\s+(?:\* *)?(-?\d{7}\.\d+)\s+(-?\d+\.\d+)\s+(-?\d{7}\.\d+)")
    rows = iter([match.groups() for match in map(row.match, lines) if match])
    return [next(np.array(xyz, dtype=np.float64) for code, *xyz in rows if code == name) for name in stations]


def _vector(start: str, end: str, gap: Array, covariance: Array) -> dict[str, Any]:
    return {"from": start, "to": end, "xyz": gap.tolist(), "covariance": covariance.tolist()}


def _turned(xyz: Array, variances: Array) -> Array:
    """Turn variances east, north, up at a place into a covariance (3, 3) in the geocentric frame."""
    axes = east_north_up(*INTERNATIONAL.geodetic(xyz)[:2])
    return np.asarray((axes * variances) @ axes.T)


def _text(path: Path) -> str:
    return path.read_text().replace("\r", "")
