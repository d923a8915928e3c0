"""How the errors of a scanner, and of the tripod under it, displace the points it records (MATH 6.8).

Names and equations are those of D. Lichti, *Error modelling, calibration and analysis of an AM-CW terrestrial laser
scanner system*, 2007, and of B. Muralikrishnan et al., NIST; of a scanner that turns by a whole circle. Errors are
recorded minus true, in the frame whose origin is the instrument and whose z axis is its vertical axis.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Floats32, Indices, Points, Scalars, Vector3
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.scans.scan import Scan

LEAST_ARM_M = 1e-6
"""Points nearer to the vertical axis have no azimuth; what errors do to them stays finite."""
SAMPLED_COLUMNS = 64
"""Of so many columns the direction is looked up, to see how the instrument turned."""
ONE_DIRECTION = 0.9
"""Length of the mean direction of a column's points above which they lie in one vertical half-plane."""
PIECES_OF_ORDER = 1024
"""So small a part of the points in their order is taken for points of one time."""
LEAST_ORDERED_TURN_RAD = 0.5
"""Points in a narrow field lie in one direction in any order: a smaller turn tells no time."""
STEADY_TURN_RAD = 0.02
"""Deviation of the columns' azimuths from a steady turn above which the columns tell no time; an instrument whose
points have time stamps does not turn back by more."""
MOST_STAMPS = 1_000_000
"""Of so many points the time stamps are looked at."""
LEAST_STAMPED_TURN_RAD = 0.1
"""A smaller turn is not told from the spread of directions at one time."""
MOST_OVERLAP_RAD = 0.35
"""By so much an instrument may scan beyond the whole circle; who goes round more often has several times in one
direction."""


class InstrumentError(StrEnum):
    """An error that a scanner makes in the same way in every set-up."""

    VERTICAL_INDEX = "vertical_index"
    """Added to every elevation [rad]."""
    RANGE_OFFSET = "range_offset"
    """Added to every range [m]."""
    RANGE_SCALE = "range_scale"
    """Share of the range added to it."""
    COLLIMATION = "collimation"
    """Angle between line of sight and the normal of the trunnion axis: adds c / cos(elevation) to azimuths [rad]."""
    TRUNNION = "trunnion"
    """Tilt of the trunnion axis: adds i tan(elevation) to azimuths [rad]."""


INSTRUMENT_ERRORS = tuple(InstrumentError)

UNITS = {
    InstrumentError.VERTICAL_INDEX: ("mgon", 1e3 * GON_PER_RAD),
    InstrumentError.RANGE_OFFSET: ("mm", 1e3),
    InstrumentError.RANGE_SCALE: ("ppm", 1e6),
    InstrumentError.COLLIMATION: ("mgon", 1e3 * GON_PER_RAD),
    InstrumentError.TRUNNION: ("mgon", 1e3 * GON_PER_RAD),
}
"""Unit in which each is told, and its number in one SI unit."""


class DriftError(StrEnum):
    """How a set-up turns while it scans: coefficients of a polynomial in time (Kager 2004, G-07, G-08) [rad].

    A steady turn is its change from start to end; the bend of a turn is by how much it is larger at start and end than
    in the middle. Over a scan both have the mean zero and do not depend on each other.
    """

    TILT_X = "tilt_x"
    """Steady turn about the scan's x axis."""
    TILT_Y = "tilt_y"
    """Steady turn about the scan's y axis."""
    HEADING = "heading"
    """Steady turn about the vertical axis."""
    TILT_X_BEND = "tilt_x_bend"
    """Bend of the turn about the scan's x axis."""
    TILT_Y_BEND = "tilt_y_bend"
    """Bend of the turn about the scan's y axis."""
    HEADING_BEND = "heading_bend"
    """Bend of the turn about the vertical axis."""


DRIFT_ERRORS = tuple(DriftError)
STEADY_DRIFTS = DRIFT_ERRORS[:3]
"""Those of first order."""


class TimeSource(StrEnum):
    """What tells when a scanner looked where."""

    TIME_STAMPS = "time-stamps"
    """The time that the file has of each point."""
    COLUMNS = "columns"
    """The columns of the grid, measured one after the other in equal times."""
    ORDER = "order"
    """The order of the points in the file, as far as it goes round the instrument."""


