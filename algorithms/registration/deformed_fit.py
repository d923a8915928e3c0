"""Lay the surfaces of two scans on each other with a motion and a deformation, to see whether a motion is enough."""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Indices, Labels, Matrix3, Points, Scalars, Vector3
from algorithms.errors import TooFewCorrespondencesError
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.rotations import rotation_matrix
from algorithms.registration.neighbourhood_covariance import neighbourhood_covariance
from algorithms.registration.rounding_covariance import least_spread, rounding_covariance
from algorithms.registration.wall_covariance import covering, wall_covariance, wall_pieces
from algorithms.scans.surface_index import EvidenceLimits
from algorithms.scans.surface_matches import nearest_surface

WIDE_GATE_M = 0.3
"""Surfaces so far apart correspond in the first round; the gate is halved from round to round, down to `NARROW`."""
STEPS = 4
"""Steps with each gate."""
MOST_LAST_STEPS = 15
"""Most steps with the last gate."""
GATE_NOISES, LEAST_GATE_M = 6.0, 0.02
"""The last gate: so many standard deviations of the noise, and never less than 2 cm."""
DOUBTFUL_SHARE = 0.3
"""A gap of this share of a gate counts a quarter (Geman and McClure)."""
TUKEY, MAD_TO_STD, LEAST_SPREAD_M = 4.685, 1.4826, 1e-4
"""As of `surface_estimate`."""
LEAST_TESTIMONY = 1e-3
"""Open is what changes the gaps by less than the root of this when it moves the surface by one metre (rms)."""
SETTLED_SPREADS = 0.005
FEW_POINTS = 4_000
"""So many points of each scan find the deformation; all of them tell how well it is known."""
LEAST_GAPS = 100
MAX_ANGLE_RAD = 0.35
FITS_SPREADS = 3.0
"""Surface fits within so many standard deviations of the gaps."""
TRIED = 0.01 * np.arange(1, 13)
"""Stretches on the way to a large deformation: from one to the next nothing moves out of the gates."""
TRIAL_POINTS, TRIAL_GATES_M = 1_000, (2.0 * WIDE_GATE_M, WIDE_GATE_M)


class DeformationKind(StrEnum):
    """By what two scans may differ beyond a motion."""

    SCALE = "scale"
    STRAIN = "strain"
    """A scale of its own along each of three axes of any direction: three stretches, three shears."""
    BEND = "bend"
    """Strain, and displacements that grow with the square of the distance."""


COUNTS = {DeformationKind.SCALE: 1, DeformationKind.STRAIN: 6, DeformationKind.BEND: 24}
"""Coefficients of each kind."""
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True, eq=False)
class Deformation:
    """Displacements Σ c_k φ_k(arm) of points at given arms from a centre."""

    kind: DeformationKind
    radius_m: float
    """Unit of length of the quadratic displacements [m]."""
    coefficients: Array
    """(m,) scale; or the symmetric strain xx yy zz √2·xy √2·xz √2·yz; of a bend also (6, 3) quadratic terms in that
    order of products, each an axis' displacement at one radius over the radius."""

    def fields(self, arms: Points) -> Array:
        """Give φ, (n, 3, m), at arms (n, 3) [m]."""
        if self.kind is DeformationKind.SCALE:
            return arms[:, :, None]
        out = np.zeros((len(arms), 3, COUNTS[self.kind]))
        for k, (a, b) in enumerate(_PAIRS):
            factor = 1.0 if a == b else 0.5**0.5
            out[:, a, k] = factor * arms[:, b]
            out[:, b, k] = factor * arms[:, a]
        if self.kind is DeformationKind.BEND:
            for k, (a, b) in enumerate(_PAIRS):
                product = arms[:, a] * arms[:, b] / self.radius_m
                for axis in range(3):
                    out[:, axis, 6 + 3 * k + axis] = product
        return out

    def fields_along(self, arms: Points, normals: Points) -> Array:
        """Give φ along unit normals (n, 3), (n, m), at arms (n, 3) [m]."""
        if self.kind is DeformationKind.SCALE:
            return np.asarray(np.einsum("ni,ni->n", arms, normals)[:, None])
        out = np.empty((len(arms), COUNTS[self.kind]))
        for k, (a, b) in enumerate(_PAIRS):
            if a == b:
                out[:, k] = normals[:, a] * arms[:, a]
            else:
                out[:, k] = 0.5**0.5 * (normals[:, a] * arms[:, b] + normals[:, b] * arms[:, a])
            if self.kind is DeformationKind.BEND:
                out[:, 6 + 3 * k : 9 + 3 * k] = (arms[:, a] * arms[:, b] / self.radius_m)[:, None] * normals
        return out

    def strain(self) -> Matrix3:
        """Give the strain as a symmetric matrix."""
        if self.kind is DeformationKind.SCALE:
            return np.asarray(self.coefficients[0] * np.eye(3))
        out = np.zeros((3, 3))
        for k, (a, b) in enumerate(_PAIRS):
            out[a, b] = out[b, a] = self.coefficients[k] * (1.0 if a == b else 0.5**0.5)
        return out

    def as_kind(self, kind: DeformationKind, radius_m: float) -> "Deformation":
        """Give the same strain as a deformation of a more general kind."""
        strain = self.strain()
        coefficients = np.zeros(COUNTS[kind])
        for k, (a, b) in enumerate(_PAIRS):
            coefficients[k] = strain[a, b] * (1.0 if a == b else 2.0**0.5)
        return Deformation(kind, radius_m, coefficients)

    def displacements(self, arms: Points) -> Points:
        """Give the displacements (n, 3) at arms (n, 3) [m]."""
        if self.kind is DeformationKind.SCALE:
            return np.asarray(self.coefficients[0] * arms)
        moved = arms @ self.strain()
        if self.kind is DeformationKind.BEND:
            products = np.column_stack([arms[:, a] * arms[:, b] for a, b in _PAIRS]) / self.radius_m
            moved += products @ self.coefficients[6:].reshape(6, 3)
        return np.asarray(moved)


