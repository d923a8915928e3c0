"""The pose by surfaces alone: point to plane from both scans to each other, with a covariance that misfits tell."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Indices, Labels, Matrix3, Scalars, Vector3
from algorithms.errors import TooFewCorrespondencesError
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.poses import PoseEstimate
from algorithms.geometry.rotations import cross_matrix
from algorithms.matching.directions import comes_first
from algorithms.matching.polish import LEAST_GAPS, SurfaceGaps, surface_gaps
from algorithms.registration.neighbourhood_covariance import neighbourhood_covariance
from algorithms.registration.rounding_covariance import least_spread, rounding_covariance
from algorithms.registration.surface_options import SurfaceOptions
from algorithms.registration.wall_covariance import covering, wall_covariance, wall_pieces
from algorithms.scans.surface_index import EvidenceLimits

MAD_TO_STD = 1.4826
"""Standard deviation of a normal variable over its median absolute value."""
TUKEY = 4.685
"""Gaps of more standard deviations count nothing: 95 % efficient with normal errors (Beaton and Tukey 1974)."""
LARGEST_INFLUENCE = 16.0 / 25.0 / 5.0**0.5 * TUKEY
"""What the most harmful gap counts, in standard deviations: the peak of u (1 - (u/c)²)² at u = c / sqrt(5)."""
LEAST_SPREAD_M = 1e-4
"""Smallest standard deviation of gaps to weigh by [m]."""
GATE_SPREADS, GATE_NOISES, LEAST_GATE_M = 6.0, 6.0, 0.02
"""Surfaces farther apart than so many standard deviations of the gaps do not correspond in the end, but never fewer
than so many of the scans' noise, and never less than 2 cm: what lies farther apart was moved."""
FACING = 0.5
"""A surface speaks of a motion when its normal lies within 60 degrees of it: farther off it does so only because its
normal is not exactly known, or because it is the rim of something."""
LEAST_TESTIMONY = 0.003
"""Motions across which less than this share of the surface stands (weights and squared cosines counted) are open:
there rims and errors of normals speak. Endless corridors, tunnels, streets, pipes and planes, noise of 2 to 30 mm, had
less than 0.0001 across what they leave open."""
WEAK_TESTIMONY, WEAK_VARIANCE = 0.01, 2.0
"""Of motions with a smaller share than the first the misfits promise too little: in 41 corridors and streets with few
small pieces across (shares of 0.0007 to 0.01) their errors were 1.35 times the standard deviation (rms)."""
COMMON_SPREADS = 0.03
"""Standard deviation, in those of the gaps, of what shifts all surfaces of a direction alike and no misfit shows: cells
of the raster that a wall only just reaches count as much as full ones, and hold the noisiest points of it."""
FLAT = 1e-9
"""Keeps turns about the line on which all surface lies from being divided by zero."""
STEADY_ROUNDS = 15
"""After so many rounds only half of each step is taken: pairs that change to and fro would keep it going."""
SETTLED_SPREADS = 0.005
"""Steps below so many standard deviations of the gaps, turns as the shift they cause, end the search."""
FEW_POINTS, NEARLY_SETTLED_SPREADS = 8_000, 0.05
"""So many points of each scan come near the answer, up to steps of so many standard deviations; then all take part."""


@dataclass(frozen=True, eq=False)
class SurfaceEstimate:
    """A pose from surfaces, between the reduced frames, and what it rests on."""

    pose: PoseEstimate
    """Pose with covariance; what the surfaces leave open is its null space, and stays at the start there."""
    centre_m: Vector3
    """(3,) weighted centre of the corresponding surface, target frame [m]."""
    radius_m: float
    """Its rms distance from there [m]."""
    gap_count: int
    """Distances between corresponding surfaces that count."""
    spread_m: float
    """Robust standard deviation of these distances [m]."""
    neighbourhood_m: float
    """Edge of the neighbourhoods whose misfits count as one [m]."""
    neighbourhoods: int
    """How many of them there are."""
    hidden_shift_m: float
    """Largest shift of the centre by one neighbourhood that lies wrong by just so much that it does most harm [m]."""
    least_testimony: float
    """Share of the corresponding surface that stands across the motion that it determines worst."""
    iterations: int
    """Rounds."""
    converged: bool

    def inverted(self) -> "SurfaceEstimate":
        """Give the same estimate with target and source exchanged."""
        centre = self.pose.target_from_source.inv().apply(self.centre_m)
        return replace(self, pose=self.pose.inverse(), centre_m=centre)

    def in_words(self) -> str:
        """Say what the estimate rests on."""
        return (
            f"{self.gap_count} distances of {self.spread_m * 1e3:.1f} mm between them in {self.neighbourhoods} "
            f"neighbourhoods of {self.neighbourhood_m:g} m"
        )


