"""Registered scans as files: how they are asked for."""

from typing import Literal, Self

from pydantic import Field, model_validator

from schemas.requests.cleaning_steps import CleaningSteps
from schemas.requests.execution import FileOutputRequest
from schemas.values.base import RequestModel
from schemas.values.crs import StatedCrs


class RegisteredOptions(RequestModel):
    """Which files registered scans become."""

    format: Literal["e57", "laz", "copc", "ply", "pcd", "ptx", "pts", "xyz", "poses"] = "e57"
    """`e57`: the uploaded E57 file with new poses, points, images and all else byte for byte; from other formats, and
    with `merge` or `per_point_std`, a new E57 with poses and photos. `ptx`: points in the scanner's frame, poses in the
    headers. `laz` (1.4, steps of 0.1 mm), `copc`, `ply`, `pcd`, `pts`, `xyz`: points in the world frame. `poses`: no
    points, poses alone as CloudCompare 4×4, CSV, 3DTK, RiSCAN PRO and JSON with covariances."""
    merge: bool = False
    """One file with all stations; else one each, or of E57 one for each that was uploaded."""
    crs: StatedCrs | None = None
    """Coordinate reference system of the world frame, such as `EPSG:25832` or `EPSG:25832+7837`; it is written into the
    files that have a place for it. Null: not said. No coordinate is changed by it. Where the control of a registration
    is in a `crs`, points of `laz`, `copc`, `ply`, `pcd`, `pts` and `xyz` are written in it, point by point, and these
    files name it; the poses of the others are rigid and lead into the local frame of `control.system`."""
    per_point_std: bool = False
    """Whether each point gets the standard deviation of its position, `std_mm`: √(σx² + σy² + σz²) from the covariance
    of its station's pose at its distance, and the noise of its range. PTX and PTS have no place for it."""
    range_std_m: float | None = Field(default=None, ge=0.0, le=10.0)
    """Standard deviation of single ranges; null: that of each scan as its registration estimated it, where there is one
    [m]."""
    left_handed: bool = False
    """Of poses for RiSCAN PRO: whether the global system is north, east, height instead of east, north, height."""
    cleaning: CleaningSteps | None = None
    """What is left out of the points beforehand, as the process `clean` does it; null: nothing, not even the points
    between surfaces. All stations are read at once then. Not for `ptx`, whose rows and columns want every point, nor
    for `poses`."""

    @property
    def smooths(self) -> bool:
        """Whether points are moved by smoothing."""
        return self.cleaning is not None and self.cleaning.smoothing is not None

    @model_validator(mode="after")
    def _can_clean(self) -> Self:
        """Refuse to clean what has to keep every point."""
        if self.cleaning is not None and self.format in {"ptx", "poses"}:
            raise ValueError(f"`cleaning` and format `{self.format}` exclude each other")
        return self


class RegisteredOutput(RegisteredOptions, FileOutputRequest):
    """How registered scans are wanted as files."""
