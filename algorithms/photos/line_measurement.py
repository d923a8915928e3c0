"""From first straight pieces to measured lines: the same for every detector."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Flags, Indices, Scalars
from algorithms.geometry.cameras import Camera
from algorithms.photos.edge_chains import covered
from algorithms.photos.edge_profile import (
    LEAST_WIDTH_PX,
    EdgePoints,
    clear_half_widths,
    edge_function,
    locate,
)
from algorithms.photos.edge_widths import composite_edges, displacement_stds
from algorithms.photos.images import GreyImage, noise_std
from algorithms.photos.line_fit import (
    EdgeLines,
    LineFit,
    fit_lines,
    ideal_from_image,
    image_from_ideal,
    lines_between,
    moved,
    noise_variances,
    place_patches,
)
from algorithms.photos.line_merging import merge_collinear, without_doubles
from algorithms.photos.options import EdgeOptions
from algorithms.photos.segment_tracking import walk_along
from algorithms.photos.segments import ImageSegments, joined, longest_first, no_segments
from algorithms.photos.systematic_errors import systematic_covariances

CORNER_PX, CORNER_SHARE = 3.0, 0.1
"""So much is left out at each end of a line when it is fitted [px, share of its length]."""
FIRST_WIDTH_PX, FIRST_HALF_WIDTH_PX = 1.0, 3.5
"""Profile with which a piece is first brought onto its edge [px]."""
LEAST_HALF_WIDTH_PX = 2.0
"""Grey values count at least so far from the edge [px]."""
LEAST_WIDTHS = 2.5
"""The profile is no wider than this part of the distance to which grey values count, or its levels would be guessed."""
WIDE, BESIDE_PX = 3.0, 2.0
"""They count to so many widths of the profile and so many pixels of the levels beside it."""
CUT_PX = 0.3
"""Less is the change of the width since then [px]."""
GAUSSIAN_OF_ARCTAN = 0.85
"""Standard deviation of the Gaussian whose slope is as wide at half height as an arctan's of width 1: 2 / 2.355."""
LARGEST_STEP_PX = 1.0
LARGEST_OFFSET_STD_PX = 0.5
LARGEST_UNEXPLAINED_STD_PX = 0.26
"""Where more uncertainty is left that the noise does not explain, there is texture, not a straight edge [px]."""
SURE_LENGTH, SURE_UNEXPLAINED = 2.0, 0.5
"""A piece that was lost when it was followed is an edge all the same with so many times the least length, and with this
part of the unexplained uncertainty."""
HOPELESS = 3.0
"""Before pieces are joined and followed so many times that much is allowed: longer lines are more certain."""
LEAST_SIGNIFICANCE = 6.0
"""Contrast in its standard deviations."""
LARGEST_LAST_TURN_RAD = float(np.deg2rad(0.5))
"""The last step turns no line by more, or the fit has not settled."""
SHORTEST_PX = 4.0
"""Shorter first pieces have no direction [px]."""
FURTHEST_PX = 3.0
"""A line that moves further from its first piece has lost its edge [px]."""
FIRST_ROUNDS, ROUNDS, LAST_ROUNDS = 2, 2, 2
"""Steps of the fit at first, after each walk, and at the end."""
WALKS = 2
"""Lines are joined and followed so often: the second time along the direction that the first gave them."""


@dataclass(frozen=True, eq=False)
class _Step:
    """One step of the fit of all lines."""

    lines: EdgeLines
    """The corrected lines."""
    fit: LineFit
    points: EdgePoints
    owners: Indices
    """(m,) line of each edge point."""


def _without_ends(lines: EdgeLines) -> EdgeLines:
    """Leave the ends out, where the blur of the corner displaces the edge."""
    trimmed = np.minimum(CORNER_PX, CORNER_SHARE * lines.lengths)
    return replace(lines, extents=lines.extents + trimmed[:, None] * np.array([1.0, -1.0]))


def _with_ends(measured: EdgeLines, before: EdgeLines) -> EdgeLines:
    """Give measured lines the length again that they had before their ends were left out."""
    ends = before.centres[:, None] + before.extents[:, :, None] * before.directions[:, None]
    along = np.einsum("nei,ni->ne", ends - measured.centres[:, None], measured.directions)
    return replace(measured, extents=along)


