"""The centre of a bright spot: a blurred square or cylinder, and the beam's tail beside it, by least squares."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage, special, stats
from scipy.optimize import least_squares

from algorithms.arrays import Array, Matrix3, Scalars, Vector3, Vectors2
from algorithms.targets.options import TargetKind
from algorithms.targets.seen_cloud import SeenCloud
from algorithms.targets.tangent_plane import TangentPlane, plane_across, plane_through

POINTS_OF_A_PLANE = 12
"""Of fewer pixels the target is taken to face the instrument."""
INNER_SHARE = 0.25
"""Pixels within so much of the spot's height from its top lie on the target as a whole."""
POINTS_OF_A_TAIL = 30
"""Pixels that a tail is told from."""
TAIL_SIGNIFICANCE, MOST_TAIL = 0.001, 0.4
STRIPS = 18
"""Of a cylinder, of equal angles: narrow where its brightness falls."""
LEAN_STD_RAD = 0.01
"""How upright a cylinder stands in the scanner's frame: its front is so much higher or lower."""
LAMBERT = 1.0
"""A foil's brightness falls with a power of the cosine of incidence that is fitted; it begins as paper's does."""
KNOWN_BEFORE = 0.7
"""Standard deviation of what is known before of the blur's logarithm and of the power."""
EXPECTED_SCATTER = 0.03
"""Of the intensities about the picture, relative to their range; what it is follows from the first fit."""
LEAST_SCATTER = 1e-4
LEAST_STD_PX = 0.02
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
    inner = values > values.max() - INNER_SHARE * (values.max() - np.median(values))
    outer = values > 0.5 * (values.max() + np.median(values))
    bright = inner if np.count_nonzero(inner) >= POINTS_OF_A_PLANE else outer
    own = cloud.ranges[numbers][bright]
    near_range = np.abs(own - range_m) < size_m
    own = own[near_range]
    if len(own) == 0:
        return None
    plane = _plane(cloud.points[numbers][bright], middle, own, size_m, kind)
    step_m = range_m * cloud.step_rad
    around = _with_surroundings(values, np.abs(cloud.ranges[numbers] - range_m) <= size_m)
    fit = _best(directions, values, around, plane, middle, step_m, SpotShape(kind, size_m, _slope(middle)))
    if fit is None:
        return None
    if kind is TargetKind.RETRO_CYLINDER:
        # how far the axis lies behind the foil follows from where the pixels lie beside it, and that from the plane
        inside = directions[bright][near_range]
        for _ in range(2):
            plane = _through_axis(plane, fit[0], inside, own, size_m)
            fit = _best(directions, values, around, plane, middle, step_m, SpotShape(kind, size_m, _slope(middle)))
            if fit is None:
                return None
    solution, covariance, agreement, rms, tail = fit
    covariance = covariance + (LEAST_STD_PX * step_m) ** 2 * np.eye(2)
    if kind is TargetKind.RETRO_CYLINDER:
        # the foil lies 0.8 radii before the axis on the average
        covariance[1, 1] += (0.4 * size_m * LEAN_STD_RAD) ** 2
    level, height = float(solution[2]), float(solution[3])
    return SpotFit(
        centre_m=plane.in_space(solution[:2]),
        covariance_m2=plane.covariance_of(solution[:2], covariance),
        incidence_rad=0.0 if kind is TargetKind.RETRO_CYLINDER else plane.incidence_rad,
        agreement=agreement,
        rms=rms,
        contrast=height / max(abs(2.0 * level + height), 1e-300),
        tail=tail,
    )


def _beside_contour(cloud: SeenCloud, index: Array, range_m: float, size_m: float) -> Array:
    """Mark the pixels of a raster that returned something far behind or before the target, next to some that did not.

    The beam may have met the target in part; which surface's echo is returned leaps, so that a whole row of such pixels
    would draw the centre to one side.
    """
    far = (index >= 0) & (np.abs(cloud.ranges[np.maximum(index, 0)] - range_m) > size_m)
    return np.asarray(far & ndimage.binary_dilation((index >= 0) & ~far, np.ones((3, 3), dtype=bool)))


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
    return TangentPlane(place, normal, np.column_stack([across, np.array([0.0, 0.0, 1.0])]), std_m, std_m)


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


