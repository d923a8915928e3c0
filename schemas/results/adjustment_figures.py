"""Figures of the adjustment of one pair (API section 4)."""

from pydantic import Field

from schemas.results.correspondences import ExternalEffect, Triple
from schemas.values.poses import Document, Row6


class GlobalTest(Document):
    """Two-sided chi-square test of the sum of squared residuals."""

    statistic: float
    """Sum of squared residuals, weighted."""
    degrees_of_freedom: int
    """Its degrees of freedom."""
    lower: float
    """Lower limit."""
    upper: float
    """Upper limit."""
    alpha: float
    """Level of the test."""
    passed: bool
    """Whether the statistic is within its limit."""
    side: str = Field(description="accepted, too-large or too-small")
    meaning: str = Field(description="The verdict in words.")


class TestLevels(Document):
    """Levels and limits of the tests, as used."""

    confidence_level: float = Field(description="Of the global test: 1 minus its level.")
    alpha_single: float = Field(description="Probability that a good component, line or plane fails its test.")
    power: float = Field(description="Probability with which an error of the smallest detectable size is found.")
    normalised_critical: float = Field(description="Limit of |normalised|, sigma0 known a priori.")
    tau_critical: float | None = Field(
        description="Limit of |normalised| / sigma0 where sigma0 is estimated (Pope); null: too little redundancy."
    )
    line_critical: float = Field(description="Limit of a whole line's statistic, four degrees of freedom.")
    b_method_alpha: float = Field(
        description="Level of the B-method's limit of a whole line, as sure to find an error as a component's test."
    )


class Adjustment(Document):
    """Figures of the fine registration."""

    model: str
    """Functional model, in words."""
    datum: str = Field(description="What defines the frame in which the pose and its standard deviations are given.")
    observations: int = Field(description="Conditions: four for each used line, three for each used plane.")
    independent_observations: int = Field(
        description="Rank of their covariance: fewer than the conditions where lines share planes."
    )
    unknowns: int
    """Number of unknowns."""
    defect: int = Field(description="Parameters that the geometry leaves free: unknowns minus rank.")
    rank: int
    """Parameters that the geometry determines."""
    redundancy: int
    """Observations more than needed."""
    sigma0_prior: float
    """Standard deviation of unit weight a priori."""
    sigma0: float | None = Field(description="A posteriori; null: no redundancy.")
    variance_factor: float = Field(
        description="By which the covariance of the pose was multiplied: sigma0 squared where residuals are too large."
    )
    iterations: int
    """Rounds until nothing changed any more."""
    converged: bool
    """Whether it came to rest within the rounds allowed."""
    global_test: GlobalTest | None
    """Test of the sum of squared residuals; null: no redundancy."""
    levels: TestLevels
    """Levels and limits of all tests."""
    test_variance_factor: float = Field(
        description="Variance factor that the tests of single lines and planes allow for (robust estimate, at least 1)."
    )
    largest_external_effects: ExternalEffect | None = Field(
        description="Largest effect of an error that stays undetected anywhere; null: nothing is controlled."
    )


class FreeMotion(Document):
    """A motion that the geometry leaves free."""

    text: str
    """What it is, in words."""
    vector: Row6 | None = Field(description="Rotation vector (rad) and translation (m); null: found before any pose.")


class PrincipalMotion(Document):
    """One of the independent motions in which the pose is known."""

    text: str
    """What it is, in words."""
    std_m: float = Field(description="Turns as the shift they cause at the features' rms distance.")
    turn: Triple = Field(description="Rotation vector times that distance; unit length together with the shift.")
    shift: Triple = Field(description="Shift of the centroid.")


class RankReport(Document):
    """What the geometry determines, and what not."""

    rank: int | None = Field(description="Determined parameters; null: no pose was looked for.")
    expected: int
    """Parameters of a pose that is fully determined: six."""
    null_space: list[FreeMotion]
    """Motions that the geometry leaves free."""
    advice: str = Field(description="What to add; empty at full rank.")
    weakest_shift_ratio: float | None = Field(
        description="Information on the weakest shift over what noise alone would pretend: below 10 free, below 1000 "
        "weak; null: noise pretends nothing."
    )
    features_radius_m: float | None = Field(description="Rms distance of the features from their centroid.")
    determined: list[PrincipalMotion] = Field(description="Independent motions, worst first, as many as the rank.")


class WeakDirection(Document):
    """A direction that the lines determine badly or not at all."""

    text: str
    """What it is, in words."""
    std_m: float | None = Field(description="Standard deviation; null: not determined.")
    advice: str
    """What to do about it."""


class LineCounts(Document):
    """Corresponding lines in the adjustment by kind."""

    plane_intersections: int
    """Lines in which two planes meet."""
    cylinder_axes: int
    """Axes of cylinders."""
    photo_edges: int
    """Lines that only photos show."""
    removed: int = Field(description="Not in the other numbers.")


class Accuracy(Document):
    """Summary under the names of the dissertation's tables."""

    mean_std_rotation_gon: float | None
    """Mean standard deviation of the three angles [gon]."""
    max_std_rotation_gon: float | None
    """Largest standard deviation of an angle [gon]."""
    mean_std_translation_m: float | None
    """Mean standard deviation of the three shifts [m]."""
    max_std_translation_m: float | None
    """Largest standard deviation of a shift [m]."""
    max_angle_gon: float | None = Field(description="Between corresponding lines after the transformation.")
    max_distance_m: float | None = Field(
        description="Largest shortest distance of corresponding lines, taken as endless (dissertation, eq. 4.17)."
    )
    max_offset_m: float | None = Field(
        description="Largest distance of corresponding lines in the middle of the piece that both scans see."
    )
    max_normalised: float | None = Field(description="Largest |NV|, with the estimated sigma0 (eq. 3.11).")
    share_normalised_beyond_1_96: float | None = Field(
        description="Share of |NV| above 1.96: 5 % where all is well. For comparison only; nothing is decided by it."
    )
    sigma0: float | None
    """Standard deviation of unit weight a posteriori; null: no redundancy."""
    iterations: int
    """Rounds until nothing changed any more."""
    lines: LineCounts
    """Lines in the adjustment, by kind."""