@dataclass(frozen=True)
class Sweep:
    """When a scanner looked where: it turns in one sense from one azimuth on."""

    start_rad: float
    """Azimuth of the first column."""
    turn_rad: float
    """Signed angle from the first to the last column, at most a whole circle."""
    shares: tuple[float, ...] = (0.0, 1.0)
    """Ascending shares of the turn, from 0 to 1..."""
    moments: tuple[float, ...] = (0.0, 1.0)
    """...and when it had come so far, 0 at the start, 1 at the end; between them it turns steadily."""
    told_by: str = TimeSource.COLUMNS.value
    """What tells so, by its `TimeSource`."""
    duration_s: float | None = None
    """From start to end [s]; None: nobody knows."""

    def times(self, points: Points) -> Scalars:
        """Give the times (n,) at which (n, 3) points about the instrument were measured, 0 at the start, 1 at the end.

        Points outside of what was swept, as means of points may be, get the time of the nearer end.
        """
        angles = (np.arctan2(points[:, 1], points[:, 0]) - self.start_rad) * np.sign(self.turn_rad)
        circle, whole = 2.0 * np.pi, abs(self.turn_rad)
        margin = 0.5 * (circle - whole)
        come = np.clip(((angles + margin) % circle - margin) / whole, 0.0, 1.0)
        return np.asarray(np.interp(come, self.shares, self.moments))


def sweep_of(scan: Scan) -> Sweep | None:
    """Find how the instrument turned: by the time stamps of its points, else by the columns of its grid or their order.

    None where they do not tell: columns whose points lie on both sides of the axis, as of scanners that look over the
    zenith, an instrument that goes round more than once, and points without time stamps that are not in the order of
    their measurement.

    Parameters
    ----------
    scan
        With the instrument's position.
    """
    if scan.sensor_m is None or len(scan.points) < 2:
        return None
    if scan.times_s is not None:
        return _sweep_in_time(scan, scan.sensor_m, scan.times_s)
    count = len(scan.points) if scan.grid is None else scan.grid.columns
    followed = None if count < 2 else _followed(scan.points, scan.sensor_m, _pieces(scan, count))
    if followed is None:
        return None
    places, turned = followed
    if scan.grid is None:
        return _sweep_in_order(turned)
    slope, start = np.polyfit(places, turned, 1)
    if np.abs(turned - start - slope * places).max() > STEADY_TURN_RAD or slope == 0.0:
        return None
    whole = float(np.clip(slope * count, -2.0 * np.pi, 2.0 * np.pi))
    return Sweep(float(start - 0.5 * slope), whole)


def _followed(
    points: Points, sensor_m: Vector3, pieces: Iterable[tuple[float, Indices]]
) -> tuple[Float64[Array, "pieces"], Float64[Array, "pieces"]] | None:
    """Follow the azimuth from piece to piece: their places and azimuths; None if one does not lie in one direction."""
    places, azimuths = [], []
    for place, numbers in pieces:
        if len(numbers) == 0:
            continue
        arms = points[numbers] - sensor_m
        flat = np.hypot(arms[:, 0], arms[:, 1])
        directions = arms[:, :2] / np.maximum(flat, LEAST_ARM_M)[:, None]
        mean = directions.mean(axis=0)
        if float(np.hypot(*mean)) < ONE_DIRECTION:
            return None
        places.append(place)
        azimuths.append(float(np.arctan2(mean[1], mean[0])))
    # from piece to piece less than half a circle, so the turn can be followed
    return (np.array(places), np.unwrap(np.array(azimuths))) if len(places) > 2 else None


