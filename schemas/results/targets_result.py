"""Result document of the process `find-targets`."""

from typing import Any

from pydantic import Field

from schemas.results.registration_result import Artifact
from schemas.values.poses import Document

Vector = tuple[float, float, float]
Pair = tuple[float, float]


class TargetDocument(Document):
    """A target that was found."""

    name: str
    """Its name in the list, or T1, T2, … where it has none there."""
    named: bool
    """Whether it was recognised in the list."""
    kind: str
    """`sphere`, `board`, `retro-square` or `retro-cylinder`."""
    alternative: str | None = None
    """What the same bright spot may be as well, less probably; null: nothing else."""
    xyz_m: Vector
    """Centre in the scan's frame, as in the file [m]."""
    covariance_m2: tuple[Vector, Vector, Vector]
    """3x3 covariance of the centre [m²]."""
    std_m: Vector
    """Standard deviations of the coordinates [m]."""
    points: int
    """Measurements that it rests on."""
    incidence_gon: float
    """Angle between the beam and the target's normal; 0 for spheres and cylinders [gon]."""
    quality: float
    """How much speaks for it, 0 to 1: the smaller of coverage and agreement with the template."""
    coverage: float
    """Share of its visible surface that holds measurements, 0 to 1."""
    contrast: float
    """(bright - dark) / (bright + dark) of the intensities; 0 for spheres."""
    rms: float
    """Residuals: metres of spheres, share of the contrast of the others."""


class RejectedTarget(Document):
    """Something that looked like a target at first."""

    kind: str
    """What it was looked at as."""
    xyz_m: Vector
    """Where [m]."""
    reason: str
    """Why it is none."""


class PhotoTargetDocument(Document):
    """A target in a photo: the projection of its centre."""

    target: str
    """Its name among `targets`."""
    x_px: float
    """Column, 0 at the centre of the leftmost pixel [px]."""
    y_px: float
    """Row, 0 at the centre of the topmost pixel [px]."""
    covariance_px2: tuple[Pair, Pair]
    """2x2 covariance of the measurement in the photo alone [px²]."""
    std_px: float
    """Mean standard deviation of a coordinate [px]."""
    expected_px: Pair
    """Where scan, mount and camera have it [px]."""
    expected_covariance_px2: tuple[Pair, Pair]
    """2x2 covariance of that: target and mount [px²]; four standard deviations are the window that was searched."""
    statistic: float
    """Squared distance from there in standard deviations: chi-square with two degrees of freedom where all is well."""
    agreement: float
    """Share of the brightness's variance that the target explains, 0 to 1."""
    contrast: float
    """Bright minus dark [grey levels]."""


class UnseenTarget(Document):
    """A target that a photo should show and does not."""

    target: str
    """Its name among `targets`."""
    reason: str
    """Why it was not measured."""


class PhotoTargetsDocument(Document):
    """A photo of the station, and the targets in it."""

    name: str
    """Its file, and number there if it is not the first."""
    file: str
    """Id of the file."""
    index: int
    """Number of the photo in the file."""
    points: list[PhotoTargetDocument] = Field(description="Targets that were measured, in the order of `targets`.")
    not_seen: list[UnseenTarget] = Field(description="Targets within the photo that were not, each with its reason.")


class NamingDocument(Document):
    """How the found targets were recognised in the list."""

    status: str
    """`determined`, `not-determined`, or `not-asked`."""
    reason: str
    """How clear it is, or why it is not determined."""
    in_common: int
    """Number of targets recognised."""
    runner_up: int
    """How many points the best other assignment has in common."""


class TargetsProvenance(Document):
    """What was done with what."""

    software: str
    """Program and version."""
    kinds: list[dict[str, Any]]
    """What was looked for."""
    sha256: str
    """Of the scan's file."""
    timings_s: dict[str, float]
    """How long each part took, by name [s]."""


class TargetsDocument(Document):
    """Answer of `find-targets`."""

    station: str
    """Name of the station."""
    targets: list[TargetDocument] = Field(description="In the order of the kinds, the best first.")
    rejected: list[RejectedTarget] = Field(description="Candidates that are none, each with its reason.")
    photos: list[PhotoTargetsDocument] = Field(
        default=[], description="The photos of the station with the targets in them, in the order of the request."
    )
    naming: NamingDocument
    """How names were given."""
    remarks: list[str] = Field(default=[])
    """Points that take no part, with their number and the reason."""
    artifacts: list[Artifact]
    """Files that can be downloaded."""
    provenance: TargetsProvenance
    """What was done with what."""
