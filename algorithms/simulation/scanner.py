"""The virtual scanner's data sheet."""

from dataclasses import dataclass, replace

import numpy as np

from algorithms.arrays import Array, Points, Scalars
from algorithms.errors import InvalidInputError
from algorithms.simulation.systematic_errors import IN_ADJUSTMENT, SystematicErrors

MAX_BEAMS = 2**31
"""The scan's grid counts points with 32 bits."""
NOT_NEGATIVE = (
    "range_noise_std_m",
    "range_noise_per_m",
    "range_noise_footprint",
    "angle_noise_std_rad",
    "beam_divergence_rad",
    "beam_exit_diameter_m",
    "echo_separation_m",
    "intensity_noise",
    "intensity_reference_m",
    "attenuation_db_per_km",
)


@dataclass(frozen=True)
class VirtualScanner:
    """Options of a panorama scanner with a vertical and a horizontal circle."""

    rows: int = 750
    """Directions on the vertical circle, from the top down."""
    columns: int = 1800
    """Directions on the horizontal circle, anticlockwise seen from above; without a narrower field of view the full
    circle, from azimuth -pi."""
    lowest_rad: float = float(np.deg2rad(-60.0))
    """Lower end of the vertical field of view: elevation above the scanner's xy plane."""
    highest_rad: float = float(np.deg2rad(90.0))
    """Upper end of the vertical field of view."""
    leftmost_rad: float = -float(np.pi)
    """First azimuth of the horizontal field of view; with `rightmost_rad` a fine scan of a part of the panorama."""
    rightmost_rad: float = float(np.pi)
    """Last azimuth of the horizontal field of view."""
    max_range_m: float = 120.0
    """Nothing farther away comes back."""
    min_range_m: float = 0.4
    """Nothing nearer comes back."""
    range_noise_std_m: float = 0.002
    """Standard deviation of a range, the part that is always there."""
    range_noise_per_m: float = 0.0
    """Part that grows with distance: standard deviation per metre of range."""
    range_noise_footprint: float = 0.0
    """Part from slanting incidence: times radius of the footprint times tangent of the incidence angle."""
    range_noise_reflectance_exponent: float = 0.0
    """The whole standard deviation is divided by (reflectance / 0.5) to this power; 0.5 is usual for weak echoes."""
    angle_noise_std_rad: float = 20e-6
    """Standard deviation of each of the two circle readings."""
    beam_divergence_rad: float = 0.3e-3
    """Full divergence of the beam."""
    beam_exit_diameter_m: float = 0.003
    """Diameter of the beam at the instrument."""
    mixed_pixels: bool = True
    """Whether a beam that meets two depths returns a mixture of both."""
    echo_separation_m: float = 1.0
    """Echoes farther apart than this do not mix; the strongest is returned."""
    unmixed_share: float = 0.0
    """Share of the beams at depth edges that return the range of one of the surfaces they meet, drawn by its part of
    the signal, instead of the mixture: the range is right and the direction wrong, by up to the footprint's radius."""
    max_incidence_rad: float = float(np.deg2rad(86.0))
    """Faces seen flatter than this do not come back."""
    reach_reflectance: float = 0.1
    """Reflectance times cosine of incidence that is just seen at the maximum range; the reach of darker or flatter
    surfaces shrinks with its square root."""
    glass_return_incidence_rad: float = float(np.deg2rad(4.0))
    """Panes met nearer to the normal than this come back."""
    glass_pass_probability: float = 0.3
    """Share of the other beams on panes that come back from what stands behind; the rest is lost."""
    mixed_intensities: bool = False
    """Whether beams that meet two reflectances return the signal of the whole footprint rather than of its centre."""
    tail_share: float = 0.0
    """With mixed intensities: share of the beam's power in a weaker bar beside it, along the horizontal circle, which
    draws a tail beside bright targets (Haring 2003, inhomogeneous beam)."""
    tail_offset_rad: float = 0.0
    """Angle from the beam to that bar."""
    dropout_probability: float = 0.0
    """Share of beams lost without any reason."""
    intensity_noise: float = 0.03
    """Relative standard deviation of the intensity (speckle)."""
    intensity_reference_m: float = 0.0
    """Distance at which a white surface that faces the beam has intensity 1; it falls with the square of the distance
    (radar equation). 0: the instrument takes the distance out."""
    attenuation_db_per_km: float = 0.0
    """Of the air in one direction: 0.2 to 0.8 where it is clear, 3.9 in haze; it weakens intensity and reach."""
    systematic: SystematicErrors = IN_ADJUSTMENT
    """What the instrument measures wrong in the same way each time; nothing unless given."""

    def __post_init__(self) -> None:
        """Refuse a data sheet that no instrument could have."""
        if self.rows < 1 or self.columns < 1 or self.rows * self.columns >= MAX_BEAMS:
            raise InvalidInputError("scanner", f"{self.rows} rows by {self.columns} columns", "1 to 2^31 beams")
        if not -np.pi / 2 <= self.lowest_rad < self.highest_rad <= np.pi / 2:
            advice = "-pi/2 <= lowest < highest <= pi/2"
            raise InvalidInputError("scanner", "the vertical field of view is empty or beyond zenith or nadir", advice)
        if not -np.pi <= self.leftmost_rad < self.rightmost_rad <= np.pi:
            advice = "-pi <= leftmost < rightmost <= pi"
            raise InvalidInputError("scanner", "the horizontal field of view is empty or more than a circle", advice)
        if not 0.0 <= self.min_range_m < self.max_range_m:
            raise InvalidInputError("scanner", f"ranges from {self.min_range_m} to {self.max_range_m} m")
        if not self.reach_reflectance > 0.0:
            raise InvalidInputError("scanner", f"reach_reflectance is {self.reach_reflectance}", "above 0")
        for name in NOT_NEGATIVE:
            if not getattr(self, name) >= 0.0:
                raise InvalidInputError("scanner", f"{name} is {getattr(self, name)}", "0 or more")
        for name in ("glass_pass_probability", "dropout_probability", "unmixed_share", "tail_share"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise InvalidInputError("scanner", f"{name} is {getattr(self, name)}", "0 to 1")

    @property
    def row_step_rad(self) -> float:
        """Angle between rows [rad]."""
        return (self.highest_rad - self.lowest_rad) / self.rows

    @property
    def column_step_rad(self) -> float:
        """Angle between columns [rad]."""
        return (self.rightmost_rad - self.leftmost_rad) / self.columns

    def elevations(self, rows: Array) -> Scalars:
        """Give the nominal elevation of each row number (n,), the centre of its cell [rad]."""
        return np.asarray(self.highest_rad - (rows + 0.5) * self.row_step_rad)

    def azimuths(self, columns: Array) -> Scalars:
        """Give the nominal azimuth of each column number (n,), the centre of its cell [rad]."""
        return np.asarray((columns + 0.5) * self.column_step_rad + self.leftmost_rad)


def scanner_with_step(step_rad: float, scanner: VirtualScanner | None = None) -> VirtualScanner:
    """Give a scanner with the same angular step on both circles (rounded to whole numbers of rows and columns)."""
    base = scanner or VirtualScanner()
    return replace(
        base,
        rows=max(1, round((base.highest_rad - base.lowest_rad) / step_rad)),
        columns=max(1, round(2.0 * np.pi / step_rad)),
    )


def directions_of(azimuths: Scalars, elevations: Scalars) -> Points:
    """Turn circle readings (n,) [rad] into unit directions (n, 3) of the scan frame."""
    directions = np.empty((len(azimuths), 3))
    horizontal = np.cos(elevations)
    np.multiply(horizontal, np.cos(azimuths), out=directions[:, 0])
    np.multiply(horizontal, np.sin(azimuths), out=directions[:, 1])
    np.sin(elevations, out=directions[:, 2])
    return directions
