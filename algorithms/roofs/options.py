"""What counts as a roof; light to import, because the web process describes it."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le


@dataclass(frozen=True)
class RoofOptions:
    """How roof planes are found over a ground plan."""

    neighbourhood_m: Annotated[float, Gt(0.0), Le(20.0)] = 1.0
    """Radius of the small neighbourhoods, seen from above, in which planes are fitted [m]; a few spacings of points."""
    noise_m: Annotated[float, Gt(0.0), Le(1.0)] = 0.03
    """Least standard deviation of heights about a roof plane [m]; the points tell more, up to four times this."""
    steepest_deg: Annotated[float, Gt(0.0), Le(80.0)] = 60.0
    """Steeper planes are walls [degree]."""
    least_area_m2: Annotated[float, Gt(0.0), Le(10_000.0)] = 2.0
    """Smaller faces are not modelled [m²]."""
    least_height_m: Annotated[float, Ge(0.0), Le(100.0)] = 2.0
    """Points less above the ground are no roof [m]."""
