"""Options of the search for mounts; light to import, because the web process describes them."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le


@dataclass(frozen=True)
class EdgeCalibrationOptions:
    """How mounts are looked for."""

    max_rotation_gon: Annotated[float, Gt(0.0), Le(3.0)] = 0.6
    """Largest error of the stated rotation about each axis of the camera that is looked for [gon]."""
    max_translation_m: Annotated[float, Gt(0.0), Le(0.5)] = 0.05
    """Largest error of each coordinate of the projection centre that is looked for [m]."""
    rounding_std_m: Annotated[float, Ge(0.0), Le(0.1)] = 0.003
    """How far real edges lie from where their planes meet, being broken, plastered or rounded: standard deviation [m];
    what the gaps between lines and edges contradict is enlarged."""
