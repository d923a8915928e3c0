"""The centre of a bright spot: a blurred square or cylinder, and the beam's tail beside it, by least squares."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from algorithms.arrays import Array, Matrix3, Scalars, Vector3, Vectors2
from algorithms.probabilities import f_sf
from algorithms.targets.damped_fit import damped_fit, residual_covariance
from algorithms.targets.options import TargetKind
from algorithms.targets.seen_cloud import SeenCloud
from algorithms.targets.spot_shape import SpotShape
from algorithms.targets.tangent_plane import TangentPlane, plane_across, plane_through

POINTS_OF_A_PLANE = 12
"""Of fewer pixels the target is taken to face the instrument."""
DARK_SHARE = 0.1
"""So much of a spot's window is surely darker than the spot."""
INNER_SHARE = 0.25
"""Pixels within so much of the spot's height from its top lie on the target as a whole."""
POINTS_OF_A_TAIL = 30
"""Pixels that a tail is told from."""
HOPELESS = 0.4
"""A shape that explains less of the intensities than this is not looked at more closely."""
WORTH_A_SECOND_LOOK = 0.9
"""A tail that with the scatter expected leaves more of the sum of squares will not be worth it with the one found."""
TAIL_SIGNIFICANCE, TAIL_WORTH, MOST_TAIL = 0.001, 0.8, 0.4
"""A tail explains significantly more, and leaves at most so much of the sum of squares: what else the shape does not
explain of many pixels would be taken for one."""
EXPECTED_SCATTER = 0.03
"""Of the intensities about the picture, relative to their range; what it is follows from the first fit."""
LEAST_SCATTER = 1e-4
TAIL_STD = 0.1
"""A beam's tail is no second sharp beam: the model leaves so much of what it moves the centre of mass by."""
LEAST_STD_PX = 0.005
"""Of one pixel a centre is never known better: the raster itself repeats no better."""


@dataclass(frozen=True, eq=False)
class SpotFit:
    """A bright spot's centre, relative to the instrument."""

    centre_m: Vector3
    covariance_m2: Matrix3
    incidence_rad: float
    agreement: float
    """Share of the intensities' variance that the template explains."""
    rms: float
    """Residuals relative to the height of the spot."""
    contrast: float
    tail: float
    """Height of the tail relative to the spot; 0 where there is none."""
    normal: Vector3 | None
    """(3,) unit normal of a square whose pixels tell it; None of others."""


def fit_spot(
    cloud: SeenCloud,
    window: tuple[slice, ...],
    start: tuple[float, float],
    range_m: float,
    size_m: float,
    kind: TargetKind,
) -> SpotFit | None:
    """Measure the centre of a spot in a window of the raster.

    The directions of the window's pixels meet the target's plane where a square blurred by the beam should explain
    their intensities. An inhomogeneous beam draws a second, weaker one beside it along the horizontal circle, which is
    taken into the model where it explains significantly more: a centroid would be drawn towards it. Across the contour
    ranges are not averaged: the range is that of the target's own pixels.

    Parameters
    ----------
    cloud
        The scan about its instrument.
    window
        Rows and columns.
    start
        Row and column in the window near the centre.
    range_m
        Median range of the spot's pixels [m].
    size_m
        Side of the square, or width and height of the cylinder [m].
    kind
        Square or cylinder.

    Returns
    -------
    The fit, or None where the pixels do not tell a centre.
    """
    assert cloud.intensity is not None  # noqa: S101 - said to the type checker, tested by the caller
    index = cloud.index[window]
    there = (index >= 0) & ~_beside_contour(cloud, index, range_m, size_m)
    numbers = index[there]
    if len(numbers) < 9:
        return None
    directions = cloud.points[numbers] / cloud.ranges[numbers, None]
    values = cloud.intensity[numbers]
    rows, columns = np.nonzero(there)
    middle = _between_pixels(directions, rows, columns, start)
    # well inside the contour: farther out the range is a mixture with what is behind
    dark = float(np.quantile(values, DARK_SHARE)) if np.all(there) else 0.0
    inner = values > values.max() - INNER_SHARE * (values.max() - dark)
    outer = values > 0.5 * (values.max() + dark)
    bright = inner if np.count_nonzero(inner) >= POINTS_OF_A_PLANE else outer
    own = cloud.ranges[numbers][bright]
    near_range = np.abs(own - range_m) < size_m
    own = own[near_range]
    if len(own) == 0:
        return None
    plane = _plane(cloud.points[numbers][bright], middle, own, size_m, kind)
    step_m = range_m * cloud.step_rad
    around = _with_surroundings(values, np.abs(cloud.ranges[numbers] - range_m) <= size_m)
    inside = directions[bright][near_range]
    silent = _silent_directions(directions, rows, columns, (index < 0) & ~ndimage.binary_fill_holes(there))
    directions = np.vstack([directions, silent])
    values, around = (np.append(part, np.zeros(len(silent))) for part in (values, around))
    shape = SpotShape(kind, size_m, _slope(middle), float(np.hypot(*plane.centre_m[:2])))
    fit = _best(directions, values, around, plane, middle, step_m, shape)
    if fit is None:
        return None
    if kind is TargetKind.RETRO_CYLINDER and fit[2] > HOPELESS:
        # how far the axis lies behind the foil follows from where the pixels lie beside it, and that from the plane
        for _ in range(2):
            plane = _through_axis(plane, fit[0], inside, own, size_m)
            fit = _best(directions, values, around, plane, middle, step_m, shape)
            if fit is None:
                return None
    solution, covariance, agreement, rms, tail = fit
    covariance = covariance + (LEAST_STD_PX * step_m) ** 2 * np.eye(2)
    if tail > 0.0:
        covariance[0, 0] += (TAIL_STD * tail * float(solution[-1])) ** 2
    level, height = float(solution[2]), float(solution[3])
    return SpotFit(
        centre_m=plane.in_space(solution[:2]),
        covariance_m2=plane.covariance_of(solution[:2], covariance),
        incidence_rad=0.0 if kind is TargetKind.RETRO_CYLINDER else plane.incidence_rad,
        agreement=agreement,
        rms=rms,
        contrast=height / max(abs(2.0 * level + height), 1e-300),
        tail=tail,
        normal=plane.normal if plane.told else None,
    )


