"""Calibrate a camera and its mount: adjust, test what is determined, covariance of the parameters (U-09 to U-12)."""

from dataclasses import dataclass, replace

import numpy as np

from algorithms.adjustment.hybrid.estimation import Estimate, estimate
from algorithms.adjustment.hybrid.gross_errors import GrossErrorOptions, Removal, Search
from algorithms.adjustment.hybrid.network import Network
from algorithms.adjustment.hybrid.state import Kind, State
from algorithms.arrays import Array, Flags
from algorithms.calibration.starting import start_of
from algorithms.calibration.structure import require_structure
from algorithms.calibration.target_field import TargetField
from algorithms.errors import DegenerateGeometryError, NotConvergedError
from algorithms.progress import NoProgress, Progress

MAX_ITERATIONS = 60
LARGEST_STD = 0.05
"""Standard deviations of principal distance and point beyond this share of the principal distance determine nothing."""
TILT_IN_STD = 10.0
"""Directions of a flat target must differ by so many of their standard deviations: what they tell of the principal
distance grows with the square of the difference, and is noise below."""
FLAT = 1e-3
"""Targets whose third extent is below this share of the first lie in a plane."""
TAKES_PART = 0.2


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
    found = estimate(network, state, np.ones(len(network.stds)), MAX_ITERATIONS)
    # what is not determined need not settle, and no observation can be tested in it
    _require_sound(_described(field, network, found, [], 1.0))
    factor, removals = 1.0, []
    if chosen.scaled_stds:
        factor = _std_factor(field, found)
        field = replace(field, image_stds=factor * field.image_stds)
        network = field.network()
        found = estimate(network, found.state, found.weights, MAX_ITERATIONS)
    if chosen.gross_errors and found.redundancy > 0:
        progress.report(0.4, "searching for gross errors")
        cleaned = _search(field, network, found, chosen).run()
        found, removals = cleaned.estimate, cleaned.removals
    done = _described(field, network, found, removals, factor)
    _require_sound(done)
    return done


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


def _std_factor(field: TargetField, found: Estimate) -> float:
    """Compare residuals with standard deviations, robustly: a normal distribution's third quarter is at 0.6745."""
    white = np.abs(found.linearised.residuals[: 2 * len(field.photos)])
    share = max(found.redundancy / max(found.used, 1), 1e-6)
    return max(float(np.median(white)) / 0.6745 / float(np.sqrt(share)), 1e-6)


def _search(field: TargetField, network: Network, found: Estimate, chosen: CalibrationOptions) -> Search:
    blocks = len(network.sizes)
    fictitious = np.zeros(blocks, dtype=bool)
    fictitious[len(field.photos) + int((field.known & ~field.held).sum()) :] = True
    options = GrossErrorOptions(
        screening_m=None, robust=False, snooping=True, alpha=chosen.alpha, power=chosen.power,
        max_removed_share=chosen.max_removed_share, max_iterations=MAX_ITERATIONS,
    )  # fmt: skip
    return Search(network, found.state, np.zeros(blocks, dtype=np.int64), fictitious, options)


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
