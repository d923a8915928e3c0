"""Registered poses beside reference poses (API section 4; the dissertation's table 4.2)."""

from pydantic import Field

from schemas.poses import Document


class ComparedParameter(Document):
    """One parameter beside its reference."""

    station: str
    parameter: str
    estimated: float
    reference: float
    difference: float = Field(description="Estimated minus reference; angles the short way round.")
    std: float | None = Field(description="Standard deviation of the estimate.")
    reference_std: float | None = Field(description="Standard deviation of the reference; null: none was given.")
    difference_std: float | None = Field(description="Both together.")
    ratio: float | None = Field(description="|difference| over its standard deviation.")
    significant: bool | None = Field(description="Whether the ratio exceeds the limit; null: no standard deviation.")


class JointTest(Document):
    """Chi-square test of all parameters together."""

    statistic: float
    degrees_of_freedom: int
    critical: float
    p_value: float
    significant: bool


class StationComparison(Document):
    """A station beside its reference, in a few numbers."""

    station: str
    mean_difference_rotation_gon: float = Field(description="Mean of the angles' absolute differences.")
    mean_difference_translation_m: float = Field(description="Mean of the shifts' absolute differences.")
    rotation_gon: float = Field(description="Angle of the rotation between both.")
    translation_m: float = Field(description="Length of the difference of the translations.")
    confidence_level: float
    limit: float = Field(description="Of the ratios of single parameters.")
    joint_test: JointTest | None = Field(description="Null: no standard deviations.")
    verdict: str = Field(description="What the tests say, in words.")
