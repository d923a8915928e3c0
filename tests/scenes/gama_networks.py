"""GNU Gama's XML networks as `hybrid-network/1`: distances, zenith angles, directions, angles, vectors, heights."""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np

SPACE = "{http://www.gnu.org/software/gama/gama-local}"
ANSWER = "{http://www.gnu.org/software/gama/gama-local-adjustment}"


def gama_network(  # noqa: C901 - one kind of observation after the other
    path: Path,
) -> dict[str, Any]:
    """Read a .gkf file; angles in gon, standard deviations in mm and 1e-4 gon, left-handed angles turned."""
    network = ET.parse(path).getroot().find(f"{SPACE}network")  # noqa: S314 - files of this project's data folder
    assert network is not None
    sign = -1.0 if network.get("angles", "left-handed") == "left-handed" else 1.0
    flip = y_sign(network)
    data = network.find(f"{SPACE}points-observations")
    assert data is not None
    points: dict[str, list[float]] = {}
    observed: dict[str, list[Any]] = {key: [] for key in ("polar", "control", "distances", "heights", "vectors")}
    stations: dict[str, dict[str, Any]] = {}
    for point in data.iter(f"{SPACE}point"):
        name = str(point.get("id"))
        xyz = [float(point.get(k, 0.0)) for k in "xyz"]
        xyz[1] *= flip
        if point.get("x") is not None:
            points[name] = xyz
        if "z" in (point.get("fix") or "").lower() and "x" in (point.get("fix") or "").lower():
            observed["control"].append({"point": name, "xyz": xyz, "held": True})
    turned = sign  # of the true directions, whichever way the axes of the file go

    def station(name: str, at: str, *, orient: bool) -> str:
        x, y, z = points.get(at, [0.0, 0.0, 0.0])
        stations.setdefault(
            name, {"id": name, "type": "scanner", "point": at, "levelled": True, "held": not orient}
            | ({} if orient else {"approx": {"X": x, "Y": y, "Z": z, "omega": 0, "phi": 0, "kappa": 0}}),
        )  # fmt: skip
        return name

    for number, block in enumerate(data.iter(f"{SPACE}obs")):
        base = block.get("from")
        for each in block:
            kind = each.tag.removeprefix(SPACE)
            start, end = each.get("from", base), each.get("to")
            value = float(each.get("val", "nan")) if each.get("val") else np.nan
            std = float(each.get("stdev", "nan"))
            below, above = float(each.get("from_dh", 0.0)), float(each.get("to_dh", 0.0))
            if np.isnan(std):
                std = default_std(data, kind, value)
            if kind in {"s-distance", "distance"} and not below and not above:
                flat = {"horizontal": True} if kind == "distance" else {}
                observed["distances"].append({"from": start, "to": end, "distance": value, "std": 1e-3 * std} | flat)
            elif kind in {"s-distance", "z-angle"}:
                at = station(f"zenith {start} {below}", str(start), orient=False)
                stations[at]["height_m"] = below
                part = ("distance", 1e-3) if kind == "s-distance" else ("zenith", 1e-4)
                observed["polar"].append({
                    "station": at, "point": end, part[0]: value, f"sigma_{part[0]}": part[1] * std, "height_m": above,
                })  # fmt: skip
            elif kind == "direction":
                at = station(f"round {number} {start}", str(start), orient=True)
                observed["polar"].append({
                    "station": at, "point": end, "horizontal": turned * value, "sigma_horizontal": 1e-4 * std
                })  # fmt: skip
            elif kind == "angle":
                # the difference of two directions, each with the variance of half of it
                at = station(f"angle {len(stations)} {start}", str(start), orient=True)
                for point, reading in ((each.get("bs"), 0.0), (each.get("fs"), turned * value)):
                    observed["polar"].append({
                        "station": at, "point": point, "horizontal": reading, "sigma_horizontal": 1e-4 * std / 2**0.5
                    })  # fmt: skip
            else:
                raise ValueError(kind)
    for block in data.iter(f"{SPACE}height-differences"):
        for each in block:
            observed["heights"].append({
                "from": each.get("from"), "to": each.get("to"), "dh": float(each.get("val", "nan")),
                "std": 1e-3 * float(each.get("stdev", "nan")),
            })  # fmt: skip
    for block in data.iter(f"{SPACE}vectors"):
        vectors = list(block.iter(f"{SPACE}vec"))
        text = block.find(f"{SPACE}cov-mat")
        assert text is not None
        numbers = [float(word) for word in (text.text or "").split()]
        size, band = int(text.get("dim", 0)), int(text.get("band", 0))
        covariance = np.zeros((size, size))
        for i in range(size):
            for j in range(i, min(i + band, size - 1) + 1):
                covariance[i, j] = covariance[j, i] = numbers.pop(0) * 1e-6
        for k, vec in enumerate(vectors):
            own = covariance[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
            assert np.count_nonzero(covariance) == sum(
                np.count_nonzero(covariance[3 * i : 3 * i + 3, 3 * i : 3 * i + 3]) for i in range(len(vectors))
            )
            axes_turned = np.diag([1.0, flip, 1.0])
            dxyz = axes_turned @ [float(vec.get(k2, "nan")) for k2 in ("dx", "dy", "dz")]
            observed["vectors"].append({
                "from": vec.get("from"), "to": vec.get("to"), "dx": dxyz[0], "dy": dxyz[1], "dz": dxyz[2],
                "covariance": (axes_turned @ own @ axes_turned).tolist(),
            })  # fmt: skip
    return {
        "format": "hybrid-network/1", "stations": list(stations.values()), "points_approx": points,
        "observations": observed,
    }  # fmt: skip


def y_sign(network: ET.Element) -> float:
    """Give -1 where x and y of a file are left-handed: its y is turned round."""
    return 1.0 if network.get("axes-xy", "ne") in {"en", "nw", "se", "ws"} else -1.0


def default_std(data: ET.Element, kind: str, value: float) -> float:
    """Give the standard deviation that the file states for all observations of a type."""
    if kind in {"s-distance", "distance"}:
        words = [float(word) for word in data.get("distance-stdev", "nan").split()]
        constant, per_km, power = (*words, 0.0, 0.0, 1.0)[:3] if len(words) == 1 else (*words, 1.0)[:3]
        return constant + per_km * (value / 1000.0) ** power
    return float(
        data.get({"z-angle": "zenith-angle", "direction": "direction", "angle": "angle"}[kind] + "-stdev", "nan")
    )


def gama_answer(path: Path) -> tuple[dict[str, np.ndarray], float, int, float]:
    """Read adjusted coordinates, [pvv], degrees of freedom and the a-priori standard deviation of a result."""
    root = ET.parse(path.with_suffix(".xml")).getroot()  # noqa: S314 - files of this project's data folder
    adjusted = root.find(f".//{ANSWER}coordinates/{ANSWER}adjusted")
    assert adjusted is not None
    network = ET.parse(path).getroot().find(f"{SPACE}network")  # noqa: S314 - likewise
    assert network is not None
    flip = y_sign(network)
    found = {}
    for point in adjusted:
        values = {e.tag.removeprefix(ANSWER).lower(): e.text for e in point}
        if {"x", "y", "z"} <= set(values):
            xyz = np.array([float(values[k] or "nan") for k in "xyz"])
            xyz[1] *= flip
            found[str(values["id"])] = xyz
    squares = float(root.findtext(f".//{ANSWER}sum-of-squares") or "nan")
    freedom = int(root.findtext(f".//{ANSWER}degrees-of-freedom") or 0)
    prior = float(root.findtext(f".//{ANSWER}apriori") or "nan")
    return found, squares, freedom, prior
