"""Result document of the process `register` (API section 4)."""

from typing import Any

from pydantic import ConfigDict, Field

from schemas.results.adjustment_figures import Accuracy, Adjustment, RankReport, WeakDirection
from schemas.results.cleaning_figures import CleaningStep
from schemas.results.comparison import ComparedParameter, StationComparison
from schemas.results.control_result import ControlResult
from schemas.results.correspondences import Correspondence, Outlier, PlaneCorrespondence
from schemas.results.method_comparison import MethodComparison
from schemas.results.network import Network
from schemas.results.own_figures import OwnFigures
from schemas.results.place import Place
from schemas.results.precision import Determined, Precision
from schemas.results.result_lists import NetworkCounts, ResultList, comes_in_pages
from schemas.results.tolerance_check import ToleranceCheck
from schemas.values.instruments import MeasuringInstrument
from schemas.values.poses import Document, Pose, Row4
from schemas.values.starts import StartDocument


class Coarse(Document):
    """Registration without first guess: the hypothesis that won."""

    target_from_source: tuple[Row4, Row4, Row4, Row4]
    """Pose of that hypothesis, 4×4 row by row."""
    support: int = Field(description="Lines and planes that both scans see in this pose.")
    score: float = Field(description="Share of the surface that fits, less a penalty for violated free space, to 1.")
    runner_up_support: int | None = Field(description="The same count for the best clearly different pose.")
    runner_up_score: float | None
    """The same score for that pose; null: there is none."""
    runner_up_target_from_source: tuple[Row4, Row4, Row4, Row4] | None = None
    """That pose, 4×4 row by row; null: there is none."""
    hypotheses_tested: int
    """Number of poses that were tried."""


class UnexplainedSurface(Document):
    """A piece of surface that stands where the other instrument looked through: it moved, or the pose is wrong."""

    station: str = Field(description="The station whose scan shows it.")
    centre_m: tuple[float, float, float] = Field(description="Its middle, in the coordinates of that station's file.")
    area_m2: float = Field(description="About how much surface it is.")
    range_m: float = Field(description="How far it is from the instrument that looked through it.")


class Overlap(Document):
    """How the surfaces of both scans fit in the registered position."""

    model_config = ConfigDict(validate_by_name=True, validate_by_alias=True)

    fraction_0_5m: float | None = Field(alias="fraction_0.5m", description="Share of points with a partner that near.")
    fraction_0_1m: float | None = Field(alias="fraction_0.1m")
    """Share of points with a partner within 0.1 m; null: not known."""
    rms_m: float | None = Field(description="Point-to-plane, of points within 0.1 m; null: there are none.")
    free_space_violations: float | None = Field(
        description="Share of surface that stands where the other instrument looked through; null: its position is "
        "unknown."
    )
    unexplained: list[UnexplainedSurface] = Field(
        default_factory=list,
        description="The largest pieces of it, the largest first: at most ten, empty where nothing can be told.",
    )


class LineCount(Document):
    """What became of the lines that one station has from one source."""

    station: str
    """Name of the station."""
    source: str = Field(description="plane-intersection, cylinder-axis or photo-edge (lines that only photos show)")
    found: int
    """Lines of that source."""
    matched: int = Field(description="Of these, those with a partner in the other station.")
    used: int = Field(description="Of the matched ones, those in the adjustment.")
    removed: int = Field(description="Of the matched ones, those that the tests removed.")


class UnusedPhotoLine(Document):
    """A line of a photo that does not carry the pose."""

    line: str = Field(description="Station and line, such as S1/L12.")
    photo: int = Field(description="Number of the station's photo that shows it, from 0.")
    surface: str = Field(
        description="crease, silhouette, surface-edge (both sides one surface: paint, a joint or a shadow) or "
        "material-edge (the same, and the scan's intensity changes there: no shadow)"
    )
    state: str = Field(description="removed: by the tests; unmatched: no line of the other station fits it.")