def _beside_contour(cloud: SeenCloud, index: Array, range_m: float, size_m: float) -> Array:
    """Mark the pixels of a raster that returned something far behind or before the target, next to some that did not.

    The beam may have met the target in part; which surface's echo is returned leaps, so that a whole row of such pixels
    would draw the centre to one side.
    """
    far = (index >= 0) & (np.abs(cloud.ranges[np.maximum(index, 0)] - range_m) > size_m)
    return np.asarray(far & ndimage.binary_dilation((index >= 0) & ~far, np.ones((3, 3), dtype=bool)))


def _silent_directions(directions: Array, rows: Array, columns: Array, silent: Array) -> Array:
    """Give the directions (k, 3) of pixels beside the target that nothing came back from: their intensity is none.

    Parameters
    ----------
    directions, rows, columns
        Of pixels (n,) from which something did.
    silent
        Which pixels of the window are meant.
    """

    def design(row: Array, column: Array) -> Array:
        return np.stack([np.ones(len(row)), row, column, row * column], axis=1)

    wanted = np.nonzero(silent)
    if len(wanted[0]) == 0:
        return np.empty((0, 3))
    law = np.linalg.lstsq(design(rows.astype(np.float64), columns.astype(np.float64)), directions, rcond=None)[0]
    found = design(*(each.astype(np.float64) for each in wanted)) @ law
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def _with_surroundings(values: Scalars, near: Array) -> Array:
    """Give the share (n,), 1 or 0, with which the brightness of what is around the target is in the intensities.

    What lies at the target's distance is seen in the same echo, where the beam meets the target in part. What lies far
    behind is another echo: then the target's pixels hold nothing of it.
    """
    dark = values < values.min() + 0.25 * (values.max() - values.min())
    before_something = np.count_nonzero(near & dark) < np.count_nonzero(~near)
    return np.where(near & before_something, 0.0, 1.0)


def _slope(direction: Vector3) -> float:
    """Give the rise of a beam over its horizontal length."""
    return float(direction[2] / np.hypot(direction[0], direction[1]))


def _between_pixels(directions: Array, rows: Array, columns: Array, place: tuple[float, float]) -> Vector3:
    """Give the unit direction (3,) of a place between pixels: bilinear, by a plane through the directions around."""
    near = np.argsort((rows - place[0]) ** 2 + (columns - place[1]) ** 2)[:9]
    design = np.column_stack([np.ones(len(near)), rows[near] - place[0], columns[near] - place[1]])
    direction = np.linalg.lstsq(design, directions[near], rcond=None)[0][0]
    return np.asarray(direction / np.linalg.norm(direction))


