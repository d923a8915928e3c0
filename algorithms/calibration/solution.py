"""Calibrate a camera and its mount: adjust, test what is determined, covariance of the parameters (U-09 to U-12)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from algorithms.adjustment.hybrid.estimation import Estimate, estimate
from algorithms.adjustment.hybrid.gross_errors import Cleaned, GrossErrorOptions, Removal, Search, most_left_out
from algorithms.adjustment.hybrid.network import Network
from algorithms.adjustment.hybrid.state import Kind, State
from algorithms.adjustment.variance_components import LEAST_REDUNDANCY
from algorithms.arrays import Array, Flags
from algorithms.calibration.one_camera import repeated_photos, require_one_distance, turned_photos, with_turned
from algorithms.calibration.starting import start_of
from algorithms.calibration.structure import require_structure
from algorithms.calibration.target_field import TargetField
from algorithms.errors import DegenerateGeometryError, NotConvergedError
from algorithms.probabilities import chi2_isf, chi2_sf
from algorithms.progress import NoProgress, Progress

MAX_ITERATIONS = 60
LARGEST_STD = 0.05
"""Standard deviations of principal distance and point beyond this share of the principal distance determine nothing."""
TILT_IN_STD = 10.0
"""Directions of a flat target must differ by so many of their standard deviations: what they tell of the principal
distance grows with the square of the difference, and is noise below."""
FLAT = 1e-3
"""Targets whose third extent is below this share of the first lie in a plane."""
ROBUST_ROUNDS, ROBUST_ITERATIONS = 8, 4
ROBUST_WIDTH = 2.0
"""Image points that miss by so many medians count half in the first adjustment."""
FAR = 5.0
"""Those that miss by more medians are left out of it; a test decides later whether they return."""
MOST_ROUNDS = 10
"""Of scales and searches for gross errors."""
SETTLED = 0.01
"""A factor on the standard deviations that changes by less has settled."""


@dataclass(frozen=True)
class CalibrationOptions:
    """How to calibrate."""

    scaled_stds: bool = True
    """Whether the image points' standard deviations are multiplied by what the residuals say of them."""
    gross_errors: bool = True
    """Whether image points that fail their test are left out."""
    alpha: float = 0.001
    """Probability that a good image point fails its test."""
    power: float = 0.80
    """Probability with which an error of the smallest detectable size is found."""
    max_removed_share: float = 0.2
    """Largest share of the image points that may be left out."""
    compares_photos: bool = True
    """Whether photos are looked through for repetitions, other principal distances, and turned ones."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated camera."""

    field: TargetField
    """With the standard deviations that image points had in the end."""
    network: Network
    estimate: Estimate
    removals: list[Removal]
    columns: Array
    """(q,) columns of the free parameters of the camera, then of the mount."""
    names: list[str]
    """(q,)."""
    covariance: Array
    """(q, q); a mount's rotation [rad] is about the axes of the camera."""
    std_factor: float
    """By what the image points' standard deviations were multiplied."""
    repeated: Sequence[tuple[str, str]] = ()
    """Photos that were left out, and of which photo each is a copy."""
    turned: Sequence[str] = ()
    """Photos that were turned by 180° to fit the camera of the others."""

    @property
    def state(self) -> State:
        """Adjusted values."""
        return self.estimate.state

    @property
    def parameters(self) -> Array:
        """Give those of the lens, (k,)."""
        return np.asarray(self.state.cameras[0, : len(self.field.lens.names)])

    @property
    def residuals(self) -> Array:
        """Give computed minus measured of all image points, (m, 2) [px]."""
        return np.asarray(self.estimate.linearised.raw_residuals[: 2 * len(self.field.photos)].reshape(-1, 2))

    @property
    def used(self) -> Flags:
        """Tell which image points were used, (m,)."""
        return np.asarray(self.estimate.weights[: 2 * len(self.field.photos)].reshape(-1, 2)[:, 0] > 0.0)

    @property
    def lens_covariance(self) -> Array:
        """Give that of all parameters of the lens, (k, k), zero for constant ones."""
        k = len(self.field.lens.names)
        columns = self.network.layout.columns[Kind.CAMERA][0, :k]
        free = np.flatnonzero(columns >= 0)
        found = np.zeros((k, k))
        at = np.searchsorted(self.columns[: np.sum(self.network.layout.columns[Kind.CAMERA] >= 0)], columns[free])
        found[np.ix_(free, free)] = self.covariance[np.ix_(at, at)]
        return found


