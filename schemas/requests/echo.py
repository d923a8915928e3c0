"""Inputs and outputs of the process `echo`: the kinds of input of the OGC test suite."""

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Field, model_validator
from pydantic.alias_generators import to_camel
from pydantic_core import PydanticCustomError

from schemas.values.base import RequestModel

CRS84 = "http://www.opengis.net/def/crs/OGC/1.3/CRS84"
LONGEST_PAUSE_S = 30
QUALIFIERS = {"value", "mediaType", "encoding", "schema", "format"}


class Measure(RequestModel):
    """A number with its unit."""

    measurement: float
    """The number."""
    uom: str
    """Unit of measure."""
    reference: str | None = None
    """Where the unit is defined."""


def _four_or_six(numbers: list[float]) -> list[float]:
    if len(numbers) not in {4, 6}:
        raise PydanticCustomError("bbox_length", "a bounding box has 4 or 6 numbers")
    return numbers


class BoundingBox(RequestModel):
    """A bounding box in a coordinate reference system."""

    bbox: Annotated[list[float], AfterValidator(_four_or_six)]
    """Minima, then maxima; 2-D or 3-D."""
    crs: str = CRS84
    """Coordinate reference system."""


def _iso_date(text: str) -> str:
    try:
        datetime.fromisoformat(text)
    except ValueError:
        raise PydanticCustomError(
            "iso_date", "write a date as 2026-01-31 or a date with time as 2026-01-31T12:00:00Z"
        ) from None
    return text


class FeatureCollection(RequestModel):
    """A GeoJSON feature collection; only its outline is looked at."""

    model_config = ConfigDict(extra="allow")

    type: Literal["FeatureCollection"]
    """Of GeoJSON."""
    features: list[dict[str, Any]]
    """The features."""


TextOfFeatures = Annotated[str, Field(json_schema_extra={"contentMediaType": "application/gml+xml; version=3.2"})]


class EchoInputs(RequestModel):
    """What comes in: at least one input; each may also be wrapped as `{"value": …}`."""

    model_config = ConfigDict(alias_generator=to_camel)

    string_input: str | None = Field(default=None, title="Text")
    """Any text."""
    measure_input: Measure | str | None = Field(default=None, title="Measure")
    """A number with its unit, or both as text."""
    date_input: Annotated[str, AfterValidator(_iso_date), Field(json_schema_extra={"format": "date-time"})] | None = (
        Field(default=None, title="Date")
    )
    """A date, or a date with time (ISO 8601)."""
    double_input: float | None = Field(default=None, title="Number")
    """Any finite number."""
    boolean_input: bool | None = Field(default=None, title="Truth value")
    """True or false."""
    array_input: list[int] | None = Field(default=None, title="Array")
    """Whole numbers."""
    complex_object_input: dict[str, Any] | str | None = Field(default=None, title="Object")
    """Any object, or text with its media type."""
    geometry_input: dict[str, Any] | list[Any] | str | None = Field(default=None, title="Geometry")
    """One geometry or several: GeoJSON, or text with its media type."""
    bounding_box_input: BoundingBox | None = Field(default=None, title="Bounding box")
    """A bounding box in a coordinate reference system."""
    feature_collection_input: FeatureCollection | TextOfFeatures | None = Field(default=None, title="Features")
    """A feature collection: GeoJSON, or text with its media type."""
    pause: int | None = Field(default=None, ge=0, le=LONGEST_PAUSE_S, title="Pause")
    """Seconds to wait before answering [s]: for trying how a client waits, follows and dismisses a job."""

    @model_validator(mode="before")
    @classmethod
    def _unwrap(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        return {
            name: given["value"]
            if isinstance(given, dict) and "value" in given and given.keys() <= QUALIFIERS
            else given
            for name, given in data.items()
        }

    @model_validator(mode="after")
    def _not_empty(self) -> "EchoInputs":
        if not self.model_fields_set:
            raise PydanticCustomError("no_input", "give at least one input")
        return self
