"""What a bright spot is the blurred picture of: a square in its plane, or an upright cylinder seen in perspective."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from algorithms.arrays import Array, Scalars, Vectors2
from algorithms.targets.options import TargetKind

STRIPS = 9
"""Of each half of a cylinder, of equal angles: narrow where its brightness falls."""
LEAN_STD_RAD = 0.03
"""How upright a cylinder stands in the scanner's frame, or a scanner that is set up by eye: towards it and across."""
LID_STD = 0.01
"""Brightness of a cylinder's lid or base beyond that of what is around, relative to its foil's."""
LAMBERT = 1.0
"""A foil's brightness falls with a power of the cosine of incidence that is fitted; it begins as paper's does."""
KNOWN_BEFORE = 0.7
"""Standard deviation of what is known before of the blur's logarithm and of the power."""


@dataclass(frozen=True)
class SpotShape:
    """What the intensities are the blurred picture of."""

    kind: TargetKind
    size_m: float
    slope: float
    """Rise of the beam over its horizontal length."""
    range_m: float = np.inf
    """Horizontal distance of a cylinder's axis: what lies before it is seen larger."""

    @property
    def begins(self) -> Scalars:
        """Give what the shape's own parameters are before anything is seen."""
        return np.zeros(1) if self.kind is TargetKind.RETRO_SQUARE else np.array([LAMBERT, 0.0, 0.0, 0.0])

    @property
    def stds(self) -> Scalars:
        """Give the standard deviations with which the blur's logarithm and the shape's own are known before."""
        if self.kind is TargetKind.RETRO_SQUARE:
            return np.array([KNOWN_BEFORE])
        return np.array([KNOWN_BEFORE, KNOWN_BEFORE, LEAN_STD_RAD, LID_STD, LEAN_STD_RAD])

    def picture(self, offset: Vectors2, log_blur: float, own: Array) -> tuple[Scalars, Array]:
        """Give the brightness (n,), 0..1, at places (n, 2) about the centre, and its derivatives (n, 3 + k): by the
        place, by the logarithm of the blur, by the shape's own.

        Its own is the turn of a square; of a cylinder the power of the cosine of incidence with which its foil shines,
        how it leans towards the instrument, how bright its lid or base is that the foil does not hide, and how it leans
        across.
        """
        blur = np.sqrt(2.0) * float(np.exp(np.clip(log_blur, -20.0, 5.0)))
        half = 0.5 * self.size_m
        turn = float(own[-1])
        axes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        turned = offset @ axes
        if self.kind is TargetKind.RETRO_CYLINDER:
            value, moved, others = self._cylinder(turned, blur, half, own)
        else:
            first, by_first, first_blur = _bar(turned[:, 0], -half, half, blur)
            other, by_other, other_blur = _bar(turned[:, 1], -half, half, blur)
            value = first * other
            moved = np.stack([by_first * other, first * by_other], axis=1)
            others = (first_blur * other + first * other_blur)[:, None]
        by_turn = moved[:, 0] * turned[:, 1] - moved[:, 1] * turned[:, 0]
        return value, np.column_stack([moved @ axes.T, others, by_turn])

    def _cylinder(self, offset: Vectors2, blur: float, half: float, own: Array) -> tuple[Scalars, Array, Array]:
        """Give upright strips, each as high above its place at the axis as a sloping beam meets it before, and the lid
        or base between there and as far behind; their derivatives by the place (n, 2), and (n, 4) by blur, power, lean
        and lid.

        Two strips at equal angles left and right have one height and one brightness.
        """
        angles = np.linspace(0.0, 0.5 * np.pi, STRIPS + 1)
        cosines = np.cos(0.5 * (angles[1:] + angles[:-1]))
        brightness = cosines ** np.clip(own[0], -5.0, 20.0)
        sides = half * np.sin(angles) / (1.0 - half * np.cos(angles) / self.range_m)
        edges = np.concatenate([-sides[::-1], sides])
        strip, by_side, strip_blur = (_pairs(below) for below in _edge(offset[:, :1], edges, blur))
        slope, depths = self.slope + own[1], half * cosines
        larger, smaller = (1.0 / (1.0 - sign * depths / self.range_m) for sign in (1.0, -1.0))
        low, high = (_edge(offset[:, 1:], larger * (end + depths * slope), blur) for end in (-half, half))
        part, by_height, part_blur = (below - above for below, above in zip(low, high, strict=True))
        # seen from above it is the lid, from below the base
        before, end = (high, half) if slope < 0.0 else (low, -half)
        behind = _edge(offset[:, 1:], smaller * (end - depths * slope), blur)
        disc, by_disc, disc_blur = (np.sign(slope) * (far - near) for far, near in zip(behind, before, strict=True))
        column = part * brightness + own[2] * disc
        by_column, column_blur = by_height * brightness + own[2] * by_disc, part_blur * brightness + own[2] * disc_blur
        moved = np.stack([np.sum(by_side * column, axis=1), np.sum(strip * by_column, axis=1)], axis=1)
        turned = np.sign(slope) * (smaller * behind[1] + larger * before[1])
        by_lean = -depths * (larger * by_height * brightness - own[2] * turned)
        others = [strip_blur * column + strip * column_blur, strip * part * (brightness * np.log(cosines))]
        others += [strip * by_lean, strip * disc]
        whole = np.sum(strip * column, axis=1)
        return whole, moved, np.stack([np.sum(each, axis=1) for each in others], axis=1)


def _pairs(below: Array) -> Array:
    """Give the differences (n, k) between the bounds of strips, from the middle outwards, left and right added.

    Parameters
    ----------
    below
        (n, 2 k + 2) at the bounds from left to right, the middle twice.
    """
    strips = below[:, :-1] - below[:, 1:]
    k = strips.shape[1] // 2
    return np.asarray(strips[:, k + 1 :] + strips[:, k - 1 :: -1])


def _edge(place: Array, at: Array | float, blur: float) -> tuple[Array, Array, Array]:
    """Give a blurred step, -0.5 to 0.5, and its derivatives by the place and by the logarithm of the blur."""
    distance = (place - at) / blur
    rise = np.exp(-(distance**2)) / np.sqrt(np.pi)
    return 0.5 * special.erf(distance), rise / blur, -distance * rise


def _bar(place: Array, low: float, high: float, blur: float) -> tuple[Array, ...]:
    """Give a blurred bar from low to high, and its derivatives by the place and by the logarithm of the blur."""
    return tuple(begin - end for begin, end in zip(_edge(place, low, blur), _edge(place, high, blur), strict=True))
