"""Measured points with their uncertainty: targets, tie points, points of a scan."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Matrices3, Points


@dataclass(frozen=True, eq=False)
class PointSet:
    """n points and their covariances."""

    coordinates: Points
    """(n, 3) [m]."""
    covariances: Matrices3
    """(n, 3, 3) [m²]."""

    def __len__(self) -> int:
        return len(self.coordinates)

    def __getitem__(self, which: Array) -> "PointSet":
        return PointSet(self.coordinates[which], self.covariances[which])

    @staticmethod
    def with_std(coordinates: Points, std_m: float) -> "PointSet":
        """Give points whose coordinates all have the same standard deviation.

        Parameters
        ----------
        coordinates
            (n, 3) [m].
        std_m
            Of each coordinate.
        """
        return PointSet(coordinates, np.tile(std_m**2 * np.eye(3), (len(coordinates), 1, 1)))
