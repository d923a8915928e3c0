"""Simulated terrain seen from above: hills, houses, trees."""

import numpy as np

from algorithms.arrays import Flags, Points, Scalars

SIDE_M = 100.0


def hill_heights(x: Scalars, y: Scalars) -> Scalars:
    """Give a terrain with slopes up to about one in four, (n,) [m]."""
    return 5.0 * np.sin(x / 25.0) + 4.0 * np.cos(y / 30.0) + 0.05 * x


def hills_with_houses(density: float = 2.0, seed: int = 4) -> tuple[Points, Flags]:
    """Scan hills with three houses and thirty trees; give points (n, 3) [m] and which lie on the ground."""
    rng = np.random.default_rng(seed)
    n = int(density * SIDE_M**2)
    x, y = rng.uniform(0.0, SIDE_M, (2, n))
    z = hill_heights(x, y)
    ground = np.ones(n, dtype=np.bool_)
    for left, below, width, depth in ((20.0, 20.0, 12.0, 10.0), (55.0, 30.0, 18.0, 14.0), (30.0, 65.0, 10.0, 20.0)):
        roof = (x > left) & (x < left + width) & (y > below) & (y < below + depth)
        z[roof] = hill_heights(np.array([left + width / 2]), np.array([below + depth / 2]))[0] + 7.0
        ground &= ~roof
    for centre in rng.uniform(5.0, SIDE_M - 5.0, (30, 2)):
        crown = ground & (np.hypot(x - centre[0], y - centre[1]) < 2.5) & (rng.random(n) < 0.7)
        z[crown] += rng.uniform(2.0, 8.0, int(crown.sum()))
        ground &= ~crown
    return np.column_stack([x, y, z + rng.normal(0.0, 0.03, n)]), ground
