"""Errors that neighbouring points share, measured on the difference of two clouds.

Points of a scan do not err independently: the range offset of a beam, the surface's own waves as two footprints see
them, a moving instrument. Such errors do not fall with the number of points in a cylinder, and a level of detection
from the points' spread alone calls them change. They show in the differences themselves, which scatter by more than
their points' noise explains once a motion of the whole is taken off. A real change has the same look: over the whole
scene waves of all lengths are seen, and up to some two fifths of it may have changed; within neighbourhoods everything
may have changed smoothly, and waves longer than they are remain unseen.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Generator, Points, Scalars, Vector3
from algorithms.deviations.cylinders import Sections
from algorithms.features.patches.patch_covariance import NUMERICAL_STD_M
from algorithms.features.patches.patch_covariance_kernels import excess
from algorithms.geometry.lines import bases_of
from algorithms.geometry.rotations import velocity_design
from algorithms.probabilities import chi2_ppf, norm_cdf, norm_ppf

NEIGHBOURHOODS = 400
"""So many give the variance to some per cent."""
LEAST_NEIGHBOURHOODS = 20
"""Fewer say too little of a median."""
ACROSS = 6
"""Cylinders along the diameter of a neighbourhood, which then holds 32."""
SPACINGS = (4.0, 2.0, 1.0)
"""Distances of the cylinders of a neighbourhood in diameters or in distances of core points, whichever is more; the
widest that the surfaces allow counts: waves longer than the neighbourhood look like its tilt and remain unseen."""
LEAST_CORES = 30
"""Fewer core points say too little of a median."""
ROUNDS, SETTLING = 4, 5
"""Rounds of leaving out what changed, and steps of the motion in each."""
TRIM = 2.5
"""Standard deviations beyond which a core point counts as changed."""
LEAST_REDUNDANCY = 6
"""Cylinders beyond the three parameters of a neighbourhood's motion."""
ALIKE = 0.95
"""Cosine between the normals of a neighbourhood and that of its middle: the same surface."""
STEADY = 10.0
"""The common scatter of a neighbourhood counts as so many points in that of each cylinder."""
LEAST_POINTS = 3.0
"""Cylinders of fewer points know too little of their own scatter."""


@dataclass(frozen=True)
class Waviness:
    """Errors of cylinder means that no number of points averages out."""

    std_m: float
    """Standard deviation of a difference of two cylinder means by them [m]."""
    samples: int
    """Core points or neighbourhoods of which it is the median; 0: not measured."""
    span_m: float
    """Longer waves are not seen [m]; inf: all are."""


UNMEASURED = Waviness(0.0, 0, 0.0)


def scene_waviness(cores: Points, normals: Points, distances_m: Scalars, noise_variances: Scalars) -> Waviness:
    """Measure the variance w² of distances beyond the noise of their points, waves of all lengths (MATH 11.3).

    A rigid motion of the whole, d = a · (δθ, δt) with a = ((x − c) × n, n), is taken off; w² is the value for which
    the median of r² / (v + w²) is that of chi-square with one degree of freedom. What is farther off than `TRIM`
    standard deviations counts as changed, and is left out of both in the next of `ROUNDS` rounds. O(k) a round.

    Parameters
    ----------
    cores, normals
        (k, 3) core points and their unit normals.
    distances_m, noise_variances
        (k,) distances along the normals and their variance from the noise of points [m, m²]; NaN where there is none.
    """
    used = np.isfinite(distances_m) & np.isfinite(noise_variances)
    if int(used.sum()) < LEAST_CORES:
        return UNMEASURED
    x, n, d, v = cores[used], normals[used], distances_m[used], noise_variances[used] + NUMERICAL_STD_M**2
    x = (x - x.mean(axis=0)) / max(float(np.std(x)), NUMERICAL_STD_M)
    motions = velocity_design(x, n)
    variance, kept = 0.0, np.ones(len(d), dtype=np.bool_)
    residuals = d - np.median(d)
    for round_ in range(ROUNDS):
        for _ in range(SETTLING):  # least absolute residuals: what has changed pulls little
            weights = 1.0 / np.sqrt(v + variance) / np.maximum(np.abs(residuals), np.sqrt(v + variance))
            roots = np.sqrt(weights[kept])[:, None]
            motion = np.linalg.lstsq(roots * motions[kept], roots[:, 0] * d[kept], rcond=1e-9)[0]
            residuals = d - motions @ motion
        cut = np.inf if round_ == 0 else TRIM
        variance = _variance_of_median(residuals[kept] ** 2, v[kept], _trimmed_median(cut))
        kept = residuals**2 <= TRIM**2 * (v + variance)
    return Waviness(float(np.sqrt(variance)), int(kept.sum()), np.inf)


def _trimmed_median(cut: float) -> float:
    """Give the median of z² for a standard normal z with |z| ≤ cut."""
    return float(norm_ppf(0.5 + 0.25 * (2.0 * norm_cdf(cut) - 1.0)) ** 2)


def _variance_of_median(squares: Scalars, noise_variances: Scalars, median: float) -> float:
    """Find the variance that makes the median of squares over variances what it should be; 0 where noise suffices."""

    def too_large(variance: float) -> bool:
        return bool(np.median(squares / (noise_variances + variance)) > median)

    return _bisected(too_large, float(np.median(squares)))


