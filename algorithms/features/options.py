"""Options of feature extraction; light to import, because the web process describes them."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le


@dataclass(frozen=True)
class FeatureOptions:
    """What counts as a feature."""

    point_std_m: Annotated[float, Ge(1e-6), Le(1.0)] | None = None
    """Standard deviation of single points across a surface that faces the instrument [m]; null estimates it from the
    scan. It sets how far points of one surface may lie off it and widens the limits of matching; the covariances of
    planes and lines follow from the residuals of their own points in any case."""
    voxel_size_m: Annotated[float, Gt(0.0), Le(10.0)] | None = None
    """Edge length of the cells that unstructured scans are cut into [m]; null chooses it from the point spacing."""
    min_plane_points: Annotated[int, Ge(10)] = 30
    """Least number of points of a plane."""
    min_plane_area_m2: Annotated[float, Ge(0.0)] = 0.02
    """Least area of a plane [m2]."""
    max_planes: Annotated[int, Ge(3), Le(5000)] = 600
    """At most so many planes are kept, those of the most points."""
    min_line_length_m: Annotated[float, Gt(0.0)] = 0.3
    """Least length of the piece along which two planes meet [m]."""
    min_cylinder_radius_m: Annotated[float, Gt(0.0)] = 0.02
    """Least radius of a cylinder [m]."""
    max_cylinder_radius_m: Annotated[float, Gt(0.0), Le(20.0)] = 5.0
    """Largest radius of a cylinder [m]; whatever is allowed here, the arc that is seen must tell the radius."""