def _step(grey: GreyImage, lines: EdgeLines, camera: Camera | None, options: EdgeOptions, noise: float) -> _Step:
    """Measure all lines once and correct their place and width."""
    placed = place_patches(lines, camera)
    points = locate(grey, placed.patches, lines.widths, lines.half_widths, options.localisation)
    fit = fit_lines(placed, points, LARGEST_STEP_PX, noise)
    widening = np.clip(points.widening, -0.4 * lines.widths, 0.4 * lines.widths)
    widths = np.clip(lines.widths + widening, LEAST_WIDTH_PX, lines.half_widths / LEAST_WIDTHS)
    return _Step(replace(moved(lines, fit), widths=widths), fit, points, placed.patches.owners)


def _brighter_side_first(grey: GreyImage, lines: EdgeLines, camera: Camera | None) -> EdgeLines:
    """Turn lines so that their normals point to the brighter side, as the grey values next to them say."""
    placed = place_patches(lines, camera)
    next_to = np.full(len(lines), LEAST_HALF_WIDTH_PX)
    points = locate(grey, placed.patches, lines.widths, next_to, "gaussian")
    rise = np.bincount(placed.patches.owners, points.contrasts, len(lines))
    return lines.turned(rise < 0.0)


def _with_clear_sides(grey: GreyImage, lines: EdgeLines, camera: Camera | None, noise: float) -> EdgeLines:
    """Choose how far from each edge grey values count, from its width and its neighbours."""
    clear = clear_half_widths(grey, place_patches(lines, camera).patches, noise, LEAST_HALF_WIDTH_PX)
    half_widths = np.minimum(clear, WIDE * lines.widths + BESIDE_PX)
    return replace(lines, half_widths=half_widths, widths=np.minimum(lines.widths, half_widths / LEAST_WIDTHS))


def _still_there(before: EdgeLines, after: EdgeLines, fit: LineFit) -> Flags:
    """Tell which lines have edge points at all and stayed near the pieces they came from."""
    relative = after.centres - before.centres
    across = np.abs(np.sum(relative * before.normals, axis=1))
    turn = np.abs(np.sum(after.directions * before.normals, axis=1))
    return np.asarray((fit.point_counts >= 2) & (across + 0.5 * turn * before.lengths < FURTHEST_PX))


def _unexplained_std(fit: LineFit, noise: float) -> Scalars:
    """Give the standard deviation of the offsets less what the photo's noise explains, (n,) [px]."""
    unexplained = 1.0 - np.minimum(1.0, noise**2 / fit.grey_variances)
    return np.asarray(np.sqrt(fit.covariances[:, 1, 1] * unexplained))


def _settled(
    grey: GreyImage, lines: EdgeLines, camera: Camera | None, options: EdgeOptions, noise: float, rounds: int
) -> EdgeLines:
    """Bring lines onto their edges; those that lose them, or turn out to lie on texture, vanish."""
    start = lines
    for _ in range(rounds):
        if len(lines) == 0:
            break
        step = _step(grey, lines, camera, options, noise)
        there = _still_there(start, step.lines, step.fit)
        there &= _unexplained_std(step.fit, noise) < HOPELESS * LARGEST_UNEXPLAINED_STD_PX
        lines, start = step.lines[there], start[there]
    return lines


def measure_lines(
    grey: GreyImage, pieces: Float64[Array, "n 4"], camera: Camera | None, options: EdgeOptions
) -> ImageSegments:
    """Measure the straight edges on which first pieces lie.

    Pieces are brought onto their edges by the profile fit, joined where they continue each other, followed to their
    ends, joined again, and fitted. What is lost on this way, as between edges that crowd, but is long and straight
    beyond doubt by itself, is an edge from the start to the end of its piece.

    Parameters
    ----------
    pieces
        (n, 4) x and y of both ends in the photo as taken [px].
    """
    lengths = np.hypot(pieces[:, 2] - pieces[:, 0], pieces[:, 3] - pieces[:, 1])
    noise = noise_std(grey)
    found = _followed(grey, pieces[lengths >= SHORTEST_PX], camera, options, noise)
    long = pieces[lengths >= SURE_LENGTH * options.min_length_px]
    left = long[~covered(long, found.raw_ends.reshape(-1, 4), grey.shape)]
    return longest_first(joined(found, _sure(grey, left, camera, options, noise)))[: options.max_segments]


def _on_edges(
    grey: GreyImage,
    pieces: Float64[Array, "n 4"],
    camera: Camera | None,
    options: EdgeOptions,
    noise: float,
    rounds: int,
) -> EdgeLines:
    """Bring pieces onto their edges."""
    limit = np.array([grey.shape[1], grey.shape[0]]) - 1.0
    ends = ideal_from_image(np.clip(pieces.reshape(-1, 2), 0.0, limit), camera).reshape(-1, 2, 2)
    lines = _brighter_side_first(grey, lines_between(ends, FIRST_WIDTH_PX, FIRST_HALF_WIDTH_PX), camera)
    lines = _with_clear_sides(grey, lines, camera, noise)
    return _settled(grey, lines, camera, options, noise, rounds)


