"""Inputs of the process `register` (section 3 of the interface)."""

from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Discriminator, Field, Tag, model_validator

from schemas.requests.control_points import MAX_CONTROL, MAX_TARGETS, Axes, ControlPoints, FixedFrame, StationTarget
from schemas.requests.edge_options import PhotoLineOptionsRequest
from schemas.requests.registration_methods import ComparedMethod, DefaultMethod, MethodRequest
from schemas.requests.report_options import ReportOptions, Tolerance
from schemas.requests.scanner_options import ScannerOptions
from schemas.requests.target_kinds import TargetSearch
from schemas.values.approximate_pose import Approximate
from schemas.values.base import RequestModel
from schemas.values.crs import StatedCrs
from schemas.values.file_references import FileReference
from schemas.values.photos import StationPhoto
from schemas.values.reference_poses import Reference
from schemas.values.starts import ChosenStart
from schemas.values.station_names import StationName
from schemas.values.text_columns import StatedColumns
from schemas.values.units import StatedUnit

PairChoice: TypeAlias = Annotated[
    Annotated[Literal["auto"], Tag("auto")]
    | Annotated[list[tuple[StationName, StationName]], Field(min_length=1), Tag("list")],
    Discriminator(lambda value: "list" if isinstance(value, list) else "auto"),
]


MAX_PHOTOS, MAX_STARTS = 200, 1000
MAX_METHODS = 20


class ScanReference(FileReference):
    """One scan of an uploaded file."""

    index: int = Field(default=0, ge=0, le=1_000_000)
    """Number of the scan in the file, from 0."""
    unit: StatedUnit | None = Field(default=None, exclude_if=lambda value: value is None)
    """In which unit its coordinates are: `mm`, `m`, `ft` (international feet) or `us-ft` (US survey feet); they are
    converted to metres. Null: what the file declares, else metres. One that contradicts the file is refused."""
    columns: StatedColumns | None = Field(default=None, exclude_if=lambda value: value is None)
    """What the columns of a text table are, such as `row,col,x,y,z,i`: x, y, z, i(ntensity), r, g, b; any other name is
    passed over. Null: as stated when it was uploaded, as the file names them, or as their numbers show."""


class Station(RequestModel):
    """One set-up of the scanner."""

    name: StationName
    """Name of the station, unique in the job."""
    scan: ScanReference
    """What was measured there."""
    photos: list[StationPhoto] = Field(default=[], max_length=MAX_PHOTOS)
    """Photos taken from the same set-up, with the camera on the scanner."""
    levelled_std_gon: float | None = Field(default=None, ge=1e-5, le=10.0)
    """Standard deviation with which the scan's z axis is vertical, about each horizontal axis; null: the instrument
    was not levelled, or nobody knows [gon]. Between two levelled stations no pose is tried that tilts them against each
    other by more than 4 standard deviations (and 4.5 gon, the roughness of the search), and a pose that does in the end
    is doubtful. The levelling is no observation of the adjustment."""
    approximate_pose: Approximate | None = None
    """Roughly known world_from_scan: a 4×4 matrix, row by row, or an object with `matrix` and `std`; none is needed. It
    is tried as a hypothesis, tells which of many stations are too far apart to be registered with each other, and
    decides where the scans allow several poses (significance 1e-5). It makes no pose better accepted than the scans do:
    a pose that contradicts the approximate poses of both stations is at best `doubtful`, with their names among the
    reasons."""
    point_std_m: float | None = Field(default=None, ge=1e-6, le=1.0)
    """Standard deviation of single points across a surface that faces the instrument; null: estimated from the scan
    [m]. It sets how far points of one surface may lie off it and widens the limits of the search; the covariances of
    planes and lines follow from the residuals of their own points in any case."""
    targets: list[StationTarget] = Field(default=[], max_length=MAX_TARGETS)
    """Survey targets that were measured at this station, such as the downloads of `find-targets` have them; those that
    `targets` of the registration looks for come to them."""


