"""Labelled samples of the ISPRS filter test, and measures of agreement."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from algorithms.arrays import Flags, Points
from service.formats import read_scan

FOLDER = Path(__file__).resolve().parents[3] / "shared" / "data" / "terrain_isprs"
SAMPLES = ("11", "12", "21", "23", "31", "41", "51", "53", "61")


def labelled_sample(name: str) -> tuple[Points, Flags]:
    """Give points, less an origin, and which of them the experts called ground.

    The ground file is a subsequence of the full one, in the same order.
    """
    both = [read_scan(path, path.name) for path in (FOLDER / f"samp{name}-utm{end}.pcd" for end in ("", "-ground"))]
    full, ground = (scan.points + (scan.origin_m - both[0].origin_m) for scan in both)
    labels = np.zeros(len(full), dtype=np.bool_)
    at = 0
    for k, point in enumerate(full.round(4).tolist()):
        if at < len(ground) and point == ground[at].round(4).tolist():
            labels[k], at = True, at + 1
    if at != len(ground):
        raise ValueError(f"sample {name}: the ground points are not among all points")
    return full, labels


def agreement(found: Flags, ground: Flags) -> Mapping[str, float]:
    """Give kappa and the errors of type I (ground called object), II (object called ground) and in total."""
    both, type_1, type_2 = (found & ground).sum(), (~found & ground).sum(), (found & ~ground).sum()
    n, neither = len(found), (~found & ~ground).sum()
    observed = (both + neither) / n
    expected = ((both + type_1) * (both + type_2) + (neither + type_1) * (neither + type_2)) / n**2
    return {
        "kappa": float((observed - expected) / (1.0 - expected)),
        "type_1": float(type_1 / ground.sum()),
        "type_2": float(type_2 / (~ground).sum()),
        "total": float((type_1 + type_2) / n),
    }
