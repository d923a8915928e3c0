"""Black-and-white boards: crossings in the intensity, measured in the plane of the board, and tests that it is one."""

import numpy as np
from scipy import ndimage

from algorithms.arrays import Array, Points
from algorithms.errors import InvalidInputError
from algorithms.progress import NoProgress, Progress
from algorithms.targets.board_template import HOPELESS, TEMPLATE_SHARE, CrossingFit, fit_crossing, searched_crossing
from algorithms.targets.found import Candidate, FoundTarget, RejectedCandidate
from algorithms.targets.options import TargetKind
from algorithms.targets.seen_cloud import SeenCloud
from algorithms.targets.tangent_plane import TangentPlane, plane_through

SMALLEST_HALF_PX, LARGEST_HALF_PX = 1.5, 9.2
"""Half a board takes so many cells of the two levels of the image pyramid on which it is looked for: on the coarser one
against noise, on the finer one where it is foreshortened."""
LEAST_SADDLE = 0.07
"""Strength of a crossing relative to the mean intensity around it."""
MOST_CANDIDATES = 1500
WORTH_A_WORD = 0.5
"""Crossings that agree less with the template are not even named as rejected."""
LEAST_AGREEMENT, LEAST_COVERAGE = 0.8, 0.7
LEAST_CONTRAST = 0.25
LEAST_IN_QUADRANT = 4
STEEPEST_RAD = float(np.deg2rad(75.0))
WORST_ANGLE_RAD = float(np.deg2rad(8.0))
OUTER, BEYOND = (0.30, 0.46), (0.56, 0.85)
"""Rings about the crossing in sides of the board: its own outer part, and what lies beyond its rim."""
LEAST_OUTER, MOST_BEYOND = 0.5, 0.5
"""Correlation with the template there: the pattern must be as large as the board, and no larger."""
MOST_OFF_PLANE = 0.15
MOST_STD = 0.03
"""Standard deviation of a board's crossing in sides: what chance makes look like one is known worse."""
REACH = 0.25
"""A crossing lies within so many sides of where it is looked for."""
INNER, LEAST_AREA = 0.22, 0.7
"""About the crossing, in sides, the points are counted that tell how many the whole board should hold, and the share of
them that it must hold."""
MOST_POINTS = 40_000


def find_boards(cloud: SeenCloud, size_m: float, *, progress: Progress | None = None) -> list[Candidate]:
    """Find square boards of four squares by their crossing.

    Parameters
    ----------
    cloud
        The scan about its instrument, with intensities.
    size_m
        Side of the whole board [m].
    progress
        Is told the candidates that were looked at.

    Returns
    -------
    Found ones and rejected ones, some of them twice.

    Raises
    ------
    InvalidInputError
        For a scan without intensities.
    """
    if cloud.intensity is None:
        raise InvalidInputError("scan", "boards are seen in the intensities, and it has none", "look for spheres")
    listener = progress or NoProgress()
    places = crossing_places(cloud, size_m)
    found: list[Candidate] = []
    for number, place in enumerate(places):
        listener.report(number / len(places), "boards")
        candidate = tested_board(cloud, place, size_m)
        if candidate is not None:
            found.append(candidate)
    return found


def crossing_places(cloud: SeenCloud, size_m: float) -> Points:
    """Give places (k, 3) where the intensity has a saddle at the scale of a board, the strongest first.

    On each level of an image pyramid the Hessian's negative determinant marks crossings, however they are turned and
    foreshortened; a cell belongs to the levels on which half a board takes two to nine cells.
    """
    assert cloud.intensity is not None  # noqa: S101 - said to the type checker, tested by the caller
    there = cloud.index >= 0
    number = np.maximum(cloud.index, 0)
    weight = there.astype(np.float32)
    value = np.where(there, cloud.intensity[number], 0.0).astype(np.float32)
    ranges = np.where(there, cloud.ranges[number], 0.0).astype(np.float32)
    step = float(np.sqrt(cloud.row_step_rad * cloud.column_step_rad))
    strengths, cells = [], []
    level = 0
    while min(weight.shape) >= 5:
        seen = np.maximum(weight, 1e-9)
        half = 0.5 * size_m / (np.maximum(ranges / seen, 1e-6) * step * 2**level)
        right = (weight > 0.0) & (half >= SMALLEST_HALF_PX) & (half < LARGEST_HALF_PX)
        if np.any(right):
            strength = _saddles(value, weight)
            peak = (strength == ndimage.maximum_filter(strength, 3)) & (strength > LEAST_SADDLE) & right
            rows, columns = np.nonzero(peak)
            strengths.append(strength[rows, columns])
            cells.append(np.stack([rows, columns, np.full(len(rows), level)], axis=1))
        elif level > 0 and not np.any((weight > 0.0) & (half >= SMALLEST_HALF_PX)):
            break
        value, weight, ranges = _halved(value), _halved(weight), _halved(ranges)
        level += 1
    if not strengths:
        return np.empty((0, 3))
    strength, cell = np.concatenate(strengths), np.concatenate(cells)
    best = np.argsort(-strength, kind="stable")[:MOST_CANDIDATES]
    places = [_point_in_cell(cloud, *(int(v) for v in cell[k])) for k in best]
    return np.array([place for place in places if place is not None]).reshape(-1, 3)


