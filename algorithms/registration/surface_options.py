"""Options of the estimate by surfaces; light to import, because the web process describes them."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le


@dataclass(frozen=True)
class SurfaceOptions:
    """Which surfaces correspond, and what counts as one observation."""

    max_distance_m: Annotated[float, Gt(0.0), Le(10.0)] = 0.2
    """Largest distance of corresponding surfaces in the first round [m]; it narrows to six standard deviations of the
    distances found."""
    max_angle_rad: Annotated[float, Gt(0.0), Le(1.5)] = 0.35
    """Largest angle between the normals of corresponding surfaces [rad]."""
    neighbourhood_m: Annotated[float, Gt(0.0), Le(100.0)] = 0.5
    """Misfits within a cube of this edge always count as one observation [m]; of larger ones (up to 32 times) where
    that enlarges the covariance."""
    max_iterations: Annotated[int, Ge(1), Le(1000)] = 50
    """Limit of rounds."""
