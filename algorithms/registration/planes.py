"""Registration by planes alone: what is left where a scan shows no lines that can be relied on."""

from dataclasses import dataclass
from typing import ClassVar, final

from algorithms.registration.method import Method


@final
@dataclass(frozen=True)
class PlanesMethod(Method):
    """Planes that both scans see, rigorously adjusted. The search uses lines too; the pose rests on planes alone."""

    name: ClassVar[str] = "planes"
    work: ClassVar[str] = "algorithms.registration.line_registration:register_by_planes"