def _halved(image: Array) -> Array:
    """Add up the cells two by two; a last odd row or column is left out."""
    rows, columns = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
    return np.asarray(0.25 * image[:rows, :columns].reshape(rows // 2, 2, columns // 2, 2).sum(axis=(1, 3)))


def _saddles(value: Array, weight: Array) -> Array:
    """Give the root of the Hessian's negative determinant relative to the mean, 0 where it is no saddle."""
    smooth = ndimage.gaussian_filter(weight, 1.0)
    image = ndimage.gaussian_filter(value, 1.0) / np.maximum(smooth, 1e-6)
    by_row, by_column = np.gradient(image)
    row_row, row_column = np.gradient(by_row)
    column_column = np.gradient(by_column, axis=1)
    saddle = np.sqrt(np.maximum(row_column**2 - row_row * column_column, 0.0))
    mean = np.maximum(np.abs(ndimage.uniform_filter(image, 5)), 1e-12)
    return np.where(smooth > 0.3, saddle / mean, 0.0)


def _point_in_cell(cloud: SeenCloud, row: int, column: int, level: int) -> Array | None:
    """Give the point nearest to the middle of a cell of the pyramid, or None where there is none about it."""
    side = 2**level
    middle = (int((row + 0.5) * side), int((column + 0.5) * side))
    reach = max(1, side // 2)
    window = cloud.index[max(0, middle[0] - reach) : middle[0] + reach + 1, max(0, middle[1] - reach) :][
        :, : 2 * reach + 1
    ]
    numbers = window[window >= 0]
    if len(numbers) == 0:
        return None
    points = cloud.points[numbers]
    return np.asarray(points[np.argmin(np.abs(np.linalg.norm(points, axis=1) - np.median(cloud.ranges[numbers])))])


def tested_board(cloud: SeenCloud, start_m: Array, size_m: float) -> Candidate | None:
    """Measure the crossing at a place in the plane around it, and test that it is a board's; None where it looks like
    none at all.
    """
    assert cloud.intensity is not None  # noqa: S101 - said to the type checker, tested by the caller
    numbers = cloud.near(start_m, 1.25 * size_m)
    numbers = numbers[:: max(1, len(numbers) // MOST_POINTS)]
    points = cloud.points[numbers]
    plane = plane_through(points[np.linalg.norm(points - start_m, axis=1) < 0.42 * size_m])
    if plane is None or plane.incidence_rad > STEEPEST_RAD:
        return None
    places, off = plane.met_by(points)
    limit = max(5.0 * plane.noise_m, 0.03 * size_m) / np.cos(plane.incidence_rad)
    on_plane = off < limit
    # the beam meets the plane at the candidate somewhere, not necessarily in the mean of the points around
    shift, _ = plane.met_by(start_m[None, :])
    values = cloud.intensity[numbers]
    start = searched_crossing(places[on_plane] - shift[0], values[on_plane], size_m)
    start = (start[0] + shift[0], start[1], start[2])
    if abs(start[2]) < WORTH_A_WORD:
        return None
    spacing = float(np.linalg.norm(start_m)) * cloud.step_rad / np.sqrt(np.cos(plane.incidence_rad))
    fit = _fitted(places[on_plane], values[on_plane], start, size_m, 0.5 * spacing)
    if fit is None:
        return None
    centre = plane.in_space(fit.place) + cloud.sensor_m
    reason, coverage = _not_a_board(places, values, on_plane, fit, size_m)
    if reason is not None:
        return RejectedCandidate(TargetKind.BOARD, centre, reason)
    contrast = (fit.bright - fit.dark) / (fit.bright + fit.dark)
    inside = np.abs(fit.across(places[on_plane])).max(axis=1) < TEMPLATE_SHARE * size_m
    return FoundTarget(
        TargetKind.BOARD,
        centre,
        _covariance(plane, fit),
        int(np.count_nonzero(inside)),
        plane.incidence_rad,
        fit.rms,
        coverage,
        float(contrast),
        max(0.0, min(coverage, fit.agreement)),
        size_m,
        plane.normal,
    )


def _covariance(plane: TangentPlane, fit: CrossingFit) -> Array:
    return plane.covariance_of(fit.place, fit.covariance)


def _fitted(
    places: Array, values: Array, start: tuple[Array, float, float], size_m: float, blur_m: float
) -> CrossingFit | None:
    """Fit the crossing twice: the second time to the points that belong to the board as the first one found it."""
    fit: CrossingFit | None = None
    place, angle, _ = start
    for _ in range(2):
        normals = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        inside = np.abs((places - place) @ normals).max(axis=1) < TEMPLATE_SHARE * size_m
        if np.count_nonzero(inside) < 4 * LEAST_IN_QUADRANT:
            return None
        fit = fit_crossing(places[inside], values[inside], (place, angle, start[2]), blur_m, REACH * size_m)
        if fit is None or float(np.linalg.norm(fit.place - start[0])) > REACH * size_m:
            return None
        if fit.agreement < HOPELESS:
            break
        place, angle = fit.place, float(fit.angles_rad[0])
    return fit


def _not_a_board(
    places: Array, values: Array, on_plane: Array, fit: CrossingFit, size_m: float
) -> tuple[str | None, float]:
    """Say why a crossing is no board's, or nothing; and which share of the four squares' parts holds points."""
    across = fit.across(places) / size_m
    radius = np.abs(across).max(axis=1)
    inside = radius < TEMPLATE_SHARE
    mine = across[inside & on_plane]
    signs = np.sign(across[:, 0] * across[:, 1])
    corner = 2 * (mine[:, 0] > 0.0).astype(np.int64) + (mine[:, 1] > 0.0)
    counts = np.bincount(corner, minlength=4)
    coverage = float(np.mean(np.minimum(counts / max(float(np.median(counts)), 1.0), 1.0)))
    inner = int(np.count_nonzero(on_plane & (radius < INNER)))
    area = len(mine) / max((TEMPLATE_SHARE / INNER) ** 2 * inner, 1.0)
    contrast = (fit.bright - fit.dark) / max(abs(fit.bright + fit.dark), 1e-300)
    between = abs((fit.angles_rad[1] - fit.angles_rad[0] + 0.5 * np.pi) % np.pi - 0.5 * np.pi)
    skew = abs(0.5 * np.pi - between)
    outer = _correlation(values, signs, on_plane & (radius > OUTER[0]) & (radius < OUTER[1]))
    beyond = _correlation(values, signs, on_plane & (radius > BEYOND[0]) & (radius < BEYOND[1]))
    off_plane = float(np.mean(~on_plane[inside]))
    std = float(np.sqrt(np.linalg.eigvalsh(fit.covariance)[-1])) / size_m
    same = np.sign(fit.agreement) if outer is None else np.sign(outer)
    checks = (
        (counts.min() < LEAST_IN_QUADRANT, f"a square holds only {counts.min()} points"),
        (fit.agreement < LEAST_AGREEMENT, f"the template explains only {fit.agreement:.0%} of the intensities"),
        (
            coverage < LEAST_COVERAGE,
            f"its squares hold unequal numbers of points: {counts.tolist()}",
        ),
        (contrast < LEAST_CONTRAST, f"the contrast is only {contrast:.2f}"),
        (skew > WORST_ANGLE_RAD, f"the edges are {np.degrees(skew):.0f} degrees off a right angle"),
        (std > MOST_STD, f"its crossing is known to {std * size_m * 1e3:.1f} mm only"),
        (off_plane > MOST_OFF_PLANE, f"{off_plane:.0%} of its points lie off its plane"),
        (area < LEAST_AREA, f"it holds only {area:.0%} of the points that a board of {size_m * 1e3:.0f} mm should"),
        (outer is not None and abs(outer) < LEAST_OUTER, f"the pattern is smaller than {size_m * 1e3:.0f} mm"),
        (beyond is not None and same * beyond > MOST_BEYOND, f"the pattern goes on beyond {size_m * 1e3:.0f} mm"),
    )
    return next((reason for failed, reason in checks if failed), None), coverage


def _correlation(values: Array, signs: Array, which: Array) -> float | None:
    """Give the correlation of intensities with the template's signs; None of fewer than eight points."""
    if np.count_nonzero(which) < 8:
        return None
    values, signs = values[which], signs[which]
    spread = float(np.std(values) * np.std(signs))
    return float(np.mean((values - values.mean()) * (signs - signs.mean()))) / spread if spread > 0.0 else 0.0
