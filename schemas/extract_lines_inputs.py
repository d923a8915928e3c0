"""Inputs of the process `extract-lines`."""

from pydantic import Field

from schemas.base import RequestModel
from schemas.register_inputs import Station


class ExtractLinesInputs(RequestModel):
    """Which scan to extract lines, planes and cylinders from."""

    station: Station = Field(title="Station")
    """The station and its scan."""
