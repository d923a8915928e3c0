"""Where an edge lies, to a small part of a pixel, from the grey values across it.

Section 4.1.3 of M. Lichtenstein's dissertation (Aachen 2011) follows Schwermann et al. (2003): the grey values
across the edge are approximated by an arctan function, I(t) = a + b F((t - p) / w) with F(z) = arctan(z) / π; p is the
place of the edge. A step blurred by a Gaussian, F the normal distribution less 1/2, is the other shape. The same two
shapes serve for one profile (`fit_profile`, to look at) and for patches of pixels along an edge (`locate`).
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.special import ndtr

from algorithms.arrays import Array, Indices, Matrix, Scalars, Vectors2
from algorithms.errors import InvalidInputError, NotConvergedError
from algorithms.photos.edge_profile_kernels import (
    ARCTAN,
    GAUSSIAN,
    mean_profiles,
    patch_sums,
    side_sums,
    solve_patches,
    sums_by_owner,
)
from algorithms.photos.images import GreyImage
from algorithms.photos.options import EdgeLocalisation

MAX_ITERATIONS = 60
SETTLED_PX = 1e-9
LEAST_WIDTH_PX = 0.3
"""The pixels alone blur an edge by so much, 1/√12 [px]."""
UPPER = ((0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3))
"""Order of the products in the sums of a patch."""
LEAST_DETERMINANT = 1e-7
"""Scaled normal equations with a smaller one say nothing."""
MANY_PATCHES = 5_000
NEIGHBOURS = 2
"""The contrast of a patch is taken from so many patches to both sides with it."""
TURNED_BACK = 0.65
REACH_PX = 8
"""The mean profile of an edge is looked at so far to both sides [px]."""


@dataclass(frozen=True, eq=False)
class ProfileFit:
    """One profile across an edge, fitted."""

    position: float
    """Place of the edge [px]."""
    width: float
    """w of the edge function, for the Gaussian its standard deviation [px]."""
    middle: float
    """Grey value at the edge, halfway between both sides."""
    contrast: float
    """Difference of the grey values far on both sides; positive when they rise with the position."""
    noise_std: float
    """Standard deviation of single grey values from the curve."""
    covariance: Float64[Array, "4 4"]
    """Covariance of (position, width, middle, contrast)."""


def edge_function(z: Array, shape: EdgeLocalisation) -> tuple[Array, Array]:
    """Give F(z), from -1/2 to 1/2, and its derivative, arctan or Gaussian."""
    if shape == "arctan":
        return np.arctan(z) / np.pi, 1.0 / (np.pi * (1.0 + z * z))
    return ndtr(z) - 0.5, np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)


def fit_profile(positions: Scalars, greys: Scalars, shape: EdgeLocalisation = "arctan") -> ProfileFit:
    """Fit a + b F((t - p) / w) to grey values at positions across an edge by least squares (Gauss-Newton, damped).

    Parameters
    ----------
    positions, greys
        (n,) places across the edge [px] and their grey values, n of at least 5.

    Raises
    ------
    InvalidInputError
        When the grey values show no difference, or are too few.
    NotConvergedError
        When the iteration does not settle.
    """
    if len(positions) < 5:
        raise InvalidInputError("profile", f"{len(positions)} grey values", "five or more")
    if np.ptp(greys) == 0.0:
        raise InvalidInputError("profile", "all grey values are equal: there is no edge")
    # the steepest place of the smoothed profile is a safe start
    order = np.argsort(positions)
    t, values = positions[order], greys[order]
    slopes = np.gradient(np.convolve(np.pad(values, 1, mode="edge"), [0.25, 0.5, 0.25], mode="valid"), t)
    p, w = float(t[np.argmax(np.abs(slopes))]), 1.0

    def solve(p: float, w: float) -> tuple[Matrix, Array, float]:
        f, slope = edge_function((t - p) / w, shape)
        levels = np.column_stack([np.ones_like(f), f])
        a, b = np.linalg.lstsq(levels, values, rcond=None)[0]
        design = np.column_stack([-b * slope / w, -b * slope * (t - p) / w**2, levels])
        residuals = values - levels @ np.array([a, b])
        return design, np.append(residuals, [a, b]), float(residuals @ residuals)

    damping, (design, state, square) = 1e-3, solve(p, w)
    for _ in range(MAX_ITERATIONS):
        normal = design.T @ design
        step = np.linalg.lstsq(normal + damping * np.diag(np.diag(normal)), design.T @ state[:-2], rcond=None)[0]
        new_p, new_w = p + step[0], float(np.clip(w + step[1], 0.5 * w, 2.0 * w))
        trial = solve(new_p, new_w)
        moved = max(abs(new_p - p), abs(new_w - w))
        if trial[2] <= square:
            p, w, (design, state, square), damping = new_p, new_w, trial, damping * 0.1
        else:
            damping *= 10.0
        if moved < SETTLED_PX:
            break
    else:
        raise NotConvergedError("edge profile", MAX_ITERATIONS, moved)
    variance = square / max(1, len(t) - 4)
    covariance = variance * np.linalg.pinv(design.T @ design)
    return ProfileFit(
        position=float(p),
        width=float(w),
        middle=float(state[-2]),
        contrast=float(state[-1]),
        noise_std=float(np.sqrt(variance)),
        covariance=covariance,
    )


@dataclass(frozen=True, eq=False)
class Patches:
    """Rectangles of pixels along edges, those of one edge in their order along it."""

    centres: Vectors2
    """(m, 2) points that should lie on the edge, in the photo as taken [px]."""
    normals: Vectors2
    """(m, 2) unit normals there, towards the brighter side."""
    half_lengths: Scalars
    """(m,) half of the length along the edge [px]."""
    owners: Indices
    """(m,) number of the edge, not falling."""
    edge_count: int
    """Number of edges."""


@dataclass(frozen=True, eq=False)
class EdgePoints:
    """What patches say of the edge."""

    shifts: Scalars
    """(m,) distance of the edge from the patch's centre along its normal [px]."""
    information: Scalars
    """(m,) inverse variance of the shift for noise of one grey level [1/px²]; 0 where nothing was to be seen."""
    contrasts: Scalars
    """(m,) contrast of the patch alone [grey levels], positive when the normal points to the brighter side."""
    contrast_variances: Scalars
    """(m,) its variance for noise of one grey level."""
    squares: Scalars
    """(m,) sum of the squared deviations of its grey values from the fitted profile."""
    freedoms: Scalars
    """(m,) their degrees of freedom."""
    edge_contrasts: Float64[Array, "edges"]
    """(n,) contrast of the whole edges [grey levels]."""
    widening: Float64[Array, "edges"]
    """(n,) change of the edges' widths that the grey values ask for [px]."""


