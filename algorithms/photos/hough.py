"""Hough transform of edge pixels: section 4.1.2 of M. Lichtenstein's dissertation (Aachen 2011).

Lines are written in Hesse's form x cos φ + y sin φ = r, equation (4.2), with 0 ≤ φ < 180° and r of either sign (the
dissertation mirrors negative r to positive ones; the set of lines is the same).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float64, Int32

from algorithms.arrays import Array, Scalars
from algorithms.photos.canny import EdgeImage, canny
from algorithms.photos.hough_kernels import cast_votes, pick_peaks
from algorithms.photos.images import GreyImage
from algorithms.photos.options import EdgeOptions
from algorithms.photos.segment_tracking import track_lines

DISTANCE_STEP_PX = 1.0
"""Width of the cells across the lines; edge pixels are known to half of it [px]."""
LARGEST_CELLS = 40_000_000
"""The accumulator has at most so many cells; larger photos get coarser angles."""
GRADIENT_TOLERANCE_RAD = float(np.deg2rad(10.0))
"""Pixels vote for lines that run along their edge to this angle."""
SUPPRESSION = 2
"""Cells around a maximum that are set to zero to both sides: two, as the dissertation does."""
MOST_LINES = 20_000


@dataclass(frozen=True, eq=False)
class HoughSpace:
    """Votes for lines."""

    votes: Int32[Array, "angles distances"]
    angle_step_rad: float
    """φ of row k is k times this."""
    distance_step_px: float
    least_distance_px: float
    """r of column k is this plus k times the step."""


@dataclass(frozen=True, eq=False)
class HesseLines:
    """Straight lines x cos φ + y sin φ = r, those with the most votes first."""

    normals_rad: Scalars
    """(n,) φ [rad]."""
    distances_px: Scalars
    """(n,) r [px]."""


def angle_step(width: int, height: int) -> float:
    """Choose the step of φ so that a line across half the photo's diagonal turns by one distance cell [rad].

    Coarser, and long edges fall into several cells; finer, and they spread over many small maxima: the choice that
    section 4.1.2 calls critical.
    """
    half_diagonal = 0.5 * float(np.hypot(width, height))
    bins = 2.0 * half_diagonal * 2.0 / DISTANCE_STEP_PX
    step = max(DISTANCE_STEP_PX / half_diagonal, np.pi * bins / LARGEST_CELLS)
    return float(np.pi / np.ceil(np.pi / step))


def vote(image: EdgeImage) -> HoughSpace:
    """Let every edge pixel vote for the lines through it."""
    height, width = image.edges.shape
    step = angle_step(width, height)
    count = round(np.pi / step)
    angles = np.arange(count) * step
    reach = float(np.ceil(np.hypot(width, height)))
    bins = int(2.0 * reach / DISTANCE_STEP_PX) + 1
    rows, columns = np.nonzero(image.edges)
    gradient = np.arctan2(image.gy[rows, columns], image.gx[rows, columns])
    first = np.ceil((gradient - GRADIENT_TOLERANCE_RAD) / step).astype(np.int64)
    last = np.floor((gradient + GRADIENT_TOLERANCE_RAD) / step).astype(np.int64)
    votes = cast_votes(
        rows, columns, np.column_stack([first, last]), np.cos(angles), np.sin(angles), DISTANCE_STEP_PX, -reach, bins
    )
    return HoughSpace(votes, step, DISTANCE_STEP_PX, -reach)


def peaks(space: HoughSpace, least_votes: int) -> HesseLines:
    """Take the maximum, set it and its neighbourhood to zero, and repeat down to `least_votes`."""
    flat = space.votes.ravel()
    cells = np.flatnonzero(flat >= least_votes)
    cells = cells[np.argsort(-flat[cells], kind="stable")]
    mirror = -2.0 * space.least_distance_px / space.distance_step_px
    picked = pick_peaks(space.votes, cells, least_votes, SUPPRESSION, SUPPRESSION, mirror)[:MOST_LINES]
    return HesseLines(
        normals_rad=picked[:, 0] * space.angle_step_rad,
        distances_px=space.least_distance_px + picked[:, 1] * space.distance_step_px,
    )


def canny_hough(grey: GreyImage, options: EdgeOptions) -> Float64[Array, "n 4"]:
    """Find straight pieces as the dissertation does: Canny, Hough, and tracking of each line through the edge pixels.

    Returns
    -------
    x and y of both ends [px].
    """
    image = canny(grey, options)
    lines = peaks(vote(image), max(5, int(0.7 * options.min_length_px)))
    return track_lines(
        image,
        lines.normals_rad,
        lines.distances_px,
        gap_px=int(options.max_gap_px),
        least_px=0.7 * options.min_length_px,
    )


def canny_hough_probabilistic(grey: GreyImage, options: EdgeOptions) -> Float64[Array, "n 4"]:
    """Find straight pieces by the progressive probabilistic Hough transform of OpenCV (Matas et al. 2000)."""
    image = canny(grey, options)
    height, width = grey.shape
    found = cv2.HoughLinesP(
        image.edges.astype(np.uint8),
        rho=DISTANCE_STEP_PX,
        theta=max(angle_step(width, height), float(np.deg2rad(0.25))),
        threshold=max(5, int(0.7 * options.min_length_px)),
        minLineLength=0.7 * options.min_length_px,
        maxLineGap=options.max_gap_px,
    )
    return np.zeros((0, 4)) if found is None else np.asarray(found, dtype=np.float64).reshape(-1, 4)
