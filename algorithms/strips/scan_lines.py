"""The rows of a strip in the order of time, and where they lie: time and nadir angle tell (Kager 2003, 2.2)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from algorithms.arrays import Array, Indices, Scalars
from algorithms.strips.patch_kernels import line_numbers
from algorithms.strips.strip import Strip

HYSTERESIS, JUMP = 0.1, 0.5
"""Shares of the swath: the mirror turns back by more than the first; less than the second at once is no new line."""


@dataclass(frozen=True, eq=False)
class ScanLines:
    """Which row of the row buffer each point belongs to."""

    lines: Indices
    """(n,) number of each point's scan line, ascending."""
    along_m: Float64[Array, "rows"]
    """(rows,) where each line lies along the flight [m]."""
    looks_back: Bool[Array, "rows"]
    """(rows,) lines that lie behind one before them, when the aircraft pitches: they are in no patch candidate."""
    across_m: Scalars
    """(n,) distance of each point to the left of the path [m]."""

    @property
    def count(self) -> int:
        """Number of lines."""
        return len(self.along_m)


def scan_lines(strip: Strip) -> ScanLines:
    """Divide a strip into its scan lines.

    The nadir angle, or where no trajectory tells it the distance across, runs monotonously within a line; it turns
    back at the end of the lines of an oscillating mirror and jumps back at those of a turning one. Drop-outs do no
    harm: no matrix is filled. O(n).
    """
    path = strip.path
    steps = np.diff(path.centres_m[:, :2], axis=0)
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])
    forward = steps / np.maximum(np.hypot(*steps.T), 1e-9)[:, None]
    middles = 0.5 * (path.nodes_s[1:] + path.nodes_s[:-1])
    # heading over a second or so: single steps of a dense trajectory are noise
    fx, fy = (np.interp(strip.times_s, middles, _smoothed(forward[:, k])) for k in range(2))
    norm = np.hypot(fx, fy)
    fx, fy = fx / norm, fy / norm
    arms = strip.points - path.centres(strip.times_s)
    across = -fy * arms[:, 0] + fx * arms[:, 1]
    angle = across if path.bodies is None else np.arctan2(across, -arms[:, 2])
    low, high = np.quantile(angle[:: max(1, len(angle) // 20_000)], [0.01, 0.99])
    lines = line_numbers(angle, HYSTERESIS * float(high - low), JUMP * float(high - low))
    counts = np.bincount(lines)
    along = np.interp(strip.times_s, path.nodes_s, lengths) + fx * arms[:, 0] + fy * arms[:, 1]
    means = np.bincount(lines, along) / counts
    return ScanLines(lines, means, means < np.maximum.accumulate(means), across)


def _smoothed(values: Scalars) -> Scalars:
    width = max(1, len(values) // 200)
    kernel = np.ones(2 * width + 1)
    return np.convolve(values, kernel, "same") / np.convolve(np.ones(len(values)), kernel, "same")
