"""Registration by surfaces alone: point to plane in both directions, from the answer of the search."""

from dataclasses import dataclass, field
from typing import ClassVar, final

from algorithms.adjustment.options import AdjustmentOptions
from algorithms.registration.method import Method
from algorithms.registration.surface_options import SurfaceOptions


@final
@dataclass(frozen=True)
class IcpPlaneMethod(Method):
    """Surfaces alone, robustly laid on each other point to plane (Chen and Medioni 1992), from the search's answer.

    The covariance comes from the misfits, those of a neighbourhood counted as one. Lines and planes serve the search
    only.
    """

    name: ClassVar[str] = "icp-plane"
    work: ClassVar[str] = "algorithms.registration.auto_registration:register_by_surfaces"

    surfaces: SurfaceOptions = field(default_factory=SurfaceOptions)
    """The estimate."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """Of three and more stations together; a pair does not use it."""
