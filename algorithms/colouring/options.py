"""How points get their colours; light to import, because the web process describes it."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le


@dataclass(frozen=True)
class ColouringOptions:
    """How photos are blended."""

    balance: bool = True
    """Whether differences of exposure, white balance and light fall-off between the photos are taken out."""
    margin_m: Annotated[float, Ge(0.001), Le(10.0)] = 0.05
    """A point is hidden when something stands before it by more than this [m]; it must be larger than the errors of
    the poses and the noise."""
    steepest_deg: Annotated[float, Gt(0.0), Le(89.9)] = 82.0
    """Photos that see a surface at a larger angle from its normal do not colour it [degrees]."""
    angle_power: Annotated[float, Ge(0.0), Le(16.0)] = 2.0
    """The weight of a photo falls with the cosine of that angle to this power."""
    distance_power: Annotated[float, Ge(0.0), Le(16.0)] = 2.0
    """The weight of a photo falls with the size of its pixels on the surface to this power."""
    border: Annotated[float, Ge(0.0), Le(0.5)] = 0.08
    """Over this share of its width and height the weight of a photo rises from its border, so that no seams show."""