@dataclass(frozen=True, eq=False)
class DeformedFit:
    """Motion and deformation: y = x + u(x - centre), x = target from source."""

    target_from_source: RigidTransform
    """Between the reduced frames."""
    centre_m: Vector3
    """(3,) in the target frame [m]."""
    deformation: Deformation
    determined: Array
    """(m, r) orthonormal combinations of the coefficients that the surfaces determine."""
    covariance: Array | None
    """(r, r) covariance of those; None of a bend, which is judged by what it explains."""
    spread_m: float
    """Robust standard deviation of the gaps that are left [m]."""
    fitting: float
    """Surface that fits within three such standard deviations, by weight."""
    fitting_rigidly: float
    """The same in the pose that was asked about, or in the best one near it without any deformation."""
    rigid_spread_m: float = 0.0
    """Robust standard deviation of the gaps there, those within the last gate [m]."""

    @property
    def gain(self) -> float:
        """How much more surface fits than without the deformation, relative to that."""
        return self.fitting / max(self.fitting_rigidly, 1e-9) - 1.0

    @property
    def explained_m(self) -> float:
        """How large the gaps are that the deformation closes, as a standard deviation [m]."""
        return float(np.sqrt(max(self.rigid_spread_m**2 - self.spread_m**2, 0.0)))

    def apply(self, points: Points) -> Points:
        """Take points of the source (n, 3) to the target frame, deformed."""
        moved = self.target_from_source.apply(points)
        return np.asarray(moved + self.deformation.displacements(moved - self.centre_m))

    def undone(self, points: Points) -> Points:
        """Take points of the target (n, 3) to the source as it is; a bend is undone to second order."""
        return np.asarray(self.target_from_source.inv().apply(_undone(self.deformation, points, self.centre_m)))


def _undone(deformation: Deformation, points: Points, centre: Vector3) -> Points:
    if deformation.kind is not DeformationKind.BEND:
        return np.asarray(np.linalg.solve(np.eye(3) + deformation.strain(), (points - centre).T).T + centre)
    once = points - deformation.displacements(points - centre)
    return np.asarray(points - deformation.displacements(once - centre))


@dataclass(frozen=True, eq=False)
class _Gaps:
    """As of `SurfaceGaps`, with the planes that the surface belongs to."""

    positions: Points
    normals: Points
    gaps_m: Scalars
    weights: Scalars
    planes: Labels
    of_target: Indices
    of_source: Indices
    least_spread_m: float
    """Gaps scatter by so much at least, by the rounding of coordinates, whatever the misfits say [m]."""

    @property
    def spread_m(self) -> float:
        """Robust standard deviation of the gaps [m]."""
        spread_m = MAD_TO_STD * float(np.median(np.abs(self.gaps_m)))
        return max(spread_m, self.least_spread_m)


