"""Inputs of the process `roofs`."""

from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

from algorithms.roofs.options import RoofOptions
from schemas.requests.execution import FileOutputRequest
from schemas.requests.method_options import options_model
from schemas.requests.posed_stations import PosedInputs, PosedStations, SelectedPoints
from schemas.values.base import RequestModel
from schemas.values.station_names import StationName

if TYPE_CHECKING:
    RoofRequest = RequestModel
else:
    RoofRequest = options_model(RoofOptions)

Coordinate: TypeAlias = Annotated[float, Field(ge=-1e9, le=1e9)]
Corner: TypeAlias = tuple[Coordinate, Coordinate]
LEAST_AREA_M2 = 0.01
"""Smaller plans are none."""


def _with_area(corners: list[Corner]) -> list[Corner]:
    (x0, y0), twice = corners[0], 0.0
    for (x1, y1), (x2, y2) in zip(corners, [*corners[1:], corners[0]], strict=True):
        twice += (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if abs(twice) < 2.0 * LEAST_AREA_M2:
        raise PydanticCustomError("plan_area", "the corners of a plan enclose an area")
    return corners


Outline: TypeAlias = Annotated[list[Corner], Field(min_length=3, max_length=1000), AfterValidator(_with_area)]


class GroundPlan(RequestModel):
    """The ground plan of a building."""

    name: StationName
    """Of the building, unique in the job."""
    corners_m: Outline
    """x, y of its corners in order, either way round, world [m]; the last side closes it, no side crosses another."""
    ground_m: Coordinate | None = None
    """Height of the ground [m]; null: a low quantile of the points within 3 m around the plan."""


class RoofsInputs(SelectedPoints, PosedInputs):
    """Registered scans or strips, and the ground plans, where they are known."""

    stations: PosedStations
    """Scans with poses, or the stations of a finished `register` job; z upward."""
    plans: list[GroundPlan] | None = Field(default=None, min_length=1, max_length=10_000)
    """The buildings; null: what stands above the terrain and is made of planes, with right-angled outlines."""
    least_plan_m2: float = Field(default=20.0, gt=0.0, le=1e6)
    """Without `plans`: smaller buildings are left out [m²]."""
    roof: RoofRequest = Field(default_factory=RoofRequest, title="Roof")
    """How roof planes are found."""


class BuildingsOutput(FileOutputRequest):
    """The buildings as a file, in the coordinates of the world."""

    format: Literal["city.json", "obj"] = "city.json"
    """`city.json`: CityJSON 2.0, level of detail 2.2; `obj`: triangles, one object each building."""
