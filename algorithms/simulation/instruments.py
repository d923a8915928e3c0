"""Instruments to plan with: two whose figures the sources print, and two classes of phase scanners.

The classes are no product, and no maker's data sheet stands behind them. Their figures, told in `source`, are of the
size that panoramic phase scanners of about 2006 to 2011 have; who plans with one compares its data sheet with them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from algorithms.errors import InvalidInputError
from algorithms.simulation.holzmarkt import LMS_Z360I
from algorithms.simulation.scanner import VirtualScanner, scanner_with_step

STEP_TOLERANCE = 1.001


@dataclass(frozen=True)
class Instrument:
    """A scanner, or a class of them, with what is said of it."""

    name: str
    """As requests name it."""
    title: str
    scanner: VirtualScanner
    """Its figures; rows and columns are those of the usual step."""
    finest_step_rad: float
    points_per_s: float
    """Measurements in a second, for the time that a scan takes."""
    source: str
    """Where the figures come from."""

    def with_step(self, step_rad: float | None, *, shots: int = 1) -> VirtualScanner:
        """Give the scanner with a step on both circles, and each range the mean of some shots.

        Parameters
        ----------
        step_rad
            None: the usual one.
        shots
            The standard deviation of the mean of n shots is that of one over the root of n.

        Raises
        ------
        InvalidInputError
            The instrument cannot turn by so little.
        """
        if step_rad is not None and step_rad * STEP_TOLERANCE < self.finest_step_rad:
            finest = f"{np.degrees(self.finest_step_rad) / 0.9:.4g} gon or more"
            raise InvalidInputError(self.name, f"a step of {np.degrees(step_rad) / 0.9:.4g} gon", finest)
        scanner = self.scanner if step_rad is None else scanner_with_step(step_rad, self.scanner)
        return replace(
            scanner,
            range_noise_std_m=scanner.range_noise_std_m / np.sqrt(shots),
            range_noise_per_m=scanner.range_noise_per_m / np.sqrt(shots),
        )


def _panorama(lowest_deg: float, highest_deg: float, *, step_deg: float) -> VirtualScanner:
    """Give a scanner of the full circle with a vertical field of view, whose other figures are still to come."""
    lowest, highest, step = (float(each) for each in np.deg2rad([lowest_deg, highest_deg, step_deg]))
    return scanner_with_step(step, VirtualScanner(lowest_rad=lowest, highest_rad=highest))


LMS_Z420I = replace(
    _panorama(-40.0, 40.0, step_deg=0.12),
    max_range_m=800.0,
    min_range_m=2.0,
    range_noise_std_m=0.010,
    angle_noise_std_rad=float(np.deg2rad(0.002)),
    beam_divergence_rad=0.25e-3,
    beam_exit_diameter_m=0.01,
    echo_separation_m=1.5,
    reach_reflectance=0.8,
)
PHASE_79M = replace(
    _panorama(-65.0, 90.0, step_deg=0.072),
    max_range_m=79.0,
    min_range_m=1.0,
    range_noise_std_m=0.0005,
    range_noise_per_m=40e-6,
    range_noise_reflectance_exponent=0.5,
    angle_noise_std_rad=float(np.deg2rad(0.007)) / 2.0,
    beam_divergence_rad=0.22e-3,
    beam_exit_diameter_m=0.003,
    echo_separation_m=79.0,
    reach_reflectance=0.1,
)
PHASE_120M = replace(
    _panorama(-62.5, 90.0, step_deg=0.072),
    max_range_m=120.0,
    min_range_m=0.6,
    range_noise_std_m=0.0008,
    range_noise_per_m=30e-6,
    range_noise_reflectance_exponent=0.5,
    angle_noise_std_rad=float(np.deg2rad(0.009)) / 2.0,
    beam_divergence_rad=0.19e-3,
    beam_exit_diameter_m=0.003,
    echo_separation_m=120.0,
    reach_reflectance=0.9,
)
INSTRUMENTS: Mapping[str, Instrument] = MappingProxyType(
    {
        each.name: each
        for each in (
            Instrument(
                "riegl-lms-z360i",
                "Riegl LMS-Z360i, time of flight, 200 m, 12 mm",
                LMS_Z360I,
                float(np.deg2rad(0.01)),
                8_000.0,
                "Haring 2005 and Dold, Ripperda and Brenner 2007: 12 mm a shot, 2 mrad, 200 m at 80 % reflectance",
            ),
            Instrument(
                "riegl-lms-z420i",
                "Riegl LMS-Z420i, time of flight, 800 m, 10 mm",
                LMS_Z420I,
                float(np.deg2rad(0.01)),
                8_000.0,
                "Lichtenstein 2011: 10 mm, 0.25 mrad, 80 by 360 degrees, 800 m at 80 % reflectance",
            ),
            Instrument(
                "phase-79m",
                "class of phase scanners with an unambiguous range of 79 m",
                PHASE_79M,
                float(np.deg2rad(0.0018)),
                500_000.0,
                "a class, no data sheet: 360 degrees by -65 to 90, 0.22 mrad, 3 mm at the exit, 0.5 mm and 40 ppm a "
                "range at 50 % reflectance, 0.0035 degrees an angle, 79 m at 10 % reflectance",
            ),
            Instrument(
                "phase-120m",
                "class of phase scanners with a range of 120 m",
                PHASE_120M,
                float(np.deg2rad(0.009)),
                976_000.0,
                "a class, no data sheet: 360 degrees by -62.5 to 90, 0.19 mrad, 3 mm at the exit, 0.8 mm and 30 ppm a "
                "range at 50 % reflectance, 0.0045 degrees an angle, 120 m at 90 % reflectance",
            ),
        )
    }
)
"""By name. A phase scanner mixes what it meets over its whole range of unambiguity, so it never tells echoes apart."""