class WrongMount(Document):
    """A camera that does not sit where it was said to: its photo's lines contradict the others as a whole."""

    station: str
    """Name of the station."""
    photo: int = Field(description="Number of the station's photo, from 0.")
    rotation_gon: float = Field(description="By how much its stated pose seems to be turned.")
    rotation_std_gon: float = Field(description="Standard deviation of that.")
    translation_m: float = Field(description="By how much it seems to be shifted.")
    statistic: float = Field(description="T, by how much the sum of squares drops when the mount is free.")
    critical: float = Field(description="Its limit.")
    global_statistic: float = Field(description="Omega of the adjustment that trusted the mount as stated.")
    global_critical: float = Field(description="Its limit at the level of single tests.")


class PhotoLineCounts(Document):
    """What became of the lines that only photos show."""

    target_found: int = Field(description="Lines of the target's photos.")
    source_found: int = Field(description="Lines of the source's photos.")
    matched: int = Field(description="Pairs of lines of which at least one comes from a photo.")
    used: int = Field(description="Of these, those in the adjustment.")
    removed: int = Field(description="Of these, those that the tests removed.")
    unused: list[UnusedPhotoLine] = Field(description="Lines of photos that were removed or found no partner.")
    wrong_mounts: list[WrongMount] = Field(
        default=[],
        description="Mounts whose stated standard deviations the lines refute, in the order found; the adjustment took "
        "the errors found for their standard deviations instead.",
    )


class PosePart(Document):
    """What a pose is made of."""

    name: str
    """lines, planes or surfaces."""
    share: float = Field(description="Of the information, averaged over the motions that the pose determines, 0 to 1.")


class SurfaceFigures(Document):
    """The pose by surfaces alone, on which the answer rests or against which it was tested."""

    distances: int = Field(description="Distances between corresponding surfaces that count.")
    spread_m: float = Field(description="Their robust standard deviation.")
    neighbourhoods: int = Field(description="Their misfits count as one observation each.")
    neighbourhood_m: float = Field(description="Edge of a neighbourhood.")
    largest_std_m: float | None = Field(
        description="Of the worst determined motion, turns as the shift they cause; null: it is open."
    )
    hidden_shift_m: float = Field(
        description="Largest shift of the pose by a neighbourhood that lies wrong by as much as does most harm."
    )
    iterations: int
    """Rounds until nothing changed any more."""
    converged: bool
    """Whether it came to rest within the rounds allowed."""


class ModelParameter(Document):
    """A parameter beside the motion that was estimated to test whether the scans differ by more; never applied."""

    value: float | None = Field(
        description="Scale or stretch of the source over the target, less one: 0.02 where the source is 2 % larger. "
        "Null: the surfaces do not determine it."
    )
    std: float | None
    """Its standard deviation; null: not determined."""
    significant: bool = Field(description="Whether the scans differ so; the pair is coarse at best then.")
    direction_in_source: tuple[float, float, float] | None = Field(
        default=None, description="Of a stretch: unit vector in the axes of the source's file."
    )


class ModelTests(Document):
    """Whether the two scans differ by more than a rigid motion."""

    rigid: bool = Field(description="False where a scale, a stretch or a bend is significant.")
    scale: ModelParameter
    """Scale of the source over the target, the same along all directions."""
    stretch: ModelParameter = Field(description="The most significant scale along one direction.")
    bend: bool = Field(description="Whether one scan is bent against the other.")
    more_surface_fits: float = Field(description="Share by which more surface fits with the deformation found.")
    instrument_shift_m: float = Field(description="How far the deformation leaves open where an instrument stood.")


