"""Whether the difference of two surfaces is noise around zero, or shows a pattern: an offset, a tilt, stripes, waves.

The difference model of two flight strips of the source shows stripes in the flying direction: the scan lag, a
synchronisation error between the direction and the range measurement (Attwenger and Briese 2003, figures 5 and 19).
"""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array
from algorithms.deviations.rasters import Grid, GridValues
from algorithms.errors import InvalidInputError
from algorithms.probabilities import log_erlang_sf

LEAST_CELLS = 64
"""Fewer cells have no pattern."""
GROSS = 4.0
"""Robust standard deviations beyond which a cell is an object that only one surface has, and takes no part."""
RINGS, SECTORS = 12, 36
"""Rings of wave numbers in which noise is taken to be alike in all directions, and sectors of half a turn."""
ROUNDS = 5
"""Rounds of fitting the trend without gross cells."""
LEAST_WAVELENGTH = 6.0
"""Cells of the shortest wave: heights from 3 x 3 cells damp shorter ones, and along rows more than aslant."""
LEAST_WAVES = 3
"""Patterns with fewer waves across the area are no pattern but a form."""


@dataclass(frozen=True)
class SurfacePattern:
    """What is in a difference beside noise."""

    offset_m: float
    """Mean difference in the middle of the area [m]."""
    tilt_u_mrad: float
    """Slope of the difference along u (right, or east)."""
    tilt_v_mrad: float
    """Slope along v (up, or north)."""
    std_m: float
    """Standard deviation about offset and tilt, gross cells left out [m]."""
    gross_cells: int
    """Cells left out because only one surface has what stands there."""
    wavelength_m: float
    """Of the strongest wave [m]."""
    stripes_azimuth_gon: float
    """Direction in which its crests run: 0 along v (north), 100 along u (east)."""
    amplitude_m: float
    """Its amplitude [m]."""
    wave_p_value: float
    """Probability of one as strong somewhere in noise."""
    direction_gon: float
    """Direction in which stripes, periodic or not, run."""
    direction_p_value: float
    """Probability of so much more power in some direction than in others where nothing but noise is."""
    alpha: float
    significant: bool
    """Whether a wave or stripes are more than chance at the level alpha, each tested at half of it."""


def surface_pattern(differences_m: GridValues, grid: Grid, alpha: float = 0.01) -> SurfacePattern:
    """Test a difference model for patterns (MATH 11.6).

    Offset and tilt are fitted and gross cells left out. The spectrum of what is left is divided by the noise of each
    ring of wave numbers (median over ln 2), so that noise correlated alike in all directions does not count: then
    powers are exponentially distributed. The largest of M is by chance in 1 − (1 − e⁻ᵍ)ᴹ (Fisher 1929); the sum of m
    in a sector is a gamma variable. O(cells log cells).

    Parameters
    ----------
    differences_m
        Second surface minus first [m]; NaN where one is missing.
    grid
        Its cells.
    alpha
        Level of the test.

    Raises
    ------
    InvalidInputError
        Where the surfaces have too few cells in common.
    """
    rows, columns = np.nonzero(np.isfinite(differences_m))
    if len(rows) < LEAST_CELLS:
        raise InvalidInputError(
            "comparison", f"the surfaces have {len(rows)} cells in common", f"{LEAST_CELLS} or more: smaller cells"
        )
    v, u = (rows - rows.mean()) * grid.cell_m, (columns - columns.mean()) * grid.cell_m
    design = np.column_stack([np.ones(len(u)), u, v])
    values = differences_m[rows, columns]
    kept = np.ones(len(values), dtype=np.bool_)
    trend, left = np.array([np.median(values), 0.0, 0.0]), values - np.median(values)
    for _ in range(ROUNDS):
        limit = GROSS * 1.4826 * float(np.median(np.abs(left[kept] - np.median(left[kept]))))
        kept = np.abs(left) <= max(limit, 1e-12)
        trend = np.linalg.lstsq(design[kept], values[kept], rcond=None)[0]
        left = values - design @ trend
    field, mask = np.zeros(grid.shape), np.zeros(grid.shape)
    field[rows[kept], columns[kept]], mask[rows[kept], columns[kept]] = left[kept], 1.0
    spectrum = _Spectrum.of(field, mask, grid.cell_m)
    frequency, wave_p = spectrum.strongest()
    direction, direction_p = spectrum.direction()
    phases = 2.0 * np.pi * (frequency[0] * u[kept] + frequency[1] * v[kept])
    cosine, sine = np.linalg.lstsq(np.column_stack([np.cos(phases), np.sin(phases)]), left[kept], rcond=None)[0]
    return SurfacePattern(
        offset_m=float(trend[0]),
        tilt_u_mrad=float(1e3 * trend[1]),
        tilt_v_mrad=float(1e3 * trend[2]),
        std_m=float(np.std(left[kept])),
        gross_cells=int((~kept).sum()),
        wavelength_m=float(1.0 / np.hypot(*frequency)),
        stripes_azimuth_gon=_crests_gon(np.arctan2(frequency[1], frequency[0])),
        amplitude_m=float(np.hypot(cosine, sine)),
        wave_p_value=wave_p,
        direction_gon=direction,
        direction_p_value=direction_p,
        alpha=alpha,
        significant=min(wave_p, direction_p) < 0.5 * alpha,
    )


