"""What an instrument measures wrong in the same way each time."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Scalars
from algorithms.errors import InvalidInputError

REFERENCE_INCIDENCE_RAD = float(np.deg2rad(70.0))
"""Angle of incidence for which the offset by incidence is stated."""


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

    def __post_init__(self) -> None:
        """Refuse errors that are no numbers or that turn ranges round."""
        for name, value in vars(self).items():
            if not np.isfinite(value):
                raise InvalidInputError("systematic errors", f"{name} is {value}", "a finite number")
        if not self.range_scale_error > -1.0:
            raise InvalidInputError("systematic errors", f"range_scale_error is {self.range_scale_error}", "above -1")

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
