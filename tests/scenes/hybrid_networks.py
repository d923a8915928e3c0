"""Small hybrid networks with known truth, in the layout `hybrid-network/1`."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

GON = 200.0 / np.pi
CAMERA = {"id": "C1", "principal_distance_px": 3000.0}
STDS = {"horizontal": 0.003, "zenith": 0.003, "distance": 0.002, "image": 0.3}


def hybrid_network(
    seed: int, *, points: int = 20, scanners: int = 3, photos: int = 4, noise: float = 1.0, approximate: bool = True
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Give a network about a room, and the true points; the first scanner is at the origin, levelled."""
    rng = np.random.default_rng(seed)
    truth = {f"{k + 1}": rng.uniform([-5.0, -5.0, -1.0], [5.0, 5.0, 3.0]) for k in range(points)}
    stations: list[dict[str, Any]] = []
    observed: dict[str, Any] = {"polar": [], "image": []}
    for k in range(scanners):
        turn = Rotation.from_euler("XYZ", [0.02, -0.03, 1.9] if k else [0.0, 0.0, 0.0])
        place = np.array([2.5 * np.cos(2.0 * k), 2.5 * np.sin(2.0 * k), 0.4]) if k else np.zeros(3)
        omega, phi, kappa = turn.as_euler("XYZ") * GON
        approx = dict(zip("XYZ", place, strict=True)) | {"omega": omega, "phi": phi, "kappa": kappa}
        stations.append({"id": f"S{k + 1}", "type": "scanner"} | ({"approx": approx} if approximate else {}))
        for name, point in truth.items():
            x, y, z = turn.inv().apply(point - place)
            values = np.arctan2(y, x) * GON % 400.0, np.arctan2(np.hypot(x, y), z) * GON, np.linalg.norm([x, y, z])
            entry: dict[str, Any] = {"station": f"S{k + 1}", "scan": "1", "point": name}
            for part, value in zip(("horizontal", "zenith", "distance"), values, strict=True):
                entry[part] = value + noise * STDS[part] * rng.normal()
                entry[f"sigma_{part}"] = STDS[part]
            observed["polar"].append(entry)
    for k in range(photos):
        alpha = 2.0 * np.pi * k / max(photos, 1)
        place = np.array([11.0 * np.cos(alpha), 11.0 * np.sin(alpha), 1.0])
        # the camera looks along -z towards the middle: its z axis points outwards
        turn = Rotation.from_euler("ZYZ", [alpha, 1.5, 0.5 * np.pi])
        angles = turn.as_euler("ZYZ") * GON
        approx = dict(zip("XYZ", place, strict=True)) | dict(zip(("alpha", "zeta", "kappa"), angles, strict=True))
        stations.append({"id": f"P{k + 1}", "type": "photo"} | ({"approx": approx} if approximate else {}))
        for name, point in truth.items():
            x, y, z = turn.inv().apply(point - place)
            image = -CAMERA["principal_distance_px"] * np.array([x, y]) / z + noise * STDS["image"] * rng.normal(size=2)
            observed["image"].append({
                "photo": f"P{k + 1}", "point": name, "x": image[0], "sigma_x": STDS["image"], "y": image[1],
                "sigma_y": STDS["image"],
            })  # fmt: skip
    network: dict[str, Any] = {
        "format": "hybrid-network/1",
        "camera": CAMERA,
        "stations": stations,
        "observations": observed,
    }
    if approximate:
        network["points_approx"] = {name: point.tolist() for name, point in truth.items()}
    return network, truth
