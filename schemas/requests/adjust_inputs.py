"""Inputs of the process `adjust`."""

from typing import Annotated, Literal, TypeAlias

from pydantic import BeforeValidator, Field

from schemas.requests.hybrid_network import HybridNetwork, NetworkName, Number, ScannerParameter, Std
from schemas.requests.network_texts import Jag3dTexts, NetworkText, network_dictionary
from schemas.values.base import RequestModel

GivenNetwork: TypeAlias = Annotated[
    HybridNetwork, BeforeValidator(network_dictionary, json_schema_input_type=HybridNetwork | NetworkText | Jag3dTexts)
]
"""A network, or the text of a file of another program that holds one."""

HeldCoordinate: TypeAlias = tuple[NetworkName, Annotated[str, Field(pattern="^[XYZ]{1,3}$")]]


class FreeDatum(RequestModel):
    """The trace of the covariance of chosen unknowns is smallest; with approximate values the frame is theirs."""

    type: Literal["free"]
    """A free network."""
    points: Annotated[list[NetworkName], Field(max_length=1_000_000)] | None = None
    """Points that carry the datum; null: all, or none where stations are named."""
    stations: Annotated[list[NetworkName], Field(max_length=100_000)] | None = None
    """Stations whose positions and angles carry it; null: all, or none where points are named."""
    angles: bool = True
    """Whether angles of these stations take part, a radian counting as a metre."""


class MinimalDatum(RequestModel):
    """Single coordinates of points are observed, as many as are free: 3-2-1 of six."""

    type: Literal["minimal"]
    """A minimal datum."""
    held: Annotated[list[HeldCoordinate], Field(min_length=1, max_length=1000)]
    """Points with their coordinates: [["401", "XYZ"], ["402", "YZ"], ["403", "Z"]]."""
    std_m: Std = 1e-6
    """Standard deviation of each [m]."""
    values: dict[str, Number] = Field(default_factory=dict)
    """Values by point and coordinate, `401X` [m]; where missing the approximate coordinate, and without one 0."""


class ControlDatum(RequestModel):
    """The datum is that of the control points among the observations."""

    type: Literal["control"]
    """Known points, with their standard deviations or held."""


class HeldDatum(RequestModel):
    """Points and stations keep their approximate values exactly."""

    type: Literal["held"]
    """Constant unknowns."""
    points: Annotated[list[NetworkName], Field(max_length=1_000_000)] = Field(default_factory=list)
    """Points."""
    stations: Annotated[list[NetworkName], Field(max_length=100_000)] = Field(default_factory=list)
    """Stations, with their attitude."""


NetworkDatum: TypeAlias = Annotated[FreeDatum | MinimalDatum | ControlDatum | HeldDatum, Field(discriminator="type")]
OtherDatum: TypeAlias = Annotated[FreeDatum | MinimalDatum, Field(discriminator="type")]


class GrossErrorSteps(RequestModel):
    """Single steps of the search for gross errors."""

    screening_m: Annotated[float, Field(gt=0.0, le=1e6)] | None = 0.5
    """Observations that miss by more than this at the object are left out first [m]; null: no screening."""
    robust: bool = True
    """Mark with ORIENT's weight function."""
    snooping: bool = True
    """Leave out what fails its test, the worst at a time, and bring back what passes in the end."""


class ScannerErrorTolerances(RequestModel):
    """Standard deviations with which errors of scanners are observed as zero: what the maker promises."""

    distance_offset: Std = 0.005
    """Addition constant [m]."""
    collimation: Std = 0.01
    """Of the line of sight [gon]."""
    trunnion: Std = 0.01
    """Of the trunnion axis [gon]."""
    zenith_index: Std = 0.01
    """Of the vertical circle [gon]."""


class ScannerErrors(RequestModel):
    """Whether the scanners are in adjustment: the network is adjusted with their errors as unknowns as well."""

    estimate: Literal["auto", "none"] | list[ScannerParameter] = Field(default="auto", max_length=4)
    """`auto`: all errors, of which the significant ones are applied if asked; a list: these; `none`: nothing."""
    apply: bool = False
    """Whether the result has the errors as unknowns: of `auto` the significant ones, of a list all."""
    tolerances: ScannerErrorTolerances = Field(default_factory=ScannerErrorTolerances)
    """What the maker promises."""


class AdjustInputs(RequestModel):
    """A network of observations and how to adjust it."""

    network: GivenNetwork = Field(title="Network")
    """Stations, points and observations; or the text of GNU Gama's or RiSCAN PRO's file: `{"format": "gama-local",
    "xml": "…"}`, or JAG3D's: `{"format": "jag3d", "files": [{"type": "directions", "text": "…"}]}`."""
    datum: NetworkDatum = Field(default_factory=lambda: FreeDatum(type="free"), title="Datum")
    """What defines the frame."""
    other_datum: OtherDatum | None = Field(default=None, title="Other datum")
    """The answer is carried into this datum as well (S-transformation); only where observations leave a frame free."""
    gross_errors: Literal["haring", "snooping", "robust", "none"] | GrossErrorSteps = "haring"
    """`haring`: screening, robust weights, single tests; or one of these, or its steps."""
    variance_components: bool = False
    """Whether standard deviations of groups are estimated from the residuals; single tests are then done once more."""
    epoch: GivenNetwork | None = Field(default=None, title="Second epoch")
    """A later network of the same points: which of them moved is tested."""
    scanner: ScannerErrors | None = Field(default=None, title="Scanners", exclude_if=lambda value: value is None)
    """Whether errors of the scanners (addition constant, collimation, trunnion axis, zenith index) are looked for, each
    scanner's over all its stations; null: they are not."""
    alpha: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.001
    """Probability that a good observation fails its test."""
    alpha_global: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.05
    """Probability that the global test rejects a good adjustment."""
    power: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.80
    """Probability with which an error of the smallest detectable size is found."""
    max_removed_share: Annotated[float, Field(ge=0.0, le=0.9)] = 0.3
    """Largest share of the observations that may be left out."""
    max_iterations: Annotated[int, Field(ge=1, le=1000)] = 50
    """Limit of rounds in each adjustment."""
    covariance_scale: Literal["a-priori", "a-posteriori"] = "a-priori"
    """Whether standard deviations of the result are multiplied by sigma0."""