def estimate_by_surfaces(
    target: ScanFeatures,
    source: ScanFeatures,
    start: RigidTransform,
    options: SurfaceOptions,
    *,
    left_out: tuple[Array, Array] | None = None,
) -> SurfaceEstimate:
    """Estimate the pose in which the surfaces of two scans lie in each other, robustly, from both sides.

    Iteratively reweighted least squares of the distances between corresponding surface along the normals (Chen and
    Medioni 1992), points of each scan against tangent planes of the other, with Tukey's weights; the correspondences
    are found anew in each round within a gate that narrows. The covariance comes from the misfits
    (`neighbourhood_covariance`).

    Parameters
    ----------
    target, source
        Features of the two scans; their thinned surfaces are used.
    start
        Target from source between the reduced frames, good to about `options.max_distance_m`.
    options
        Limits.
    left_out
        True for points of the target's and the source's `index` that take no part; None: all do.

    Raises
    ------
    TooFewCorrespondencesError
        When too little surface lies on surface.
    """
    if not comes_first(target, source):
        turned = None if left_out is None else (left_out[1], left_out[0])
        return estimate_by_surfaces(source, target, start.inv(), options, left_out=turned).inverted()
    noise_m = max(target.noise_std_m, source.noise_std_m)
    least_gate = max(GATE_NOISES * noise_m, LEAST_GATE_M)
    gate = max(options.max_distance_m, least_gate)
    most = max(len(index.points) for index in (target.index, source.index))
    points = min(FEW_POINTS, most)
    spread_m = max(LEAST_SPREAD_M, least_spread(target, source))
    pose, converged, rounds = start, False, 0
    while not converged and rounds < options.max_iterations:
        gaps = _gaps(target, source, pose, gate, points, options, left_out)
        if len(gaps.gaps_m) < LEAST_GAPS and points < most:
            points = most
            continue
        fit = _weighed(gaps, spread_m)
        step, length = fit.step(1.0 if rounds < STEADY_ROUNDS else 0.5)
        pose = step * pose
        narrower = max(min(gate, GATE_SPREADS * fit.spread_m), least_gate)
        rounds += 1
        settled = SETTLED_SPREADS if points == most else NEARLY_SETTLED_SPREADS
        converged = length < settled * fit.spread_m and narrower > 0.95 * gate
        if points < most and (converged or rounds >= STEADY_ROUNDS):
            points, converged = most, False
        gate = narrower
    fit = _weighed(_gaps(target, source, pose, gate, most, options, left_out), spread_m)
    by_rounding = rounding_covariance(fit.gain(), target, source, fit.gaps.of_target, fit.gaps.of_source)
    walls = wall_pieces(_planes_of(fit.gaps, target, source), fit.gaps.positions)
    return _with_covariance(fit, by_rounding, walls, pose, options, rounds, converged)