def neighbourhood_waviness(
    cores: Points, normals: Points, distances_m: Scalars, sections: tuple[Sections, Sections], *,
    radius_m: float, noise_factor: float, rng: Generator,
) -> Waviness:  # fmt: skip
    """Measure the variance w² of differences of cylinder means beyond the noise of their points (MATH 11.3).

    In each neighbourhood the distances d of some 32 core points whose cylinders do not touch have noise variances
    v = s₁²/n₁ + s₂²/n₂; a plane is fitted to d, and Q(w²) = Σ r² / (v + w²). The w² for which the median over the
    neighbourhoods of Q / χ²₀.₅(f) is 1 is the answer: Paule and Mandel's estimator (1982) with a median over
    neighbourhoods instead of a sum, so that change in less than half of them does not count. O(k log k).

    Parameters
    ----------
    cores, normals
        (k, 3) core points and their unit normals.
    distances_m
        (k,) distances along the normals, NaN where there is none [m].
    sections
        What the cylinders hold of each cloud.
    radius_m
        Radius of the cylinders [m].
    noise_factor
        Variance of the sections' positions over that of a mean: 1 for means, π/2 for medians.
    rng
        Draws the middles of the neighbourhoods.
    """
    counts = np.minimum(*(section.counts for section in sections))
    usable = np.flatnonzero(np.isfinite(distances_m) & (counts >= LEAST_POINTS))
    if len(usable) < LEAST_CORES:
        return UNMEASURED
    places = cKDTree(cores[usable])
    gaps, _ = places.query(cores[usable], k=2)
    distance = max(2.0 * radius_m, float(np.median(np.asarray(gaps)[:, 1])))
    middles = np.sort(rng.choice(usable, min(NEIGHBOURHOODS, len(usable)), replace=False))
    for spacing in SPACINGS:
        members = _laid_out(cores, normals, usable, places, middles, spacing * distance)
        systems = [
            _system(cores[which] - cores[middle], normals[middle], distances_m[which], which, sections, noise_factor)
            for middle, which in zip(middles.tolist(), members, strict=True)
            if len(which) >= 3 + LEAST_REDUNDANCY
        ]
        if len(systems) >= LEAST_NEIGHBOURHOODS:
            return Waviness(float(np.sqrt(_common_variance(systems))), len(systems), ACROSS * spacing * distance)
    return UNMEASURED


def _laid_out(
    cores: Points, normals: Points, usable: Array, places: cKDTree, middles: Array, spacing: float
) -> list[Array]:
    """Give for each middle the core points of its surface that are nearest to the places of a grid around it."""
    steps = (np.arange(ACROSS) - 0.5 * (ACROSS - 1)) * spacing
    grid = np.array([(u, v) for u in steps for v in steps if np.hypot(u, v) <= 0.5 * ACROSS * spacing])
    wished = cores[middles][:, None, :] + np.einsum("kij,pj->kpi", bases_of(normals[middles]), grid)
    # half a spacing less than a diameter: cylinders of neighbouring places do not touch but for their rims
    _, found = places.query(wished, distance_upper_bound=0.5 * spacing)
    members = []
    for middle, row in zip(middles.tolist(), np.asarray(found), strict=True):
        which = usable[np.unique(row[row < len(usable)])]
        members.append(which[normals[which] @ normals[middle] > ALIKE])
    return members


System = tuple[Array, Array, Array]
"""Jacobian (p, 3), differences (p,) [m] and noise variances (p,) [m²] of a neighbourhood."""


def _system(
    offsets: Points, normal: Vector3, differences: Scalars, which: Array, sections: tuple[Sections, Sections],
    noise_factor: float,
) -> System:  # fmt: skip
    """Give the equations of a neighbourhood that moved as a whole."""
    jacobian = np.column_stack([np.ones(len(which)), offsets @ bases_of(normal[None])[0]])
    noise = noise_factor * sum(_steadied(section.spreads_m[which], section.counts[which]) for section in sections)
    return jacobian, differences, np.asarray(noise) + NUMERICAL_STD_M**2


def _steadied(spreads: Scalars, counts: Scalars) -> Scalars:
    """Give the variance of each mean, the spread of few points steadied by those of the neighbourhood (median)."""
    common = float(np.median(spreads**2))
    return np.asarray((STEADY * common + (counts - 1.0) * spreads**2) / (STEADY + counts - 1.0) / counts)


def _common_variance(systems: list[System]) -> float:
    """Find w² by bisection; zero where noise explains the median neighbourhood."""
    degrees = np.array([len(differences) - jacobian.shape[1] for jacobian, differences, _ in systems], dtype=np.float64)
    medians = chi2_ppf(0.5, degrees)

    def too_large(variance: float) -> bool:
        squares = np.array([excess(jacobian, d, noise + variance) for jacobian, d, noise in systems]) + degrees
        return bool(np.median(squares / medians) > 1.0)

    return _bisected(too_large, max(float(np.median(noise)) for _, _, noise in systems))


def _bisected(too_large: Callable[[float], bool], high: float) -> float:
    """Find where a monotonous condition ends to hold, to a hundredth; 0 where it does not hold even there."""
    if not too_large(0.0):
        return 0.0
    low = 0.0
    while too_large(high):
        low, high = high, 4.0 * high
    while high - low > 0.01 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if too_large(middle) else (low, middle)
    return 0.5 * (low + high)
