"""Buildings of eleven kinds with known volumes, as a flight sees them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Points
from algorithms.deviations.signed_distances import inside_polygon

Height = Callable[[Array, Array], Array]
AROUND_M = 5.0


@dataclass(frozen=True, eq=False)
class RoofKind:
    """A plan about the origin, and the height of the roof over it [m]."""

    outline: Array
    height: Height

    def volume_m3(self) -> float:
        """Sum the heights on a raster of 2 cm [m³]."""
        step = 0.02
        low, high = self.outline.min(axis=0), self.outline.max(axis=0)
        x, y = np.meshgrid(*(np.arange(low[k] + step / 2, high[k], step) for k in (0, 1)))
        places = np.column_stack([x.ravel(), y.ravel()])
        return float(self.height(*places[inside_polygon(places, self.outline)].T).sum() * step**2)


def _rectangle(a: float, b: float) -> Array:
    return np.array([[-a, -b], [a, -b], [a, b], [-a, b]], dtype=np.float64)


def _ell(x: Array, y: Array) -> Array:
    """Give two gables of one width that meet in a hip and a valley."""
    x, y = x + 8.0, y + 9.0
    along_x = np.where(y <= 8.0, np.minimum(y, 8.0 - y), -np.inf)
    along_y = np.where(x <= 8.0, np.minimum(x, 8.0 - x), -np.inf)
    corner = np.minimum(np.minimum(x, y), np.maximum(8.0 - x, 8.0 - y))
    return 6.0 + 0.7 * np.where((x <= 8.0) & (y <= 8.0), corner, np.maximum(along_x, along_y))


def _mansard(x: Array, y: Array) -> Array:
    rim = np.minimum(6.0 - np.abs(x), 5.0 - np.abs(y))
    return 6.0 + np.where(rim < 1.5, 1.6 * rim, 2.4 + 0.4 * (rim - 1.5))


def _dormer(x: Array, y: Array) -> Array:
    main = 6.0 + 0.8 * (4.0 - np.abs(y))
    return np.where((np.abs(x) < 1.75) & (y > -3.5) & (y < 0.0), np.maximum(main, 8.6), main)


def _parapet(x: Array, y: Array) -> Array:
    return np.where(np.minimum(6.0 - np.abs(x), 4.0 - np.abs(y)) < 0.4, 7.0, 6.0)


KINDS: Mapping[str, RoofKind] = {
    "flat": RoofKind(_rectangle(6, 4), lambda x, _: np.full_like(x, 6.0)),
    "shed": RoofKind(_rectangle(6, 4), lambda _, y: 7.0 + 0.3 * y),
    "gable": RoofKind(_rectangle(6, 4), lambda _, y: 6.0 + 0.8 * (4.0 - np.abs(y))),
    "steep gable": RoofKind(_rectangle(6, 4), lambda _, y: 5.0 + 1.6 * (4.0 - np.abs(y))),
    "hip": RoofKind(_rectangle(7, 4), lambda x, y: 6.0 + 0.7 * np.minimum(4.0 - np.abs(y), 7.0 - np.abs(x))),
    "pyramid": RoofKind(_rectangle(4, 4), lambda x, y: 8.0 + 1.2 * (4.0 - np.maximum(np.abs(x), np.abs(y)))),
    "mansard": RoofKind(_rectangle(6, 5), _mansard),
    "ell": RoofKind(np.array([[-8.0, -9.0], [8.0, -9.0], [8.0, -1.0], [0.0, -1.0], [0.0, 9.0], [-8.0, 9.0]]), _ell),
    "dormer": RoofKind(_rectangle(6, 4), _dormer),
    "parapet": RoofKind(_rectangle(6, 4), _parapet),
    "stepped": RoofKind(_rectangle(7, 4), lambda x, _: np.where(x < -2.0, 9.0, 6.0)),
}


def flown(kind: RoofKind, seed: int, density: float, noise_m: tuple[float, float]) -> Points:
    """Give points of roof and ground with horizontal and vertical noise; walls are not seen.

    Parameters
    ----------
    kind
        The building.
    seed
        Of places and noise.
    density
        Points a square metre.
    noise_m
        Standard deviations of each horizontal coordinate, and of the height [m].
    """
    rng = np.random.default_rng(seed)
    low, high = kind.outline.min(axis=0) - AROUND_M, kind.outline.max(axis=0) + AROUND_M
    places = rng.uniform(low, high, (round(float(np.prod(high - low)) * density), 2))
    on = inside_polygon(places, kind.outline)
    heights = np.where(on, kind.height(*places.T), 0.0)
    noise = rng.normal(0.0, 1.0, (len(places), 3)) * [noise_m[0], noise_m[0], noise_m[1]]
    return np.column_stack([places, heights]) + noise
