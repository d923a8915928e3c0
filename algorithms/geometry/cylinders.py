"""Cylinders with uncertainty: an axis line and a radius."""

from dataclasses import dataclass

from algorithms.arrays import Flags, Indices, Scalars
from algorithms.geometry.lines import Lines


@dataclass(frozen=True, eq=False)
class Cylinders:
    """n cylinders in one frame, column by column."""

    axes: Lines
    """n axis lines; source CYLINDER_AXIS, parents (own number, -1)."""
    radii_m: Scalars
    """(n,) radii [m]."""
    radius_std_m: Scalars
    """(n,) standard deviations of the radii [m]."""
    convex: Flags
    """(n,) True when seen from outside (a pipe), False from inside (a tunnel)."""
    arcs_rad: Scalars
    """(n,) seen part of the circumference [rad]."""
    noise_std_m: Scalars
    """(n,) standard deviation of single points from the surface [m]."""
    point_counts: Indices
    """(n,) number of points."""

    def __len__(self) -> int:
        return len(self.radii_m)