def _plane(bright: Array, middle: Vector3, ranges: Scalars, size_m: float, kind: TargetKind) -> TangentPlane:
    """Give the plane in which the target is measured: its own where enough pixels show it, else that across the beam;
    of a cylinder the upright one through its axis, which turns with the instrument.
    """
    range_m = float(np.median(ranges))
    std = max(1.2533 * float(np.std(ranges)), 1e-4) / float(np.sqrt(len(ranges)))
    own = plane_through(bright) if kind is TargetKind.RETRO_SQUARE and len(bright) >= POINTS_OF_A_PLANE else None
    if own is not None and own.incidence_rad < np.deg2rad(70.0):
        return own
    if kind is TargetKind.RETRO_CYLINDER:
        return _upright(middle * (range_m + 0.5 * size_m * float(np.hypot(1.0, _slope(middle)))), std)
    return plane_across(middle * range_m, std)


def _upright(place: Vector3, std_m: float) -> TangentPlane:
    """Give the vertical plane through a place that faces the instrument."""
    normal = -np.array([place[0], place[1], 0.0]) / float(np.hypot(place[0], place[1]))
    across = np.array([-normal[1], normal[0], 0.0])
    return TangentPlane(place, normal, np.column_stack([across, np.array([0.0, 0.0, 1.0])]), std_m, std_m, told=False)


def _through_axis(
    plane: TangentPlane, solution: Array, directions: Array, ranges: Scalars, size_m: float
) -> TangentPlane:
    """Move an upright plane onto the axis of a cylinder: each pixel lies before it by what its place beside it tells.

    Parameters
    ----------
    plane
        Near the axis.
    solution
        Whose first is the place of the axis in it [m].
    directions
        (n, 3) of pixels on the cylinder.
    ranges
        (n,) of them [m].
    size_m
        Diameter [m].
    """
    horizontal = np.hypot(directions[:, 0], directions[:, 1])
    places, _ = plane.met_by(directions)
    radius = 0.5 * size_m
    depths = np.sqrt(np.maximum(radius**2 - np.minimum(np.abs(places[:, 0] - solution[0]), radius) ** 2, 0.0))
    own = ranges * horizontal + depths
    place = plane.in_space(solution[:2])
    std = max(float(np.std(own)), 1e-4) / float(np.sqrt(len(own)))
    return _upright(place * (float(np.mean(own)) / float(np.hypot(place[0], place[1]))), std)


def _best(
    directions: Array,
    values: Scalars,
    around: Array,
    plane: TangentPlane,
    middle: Vector3,
    step_m: float,
    shape: SpotShape,
) -> tuple[Array, Array, float, float, float] | None:
    """Fit without and with a tail, and take the tail where it is significant; None where the centre runs away."""
    unit, size_m = float(np.ptp(values)), shape.size_m
    if unit <= 0.0:
        return None
    places, _ = plane.met_by(directions)
    start = plane.met_by(middle[None, :])[0][0]
    level = float(np.median(values))
    first = np.array([start[0], start[1], level, unit, np.log(max(0.5 * step_m, 0.05 * size_m))])
    flat = shape.kind is TargetKind.RETRO_SQUARE
    own = np.deg2rad([0.0, 22.5, 45.0, 67.5]) if size_m > 4.0 * step_m else np.zeros(1)
    begins = own[:, None] if flat else shape.begins[None, :]
    problem = SpotModel(places, values, around, shape, unit, own_is_free=not flat or len(own) > 1)
    plain = min((problem.roughly(np.append(first, begin)) for begin in begins), key=lambda trial: trial.omega)
    solution, omega, covariance = problem.solved(plain)
    tail = 0.0
    n = len(values)
    whole = float(np.sum((values - values.mean()) ** 2))
    if n >= POINTS_OF_A_TAIL and omega < (1.0 - HOPELESS) * whole:
        without = solution, omega
        for side in (-1.0, 1.0):
            begin = np.concatenate([without[0], [0.1, side * max(2.0 * step_m, 0.5 * size_m)]])
            rough = problem.roughly(begin)
            if rough.omega > WORTH_A_SECOND_LOOK * without[1]:
                continue
            other = problem.solved(rough)
            freedom = n - len(begin)
            gain = (without[1] - other[1]) / 2.0 / max(other[1] / freedom, 1e-300)
            if (
                0.0 < other[0][-2] < MOST_TAIL
                and other[1] < TAIL_WORTH * omega
                and f_sf(gain, 2, freedom) < TAIL_SIGNIFICANCE
            ):
                solution, omega, covariance = other
                tail = float(other[0][-2])
    if float(np.linalg.norm(solution[:2] - start)) > size_m:
        return None
    agreement = 1.0 - omega / whole
    rms = float(np.sqrt(omega / n)) / max(abs(float(solution[3])), 1e-300)
    return solution, covariance, agreement, rms, tail


