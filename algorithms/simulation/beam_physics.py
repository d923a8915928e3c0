"""What a laser beam meets, and what comes back of it: footprint, radar equation, echo.

W. Wagner, A. Ullrich and C. Briese, "Der Laserstrahl und seine Interaktion mit der Erdoberfläche" (VGI 4/2003);
equation numbers are theirs.
"""

from enum import StrEnum

import numpy as np

from algorithms.arrays import Array, Scalars
from algorithms.errors import InvalidInputError

LIGHT_M_PER_S = 299_792_458.0
GROUP_VELOCITY_M_PER_S = 3.0e8
"""As the source rounds it; in air it differs by up to 0.03 % from one air to another."""


class EchoDetection(StrEnum):
    """Where in an echo the range is taken."""

    LEADING_EDGE = "leading-edge"
    """Where the signal first exceeds half of its maximum."""
    CENTROID = "centroid"
    """At the centre of gravity: later, a longer range."""
    MAXIMUM = "maximum"
    """Where its derivative vanishes; of a flat top its middle."""


def footprint_m(ranges_m: Array | float, divergence_rad: float, cosines: Array | float = 1.0) -> Array:
    """Give the length of the footprint on the surface, in the plane of incidence, R beta / cos (1, 2) [m].

    Parameters
    ----------
    ranges_m
        (n,) distances.
    divergence_rad
        Full divergence of the beam.
    cosines
        (n,) cosines of the angles of incidence, above 0.
    """
    return np.asarray(np.asarray(ranges_m) * divergence_rad / cosines)


def separable_ranges_m(pulse_s: float) -> float:
    """Give how far apart two surfaces must be for two echoes, v_g tau / 2 (3) [m]; ranges are measured far better."""
    return 0.5 * GROUP_VELOCITY_M_PER_S * pulse_s


def received_power_w(
    sent_w: float,
    ranges_m: Array | float,
    divergence_rad: float,
    aperture_m: float,
    cross_section_m2: Array | float,
    efficiency: float = 1.0,
) -> Array:
    """Give the power at the receiver, P_S D^2 / (4 pi R^4 beta^2) eta sigma: the radar equation (8) [W].

    Parameters
    ----------
    sent_w
        Power of the pulse.
    ranges_m
        (n,) distances.
    divergence_rad
        Full divergence of the beam.
    aperture_m
        Diameter of the receiver's lens.
    cross_section_m2
        (n,) scattering cross-sections.
    efficiency
        Of instrument and atmosphere together, 0..1.
    """
    ranges = np.asarray(ranges_m, dtype=np.float64)
    spread = 4.0 * np.pi * ranges**4 * divergence_rad**2
    return np.asarray(sent_w * aperture_m**2 / spread * efficiency * np.asarray(cross_section_m2))


def cross_section_of_small_m2(reflectance: float, area_m2: float) -> float:
    """Give the cross-section of something smaller than the footprint that faces the beam, 4 rho dA (10) [m²].

    Diffuse reflection after Lambert, into the solid angle pi.
    """
    return 4.0 * reflectance * area_m2


def cross_section_of_wire_m2(reflectance: float, diameter_m: float, range_m: float, divergence_rad: float) -> float:
    """Give the cross-section of a wire across the beam, 4 rho d R beta (11) [m²]."""
    return 4.0 * reflectance * diameter_m * range_m * divergence_rad


def cross_section_of_surface_m2(
    reflectances: Array | float, ranges_m: Array | float, divergence_rad: float, cosines: Array | float = 1.0
) -> Array:
    """Give the cross-section of a surface larger than the footprint, pi rho R^2 beta^2 cos (12) [m²].

    The footprint of a surface at a slant is larger by 1/cos, and is lit and looks back weaker by cos each.
    """
    ranges = np.asarray(ranges_m, dtype=np.float64)
    return np.asarray(np.pi * np.asarray(reflectances) * ranges**2 * divergence_rad**2 * np.asarray(cosines))


def transmission(ranges_m: Array | float, attenuation_db_per_km: float) -> Array:
    """Give the share of the light that the air leaves there and back, 0..1.

    Parameters
    ----------
    ranges_m
        (n,) distances.
    attenuation_db_per_km
        On the way in one direction: 0.2 to 0.8 in clear air, 3.9 in haze (at 1.06 um).
    """
    return np.asarray(10.0 ** (-2.0 * attenuation_db_per_km * np.asarray(ranges_m) / 1000.0 / 10.0))


