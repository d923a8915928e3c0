"""Iterative closest points by approximants of the squared distance."""

from dataclasses import dataclass, field
from typing import ClassVar, final

from algorithms.registration.icp_options import ApproximantOptions
from algorithms.registration.method import ProposingMethod


@final
@dataclass(frozen=True)
class IcpD2Method(ProposingMethod):
    """Quadratic approximants of the squared distance from the surface, minimised in turns (Hofer and Pottmann 2004).

    Between point to point and point to plane by distance and curvature; each step is the helical motion of a velocity
    field. Cells of space keep the nearest surface (d2-tree): none is searched twice. Only points near the other surface
    take part, large distances count less, and every iteration is recorded. The service estimates from there on; what
    the method says itself stands beside.
    """

    name: ClassVar[str] = "icp-d2"
    work: ClassVar[str] = "algorithms.registration.icp_registration:register_by_approximants"

    iteration: ApproximantOptions = field(default_factory=ApproximantOptions)
    """The method's own iteration."""
