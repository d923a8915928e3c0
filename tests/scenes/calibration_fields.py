"""A field of near and far targets before a scanner, and photos of a camera on its head, as a request has them."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.calibration.lenses import LENSES

WIDTH, HEIGHT = 1280, 960
LENS = LENSES["opencv"]
TRUTH = {"f": 1000.0, "cx": 647.5, "cy": 473.5, "k1": -0.15, "p1": 0.001}
MOUNT_TURN = (
    np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    @ Rotation.from_rotvec([0.01, -0.02, 0.03]).as_matrix()
)
MOUNT_PLACE = np.array([0.05, 0.02, 0.25])


def mounted_field(seed: int, noise_px: float = 0.1, std_m: float = 0.002) -> dict[str, Any]:
    """Give inputs of `calibrate-camera`: 50 targets at 3 and 9 m, seen at three head angles."""
    rng = np.random.default_rng(seed)
    parameters = np.array([TRUTH.get(name, 0.0) for name in LENS.names])
    places = np.array([
        distance * np.array([np.cos(a), np.sin(a), h])
        for shift, distance in ((0.0, 3.0), (0.03, 9.0))
        for a in np.linspace(-0.45, 0.45, 5) + shift for h in np.linspace(-0.38, 0.38, 5)
    ])  # fmt: skip
    points = []
    heads = (-12.0, 0.0, 15.0)
    for k, angle in enumerate(heads):
        in_head = places @ Rotation.from_euler("Z", angle * np.pi / 200.0).as_matrix()
        image = LENS.image((in_head - MOUNT_PLACE) @ MOUNT_TURN, parameters)
        measured = image + noise_px * rng.normal(size=image.shape)
        shown = ((image > 0.0) & (image < [WIDTH - 1, HEIGHT - 1])).all(axis=1)
        points += [
            {"photo": f"P{k}", "target": f"T{i}", "x": measured[i, 0], "y": measured[i, 1], "std_px": noise_px}
            for i in np.flatnonzero(shown)
        ]
    targets = places + std_m * rng.normal(size=places.shape)
    return {
        "field": {
            "targets": [{"name": f"T{i}", "xyz_m": xyz, "std_m": std_m} for i, xyz in enumerate(targets.tolist())],
            "photos": [{"name": f"P{k}", "cop_gon": angle} for k, angle in enumerate(heads)],
            "image_points": points,
        },
        "camera": {"width": WIDTH, "height": HEIGHT, "unknown": ["f", "cx", "cy", "k1", "p1"], "pixel_um": 7.5},
        "mount": {"cop_std_gon": 0.001},
    }
