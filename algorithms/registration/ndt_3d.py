"""The normal distributions transform in space, for scanners in any attitude."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, final

from annotated_types import Ge, Gt, Le

from algorithms.registration.icp_options import IcpStart
from algorithms.registration.method import ProposingMethod


@dataclass(frozen=True)
class CellOptions:
    """Cells, and where to start."""

    coarsest_cell_m: Annotated[float, Gt(0.01), Le(1000.0)] = 8.0
    """Edge of the largest cells [m]."""
    finest_cell_m: Annotated[float, Gt(0.01), Le(100.0)] = 0.5
    """Edge of the smallest cells [m]."""
    steps: Annotated[int, Ge(1), Le(20)] = 5
    """So many sizes from the largest to the smallest."""
    start: IcpStart = IcpStart.MATCHING
    """Where it starts; picked points are not known here."""
    beside_rad: Annotated[float, Ge(0.0), Le(1.6)] = 0.35
    """Starts turned by so much about each axis, to either side, are followed as well [rad]."""
    beside_m: Annotated[float, Ge(0.0), Le(100.0)] = 2.0
    """Likewise starts shifted by so much along each axis [m]."""


@final
@dataclass(frozen=True)
class Ndt3dMethod(ProposingMethod):
    """Normal distributions in cubic cells of both scans propose the pose, also of tilted scanners.

    Distribution to distribution (Stoyanov, Magnusson, Andreasson and Lilienthal 2012), climbed from large cells to
    small ones by Newton's method with the analytic gradient and Hessian. Beyond the paper, starts beside the
    start are followed too, the target's cells overlap by halves so that cells do not catch in each other, and the
    surfaces choose between the best answers. The service estimates from there on.
    """

    name: ClassVar[str] = "ndt-3d"
    work: ClassVar[str] = "algorithms.registration.ndt_3d_registration:register_by_cells"

    cells: CellOptions = field(default_factory=CellOptions)
    """The method's own search."""