def relative_power(
    reflectances: Array, ranges_m: Array, cosines: Array, reference_m: float, attenuation_db_per_km: float = 0.0
) -> Array:
    """Give the power that comes back of surfaces over that of a white one that faces the beam at a reference distance.

    What is left of the radar equation of surfaces larger than the footprint: rho cos / R^2, and the air.

    Parameters
    ----------
    reflectances, ranges_m, cosines
        (n,) reflectances, distances and cosines of the angles of incidence.
    reference_m
        Distance of the white surface.
    attenuation_db_per_km
        As in `transmission`.
    """
    air = transmission(ranges_m, attenuation_db_per_km) / transmission(reference_m, attenuation_db_per_km)
    return np.asarray(reflectances * cosines * (reference_m / ranges_m) ** 2 * air)


def slanted_profile(range_m: float, depth_m: float, step_m: float) -> tuple[Scalars, Scalars]:
    """Give the cross-section by distance of a plane whose footprint is so deep: the same in every slice.

    Parameters
    ----------
    range_m
        Of the middle.
    depth_m
        Farthest minus nearest: footprint times the tangent of the angle of incidence.
    step_m
        Of the slices.

    Returns
    -------
    (n,) distances [m] and (n,) shares of the cross-section, sum 1.
    """
    count = max(1, round(depth_m / step_m))
    distances = range_m + (np.arange(count) + 0.5 - 0.5 * count) * (depth_m / count)
    return distances, np.full(count, 1.0 / count)


def echo(distances_m: Array, cross_sections: Array, pulse_s: float, step_m: float) -> tuple[Array, Array]:
    """Give what comes back of a rectangular pulse: its convolution with the cross-section by distance (17 to 22).

    Parameters
    ----------
    distances_m, cross_sections
        (n,) what is met, where.
    pulse_s
        Length of the pulse.
    step_m
        Of the samples, in the way of the light there and back, smaller than the pulse.

    Returns
    -------
    (m,) ways there and back, from the pulse's start [m], and (m,) signal; its integral is that of the cross-section
    times the length of the pulse.

    Raises
    ------
    InvalidInputError
        The samples are farther apart than the pulse is long.
    """
    length = GROUP_VELOCITY_M_PER_S * pulse_s
    if not 0.0 < step_m < length:
        raise InvalidInputError("echo", f"samples of {step_m} m", f"above 0 and below the pulse's {length:g} m")
    arrivals = 2.0 * np.asarray(distances_m, dtype=np.float64)
    ways = np.arange(arrivals.min() - 2.0 * step_m, arrivals.max() + length + 2.0 * step_m, step_m)
    order = np.argsort(arrivals)
    total = np.concatenate([[0.0], np.cumsum(np.asarray(cross_sections)[order])])
    begun = total[np.searchsorted(arrivals[order], ways, side="right")]
    ended = total[np.searchsorted(arrivals[order], ways - length, side="right")]
    return ways, np.asarray(begun - ended)


def detected_range_m(ways_m: Array, signal: Array, detection: EchoDetection, pulse_s: float) -> float:
    """Give the range that an instrument makes of an echo, right for a surface that faces it [m].

    Parameters
    ----------
    ways_m, signal
        Of `echo`.
    detection
        Where in the echo the range is taken.
    pulse_s
        Length of the pulse: half of it is taken off where the middle of the echo counts.
    """
    length = GROUP_VELOCITY_M_PER_S * pulse_s
    if detection is EchoDetection.LEADING_EDGE:
        above: Array = np.flatnonzero(signal >= 0.5 * signal.max())
        return 0.5 * float(ways_m[above[0]])
    if detection is EchoDetection.CENTROID:
        return 0.5 * (float(signal @ ways_m / signal.sum()) - 0.5 * length)
    top = np.flatnonzero(signal >= (1.0 - 1e-9) * signal.max())
    return 0.5 * (0.5 * float(ways_m[top[0]] + ways_m[top[-1]]) - 0.5 * length)


def delay_by_water_m(water_mm: float) -> float:
    """Give how much longer a vertical way through the atmosphere seems, 4e-4 m per millimetre of its water [m].

    The source prints 0.02 m for 25 mm, which is the way there and back.
    """
    return 4e-4 * water_mm
