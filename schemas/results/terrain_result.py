"""Result document of the process `terrain`."""

from typing import Any

from pydantic import Field

from schemas.results.posed_result import PosedDocument
from schemas.results.registration_result import Artifact
from schemas.values.poses import Document


class HeightFigures(Document):
    """A model of heights in figures."""

    name: str
    """dtm, dsm or ndsm, where wanted canopy and stand-height; its file is of that name, with `-metres` behind it where
    the coordinates were in another unit."""
    lowest_m: float
    """Least height [m]."""
    mean_m: float
    """Mean [m]."""
    highest_m: float
    """Largest height [m]."""


class ComparedFilter(Document):
    """What another filter calls ground."""

    name: str
    """The filter, with its usual options."""
    ground: int | None
    """Points on the ground; null: it found none, see `reason`."""
    kappa: float | None
    """Cohen's kappa with the chosen filter: 1 where they agree, 0 where as by chance."""
    only_here: int | None
    """Points that it calls ground and the chosen filter does not."""
    only_chosen: int | None
    """Points that the chosen filter calls ground and it does not."""
    seconds: float
    """How long it took [s]."""
    reason: str | None = None
    """Why it found no ground."""


class GroundResiduals(Document):
    """Heights of the ground points above the terrain."""

    rms_m: float
    """Root mean square [m]."""
    share_within_10_cm: float
    """Share of ground points within 10 cm of the terrain, 0..1."""
    expected_std_m: float | None
    """Median of the expected standard deviations of the terrain's heights [m]; null: not known anywhere."""
    unknown_share: float
    """Share of the cells in which too few ground points are near for an expected standard deviation, 0..1."""


class TerrainDocument(PosedDocument):
    """Which points lie on the ground, and the models made of them."""

    points: int
    """Points of all stations."""
    ground: int
    """Points on the ground."""
    objects: int
    """Points on anything else."""
    low: int
    """Points far below the ground."""
    filter: dict[str, Any]
    """The filter, with the options used."""
    cell_m: float
    """Edge of the cells [m]."""
    rows: int
    """Of the models, along y."""
    columns: int
    """Of the models, along x."""
    no_data_share: float = 0.0
    """Share of the cells without terrain, in gaps wider than `gap_m` and `covered_m`, 0..1."""
    models: list[HeightFigures]
    """Terrain, surface, and heights of objects above the terrain."""
    residuals: GroundResiduals
    """How near the ground points are to the terrain."""
    compared: list[ComparedFilter]
    """Other filters beside the chosen one."""
    remarks: list[str]
    """What a reader should know."""
    artifacts: list[Artifact]
    """Models as ESRI ASCII grids, pictures, drawings."""
    classified: list[Artifact] | None = Field(default=None, exclude_if=lambda value: value is None)
    """The file of points with classes, where it was wanted."""
