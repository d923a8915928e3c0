"""Result of the process `colour`."""

from pydantic import Field

from schemas.results.posed_result import PosedDocument
from schemas.results.registration_result import Artifact
from schemas.values.poses import Document


class PhotoFigures(Document):
    """What one photo gave."""

    station: str
    """Where it was taken."""
    name: str
    """Of its file, and number in it."""
    shown: int
    """Points that it shows."""
    shared: int
    """Points of a sample that other photos show as well."""
    rms: float | None
    """Root mean square difference of its balanced colours from the blended ones, at shared points [grey levels];
    null where none are shared."""
    gain: tuple[float, float, float]
    """How many times as bright it is as the mean of all photos: red, green, blue."""


class PhotoTurnFigures(Document):
    """A photo, or all photos of a station, that is turned against what the photos from elsewhere show."""

    station: str
    """Where they were taken."""
    photos: list[str]
    """Names of the photos that turn together."""
    turn_mrad: tuple[float, float, float]
    """Rotation vector in the camera's axes (x right, y down, z forward) that leads from the stated camera axes to those
    that the colours ask for [mrad]."""
    turn_std_mrad: tuple[float, float, float]
    """Standard deviations of its components [mrad]."""
    shift_px: float
    """By so much it moves the photo [px]."""
    statistic: float
    """Of the test that there is no turn."""
    critical: float
    """Limit of the test, chi-square with 3 degrees of freedom."""


class ColouringDocument(PosedDocument):
    """How the points got their colours."""

    points: int
    """Points of all stations."""
    coloured: int
    """Points that a photo shows; the others are black."""
    photos: list[PhotoFigures]
    """Every photo."""
    fall_off: tuple[float, float, float]
    """Brightness in the corners of the photos over that in the middle: red, green, blue."""
    turned: list[PhotoTurnFigures]
    """Photos and mounts that the others contradict; the colours are blended with the poses as they were stated."""
    remarks: list[str]
    """What could not be done, and why."""
    coloured_cloud: list[Artifact] | None = Field(default=None, exclude_if=lambda value: value is None)
    """The file, where it was wanted."""
