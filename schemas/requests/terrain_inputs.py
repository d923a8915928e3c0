"""Inputs of the process `terrain`."""

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias, get_args

from pydantic import Field

from algorithms.terrain.options import Opening, TerrainFilter
from schemas.requests.execution import FileOutputRequest
from schemas.requests.method_options import options_model
from schemas.requests.posed_stations import PosedInputs, PosedStations, SelectedPoints
from schemas.requests.register_inputs import ScanReference
from schemas.values.base import RequestModel

FILTERS = get_args(TerrainFilter)

if TYPE_CHECKING:
    FilterRequest = RequestModel
    DefaultFilter = RequestModel
    FilterName: TypeAlias = str
else:
    _MODELS = {each: options_model(each) for each in FILTERS}
    FilterRequest = Annotated[reduce(or_, _MODELS.values()), Field(discriminator="name")]
    DefaultFilter = _MODELS[Opening]
    FilterName = Literal[tuple(each.name for each in FILTERS)]


class LinearPrediction(RequestModel):
    """Least squares interpolation with a covariance function, which tells standard deviations everywhere."""

    correlation_m: float = Field(default=10.0, gt=0.0, le=10_000.0)
    """Distance at which the covariance of heights has fallen to exp(-1/2) [m]."""
    relief_m: float = Field(default=1.0, gt=0.0, le=10_000.0)
    """Standard deviation of the terrain about a plane through the points around [m]."""
    noise_m: float = Field(default=0.1, gt=0.0, le=100.0)
    """Standard deviation of a point about the terrain [m]."""


class TrainingTerrain(RequestModel):
    """Measured terrain of which somebody has told ground and objects, z upwards, both in one frame."""

    ground: ScanReference
    """Points on the ground."""
    objects: ScanReference
    """Points on buildings, plants and all else above it."""


class TerrainInputs(SelectedPoints, PosedInputs):
    """A registered cloud, z upwards, and how its ground is found."""

    stations: PosedStations
    """Scans with poses, or the stations of a finished `register` job."""
    filter: FilterRequest = Field(default_factory=DefaultFilter)
    """How points on the ground are told from those on objects, with its options."""
    training: TrainingTerrain | None = None
    """Terrain from which the filter `slope` learns its allowed heights, with its radius; null: nothing is learned."""
    compare_filters: list[FilterName] = Field(default=[], max_length=20)
    """Other filters, with their usual options, whose ground is compared with that of the chosen one."""
    cell_m: float = Field(default=1.0, gt=0.0, le=1000.0)
    """Edge of the cells of filters and models [m]."""
    gap_m: float = Field(default=20.0, gt=0.0, le=10_000.0)
    """Widest gap without points over which models go on [m]: where a circle of this diameter without points fits, as
    over a lake, they have no data. Gaps that sparse points leave by chance, up to 5 mean spacings, are bridged too."""
    covered_m: float = Field(default=50.0, gt=0.0, le=10_000.0)
    """Widest area without ground points, under buildings and plants, over which the terrain goes on [m]; likewise."""
    prediction: LinearPrediction | None = Field(default=None, title="Linear prediction")
    """Predict the terrain with a covariance function; null: a moving plane through the ground points around."""
    maps: bool = True
    """Make maps of density, distance, residuals and expected standard deviations."""
    contour_interval_m: Annotated[float, Field(gt=0.0, le=1000.0)] | None = None
    """Draw contour lines of the terrain, and of the heights of objects, at this interval [m]; null: none."""
    canopy: bool = False
    """Model the canopy by the filter turned upside down, and the height of the stand above the terrain."""
    mesh: bool = False
    """Write the terrain as a triangle mesh."""
    grid_format: Literal["asc", "geotiff"] = "asc"
    """Format of all grids: ESRI ASCII, or GeoTIFF (float32). The reference system of the stations' files is named in
    them, or beside them (`.prj`, `.aux.xml`)."""
    light_azimuth_deg: float = Field(default=315.0, ge=0.0, le=360.0)
    """From where light falls on the picture of the terrain, clockwise from north [degrees]."""
    light_altitude_deg: float = Field(default=45.0, gt=0.0, le=90.0)
    """Height of that light above the horizon [degrees]."""


class ClassifiedOutput(FileOutputRequest):
    """The points of all stations with their classes: 2 ground, 1 other, 7 below the ground."""

    format: Literal["laz", "copc", "ply", "pcd", "xyz"] = "laz"
    """Format of the file."""
