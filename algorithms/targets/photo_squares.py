"""A square target in the pixels of a photo: a blurred square in its own plane on ground of uneven brightness."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Flags, Scalars, Vectors2
from algorithms.numbered_rows import numbered_rows
from algorithms.targets.damped_fit import damped_fit, error_parts, gain_of
from algorithms.targets.options import TargetKind
from algorithms.targets.spot_shape import SpotShape

KNOWN_BLUR = 0.4
"""Standard deviation of the logarithm of the blur: lens and pixel, within a factor of one and a half."""
KNOWN_SHAPE, OPEN_SHAPE = 0.02, 0.5
"""Standard deviation of a stretch of the square whose plane is known, or is not."""
SURE = 0.02
"""Pixels that are part of the square or of the ground to so much are left out where they are something else."""
OUTLYING, MOST_LEFT_OUT = 4.0, 0.3
LEAST_PIXELS = 30
ROUNDS = 3
BLOCK = 6.0
"""Width in blurs of blocks whose residuals may be dependent."""
FIXED = 7
"""Place (2), logarithm of the blur, three stretches, turn; then the ground outside and inside."""


@dataclass(frozen=True, eq=False)
class SquareFit:
    """Where a square lies in its plane."""

    place: Array
    """(2,) [m]."""
    covariance: Array
    """(2, 2) [m²]."""
    by_ground: Array
    """(2, n) derivatives of the place by the brightness of the ground behind each pixel; 0 of those left out."""
    inside_covariance: Array
    """(2, 2) of the covariance, what pixels of the square itself and what is known before contribute [m²]."""
    agreement: float
    """Share of the brightness's variance that the square explains, 0..1."""
    rms: float
    """Of the residuals [grey levels]."""
    contrast: float
    """Brightness inside minus outside, at the centre [grey levels]."""
    stretch: float
    """Largest stretch of the square."""
    turn_rad: float


def fit_square(
    places: Vectors2, grey: Scalars, size_m: float, start: Array, blur_m: float, *, plane_is_known: bool
) -> SquareFit | None:
    """Fit a square to the brightness of pixels; None where it does not settle or too few are left.

    The brightness inside and outside is a plane each, the square is blurred by lens and pixel, and all are found
    together. Pixels far from the contour that do not fit are something else and left out. The covariance is taken from
    the residuals themselves (White 1980, in the form HC3).

    Parameters
    ----------
    places
        (n, 2) where the rays of the pixels meet the target's plane [m].
    grey
        (n,) brightness, linear or not.
    size_m
        Side [m].
    start
        (3,) place [m] and turn [rad].
    blur_m
        Expected standard deviation of the blur [m].
    plane_is_known
        Whether the plane is the target's own; otherwise it is foreshortened in a way that is found.
    """
    kept = np.ones(len(places), dtype=bool)
    stretch_std = KNOWN_SHAPE if plane_is_known else OPEN_SHAPE
    everything = SquareModel(places, grey, size_m, start, blur_m, stretch_std)
    x = None
    for _ in range(ROUNDS):
        if np.count_nonzero(kept) < max(LEAST_PIXELS, (1.0 - MOST_LEFT_OUT) * len(kept)):
            return None
        model = SquareModel(places[kept], grey[kept], size_m, start, blur_m, stretch_std)
        solved = model.solved(x)
        if solved is None:
            return None
        x, omega, covariance, influence, inside = solved
        by_ground = np.zeros((2, len(places)))
        by_ground[:, kept] = influence
        left = everything.fitting(x, kept)
        if np.array_equal(left, kept):
            break
        kept = left
    assert x is not None  # noqa: S101 - said to the type checker
    spread = float(np.sum((model.grey - model.grey.mean()) ** 2))
    return SquareFit(
        place=x[:2],
        covariance=covariance,
        by_ground=by_ground,
        inside_covariance=inside,
        agreement=1.0 - omega / max(spread, 1e-300),
        rms=float(np.sqrt(omega / len(model.grey))),
        contrast=float(x[FIXED + 3] - x[FIXED]),
        stretch=float(np.abs(x[3:6]).max()),
        turn_rad=float(x[6]),
    )


