"""Result of the process `clean`."""

from pydantic import Field

from schemas.poses import Document
from schemas.registration_result import Artifact


class CleaningStep(Document):
    """What one step did to one station."""

    step: str
    """Name of the option that asked for it."""
    station: str
    """Of which the points are."""
    before: int
    """Points before the step."""
    removed: int
    """Points that it left out."""
    marked: int
    """Points that it marked and kept."""
    after: int
    """Points that were left."""


class SmoothingPassFigures(Document):
    """What one pass of the smoothing did."""

    number: int
    """From 1."""
    largest_mm: float
    """Largest movement of a point [mm]."""
    mean_mm: float
    """Mean movement [mm]."""
    std_mm: float
    """Standard deviation of the movements [mm]."""
    removed: int
    """Points left out afterwards as outliers."""
    remaining: int
    """Points that were left."""


class CleaningDocument(Document):
    """What was taken away, step by step, and the points that are left."""

    points_before: int
    """Points of all stations."""
    points_after: int
    """Points that are left."""
    steps: list[CleaningStep]
    """In the order in which they were taken."""
    smoothing: list[SmoothingPassFigures]
    """The passes of the smoothing; empty without it."""
    left_out: dict[str, str]
    """Stations without a pose, by name, and why they have none."""
    remarks: list[str]
    """What could not be done, and why."""
    cleaned: list[Artifact] | None = Field(default=None, exclude_if=lambda value: value is None)
    """The file, where it was wanted."""
