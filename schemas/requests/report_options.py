"""What a request says of its report: whose it is, in which language, and what was ordered."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from schemas.values.base import RequestModel

Line: TypeAlias = Annotated[str, Field(max_length=200, pattern=r"^[^\x00-\x1f\x7f]*$")]
"""One line of text without control characters."""


class ReportOptions(RequestModel):
    """Head and language of the report. Nothing here changes what is computed."""

    project: Line = ""
    """Name of the project, as it stands at the head of the report."""
    client: Line = ""
    """Who ordered the survey."""
    operator: Line = ""
    """Who measured and answers for it."""
    order: Line = ""
    """Number or date of the order."""
    remarks: Annotated[str, Field(max_length=2000, pattern=r"^[^\x00-\x09\x0b-\x1f\x7f]*$")] = ""
    """What else is to stand below the head, such as weather, levelling or adjustments of the instrument; lines are
    kept."""
    lang: Literal["en", "de"] = "en"
    """Language of report.html and report.pdf: `en` or `de`. Reasons that the computation gives stay English."""


class Tolerance(RequestModel):
    """What was ordered, to be compared with what was reached; nothing is computed otherwise because of it."""

    std_m: float | None = Field(default=None, ge=1e-6, le=100.0)
    """Largest standard deviation of position, √(σx² + σy² + σz²), that its registration may give to a point of a
    station, relative to the fixed station [m]. It is compared with what 95 % of the scanned surface keeps, not with its
    middle alone; the scanner's own noise is not in it."""
    std_gon: float | None = Field(default=None, ge=1e-6, le=100.0)
    """Largest standard deviation of the rotation of a station about any axis [gon]."""

    @model_validator(mode="after")
    def _says_something(self) -> "Tolerance":
        if self.std_m is None and self.std_gon is None:
            raise PydanticCustomError("empty_tolerance", "state std_m, std_gon or both, or leave the tolerance out")
        return self