@dataclass(frozen=True, eq=False)
class SquareModel:
    """Brightness of pixels by place, blur, stretches and turn of a square, and planes of brightness out- and inside."""

    places: Vectors2
    grey: Scalars
    size_m: float
    start: Array
    blur_m: float
    stretch_std: float

    @property
    def _ground(self) -> Array:
        return np.column_stack([np.ones(len(self.places)), (self.places - self.start[:2]) / self.size_m])

    @property
    def _known(self) -> Array:
        """Standard deviations of what is known before: blur and stretches."""
        return np.array([KNOWN_BLUR, *[self.stretch_std] * 3])

    def first(self) -> Array:
        """Give start values: those of the ground by linear least squares."""
        start = np.concatenate([self.start[:2], [np.log(self.blur_m), 0.0, 0.0, 0.0, self.start[2]]])
        share, _ = self.share(start)
        design = np.column_stack([self._ground * (1.0 - share)[:, None], self._ground * share[:, None]])
        return np.concatenate([start, np.linalg.lstsq(design, self.grey, rcond=1e-9)[0]])

    def share(self, x: Array) -> tuple[Scalars, Array]:
        """Give the share (n,) of the square in each pixel and its derivatives (n, 7)."""
        stretch = np.array([[1.0 + x[3], x[5]], [x[5], 1.0 + x[4]]])
        offset = self.places - x[:2]
        value, by_own = SpotShape(TargetKind.RETRO_SQUARE, self.size_m, 0.0).picture(offset @ stretch, x[2], x[6:7])
        first, second = by_own[:, 0], by_own[:, 1]
        return value, np.column_stack([
            -by_own[:, :2] @ stretch, by_own[:, 2], first * offset[:, 0], second * offset[:, 1],
            first * offset[:, 1] + second * offset[:, 0], by_own[:, 3],
        ])  # fmt: skip

    def brightness(self, x: Array) -> tuple[Scalars, Array]:
        """Give the brightness (n,) and its derivatives (n, 13)."""
        share, by_shape = self.share(x)
        ground = self._ground
        outside, inside = ground @ x[FIXED : FIXED + 3], ground @ x[FIXED + 3 :]
        derivatives = [(inside - outside)[:, None] * by_shape, ground * (1.0 - share)[:, None], ground * share[:, None]]
        return outside * (1.0 - share) + inside * share, np.column_stack(derivatives)

    def fitting(self, x: Array, kept: Flags) -> Flags:
        """Tell which pixels (n,) fit, or lie so near to the contour that they must."""
        misfits = np.abs(self.grey - self.brightness(x)[0])
        share, _ = self.share(x)
        limit = OUTLYING * max(1.4826 * float(np.median(misfits[kept])), 1.0)
        return np.asarray((misfits < limit) | ((share > SURE) & (share < 1.0 - SURE)))

    def solved(self, begin: Array | None) -> tuple[Array, float, Array, Array, Array] | None:
        """Give the solution, its sum of squares, and the covariance (2, 2) of the place; its derivatives (2, n) by the
        ground, and its covariance by all else; None where it runs away.
        """
        first = self.first()
        x = first if begin is None else begin
        n, noise = len(self.grey), max(float(np.std(self.grey)), 1.0)
        prior = np.zeros((4, len(first)))
        # what is known before weighs against the noise, which the first fit tells
        for _ in range(2):
            prior[np.arange(4), np.arange(2, 6)] = noise / self._known

            def model(y: Array, prior: Array = prior) -> tuple[Scalars, Array]:
                value, derivatives = self.brightness(y)
                return np.append(value - self.grey, prior @ (y - first)), np.vstack([derivatives, prior])

            fitted = damped_fit(model, x, most_evaluations=40, x_tolerance=1e-6)
            x = fitted.solution
            if not np.all(np.isfinite(x)) or float(np.linalg.norm(x[:2] - self.start[:2])) > self.size_m:
                return None
            misfits = fitted.residuals[:n]
            noise = max(float(np.sqrt(np.sum(misfits**2) / max(n - len(x), 1))), 0.3)
        design = fitted.jacobian
        gain = gain_of(design)
        parts = np.vstack([error_parts(design[:n], gain[:n], misfits), noise * gain[n:]])
        # what is not the square's own (joints of bricks, shadows) is not independent from pixel to pixel
        together = np.vstack([self._by_blocks(parts[:n]), parts[n:]])
        covariances = [(each.T @ each)[:2, :2] for each in (parts, together)]
        share, _ = self.share(x)
        inside = parts[:, :2] * np.append(share, np.ones(4))[:, None]
        by_ground = gain[:n, :2].T * (1.0 - share)
        return x, float(np.sum(misfits**2)), np.asarray(max(covariances, key=np.trace)), by_ground, inside.T @ inside

    def _by_blocks(self, rows: Array) -> Array:
        """Add up what belongs to pixels (n, k) that lie in one block of some blurs' width."""
        cells = np.floor(self.places / (BLOCK * self.blur_m)).astype(np.int64)
        _, block = numbered_rows(cells)
        return np.stack([np.bincount(block, column) for column in rows.T], axis=1)
