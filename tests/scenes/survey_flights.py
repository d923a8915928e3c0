"""A second, independent simulator of airborne strips: rasters of fractal land, GNSS waves, drifting attitude.

It shares nothing with `algorithms.simulation.strip_flights`, and knows nothing of what the corrections are like: errors
are waves in time, random walks and a bore-sight, not polynomials.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64
from scipy import ndimage
from scipy.spatial.transform import Rotation

from algorithms.arrays import Array, Generator, Points, Scalars

GON = np.pi / 200.0
PIXEL_M = 0.5
MARGIN_M = 260.0
MODES = 60
"""Waves that make the land."""
NODES_PER_S = 50.0


@dataclass(frozen=True)
class SurveyErrors:
    """Sizes of errors, as standard deviations of what is drawn for each strip."""

    offset_m: float = 0.1
    """Of the place of a strip along each axis [m]."""
    wave_m: float = 0.03
    """Amplitude of waves of the height; of those in plan two thirds [m]."""
    periods_s: tuple[float, float] = (8.0, 30.0)
    """Range of their periods [s]."""
    attitude_gon: float = 0.01
    """Of roll, pitch and heading of a strip [gon]."""
    walk_gon: float = 0.005
    """Of their random walk over a strip [gon]."""
    boresight_gon: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Turn of the scanner against its inertial unit about forward, left, up [gon]."""


@dataclass(frozen=True)
class Survey:
    """A block of flight lines, and what is measured along them."""

    length_m: float = 700.0
    lines: int = 3
    crossing: int = 2
    azimuth_deg: float = 37.0
    """Of the first line, from +y clockwise [degree]."""
    height_m: float = 280.0
    speed_m_s: float = 45.0
    half_angle_deg: float = 26.0
    sidelap: float = 0.45
    rows_per_s: float = 40.0
    points_per_row: int = 150
    range_std_m: float = 0.015
    angle_std_rad: float = 2e-5

    @property
    def width_m(self) -> float:
        """Width of a strip [m]."""
        return float(2.0 * self.height_m * np.tan(np.radians(self.half_angle_deg)))

    def legs(self) -> list[tuple[str, Array, Array]]:
        """Return name, start and end (2,) in plan of every line [m]."""
        a = np.radians(self.azimuth_deg)
        ahead, right = np.array([np.sin(a), np.cos(a)]), np.array([np.cos(a), -np.sin(a)])
        step, width = self.width_m * (1.0 - self.sidelap), self.width_m
        found = []
        for k in range(self.lines):
            ends = [k * step * right, k * step * right + self.length_m * ahead]
            first, last = ends if k % 2 == 0 else ends[::-1]
            found.append((f"line {k + 1}", first, last))
        across = (self.lines - 1) * step
        for k in range(self.crossing):
            at = self.length_m * (0.15 + 0.7 * k / max(self.crossing - 1, 1))
            ends = [at * ahead - 0.4 * width * right, at * ahead + (across + 0.4 * width) * right]
            first, last = ends if k % 2 == 0 else ends[::-1]
            found.append((f"cross {k + 1}", first, last))
        return found