@dataclass(frozen=True)
class SpotShape:
    """What the intensities are the blurred picture of."""

    kind: TargetKind
    size_m: float
    slope: float
    """Rise of the beam over its horizontal length."""

    def picture(self, offset: Vectors2, log_blur: float, own: float) -> tuple[Scalars, Array]:
        """Give the brightness (n,), 0..1, at places (n, 2) about the centre, and its derivatives (n, 4): by the place,
        by the logarithm of the blur, by the shape's own.

        Its own is the turn of a square, and the power of the cosine of incidence with which a cylinder's foil shines.
        """
        blur = np.sqrt(2.0) * float(np.exp(np.clip(log_blur, -20.0, 5.0)))
        half = 0.5 * self.size_m
        if self.kind is TargetKind.RETRO_CYLINDER:
            return self._cylinder(offset, blur, half, own)
        axes = np.array([[np.cos(own), -np.sin(own)], [np.sin(own), np.cos(own)]])
        turned = offset @ axes
        first, by_first, first_blur = _bar(turned[:, 0], -half, half, blur)
        other, by_other, other_blur = _bar(turned[:, 1], -half, half, blur)
        moved = np.stack([by_first * other, first * by_other], axis=1)
        turn = moved[:, 0] * turned[:, 1] - moved[:, 1] * turned[:, 0]
        return first * other, np.column_stack([moved @ axes.T, first_blur * other + first * other_blur, turn])

    def _cylinder(self, offset: Vectors2, blur: float, half: float, power: float) -> tuple[Scalars, Array]:
        """Give upright strips, each as high above its place at the axis as a sloping beam meets it before."""
        angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, STRIPS + 1)
        edges, cosines = half * np.sin(angles), np.cos(0.5 * (angles[1:] + angles[:-1]))
        brightness = cosines ** np.clip(power, -5.0, 20.0)
        strip, by_side, strip_blur = _bar(offset[:, :1], edges[:-1], edges[1:], blur)
        part, by_height, part_blur = _bar(offset[:, 1:] - half * cosines * self.slope, -half, half, blur)
        whole = strip * part
        derivatives = [by_side * part @ brightness, strip * by_height @ brightness]
        derivatives += [(strip_blur * part + strip * part_blur) @ brightness, whole @ (brightness * np.log(cosines))]
        return whole @ brightness, np.stack(derivatives, axis=1)


def _bar(place: Array, low: Array | float, high: Array | float, blur: float) -> tuple[Array, Array, Array]:
    """Give a blurred bar from low to high, and its derivatives by the place and by the logarithm of the blur."""
    begin, end = (place - low) / blur, (place - high) / blur
    rise, fall = np.exp(-(begin**2)) / np.sqrt(np.pi), np.exp(-(end**2)) / np.sqrt(np.pi)
    return 0.5 * (special.erf(begin) - special.erf(end)), (rise - fall) / blur, end * fall - begin * rise


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
    own = own if flat else np.array([LAMBERT])
    problem = SpotModel(places, values, around, shape, unit, own_is_free=not flat or len(own) > 1)
    plain = min((problem.solved(np.append(first, value)) for value in own), key=lambda trial: trial[1])
    solution, omega, covariance = plain
    tail = 0.0
    n = len(values)
    if n >= POINTS_OF_A_TAIL:
        for side in (-1.0, 1.0):
            begin = np.concatenate([plain[0], [0.1, side * max(2.0 * step_m, 0.5 * size_m)]])
            other = problem.solved(begin)
            freedom = n - 8
            gain = (plain[1] - other[1]) / 2.0 / max(other[1] / freedom, 1e-300)
            if 0.0 < other[0][6] < MOST_TAIL and other[1] < omega and stats.f.sf(gain, 2, freedom) < TAIL_SIGNIFICANCE:
                solution, omega, covariance = other
                tail = float(other[0][6])
    if float(np.linalg.norm(solution[:2] - start)) > size_m:
        return None
    whole = float(np.sum((values - values.mean()) ** 2))
    agreement = 1.0 - omega / whole
    rms = float(np.sqrt(omega / n)) / max(abs(float(solution[3])), 1e-300)
    return solution, covariance, agreement, rms, tail