def _sure(
    grey: GreyImage, pieces: Float64[Array, "n 4"], camera: Camera | None, options: EdgeOptions, noise: float
) -> ImageSegments:
    """Measure pieces as they are, and keep those that are edges beyond doubt."""
    if len(pieces) == 0:
        return no_segments()
    lines = without_doubles(_on_edges(grey, pieces, camera, options, noise, FIRST_ROUNDS + ROUNDS))
    lines = lines[lines.lengths >= SURE_LENGTH * options.min_length_px]
    lines = _with_clear_sides(grey, lines, camera, noise)
    return _measured(grey, lines, camera, options, noise, SURE_UNEXPLAINED * LARGEST_UNEXPLAINED_STD_PX)


def _followed(
    grey: GreyImage, pieces: Float64[Array, "n 4"], camera: Camera | None, options: EdgeOptions, noise: float
) -> ImageSegments:
    """Bring pieces onto their edges, join them and follow them to their ends."""
    if len(pieces) == 0:
        return no_segments()
    lines = _on_edges(grey, pieces, camera, options, noise, FIRST_ROUNDS)
    for _ in range(WALKS):
        lines = without_doubles(merge_collinear(lines, options.max_gap_px))
        lines = walk_along(grey, _with_clear_sides(grey, lines, camera, noise), camera, options)
        lines = _settled(grey, lines, camera, options, noise, ROUNDS)
    lines = without_doubles(merge_collinear(lines, options.max_gap_px))
    lines = lines[lines.lengths >= options.min_length_px]
    return _measured(grey, lines, camera, options, noise, LARGEST_UNEXPLAINED_STD_PX)


def _measured(
    grey: GreyImage, lines: EdgeLines, camera: Camera | None, options: EdgeOptions, noise: float, unexplained_px: float
) -> ImageSegments:
    """Fit lines without their ends, and keep those that are straight edges."""
    if len(lines) == 0:
        return no_segments()
    for _ in range(LAST_ROUNDS):
        step = _step(grey, _without_ends(lines), camera, options, noise)
        lines = _with_ends(step.lines, lines)
    return _accepted(replace(step, lines=lines), camera, options, noise, unexplained_px)


def _accepted(
    step: _Step, camera: Camera | None, options: EdgeOptions, noise: float, unexplained_px: float
) -> ImageSegments:
    """Keep the lines that are edges beyond doubt."""
    lines, fit, points = step.lines, step.fit, step.points
    count = len(lines)
    doubt = np.bincount(step.owners, points.contrast_variances, count) / np.bincount(step.owners, minlength=count) ** 2
    significance = points.edge_contrasts / np.sqrt(doubt * noise_variances(points, step.owners, count))
    # an arctan reaches its levels far away only: of its contrast the part within the band is seen
    reached = 2.0 * edge_function(lines.half_widths / lines.widths, options.localisation)[0]
    good = (
        (fit.point_counts >= 2)
        & (points.edge_contrasts >= options.min_contrast)
        & (significance >= LEAST_SIGNIFICANCE)
        & (fit.covariances[:, 1, 1] < LARGEST_OFFSET_STD_PX**2)
        & (_unexplained_std(fit, noise) < unexplained_px)
        & (np.abs(fit.angles) < LARGEST_LAST_TURN_RAD)
    )
    chosen = lines[good]
    cut = chosen.half_widths < WIDE * chosen.widths + BESIDE_PX - CUT_PX
    widths = (chosen.widths, points.edge_contrasts[good], chosen.lengths, noise)
    systematic = systematic_covariances(chosen, place_patches(chosen, camera), cut, displacement_stds(*widths))
    ends = chosen.centres[:, None] + chosen.extents[:, :, None] * chosen.directions[:, None]
    scale = GAUSSIAN_OF_ARCTAN if options.localisation == "arctan" else 1.0
    return ImageSegments(
        centres=chosen.centres,
        directions=chosen.directions,
        extents=chosen.extents,
        covariances=fit.covariances[good] + systematic,
        contrasts=(points.edge_contrasts * reached)[good],
        widths_px=scale * chosen.widths,
        point_counts=fit.point_counts[good],
        raw_ends=image_from_ideal(ends.reshape(-1, 2), camera).reshape(-1, 2, 2),
        composite=composite_edges(*widths),
    )
