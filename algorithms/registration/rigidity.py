"""Whether two scans differ by more than a rigid motion: another scale, a stretch along one axis, a bend.

Clouds in other units, rescaled to a map projection, cut from a scanner out of adjustment or bent by a moving one can be
laid on each other so that a part of them fits perfectly, and the misfits of what fits say nothing of the rest. So from
the pose on a deformation is estimated too. It counts where it is significant *and* explains surface that the motion
does not, or is larger than any scanner errs. It is reported, never applied: which of the scans is right nobody knows.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array
from algorithms.errors import TooFewCorrespondencesError
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.poses import PoseEstimate, inversion_jacobian
from algorithms.matching.directions import comes_first
from algorithms.registration.deformed_fit import DeformationKind, DeformedFit, MotionAlone, fit_deformed
from algorithms.scans.point_blocks import side_by_side

SIGNIFICANT = 4.0
"""Standard deviations from which a deformation is significant, where it explains more surface."""
LEAST_GAINS = {DeformationKind.SCALE: 0.01, DeformationKind.STRAIN: 0.02, DeformationKind.BEND: 0.03}
"""So much more surface, relative to what fits in the pose, must fit with the deformation: more freedom finds more by
itself, and scanners bend their clouds a little."""
CERTAIN, LARGE = 10.0, 0.002
"""So many standard deviations tell a stretch that is larger than this, 2 mm in a metre, where it explains a little
surface: a scanner's ranges err by a tenth of that at the very most."""
EXPLAINED_NOISES = 1.0
"""A bend that closes gaps as large as the noise of single points is there, where it explains a little surface: what a
bend closed in poses of a car park, a yard, a hall and a street that were right was three quarters of it at most."""
LEAST_GAIN_FROM_AFAR = 0.1
"""So much more surface must fit with a large deformation where none was found near the pose: some chance fit is near
many scales. Where one was found, the one that explains more counts."""
WORTH_A_LOOK = 0.005
"""Where less more surface fits nothing is explained."""


@dataclass(frozen=True)
class Stretch:
    """How much longer the source is along a direction than the target."""

    value: float
    """Relative, positive where the source is larger; 0.02 is two per cent."""
    std: float
    """Its standard deviation."""
    direction_in_source: tuple[float, float, float] | None = None
    """Unit vector in the source's axes; None for a scale, which is the same along all."""

    def inverted(self, target_from_source: RigidTransform | None = None) -> "Stretch":
        """Say how much longer the target is than the source, along a direction in its axes."""
        direction = self.direction_in_source
        if direction is not None and target_from_source is not None:
            direction = _signed(target_from_source.rotation.apply(np.array(direction)))
        return Stretch(1.0 / (1.0 + self.value) - 1.0, self.std, direction)


@dataclass(frozen=True, eq=False)
class Rigidity:
    """What was found beside the motion."""

    scale: Stretch | None
    """One scale for all axes; None where the surfaces do not determine it."""
    stretch: Stretch | None = None
    """The most significant stretch along one direction, with scales of their own for all axes."""
    kind: DeformationKind | None = None
    """The simplest significant deformation; None where nothing speaks against a motion alone."""
    gain: float = 0.0
    """How much more surface fits with that deformation, relative to what fits in the pose."""
    motions: Array | None = None
    """(2, 6) differences of the pose (turn [rad], shift [m], reduced target frame) that put the source's instrument,
    and the target's, where the deformed scan has it; None where there is no deformation."""
    shifts_m: tuple[float, float] = (0.0, 0.0)
    """How far each instrument is from there [m]."""

    @property
    def moved_m(self) -> float:
        """How far the deformation leaves it open where an instrument stood [m]."""
        return max(self.shifts_m)

    def inverted(self, target_from_source: RigidTransform) -> "Rigidity":
        """Give the same with target and source exchanged.

        Parameters
        ----------
        target_from_source
            The pose as it was.
        """
        jacobian = inversion_jacobian(target_from_source)
        return replace(
            self,
            scale=None if self.scale is None else self.scale.inverted(),
            stretch=None if self.stretch is None else self.stretch.inverted(target_from_source),
            motions=None if self.motions is None else self.motions[::-1] @ jacobian.T,
            shifts_m=self.shifts_m[::-1],
        )

    def widened(self, pose: PoseEstimate) -> PoseEstimate:
        """Give a pose between the reduced frames with a covariance that holds what the deformation leaves open."""
        if self.motions is None:
            return pose
        return replace(pose, covariance=pose.covariance + self.motions.T @ self.motions)

    def doubts(self) -> list[str]:
        """Say by what the scans differ beside a motion, and what the cause may be."""
        if self.kind is None:
            return []
        more = f"with it {self.gain:.1%} more of the surface fits"
        if self.kind is DeformationKind.SCALE and self.scale is not None:
            what = (
                f"the source is {_percent(self.scale)} than the target (t = {self.scale.value / self.scale.std:.0f}, "
                f"{more})"
            )
        elif self.kind is DeformationKind.STRAIN and self.stretch is not None:
            along = ", ".join(f"{value:.2f}" for value in self.stretch.direction_in_source or ())
            what = (
                f"the source is {_percent(self.stretch)} than the target along ({along}) of its own axes, but not so "
                f"along the others (t = {abs(self.stretch.value) / self.stretch.std:.0f}, {more})"
            )
        else:
            what = f"one of the scans is bent against the other ({more})"
        doubt = (
            f"the scans differ by more than a motion: {what}: other units, a rescaled cloud, or a scanner out of "
            f"adjustment. Nothing was rescaled; the standard deviations hold the {self.moved_m * 1e3:.0f} mm by which "
            "this leaves the instruments open"
        )
        return [doubt]