class MotionAlone:
    """What lies on what near a pose without any deformation: found once for all deformations that are compared."""

    def __init__(self, target: ScanFeatures, source: ScanFeatures, pose: RigidTransform) -> None:
        """Keep two scans and a pose.

        Parameters
        ----------
        target, source
            Features of both scans.
        pose
            Target from source between the reduced frames.

        Raises
        ------
        TooFewCorrespondencesError
            When too little surface lies near surface.
        """
        self.target, self.source, self.pose = target, source, pose
        first = _measure(target, source, pose, None, np.zeros(3), WIDE_GATE_M, FEW_POINTS)
        self.centre = np.average(first.positions, axis=0, weights=first.weights)
        arms = first.positions - self.centre
        self.radius_m = max(float(np.sqrt(np.average(np.sum(arms**2, axis=1), weights=first.weights))), 1e-3)
        self._settled: dict[float, RigidTransform] = {}
        self._gaps: dict[tuple[float, int], tuple[_Gaps, _Gaps]] = {}

    def best_gaps(self, gate_m: float, points: int, fits_m: float) -> "_Gaps":
        """Give the gaps in the pose, or in the best one near it where more fits within `fits_m`.

        What a motion closes no deformation must: poses rest on lines and planes too, and on rounded coordinates, so
        they may be off by more than the gaps scatter.
        """
        if gate_m not in self._settled:
            self._settled[gate_m] = self._best_pose(gate_m)
        if (gate_m, points) not in self._gaps:
            poses = self.pose, self._settled[gate_m]
            given, best = (
                _measure(self.target, self.source, each, None, self.centre, gate_m, points) for each in poses
            )
            self._gaps[gate_m, points] = given, best
        return max(self._gaps[gate_m, points], key=lambda gaps: _weight_within(gaps, fits_m))

    def _best_pose(self, gate_m: float) -> RigidTransform:
        """Give the pose near the given one in which the surfaces fit best."""
        found, straight = self.pose, Deformation(DeformationKind.SCALE, self.radius_m, np.zeros(1))
        for _ in range(MOST_LAST_STEPS):
            gaps = _measure(self.target, self.source, found, None, self.centre, gate_m, FEW_POINTS)
            system = _System.of(gaps, straight, self.centre, None)
            step = system.motion()
            found = _moved(found, step, self.centre, self.radius_m)
            if float(np.linalg.norm(step)) < SETTLED_SPREADS * system.spread_m:
                break
        return found


def fit_deformed(
    alone: MotionAlone,
    kind: DeformationKind,
    *,
    thorough: bool = True,
    start: DeformedFit | None = None,
    from_afar: bool = False,
) -> DeformedFit:
    """Estimate motion and deformation together, from a pose that lays a part of the surfaces on each other.

    Robust least squares of the distances along the normals from both sides, as `estimate_by_surfaces`, but from a wide
    gate on, with weights that grow stricter: what fits now may be the part that fits by chance. The covariance is the
    smallest that is not below that of neighbourhoods and that of walls. O(n) for n surface points, a few dozen times.

    Parameters
    ----------
    alone
        Both scans and the pose.
    kind
        Of deformation.
    thorough
        Whether all points tell how well it is known, and how much fits; else few do.
    start
        A simpler deformation near which this one is looked for.
    from_afar
        Whether to begin with the best of some large scales, or of stretches along one of the source's axes: of what
        differs by per cents the wide gate holds too little.

    Raises
    ------
    TooFewCorrespondencesError
        When too little surface lies near surface.
    """
    target, source, centre, radius = alone.target, alone.source, alone.centre, alone.radius_m
    most = max(len(target.index.points), len(source.index.points)) if thorough else FEW_POINTS
    noise_m = max(target.noise_std_m, source.noise_std_m)
    narrow = max(GATE_NOISES * noise_m, LEAST_GATE_M)
    found, bent, gate = alone.pose, Deformation(kind, radius, np.zeros(COUNTS[kind])), WIDE_GATE_M
    if start is not None:
        found, bent, gate = start.target_from_source, start.deformation.as_kind(kind, radius), 2.0 * narrow
    elif from_afar:
        found, bent = _best_trial(target, source, alone.pose, bent, centre)
    while True:
        last = gate <= narrow
        for _ in range(MOST_LAST_STEPS if last else STEPS):
            gaps = _measure(target, source, found, bent, centre, gate, FEW_POINTS)
            system = _System.of(gaps, bent, centre, None if last else DOUBTFUL_SHARE * gate)
            step, change = system.solution()
            found = _moved(found, step, centre, radius)
            bent = replace(bent, coefficients=bent.coefficients + change)
            length = float(np.linalg.norm(step) + radius * np.linalg.norm(change))
            if length < SETTLED_SPREADS * system.spread_m:
                break
        if last:
            break
        gate = max(narrow, 0.5 * gate)
    gaps = _measure(target, source, found, bent, centre, gate, most)
    system = _System.of(gaps, bent, centre, None)
    fits_m = FITS_SPREADS * system.spread_m
    rigid = alone.best_gaps(gate, most, fits_m)
    return DeformedFit(
        target_from_source=found,
        centre_m=centre,
        deformation=bent,
        determined=system.determined,
        covariance=None if kind is DeformationKind.BEND else system.covariance(target, source),
        spread_m=system.spread_m,
        fitting=_weight_within(gaps, fits_m),
        fitting_rigidly=_weight_within(rigid, fits_m),
        rigid_spread_m=rigid.spread_m,
    )


