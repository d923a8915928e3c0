"""Result of the process `roofs`."""

from typing import Literal

from pydantic import Field

from schemas.results.posed_result import PosedDocument
from schemas.results.registration_result import Artifact
from schemas.values.poses import Document


class RoofFace(Document):
    """One face of a roof, z = a x + b y + c."""

    slope_deg: float
    """Of the face against the horizontal [degree]."""
    azimuth_gon: float | None
    """Direction in which water runs off, from north (+y) clockwise [gon]; null: it is level to 0.1 degree."""
    area_m2: float
    """Of the face itself, not of its plan; 0 where all of it went to other faces [m²]."""
    points_before: int
    """Points that its cluster of small planes took."""
    points_after: int
    """Points that lie in it."""
    rms_m: float
    """Of the height differences of these [m]."""


class ModelledBuilding(Document):
    """One building."""

    name: str
    """Of the plan; of plans that were found `building-1` and so on, the largest first."""
    corners_m: list[tuple[float, float]]
    """x, y of the plan's corners, world [m]."""
    points: int
    """Points over the plan and above the ground."""
    ground_m: float | None
    """Height of the ground [m]; null: it could not be modelled."""
    faces: list[RoofFace]
    """Those with most neighbourhoods first."""
    share_without_face: float
    """Share of the points that lie in no face, 0..1: chimneys, dormers that are too small, vegetation."""
    status: Literal["modelled", "incomplete", "not-modelled"]
    """`incomplete`: points speak against the volume, or much of the roof has no face or no points, see `reason`."""
    rms_m: float | None = None
    """Of the points' heights above the modelled roof, without those in no face [m]; null: it could not be modelled."""
    largest_gap_m: float | None = None
    """Radius of the largest circle about a place of the plan without points of the roof [m]."""
    unseen_share: float | None = None
    """Share of the plan that lies farther than `neighbourhood_m` from any point of the roof, 0..1."""
    misfit_m3: float | None = None
    """What the points enclose more than the building does [m³]."""
    misfit_std_m3: float | None = None
    """Its standard deviation, by the scatter of the points and by the height of the ground [m³]."""
    watertight: bool
    """Whether its polygons bound a body."""
    volume_m3: float | None
    """What they enclose, above the ground [m³]; null: not watertight. Right only where `status` is `modelled`."""
    reason: str | None
    """Why it could not be modelled, or what is incomplete; null: nothing speaks against it."""


class RoofsDocument(PosedDocument):
    """Buildings with their roofs."""

    buildings: list[ModelledBuilding]
    """In the order of the plans."""
    remarks: list[str] = Field(default=[])
    """Points that take no part, with their number and the reason."""
    building_models: list[Artifact] | None = Field(default=None, exclude_if=lambda value: value is None)
    """The file, where it was wanted."""
