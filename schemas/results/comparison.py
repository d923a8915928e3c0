"""Registered poses beside reference poses (API section 4; the dissertation's table 4.2)."""

from pydantic import Field

from schemas.values.poses import Document


class ComparedParameter(Document):
    """One parameter beside its reference."""

    station: str
    """Name of the station."""
    parameter: str
    """Which of the six parameters."""
    estimated: float
    """Value from the scans [gon or m]."""
    reference: float
    """Value of the reference [gon or m]."""
    difference: float = Field(description="Estimated minus reference; angles the short way round.")
    std: float | None = Field(description="Standard deviation of the estimate.")
    reference_std: float | None = Field(description="Standard deviation of the reference; null: none was given.")
    difference_std: float | None = Field(description="Both together.")
    ratio: float | None = Field(description="|difference| over its standard deviation.")
    significant: bool | None = Field(description="Whether the ratio exceeds the limit; null: no standard deviation.")


class JointTest(Document):
    """Chi-square test of all parameters together."""

    statistic: float
    """Sum of squared differences, weighted by both covariances."""
    degrees_of_freedom: int
    """Its degrees of freedom."""
    critical: float
    """Limit of the statistic."""
    p_value: float
    """Probability of a larger statistic where nothing is wrong."""
    significant: bool
    """Whether the limit is exceeded."""


class StationComparison(Document):
    """A station beside its reference, in a few numbers."""

    station: str
    """Name of the station."""
    mean_difference_rotation_gon: float = Field(description="Mean of the angles' absolute differences.")
    mean_difference_translation_m: float = Field(description="Mean of the shifts' absolute differences.")
    rotation_gon: float = Field(description="Angle of the rotation between both.")
    translation_m: float = Field(description="Length of the difference of the translations.")
    confidence_level: float
    """Of the tests, 0 to 1."""
    limit: float = Field(description="Of the ratios of single parameters.")
    joint_test: JointTest | None = Field(description="Null: no standard deviations.")
    verdict: str = Field(description="What the tests say, in words.")
