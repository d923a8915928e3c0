"""Result document of the process `compare`."""

from typing import Any, Literal

from pydantic import Field

from schemas.results.posed_result import PoseSource
from schemas.results.registration_result import Artifact
from schemas.values.poses import Document


class Quantile(Document):
    """What a share of the deviations does not exceed."""

    share: float
    """The share, 0..1."""
    deviation_m: float
    """[m]."""


class DeviationFigures(Document):
    """Signed deviations in figures."""

    count: int
    """Deviations."""
    mean_m: float | None
    """Mean, with sign [m]; null: which side is positive is arbitrary, and so are all signs."""
    std_m: float
    """Standard deviation about the mean [m]."""
    rms_m: float
    """Root mean square, about zero [m]."""
    mean_absolute_m: float
    """Mean of the amounts [m]."""
    robust_std_m: float
    """1.4826 times the median distance from the median [m]."""
    quantiles: list[Quantile]
    """In ascending order."""
    largest_m: float
    """The one of largest amount, with its sign [m]."""
    largest_at_m: tuple[float, float, float]
    """Where that is, world [m]."""
    share_within_tolerance: float
    """Share of deviations within the tolerance, 0..1."""


class DeviationHistogram(Document):
    """Counts of deviations in classes of equal width."""

    edges_m: list[float]
    """Borders of the classes, one more than counts [m]."""
    counts: list[int]
    """In each class."""
    below: int
    """Below the first border."""
    above: int
    """Above the last border."""


class PlaneFigures(Document):
    """Deviations of the points that belong to a plane."""

    name: str
    """As in the request."""
    figures: DeviationFigures | None
    """Null: no point lies before it."""


class MeshFigures(Document):
    """What the edges of a mesh say of it."""

    triangles: int
    """In use."""
    closed: bool
    """Whether it bounds a body; signs are right everywhere then."""
    border_edges: int
    """Edges of one triangle only: rims of holes, or of an open surface."""
    crowded_edges: int
    """Edges of three triangles or more."""
    contradicting_edges: int
    """Edges whose triangles look to opposite sides: the sign changes there."""
    dropped_triangles: int
    """Triangles without area, left out."""


class M3C2Figures(Document):
    """What the level of detection says."""

    core_points: int
    """Places where both clouds were looked for."""
    measured: int
    """Of these, where both have points."""
    significant: int
    """Of these, where the distance exceeds its level of detection."""
    expected_by_chance: float
    """How many would exceed it without any change: alpha times those measured."""
    median_level_of_detection_m: float
    """Median [m]."""
    median_pose_std_m: float
    """Median standard deviation of distances by the errors of the poses [m]."""
    waviness_std_m: float
    """Standard deviation of distances by errors that neighbouring points share [m]."""
    waviness_samples: int
    """Core points or neighbourhoods from which it was measured; 0: it was stated, or there were too few."""
    median_points: tuple[float, float]
    """Median numbers of points in a cylinder, reference and cloud."""


class PatternFigures(Document):
    """What is in the difference of two surfaces beside noise."""

    cell_m: float
    """Edge of a cell [m]."""
    rows: int
    """Upwards in the picture."""
    columns: int
    """To the right."""
    common_cells: int
    """Cells in which both surfaces have a height."""
    gross_cells: int
    """Cells left out because only one surface has what stands there."""
    offset_m: float
    """Mean difference, cloud minus reference, in the middle [m]."""
    tilt_right_mrad: float
    """Slope of the difference to the right [mrad]."""
    tilt_up_mrad: float
    """Slope upwards in the picture [mrad]."""
    std_m: float
    """About offset and tilt [m]."""
    wavelength_m: float
    """Of the strongest wave [m]."""
    stripes_azimuth_gon: float
    """Direction of its crests: 0 upwards in the picture (north), 100 to the right (east) [gon]."""
    amplitude_m: float
    """Of that wave [m]."""
    wave_p_value: float
    """Probability of a wave as strong somewhere in noise."""
    direction_gon: float
    """Direction of stripes, periodic or not [gon]."""
    direction_p_value: float
    """Probability of so much power in one direction in noise."""
    significant: bool
    """Whether there is a pattern, at the level alpha."""


class CompareProvenance(Document):
    """What was done with what."""

    software: str
    """Program and version."""
    inputs: dict[str, Any]
    """As used."""
    timings_s: dict[str, float]
    """Seconds by part."""


class CompareDocument(Document):
    """Answer of `compare`."""

    poses_from: dict[Literal["cloud", "reference"], dict[str, PoseSource]] = Field(default={})
    """Where the pose of each station is from, by name: the `request`, a `job`, the `file`; `none`: the coordinates of
    the file are those of the world."""

    method: str
    """m3c2 or nearest."""
    points: int
    """Points of the cloud."""
    without_deviation: int
    """Points, or core points, to which the reference has nothing within reach."""
    without_sign: int
    """Deviations whose side is unknown: beside holes of a mesh, at what is no surface. They count as positive."""
    positive_side: Literal["stated", "instruments", "up", "arbitrary", "reference"]
    """What says which side of the reference is positive: the request, the instruments' places, above a terrain, the
    sides of the mesh or planes; `arbitrary`: nothing does, and all signs could be the opposite ones."""
    figures: DeviationFigures
    """All deviations; of `m3c2` those of core points that both clouds have points at."""
    histogram: DeviationHistogram
    """Of the deviations."""
    m3c2: M3C2Figures | None
    """Null: another method."""
    mesh: MeshFigures | None
    """Null: no mesh."""
    planes: list[PlaneFigures]
    """By plane, as in the request."""
    pattern: PatternFigures | None
    """Null: no raster was wanted."""
    deviations: list[Artifact] | None = Field(default=None, exclude_if=lambda value: value is None)
    """Points with their deviations, when wanted."""
    artifacts: list[Artifact]
    """Histogram, picture, maps and grids."""
    remarks: list[str]
    """What a reader of the figures must know."""
    provenance: CompareProvenance
    """What was done with what."""
