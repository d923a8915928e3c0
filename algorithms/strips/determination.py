"""What patches determine, what only the observations of zero hold, and what to add (Kager 2003; MATH 12.3).

Nothing singular is left: every coefficient is observed as zero. So the question is not whether the normal matrix has an
inverse, but whose word a value rests on.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Matrix6, Points, Scalars, Vector3
from algorithms.probabilities import chi2_isf
from algorithms.strips.adjustment import Adjusted
from algorithms.strips.block import positive_solution
from algorithms.strips.corrections import BORESIGHT, MOUNT
from algorithms.strips.strip import Strip

HELD = 0.5
"""A coefficient is held by its observation of zero where the data tell less than that share of it."""
FAMILY_ALPHA = 0.01
"""Probability with which of strips in order any coefficient at all is called significant."""
FREE = 0.5
"""Variance of a common motion over that of the observations of zero, from which it is called not determined."""
SWINGS = 3.0
"""A polynomial oscillates when without observations of zero it would correct by so many times more."""
LEAST_SWING_M = 0.05
"""Smaller corrections are no oscillation that anybody would mind [m]."""
WEAK = 1e-6
"""Share of the observations of zero that stays when one asks what would be without them."""
SAMPLES = 100
"""Points of each strip in which its correction is looked at."""


@dataclass(frozen=True)
class Coefficient:
    """One number that corrects a strip, or all of them."""

    strip: int | None
    """None: of the bore-sight, or of what strips without trajectories have in common."""
    parameter: str
    power: int
    """Of time, which runs from -1 to 1."""
    value: float
    """To be added to what the strip says [m, rad]."""
    std: float
    zero_std: float
    """Standard deviation of its observation of zero."""
    observed_as_zero: bool
    """False: the data contradict that observation, and it was given up."""
    data_share: float
    """Share of it that the data tell, 0..1; the rest is the word of its observation of zero."""
    statistic: float
    """Square of the value over its standard deviation, both without its own observation of zero."""
    critical: float

    @property
    def held(self) -> bool:
        """Whether it rests mainly on its observation of zero."""
        return self.data_share < HELD

    @property
    def significant(self) -> bool:
        """Whether it is not zero."""
        return not self.held and self.statistic > self.critical


@dataclass(frozen=True)
class CommonMotion:
    """A motion of the whole block."""

    name: str
    """Shift along x, y or z, turn about x, y or z."""
    std: float
    """Standard deviation, the block taken for a rigid body that control holds [m, rad]."""
    zero_std: float
    """The same by the observations of zero alone."""
    advice: str
    """What to add where it is not determined."""

    @property
    def determined(self) -> bool:
        """Whether control tells more of it than the observations of zero."""
        return self.std**2 < FREE * self.zero_std**2


@dataclass(frozen=True)
class Oscillation:
    """A polynomial that would swing where no patches hold it."""

    strip: int
    powers: tuple[int, ...]
    """Of time, whose coefficients are held."""
    largest_m: float
    """Correction at most [m]."""
    without_m: float
    """The same without observations of zero [m]."""


@dataclass(frozen=True, eq=False)
class Determination:
    """Whose word the corrections rest on."""

    coefficients: tuple[Coefficient, ...]
    motions: tuple[CommonMotion, ...]
    oscillations: tuple[Oscillation, ...]
    point_std_m: Float64[Array, "strips"]
    """(strips,) largest standard deviation of the correction of a point of each strip [m]."""
    axis_stds_m: Float64[Array, "strips 3"]
    """(strips, 3) standard deviations along x, y, z, root of the mean square over points of each strip [m]."""
    largest_m: Float64[Array, "strips"]
    """(strips,) largest correction of a point of each strip [m]."""


ADVICE = {
    "shift along x": "inclined control planes, such as roofs, at least three that face different ways",
    "shift along y": "inclined control planes, such as roofs, at least three that face different ways",
    "shift along z": "a height control point or level control plane",
    "turn about x": "height control in the corners of the block",
    "turn about y": "height control in the corners of the block",
    "turn about z": "inclined control planes at both ends of the block",
}


def determination_of(adjusted: Adjusted, strips: Sequence[Strip]) -> Determination:
    """Ask of every coefficient and of the block's common motions what the data tell.

    Parameters
    ----------
    adjusted
        The block.
    strips
        Its strips, in the same order.
    """
    samples = [_Sample.of(adjusted, number, strip) for number, strip in enumerate(strips)]
    own = adjusted.block.degrees.count
    without = _without_zeros(adjusted)
    oscillations, largest, stds, axes = [], [], [], []
    for number, sample in enumerate(samples):
        part = slice(number * own, (number + 1) * own)
        values, free = adjusted.block.vector(adjusted.state)[part], without[part]
        now, then = (float(np.linalg.norm(sample.own(adjusted) @ each, axis=1).max()) for each in (values, free))
        largest.append(sample.largest_m)
        by_axes = sample.stds_m(adjusted)
        stds.append(float(np.linalg.norm(by_axes, axis=1).max()))
        axes.append(np.sqrt((by_axes**2).mean(axis=0)))
        if then > SWINGS * max(now, LEAST_SWING_M):
            oscillations.append(Oscillation(number, _held_powers(adjusted, number), now, then))
    return Determination(
        coefficients_of(adjusted), _motions(adjusted, samples), tuple(oscillations), np.array(stds), np.array(axes),
        np.array(largest),
    )  # fmt: skip


def coefficients_of(adjusted: Adjusted) -> tuple[Coefficient, ...]:
    """Describe and test every coefficient, without its own observation of zero and with those of the others.

    With variance s² and the observation's t² the rest of the block tells I = 1/s² − 1/t², and the value p without it
    is x / (s² I); T = p² I is chi-square with one degree of freedom, all of them together at 1 % (Šidák).
    """
    block = adjusted.block
    count = block.before_waves
    values, variances = block.whole_vector(adjusted.state)[:count], np.diag(adjusted.whole_cofactors)[:count]
    weights, zero_stds = (
        np.concatenate(parts)
        for parts in ((adjusted.zero_weights, adjusted.mount_stds**-2.0), (adjusted.zero_stds, adjusted.mount_stds))
    )
    critical = float(chi2_isf(1.0 - (1.0 - FAMILY_ALPHA) ** (1.0 / max(count, 1)), 1))
    names: list[tuple[int | None, str, int]] = [
        (strip, name, power) for strip in range(len(block.paths)) for name, power in block.degrees.names()
    ]
    if block.with_boresight:
        names += [(None, name, 0) for name in BORESIGHT]
    if block.with_mount:
        names += [(None, name, 0) for name in MOUNT]
    found = []
    for k, (strip, name, power) in enumerate(names):
        tells = max(1.0 / variances[k] - weights[k], 0.0)
        share = float(tells * variances[k]) if weights[k] else _alone(adjusted, k, variances[k])
        statistic = float((values[k] / variances[k]) ** 2 / tells) if tells * variances[k] > 1e-9 else 0.0
        found.append(
            Coefficient(
                strip=strip,
                parameter=name,
                power=power,
                value=float(values[k]),
                std=float(np.sqrt(variances[k])),
                zero_std=float(zero_stds[k]),
                observed_as_zero=bool(weights[k] > 0.0),
                data_share=share,
                statistic=statistic,
                critical=critical,
            )
        )
    return tuple(found)


def _alone(adjusted: Adjusted, k: int, variance: float) -> float:
    """Give the share that the data would tell beside an observation of zero that was given up."""
    return float(1.0 - variance / (variance + adjusted.zero_stds[k] ** 2))


@dataclass(frozen=True, eq=False)
class _Sample:
    """Some points of a strip, and how all unknowns move them."""

    number: int
    points: Points
    """(n, 3) [m]."""
    times_s: Scalars
    design: Float64[Array, "n 3 c"]
    """By the unknowns of `Block.columns_of`."""
    largest_m: float

    @staticmethod
    def of(adjusted: Adjusted, number: int, strip: Strip) -> "_Sample":
        """Take points all over a strip."""
        chosen = np.linspace(0, len(strip.points) - 1, min(SAMPLES, len(strip.points))).astype(np.int64)
        points, times = strip.points[chosen], strip.times_s[chosen]
        moved = adjusted.block.correction(adjusted.state, number).applied(points, times) - points
        design = adjusted.block.design(adjusted.state, number, points, times)
        return _Sample(number, points, times, design, float(np.linalg.norm(moved, axis=1).max()))

    def own(self, adjusted: Adjusted) -> Float64[Array, "n 3 c"]:
        """Return how the coefficients of the strip move the points."""
        return self.design[:, :, : adjusted.block.degrees.count]

    def stds_m(self, adjusted: Adjusted) -> Points:
        """Return standard deviations of the corrections of the points along x, y, z (n, 3)."""
        which = adjusted.block.columns_of(self.number)
        covariance = adjusted.whole_cofactors[np.ix_(which, which)]
        return np.asarray(np.sqrt(np.einsum("nic,cd,nid->ni", self.design, covariance, self.design)))


def _without_zeros(adjusted: Adjusted) -> Float64[Array, "u"]:
    """Give what the unknowns would be without those observations of zero that keep polynomials from swinging.

    They are those of powers above the first; a trace of them stays, so that the equations are regular.
    """
    block, values = adjusted.block, adjusted.block.vector(adjusted.state)
    right = (adjusted.data_normal + np.diag(adjusted.zero_weights)) @ values
    powers = np.array([power for _, power in block.degrees.names()] * len(block.paths) + [0] * 3 * block.with_boresight)
    weights = np.where(powers > 1, WEAK * adjusted.zero_stds**-2, adjusted.zero_weights)
    return positive_solution(adjusted.data_normal + np.diag(weights), right)


def _held_powers(adjusted: Adjusted, strip: int) -> tuple[int, ...]:
    held = {each.power for each in coefficients_of(adjusted) if each.strip == strip and each.held}
    return tuple(sorted(power for power in held if power > 1))


def _motions(adjusted: Adjusted, samples: Sequence[_Sample]) -> tuple[CommonMotion, ...]:
    """Ask what control tells of the motions of the block as a rigid body, which ties do not see."""
    points = np.concatenate([sample.points for sample in samples])
    middle = points.mean(axis=0)
    own, weights = adjusted.block.degrees.count, adjusted.zero_weights
    weights = np.where(weights > 0.0, weights, adjusted.zero_stds**-2)
    realised = np.zeros((adjusted.block.stated, 6))
    for sample in samples:
        part = slice(sample.number * own, (sample.number + 1) * own)
        scale = weights[part] ** -0.5
        fields = _rigid(sample.points - middle).reshape(-1, 6)
        realised[part] = (
            scale[:, None] * np.linalg.lstsq(sample.own(adjusted).reshape(-1, own) * scale, fields, rcond=1e-6)[0]
        )
    by_zeros = realised.T @ (weights[:, None] * realised)
    variances, alone = (np.diag(np.linalg.pinv(each)) for each in (by_zeros + _by_control(adjusted, middle), by_zeros))
    return tuple(
        CommonMotion(name, float(np.sqrt(variances[k])), float(np.sqrt(alone[k])), ADVICE[name])
        for k, name in enumerate(ADVICE)
    )


def _rigid(arms: Points) -> Float64[Array, "n 3 6"]:
    """Give the displacements by unit shifts along and turns about the axes."""
    turns = np.stack([np.cross(axis, arms) for axis in np.eye(3)], axis=2)
    return np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=2)


def _by_control(adjusted: Adjusted, middle: Vector3) -> Matrix6:
    """Give the information of control, whose patches strips that take part see, on the motions of a rigid block."""
    block = adjusted.block
    known, ties = block.control, block.ties
    seen = np.bincount(ties.patches[adjusted.used], ties.std_m[adjusted.used] ** -2, len(block.references_m))
    which = adjusted.control_used & (seen[known.patches] > 0.0)
    normals = block.frames[known.patches[which]][:, :, 2]
    variances = ((normals * known.std_m[which]) ** 2).sum(axis=1) + 1.0 / seen[known.patches[which]]
    rows = np.einsum("mi,mik->mk", normals, _rigid(known.points_m[which] - middle))
    return np.asarray(rows.T @ (rows / (adjusted.variance_factor * variances)[:, None]))
