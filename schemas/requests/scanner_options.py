"""What a request wants to know of the instrument that measured its stations."""

from typing import Literal, TypeAlias

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from schemas.values.base import RequestModel
from schemas.values.station_names import StationName

InstrumentErrorName: TypeAlias = Literal["vertical_index", "range_offset", "range_scale", "collimation", "trunnion"]
"""Names of `algorithms.scans.instrument_errors.InstrumentError`, which would load numpy into the web process."""


class ScannerTolerances(RequestModel):
    """Standard deviations with which each error is observed as zero: what the maker promises."""

    vertical_index_mgon: float = Field(default=10.0, gt=0.0, le=5000.0)
    """Of the zero of the vertical circle [mgon]."""
    range_offset_mm: float = Field(default=5.0, gt=0.0, le=1000.0)
    """Of the addition constant [mm]."""
    range_scale_ppm: float = Field(default=50.0, gt=0.0, le=10000.0)
    """Of the scale of ranges [ppm]."""
    collimation_mgon: float = Field(default=10.0, gt=0.0, le=5000.0)
    """Of the collimation axis [mgon]."""
    trunnion_mgon: float = Field(default=10.0, gt=0.0, le=5000.0)
    """Of the trunnion axis [mgon]."""
    drift_mgon: float = Field(default=10.0, gt=0.0, le=5000.0)
    """Of the turn of a tripod while it is scanned from, about each axis, over the whole scan [mgon]."""


class ScannerOptions(RequestModel):
    """Whether the instrument is in adjustment and the tripod stood still, by planes and targets of several stations."""

    estimate: Literal["auto", "none"] | list[InstrumentErrorName] = Field(default="none", max_length=5)
    """`auto`: all errors are looked for and the significant ones reported; a list: these are estimated whether they are
    significant or not; `none`: nothing."""
    tripod: Literal["auto", "none"] = "none"
    """`auto`: a steady turn of each set-up during its scan is looked for, about three axes; the time of points is that
    of their time stamps (LAS, E57), else of their columns, else of their order in the file where it goes round the
    instrument; others cannot tell."""
    tripod_order: Literal[1, 2] = 1
    """Order of the polynomials in time: 1 a steady turn, 2 with a bend as well (a tripod that settles). Every further
    coefficient makes the others less certain, and the limit of all tests higher."""
    apply: bool = False
    """Whether the poses are those with the estimated errors taken off, as are the targets that are adjusted with them;
    they rest on planes, pipes and targets alone then, as the surfaces of pairs were compared as measured. Otherwise the
    errors are reported and nothing is changed."""
    tolerances: ScannerTolerances = Field(default_factory=ScannerTolerances)
    """What the maker promises."""
    instruments: dict[str, list[StationName]] | None = Field(default=None, max_length=100)
    """Which instrument measured which stations, by a name for each; null: one instrument measured all."""

    @model_validator(mode="after")
    def _one_instrument_a_station(self) -> "ScannerOptions":
        named = [station for stations in (self.instruments or {}).values() for station in stations]
        if len(named) != len(set(named)):
            raise PydanticCustomError("one_instrument", "a station is listed with two instruments")
        return self

    @property
    def asks(self) -> bool:
        """Whether anything is to be estimated."""
        return self.tripod == "auto" or self.estimate not in ("none", [])
