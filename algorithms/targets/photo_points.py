"""Targets in photos of a station, looked for in the window that the scan gives (Ullrich, Schwarz and Kager 2003)."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from algorithms.arrays import Array, Vector3
from algorithms.errors import InvalidInputError
from algorithms.photos.images import grey_image, noise_std
from algorithms.photos.station_photo import StationPhoto
from algorithms.targets.board_template import TEMPLATE_SHARE, fit_crossing
from algorithms.targets.found import FoundTarget
from algorithms.targets.options import TargetKind
from algorithms.targets.photo_agreement import Candidate, ImagePoint, NotSeen, agreeing
from algorithms.targets.photo_sights import LEAST_AGREEMENT, WINDOW_SIGMAS, Sight, sight_of
from algorithms.targets.photo_squares import SquareFit, fit_square
from algorithms.targets.photo_textures import texture_covariance

TEMPLATE_PX = 40.0
"""In the first search it is made so small."""
BLUR_PX = 0.7
"""Standard deviation of what lens and pixel blur, before it is seen."""
BOARD_TURNS = np.deg2rad(np.arange(0.0, 90.0, 15.0))
SQUARE_TURNS = np.deg2rad([0.0, 22.5, 45.0, 67.5])
LEAST_LIKENESS, WORTH_TRYING, MOST_TRIED = 0.45, 0.75, 4
"""Correlation with the template of places that are looked at closely, that relative to the largest, and how many."""
LEAST_STD_PX = 0.002
"""A centre in a photo is never known better: brightness is not even to the last."""
AROUND, CLEAR_BLURS = 1.5, 3.0
"""The ground's texture is that of so many sizes around a square, beyond so many blurs from it."""
MOST_STRETCH = {True: 0.12, False: 1.5}
"""Of a shape whose plane is known, or is not."""
WORST_ANGLE_RAD = float(np.deg2rad(8.0))


def find_in_photo(photo: StationPhoto, targets: Sequence[FoundTarget], origin_m: Vector3) -> list[ImagePoint | NotSeen]:
    """Measure the targets of a scan in a photo of the same station.

    Each target is projected with its covariance and that of the mount; in the window of four standard deviations its
    own picture, foreshortened as the plane that the scan measured says, is looked for and then fitted to the pixels,
    whose rays are brought into the target's plane: neither perspective nor the lens's distortion moves the centre.

    Parameters
    ----------
    photo
        Pixels, camera and mount.
    targets
        Of the scan, in its reduced frame.
    origin_m
        (3,) of that frame: the photo's pose is in full coordinates.

    Returns
    -------
    One entry for each target, in their order.

    Raises
    ------
    InvalidInputError
        When the photo does not have the size of its camera.
    """
    camera = photo.camera
    if photo.image.shape[:2] != (camera.height, camera.width):
        size = f"{photo.image.shape[1]} by {photo.image.shape[0]} pixels"
        raise InvalidInputError("photo", size, f"the camera's are {camera.width} by {camera.height}")
    grey = grey_image(photo.image)
    seen = photo, grey, noise_std(grey)
    sights = [sight_of(*seen, target, origin_m) for target in targets]
    answers: list[ImagePoint | NotSeen] = []
    candidates: list[Candidate] = []
    for number, sight in enumerate(sights):
        found = NotSeen(number, sight) if isinstance(sight, str) else _measured(number, sight)
        answers.append(found if isinstance(found, NotSeen) else found[0].point)
        candidates += [] if isinstance(found, NotSeen) else found
    for decided in agreeing(candidates, photo.mount_covariance):
        answers[decided.target] = decided
    return answers


def _measured(number: int, sight: Sight) -> list[Candidate] | NotSeen:
    """Measure what in the window looks like a target, or say why nothing does."""
    tried = [_fitted(sight.at(place), turn, sign) for place, turn, sign in _alike(sight)]
    expected = sight.expected_px, sight.covariance_px2
    found = [
        Candidate(
            ImagePoint(number, fit.image_px, fit.covariance_px2, *expected, fit.agreement, fit.contrast),
            sight.own_covariance_px2,
            sight.by_mount,
            sight.size_px,
        )
        for fit in tried
        if not isinstance(fit, str)
    ]
    if found:
        return found
    return NotSeen(
        number, next((each for each in tried if isinstance(each, str)), "nothing in its window looks like it")
    )