@dataclass(frozen=True, eq=False)
class Country:
    """Heights of ground and roofs in a raster, and the roof faces."""

    low_m: Float64[Array, "2"]
    heights_m: Float64[Array, "rows columns"]
    ground_m: Float64[Array, "rows columns"]
    faces_m: Float64[Array, "faces 4 3"]
    """(faces, 4, 3) points well inside of each roof face [m]."""

    @staticmethod
    def drawn(survey: Survey, seed: int) -> "Country":
        """Make land under a survey: waves of all lengths, a dam, houses with hipped and level roofs."""
        rng = np.random.default_rng([seed, 5])
        ends = np.array([end for _, *pair in survey.legs() for end in pair])
        low, high = ends.min(axis=0) - MARGIN_M, ends.max(axis=0) + MARGIN_M
        columns, rows = np.ceil((high - low) / PIXEL_M).astype(np.int64)
        x, y = low[0] + PIXEL_M * np.arange(columns), low[1] + PIXEL_M * np.arange(rows)
        ground = np.zeros((rows, columns))
        for length in np.geomspace(60.0, 900.0, MODES):
            bearing, phase = rng.uniform(0.0, 2.0 * np.pi, 2)
            kx, ky = 2.0 * np.pi / length * np.array([np.cos(bearing), np.sin(bearing)])
            wave = np.exp(1j * (ky * y + phase))[:, None] * np.exp(1j * kx * x)[None]
            ground += 9.0 * (length / 900.0) ** 1.2 * wave.imag / np.sqrt(MODES / 8)
        middle = 0.5 * (low + high)
        ground += np.clip(6.0 - 0.45 * np.abs(y[:, None] - middle[1] - 0.2 * (x[None] - middle[0])), 0.0, 4.0)
        heights, faces = ground.copy(), []
        for cx, cy in rng.uniform(low + 30.0, high - 30.0, (int(np.prod(high - low) / 5000.0), 2)):
            faces += _built(heights, ground, low, np.array([cx, cy]), rng)
        return Country(low, heights, ground, np.array(faces).reshape(-1, 4, 3))

    def at(self, xy: Array, raster: Array | None = None) -> Scalars:
        """Interpolate heights (n,) at places (n, 2) [m]."""
        cells = ((xy - self.low_m) / PIXEL_M).T[::-1]
        values = self.heights_m if raster is None else raster
        return np.asarray(ndimage.map_coordinates(values, cells, order=1, mode="nearest"))

    def control(self, survey: Survey, seed: int, std_m: float = 0.01) -> list[tuple[str, Points]]:
        """Measure roof faces near the corners of the block (four points each) and single heights of the ground."""
        rng = np.random.default_rng([seed, 6])
        lines = [pair for name, *pair in survey.legs() if name.startswith("line")]
        corners = [*lines[0], *lines[-1]]
        found = []
        for number, corner in enumerate(corners):
            near = np.hypot(*(self.faces_m.mean(axis=1)[:, :2] - corner).T)
            for k in np.argsort(near)[:5].tolist():
                face = self.faces_m[k]
                found.append((f"roof {number} {k}", face + rng.normal(0.0, std_m, face.shape)))
            around = corner + rng.uniform(-60.0, 60.0, (80, 2))
            ring = np.array([[a, b] for a in (-6.0, 0.0, 6.0) for b in (-6.0, 0.0, 6.0)])
            every = (around[:, None] + ring).reshape(-1, 2)
            rise = (self.at(every) - self.at(every, self.ground_m)).reshape(len(around), -1)
            for k in np.flatnonzero((rise < 1e-6).all(axis=1))[:3].tolist():
                point = np.append(around[k], self.at(around[k][None])[0])[None]
                found.append((f"ground {number} {k}", point + rng.normal(0.0, std_m, point.shape)))
        return found


@dataclass(frozen=True, eq=False)
class SurveyedStrip:
    """A strip as delivered, its trajectory as reported, and the truth."""

    name: str
    times_s: Scalars
    points_m: Points
    """(n, 3) as recorded, with the noise of ranges and angles [m]."""
    silent_m: Points
    """(n, 3) as they would be recorded without that noise [m]."""
    true_m: Points
    """(n, 3) where the beams met the land [m]."""
    path_times_s: Scalars
    path_m: Points
    """(k, 3) reported places of the scanner [m]."""
    angles_rad: Points
    """(k, 3) reported roll (right wing down), pitch (nose up), heading (clockwise from +y) [rad]."""


def surveyed(survey: Survey, country: Country, errors: SurveyErrors, seed: int) -> list[SurveyedStrip]:
    """Fly all lines."""
    found, start = [], 100.0
    for number, (name, first, last) in enumerate(survey.legs()):
        rng = np.random.default_rng([seed, number, 7])
        strip = _strip(survey, country, errors, name, first, last, start, rng)
        found.append(strip)
        start = float(np.ceil(strip.times_s[-1] + 200.0))
    return found


