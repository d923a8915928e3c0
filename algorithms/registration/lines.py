"""Registration by lines (Lichtenstein 2011), completed: no first guess, rigorous covariance, honest refusal."""

from dataclasses import dataclass
from typing import ClassVar, final

from algorithms.registration.method import Method


@final
@dataclass(frozen=True)
class LinesMethod(Method):
    """Lines from plane intersections and cylinder axes, with the planes they lie in."""

    name: ClassVar[str] = "lines"
    work: ClassVar[str] = "algorithms.registration.line_registration:register_by_lines"

    planes: bool = True
    """Also use the planes that both scans see as observations, beside the lines."""