def _alike(sight: Sight) -> list[tuple[Array, float, float]]:
    """Give the places (2,) [px] in the window that look like the target, most alike first, with turn and sign."""
    reach = np.ceil(WINDOW_SIGMAS * np.sqrt(np.diag(sight.covariance_px2)) + 2.0).astype(np.int64)
    half = int(np.ceil(0.5 * sight.size_px * 1.42 + sight.rim_m / sight.pixel_m))
    middle = np.rint(sight.expected_px).astype(np.int64)
    low, high = middle - reach - half, middle + reach + half + 1
    # beyond the rim of the photo its last pixels go on
    seen = (np.clip(np.arange(low[k], high[k]), 0, sight.grey.shape[1 - k] - 1) for k in (1, 0))
    window = sight.grey[np.ix_(*seen)]
    scale = max(1, int(sight.size_px / TEMPLATE_PX))
    small = window if scale == 1 else _shrunk(window, scale)
    steps = np.arange(-(half // scale), half // scale + 1) * scale
    columns, rows = (each.ravel() for each in np.meshgrid(steps, steps))
    pixels = sight.expected_px + np.column_stack([columns, rows])
    places = sight.places(np.clip(pixels, -0.5, np.array(sight.grey.shape[::-1]) - 0.5))
    size = (len(steps), len(steps))
    found = []
    for turn in BOARD_TURNS if sight.target.kind is TargetKind.BOARD else SQUARE_TURNS:
        template, mask = _template(sight, places, turn, scale)
        if np.count_nonzero(mask) < 9:
            continue
        alike = cv2.matchTemplate(
            small.astype(np.float32), template.reshape(size), cv2.TM_CCOEFF_NORMED, mask=mask.reshape(size)
        )
        alike = np.where(np.isfinite(alike), alike, 0.0)
        peaks = np.abs(alike)
        highest = (peaks == cv2.dilate(peaks, np.ones((3, 3)))) & (peaks > LEAST_LIKENESS)
        for row, column in np.argwhere(highest):
            # pixel k of the shrunk window covers the pixels from scale k on
            middle_px = np.array([column, row]) * scale + (len(steps) // 2) * scale + 0.5 * (scale - 1)
            found.append((float(peaks[row, column]), low + middle_px, turn, float(alike[row, column])))
    found.sort(key=lambda each: -each[0])
    kept: list[tuple[Array, float, float]] = []
    inside = sight.photo.camera.inside(np.array([each[1] for each in found]).reshape(-1, 2))
    for (likeness, place, turn, sign), in_photo in zip(found, inside, strict=True):
        if len(kept) == MOST_TRIED or likeness < WORTH_TRYING * found[0][0]:
            break
        if in_photo and all(float(np.linalg.norm(place - other[0])) > max(0.3 * sight.size_px, 2.0) for other in kept):
            kept.append((place, turn, sign))
    return kept


def _shrunk(window: Array, scale: int) -> Array:
    """Average blocks of pixels; an incomplete last row or column is left out."""
    rows, columns = (length // scale * scale for length in window.shape)
    return np.asarray(window[:rows, :columns].reshape(rows // scale, scale, columns // scale, scale).mean(axis=(1, 3)))


def _template(sight: Sight, places: Array, turn: float, scale: int) -> tuple[Array, Array]:
    """Give the brightness (n,) of the target at places of its plane, and which of them (n,) count: float32."""
    size, width = sight.target.size_m, sight.pixel_m * scale
    own = places @ _axes(turn)
    if sight.target.kind is TargetKind.BOARD:
        value = np.prod(np.clip(own / width, -1.0, 1.0), axis=1)
        mask = np.abs(own).max(axis=1) < TEMPLATE_SHARE * size
    else:
        value = np.prod(np.clip((0.5 * size - np.abs(own)) / width + 0.5, 0.0, 1.0), axis=1)
        mask = np.abs(own).max(axis=1) < 0.5 * size + sight.rim_m
    return value.astype(np.float32), mask.astype(np.float32)


def _axes(turn: float) -> Array:
    """Give the directions (2, 2), one a column, of axes turned by an angle [rad]."""
    return np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])


@dataclass(frozen=True, eq=False)
class _Fit:
    image_px: Array
    covariance_px2: Array
    agreement: float
    contrast: float


def _fitted(sight: Sight, turn: float, sign: float) -> _Fit | str:
    """Fit the target at a place of the window, or say why it is none."""
    half = int(np.ceil(0.5 * sight.size_px * 1.42 + sight.rim_m / sight.pixel_m)) + 1
    middle = sight.photo.camera.image_from_camera(sight.plane.centre_m[None, :])[0]
    low = np.maximum(np.rint(middle).astype(np.int64) - half, 0)
    high = np.minimum(np.rint(middle).astype(np.int64) + half + 1, sight.grey.shape[::-1])
    columns, rows = (each.ravel() for each in np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1])))
    if len(columns) == 0:
        return "it is cut off by the rim of the photo"
    places = sight.places(np.column_stack([columns, rows]).astype(np.float64))
    grey = sight.grey[rows, columns].astype(np.float64)
    if sight.target.kind is TargetKind.BOARD:
        return _fitted_board(sight, places, grey, turn, sign)
    size, known = sight.target.size_m, sight.plane.told
    mask = np.abs(places @ _axes(turn)).max(axis=1) < 0.5 * size + sight.rim_m
    start, blur_m = np.array([0.0, 0.0, turn]), BLUR_PX * sight.pixel_m
    fit = fit_square(places[mask], grey[mask], size, start, blur_m, plane_is_known=known)
    if fit is None:
        return "the brightness of its window is not that of a square"
    if fit.agreement < LEAST_AGREEMENT and not sight.clear(fit.rms, fit.contrast):
        return f"a square explains only {max(fit.agreement, 0.0):.0%} of the brightness there"
    if fit.stretch > MOST_STRETCH[known]:
        return f"what is there is {fit.stretch:.0%} larger or smaller than the square"
    weights = np.zeros((2, len(places)))
    weights[:, mask] = fit.by_ground
    covariance = _with_texture(sight, fit, (low, high), weights)
    return _in_photo(sight, fit.place, covariance, fit.agreement, fit.contrast)


def _with_texture(sight: Sight, fit: SquareFit, window: tuple[Array, Array], weights: Array) -> Array:
    """Give the covariance (2, 2) of a square's place, at least that of the ground around it.

    Parameters
    ----------
    sight, fit
        The square.
    window
        First column and row, and those after the last.
    weights
        (2, n) derivatives of the place by the ground behind the window's pixels.
    """
    (low, high), reach = window, round(AROUND * sight.size_px)
    begin, end = np.maximum(low - reach, 0), np.minimum(high + reach, sight.grey.shape[::-1])
    columns, rows = np.meshgrid(np.arange(begin[0], end[0]), np.arange(begin[1], end[1]))
    places = sight.places(np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64)) - fit.place
    clear = 0.5 * sight.target.size_m + CLEAR_BLURS * BLUR_PX * sight.pixel_m
    ground = (np.abs(places @ _axes(fit.turn_rad)).max(axis=1) > clear).reshape(rows.shape)
    moved = np.zeros((2, *rows.shape))
    part = slice(low[1] - begin[1], high[1] - begin[1]), slice(low[0] - begin[0], high[0] - begin[0])
    moved[:, *part] = weights.reshape(2, high[1] - low[1], high[0] - low[0])
    texture = texture_covariance(sight.grey[begin[1] : end[1], begin[0] : end[0]], ground, moved)
    if texture is None:
        return fit.covariance
    return max(fit.covariance, texture + fit.inside_covariance, key=np.trace)


