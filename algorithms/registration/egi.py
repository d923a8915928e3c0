"""Extended Gaussian images: the rotation from directions of surfaces alone."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated, ClassVar, final

from annotated_types import Ge, Gt, Le

from algorithms.registration.method import ProposingMethod


class TurnAxes(StrEnum):
    """About which axes the images are turned."""

    ALL = "all"
    """All three: scanners may lean."""
    VERTICAL = "vertical"
    """The z axis alone, as in the paper: both scanners are levelled, but for small tilts that their walls tell."""


@dataclass(frozen=True)
class SphereOptions:
    """How finely the sphere is divided, and how many answers are followed."""

    axes: TurnAxes = TurnAxes.ALL
    """About which axes the images are turned."""
    finest_level: Annotated[int, Ge(3), Le(6)] = 6
    """The icosahedron is divided so many times: 5 gives cells of 2.2, 6 of 1.1 degrees."""
    max_peaks: Annotated[int, Ge(1), Le(100)] = 24
    """So many distinct rotations of highest correlation are completed with a shift and compared."""
    ambiguity_ratio: Annotated[float, Gt(0.0), Le(1.0)] = 0.9
    """Other rotations with so much of the best correlation are reported as ambiguous."""


@final
@dataclass(frozen=True)
class EgiMethod(ProposingMethod):
    """Extended Gaussian images propose the rotation (Horn 1984; Dold, Ripperda and Brenner 2007).

    The planes' normals, weighed by area, are mapped to a divided icosahedron; the correlation of two such spheres is
    searched coarse to fine. Beyond the paper, the lost shift is completed from the offsets of parallel planes, of all
    rotations of high correlation the one in which surface lies on surface is taken, and planes that agree there make
    the pose finer than the cells. The service estimates from
    there on; what the method says itself stands beside.
    """

    name: ClassVar[str] = "egi"
    work: ClassVar[str] = "algorithms.registration.egi_registration:register_by_spheres"

    sphere: SphereOptions = field(default_factory=SphereOptions)
    """The method's own search."""