def _whole_edges(sums: Array) -> tuple[Scalars, Scalars]:
    """Give contrast and change of width of edges from the sums over all their patches; 0 where not determined."""
    normal = np.empty((len(sums), 4, 4))
    for column, (i, j) in enumerate(UPPER):
        normal[:, i, j] = normal[:, j, i] = sums[:, column]
    scale = np.sqrt(np.maximum(np.einsum("mii->mi", normal), 1e-12))
    normal /= scale[:, :, None] * scale[:, None, :]
    regular = np.linalg.det(normal) > LEAST_DETERMINANT
    normal[~regular] = np.eye(4)
    solution = np.linalg.solve(normal, (sums[:, 10:14] / scale)[:, :, None])[:, :, 0] / scale
    regular &= solution[:, 1] != 0.0
    widening = np.divide(solution[:, 3], solution[:, 1], out=np.zeros(len(sums)), where=regular)
    determinant = sums[:, 0] * sums[:, 4] - sums[:, 1] ** 2
    rise = sums[:, 0] * sums[:, 11] - sums[:, 1] * sums[:, 10]
    flat = determinant <= LEAST_DETERMINANT * sums[:, 0] * sums[:, 4]
    return np.where(flat, 0.0, rise / np.where(flat, 1.0, determinant)), widening


