"""Inputs of the process `adjust-strips`."""

from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from pydantic import BeforeValidator, Field

from algorithms.strips.options import CorrectionOptions, PatchOptions
from schemas.requests.execution import FileOutputRequest
from schemas.requests.method_options import options_model
from schemas.requests.point_tables import PointTable, as_tuples, point_dictionaries
from schemas.values.base import RequestModel
from schemas.values.file_references import FileReference
from schemas.values.station_names import StationName

if TYPE_CHECKING:
    PatchRequest = RequestModel
    CorrectionRequest = RequestModel
else:
    PatchRequest = options_model(PatchOptions)
    CorrectionRequest = options_model(CorrectionOptions)

Coordinate: TypeAlias = Annotated[float, Field(ge=-1e9, le=1e9)]
Std: TypeAlias = Annotated[float, Field(gt=0.0, le=100.0)]
MOST_STRIPS = 300
LONGEST_PAUSE_S = 120.0
"""Points further apart in time are of two strips: an airborne scanner flies kilometres meanwhile [s]."""
ColumnWord: TypeAlias = Annotated[str, Field(min_length=1, max_length=40)]


class StripFile(FileReference):
    """A strip, or a tile of several: LAS or LAZ in metres, z upwards, with the GPS time of every point."""

    name: StationName | None = None
    """What it is called in the result; null: as its file, without the ending."""
    one_strip: bool = False
    """Take the file for one strip whatever its points say; false: points of several point sources are as many strips,
    those that several tiles share are joined, and a pause of more than 120 s divides."""


class TrajectoryFile(FileReference):
    """Where the scanner was: a text table of time, x, y, z and, if known, roll, pitch, heading."""

    columns: list[ColumnWord] | None = Field(default=None, min_length=4, max_length=50)
    """What the columns hold: `time`, `x`, `y`, `z`, `roll`, `pitch`, `heading`, others are passed over; null: as the
    first line names them, else in this order."""


class StripControlPoint(RequestModel):
    """A known point on a surface that is smooth around it. Points of one name lie in one plane, such as a roof face."""

    name: str = Field(min_length=1, max_length=100)
    """Of the plane, or of the single point."""
    x: Coordinate
    """Coordinate [m]."""
    y: Coordinate
    """Coordinate [m]."""
    z: Coordinate
    """Height [m]."""
    std_m: Std | tuple[Std, Std, Std] = 0.02
    """Standard deviation of the coordinates, one for all or one each [m]."""


def _control_of_table(given: object) -> object:
    """Give the points of a table; nothing of their use."""
    points = point_dictionaries(given)
    if points is given:
        return given
    return [{key: as_tuples(value) for key, value in point.items() if key != "use"} for point in points]


class AdjustStripsInputs(RequestModel):
    """Strips of one flight or several, which overlap."""

    strips: list[StripFile] = Field(min_length=1, max_length=MOST_STRIPS, title="Strips")
    """The strips, at least two, or one and control; tiles that hold several strips are divided by point source."""
    trajectories: list[TrajectoryFile] = Field(default_factory=list, max_length=100, title="Trajectories")
    """Where the scanner was, in the coordinates and times of the strips: each strip takes the one that covers its
    times. Without any, strips are turned about the middle line of their points, and a bore-sight is estimated only as
    shifts and turns that they have in common."""
    angle_unit: Literal["deg", "gon", "rad"] = "deg"
    """Of the angles in trajectories: roll (right wing down), pitch (nose up), heading (clockwise from +y)."""
    control: Annotated[
        list[StripControlPoint],
        BeforeValidator(_control_of_table, json_schema_input_type=list[StripControlPoint] | PointTable),
    ] = Field(default_factory=list, max_length=20_000, title="Control")
    """Known planes and heights: four points on a plane, on the source's advice, or single points on smooth ground. A
    list, or the text of a table: `{"csv": "…"}`."""
    patches: PatchRequest = Field(default_factory=PatchRequest, title="Patches")
    """Which pieces of surface tie strips."""
    corrections: CorrectionRequest = Field(default_factory=CorrectionRequest, title="Corrections")
    """What corrects a strip."""
    alpha: float = Field(default=0.001, gt=0.0, le=0.1)
    """Probability with which a good patch fails its test."""
    passes: int = Field(default=2, ge=1, le=5)
    """How often homologous patches are looked for, the later times where the corrections so far say that they are; of 2
    and more, up to four times more while these move patches by more than 0.1 m."""
    picture_cell_m: float = Field(default=2.0, gt=0.0, le=1000.0)
    """Edge of the cells in which heights of strips are compared, for the pictures and their figures [m]."""
    picture_limit_m: float = Field(default=0.15, gt=0.0, le=100.0)
    """Differences from which on the pictures have their strongest colours [m]."""


class CorrectedOutput(FileOutputRequest):
    """Each strip as a file with corrected coordinates, all else as it was."""

    format: Literal["laz"] = "laz"
    """`laz`: in the point format, order and coordinate steps of its file."""