def without_errors(errors: SurveyErrors) -> SurveyErrors:
    """Return errors of size zero but for the bore-sight."""
    return replace(errors, offset_m=0.0, wave_m=0.0, attitude_gon=0.0, walk_gon=0.0)


def _strip(
    survey: Survey,
    country: Country,
    errors: SurveyErrors,
    name: str,
    first: Array,
    last: Array,
    start_s: float,
    rng: Generator,
) -> SurveyedStrip:
    length = float(np.hypot(*(last - first)))
    rows = int(length / survey.speed_m_s * survey.rows_per_s)
    step = 1.0 / (survey.rows_per_s * survey.points_per_row)
    times = start_s + step * np.arange(rows * survey.points_per_row)
    nodes = np.arange(start_s - 1.0, times[-1] + 1.0, 1.0 / NODES_PER_S)
    ahead = (last - first) / length
    heading = np.arctan2(*ahead)
    xy = first + (survey.speed_m_s * (nodes - start_s))[:, None] * ahead
    level = float(country.at(first + np.linspace(0.0, 1.0, 50)[:, None] * (last - first)).mean())
    place = np.column_stack([xy, np.full(len(nodes), level + survey.height_m)])
    place += np.column_stack([_turbulence(nodes, size, rng) for size in (1.5, 1.5, 2.0)])
    roll, pitch, crab = (
        mean + np.radians(_turbulence(nodes, size, rng)) for mean, size in ((0.0, 1.0), (0.03, 0.5), (0.02, 0.5))
    )
    angles = np.column_stack([roll, pitch, heading + crab])
    wrong = np.column_stack(
        [
            errors.offset_m * rng.normal() + share * errors.wave_m * _waves(nodes, errors.periods_s, rng)
            for share in (0.67, 0.67, 1.0)
        ]
    )
    turned = GON * np.column_stack(
        [errors.attitude_gon * rng.normal() + errors.walk_gon * _walk(nodes, start_s, times[-1], rng) for _ in range(3)]
    )
    sides = np.radians(survey.half_angle_deg) * np.tile(np.linspace(1.0, -1.0, survey.points_per_row), rows)
    where = np.column_stack([np.interp(times, nodes, place[:, k]) for k in range(3)])
    held = _attitude(np.column_stack([np.interp(times, nodes, angles[:, k]) for k in range(3)]))
    mount = Rotation.from_rotvec(GON * np.array(errors.boresight_gon))
    beams = np.column_stack([np.zeros(len(sides)), np.sin(sides), -np.cos(sides)])
    rays = held.apply(mount.apply(beams))
    ranges, met = _met(country, where, rays)
    told_place = place - wrong
    told_angles = angles - turned
    told_where = np.column_stack([np.interp(times, nodes, told_place[:, k]) for k in range(3)])
    told_held = _attitude(np.column_stack([np.interp(times, nodes, told_angles[:, k]) for k in range(3)]))
    silent = told_where + told_held.apply(ranges[:, None] * beams)
    noisy = sides + rng.normal(0.0, survey.angle_std_rad, len(sides))
    beams = np.column_stack([np.zeros(len(sides)), np.sin(noisy), -np.cos(noisy)])
    read = ranges + rng.normal(0.0, survey.range_std_m, len(ranges))
    recorded = told_where + told_held.apply(read[:, None] * beams)
    true = where + ranges[:, None] * rays
    return SurveyedStrip(
        name, times[met], recorded[met], silent[met], true[met], nodes, told_place, told_angles
    )  # fmt: skip


def _attitude(angles: Points) -> Rotation:
    """Return world from body (forward, left, up) of roll, pitch, heading."""
    roll, pitch, heading = angles.T
    return Rotation.from_euler("ZYX", np.column_stack([0.5 * np.pi - heading, -pitch, roll]))