def _best_trial(
    target: ScanFeatures, source: ScanFeatures, pose: RigidTransform, straight: Deformation, centre: Vector3
) -> tuple[RigidTransform, Deformation]:
    """Give the motion and the large deformation that lay most surface on surface, by graduated weights."""
    if straight.kind is DeformationKind.SCALE:
        directions = [np.ones(1)]
    else:
        axes = rotation_matrix(pose).T
        directions = [np.array([a[i] * a[j] * (1.0 if i == j else 2.0**0.5) for i, j in _PAIRS]) for a in axes]
    best, found = 0.0, (pose, straight)
    for direction in directions:
        for sign in (-1.0, 1.0):
            moved = pose  # what is laid on each other stays so while the deformation grows, and more comes to it
            for stretch in sign * TRIED:
                bent = replace(straight, coefficients=stretch * direction)
                try:
                    for gate in TRIAL_GATES_M:
                        gaps = _measure(target, source, moved, bent, centre, gate, TRIAL_POINTS)
                        system = _System.of(gaps, bent, centre, DOUBTFUL_SHARE * gate)
                        moved = _moved(moved, system.motion(), centre, bent.radius_m)
                except TooFewCorrespondencesError:
                    break
                if system.weights.sum() > best:
                    best, found = float(system.weights.sum()), (moved, bent)
    return found


def _weight_within(gaps: _Gaps, distance_m: float) -> float:
    return float(gaps.weights[np.abs(gaps.gaps_m) < distance_m].sum())


def _moved(pose: RigidTransform, step: Array, centre: Vector3, radius: float) -> RigidTransform:
    rotation = Rotation.from_rotvec(step[:3] / radius)
    return RigidTransform.from_components(step[3:] + centre - rotation.apply(centre), rotation) * pose


def _measure(
    target: ScanFeatures,
    source: ScanFeatures,
    pose: RigidTransform,
    bent: Deformation | None,
    centre: Vector3,
    gate_m: float,
    points: int,
) -> _Gaps:
    """Measure between corresponding surface, the source moved and deformed.

    From the target's points one looks back into the source as it is: the deformation is undone.
    """
    here, there = target.index, source.index
    limits = EvidenceLimits(gate_m, MAX_ANGLE_RAD, 2.5 * max(here.spacing_m, there.spacing_m))
    turn = rotation_matrix(pose)
    moved = pose.apply(there.points[:points])
    if bent is not None:
        moved = moved + bent.displacements(moved - centre)
    match = nearest_surface(moved, there.normals[:points] @ turn.T, here, limits)
    on = np.flatnonzero(match >= 0)
    back = here.points[:points]
    if bent is not None:
        back = _undone(bent, back, centre)
    rematch = nearest_surface(pose.inv().apply(back), here.normals[:points] @ turn, there, limits)
    on_back = np.flatnonzero(rematch >= 0)
    if len(on) + len(on_back) < LEAST_GAPS:
        raise TooFewCorrespondencesError(len(on) + len(on_back), LEAST_GAPS, "surface points")
    normals = here.normals[match[on]]
    normals_back = there.normals[rematch[on_back]] @ turn.T
    labels = target.surface.plane_labels[here.numbers]
    return _Gaps(
        positions=np.vstack([moved[on], back[on_back]]),
        normals=np.vstack([normals, normals_back]),
        gaps_m=np.concatenate(
            [
                np.einsum("ij,ij->i", normals, here.points[match[on]] - moved[on]),
                np.einsum("ij,ij->i", normals_back, back[on_back] - pose.apply(there.points[rematch[on_back]])),
            ]
        ),
        weights=np.concatenate([there.weights[:points][on], here.weights[:points][on_back]]),
        planes=np.concatenate([labels[match[on]], labels[:points][on_back]]),
        of_target=np.concatenate([match[on], on_back]),
        of_source=np.concatenate([on, rematch[on_back]]),
        least_spread_m=max(LEAST_SPREAD_M, least_spread(target, source)),
    )


