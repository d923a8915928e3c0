"""Where control is missing: corners of the block, cross strips or chains of heights at its ends (Kager 2003, 4)."""

from collections.abc import Sequence

import numpy as np

from algorithms.arrays import Array, OtherPoints, Points, Vector3
from algorithms.strips.strip import StripPath

NEAR = 0.3
"""Share of the block's length and width that counts as its corner or end."""
CHAIN = 3
"""Known heights at an end of the block that stand for a cross strip."""
CROSS = np.cos(np.pi / 4.0)
"""Strips at a larger angle to the others are cross strips."""


def missing_control(paths: Sequence[StripPath], ties_m: Points, control_m: OtherPoints, origin_m: Vector3) -> list[str]:
    """Name the corners without control and the ends without cross strip.

    Parameters
    ----------
    paths
        Of the strips.
    ties_m
        (k, 3) where patches tie the strips, in the frame of the paths [m].
    control_m
        (m, 3) where control takes part, likewise [m].
    origin_m
        Of that frame, for the words [m].
    """
    if len(ties_m) == 0:
        return []
    ahead = np.stack([path.axes[:2, 0] for path in paths])
    # directions to and fro are one: doubled angles
    doubled = np.stack([ahead[:, 0] ** 2 - ahead[:, 1] ** 2, 2.0 * ahead[:, 0] * ahead[:, 1]], axis=1)
    lengths = np.array([np.hypot(*(path.centres_m[-1, :2] - path.centres_m[0, :2])) for path in paths])
    weights = lengths * np.array([int((doubled @ each > 0.0).sum()) for each in doubled])
    main = ahead[int(np.argmax(weights))]
    axes = np.array([main, [-main[1], main[0]]])
    low, high = (side(ties_m[:, :2] @ axes.T, axis=0) for side in (np.min, np.max))
    known = (control_m[:, :2] @ axes.T - low) / np.maximum(high - low, 1e-9)
    crossing = np.flatnonzero(np.abs(ahead @ main) < CROSS)
    words = []
    for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)):
        if not (np.abs(known - [u, v]) <= NEAR).all(axis=1).any():
            x, y = (low + (high - low) * [u, v]) @ axes + origin_m[:2]
            words.append(f"no control near the corner of the block at x {x:.0f}, y {y:.0f}: add a control plane there")
    if len(paths) - len(crossing) < 2:
        return words
    for u in (0, 1):
        crossed = any(_lies_at(paths[k], axes, low, high, u) for k in crossing.tolist())
        if not crossed and int((np.abs(known[:, 0] - u) <= NEAR).sum()) < CHAIN:
            x, y = (low + (high - low) * [u, 0.5]) @ axes + origin_m[:2]
            words.append(
                f"no cross strip at the end of the block near x {x:.0f}, y {y:.0f}: fly one, or measure a chain of "
                f"{CHAIN} heights or more across it"
            )
    return words


def _lies_at(path: StripPath, axes: Array, low: Array, high: Array, u: int) -> bool:
    along = float((path.centres_m[:, :2].mean(axis=0) @ axes.T)[0])
    return bool(abs((along - low[0]) / max(float(high[0] - low[0]), 1e-9) - u) <= NEAR)
