"""Lens models of a calibration: contradictions of image points, and their derivatives (U-09).

Camera frames are right, down, forward, image points columns and rows of pixels, as everywhere in `algorithms`.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from algorithms.arrays import Array

LEAST_DEPTH = 1e-9


@dataclass(frozen=True)
class Misfit:
    """Computed minus measured, and derivatives."""

    residuals: Array
    """(n, 2) [px]."""
    by_seen: Array
    """(n, 2, 3) by the points in the frame of the camera [px/m]."""
    by_parameters: Array
    """(n, 2, k)."""


@dataclass(frozen=True)
class Lens(ABC):
    """A model with its parameters in their order."""

    names: ClassVar[tuple[str, ...]]
    """Parameters: principal distance, column and row of the principal point [px], then what bends the rays."""

    @abstractmethod
    def misfit(self, seen: Array, measured: Array, parameters: Array) -> Misfit:
        """Compute contradictions of measured image points (n, 2) of points seen (n, 3) [m] with parameters (k,)."""

    @abstractmethod
    def rays(self, image: Array, parameters: Array) -> Array:
        """Give the directions (n, 3), z = 1, of image points (n, 2)."""

    def started(self, principal_distance_px: float, width: int, height: int) -> Array:
        """Give parameters (k,) of a lens without distortion whose axis meets the middle of the photo."""
        found = np.zeros(len(self.names))
        found[:3] = principal_distance_px, 0.5 * (width - 1), 0.5 * (height - 1)
        return found

    def place(self, name: str) -> int:
        """Give the place of a parameter."""
        return self.names.index(name)

    def image(self, seen: Array, parameters: Array, guess: Array | None = None) -> Array:
        """Project points (n, 3) in front of the camera to image points (n, 2)."""
        image = np.zeros((len(seen), 2)) if guess is None else guess.copy()
        return np.asarray(image + self.misfit(seen, image, parameters).residuals)


@final
@dataclass(frozen=True)
class ForwardLens(Lens):
    """OpenCV's: the distortion displaces the ideal point; with k4 to k6 its rational model.

    fy = f and fx = f (1 + b), so that a lens of square pixels has one principal distance.
    """

    names: ClassVar = ("f", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "b")

    def misfit(self, seen: Array, measured: Array, parameters: Array) -> Misfit:
        """Compute u = fx (x g + 2 p1 x y + p2 (r² + 2x²)) + cx, v alike, g = (1 + k1 r² + …)/(1 + k4 r² + …)."""
        fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6, b = parameters
        fx = fy * (1.0 + b)
        depth = _depths(seen)
        x, y = seen[:, 0] / depth, seen[:, 1] / depth
        r2 = x * x + y * y
        above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
        gain = above / below
        slope = (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3) - gain * (k4 + r2 * (2.0 * k5 + 3.0 * r2 * k6))) / below
        bent_x = x * gain + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        bent_y = y * gain + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
        residuals = np.column_stack([fx * bent_x + cx, fy * bent_y + cy]) - measured
        by_ideal = np.empty((len(seen), 2, 2))
        by_ideal[:, 0, 0] = fx * (gain + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x)
        by_ideal[:, 0, 1] = fx * (2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y)
        by_ideal[:, 1, 0] = fy * (2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y)
        by_ideal[:, 1, 1] = fy * (gain + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x)
        by_parameters = np.zeros((len(seen), 2, len(self.names)))
        by_parameters[:, 0, 0], by_parameters[:, 1, 0] = (1.0 + b) * bent_x, bent_y
        by_parameters[:, 0, 1] = by_parameters[:, 1, 2] = 1.0
        by_parameters[:, 0, 11] = fy * bent_x
        scaled = np.column_stack([fx * x, fy * y])
        powers = np.column_stack([r2, r2**2, r2**3])
        radial = scaled[:, :, None] * (powers / below[:, None])[:, None, :]
        by_parameters[:, :, [3, 4, 7]] = radial
        by_parameters[:, :, [8, 9, 10]] = -gain[:, None, None] * radial
        by_parameters[:, 0, 5], by_parameters[:, 1, 5] = 2.0 * fx * x * y, fy * (r2 + 2.0 * y * y)
        by_parameters[:, 0, 6], by_parameters[:, 1, 6] = fx * (r2 + 2.0 * x * x), 2.0 * fy * x * y
        return Misfit(residuals, by_ideal @ _by_seen(x, y, depth), by_parameters)

    def rays(self, image: Array, parameters: Array) -> Array:
        """Undo the distortion by Newton's method."""
        f, cx, cy = parameters[:3]
        ideal = (image - np.array([cx, cy])) / (f * np.array([1.0 + parameters[-1], 1.0]))
        for _ in range(30):
            seen = np.column_stack([ideal, np.ones(len(ideal))])
            found = self.misfit(seen, image, parameters)
            step = np.linalg.solve(found.by_seen[:, :, :2], found.residuals[:, :, None])[:, :, 0]
            ideal = ideal - step
            if not np.abs(step).max(initial=0.0) > 1e-14:
                break
        return np.column_stack([ideal, np.ones(len(ideal))])


