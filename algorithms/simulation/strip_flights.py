"""A flight over a made-up landscape: strips with planted errors of place, attitude and mount, and what misleads.

The landscape is a surface of heights with gabled houses; trees scatter points in their crowns, cars stand elsewhere in
every strip, and some squares are higher in some strips (heaps, high grass): what is homologous by place is not the same
surface there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from algorithms.arrays import Array, Flags, Generator, Points, Scalars, Vector3
from algorithms.strips.corrections import Degrees
from algorithms.strips.strip import Strip, Trajectory

HOUSE_CELL_M, TREE_CELL_M, CAR_CELL_M = 45.0, 18.0, 60.0
HEIGHT_STEPS = 14
"""Of the search for where a ray meets the surface of heights."""
MET_M = 1e-4
CAR_M = (4.4, 1.8, 1.5)


@dataclass(frozen=True)
class FlightLine:
    """A straight flight."""

    name: str
    start_m: tuple[float, float]
    end_m: tuple[float, float]


@dataclass(frozen=True)
class Flight:
    """Lines, and how the scanner measures along them."""

    lines: tuple[FlightLine, ...]
    height_m: float = 500.0
    """Above z = 0 [m]."""
    speed_m_s: float = 50.0
    lines_per_s: float = 50.0
    points_per_line: int = 350
    half_angle_rad: float = np.radians(20.0)
    oscillating: bool = False
    """Whether the mirror swings to and fro; else it turns, and all lines run one way."""
    range_std_m: float = 0.02
    angle_std_rad: float = 2e-5
    lag_rad: float = 0.0
    """By how much angles lag behind the swinging mirror [rad]."""
    trajectory_per_s: float = 100.0

    @staticmethod
    def block(
        strips: int, length_m: float, *, overlap: float = 0.4, cross: int = 2, height_m: float = 500.0
    ) -> tuple[FlightLine, ...]:
        """Give parallel lines along x, flown to and fro, and cross strips at the ends, as the source wants blocks."""
        width = 2.0 * height_m * np.tan(np.radians(20.0))
        step = width * (1.0 - overlap)
        lines = []
        for k in range(strips):
            ends = [(0.0, k * step), (length_m, k * step)]
            first, last = ends if k % 2 == 0 else ends[::-1]
            lines.append(FlightLine(f"strip-{k + 1}", first, last))
        for k in range(cross):
            x = length_m * (0.1 + 0.8 * k / max(cross - 1, 1))
            lines.append(FlightLine(f"cross-{k + 1}", (x, -0.5 * width), (x, (strips - 1) * step + 0.5 * width)))
        return tuple(lines)


@dataclass(frozen=True)
class Landscape:
    """What is flown over."""

    seed: int = 0
    relief_m: float = 12.0
    houses: float = 0.5
    """Share of the cells of 45 m with a house."""
    trees: float = 0.3
    """Share of the cells of 18 m with a tree."""
    cars: float = 0.5
    """Share of the cells of 60 m with a car, elsewhere in every strip."""
    raised: int = 0
    """Squares that are higher in every second strip."""
    raised_m: float = 0.3
    raised_side_m: float = 14.0

    def terrain(self, x: Scalars, y: Scalars) -> Scalars:
        """Give heights of the ground (n,) [m]."""
        return np.asarray(
            self.relief_m * (np.sin(x / 140.0) + 0.7 * np.cos(y / 110.0) + 0.3 * np.sin((x + 2.0 * y) / 60.0))
        )

    def surface(self, x: Scalars, y: Scalars) -> Scalars:
        """Give heights of ground and roofs (n,) [m]."""
        cells = np.floor(np.column_stack([x, y]) / HOUSE_CELL_M).astype(np.int64)
        there, middle, turn, half, width, slope = self._houses(cells)
        c, s = np.cos(turn), np.sin(turn)
        u, v = c * (x - middle[:, 0]) + s * (y - middle[:, 1]), -s * (x - middle[:, 0]) + c * (y - middle[:, 1])
        on = there & (np.abs(u) < half) & (np.abs(v) < width)
        return np.where(on, middle[:, 2] + slope * (width - np.abs(v)), self.terrain(x, y))

    def roof_faces(self, low_m: tuple[float, float], high_m: tuple[float, float]) -> Float64[Array, "faces 4 3"]:
        """Give four points on each roof face of the houses in a rectangle, a metre inside, as control is measured."""
        first, last = (np.floor(np.array(corner) / HOUSE_CELL_M).astype(np.int64) for corner in (low_m, high_m))
        cells = np.stack(np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(first, last, strict=True))), -1).reshape(
            -1, 2
        )
        there, middle, turn, half, width, slope = self._houses(cells)
        there &= ((middle[:, :2] > low_m) & (middle[:, :2] < high_m)).all(axis=1)
        middle, turn, half, width, slope = (each[there] for each in (middle, turn, half, width, slope))
        faces = []
        for side in (1.0, -1.0):
            along = (half - 1.0)[:, None] * np.array([-1.0, 1.0, 1.0, -1.0])
            inside = np.stack([np.ones_like(width), np.ones_like(width), width - 1.0, width - 1.0], axis=1)
            c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
            faces.append(
                np.stack(
                    [
                        middle[:, :1] + c * along - s * side * inside,
                        middle[:, 1:2] + s * along + c * side * inside,
                        middle[:, 2:] + slope[:, None] * (width[:, None] - inside),
                    ],
                    axis=-1,
                )
            )
        return np.concatenate(faces)

    def _houses(self, cells: Array) -> tuple[Flags, Points, Scalars, Scalars, Scalars, Scalars]:
        """Give of cells (n, 2) whether a house is there, middle at the eaves, turn, half length and width, slope."""
        chance, dx, dy, turn, slope, long, wide = _of_cells(cells, self.seed, 7)
        xy = (cells + 0.3 + 0.4 * np.column_stack([dx, dy])) * HOUSE_CELL_M
        middle = np.column_stack([xy, self.terrain(*xy.T) + 6.0])
        return chance < self.houses, middle, np.pi * turn, 6.0 + 4.0 * long, 4.0 + 2.0 * wide, 0.3 + 0.6 * slope

    def squares(self, lines: Sequence[FlightLine]) -> Float64[Array, "k 2"]:
        """Give the middles of the raised squares [m]."""
        rng = np.random.default_rng([self.seed, 77])
        ends = np.array([end for line in lines for end in (line.start_m, line.end_m)])
        return np.asarray(rng.uniform(ends.min(axis=0), ends.max(axis=0), (self.raised, 2)))


@dataclass(frozen=True, eq=False)
class PlantedErrors:
    """What the corrections of the strips ought to be."""

    degrees: Degrees
    coefficients: Float64[Array, "strips c"]
    """What corrects each strip, in the order of `Degrees.names` [m, rad]."""
    boresight_rad: Vector3 = field(default_factory=lambda: np.zeros(3))
    """What corrects the mount [rad]."""
    wave_m: float = 0.0
    """Amplitude of an oscillation of the heights of the path [m]."""
    wave_s: float = 10.0
    """Its period [s]."""


@dataclass(frozen=True, eq=False)
class FlownStrip:
    """A strip as it is delivered, and the truth."""

    strip: Strip
    true_points: Points
    """(n, 3) where the points are in truth, but for the noise of the measurement [m]."""
    misleading: Flags
    """(n,) on trees, cars and raised squares."""
    angles_rad: Scalars
    """(n,) of the mirror, from nadir to the left [rad]."""


def fly(flight: Flight, land: Landscape, errors: PlantedErrors, seed: int) -> list[FlownStrip]:
    """Measure all strips.

    Parameters
    ----------
    flight, land
        How and over what.
    errors
        What is wrong with the reported paths: corrections of the strips by these values make them right.
    seed
        Of the noise.
    """
    squares = land.squares(flight.lines)
    flown, start_s = [], 0.0
    for number, line in enumerate(flight.lines):
        rng = np.random.default_rng([seed, number])
        flown.append(_flown(flight, land, errors, squares if number % 2 else squares[:0], number, line, start_s, rng))
        start_s = float(np.ceil(flown[-1].strip.times_s[-1] + 60.0))
    return flown


def _flown(
    flight: Flight,
    land: Landscape,
    errors: PlantedErrors,
    squares: Array,
    number: int,
    line: FlightLine,
    start_s: float,
    rng: Generator,
) -> FlownStrip:
    first, last = np.array(line.start_m), np.array(line.end_m)
    length = float(np.hypot(*(last - first)))
    along = (last - first) / length
    rows = int(length / flight.speed_m_s * flight.lines_per_s)
    times = start_s + np.arange(rows * flight.points_per_line) / (flight.lines_per_s * flight.points_per_line)
    phase = np.linspace(-1.0, 1.0, flight.points_per_line)
    directions = np.ones(len(times), dtype=np.int8)
    angles = np.tile(phase, rows)
    if flight.oscillating:
        directions = np.repeat((np.arange(rows) % 2 == 0).astype(np.int8), flight.points_per_line)
        angles = np.where(directions == 1, angles, -angles)
    angles = flight.half_angle_rad * angles
    wobble = rng.uniform(0.0, 2.0 * np.pi, 6)
    end_s = float(times[-1])
    nodes = np.arange(start_s - 1.0, end_s + 1.0 + 1.0 / flight.trajectory_per_s, 1.0 / flight.trajectory_per_s)
    true = _true_path(flight, first, along, nodes, start_s, wobble)
    reported = _reported(true, errors, number, (start_s, end_s), along)
    lag = flight.lag_rad * np.where(directions == 1, 1.0, -1.0)
    seen = angles + rng.normal(0.0, flight.angle_std_rad, len(angles))
    beams = np.column_stack([np.zeros(len(angles)), np.sin(angles + lag), -np.cos(angles + lag)])
    mount = Rotation.from_rotvec(errors.boresight_rad)
    centres, attitudes = _interpolated(true, times)
    rays = attitudes.apply(mount.apply(beams))
    ranges, met, misleading = _ranges(land, squares, centres, rays, rng)
    points = centres + ranges[:, None] * rays
    ranges = ranges + rng.normal(0.0, flight.range_std_m, len(ranges))
    told_centres, told_attitudes = _interpolated(reported, times)
    local = np.column_stack([np.zeros(len(seen)), np.sin(seen), -np.cos(seen)]) * ranges[:, None]
    recorded = told_centres + told_attitudes.apply(local)
    strip = Strip(
        line.name, recorded[met], times[met], _as_trajectory(reported), directions[met] if flight.oscillating else None
    )
    return FlownStrip(strip, points[met], misleading[met], angles[met])


@dataclass(frozen=True, eq=False)
class _Path:
    times_s: Scalars
    positions_m: Points
    attitudes: Rotation
    """World from body (forward, left, up)."""


def _true_path(flight: Flight, first: Array, along: Array, nodes: Scalars, start_s: float, wobble: Array) -> _Path:
    t = nodes - start_s
    xy = first + (flight.speed_m_s * t)[:, None] * along
    z = flight.height_m + 3.0 * np.sin(t / 7.0 + wobble[0])
    side = np.array([-along[1], along[0]]) * (2.0 * np.sin(t / 9.0 + wobble[1]))[:, None]
    azimuth = np.arctan2(along[1], along[0]) + 0.03 + 0.01 * np.sin(t / 5.0 + wobble[2])
    roll, pitch = 0.02 * np.sin(t / 3.0 + wobble[3]), 0.03 + 0.01 * np.sin(t / 4.0 + wobble[4])
    return _Path(
        nodes,
        np.column_stack([xy + side, z]),
        Rotation.from_euler("ZYX", np.column_stack([azimuth, -pitch, roll])),
    )


def _reported(true: _Path, errors: PlantedErrors, number: int, span_s: tuple[float, float], along: Array) -> _Path:
    """Take the corrections off the true path: what is reported needs them."""
    tau = (true.times_s - 0.5 * (span_s[0] + span_s[1])) / (0.5 * (span_s[1] - span_s[0]))
    shifts, tilts = errors.degrees.split(errors.coefficients[number])
    shift = np.vander(tau, len(shifts), increasing=True) @ shifts
    shift[:, 2] += errors.wave_m * np.sin(2.0 * np.pi * (true.times_s - span_s[0]) / errors.wave_s)
    axes = np.array([[along[0], -along[1], 0.0], [along[1], along[0], 0.0], [0.0, 0.0, 1.0]])
    tilt = np.zeros((len(tau), 3))
    if len(tilts):
        tilt = np.vander(tau, len(tilts), increasing=True) @ tilts @ axes.T
    return _Path(true.times_s, true.positions_m - shift, Rotation.from_rotvec(tilt).inv() * true.attitudes)


def _interpolated(path: _Path, times_s: Scalars) -> tuple[Points, Rotation]:
    """Interpolate as `Trajectory` does: linearly in positions and in the columns of the attitude."""
    centres = np.column_stack([np.interp(times_s, path.times_s, path.positions_m[:, k]) for k in range(3)])
    vectors = path.attitudes.as_rotvec()
    turned = np.column_stack([np.interp(times_s, path.times_s, vectors[:, k]) for k in range(3)])
    return centres, Rotation.from_rotvec(turned)


def _as_trajectory(path: _Path) -> Trajectory:
    azimuth, pitch, roll = path.attitudes.as_euler("ZYX").T
    return Trajectory(path.times_s, path.positions_m, np.column_stack([roll, -pitch, 0.5 * np.pi - azimuth]))


def _ranges(
    land: Landscape, squares: Array, centres: Points, rays: Points, rng: Generator
) -> tuple[Scalars, Flags, Flags]:
    """Give ranges (n,), which rays met a surface, and which met what misleads."""
    cars = int(rng.integers(1 << 31))

    def heights(x: Scalars, y: Scalars) -> tuple[Scalars, Flags]:
        z = land.surface(x, y)
        other = np.zeros(len(x), dtype=np.bool_)
        for square in squares:
            inside = (np.abs(x - square[0]) < 0.5 * land.raised_side_m) & (
                np.abs(y - square[1]) < 0.5 * land.raised_side_m
            )
            z, other = z + land.raised_m * inside, other | inside
        cells = np.floor(np.column_stack([x, y]) / CAR_CELL_M).astype(np.int64)
        chance, dx, dy = _of_cells(cells, cars, 3)
        cx, cy = ((cells[:, k] + 0.1 + 0.8 * d) * CAR_CELL_M for k, d in enumerate((dx, dy)))
        on = (chance < land.cars) & (np.abs(x - cx) < 0.5 * CAR_M[0]) & (np.abs(y - cy) < 0.5 * CAR_M[1])
        return np.where(on, np.maximum(z, land.terrain(cx, cy) + CAR_M[2]), z), other | on

    z, misleading = np.zeros(len(rays)), np.zeros(len(rays), dtype=np.bool_)
    open_ = np.arange(len(rays))
    for _ in range(HEIGHT_STEPS):
        ranges = (z[open_] - centres[open_, 2]) / rays[open_, 2]
        z_new, misleading[open_] = heights(*(centres[open_, :2] + ranges[:, None] * rays[open_, :2]).T)
        moved = np.abs(z_new - z[open_]) >= MET_M
        z[open_] = z_new
        open_ = open_[moved]
    met = np.ones(len(rays), dtype=np.bool_)
    met[open_] = False
    ranges = (z - centres[:, 2]) / rays[:, 2]
    x, y = (centres[:, :2] + ranges[:, None] * rays[:, :2]).T
    cells = np.floor(np.column_stack([x, y]) / TREE_CELL_M).astype(np.int64)
    chance, dx, dy, radius, height = _of_cells(cells, land.seed + 1, 5)
    cx, cy = ((cells[:, k] + 0.3 + 0.4 * d) * TREE_CELL_M for k, d in enumerate((dx, dy)))
    crown = (chance < land.trees) & (np.hypot(x - cx, y - cy) < 1.5 + 3.0 * radius) & (rng.random(len(x)) < 0.8)
    up = rng.uniform(0.2, 1.0, len(x)) * (3.0 + 12.0 * height)
    ranges = np.where(crown, ranges + up / rays[:, 2], ranges)
    return ranges, met, misleading | crown


def _of_cells(cells: Array, seed: int, count: int) -> list[Scalars]:
    """Give numbers from 0 to 1 that belong to cells (n, 2), the same for all who ask."""
    # multiply, shift and multiply again (splitmix64): neighbours get numbers that have nothing in common
    with np.errstate(over="ignore"):
        key = cells[:, 0].astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        key ^= cells[:, 1].astype(np.uint64) * np.uint64(0xC2B2AE3D27D4EB4F)
        key += np.uint64(seed & 0xFFFFFFFF) * np.uint64(0xD6E8FEB86659FD93)
        out = []
        for _ in range(count):
            key = key + np.uint64(0x9E3779B97F4A7C15)
            mixed = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            out.append((mixed >> np.uint64(11)).astype(np.float64) / float(1 << 53))
    return out