def _sweep_in_time(scan: Scan, sensor_m: Vector3, times_s: Floats32) -> Sweep | None:
    """Take the turn that the time stamps tell, however unsteady, whatever the order of the points."""
    known = np.flatnonzero(np.isfinite(times_s))
    known = known[:: max(1, len(known) // MOST_STAMPS)]
    in_time = known[np.argsort(times_s[known], kind="stable")]
    if len(in_time) < 2:
        return None
    moments = times_s[in_time].astype(np.float64)
    first, duration = moments[0], moments[-1] - moments[0]
    pieces = ((float(moments[numbers].mean()), in_time[numbers]) for numbers in _runs(len(in_time)))
    followed = _followed(scan.points, sensor_m, pieces)
    if followed is None or duration <= 0.0:
        return None
    at, turned = followed
    whole = float(turned[-1] - turned[0])
    come = np.maximum.accumulate((turned - turned[0]) * np.sign(whole))
    back = (come - (turned - turned[0]) * np.sign(whole)).max()
    if abs(whole) < LEAST_STAMPED_TURN_RAD or back > STEADY_TURN_RAD or abs(whole) > 2.0 * np.pi + MOST_OVERLAP_RAD:
        return None
    most = min(abs(whole), 2.0 * np.pi)
    return Sweep(
        start_rad=float(turned[0]),
        turn_rad=float(np.copysign(most, whole)),
        shares=tuple(np.minimum(come / most, 1.0).tolist()),
        moments=tuple(((at - first) / duration).tolist()),
        told_by=TimeSource.TIME_STAMPS.value,
        duration_s=float(duration),
    )


def _sweep_in_order(turned: Float64[Array, "pieces"]) -> Sweep | None:
    """Take the turn of the points' order; how many come back from each direction says nothing of its speed."""
    whole = float(turned[-1] - turned[0])
    back = np.diff(turned) * np.sign(whole) < -STEADY_TURN_RAD
    if abs(whole) < LEAST_ORDERED_TURN_RAD or back.any():
        return None
    turn = float(np.clip(whole, -2.0 * np.pi, 2.0 * np.pi))
    return Sweep(float(turned[0]), turn, told_by=TimeSource.ORDER.value)


def _pieces(scan: Scan, count: int) -> Iterator[tuple[float, Indices]]:
    """Give places among the columns, or points, and the points measured there at one time."""
    if scan.grid is not None:
        for column in np.unique(np.linspace(0, count - 1, SAMPLED_COLUMNS).astype(np.int64)).tolist():
            numbers = scan.grid.index[:, column]
            yield float(column), numbers[numbers >= 0]
        return
    for numbers in _runs(count):
        yield float(numbers.mean()), numbers


def _runs(count: int) -> Iterator[Indices]:
    """Give short runs of so many numbers, spread evenly from the first to the last."""
    size = max(count // PIECES_OF_ORDER, 1)
    for first in np.unique(np.linspace(0, count - size, SAMPLED_COLUMNS).astype(np.int64)).tolist():
        yield np.arange(first, first + size)


def instrument_displacements(arms: Points) -> Float64[Array, "n 3 errors"]:
    """Give how a unit of each instrument error displaces recorded points (MATH 6.8).

    Parameters
    ----------
    arms
        (n, 3) recorded points from the instrument, z along its vertical axis [m].

    Returns
    -------
    (n, 3, 5) recorded minus true [m for each rad, m, 1, rad, rad] in the order of `INSTRUMENT_ERRORS`.
    """
    x, y, z = arms.T
    flat = np.maximum(np.hypot(x, y), LEAST_ARM_M)
    distance = np.hypot(flat, z)
    upwards = np.stack([-z * x / flat, -z * y / flat, flat], axis=1)
    sideways = np.stack([-y, x, np.zeros_like(x)], axis=1) / flat[:, None]
    return np.stack(
        [upwards, arms / distance[:, None], arms, distance[:, None] * sideways, z[:, None] * sideways], axis=2
    )


def drift_displacements(arms: Points, times: Scalars) -> Float64[Array, "n 3 drifts"]:
    """Give how a unit of each drift displaces recorded points: -f(t) e × x, e the axis of the turn (MATH 6.8).

    f is t - 1/2 of a steady turn, 4 (t - 1/2)² - 1/3 of its bend.

    Parameters
    ----------
    arms
        (n, 3) recorded points from the instrument [m].
    times
        (n,) of their measurement, 0 to 1.

    Returns
    -------
    (n, 3, 6) recorded minus true [m for each rad] in the order of `DRIFT_ERRORS`.
    """
    x, y, z = arms.T
    nothing = np.zeros_like(x)
    turned = np.stack(
        [
            np.stack([nothing, z, -y], axis=1),
            np.stack([-z, nothing, x], axis=1),
            np.stack([y, -x, nothing], axis=1),
        ],
        axis=2,
    )
    return np.concatenate([turned * part[:, None, None] for part in drift_polynomials(times)], axis=2)


def drift_polynomials(times: Scalars) -> tuple[Scalars, Scalars]:
    """Give how far a steady turn and its bend have come at times (n,), 0 to 1 (MATH 6.8)."""
    return np.asarray(times - 0.5), np.asarray(4.0 * np.square(times - 0.5) - 1.0 / 3.0)


def without_errors(points: Points, sensor_m: Vector3, errors: Float64[Array, "errors"]) -> Points:
    """Take known instrument errors off recorded points, exactly and not to first order (MATH 6.8).

    Parameters
    ----------
    points
        (n, 3) recorded points, z axis along the instrument's vertical axis [m].
    sensor_m
        Where the instrument stood, in the same frame.
    errors
        (5,) in the order of `INSTRUMENT_ERRORS` [rad, m, 1, rad, rad].
    """
    index, offset, scale, collimation, trunnion = errors
    arms = points - sensor_m
    elevations = np.arctan2(arms[:, 2], np.hypot(arms[:, 0], arms[:, 1])) - index
    azimuths = np.arctan2(arms[:, 1], arms[:, 0]) - collimation / np.cos(elevations) - trunnion * np.tan(elevations)
    ranges = (np.linalg.norm(arms, axis=1) - offset) / (1.0 + scale)
    flat = np.cos(elevations)
    directions = np.stack([flat * np.cos(azimuths), flat * np.sin(azimuths), np.sin(elevations)], axis=1)
    return np.asarray(sensor_m + ranges[:, None] * directions)