class Pair(Document):
    """What came out for two stations."""

    target: str
    """Name of the station that gives the frame."""
    source: str
    """Name of the station that is moved."""
    status: str = Field(
        description="accepted: in place and as precise as asked; coarse: in place, less precise; doubtful, ambiguous, "
        "rejected: not certainly in place; degenerate: not determined"
    )
    reasons: list[str]
    """Why it has that status, the weightiest reason first."""
    target_from_source: Pose | None
    """The pose; null: there is none."""
    estimator: str | None = Field(
        default=None,
        description="What gave the pose: lines+planes+surfaces, planes+surfaces, surfaces, lines+planes, planes or "
        "lines, each with +targets where survey targets take part, or targets; null: an estimator of the method's own.",
    )
    estimator_reason: str | None = Field(default=None, description="Why, in words with figures.")
    pose_parts: list[PosePart] = Field(default=[], description="What that pose is made of, the largest share first.")
    surfaces: SurfaceFigures | None = Field(default=None, description="Null: the method does not use surfaces.")
    model: ModelTests | None = Field(default=None, description="Null: there is no pose to test.")
    place: Place | None = Field(
        default=None,
        description="How probable the pose is by the evidence, beside others; below one half it is not accepted. "
        "Null: there is no pose, or the evidence is not calibrated.",
    )
    determined: Determined | None = Field(default=None, description="What is determined; null: there is no pose.")
    precision: Precision | None = Field(
        default=None, description="How well the pose is known; null: there is none, or it leaves motions free."
    )
    start: StartDocument | None = Field(
        default=None, description="The start that somebody chose; null: the scans alone were asked."
    )
    coarse: Coarse | None
    """How it was found; null: the method searches nothing."""
    adjustment: Adjustment | None = Field(
        description="The rigorous adjustment, also where the method has an estimator of its own; with correspondences, "
        "outliers, accuracy and rank report."
    )
    correspondences: list[Correspondence]
    """Lines of both stations taken for one."""
    plane_correspondences: list[PlaneCorrespondence]
    """Planes of both stations taken for one."""
    outliers: list[Outlier]
    """What was removed or put back, in that order."""
    accuracy: Accuracy | None
    """Summary of the adjustment; null: there is none."""
    line_counts: list[LineCount] = Field(
        default=[], description="What became of the lines of both stations, by where they come from."
    )
    photo_lines: PhotoLineCounts | None = Field(default=None, description="Null: neither station has photos.")
    own_figures: OwnFigures | None = Field(
        default=None, description="Of methods with an estimator of their own: what they say of themselves."
    )
    rank_report: RankReport | None = Field(description="Null: the scans did not come as far as an adjustment.")
    weak_directions: list[WeakDirection]
    """Directions that are determined badly or not at all."""
    overlap: Overlap | None
    """How the surfaces fit; null: there is no pose."""
    timings_s: dict[str, float]
    """How long each part took, by name [s]."""


class Station(Document):
    """A station in the common frame."""

    name: str
    """Name of the station."""
    status: str = Field(description="fixed, registered or unregistered")
    reason: str | None = Field(
        default=None, description="Why it could not be registered; of a registered one what contradicts its pose."
    )
    world_from_scan: Pose | None
    """Its pose; null: it has none."""


class PhotoEdgeCount(Document):
    """What one photo gave."""

    file: str
    """Identifier of the file."""
    index: int
    """Number in the file, from 0."""
    segments: int = Field(description="Straight edges found in the photo.")
    projected: int = Field(description="Of these, those that became lines in space.")
    merged: int = Field(description="Of these, those that were joined with lines of the scan or of other photos.")
    rejected: dict[str, int] = Field(description="Edges that gave no line in space, by reason.")


class FeatureCount(Document):
    """How many features a scan gave."""

    station: str
    """Name of the station."""
    points: int
    """Points that were looked at."""
    lines: int
    """Lines."""
    planes: int
    """Planes."""
    cylinders: int
    """Cylinders."""
    noise_std_m: float
    """Standard deviation of points across their surfaces [m]."""
    left_out_points: int = Field(default=0, description="Isolated points far from everything else, not contained.")
    instrument_std_m: float | None = Field(
        default=None,
        description="Standard deviation of the instrument's position where it was guessed from the cloud; null: the "
        "file states it, or it is unknown.",
    )
    coordinate_step_m: tuple[float, float, float] | None = Field(
        default=None,
        description="What the coordinates are rounded to along x, y and z of the file, found from themselves; of "
        "slices of unequal thickness that of the typical point.",
    )
    range_step_m: float | None = Field(
        default=None, description="Step of the distances from the instrument; null: none is seen."
    )
    coordinate_slices: bool = Field(
        default=False, description="Coordinates fall on slices of unequal thickness, as depth cameras measure."
    )
    photo_edges: int = Field(default=0, description="Lines that only the photos show, contained in `lines`.")
    photos: list[PhotoEdgeCount] = Field(default=[], description="What each photo of the station gave.")
    warnings: list[str] = Field(
        default=[],
        description="What looked wrong with its scan, what was changed in reading it (such as the unit), isolated "
        "points that were left out, and which scans of the same file were.",
    )


