"""Inputs of the process `drainage`."""

from pydantic import Field

from schemas.requests.posed_stations import PosedInputs, PosedStations, SelectedPoints
from schemas.requests.terrain_inputs import FilterRequest


class DrainageInputs(SelectedPoints, PosedInputs):
    """A registered cloud, z upwards, on whose terrain it rains."""

    stations: PosedStations
    """Scans with poses, or the stations of a finished `register` job."""
    filter: FilterRequest | None = None
    """How points on the ground are told from those on objects; null: all points lie on the terrain."""
    cell_m: float = Field(default=1.0, gt=0.0, le=1000.0)
    """Edge of the cells [m]."""
    gap_m: float = Field(default=20.0, gt=0.0, le=10_000.0)
    """Widest gap without points over which the terrain goes on [m]: where a circle of this diameter without points
    fits, as over a lake, grids have no data. Gaps that sparse points leave by chance, up to 5 mean spacings, are
    bridged too."""
    covered_m: float = Field(default=50.0, gt=0.0, le=10_000.0)
    """Widest area without ground points, under buildings and plants, over which the terrain goes on [m]; likewise."""
    least_catchment_m2: float = Field(default=1000.0, gt=0.0, le=1e12)
    """Area whose water makes a valley or ridge line [m²]."""
    least_length_m: float = Field(default=20.0, ge=0.0, le=1e6)
    """Shorter lines are left out [m]."""
    ridges: bool = True
    """Look for ridges too: valleys of the terrain turned upside down."""
    hollow_paths: bool = True
    """Join the bases of hollows over their lowest saddles."""
