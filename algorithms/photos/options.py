"""Options of the edge detection in photos; light to import, because the web process describes them."""

from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

from annotated_types import Ge, Gt, Le

EdgeDetector: TypeAlias = Literal["edge-chains", "lsd", "canny-hough", "canny-hough-probabilistic", "segment-growing"]
"""Ways from the grey values to first straight pieces; all are refined in the same way."""
EdgeLocalisation: TypeAlias = Literal["arctan", "gaussian", "area"]
"""Ways to find the edge in a profile across it."""


@dataclass(frozen=True)
class EdgeOptions:
    """What counts as a straight edge in a photo."""

    detector: EdgeDetector = "edge-chains"
    """Way to the first straight pieces: linked edge pixels cut where they bend, OpenCV's line segment detector, the
    Hough transform of the Canny edges (complete or probabilistic), or Schneider's half circles."""
    localisation: EdgeLocalisation = "gaussian"
    """How the edge is placed in the grey values across it: fit of a step blurred by a Gaussian (the most exact in our
    measurements), fit of an arctan, or equal areas."""
    smoothing_px: Annotated[float, Ge(0.0), Le(10.0)] = 1.0
    """Standard deviation of the Gaussian that smooths the photo before edges are looked for; positions are measured in
    the unsmoothed photo [px]."""
    high_threshold: Annotated[float, Gt(0.0)] | None = None
    """Gradient magnitude (4.1) from which a pixel starts an edge [grey levels/px]; null derives it from the noise."""
    low_threshold: Annotated[float, Gt(0.0)] | None = None
    """Gradient magnitude (4.1) down to which an edge is followed [grey levels/px]; null takes half the high one."""
    min_length_px: Annotated[float, Ge(5.0)] = 20.0
    """Least length of an edge [px]."""
    min_contrast: Annotated[float, Gt(0.0), Le(255.0)] = 5.0
    """Least difference of the grey values on both sides [grey levels]."""
    max_gap_px: Annotated[float, Ge(0.0), Le(100.0)] = 8.0
    """Pieces of one line no further apart than this become one edge [px]."""
    max_segments: Annotated[int, Ge(1), Le(100_000)] = 20_000
    """At most so many edges are kept, the longest."""