def _percent(stretch: Stretch) -> str:
    word = "larger" if stretch.value > 0.0 else "smaller"
    return f"{abs(stretch.value) * 100:.3g} % (standard deviation {stretch.std * 100:.1g} %) {word}"


def rigidity(
    target: ScanFeatures, source: ScanFeatures, pose: RigidTransform, *, is_doubtful: bool = False
) -> Rigidity:
    """Look for a deformation of the source beside its motion.

    A scale is always estimated. Scales of their own for all axes and a bend are estimated with few points, and with all
    where they explain surface. Where something speaks against the pose, or a deformation was found, large ones are
    tried too: what differs by per cents fits some smaller deformation by chance.

    Parameters
    ----------
    target, source
        Features of both scans.
    pose
        Target from source between the reduced frames.
    is_doubtful
        Whether something else speaks against the pose.
    """
    if not comes_first(target, source):
        return rigidity(source, target, pose.inv(), is_doubtful=is_doubtful).inverted(pose.inv())
    noise_m = max(target.noise_std_m, source.noise_std_m)
    try:
        alone = MotionAlone(target, source, pose)
        scale, (strain, bend) = side_by_side(
            lambda: fit_deformed(alone, DeformationKind.SCALE), lambda: _strain_and_bend(alone)
        )
        if max(strain.gain, bend.gain) > WORTH_A_LOOK:
            strain = fit_deformed(alone, DeformationKind.STRAIN)
        if explained_by_a_bend(scale, strain, bend, noise_m):
            bend = fit_deformed(alone, DeformationKind.BEND, start=strain)
    except TooFewCorrespondencesError:
        return Rigidity(None)
    kind = _kind(scale, strain, bend, pose, noise_m)
    if is_doubtful or kind is not None:
        least = max(scale.gain, strain.gain, 0.0) + (LEAST_GAIN_FROM_AFAR if kind is None else 0.0)
        scale, strain = (_better_from_afar(alone, fit, least) for fit in (scale, strain))
        kind = _kind(scale, strain, bend, pose, noise_m)
    by_scale, stretch = _scale_of(scale), _largest_stretch(strain, pose)
    if kind is None:
        return Rigidity(by_scale, stretch)
    best = {DeformationKind.SCALE: scale, DeformationKind.STRAIN: strain, DeformationKind.BEND: bend}[kind]
    motions, shifts = _open_motions(best, target, source, pose)
    return Rigidity(by_scale, stretch, kind, best.gain, motions, shifts)


def _strain_and_bend(alone: MotionAlone) -> tuple[DeformedFit, DeformedFit]:
    """Fit both with few points, the bend from the strain on."""
    strain = fit_deformed(alone, DeformationKind.STRAIN, thorough=False)
    return strain, fit_deformed(alone, DeformationKind.BEND, thorough=False, start=strain)