def locate(
    grey: GreyImage,
    patches: Patches,
    widths: Scalars,
    half_widths: Scalars,
    localisation: EdgeLocalisation,
) -> EdgePoints:
    """Find the edge in every patch by one linearised step of the profile fit, from the pixels as they are.

    With the edge at distance δ from the patch's centre I = a + b F(t/w) - b δ F'(t) to first order; a, b and δ of each
    patch follow from linear least squares over its pixels at their own distances t, without resampling. δ is divided by
    the contrast of the neighbourhood, which noise hardly touches, so that the step is unbiased; repeated from the
    improved line it converges to the fit of the curve itself. Localisation by `area` chooses δ so that observed and
    fitted grey values have the same sum over the patch, the two sides taken from its outer halves.

    Parameters
    ----------
    widths, half_widths
        (n,) width w of each edge's profile, and how far across the edge pixels count [px].
    """
    kind = ARCTAN if localisation == "arctan" else GAUSSIAN
    places = (patches.centres, patches.normals, patches.half_lengths)
    reach, width = half_widths[patches.owners], widths[patches.owners]
    parts = [slice(None)]
    if len(width) > MANY_PATCHES:
        parts = [slice(0, len(width) // 2), slice(len(width) // 2, None)]

    def sums_of(part: slice) -> Array:
        centres, normals, half_lengths = (place[part] for place in places)
        return np.asarray(patch_sums(grey, centres, normals, half_lengths, reach[part], width[part], kind))

    # the compiled sums release the interpreter lock, and each patch stands alone
    with ThreadPoolExecutor(max_workers=len(parts)) as threads:
        sums = np.concatenate(list(threads.map(sums_of, parts)))
    solved = solve_patches(sums, patches.owners, NEIGHBOURS)
    edge_contrasts, widening = _whole_edges(sums_by_owner(sums, patches.owners, patches.edge_count))
    variances, nearby = solved[:, 1], solved[:, 5]
    usable = (variances > 0.0) & (nearby > 0.0)
    contrast = np.where(usable, nearby, 1.0)
    shifts = np.where(usable, -solved[:, 0] / contrast, 0.0)
    if localisation == "area":
        sides = side_sums(grey, *places, reach, width, kind)
        n_dark, n_bright = np.maximum(sides[:, 0], 1.0), np.maximum(sides[:, 3], 1.0)
        rise = sides[:, 5] / n_bright - sides[:, 2] / n_dark
        usable &= (sides[:, 0] > 0.0) & (sides[:, 3] > 0.0) & (rise > 0.0) & (sums[:, 2] > 0.0)
        step = (sides[:, 4] / n_bright - sides[:, 1] / n_dark) / np.where(usable, rise, 1.0)
        dark = sides[:, 1] / n_dark - step * sides[:, 2] / n_dark
        slope = np.where(usable, sums[:, 2], 1.0)
        shifts = np.where(usable, -(sums[:, 10] - sums[:, 0] * dark - step * sums[:, 1]) / (contrast * slope), 0.0)
        # of the sum over the patch less its mean from both sides, for white noise
        variances = np.maximum(0.25 * sums[:, 0] ** 2 * (1.0 / n_dark + 1.0 / n_bright) - sums[:, 0], sums[:, 0])
        variances /= slope**2
    information = np.where(usable, contrast**2 / np.where(usable, variances, 1.0), 0.0)
    return EdgePoints(
        shifts=shifts,
        information=information,
        contrasts=solved[:, 3],
        contrast_variances=solved[:, 4],
        squares=np.where(usable, solved[:, 2], 0.0),
        freedoms=np.where(usable, np.maximum(sums[:, 0] - 3.0, 0.0), 0.0),
        edge_contrasts=edge_contrasts,
        widening=widening,
    )


def clear_half_widths(grey: GreyImage, patches: Patches, noise: float, least: float) -> Scalars:
    """Tell how far across each edge its profile rises undisturbed to both sides, (n,) [px].

    The mean profile of the edge is followed outwards from its middle: where it turns back by more than `TURNED_BACK` of
    what it rose (and four standard deviations of the noise), another edge begins; pixels from one pixel before are left
    out, on both sides alike so that the profile stays symmetric.
    """
    sums, numbers = mean_profiles(
        grey, patches.centres, patches.normals, patches.half_lengths, patches.owners, patches.edge_count, REACH_PX
    )
    # neighbouring classes of half a pixel are joined: of an edge along rows or columns every second is empty
    weight = numbers[:, :-1] + numbers[:, 1:]
    profile = (sums[:, :-1] + sums[:, 1:]) / np.maximum(weight, 1.0)
    middle = 2 * REACH_PX - 1
    limits = np.full(patches.edge_count, float(REACH_PX))
    for side in (1, -1):
        outwards = side * (profile[:, middle::side] - profile[:, middle : middle + 1])
        count = weight[:, middle::side]
        present = np.cumsum(count == 0.0, axis=1) == 0
        reached = np.maximum.accumulate(np.where(present, outwards, -np.inf), axis=1)
        sure = 4.0 * noise / np.sqrt(np.maximum(count, 1.0))
        turned = present & (outwards < np.minimum((1.0 - TURNED_BACK) * reached, reached - sure))
        limits = np.where(turned.any(axis=1), np.minimum(limits, 0.5 * np.argmax(turned, axis=1) - 1.0), limits)
    return np.asarray(np.maximum(limits, least))