@dataclass(frozen=True, eq=False)
class SpotModel:
    """Intensities by centre (2), level, height, blur and one of the shape's own; share and place of a tail."""

    places: Vectors2
    values: Scalars
    around: Array
    """(n,) share with which the level of what is around the target is in them."""
    shape: SpotShape
    unit: float
    """Range of the intensities."""
    own_is_free: bool

    def solved(self, start: Array) -> tuple[Array, float, Array]:
        """Give the solution, its sum of squares, and the covariance (2, 2) of the centre."""
        solution, omega, _ = self._solved(start, start, EXPECTED_SCATTER)
        scatter = max(float(np.sqrt(omega / len(self.values))) / self.unit, LEAST_SCATTER)
        return self._solved(solution, start, scatter)

    def _solved(self, begin: Array, start: Array, scatter: float) -> tuple[Array, float, Array]:
        """Solve where the intensities scatter by so much of their range, and the start is what is known before."""
        free = np.ones(len(start), dtype=bool)
        free[5] = self.own_is_free
        known = np.zeros((1 if self.shape.kind is TargetKind.RETRO_SQUARE else 2, len(start)))
        known[np.arange(len(known)), 4 + np.arange(len(known))] = scatter / KNOWN_BEFORE

        def whole(x: Array) -> Array:
            out = start.copy()
            out[free] = x
            return out

        def residuals(x: Array) -> Array:
            full = whole(x)
            return np.append((self.intensities(full)[0] - self.values) / self.unit, known @ (full - start))

        def jacobian(x: Array) -> Array:
            return np.vstack([self.intensities(whole(x))[1] / self.unit, known])[:, free]

        size, unit = self.shape.size_m, self.unit
        scale = np.array([size, size, unit, unit, 1.0, 1.0, 1.0, size])[: len(start)]
        fitted = least_squares(residuals, begin[free], jacobian, method="lm", x_scale=scale[free], max_nfev=100)
        solution = whole(fitted.x)
        n = len(self.values)
        misfits = np.asarray(fitted.fun)[:n]
        design = np.asarray(fitted.jac)
        inverse = np.linalg.pinv(design.T @ design + 1e-12 * np.diag(1.0 / scale[free] ** 2), hermitian=True)
        gain = design @ inverse
        leverage = np.minimum(np.einsum("ij,ij->i", gain[:n], design[:n]), 0.95)
        # what is known before scatters as much as was said of it, whatever its residual happens to be
        meat = gain * np.append(misfits / (1.0 - leverage), np.full(len(known), scatter))[:, None]
        return solution, float(np.sum(misfits**2)) * unit**2, np.asarray((meat.T @ meat)[:2, :2])

    def intensities(self, x: Array) -> tuple[Scalars, Array]:
        """Give the intensities (n,) of the shape, with a tail of a weaker one beside it too, and their derivatives."""
        offset = self.places - x[:2]
        value, by_shape = self.shape.picture(offset, x[4], x[5])
        by_tail = np.empty((len(offset), 0))
        if len(x) > 6:
            beside, by_beside = self.shape.picture(offset - np.array([x[7], 0.0]), x[4], x[5])
            by_tail = np.column_stack([beside - value, -x[6] * by_beside[:, 0]])
            value, by_shape = (1.0 - x[6]) * value + x[6] * beside, (1.0 - x[6]) * by_shape + x[6] * by_beside
        height = x[3]
        by_level = np.column_stack([self.around, value])
        derivatives = np.column_stack([-height * by_shape[:, :2], by_level, height * by_shape[:, 2:], height * by_tail])
        return np.asarray(x[2] * self.around + height * value), derivatives
