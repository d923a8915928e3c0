"""Result of the process `clean`."""

from pydantic import Field

from schemas.results.cleaning_figures import CleaningStep, SmoothingPassFigures
from schemas.results.posed_result import PosedDocument
from schemas.results.registration_result import Artifact


class CleaningDocument(PosedDocument):
    """What was taken away, step by step, and the points that are left."""

    points_before: int
    """Points of all stations."""
    points_after: int
    """Points that are left."""
    steps: list[CleaningStep]
    """In the order in which they were taken."""
    smoothing: list[SmoothingPassFigures]
    """The passes of the smoothing; empty without it."""
    remarks: list[str]
    """What could not be done, and why."""
    cleaned: list[Artifact] | None = Field(default=None, exclude_if=lambda value: value is None)
    """The file, where it was wanted."""