@dataclass(frozen=True, eq=False)
class _System:
    """Weighted gaps and the normal equations of what they determine."""

    gaps: _Gaps
    weights: Scalars
    slopes: Scalars
    spread_m: float
    radius_m: float
    design: Array
    """(n, 6 + m) by (radius times turn, shift, radius times coefficients) [m]."""
    basis: Array
    """(6 + m, k + r) motions that the surfaces determine, and deformations that they determine beside these."""
    motions: int
    """k of them."""
    matrix: Array
    """(6 + m, 6 + m) normal equations over the sum of the weights."""
    closed: Array
    """(6 + m,) their right side [m]."""

    @staticmethod
    def of(gaps: _Gaps, bent: Deformation, centre: Vector3, doubtful_m: float | None) -> "_System":
        """Weigh gaps: those of `doubtful_m` count a quarter; None: Tukey's weights by the spread of the gaps."""
        spread = gaps.spread_m
        if doubtful_m is None:
            squares = np.square(gaps.gaps_m / (TUKEY * spread))
            inside = squares < 1.0
            weights = np.where(inside, np.square(1.0 - squares), 0.0) * gaps.weights
            slopes = np.where(inside, (1.0 - squares) * (1.0 - 5.0 * squares), 0.0) * gaps.weights
        else:
            weights = gaps.weights / np.square(1.0 + np.square(gaps.gaps_m / doubtful_m))
            slopes = weights
        arms = gaps.positions - centre
        fields = bent.fields_along(arms, gaps.normals) / bent.radius_m
        design = np.hstack([np.cross(arms, gaps.normals) / bent.radius_m, gaps.normals, fields])
        weighted = (design * (weights / weights.sum())[:, None]).T
        matrix, closed = weighted @ design, weighted @ gaps.gaps_m
        values, vectors = np.linalg.eigh(matrix[:6, :6])
        known = vectors[:, values > LEAST_TESTIMONY]
        cross = known.T @ matrix[:6, 6:]
        rest = matrix[6:, 6:] - cross.T @ np.linalg.solve(known.T @ matrix[:6, :6] @ known, cross)
        values, vectors = np.linalg.eigh(rest)
        determined = vectors[:, values > LEAST_TESTIMONY]
        return _System(
            gaps, weights, slopes, spread, bent.radius_m, design, block_diag(known, determined), known.shape[1], matrix,
            closed,
        )  # fmt: skip

    @property
    def determined(self) -> Array:
        """(m, r) deformations that the surfaces determine."""
        return self.basis[6:, self.motions :]

    def solution(self) -> tuple[Array, Array]:
        """Give the motion (6,) [m] that closes the gaps, and the change of the coefficients (m,)."""
        change = self._solved(self.basis)
        return change[:6], change[6:] / self.radius_m

    def motion(self) -> Array:
        """Give the motion (6,) [m] that closes the gaps without any change of the coefficients."""
        return self._solved(self.basis[:, : self.motions])[:6]

    def _solved(self, basis: Array) -> Array:
        return np.asarray(basis @ np.linalg.solve(basis.T @ self.matrix @ basis, basis.T @ self.closed))

    def covariance(self, target: ScanFeatures, source: ScanFeatures) -> Array:
        """Give the covariance (r, r) of the determined deformations; rounded coordinates of both scans add theirs."""
        reduced, k = self.design @ self.basis, self.motions
        found = neighbourhood_covariance(
            reduced, self.weights, self.gaps.gaps_m, self.gaps.positions, self.gaps.normals,
            slopes=self.slopes, edge_m=0.5, shifts=np.zeros((3, reduced.shape[1])),
        )  # fmt: skip
        variances = np.where(np.isfinite(found.variances), found.variances, 1e6)
        pieces = wall_pieces(self.gaps.planes, self.gaps.positions)
        walls = wall_covariance(reduced, self.weights, self.gaps.gaps_m, pieces, slopes=self.slopes)
        whole = covering((found.axes * variances) @ found.axes.T, walls)
        weighted = reduced * self.weights[:, None]
        gain = np.linalg.solve(weighted.T @ reduced, weighted.T)
        whole = whole + rounding_covariance(gain, target, source, self.gaps.of_target, self.gaps.of_source)
        return np.asarray(whole[k:, k:] / self.radius_m**2)
