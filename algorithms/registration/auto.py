"""Registration by whatever two scans have: lines, planes and surfaces together, and what falls back on what."""

from dataclasses import dataclass, field
from typing import ClassVar, final

from algorithms.registration.method import Method
from algorithms.registration.surface_options import SurfaceOptions


@final
@dataclass(frozen=True)
class AutoMethod(Method):
    """Lines, planes and surfaces together; where they contradict each other or are too few, planes or surfaces alone.

    The result says which estimator gave the pose, and why.
    """

    name: ClassVar[str] = "auto"
    work: ClassVar[str] = "algorithms.registration.auto_registration:register_automatically"

    surfaces: SurfaceOptions = field(default_factory=SurfaceOptions)
    """The estimate by surfaces."""
