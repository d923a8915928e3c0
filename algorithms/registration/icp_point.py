"""Iterative closest points, point to point."""

from dataclasses import dataclass, field
from typing import ClassVar, final

from algorithms.registration.icp_options import IcpOptions
from algorithms.registration.method import ProposingMethod


@final
@dataclass(frozen=True)
class IcpPointMethod(ProposingMethod):
    """Closest points, and the closed-form motion that lays them on each other, in turns (Besl and McKay 1992).

    For comparison: `icp-plane` needs a few steps where this one needs tens. Only points near the other surface take
    part, large distances count less, and every iteration is recorded. The service estimates from there on; what the
    method says itself stands beside.
    """

    name: ClassVar[str] = "icp-point"
    work: ClassVar[str] = "algorithms.registration.icp_registration:register_point_to_point"

    iteration: IcpOptions = field(default_factory=IcpOptions)
    """The method's own iteration."""