@final
@dataclass(frozen=True)
class BackwardLens(Lens):
    """Brown's: the distortion corrects the measured point, as in photogrammetry (PhotoModeler, DBAT, Australis).

    Measured from the principal point, x right and y up, r² = x² + y²:
    x' = x + x (K1 r² + K2 r⁴ + K3 r⁶) + P1 (r² + 2x²) + 2 P2 x y, y' = y + y (…) + P2 (r² + 2y²) + 2 P1 x y;
    the affinity 1 + b stretches x before that, or x' after it (D. C. Brown, Close-range camera calibration, 1971).
    """

    stretched_first: bool = True
    """Whether the affinity acts before the distortion."""
    names: ClassVar = ("c", "x0", "y0", "K1", "K2", "K3", "P1", "P2", "b")

    def misfit(self, seen: Array, measured: Array, parameters: Array) -> Misfit:
        """Compute c x/z and c y/z (y up) minus the corrected measured points; rows are turned down again."""
        c = parameters[0]
        depth = _depths(seen)
        x, y = seen[:, 0] / depth, seen[:, 1] / depth
        corrected, by_parameters = self._corrected(measured, parameters)
        # rows count downwards, as those of every image
        residuals = c * np.column_stack([x, y]) - corrected
        by_parameters = -by_parameters
        by_parameters[:, 0, 0], by_parameters[:, 1, 0] = x, y
        return Misfit(residuals, c * _by_seen(x, y, depth), by_parameters)

    def _corrected(self, measured: Array, parameters: Array) -> tuple[Array, Array]:
        """Correct measured points; (n, 2) in pixels, x right and y down, and (n, 2, k)."""
        _, x0, y0, k1, k2, k3, p1, p2, b = parameters
        stretch = 1.0 + b
        first = stretch if self.stretched_first else 1.0
        across, y = measured[:, 0] - x0, y0 - measured[:, 1]
        x = first * across
        r2 = x * x + y * y
        radial = r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))
        corrected_x = x * (1.0 + radial) + p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y
        corrected_y = y * (1.0 + radial) + p2 * (r2 + 2.0 * y * y) + 2.0 * p1 * x * y
        by_x = np.column_stack([
            1.0 + radial + x * x * slope + 6.0 * p1 * x + 2.0 * p2 * y,
            x * y * slope + 2.0 * p2 * x + 2.0 * p1 * y,
        ])  # fmt: skip
        by_y = np.column_stack([by_x[:, 1], 1.0 + radial + y * y * slope + 6.0 * p2 * y + 2.0 * p1 * x])
        terms = np.zeros((len(x), 2, len(self.names)))
        terms[:, :, 1], terms[:, :, 2] = -first * by_x, by_y
        for place, power in ((3, r2), (4, r2**2), (5, r2**3)):
            terms[:, 0, place], terms[:, 1, place] = x * power, y * power
        terms[:, 0, 6], terms[:, 1, 6] = r2 + 2.0 * x * x, 2.0 * x * y
        terms[:, 0, 7], terms[:, 1, 7] = 2.0 * x * y, r2 + 2.0 * y * y
        if self.stretched_first:
            terms[:, :, 8] = by_x * across[:, None]
        else:
            terms[:, 0] *= stretch
            terms[:, 0, 8] = corrected_x
            corrected_x = stretch * corrected_x
        corrected = np.column_stack([corrected_x, -corrected_y])
        terms[:, 1] *= -1.0
        return corrected, terms

    def rays(self, image: Array, parameters: Array) -> Array:
        """Correct the image points."""
        corrected = self._corrected(image, parameters)[0]
        return np.column_stack([corrected / parameters[0], np.ones(len(image))])

    def image(self, seen: Array, parameters: Array, guess: Array | None = None) -> Array:
        """Find what is corrected to the ideal points, by Newton's method."""
        depth = _depths(seen)
        ideal = parameters[0] * seen[:, :2] / depth[:, None]
        image = ideal + parameters[1:3] if guess is None else guess.copy()
        for _ in range(60):
            corrected, terms = self._corrected(image, parameters)
            # moving the principal point moves the corrected point the other way
            jacobians = -terms[:, :, 1:3]
            step = np.linalg.solve(jacobians, (ideal - corrected)[:, :, None])[:, :, 0]
            image = image + step
            if not np.abs(step).max(initial=0.0) > 1e-10:
                break
        return np.asarray(image)


LENSES: Mapping[str, Lens] = {
    "opencv": ForwardLens(),
    "brown": BackwardLens(),
    "brown-affinity-after": BackwardLens(stretched_first=False),
}
"""Lens models by their names in requests."""


def _depths(seen: Array) -> Array:
    return np.where(np.abs(seen[:, 2]) < LEAST_DEPTH, LEAST_DEPTH, seen[:, 2])


def _by_seen(x: Array, y: Array, depth: Array) -> Array:
    found = np.zeros((len(x), 2, 3))
    found[:, 0, 0] = found[:, 1, 1] = 1.0 / depth
    found[:, 0, 2], found[:, 1, 2] = -x / depth, -y / depth
    return found
