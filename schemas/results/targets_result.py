"""Result document of the process `find-targets`."""

from typing import Any

from pydantic import Field

from schemas.results.registration_result import Artifact
from schemas.values.poses import Document

Vector = tuple[float, float, float]


class TargetDocument(Document):
    """A target that was found."""

    name: str
    """Its name in the list, or T1, T2, … where it has none there."""
    named: bool
    """Whether it was recognised in the list."""
    kind: str
    """`sphere`, `board`, `retro-square` or `retro-cylinder`."""
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
    naming: NamingDocument
    """How names were given."""
    artifacts: list[Artifact]
    """Files that can be downloaded."""
    provenance: TargetsProvenance
    """What was done with what."""
