"""Inputs of the process `calibrate-mount`."""

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from algorithms.calibration.edge_options import EdgeCalibrationOptions
from schemas.requests.edge_options import EdgeOptionsRequest
from schemas.requests.extract_lines_inputs import FeatureOptionsRequest
from schemas.requests.method_options import options_model
from schemas.requests.register_inputs import Station
from schemas.values.base import RequestModel

if TYPE_CHECKING:
    EdgeCalibrationRequest = RequestModel
else:
    EdgeCalibrationRequest = options_model(EdgeCalibrationOptions)

MAX_STATIONS = 100


class CalibrateMountInputs(RequestModel):
    """Scans and photos of the same set-ups, and how far stated mounts may be off."""

    stations: list[Station] = Field(min_length=1, max_length=MAX_STATIONS, title="Stations")
    """Scans with the photos taken there; each photo with its stated pose or mount. No registration is needed."""
    mounts: Literal["camera", "photo"] = Field(default="camera", title="Mounts")
    """`camera`: photos of one interior orientation are of one camera, whose mount is common to all of them. `photo`:
    every photo has an error of its own."""
    search: EdgeCalibrationRequest = Field(default_factory=EdgeCalibrationRequest, title="Search")
    """How far stated mounts may be off."""
    edges: EdgeOptionsRequest = Field(default_factory=EdgeOptionsRequest, title="Edges")
    """Which edges of the photos are taken."""
    features: FeatureOptionsRequest = Field(default_factory=FeatureOptionsRequest, title="Features")
    """What counts as a plane of the scans."""
    distances_m: list[Annotated[float, Field(gt=0.0, le=1e6)]] = Field(
        default_factory=lambda: [10.0, 50.0], min_length=1, max_length=10, title="Distances"
    )
    """At which the effect of the mount's error is told [m]."""

    @model_validator(mode="after")
    def _photos(self) -> "CalibrateMountInputs":
        if not any(station.photos for station in self.stations):
            raise PydanticCustomError("no_photos", "no station has `photos`: give those taken from the set-ups")
        return self
