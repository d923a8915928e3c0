"""Result of the process `roofs`."""

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
    watertight: bool
    """Whether its polygons bound a body."""
    volume_m3: float | None
    """What they enclose, above the ground [m³]; null: they are not watertight."""
    reason: str | None
    """Why it could not be modelled; null: it could."""


class RoofsDocument(PosedDocument):
    """Buildings with their roofs."""

    buildings: list[ModelledBuilding]
    """In the order of the plans."""
    remarks: list[str] = Field(default=[])
    """Points that take no part, with their number and the reason."""
    building_models: list[Artifact] | None = Field(default=None, exclude_if=lambda value: value is None)
    """The file, where it was wanted."""