def _fitted_board(sight: Sight, places: Array, grey: Array, turn: float, sign: float) -> _Fit | str:
    size, fit = sight.target.size_m, None
    place = np.zeros(2)
    for _ in range(2):
        inside = np.abs((places - place) @ _axes(turn)).max(axis=1) < TEMPLATE_SHARE * size
        if np.count_nonzero(inside) < 4 * 6:
            return "its squares hold too few pixels"
        fit = fit_crossing(places[inside], grey[inside], (place, turn, sign), BLUR_PX * sight.pixel_m, size)
        if fit is None or float(np.linalg.norm(fit.place)) > 0.5 * size:
            return "the brightness of its window is not that of a board"
        place, turn = fit.place, float(fit.angles_rad[0])
    assert fit is not None  # noqa: S101 - said to the type checker
    contrast = fit.bright - fit.dark
    if fit.agreement < LEAST_AGREEMENT and not sight.clear(0.5 * fit.rms * contrast, contrast):
        return f"a board explains only {max(fit.agreement, 0.0):.0%} of the brightness there"
    between = abs((fit.angles_rad[1] - fit.angles_rad[0] + 0.5 * np.pi) % np.pi - 0.5 * np.pi)
    skew = abs(0.5 * np.pi - between)
    if skew > WORST_ANGLE_RAD:
        return f"the edges there are {np.degrees(skew):.0f} degrees off a right angle in the board's plane"
    return _in_photo(sight, fit.place, fit.covariance, fit.agreement, contrast)


def _in_photo(sight: Sight, place: Array, covariance: Array, agreement: float, contrast: float) -> _Fit:
    """Bring a place of the target's plane and its covariance back into the photo."""
    camera = sight.photo.camera
    centre = sight.plane.in_space(place)[None, :]
    by_place = (
        camera.image_jacobians(camera.ideal_from_camera(centre))[0]
        @ camera.projection_jacobians(centre)[0]
        @ sight.plane.basis
    )
    image = camera.image_from_camera(centre)[0]
    whole = by_place @ covariance @ by_place.T + LEAST_STD_PX**2 * np.eye(2)
    return _Fit(image, np.asarray(whole), agreement, abs(contrast))