def _crests_gon(wave_angle_rad: float) -> float:
    """Give the azimuth of the crests of a wave that runs at an angle from u towards v, 0..200 gon."""
    return float((-wave_angle_rad * 200.0 / np.pi) % 200.0)


@dataclass(frozen=True, eq=False)
class _Spectrum:
    """Powers at the wave numbers of a half plane, as multiples of the noise of their ring."""

    fu: Array
    fv: Array
    """(m,) wave numbers [1/m]."""
    powers: Array
    """(m,)."""

    @staticmethod
    def of(field: GridValues, mask: GridValues, cell_m: float) -> "_Spectrum":
        """Transform a field with gaps and normalise its powers."""
        rows, columns = field.shape
        transformed = np.abs(np.fft.rfft2(field - mask * field.sum() / mask.sum())) ** 2
        fv, fu = np.meshgrid(np.fft.fftfreq(rows, cell_m), np.fft.rfftfreq(columns, cell_m), indexing="ij")
        radius = np.hypot(fu * columns * cell_m, fv * rows * cell_m)  # waves across the area
        half = (fu > 0.0) | (fv > 0.0)  # of fu = 0 the other half is the mirror image
        used = half & (radius >= LEAST_WAVES) & (np.hypot(fu, fv) <= 1.0 / (LEAST_WAVELENGTH * cell_m))
        fu, fv, powers = fu[used], fv[used], transformed[used]
        lengths = np.hypot(fu, fv)
        order = np.argsort(lengths)
        for ring in np.array_split(order, min(RINGS, max(1, len(order) // 30))):
            noise = float(np.median(powers[ring])) / np.log(2.0)
            powers[ring] /= noise if noise > 0.0 else 1.0
        return _Spectrum(fu, fv, powers)

    def strongest(self) -> tuple[tuple[float, float], float]:
        """Give the wave number of the largest power and the probability of one as large in noise."""
        if not len(self.powers):
            raise InvalidInputError("comparison", "the area is too narrow for a pattern", "smaller cells")
        k = int(np.argmax(self.powers))
        chance = -np.expm1(len(self.powers) * np.log1p(-min(np.exp(-self.powers[k]), 1.0 - 1e-16)))
        return (float(self.fu[k]), float(self.fv[k])), float(chance)

    def direction(self) -> tuple[float, float]:
        """Give the azimuth of stripes in the sector of the most surprising power, with its probability [gon]."""
        angles = np.arctan2(self.fv, self.fu) % np.pi
        sectors = np.floor(angles / np.pi * SECTORS + 0.5).astype(np.int64) % SECTORS
        counts = np.bincount(sectors, minlength=SECTORS)
        sums = np.bincount(sectors, self.powers, minlength=SECTORS)
        log_p = [log_erlang_sf(float(total), int(count)) for total, count in zip(sums, counts, strict=True)]
        k = int(np.argmin(log_p))
        return _crests_gon(k * np.pi / SECTORS), float(min(1.0, SECTORS * np.exp(log_p[k])))
