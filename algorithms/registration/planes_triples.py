"""The symbolic matching of planes by Dold and Brenner, for comparison and as a search of its own."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, final

from annotated_types import Ge, Gt, Le

from algorithms.registration.method import ProposingMethod


@dataclass(frozen=True)
class TripleOptions:
    """How triples of planes are laid on each other; the paper gives the number of planes only."""

    max_planes: Annotated[int, Ge(3), Le(100)] = 50
    """So many planes of each scan take part, the largest: most points lie on what is near."""
    max_triples: Annotated[int, Ge(1), Le(20_000)] = 6000
    """So many triples of each scan are tried, those of the largest triple product: three planes that stand square to
    each other have 1."""
    least_product: Annotated[float, Gt(0.0), Le(1.0)] = 0.3
    """Triples with a smaller triple product fix no pose."""
    max_cosine_difference: Annotated[float, Gt(0.0), Le(0.2)] = 0.02
    """Angles between the planes of two triples that differ by more, as cosines, are not those of the same planes."""
    max_angle_rad: Annotated[float, Gt(0.0), Le(0.5)] = 0.02
    """Planes agree when their normals differ by less [rad]."""
    max_distance_m: Annotated[float, Gt(0.0), Le(2.0)] = 0.15
    """And when the middle of one lies no farther from the other [m]."""
    max_gap_m: Annotated[float, Ge(0.0), Le(10_000.0)] = 20.0
    """And when they are no farther apart from rim to rim: two scans see two pieces of one street [m]."""
    max_shift_m: Annotated[float, Gt(0.0), Le(10_000.0)] = 200.0
    """The middles of the scans are no farther apart [m]."""
    max_poses: Annotated[int, Ge(1), Le(20_000_000)] = 1_500_000
    """So many poses are counted at most."""


@final
@dataclass(frozen=True)
class PlanesTriplesMethod(ProposingMethod):
    """Triples of planes propose the pose (Dold, Ripperda and Brenner 2007): the one in which most planes agree.

    Triples of both scans are laid on each other, the most orthogonal ones first; the pose comes from the quaternion of
    the normals and least squares. Beyond the paper, planes agree only where they come near each other, and of the best
    poses the one in which most surface lies on surface is taken. The service estimates from there on; what the method
    says itself stands beside.
    """

    name: ClassVar[str] = "planes-triples"
    work: ClassVar[str] = "algorithms.registration.triples_registration:register_by_triples"

    triples: TripleOptions = field(default_factory=TripleOptions)
    """The method's own search."""
