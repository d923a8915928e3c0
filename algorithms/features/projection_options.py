"""Options of the way from edges of photos to lines in space; light to import, because the web process describes them."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le


@dataclass(frozen=True)
class ProjectionOptions:
    """Which points beside an edge are used, and which lines are good enough."""

    band_px: Annotated[float, Gt(0.0), Le(1000.0)] = 40.0
    """Points up to this distance from the edge make the plane beside it, measured in the photo [px]."""
    band_m: Annotated[float, Gt(0.0), Le(10.0)] = 0.5
    """The same limit across the line of sight, in space [m]; the smaller of both counts."""
    gap_px: Annotated[float, Ge(0.0), Le(50.0)] = 2.0
    """Points nearer to the edge are not used: beams that hit both sides measure neither [px]."""
    min_points: Annotated[int, Ge(4)] = 12
    """Least number of points of a plane beside an edge."""
    min_length_px: Annotated[float, Ge(0.0)] = 20.0
    """Shorter edges are left out [px]."""
    min_length_m: Annotated[float, Ge(0.0)] = 0.15
    """Shorter lines are left out [m]."""
    min_angle_gon: Annotated[float, Gt(0.0), Le(100.0)] = 15.0
    """Least angle between the plane through the projection centre and the surface's plane [gon]."""
    max_std_m: Annotated[float, Gt(0.0)] = 0.03
    """Lines less certain across themselves at one of their ends are left out [m]."""
