"""Geodetic coordinates of networks on an ellipsoid: place and directions in its geocentric frame."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.arrays import Array


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """An ellipsoid of revolution; latitudes and longitudes in degrees, heights above it in metres."""

    semi_major_m: float
    inverse_flattening: float

    def xyz(self, place: Array) -> Array:
        """Give geocentric coordinates (..., 3) [m] of latitude, longitude and height (..., 3)."""
        latitude, longitude, height = np.moveaxis(np.asarray(place, dtype=np.float64), -1, 0)
        return np.stack(self._cart.transform(longitude, latitude, height), axis=-1)

    def geodetic(self, xyz: Array) -> Array:
        """Give latitude, longitude and height (..., 3) of geocentric coordinates (..., 3) [m]."""
        longitude, latitude, height = self._cart.transform(*np.moveaxis(xyz, -1, 0), direction="INVERSE")
        return np.stack([latitude, longitude, height], axis=-1)

    def rates(self, place: Array) -> Array:
        """Give the derivatives (3, 3) of geocentric coordinates by latitude, longitude [m/degree] and height."""
        steps = np.diag([1e-3, 1e-3, 1.0])
        return np.asarray((self.xyz(place + steps) - self.xyz(place - steps)).T / (2.0 * steps.diagonal()))

    @cached_property
    def _cart(self) -> Any:
        from pyproj import Transformer

        return Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
            f"+step +proj=cart +a={self.semi_major_m!r} +rf={self.inverse_flattening!r}"
        )


INTERNATIONAL = Ellipsoid(6378388.0, 297.0)
GRS80 = Ellipsoid(6378137.0, 298.257222101)


def degrees(degree: str, minute: str, second: str, sign: str = "") -> float:
    """Read an angle of degrees, minutes and seconds; south and west are negative."""
    size = abs(float(degree)) + float(minute) / 60.0 + float(second) / 3600.0
    return -size if sign in ("S", "W") or degree.startswith("-") else size


def east_north_up(latitude: float, longitude: float) -> Array:
    """Give the axes of a place as columns (3, 3) in the geocentric frame; up is where latitude and longitude point."""
    return Rotation.from_euler("ZYX", [longitude + 90.0, 0.0, 90.0 - latitude], degrees=True).as_matrix()


def pose(rotation: Array, xyz: Array) -> dict[str, float]:
    """Give a pose of `hybrid-network/1` in degrees."""
    angles = Rotation.from_matrix(rotation).as_euler("XYZ", degrees=True)
    return dict(zip(("omega", "phi", "kappa", "X", "Y", "Z"), [*map(float, angles), *map(float, xyz)], strict=True))
