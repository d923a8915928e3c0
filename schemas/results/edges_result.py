"""Result document of the process `detect-edges`."""

from typing import Any

from pydantic import Field

from schemas.results.registration_result import Artifact
from schemas.values.poses import Document

Pixel = tuple[float, float]


class DetectedEdge(Document):
    """A straight edge of a photo with its uncertainty.

    Pixels are (column, row), (0, 0) at the centre of the top-left pixel. Ideal pixels are those of the same camera
    without lens distortion; where no distortion is known they are the photo's own.
    """

    name: str
    """E1, E2, …"""
    start_px: Pixel = Field(description="Ideal pixels; the brighter side is on the right, seen from start to end.")
    end_px: Pixel = Field(description="Ideal pixels.")
    raw_start_px: Pixel = Field(description="In the photo as taken.")
    raw_end_px: Pixel = Field(description="In the photo as taken.")
    centre_px: Pixel = Field(description="Point of the edge where angle and offset are uncorrelated, ideal pixels.")
    direction: Pixel = Field(description="Unit vector from start to end.")
    length_px: float
    """Length [px]."""
    covariance: tuple[Pixel, Pixel] = Field(
        description="2x2 of angle (rad) and offset across the edge at its centre (px), towards the brighter side."
    )
    angle_std_gon: float
    """Standard deviation of its direction [gon]."""
    offset_std_px: float
    """Standard deviation across it, at its centre [px]."""
    contrast: float = Field(description="Difference of the grey values on both sides, of 0 to 255.")
    blur_px: float = Field(description="Standard deviation of the edge's blur, the pixel's own size included.")
    points: int = Field(description="Edge points in the line fit.")


class EdgeCount(Document):
    """How many edges there are, and what they add up to."""

    edges: int
    """Number of edges."""
    truncated: bool = Field(
        description="Whether these are as many as `max_segments` allows: shorter ones may be left out."
    )
    total_length_px: float
    """Sum of their lengths [px]."""
    median_offset_std_px: float | None = Field(description="Null: there are no edges.")
    median_angle_std_gon: float | None
    """Median of the standard deviations of direction [gon]; null: there are no edges."""


class DetectedPhoto(Document):
    """The photo that was looked at."""

    file: str
    """Identifier of the file."""
    index: int
    """Number in the file, from 0."""
    name: str
    """What the file calls it."""
    width: int
    """Columns [px]."""
    height: int
    """Rows [px]."""
    camera: dict[str, Any] | None = Field(
        description="Interior orientation whose distortion was removed, from the request or the file; null: none."
    )


class EdgesProvenance(Document):
    """What was done with what."""

    software: str
    """Program and version."""
    edges: dict[str, Any] = Field(description="All options as used.")
    sha256: str = Field(description="Of the photo's file.")
    timings_s: dict[str, float]
    """How long each part took, by name [s]."""


class EdgesDocument(Document):
    """Answer of `detect-edges`."""

    photo: DetectedPhoto
    """The photo that was looked at."""
    counts: EdgeCount
    """How many edges there are."""
    edges: list[DetectedEdge] = Field(description="The longest first.")
    artifacts: list[Artifact]
    """Files that can be downloaded."""
    provenance: EdgesProvenance
    """What was done with what."""
