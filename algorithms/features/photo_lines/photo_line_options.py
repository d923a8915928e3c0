"""Options of lines from photos; light to import, because the web process describes them."""

from dataclasses import dataclass, field

from algorithms.features.photo_lines.projection_options import ProjectionOptions
from algorithms.photos.options import EdgeOptions


@dataclass(frozen=True)
class PhotoLineOptions:
    """Which edges of photos become lines in space."""

    edges: EdgeOptions = field(default_factory=EdgeOptions)
    """What counts as a straight edge in a photo."""
    projection: ProjectionOptions = field(default_factory=ProjectionOptions)
    """Which points beside an edge are used, and which lines are good enough."""