@dataclass(frozen=True, eq=False)
class RoughFit:
    """A solution where the scatter of the intensities was not known yet."""

    start: Array
    """What was known before."""
    solution: Array
    omega: float
    """Sum of squares."""


@dataclass(frozen=True, eq=False)
class SpotModel:
    """Intensities by centre (2), level, height, blur and the shape's own; share and place of a tail."""

    places: Vectors2
    values: Scalars
    around: Array
    """(n,) share with which the level of what is around the target is in them."""
    shape: SpotShape
    unit: float
    """Range of the intensities."""
    own_is_free: bool

    def roughly(self, start: Array) -> "RoughFit":
        """Solve where the intensities scatter as expected."""
        solution, omega, _ = self._solved(start, start, EXPECTED_SCATTER)
        return RoughFit(start, solution, omega)

    def solved(self, rough: "RoughFit") -> tuple[Array, float, Array]:
        """Give the solution, its sum of squares, and the covariance (2, 2) of the centre, with the scatter found."""
        scatter = max(float(np.sqrt(rough.omega / len(self.values))) / self.unit, LEAST_SCATTER)
        return self._solved(rough.solution, rough.start, scatter)

    def _solved(self, begin: Array, start: Array, scatter: float) -> tuple[Array, float, Array]:
        """Solve where the intensities scatter by so much of their range, and the start is what is known before."""
        free = np.ones(len(start), dtype=bool)
        free[5] = self.own_is_free
        stds = self.shape.stds
        known = np.zeros((len(stds), len(start)))
        known[np.arange(len(stds)), 4 + np.arange(len(stds))] = scatter / stds

        def whole(x: Array) -> Array:
            out = start.copy()
            out[free] = x
            return out

        def model(x: Array) -> tuple[Scalars, Array]:
            now = whole(x)
            value, derivatives = self.intensities(now)
            residuals = np.append((value - self.values) / self.unit, known @ (now - start))
            return residuals, np.vstack([derivatives / self.unit, known])[:, free]

        size, unit = self.shape.size_m, self.unit
        scale = np.ones(len(start))
        scale[:4] = size, size, unit, unit
        if self._has_tail(start):
            scale[-1] = size
        fitted = damped_fit(model, begin[free], most_evaluations=40, scale=scale[free])
        solution = whole(fitted.solution)
        n = len(self.values)
        misfits = fitted.residuals[:n]
        design = fitted.jacobian
        inverse = np.linalg.pinv(design.T @ design + 1e-12 * np.diag(1.0 / scale[free] ** 2), hermitian=True)
        gain = design @ inverse
        covariance = residual_covariance(design[:n], gain[:n], misfits)[:2, :2]
        # what is known before scatters as much as was said of it, whatever its residual happens to be
        covariance = covariance + scatter**2 * gain[n:, :2].T @ gain[n:, :2]
        return solution, float(np.sum(misfits**2)) * unit**2, covariance

    def _has_tail(self, x: Array) -> bool:
        return len(x) > 5 + len(self.shape.begins)

    def intensities(self, x: Array) -> tuple[Scalars, Array]:
        """Give the intensities (n,) of the shape, with a tail of a weaker one beside it too, and their derivatives."""
        offset = self.places - x[:2]
        own = x[5 : 5 + len(self.shape.begins)]
        value, by_shape = self.shape.picture(offset, x[4], own)
        by_tail = np.empty((len(offset), 0))
        if self._has_tail(x):
            share, beside_m = x[-2:]
            beside, by_beside = self.shape.picture(offset - np.array([beside_m, 0.0]), x[4], own)
            by_tail = np.column_stack([beside - value, -share * by_beside[:, 0]])
            value, by_shape = (1.0 - share) * value + share * beside, (1.0 - share) * by_shape + share * by_beside
        height = x[3]
        by_level = np.column_stack([self.around, value])
        derivatives = np.column_stack([-height * by_shape[:, :2], by_level, height * by_shape[:, 2:], height * by_tail])
        return np.asarray(x[2] * self.around + height * value), derivatives
