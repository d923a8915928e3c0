"""Whether a calibration repeats: halves of its photos against each other, and against an earlier calibration."""

from dataclasses import dataclass, replace

import numpy as np

from algorithms.adjustment.hybrid.state import State
from algorithms.arrays import Array
from algorithms.calibration.lenses import Lens
from algorithms.calibration.projection import differences, expected_differences, format_grid
from algorithms.calibration.solution import Calibration, CalibrationOptions, calibrate
from algorithms.calibration.target_field import TargetField
from algorithms.errors import AlgorithmError
from algorithms.probabilities import chi2_sf

LEAST_PHOTOS = 6
"""Fewer photos are not split."""


@dataclass(frozen=True, eq=False)
class Halves:
    """Two calibrations from every other photo."""

    image: Array
    """(g, 2) [px]."""
    differences: Array
    """(g, 2) second minus first [px]."""
    expected: Array
    """(g,) root mean square length that both covariances let expect [px]."""

    @property
    def ratio(self) -> float:
        """Root mean square of the differences over what is expected of them; above 2 the model misses something."""
        lengths = np.sum(np.square(self.differences), axis=1)
        return float(np.sqrt(lengths.mean() / np.square(self.expected).mean()))


def compare_halves(field: TargetField, state: State) -> Halves | str:
    """Calibrate from the photos with even and from those with odd numbers; say why where that is not possible.

    Parameters
    ----------
    field
        Targets and photos, with the standard deviations that image points have.
    state
        A solution, from which both start.
    """
    photos = len(field.photo_names)
    if photos < LEAST_PHOTOS:
        return f"{photos} photos are too few for two halves: {LEAST_PHOTOS} are needed"
    options = CalibrationOptions(scaled_stds=False, gross_errors=False, compares_photos=False)
    halves = []
    for parity in (0, 1):
        chosen = np.arange(photos) % 2 == parity
        part = field.with_photos(chosen)
        try:
            halves.append(calibrate(part, options, _of_photos(state, chosen)))
        except AlgorithmError as error:
            return f"one half of the photos alone does not determine the camera: {error}"
    first, second = halves
    image = format_grid(field.width, field.height)
    covariance = first.lens_covariance + second.lens_covariance
    spread = expected_differences(field.lens, first.parameters, covariance, image)
    expected = np.sqrt(np.trace(spread, axis1=1, axis2=2))
    found = differences((field.lens, first.parameters), (field.lens, second.parameters), image)
    return Halves(image, found, expected)


def _of_photos(state: State, chosen: Array) -> State:
    return replace(state, rotations=state.rotations[chosen], positions=state.positions[chosen])


@dataclass(frozen=True, eq=False)
class BeforeAfter:
    """A calibration against an earlier one."""

    names: list[str]
    before: Array
    after: Array
    stds: Array
    """(q,) of the differences."""
    statistic: float
    """T of all differences together."""
    p_value: float
    """Probability of a larger T when nothing changed."""
    image: Array
    """(g, 2) [px]."""
    differences: Array
    """(g, 2) of the projections, after minus before [px]."""


def compare_with_earlier(done: Calibration, lens: Lens, parameters: Array, stds: Array) -> BeforeAfter:
    """Test whether the camera changed (MATH 4.2).

    Parameters
    ----------
    done
        The present calibration, in which the earlier one must not have been an observation.
    lens, parameters
        Of the earlier one.
    stds
        (k,) of its parameters, zero where it is taken as exact; of another lens model they do not count.
    """
    image = format_grid(done.field.width, done.field.height)
    found = differences((lens, parameters), (done.field.lens, done.parameters), image)
    if lens != done.field.lens:
        none = np.zeros(0)
        return BeforeAfter([], none, none, none, float("nan"), float("nan"), image, found)
    free = np.flatnonzero(np.diag(done.lens_covariance) > 0.0)
    covariance = done.lens_covariance[np.ix_(free, free)] + np.diag(np.square(stds[free]))
    change = done.parameters[free] - parameters[free]
    scale = np.sqrt(np.diag(covariance))
    white = np.linalg.solve(np.linalg.cholesky(covariance / np.outer(scale, scale)), change / scale)
    statistic = float(white @ white)
    return BeforeAfter(
        [lens.names[k] for k in free], parameters[free], done.parameters[free], scale, statistic,
        float(chi2_sf(statistic, len(free))), image, found,
    )  # fmt: skip