class RegisterInputs(RequestModel):
    """What is to be registered, and how."""

    stations: list[Station] = Field(min_length=2, title="Stations")
    """Two stations or more."""
    pairs: PairChoice = Field(default="auto", title="Pairs")
    """`auto`, or the list of [target, source] names to try."""
    approximate_poses: Literal["stated", "file"] = Field(default="stated", title="Approximate poses")
    """`file`: the poses that E57 and PTX files state count as approximate poses (20 gon, 5 m) of stations that have no
    `approximate_pose`. `stated`: poses of files are not looked at."""
    method: MethodRequest = Field(default_factory=DefaultMethod, title="Method")
    """Method of registration with its options."""
    compare_methods: list[ComparedMethod] = Field(default=[], max_length=MAX_METHODS, title="Methods to compare")
    """Methods that register every pair as well, by name or with options as in `method`, to be laid beside it in
    `method_comparison`; they use the features that `method` asks for and change nothing of the answer. The name of
    `method` stands for it with its options, which is always the first of the table where it is not named."""
    photo_lines: PhotoLineOptionsRequest = Field(default_factory=PhotoLineOptionsRequest, title="Lines from photos")
    """Which edges of the photos become lines in space."""
    targets: TargetSearch | None = Field(default=None, title="Targets")
    """Survey targets to look for in every scan; null: only those that the stations state."""
    control: ControlPoints = Field(default=[], max_length=MAX_CONTROL, title="Control")
    """Points with known coordinates among the targets of the stations: a list, or the text of a table: `{"csv": "…"}`.
    Three that do not lie on one line, `use: "control"`, hold the world frame."""
    fix: FixedFrame = Field(default="first-station", title="Datum")
    """Whose frame becomes the world frame: `first-station`, the name of a station, `control` (the default where there
    are control points), or `free`: the first station's frame, standard deviations those of the smallest trace over all
    stations."""
    crs: StatedCrs | None = Field(default=None, title="System of the control")
    """Map projection of the control, such as `EPSG:25832`. The adjustment is done in a local Cartesian frame (x east, y
    north, z up at a point of the site), which is the world frame then, and points are given in the projection as well;
    null: the control is Cartesian already."""
    control_axes: Axes = Field(default="east-north-height", title="Axes of the control")
    """What x, y, z of the control are, and of what is given beside it: `north-east-height` is left-handed. The world
    frame is right-handed always: east, north, height."""
    geoid_undulation_m: float = Field(default=0.0, ge=-200.0, le=200.0, title="Undulation of the geoid")
    """With `crs`: height of the geoid over the ellipsoid at the site [m]. It is added to the heights of the control,
    which else count as ellipsoidal; 50 m that are missing change lengths by 8 mm in a km."""
    starts: list[ChosenStart] = Field(default=[], max_length=MAX_STARTS, title="Chosen starts")
    """Where a person says that stations lie to each other, a pair each, where the scans alone do not tell: by points
    picked in both scans, or by a pose such as one of two alternatives. The pair is adjusted from there on and judged as
    strictly as any other, the search's own pose standing beside it as its rival; where the scans leave several poses
    possible, the choice decides. The result document says who chose (`pairs[].start`)."""
    scanner: ScannerOptions | None = Field(default=None, title="Scanner", exclude_if=lambda value: value is None)
    """Whether errors of the instrument (vertical index, range offset, collimation) and turns of the tripod during scans
    are looked for in what three stations or more see; null: they are not. The answer is `network.instruments`."""
    reference: dict[StationName, Reference] | None = Field(default=None, title="Reference poses")
    """Known poses (world_from_scan) by station name, to compare the answer with: the 4×4 matrix, row by row, or an
    object with matrix and standard deviations."""
    report: ReportOptions = Field(default_factory=ReportOptions, title="Report")
    """Head and language of the report."""
    tolerance: Tolerance | None = Field(default=None, title="Tolerance")
    """What was ordered, to be compared with what was reached; null: the report gives what was reached alone."""

    @model_validator(mode="after")
    def _frame_of_the_control(self) -> Self:
        """Take the control's frame where points of it take part and nothing else is said."""
        if "fix" in self.model_fields_set or all(point.use == "check" for point in self.control):
            return self
        return self.model_copy(update={"fix": "control"})
