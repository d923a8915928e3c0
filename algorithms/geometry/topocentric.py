"""From a map projection to a local Cartesian frame and back: what a projection does to lengths is no error of a scan.

A projection changes lengths by its scale (UTM by -0.4 m in a km at its central meridian) and shows a curved earth as a
plane (8 mm in height over 320 m, 20 m over 16 km). Poses are rigid motions, so adjustments are done in the frame of
PROJ's `topocentric`: x east, y north, z up at a point of the site.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from algorithms.arrays import Array, Matrices3, Points, Vector3
from algorithms.errors import InvalidInputError

MARGIN_DEG = 6.0
"""A zone's width: neighbouring zones are used beyond their rims."""
STEP_M = 10.0
"""Half the step of the differences by which the projection is linearised."""


@dataclass(frozen=True, eq=False)
class TopocentricFrame:
    """A local Cartesian frame at a point of a projected system."""

    crs: str
    """The projected system as PROJ takes it; of a compound one the plane part counts."""
    origin: Vector3
    """(3,) easting, northing, height of the local origin in that system [m]."""
    undulation_m: float = 0.0
    """Height of the geoid over the ellipsoid, which is added to all heights first [m]."""

    def to_local(self, projected: Points) -> Points:
        """Carry (n, 3) easting, northing, height to (n, 3) local coordinates [m].

        Raises
        ------
        InvalidInputError
            Points lie outside of the projection.
        """
        heights = projected[:, 2] + self.undulation_m
        longitudes, latitudes = self._geographic.transform(projected[:, 0], projected[:, 1])
        local = self._topocentric.transform(longitudes, latitudes, heights, radians=False)
        return _finite(np.column_stack(local))

    def from_local(self, local: Points) -> Points:
        """Carry (n, 3) local coordinates to (n, 3) easting, northing, height [m].

        Raises
        ------
        InvalidInputError
            Points lie outside of the projection.
        """
        longitudes, latitudes, heights = self._topocentric.transform(
            local[:, 0], local[:, 1], local[:, 2], radians=False, direction="INVERSE"
        )
        east, north = self._geographic.transform(longitudes, latitudes, direction="INVERSE")
        return _finite(np.column_stack([east, north, heights - self.undulation_m]))

    def rates(self, local: Points) -> Matrices3:
        """Give the derivatives (n, 3, 3) of projected by local coordinates: scale and convergence at each place."""
        steps = STEP_M * np.eye(3)
        columns = [(self.from_local(local + step) - self.from_local(local - step)) / (2.0 * STEP_M) for step in steps]
        return np.stack(columns, axis=2)

    @property
    def is_in_area(self) -> bool:
        """Say whether the origin lies about where the system is meant for; True where nobody says where that is."""
        area = self._plane.area_of_use
        longitude, latitude = self._geographic.transform(self.origin[0], self.origin[1])
        if not np.isfinite([longitude, latitude]).all():
            return False
        if area is None or area.west > area.east:
            return True
        return bool(
            area.west - MARGIN_DEG <= longitude <= area.east + MARGIN_DEG
            and area.south - MARGIN_DEG <= latitude <= area.north + MARGIN_DEG
        )

    @cached_property
    def _plane(self) -> Any:
        from pyproj import CRS

        crs = CRS.from_user_input(self.crs)
        parts = [part for part in (crs.sub_crs_list or [crs]) if not part.is_vertical]
        found = (parts[0].source_crs or parts[0]) if parts[0].is_bound else parts[0]
        return found.to_2d() if len(found.axis_info) > 2 else found

    @cached_property
    def _geographic(self) -> Any:
        from pyproj import Transformer

        # of the same datum, so that nothing but the projection is undone
        return Transformer.from_crs(self._plane, self._plane.geodetic_crs, always_xy=True)

    @cached_property
    def _topocentric(self) -> Any:
        from pyproj import Transformer

        longitude, latitude = self._geographic.transform(self.origin[0], self.origin[1])
        height = float(self.origin[2]) + self.undulation_m
        if not np.isfinite([longitude, latitude]).all():
            raise InvalidInputError("crs", "the coordinates lie outside of its projection", "look at axes and system")
        ellipsoid = self._plane.ellipsoid
        a, b = ellipsoid.semi_major_metre, ellipsoid.semi_minor_metre
        return Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
            f"+step +proj=cart +a={a!r} +b={b!r} "
            f"+step +proj=topocentric +a={a!r} +b={b!r} +lon_0={longitude!r} +lat_0={latitude!r} +h_0={height!r}"
        )


def turned_covariances(covariances: Matrices3, rates: Matrices3) -> Matrices3:
    """Carry (n, 3, 3) covariances along linear maps (n, 3, 3) [m²]."""
    return np.asarray(rates @ covariances @ np.swapaxes(rates, 1, 2))


def _finite(points: Array) -> Points:
    if not np.isfinite(points).all():
        raise InvalidInputError("crs", "some coordinates lie outside of its projection", "look at axes and system")
    return np.asarray(points, dtype=np.float64)
