"""Distances between two clouds along local normals (M3C2), with a level of detection that knows all errors.

D. Lague, N. Brodu, J. Leroux, *Accurate 3D comparison of complex topography with terrestrial laser scanner*, 2013,
doi:10.1016/j.isprsjprs.2013.04.009. There the level of detection knows the noise of the points and one number for the
registration; here the joint covariance of both poses, at the place and in the direction of each distance, and the
errors that neighbouring points share.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from algorithms.arrays import CorePoints, Flags, Generator, OtherPoints, Points, Scalars
from algorithms.deviations.cylinders import core_normals, sections
from algorithms.deviations.joint_poses import JointPoses, StationPairs
from algorithms.deviations.options import Average, M3C2Options, WavesOf
from algorithms.deviations.orientation import Side, orientation
from algorithms.deviations.point_index import index_points
from algorithms.deviations.waviness import UNMEASURED, Waviness, neighbourhood_waviness, scene_waviness
from algorithms.errors import InvalidInputError
from algorithms.progress import NoProgress, Progress

MEDIAN_VARIANCE = np.pi / 2.0
"""Variance of a median over that of the mean, normal distribution."""


@dataclass(frozen=True, eq=False)
class M3C2:
    """Distances at k core points; NaN where a cylinder holds no points of one of the clouds."""

    normals: Points
    """(k, 3) unit normals, zero where no plane was found."""
    distances_m: Scalars
    """(k,) from the first cloud to the second, positive along the normal [m]."""
    std_m: Scalars
    """(k,) standard deviation of the distance, all errors together [m]; NaN below two points in a cylinder."""
    levels_of_detection_m: Scalars
    """(k,) what |distance| exceeds by chance in a share alpha of unchanged places [m]."""
    significant: Flags
    """(k,) whether |distance| exceeds it."""
    p_values: Scalars
    """(k,) probability of a larger |distance| without change."""
    pose_std_m: Scalars
    """(k,) share of the poses in `std_m` [m]."""
    counts: tuple[Scalars, Scalars]
    """(k,) points in the cylinder, of each cloud."""
    spreads_m: tuple[Scalars, Scalars]
    """(k,) spread of the points along the normal, of each cloud [m]."""
    waviness: Waviness
    """Errors shared by the points of a cylinder."""

    @property
    def measured(self) -> Flags:
        """(k,) where a distance and its level of detection exist."""
        return np.asarray(np.isfinite(self.levels_of_detection_m))


def m3c2(
    first: Points,
    second: OtherPoints,
    cores: CorePoints,
    poses: JointPoses | StationPairs,
    options: M3C2Options,
    *,
    normals: CorePoints | None = None,
    stated: Side | None = None,
    rng: Generator,
    progress: Progress | None = None,
) -> M3C2:
    """Measure distances from one cloud to another along the normals of the first (MATH 11.1 to 11.4).

    d = mean(t₂) − mean(t₁), t = n · (x − core) of the points within the cylinder about the core point, and
    var d = aᵀ S a + s₁²/n₁ + s₂²/n₂ + w², a of `JointPoses.variances_along`, w of `scene_waviness`. The level of
    detection is the two-sided quantile of Student's t times √var, its degrees of freedom by Welch and Satterthwaite:
    few points know their own spread badly; what poses and waves add counts as known. O(points) to sort, then
    O(points within a cylinder and on the shell of a sphere) a core point, on all processors.

    Parameters
    ----------
    first, second
        (n, 3), (m, 3) clouds in one frame, reduced to a near origin [m].
    cores
        (k, 3) core points, on the first cloud or near it [m].
    poses
        Poses of the stations that measured the two clouds, in the same frame.
    options
        Sizes and levels.
    normals
        (k, 3) unit normals to the positive side; None: fitted.
    stated
        To which side fitted normals are turned; None: as `orientation` finds it without an instrument.
    rng
        Draws where the waviness is measured.
    progress
        Told of the steps.

    Raises
    ------
    InvalidInputError
        Without core points, or where a cloud has no points.
    """
    listener = progress or NoProgress()
    if min(len(first), len(second), len(cores)) == 0:
        raise InvalidInputError("comparison", "one of the clouds has no points, or there are no core points")
    listener.report(0.0, "normals of the core points")
    if normals is None:
        found, _ = core_normals(first, cores, options.normal_radii_m)
        normals = orientation(found, cores, None, stated).normals
    listener.report(0.4, "sorting both clouds")
    radius, half = options.cylinder_radius_m, options.max_distance_m
    indices = [index_points(points, 2.0 * radius) for points in (first, second)]
    listener.report(0.5, "points in the cylinders")
    median = options.average is Average.MEDIAN
    one, two = (
        sections(index, cores, normals, radius_m=radius, half_length_m=half, median=median) for index in indices
    )
    factor = MEDIAN_VARIANCE if median else 1.0
    distances = two.positions_m - one.positions_m
    listener.report(0.85, "errors that neighbouring points share")
    white = [factor * section.spreads_m**2 / np.maximum(section.counts, 1.0) for section in (one, two)]
    if options.waviness_std_m is not None:
        waviness = replace(UNMEASURED, std_m=options.waviness_std_m)
    elif options.waves is WavesOf.SCENE:
        waviness = scene_waviness(cores, normals, distances, white[0] + white[1])
    else:
        waviness = neighbourhood_waviness(
            cores, normals, distances, (one, two), radius_m=radius, noise_factor=factor, rng=rng
        )  # fmt: skip
    pose_variances = poses.variances_along(cores, normals)
    variances = pose_variances + waviness.std_m**2 + white[0] + white[1]
    degrees = _degrees_of_freedom(variances, white, (one.counts, two.counts))
    std = np.sqrt(variances)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.abs(distances) / std
    levels = special.stdtrit(degrees, 1.0 - options.alpha / 2.0) * std
    return M3C2(
        normals=normals,
        distances_m=distances,
        std_m=std,
        levels_of_detection_m=levels,
        significant=np.abs(distances) > levels,
        p_values=2.0 * special.stdtr(degrees, -ratios),
        pose_std_m=np.sqrt(pose_variances),
        counts=(one.counts, two.counts),
        spreads_m=(one.spreads_m, two.spreads_m),
        waviness=waviness,
    )


def _degrees_of_freedom(variances: Scalars, white: list[Scalars], counts: tuple[Scalars, Scalars]) -> Scalars:
    """Give Welch and Satterthwaite's degrees of freedom, (k,): var² / Σ (s²/n)² / (n − 1); at most a million."""
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = sum(share**2 / np.maximum(count - 1.0, 1.0) for share, count in zip(white, counts, strict=True))
        degrees = variances**2 / parts
    return np.where(np.isnan(variances), np.nan, np.minimum(np.where(parts > 0.0, degrees, np.inf), 1e6))
