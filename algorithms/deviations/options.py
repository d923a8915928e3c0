"""Options of comparisons of surfaces."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from annotated_types import Interval, Len

from algorithms.errors import InvalidInputError

Radius = Annotated[float, Interval(gt=0.0, le=1000.0)]


class Average(StrEnum):
    """How the points of a cylinder are averaged."""

    MEAN = "mean"
    MEDIAN = "median"


class WavesOf(StrEnum):
    """Where the errors that neighbouring points share are measured."""

    SCENE = "scene"
    NEIGHBOURHOODS = "neighbourhoods"


@dataclass(frozen=True)
class M3C2Options:
    """Distances along local normals between two clouds: sizes and levels."""

    cylinder_radius_m: Radius = 0.05
    """Radius of the cylinder whose points are averaged; half the projection scale d [m]."""
    max_distance_m: Radius = 0.5
    """Length of the cylinder to either side of the core point: larger deviations are not seen [m]."""
    normal_radii_m: Annotated[tuple[Radius, ...], Len(1, 10)] = (0.25,)
    """Radii of the spheres in which normals are found, half the normal scale D; of several the most plane one [m]."""
    average: Average = Average.MEAN
    """mean, or median with interquartile range."""
    alpha: Annotated[float, Interval(gt=0.0, lt=1.0)] = 0.05
    """Share of unchanged core points that may be called changed."""
    waviness_std_m: Annotated[float, Interval(ge=0.0, le=1.0)] | None = None
    """Standard deviation of errors that the points of a cylinder share; null: measured on the clouds [m]."""
    waves: WavesOf = WavesOf.SCENE
    """Where it is measured: scene, which sees waves of all lengths where at most two fifths of the surface changed; or
    neighbourhoods, where all of it may have changed smoothly, but long waves remain unseen."""

    def __post_init__(self) -> None:
        """Refuse sizes that make no cylinder.

        Raises
        ------
        InvalidInputError
            If a length is not positive or the level is not between 0 and 1.
        """
        lengths = (self.cylinder_radius_m, self.max_distance_m, *self.normal_radii_m)
        if not self.normal_radii_m or not all(0.0 < length < float("inf") for length in lengths):
            raise InvalidInputError("comparison", "radii and distances must be positive lengths")
        if not 0.0 < self.alpha < 1.0:
            raise InvalidInputError("comparison", f"alpha is {self.alpha}", "between 0 and 1")
        if self.waviness_std_m is not None and not 0.0 <= self.waviness_std_m < float("inf"):
            raise InvalidInputError("comparison", "the waviness must be a length")


@dataclass(frozen=True)
class RasterOptions:
    """Comparison of both surfaces as heights on a grid, with maps of what each is worth."""

    cell_m: Radius | None = None
    """Edge of a cell; null: such that one holds four points on average [m]."""
    unit_cells: Annotated[int, Interval(ge=1, le=1000)] = 5
    """Cells along the edge of an analysis unit, for which density and residuals are counted."""
    alpha: Annotated[float, Interval(gt=0.0, lt=1.0)] = 0.01
    """Level of the test for patterns in the difference."""