def _turbulence(times: Scalars, size: float, rng: Generator) -> Scalars:
    """Return smooth noise of standard deviation near `size`, with periods from 3 to 40 s."""
    periods, phases = np.geomspace(3.0, 40.0, 8), rng.uniform(0.0, 2.0 * np.pi, 8)
    weights = rng.normal(0.0, 1.0, 8) * np.sqrt(periods / periods.max())
    return np.asarray(
        size * (weights[:, None] * np.sin(2.0 * np.pi * times / periods[:, None] + phases[:, None])).sum(0)
    )


def _waves(times: Scalars, periods_s: tuple[float, float], rng: Generator) -> Scalars:
    """Return a wave of amplitude 1, its energy in two periods."""
    found = np.zeros(len(times))
    for share in (0.8, 0.6):
        period, phase = np.exp(rng.uniform(*np.log(periods_s))), rng.uniform(0.0, 2.0 * np.pi)
        found += share * np.sin(2.0 * np.pi * times / period + phase)
    return found


def _walk(times: Scalars, first_s: float, last_s: float, rng: Generator) -> Scalars:
    """Return a random walk that is zero in the middle and has standard deviation 1 after the length of the strip."""
    steps = rng.normal(0.0, np.sqrt(1.0 / (NODES_PER_S * (last_s - first_s))), len(times))
    walk = ndimage.uniform_filter1d(np.cumsum(steps), int(NODES_PER_S))
    return np.asarray(walk - np.interp(0.5 * (first_s + last_s), times, walk))


def _met(country: Country, where: Points, rays: Points) -> tuple[Scalars, Array]:
    """Return ranges (n,) to the land, and which rays settle on it; those at walls do not."""
    z = country.at(where[:, :2])
    moved = np.full(len(rays), np.inf)
    for _ in range(12):
        ranges = (z - where[:, 2]) / rays[:, 2]
        new = country.at(where[:, :2] + ranges[:, None] * rays[:, :2])
        moved, z = np.abs(new - z), 0.3 * z + 0.7 * new
    return (z - where[:, 2]) / rays[:, 2], moved < 1e-4


def _built(heights: Array, ground: Array, low: Array, middle: Array, rng: Generator) -> Sequence[Array]:
    """Put a house with a hipped or a level roof on the ground; return points of its larger faces."""
    half, wide, bearing = rng.uniform(7.0, 13.0), rng.uniform(5.0, 8.0), rng.uniform(0.0, np.pi)
    slope, eaves = rng.choice([0.0, 0.35, 0.6, 0.9]), rng.uniform(3.0, 9.0)
    reach = int(np.ceil((half + wide) / PIXEL_M))
    column, row = np.rint((middle - low) / PIXEL_M).astype(np.int64)
    window = np.s_[row - reach : row + reach + 1, column - reach : column + reach + 1]
    offsets = PIXEL_M * np.arange(-reach, reach + 1)
    x, y = np.meshgrid(offsets, offsets)
    if (heights[window] > ground[window]).any():
        return []
    c, s = np.cos(bearing), np.sin(bearing)
    u, v = c * x + s * y, -s * x + c * y
    on = (np.abs(u) < half) & (np.abs(v) < wide)
    base = float(ground[row, column]) + eaves
    to_edge = np.minimum(wide - np.abs(v), half - np.abs(u))
    heights[window] = np.where(on, base + slope * to_edge, heights[window])
    at = low + PIXEL_M * np.array([column, row])
    faces = []
    for side in (1.0, -1.0):
        inner = np.array([0.2, 0.2, 0.8, 0.8]) * wide if slope else np.array([0.1, 0.1, 0.85, 0.85]) * wide
        along = (
            (half - wide) * np.array([-1.0, 1.0, 1.0, -1.0]) * 0.9 if slope else 0.8 * half * np.array([-1, 1, 1, -1])
        )
        spot = np.column_stack([c * along - s * side * inner, s * along + c * side * inner])
        faces.append(np.column_stack([at + spot, base + slope * (wide - inner)]))
    return faces if half - wide > 2.0 else []
