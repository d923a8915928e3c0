"""GNU Gama's input as a network: distances, zenith angles, directions, angles, vectors and height differences."""

import math
from typing import Any
from xml.etree.ElementTree import Element

RIGHT_HANDED_AXES = frozenset({"en", "nw", "se", "ws"})
"""Directions of x and y that make a right-handed system; y of others is turned round."""


def network_of_gama(root: Element) -> dict[str, Any]:
    """Read the root of a .gkf file: angles in gon, standard deviations in mm and 1e-4 gon.

    Points that are fixed in all three coordinates become control that is held; left-handed axes and angles are turned.

    Raises
    ------
    ValueError
        No gama-local file, an observation of another kind, points fixed in part, vectors that are correlated with each
        other, or a value that is no number; each by name.
    """
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    network = root.find("network") if root.tag == "gama-local" else None
    data = None if network is None else network.find("points-observations")
    if network is None or data is None:
        raise ValueError("this is no gama-local file: network/points-observations is missing")
    return _Reading(network, data).network()


class _Reading:
    def __init__(self, network: Element, data: Element) -> None:
        self.data = data
        self.turned = -1.0 if network.get("angles", "left-handed") == "left-handed" else 1.0
        self.flip = 1.0 if network.get("axes-xy", "ne") in RIGHT_HANDED_AXES else -1.0
        self.points: dict[str, list[float]] = {}
        self.stations: dict[str, dict[str, Any]] = {}
        kinds = ("polar", "control", "distances", "heights", "vectors")
        self.observed: dict[str, list[Any]] = {kind: [] for kind in kinds}

    def network(self) -> dict[str, Any]:
        known = {"point", "obs", "height-differences", "vectors"}
        for block in self.data:
            if block.tag not in known:
                raise ValueError(f"gama-local: {block.tag!r} is no observation of this service")
        for point in self.data.findall("point"):
            self._point(point)
        for number, block in enumerate(self.data.findall("obs")):
            for each in block:
                self._terrestrial(each, block.get("from"), number)
        for block in self.data.findall("height-differences"):
            for each in block:
                self.observed["heights"].append({
                    "from": each.get("from"), "to": each.get("to"), "dh": _number(each, "val"),
                    "std": 1e-3 * _number(each, "stdev"),
                })  # fmt: skip
        for block in self.data.findall("vectors"):
            self._vectors(block)
        return {
            "format": "hybrid-network/1", "stations": list(self.stations.values()), "points_approx": self.points,
            "observations": self.observed,
        }  # fmt: skip

    def _point(self, point: Element) -> None:
        name, fixed = str(point.get("id")), (point.get("fix") or "").lower()
        if point.get("x") is None or point.get("y") is None:
            if fixed:
                raise ValueError(f"gama-local: point {name!r} is fixed and has no x and y")
            return
        xyz = [_number(point, "x"), self.flip * _number(point, "y"), _number(point, "z") if point.get("z") else 0.0]
        self.points[name] = xyz
        if fixed and set(fixed) != set("xyz"):
            raise ValueError(f"gama-local: point {name!r} is fixed in {fixed} only; here it is fixed in xyz or not")
        if fixed:
            self.observed["control"].append({"point": name, "xyz": xyz, "held": True})

    def _station(self, name: str, at: str, *, orient: bool) -> str:
        x, y, z = self.points.get(at, [0.0, 0.0, 0.0])
        station = {"id": name, "type": "scanner", "point": at, "levelled": True, "held": not orient}
        if not orient:
            station["approx"] = {"X": x, "Y": y, "Z": z, "omega": 0.0, "phi": 0.0, "kappa": 0.0}
        self.stations.setdefault(name, station)
        return name

    def _terrestrial(self, each: Element, base: str | None, number: int) -> None:
        kind, start, end = each.tag, str(each.get("from", base)), each.get("to")
        if kind == "cov-mat":
            raise ValueError("gama-local: observations of <obs> with a covariance matrix are not read")
        if kind not in {"distance", "s-distance", "z-angle", "direction", "angle"}:
            raise ValueError(f"gama-local: {kind!r} is no observation of this service")
        value = _number(each, "val")
        std = _number(each, "stdev") if each.get("stdev") else self._default_std(kind, value)
        below, above = (_number(each, key) if each.get(key) else 0.0 for key in ("from_dh", "to_dh"))
        if kind in {"distance", "s-distance"} and not below and not above:
            entry: dict[str, Any] = {"from": start, "to": end, "distance": value, "std": 1e-3 * std}
            self.observed["distances"].append(entry | ({"horizontal": True} if kind == "distance" else {}))
        elif kind in {"s-distance", "z-angle"}:
            at = self._station(f"zenith {start} {below}", start, orient=False)
            self.stations[at]["height_m"] = below
            part, unit = ("distance", 1e-3) if kind == "s-distance" else ("zenith", 1e-4)
            entry = {"station": at, "point": end, part: value, f"sigma_{part}": unit * std, "height_m": above}
            self.observed["polar"].append(entry)
        elif kind == "direction":
            at = self._station(f"round {number} {start}", start, orient=True)
            self._horizontal(at, end, self.turned * value, std)
        elif kind == "angle":
            # the difference of two directions, each with half of its variance
            at = self._station(f"angle {len(self.stations)} {start}", start, orient=True)
            self._horizontal(at, each.get("bs"), 0.0, std / math.sqrt(2.0))
            self._horizontal(at, each.get("fs"), self.turned * value, std / math.sqrt(2.0))
        else:
            raise ValueError("gama-local: a horizontal distance between marks of other heights is not read")

    def _horizontal(self, station: str, point: str | None, value: float, std: float) -> None:
        entry = {"station": station, "point": point, "horizontal": value, "sigma_horizontal": 1e-4 * std}
        self.observed["polar"].append(entry)

    def _vectors(self, block: Element) -> None:
        vectors, given = block.findall("vec"), block.find("cov-mat")
        if given is None:
            raise ValueError("gama-local: vectors need a covariance matrix")
        if (other := next((each.tag for each in block if each.tag not in {"vec", "cov-mat"}), None)) is not None:
            raise ValueError(f"gama-local: {other!r} is no observation of this service")
        numbers = iter((given.text or "").split())
        size, band = int(given.get("dim", 0)), int(given.get("band", 0))
        if size != 3 * len(vectors):
            raise ValueError(f"gama-local: {len(vectors)} vectors and a covariance matrix of {size}")
        covariances = [[[0.0] * 3 for _ in range(3)] for _ in vectors]
        for i in range(size):
            for j in range(i, min(i + band, size - 1) + 1):
                value = 1e-6 * float(next(numbers, "nan"))
                if i // 3 == j // 3:
                    turned = value * (self.flip if (i % 3 == 1) != (j % 3 == 1) else 1.0)
                    covariances[i // 3][i % 3][j % 3] = covariances[i // 3][j % 3][i % 3] = turned
                elif value != 0.0:
                    raise ValueError("gama-local: vectors that are correlated with each other are not read")
        if next(numbers, None) is not None:
            raise ValueError(f"gama-local: a covariance matrix of {size} with band {band} has more numbers than that")
        for vec, covariance in zip(vectors, covariances, strict=True):
            self.observed["vectors"].append({
                "from": vec.get("from"), "to": vec.get("to"), "dx": _number(vec, "dx"),
                "dy": self.flip * _number(vec, "dy"), "dz": _number(vec, "dz"), "covariance": covariance,
            })  # fmt: skip

    def _default_std(self, kind: str, value: float) -> float:
        """Give the standard deviation that the file states for all observations of a type."""
        stated = "distance" if kind in {"distance", "s-distance"} else "zenith-angle" if kind == "z-angle" else kind
        words = (self.data.get(f"{stated}-stdev") or "").split()
        if not words:
            raise ValueError(f"gama-local: a {kind} has no standard deviation, and there is no {stated}-stdev")
        constant, per_km, power = [*(float(word) for word in words), *((0.0, 0.0, 1.0)[len(words) :])][:3]
        return float(constant + per_km * (value / 1000.0) ** power)


def _number(element: Element, key: str) -> float:
    text = element.get(key)
    try:
        return float(text or "")
    except ValueError:
        where = ", ".join(f"{k} {element.get(k)}" for k in ("id", "from", "to") if element.get(k))
        raise ValueError(f"gama-local: {key} of {element.tag} ({where}) is {text!r}, no number") from None