def explained_by_a_bend(scale: DeformedFit, strain: DeformedFit, bend: DeformedFit, noise_m: float) -> bool:
    """Say whether a bend explains what simpler deformations do not: surface, or gaps as large as the noise.

    Parameters
    ----------
    scale, strain, bend
        The fits.
    noise_m
        Standard deviation of single points [m].
    """
    more = bend.gain - max(scale.gain, strain.gain, 0.0)
    closes = bend.explained_m > EXPLAINED_NOISES * noise_m
    return more > LEAST_GAINS[DeformationKind.BEND] or (more > LEAST_GAINS[DeformationKind.SCALE] and closes)


def _better_from_afar(alone: MotionAlone, near: DeformedFit, least_gain: float) -> DeformedFit:
    """Give the fit of a large deformation of the same kind where it gains more than that."""
    try:
        far = fit_deformed(alone, near.deformation.kind, from_afar=True)
    except TooFewCorrespondencesError:
        return near
    return far if far.gain > least_gain else near


def _kind(
    scale: DeformedFit, strain: DeformedFit, bend: DeformedFit, pose: RigidTransform, noise_m: float
) -> DeformationKind | None:
    """Say which deformation is there: the simplest that explains the surface; None if none is significant."""
    more = strain.gain - max(scale.gain, 0.0)
    if _tells(_scale_of(scale), scale) and more < LEAST_GAINS[DeformationKind.STRAIN]:
        return DeformationKind.SCALE
    if _tells(_largest_stretch(strain, pose), strain):
        return DeformationKind.STRAIN
    return DeformationKind.BEND if explained_by_a_bend(scale, strain, bend, noise_m) else None


def _tells(found: Stretch | None, fit: DeformedFit) -> bool:
    """Say whether a stretch is significant and matters."""
    if found is None:
        return False
    size = abs(found.value)
    explains = size > SIGNIFICANT * found.std and fit.gain > LEAST_GAINS[fit.deformation.kind]
    return explains or (size > CERTAIN * found.std and size > LARGE and fit.gain > WORTH_A_LOOK)


def _scale_of(fit: DeformedFit) -> Stretch | None:
    """Give the scale of the source over the target; the fit's makes the source fit."""
    if fit.covariance is None or fit.determined.shape[1] == 0:
        return None
    value = float(fit.deformation.coefficients[0])
    return Stretch(1.0 / (1.0 + value) - 1.0, float(fit.covariance[0, 0] ** 0.5))


def _largest_stretch(fit: DeformedFit, pose: RigidTransform) -> Stretch | None:
    """Give the most significant principal stretch."""
    if fit.covariance is None or fit.determined.shape[1] == 0:
        return None
    values, axes = np.linalg.eigh(fit.deformation.strain())
    covariance = fit.determined @ fit.covariance @ fit.determined.T
    fields = fit.deformation.fields(axes.T)[:, :, :6]
    # a principal stretch changes by its direction's share of each component of the strain
    shares = np.einsum("ki,kim->km", axes.T, fields)
    stds = np.sqrt(np.maximum(np.einsum("km,mn,kn->k", shares, covariance[:6, :6], shares), 1e-18))
    most = int(np.argmax(np.abs(values) / stds))
    direction = _signed(pose.rotation.inv().apply(axes[:, most]))
    return Stretch(float(1.0 / (1.0 + values[most]) - 1.0), float(stds[most]), direction)


def _signed(direction: Array) -> tuple[float, float, float]:
    """Turn a unit vector so that its largest component is positive."""
    x, y, z = (direction * np.sign(direction[np.argmax(np.abs(direction))])).tolist()
    return float(x), float(y), float(z)


def _open_motions(
    fit: DeformedFit, target: ScanFeatures, source: ScanFeatures, pose: RigidTransform
) -> tuple[Array, tuple[float, float]]:
    """Give the differences of the pose that put each instrument where the deformed scan has it."""
    turn = (fit.target_from_source.rotation * pose.rotation.inv()).as_rotvec()
    here = target.index.centre_m if target.sensor_m is None else target.sensor_m
    there = source.index.centre_m if source.sensor_m is None else source.sensor_m
    places = pose.apply(there), here
    shifts = fit.apply(there[None])[0] - places[0], here - pose.apply(fit.undone(here[None])[0])
    motions = [
        np.concatenate([turn, shift - np.cross(turn, place - np.asarray(pose.translation))])
        for place, shift in zip(places, shifts, strict=True)
    ]
    return np.array(motions), (float(np.linalg.norm(shifts[0])), float(np.linalg.norm(shifts[1])))
