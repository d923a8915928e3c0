"""Result document of the process `drainage`."""

from schemas.results.posed_result import PosedDocument
from schemas.results.registration_result import Artifact
from schemas.values.poses import Document


class TerrainLine(Document):
    """A line of the drawing."""

    kind: str
    """valley, ridge or hollow-path."""
    length_m: float
    """In plan [m]."""
    catchment_m2: float | None
    """From which water runs to its end [m²]; null: of paths between hollows."""
    lowest_m: float
    """Least height [m]."""
    highest_m: float
    """Largest height [m]."""


class HollowFigures(Document):
    """A region without outflow until it is full."""

    x_m: float
    """Of its deepest cell, world [m]."""
    y_m: float
    """Of its deepest cell, world [m]."""
    bottom_m: float
    """Height of that [m]."""
    rim_m: float
    """Height of the lowest point of its rim [m]."""
    area_m2: float
    """Under water when it is full [m²]."""
    volume_m3: float
    """Of the water then [m³]."""


class DrainageDocument(PosedDocument):
    """Where water runs on a terrain, and the lines that follow from it."""

    points: int
    """Points of all stations."""
    ground: int
    """Points that make the terrain."""
    cell_m: float
    """Edge of the cells [m]."""
    rows: int
    """Of the cells, along y."""
    columns: int
    """Of the cells, along x."""
    mean_slope_deg: float
    """Mean of the steepest slopes of the cells [degrees]."""
    largest_catchment_m2: float
    """From which water runs to one cell [m²]."""
    lines: list[TerrainLine]
    """Valleys, ridges and paths between hollows, as in the drawings."""
    hollow_count: int
    """Hollows of the terrain."""
    hollows: list[HollowFigures]
    """The largest of them by volume, at most 1000."""
    remarks: list[str]
    """What a reader should know."""
    artifacts: list[Artifact]
    """Grids, pictures and drawings."""