class Artifact(Document):
    """A download."""

    name: str
    """What the download is called."""
    type: str
    """Media type."""
    bytes: int
    """Size [bytes]."""
    href: str
    """Where it is."""


class InputFile(Document):
    """A scan or photo that went in."""

    station: str
    """Name of the station."""
    kind: str = Field(default="scan", description="scan or photo")
    file: str
    """Identifier of the file."""
    name: str | None = Field(default=None, description="What the file was called when it was uploaded.")
    index: int
    """Number in the file, from 0."""
    sha256: str
    """Hash of the file's content."""
    unit: str | None = Field(default=None, description="Of the coordinates, as the request states it.")
    columns: str | None = Field(default=None, description="Of a text table, as the request of the job states them.")
    instrument: MeasuringInstrument | None = Field(
        default=None, description="What the scan's file says of instrument and time; null: nothing."
    )


class Provenance(Document):
    """What was done with what."""

    model_config = comes_in_pages("inputs")

    software: str
    """Program and version."""
    method: dict[str, Any]
    """Method with all its options, as used."""
    seed: int
    """Of the random numbers: the same seed gives the same answer."""
    inputs: list[InputFile]
    """Scans and photos that went in."""
    timings_s: dict[str, float]
    """How long each part took, by name [s]."""


class RegisteredFile(Artifact):
    """A file with registered scans, or with poses."""

    format: str
    """As requested."""
    stations: list[str]
    """Whose points are in it, in their order."""
    points: int
    """Points in it; 0 for poses alone."""
    notes: list[str] = Field(default_factory=list)
    """What the format could not keep, or was changed for it."""
    cleaning: list[CleaningStep] | None = Field(default=None, exclude_if=lambda value: value is None)
    """What every step of `cleaning` took away of the stations in this file, where it was asked for."""


class RegistrationDocument(Document):
    """Answer of `register`; of a large network its `lists` do not stand in it."""

    model_config = comes_in_pages("stations", "pairs", "features", "comparison", "comparison_summary")

    status: str = Field(description="registered, partly-registered or not-registered")
    stations: list[Station]
    """Every station with its pose in the common frame."""
    pairs: list[Pair]
    """Every pair that was tried."""
    network: Network | None = Field(default=None, description="Null: there are only two stations.")
    control: ControlResult | None = Field(
        default=None,
        exclude_if=lambda value: value is None,
        description="Targets and control in one adjustment with what the scans say, where there are any.",
    )
    method_comparison: MethodComparison | None = Field(
        default=None, exclude_if=lambda value: value is None, description="Where `compare_methods` asks for it."
    )
    tolerance: ToleranceCheck | None = Field(
        default=None, description="What was ordered beside what was reached; null: made by an older version."
    )
    features: list[FeatureCount]
    """What each scan gave."""
    comparison: list[ComparedParameter] | None
    """Parameters beside those of the reference; null: none was given."""
    comparison_summary: list[StationComparison] | None
    """The same by station; null: no reference was given."""
    artifacts: list[Artifact]
    """Files that can be downloaded."""
    registered: list[RegisteredFile] | None = Field(default=None, exclude_if=lambda value: value is None)
    """The registered scans as files, where these were wanted."""
    provenance: Provenance
    """What was done with what."""
    lists: dict[str, ResultList] = Field(
        default_factory=dict,
        exclude_if=lambda value: not value,
        description="Of a large network, by name: what does not stand in this document and comes page by page.",
    )
    counts: NetworkCounts | None = Field(
        default=None, exclude_if=lambda value: value is None, description="Of a large network: what its lists come to."
    )