def _planes_of(gaps: SurfaceGaps, target: ScanFeatures, source: ScanFeatures) -> Labels:
    """Give the plane that corresponding surface belongs to, those of the source numbered on; -1 for none."""
    labels = target.surface.plane_labels[target.index.numbers[gaps.of_target]]
    others = source.surface.plane_labels[source.index.numbers[gaps.of_source]]
    joined = np.where(labels >= 0, labels, np.where(others >= 0, others + len(target.planes), -1))
    return joined.astype(np.int32)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Gaps in a pose with their weights, and the normal equations in scaled, centred parameters."""

    gaps: SurfaceGaps
    weights: Scalars
    slopes: Scalars
    spread_m: float
    centre_m: Vector3
    radius_m: float
    design: Array
    """(n, 6) derivatives by (radius times turn, shift of the centre)."""
    normal_matrix: Array
    """(6, 6) of all six parameters, and what stands on the right."""
    right: Array
    """(6,)."""
    known: Array
    """(6, k) motions that the surfaces determine, each an rms displacement of the surface by one metre."""
    testimony: Array
    """(k,) share of the surface that stands across each of them."""
    open_: Array
    """(6, 6 - k) those that they leave open."""

    def gain(self) -> Array:
        """Give what each gap changes the determined motions by, (k, n)."""
        weighted = self.known.T @ (self.design * self.weights[:, None]).T
        return np.asarray(np.linalg.solve(self.known.T @ self.normal_matrix @ self.known, weighted))

    def step(self, share: float) -> tuple[RigidTransform, float]:
        """Solve for the motion that closes the gaps and take a share of it; what is open stays. Give its length [m]."""
        matrix = self.known.T @ self.normal_matrix @ self.known
        motion = share * self.known @ np.linalg.solve(matrix, self.known.T @ self.right)
        rotation = Rotation.from_rotvec(motion[:3] / self.radius_m)
        shift = motion[3:] + self.centre_m - rotation.apply(self.centre_m)
        return RigidTransform.from_components(shift, rotation), float(np.linalg.norm(motion))


def _gaps(
    target: ScanFeatures,
    source: ScanFeatures,
    pose: RigidTransform,
    gate_m: float,
    points: int,
    options: SurfaceOptions,
    left_out: tuple[Array, Array] | None,
) -> SurfaceGaps:
    """Find corresponding surface of so many points of each scan."""
    indices = target.index, source.index
    limits = EvidenceLimits(gate_m, options.max_angle_rad, 2.5 * max(index.spacing_m for index in indices))
    return surface_gaps(pose, *indices, limits, points, left_out=left_out)


def _weighed(gaps: SurfaceGaps, least_spread_m: float) -> _Fit:
    """Weigh corresponding surface, by no smaller a standard deviation of the gaps than given.

    Raises
    ------
    TooFewCorrespondencesError
        When there is too little.
    """
    from algorithms.registration import surface_kernels as kernels

    if len(gaps.gaps_m) < LEAST_GAPS:
        raise TooFewCorrespondencesError(len(gaps.gaps_m), LEAST_GAPS, "surface points")
    spread = max(MAD_TO_STD * float(np.median(np.abs(gaps.gaps_m))), least_spread_m)
    squares = np.square(gaps.gaps_m / (TUKEY * spread))
    inside = squares < 1.0
    robust = np.where(inside, np.square(1.0 - squares), 0.0)
    slopes = np.where(inside, (1.0 - squares) * (1.0 - 5.0 * squares), 0.0) * gaps.weights
    weights = robust * gaps.weights
    centre = weights @ gaps.positions / weights.sum()
    arms = gaps.positions - centre
    scatter = (arms * weights[:, None]).T @ arms / weights.sum()
    radius = max(float(np.sqrt(np.trace(scatter))), 1e-3)
    design = kernels.scaled_design(gaps.positions, gaps.normals, centre, radius)
    matrix, right = kernels.normal_equations(design, weights, gaps.gaps_m)
    motions = _motions(matrix / weights.sum(), scatter / radius**2)
    told = kernels.testimonies(motions, gaps.positions, gaps.normals, weights, centre, radius, FACING) / weights.sum()
    determined = told >= LEAST_TESTIMONY
    known, open_ = motions[:, determined], motions[:, ~determined]
    return _Fit(gaps, weights, slopes, spread, centre, radius, design, matrix, right, known, told[determined], open_)


def _motions(normal_matrix: Array, spread: Matrix3) -> Array:
    """Give six motions, (6, 6) columns, of which surfaces may determine some and leave others open.

    The motions q of N q = λ D q with N = Σ w a aᵀ and D the same if every surface stood square to its displacement: λ
    is the mean squared cosine between normals and displacements, whatever the lever arms. What is left of it when only
    surfaces that face the displacement count decides.

    Parameters
    ----------
    normal_matrix
        (6, 6) N, of weights that add up to one.
    spread
        Scatter of the surface about the centre, over the squared radius.
    """
    possible = np.zeros((6, 6))
    possible[:3, :3] = np.trace(spread) * np.eye(3) - spread + FLAT * np.eye(3)
    possible[3:, 3:] = np.eye(3)
    return np.asarray(linalg.eigh(normal_matrix, possible)[1])


def _with_covariance(
    fit: _Fit,
    by_rounding: Array,
    walls: Indices,
    pose: RigidTransform,
    options: SurfaceOptions,
    rounds: int,
    converged: bool,
) -> SurfaceEstimate:
    """Add the covariance, told at the origins of the reduced frames."""
    shifts = fit.known[3:]
    found = neighbourhood_covariance(
        fit.design @ fit.known,
        fit.weights,
        fit.gaps.gaps_m,
        fit.gaps.positions,
        fit.gaps.normals,
        slopes=fit.slopes,
        edge_m=options.neighbourhood_m,
        shifts=shifts,
    )
    enlarged = np.where(fit.testimony < WEAK_TESTIMONY, WEAK_VARIANCE**0.5, 1.0)
    axes, controlled = fit.known @ (enlarged[:, None] * found.axes), np.isfinite(found.variances)
    by_walls = wall_covariance(fit.design @ fit.known, fit.weights, fit.gaps.gaps_m, walls, slopes=fit.slopes)
    kept = found.axes[:, controlled]
    along = np.diag(found.variances[controlled])
    if kept.shape[1]:
        along = covering(along, kept.T @ by_walls @ kept)
    along += (COMMON_SPREADS * fit.spread_m) ** 2 * np.eye(len(along))
    scaled = axes[:, controlled] @ along @ axes[:, controlled].T + fit.known @ by_rounding @ fit.known.T
    to_pose = np.eye(6) / fit.radius_m
    to_pose[3:, 3:] = np.eye(3)
    to_pose[3:, :3] = cross_matrix(fit.centre_m - np.asarray(pose.translation)) / fit.radius_m
    free = to_pose @ np.hstack([fit.open_, axes[:, ~controlled]])
    return SurfaceEstimate(
        pose=PoseEstimate(pose, to_pose @ scaled @ to_pose.T, free),
        centre_m=fit.centre_m,
        radius_m=fit.radius_m,
        gap_count=int(np.count_nonzero(fit.weights)),
        spread_m=fit.spread_m,
        neighbourhood_m=found.edge_m,
        neighbourhoods=found.count,
        hidden_shift_m=LARGEST_INFLUENCE * fit.spread_m * float(np.linalg.norm(shifts @ found.largest_share, ord=2)),
        least_testimony=float(fit.testimony.min(initial=1.0)),
        iterations=rounds,
        converged=converged,
    )
