"""Inputs of the process `extract-lines`."""

from typing import TYPE_CHECKING

from pydantic import Field

from algorithms.features.options import FeatureOptions
from schemas.base import RequestModel
from schemas.method_options import options_model
from schemas.register_inputs import Station

if TYPE_CHECKING:
    FeatureOptionsRequest = RequestModel
else:
    FeatureOptionsRequest = options_model(FeatureOptions)


class ExtractLinesInputs(RequestModel):
    """Which scan to extract lines, planes and cylinders from, and how."""

    station: Station = Field(title="Station")
    """The station and its scan."""
    features: FeatureOptionsRequest = Field(default_factory=FeatureOptionsRequest, title="Features")
    """What counts as a feature."""