def calibrate(
    field: TargetField,
    options: CalibrationOptions | None = None,
    start: State | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Calibrate from scratch, or from given values.

    Parameters
    ----------
    field
        Targets and photos.
    options
        How; None: as usual.
    start
        Values of all unknowns; None: they are found.
    progress
        Hears how it goes.

    Raises
    ------
    DegenerateGeometryError
        What is not determined, by name, and what to add.
    InvalidInputError
        There are no start values.
    NotConvergedError
        The adjustment did not settle.
    """
    chosen, progress = options or CalibrationOptions(), progress or NoProgress()
    require_structure(field)
    progress.report(0.05, "start values")
    state = start_of(field) if start is None else start
    network = field.network()
    progress.report(0.2, "adjusting")
    found, removals = _first(field, network, state, chosen)
    repeated: list[tuple[str, str]] = []
    turned: list[str] = []
    if chosen.compares_photos:
        progress.report(0.3, "comparing photos")
        require_one_distance(field, found)
        names = field.photo_names
        pairs = repeated_photos(field, _robust_factor(field, found))
        repeated = [(names[later], names[earlier]) for later, earlier in pairs]
        again = field.with_photos(~np.isin(np.arange(len(names)), [later for later, _ in pairs]))
        numbers = turned_photos(field, network, found) if found.converged else []
        turned = [names[k] for k in numbers if names[k] in again.photo_names]
        again = with_turned(again, [again.photo_names.index(name) for name in turned])
        if repeated or turned:
            field, network = again, again.network()
            found, removals = _first(field, network, start_of(field), chosen)
    # what is not determined need not settle, and no observation can be tested in it
    _require_sound(_described(field, network, found, [], 1.0))
    settled = _settled(field, network, found, removals, chosen, progress)
    done = replace(settled, repeated=repeated, turned=turned)
    _require_sound(done)
    return done


def _first(
    field: TargetField, network: Network, start: State, chosen: CalibrationOptions
) -> tuple[Estimate, list[Removal]]:
    """Adjust; where gross errors are looked for, without what misses by far, which may keep it from settling."""
    weights = np.ones(len(network.sizes))
    if not chosen.gross_errors:
        return estimate(network, start, weights[network.block_of_row], MAX_ITERATIONS), []
    images = len(field.photos)
    misses = _lengths(network.linearised(start).residuals, images)
    for _ in range(ROBUST_ROUNDS):
        scale = max(float(np.median(misses)), 1e-9)
        weights[:images] = 1.0 / (1.0 + np.square(misses / (ROBUST_WIDTH * scale)))
        found = estimate(network, start, weights[network.block_of_row], ROBUST_ITERATIONS, rough=True)
        start, misses = found.state, _lengths(found.linearised.residuals, images)
        if found.converged and float(np.median(misses)) > 0.9 * scale:
            break
    far = np.flatnonzero(misses > FAR * max(float(np.median(misses)), 1e-9))
    far = far[np.argsort(-misses[far], kind="stable")[: most_left_out(chosen.max_removed_share, images)]]
    weights[:] = 1.0
    weights[far] = 0.0
    removals = [Removal(int(k), "robust", 1, float(misses[k])) for k in far]
    return estimate(network, start, weights[network.block_of_row], MAX_ITERATIONS), removals


def _lengths(residuals: Array, images: int) -> Array:
    return np.asarray(np.linalg.norm(residuals[: 2 * images].reshape(-1, 2), axis=1))


def _settled(
    field: TargetField,
    network: Network,
    found: Estimate,
    removals: list[Removal],
    chosen: CalibrationOptions,
    progress: Progress,
) -> Calibration:
    """Scale standard deviations and leave gross errors out by turns: each decides on what the other looks like."""
    factor, change = 1.0, _robust_factor(field, found) if chosen.scaled_stds else 1.0
    used = np.ones(len(network.sizes), dtype=bool)
    used[[each.block for each in removals]] = False
    for _ in range(MOST_ROUNDS):
        if chosen.scaled_stds:
            factor *= change
            field = replace(field, image_stds=change * field.image_stds)
            network = field.network()
            found = estimate(network, found.state, found.weights, MAX_ITERATIONS)
        if not (chosen.gross_errors and found.redundancy > 0):
            break
        progress.report(0.4, "searching for gross errors")
        cleaned = _search(field, network, found, chosen, used).run()
        found, used = cleaned.estimate, cleaned.used
        removals = [each for each in removals if not used[each.block]]
        already = {each.block for each in removals}
        removals += [each for each in cleaned.removals if each.block not in already]
        change = _cleaned_factor(field, cleaned, chosen.alpha)
        if not chosen.scaled_stds or abs(change - 1.0) < SETTLED:
            break
    return _described(field, network, found, removals, factor)


def _described(
    field: TargetField, network: Network, found: Estimate, removals: list[Removal], factor: float
) -> Calibration:
    _require_determined(field, network, found)
    columns = np.concatenate([network.layout.columns[kind].ravel() for kind in (Kind.CAMERA, Kind.MOUNT)])
    columns = columns[columns >= 0]
    names = np.array(field.unknown_names())[columns].tolist()
    covariance = covariance_of(found, columns, network.layout.count)
    return Calibration(field, network, found, removals, columns, names, covariance, factor)


def _require_sound(done: Calibration) -> None:
    _require_precision(done)
    _require_views(done)
    if not done.estimate.converged:
        raise NotConvergedError("the calibration", done.estimate.iterations, float("nan"))


def covariance_of(found: Estimate, columns: Array, count: int) -> Array:
    """Give the covariance of some unknowns, (q, q), from the factor of the normal equations (MATH 3.1)."""
    right = np.zeros((count, len(columns)))
    right[columns, np.arange(len(columns))] = 1.0
    covariance = found.factor.solved(right)[columns]
    return np.asarray(0.5 * (covariance + covariance.T))


def _robust_factor(field: TargetField, found: Estimate) -> float:
    """Compare residuals with standard deviations, robustly: a normal distribution's third quarter is at 0.6745."""
    rows = 2 * len(field.photos)
    white = np.abs(found.linearised.residuals[:rows][found.weights[:rows] > 0.0])
    share = max(found.redundancy / max(found.used, 1), 1e-6)
    return max(float(np.median(white)) / 0.6745 / float(np.sqrt(share)), 1e-6)


def _cleaned_factor(field: TargetField, cleaned: Cleaned, alpha: float) -> float:
    """Compare residuals with standard deviations where those beyond the limit of the tests are missing (MATH 4.7)."""
    rows = np.arange(2 * len(field.photos))
    weights = cleaned.estimate.weights[rows]
    omega = float(weights @ np.square(cleaned.estimate.linearised.residuals[rows]))
    redundancy = float(cleaned.tests.redundancy[rows][weights > 0.0].sum())
    limit = chi2_isf(alpha, 2)
    # the mean of a chi squared of two degrees below the limit of its tests
    kept = (1.0 - chi2_sf(limit, 4)) / (1.0 - alpha)
    return float(np.sqrt(omega / (kept * redundancy))) if redundancy >= LEAST_REDUNDANCY and omega > 0.0 else 1.0


def _search(field: TargetField, network: Network, found: Estimate, chosen: CalibrationOptions, used: Flags) -> Search:
    blocks = len(network.sizes)
    fictitious = np.zeros(blocks, dtype=bool)
    fictitious[len(field.photos) + int((field.known & ~field.held).sum()) :] = True
    options = GrossErrorOptions(
        screening_m=None, robust=False, snooping=True, alpha=chosen.alpha, power=chosen.power,
        max_removed_share=chosen.max_removed_share, max_iterations=MAX_ITERATIONS,
    )  # fmt: skip
    return Search(network, found.state, np.zeros(blocks, dtype=np.int64), fictitious, options, used=used)


def _require_determined(field: TargetField, network: Network, found: Estimate) -> None:
    count = network.layout.count
    names = field.unknown_names()
    if found.defect.count:
        raise DegenerateGeometryError(
            count - found.defect.count, found.defect.named(), found.defect.basis,
            advice="give known coordinates of three targets that are not on one line", parameters=count,
        )  # fmt: skip
    if len(found.fictitious):
        concerned = [name for name, free in zip(names, found.undetermined(), strict=True) if free]
        raise DegenerateGeometryError(
            count - len(found.fictitious), concerned[:20],
            advice=f"hold some of them, or add {ADVICE}", parameters=count,
        )  # fmt: skip


ADVICE = "photos that are tilted by 20 to 45 degrees about both axes and turned by a right angle, or targets in depth"


def _require_precision(done: Calibration) -> None:
    limit = LARGEST_STD * done.parameters[0]
    weak = []
    for k, name in enumerate(done.field.lens.names[:3]):
        if name in done.names:
            std = float(np.sqrt(done.covariance[done.names.index(name), done.names.index(name)]))
            # what does not settle has no finite figure either
            if not std < limit:
                weak.append(f"{name}, known to {std:.3g} px of {done.parameters[k]:.6g} px only")
    if weak:
        raise DegenerateGeometryError(
            done.network.layout.count - len(weak), weak, advice=f"add {ADVICE}", parameters=done.network.layout.count
        )


def _require_views(done: Calibration) -> None:
    """Refuse flat targets seen from one direction only: principal distance and distance are one there."""
    field, state = done.field, done.state
    if field.mount is not None or not field.unknown[0] or np.isfinite(field.parameter_stds[0]):
        return
    shown = state.points[np.unique(field.points)]
    sizes, axes = np.linalg.svd(shown - shown.mean(axis=0), full_matrices=False)[1:]
    if sizes[2] > FLAT * sizes[0]:
        return
    normals = np.einsum("nji,j->ni", state.rotations, axes[2])
    columns = done.network.layout.columns[Kind.POSE][:, :3]
    turns = np.array([covariance_of(done.estimate, each, done.network.layout.count) for each in columns])
    stds = np.sqrt(np.linalg.eigvalsh(turns)[:, -1])
    apart = np.arccos(np.clip(np.abs(normals @ normals.T), 0.0, 1.0))
    in_std = apart / np.hypot(stds[:, None], stds[None, :])
    if not in_std.max(initial=0.0) > TILT_IN_STD:
        what = (
            f"{field.lens.names[0]}: all {len(normals)} photos see the flat target from one direction (within "
            f"{np.degrees(apart.max(initial=0.0)):.2g} degrees, less than {TILT_IN_STD:.0f} standard deviations), "
            "and principal distance and distance are one"
        )
        count = done.network.layout.count
        raise DegenerateGeometryError(count - 1, [what], advice=f"add {ADVICE}", parameters=count)
