"""Result document of the process `register` (API section 4)."""

from typing import Any

from pydantic import ConfigDict, Field

from schemas.poses import Document, Pose, Row4


class Coarse(Document):
    """Registration without first guess: the hypothesis that won."""

    target_from_source: tuple[Row4, Row4, Row4, Row4]
    support: int = Field(description="Lines and planes that both scans see in this pose.")
    score: float = Field(description="Share of the surface that fits, less a penalty for violated free space, to 1.")
    runner_up_support: int | None = Field(description="The same count for the best clearly different pose.")
    runner_up_score: float | None
    runner_up_target_from_source: tuple[Row4, Row4, Row4, Row4] | None = None
    hypotheses_tested: int


class GlobalTest(Document):
    """Two-sided chi-square test of the sum of squared residuals."""

    statistic: float
    lower: float
    upper: float
    alpha: float
    passed: bool


class Adjustment(Document):
    """Figures of the fine registration."""

    model: str
    observations: int = Field(description="Conditions, four for each used line.")
    independent_observations: int = Field(
        description="Rank of their covariance: fewer than the conditions where lines share planes."
    )
    unknowns: int
    rank: int
    redundancy: int
    sigma0_prior: float
    sigma0: float | None
    iterations: int
    converged: bool
    global_test: GlobalTest | None
    test_variance_factor: float = Field(
        description="Variance factor that the tests of single lines and planes allow for (robust estimate, at least 1)."
    )
    largest_external_effects: dict[str, float] = Field(
        description="Largest effect of an error that stays undetected on each parameter (rad, m)."
    )


class LineTest(Document):
    """Test of a line as a whole."""

    statistic: float
    degrees_of_freedom: float
    critical: float


class Correspondence(Document):
    """Two lines taken for one, and how well they agree."""

    target_line: str
    source_line: str
    source: str = Field(description="plane-intersection, cylinder-axis or photo-edge")
    angle_gon: float
    distance_m: float
    residuals: list[float] = Field(description="Two tilts (rad) and two offsets (m).")
    normalised: list[float | None] = Field(description="Residual over its standard deviation; null: not controlled.")
    redundancy: float = Field(description="Sum of the four redundancy numbers, 0 to 4.")
    test: LineTest | None
    mdb: list[float | None] = Field(description="Minimal detectable blunder of each residual (rad, rad, m, m).")
    state: str = Field(description="used, removed, reinstated or not-controlled")


class PlaneCorrespondence(Document):
    """Two planes taken for one, observed beside the lines."""

    target_plane: str
    source_plane: str
    angle_gon: float
    distance_m: float
    statistic: float = Field(description="Test value of the pair, chi-square distributed.")
    degrees_of_freedom: float
    state: str = Field(description="used, removed, reinstated or not-controlled")


class Outlier(Document):
    """A pair of lines that was removed (or put back), when and why."""

    line: str
    kind: str = Field(description="line or plane")
    step: int
    statistic: float
    change: str = Field(description="removed or reinstated")
    why: str


class Accuracy(Document):
    """Summary under the names of the dissertation's tables."""

    mean_std_rotation_gon: float | None
    mean_std_translation_m: float | None
    max_angle_gon: float | None
    max_distance_m: float | None


class WeakDirection(Document):
    """A direction that the lines determine badly or not at all."""

    text: str
    std_m: float | None = Field(description="Standard deviation; null: not determined.")
    advice: str


class Overlap(Document):
    """How the surfaces of both scans fit in the registered position."""

    model_config = ConfigDict(validate_by_name=True, validate_by_alias=True)

    fraction_0_5m: float | None = Field(alias="fraction_0.5m", description="Share of points with a partner that near.")
    fraction_0_1m: float | None = Field(alias="fraction_0.1m")
    rms_m: float | None = Field(description="Point-to-plane, of points within 0.1 m; null: there are none.")
    free_space_violations: float | None = Field(
        description="Share of surface that stands where the other instrument looked through; null: its position is "
        "unknown."
    )


class Pair(Document):
    """What came out for two stations."""

    target: str
    source: str
    status: str = Field(description="accepted, doubtful, rejected, ambiguous or degenerate")
    reasons: list[str]
    target_from_source: Pose | None
    coarse: Coarse | None
    adjustment: Adjustment | None
    correspondences: list[Correspondence]
    plane_correspondences: list[PlaneCorrespondence]
    outliers: list[Outlier]
    accuracy: Accuracy | None
    weak_directions: list[WeakDirection]
    overlap: Overlap | None
    timings_s: dict[str, float]


class Station(Document):
    """A station in the common frame."""

    name: str
    status: str = Field(description="fixed, registered or unregistered")
    reason: str | None = Field(default=None, description="Why it could not be registered.")
    world_from_scan: Pose | None


class FeatureCount(Document):
    """How many features a scan gave."""

    station: str
    points: int
    lines: int
    planes: int
    cylinders: int
    noise_std_m: float


class ComparedParameter(Document):
    """One parameter beside its reference."""

    station: str
    parameter: str
    estimated: float
    reference: float
    difference: float
    std: float | None


class Artifact(Document):
    """A download."""

    name: str
    type: str
    bytes: int
    href: str


class InputFile(Document):
    """A file that went in."""

    station: str
    file: str
    index: int
    sha256: str


class Provenance(Document):
    """What was done with what."""

    software: str
    method: dict[str, Any]
    seed: int
    inputs: list[InputFile]
    timings_s: dict[str, float]


class RegistrationDocument(Document):
    """Answer of `register`."""

    status: str = Field(description="registered, partly-registered or not-registered")
    stations: list[Station]
    pairs: list[Pair]
    features: list[FeatureCount]
    comparison: list[ComparedParameter] | None
    artifacts: list[Artifact]
    provenance: Provenance
