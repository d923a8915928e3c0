"""What cleaning took away, step by step."""

from schemas.values.poses import Document


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
