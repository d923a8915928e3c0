"""What an instrument measures wrong in the same way each time."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.arrays import Points, Scalars
from algorithms.errors import InvalidInputError
from algorithms.scans.instrument_errors import drift_polynomials

REFERENCE_INCIDENCE_RAD = float(np.deg2rad(70.0))
"""Angle of incidence for which the offset by incidence is stated."""
LEAST_COSINE = 1e-6
"""Beams nearer to the zenith have no azimuth; what a collimation error does to them stays finite."""


@dataclass(frozen=True)
class SystematicErrors:
    """Options of an instrument out of adjustment; one that is in adjustment has none of these errors."""

    range_offset_m: float = 0.0
    """Added to every range (zero-point correction that was not applied)."""
    range_scale_error: float = 0.0
    """Relative error of every range: 20e-6 makes 100 m 2 mm too long. The group velocity of light alone varies by up to
    0.03 % with the air (VGI 4/2003, laser physics, section on atmosphere)."""
    incidence_offset_m: float = 0.0
    """Added to a range measured at 70 degrees from the normal; it grows with the tangent of the angle of incidence, as
    does the depth of the footprint on the surface and with it the length of the echo. Where in a longer echo the range
    is taken (leading edge or centroid) is the instrument's way, and so is the sign (VGI 4/2003, laser physics, sections
    on the pulse's shape and on the detection of echoes)."""
    vertical_index_error_rad: float = 0.0
    """Recorded elevation minus true one, the same in all directions: the zero of a vertical circle read in one face."""
    collimation_error_rad: float = 0.0
    """Angle between the line of sight and the normal of the trunnion axis: adds c / cos(elevation) to azimuths."""
    trunnion_error_rad: float = 0.0
    """Tilt of the trunnion axis: adds i tan(elevation) to azimuths."""
    drift_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Turn of the tripod about the scanner's x, y, z axes from the first column to the last, steady; half of it before
    and half after the stated pose."""
    drift_bend_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """By how much more the tripod is turned at the first and the last column than in the middle; its mean is zero."""

    def __post_init__(self) -> None:
        """Refuse errors that are no numbers or that turn ranges round."""
        for name, value in vars(self).items():
            if not np.isfinite(value).all():
                raise InvalidInputError("systematic errors", f"{name} is {value}", "a finite number")
        if not self.range_scale_error > -1.0:
            raise InvalidInputError("systematic errors", f"range_scale_error is {self.range_scale_error}", "above -1")

    def true_directions(self, azimuths: Scalars, elevations: Scalars, times: Scalars) -> Points:
        """Give where beams really went, (n, 3) unit vectors in the scan frame of the stated pose.

        Parameters
        ----------
        azimuths, elevations
            (n,) recorded [rad].
        times
            (n,) of the measurement, 0 at the first column and 1 after the last.
        """
        elevations = elevations - self.vertical_index_error_rad
        if self.collimation_error_rad or self.trunnion_error_rad:
            sideways = self.collimation_error_rad / np.maximum(np.cos(elevations), LEAST_COSINE)
            azimuths = azimuths - sideways - self.trunnion_error_rad * np.tan(elevations)
        horizontal = np.cos(elevations)
        directions = np.stack(
            [horizontal * np.cos(azimuths), horizontal * np.sin(azimuths), np.sin(elevations)], axis=1
        )
        if any((*self.drift_rad, *self.drift_bend_rad)):
            steady, bend = drift_polynomials(times)
            turns = steady[:, None] * np.array(self.drift_rad) + bend[:, None] * np.array(self.drift_bend_rad)
            directions = Rotation.from_rotvec(turns).apply(directions)
        return np.asarray(directions)

    def range_errors_m(self, ranges_m: Scalars, cosines: Scalars) -> Scalars:
        """Give recorded minus true ranges (n,) [m].

        Parameters
        ----------
        ranges_m
            (n,) true ranges.
        cosines
            (n,) cosines of the angles of incidence, above 0.
        """
        errors = self.range_offset_m + self.range_scale_error * ranges_m
        if self.incidence_offset_m:
            tangents = np.sqrt(np.maximum(0.0, 1.0 - cosines**2)) / cosines
            errors = errors + self.incidence_offset_m * tangents / np.tan(REFERENCE_INCIDENCE_RAD)
        return np.asarray(errors)


IN_ADJUSTMENT = SystematicErrors()
"""An instrument without any."""
