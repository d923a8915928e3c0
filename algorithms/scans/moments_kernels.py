"""The one accumulator of points: count, sums of coordinates, sums of their products; inlined into compiled loops.

The sums are a tuple (n, x, y, z, xx, xy, xz, yy, yz, zz), which stays in registers while a loop runs.
"""

from numba import njit

from algorithms.arrays import Array

Sums = tuple[float, float, float, float, float, float, float, float, float, float]
NOTHING: Sums = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""The sums of no point."""


@njit(cache=True, nogil=True, inline="always")
def with_point(sums: Sums, x: float, y: float, z: float) -> Sums:
    """Give the sums with one more point; coordinates about an origin near the points, or digits are lost."""
    return (
        sums[0] + 1.0,
        sums[1] + x,
        sums[2] + y,
        sums[3] + z,
        sums[4] + x * x,
        sums[5] + x * y,
        sums[6] + x * z,
        sums[7] + y * y,
        sums[8] + y * z,
        sums[9] + z * z,
    )


@njit(cache=True, nogil=True, inline="always")
def write_central(sums: Sums, ox: float, oy: float, oz: float, out: Array) -> None:
    """Write count, mean and central sums of products (10,) of points whose sums are about the origin o."""
    n = sums[0]
    x = sums[1] / n
    y = sums[2] / n
    z = sums[3] / n
    out[0] = n
    out[1] = x + ox
    out[2] = y + oy
    out[3] = z + oz
    out[4] = sums[4] - n * x * x
    out[5] = sums[5] - n * x * y
    out[6] = sums[6] - n * x * z
    out[7] = sums[7] - n * y * y
    out[8] = sums[8] - n * y * z
    out[9] = sums[9] - n * z * z
