"""The normal distributions transform in horizontal slices, for levelled scanners."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, final

from annotated_types import Ge, Gt, Le

from algorithms.registration.method import ProposingMethod


@dataclass(frozen=True)
class LayerOptions:
    """Slices and cells, as Dold, Ripperda and Brenner (2007) chose them, and where to start."""

    heights_m: tuple[float, ...] = (0.0, 4.5, 9.0, 13.5)
    """Middles of the slices above the instrument [m]."""
    thickness_m: Annotated[float, Gt(0.0), Le(10.0)] = 0.6
    """Of each slice [m]; the paper does not give it."""
    coarsest_cell_m: Annotated[float, Gt(0.1), Le(10_000.0)] = 250.0
    """Edge of the largest cells [m]."""
    finest_cell_m: Annotated[float, Gt(0.1), Le(100.0)] = 2.0
    """Edge of the smallest cells [m]."""
    steps: Annotated[int, Ge(1), Le(20)] = 8
    """So many sizes from the largest to the smallest."""
    headings: Annotated[int, Ge(1), Le(360)] = 24
    """So many headings, evenly spread over the circle, are starts."""
    reach_m: Annotated[float, Ge(0.0), Le(1000.0)] = 40.0
    """As far apart the instruments are looked for in cells of middle size [m]."""
    levelled_std_rad: Annotated[float, Gt(0.0), Le(0.2)] = 0.001
    """How well the scanners are levelled once their walls are made vertical (standard deviation) [rad]: what the method
    claims of the tilts."""


@final
@dataclass(frozen=True)
class NdtMethod(ProposingMethod):
    """Normal distributions in horizontal slices propose the pose of levelled scanners (Dold et al. 2007).

    Biber and Strasser's score (2003), summed over the slices, is climbed from the largest cells to the smallest. Beyond
    the paper, many headings and shifts are tried, the cells of four grids overlap, the step is Newton's with the
    analytic Hessian, walls tell small tilts of the scanners, the height comes from what lies flat, and the surfaces
    choose between the best answers. The service estimates from there on; what the method says itself stands beside.
    Scanners that lean by more than some degrees are beyond it.
    """

    name: ClassVar[str] = "ndt"
    work: ClassVar[str] = "algorithms.registration.ndt_registration:register_by_layers"

    layers: LayerOptions = field(default_factory=LayerOptions)
    """The method's own search."""
