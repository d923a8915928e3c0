"""What was ordered beside what was reached."""

from pydantic import Field

from schemas.results.result_lists import comes_in_pages
from schemas.values.poses import Document


class StationPrecision(Document):
    """How well the points of a station are known relative to the fixed one, by its pose alone."""

    station: str
    """Name of the station."""
    std_m: float | None = Field(
        description="Standard deviation of position, √(σx² + σy² + σz²), that 95 % of its surface keeps; null: not "
        "determined."
    )
    middle_std_m: float | None = Field(description="The same in the middle of its surface.")
    std_gon: float | None = Field(description="Of its rotation about the worst axis; null: not determined.")
    within: bool | None = Field(description="Whether it keeps the tolerance; null: none was stated, or not determined.")


class ToleranceReason(Document):
    """One thing that stands against a tolerance being kept."""

    code: str = Field(
        description="beyond: a station exceeds it; no-pose, no-figure: a station has none; confirmed: a registration "
        "was doubtful by itself; contradicted: targets or control contradict the scans of a station; not-settled: an "
        "adjustment did not come to rest"
    )
    name: str = Field(description="The station, or source → target of a registration.")


class ToleranceCheck(Document):
    """Whether the order is kept."""

    model_config = comes_in_pages("stations", "reasons")

    std_m: float | None
    """As ordered [m]; null: nothing was ordered."""
    std_gon: float | None
    """As ordered [gon]; null: nothing was ordered."""
    reached_std_m: float | None
    """Largest of all stations [m]; null: not determined for all of them."""
    reached_std_gon: float | None
    """Largest of all stations [gon]; null: not determined for all of them."""
    verdict: str = Field(
        description="met; not-met; not-determined: a station has no pose, or no standard deviation; not-confirmed: the "
        "figures keep it, but registrations that were not accepted by themselves, or an adjustment that did not "
        "settle, carry them; none: nothing was ordered"
    )
    reasons: list[ToleranceReason]
    """What stands against `met`."""
    stations: list[StationPrecision]
    """Each station but the fixed one."""
