"""Inputs of the process `extract-lines`."""

from typing import TYPE_CHECKING

from pydantic import Field

from algorithms.features.options import FeatureOptions
from schemas.requests.edge_options import PhotoLineOptionsRequest
from schemas.requests.method_options import options_model
from schemas.requests.register_inputs import Station
from schemas.values.base import RequestModel

if TYPE_CHECKING:
    FeatureOptionsRequest = RequestModel
else:
    FeatureOptionsRequest = options_model(FeatureOptions)


class ExtractLinesInputs(RequestModel):
    """Which scan to extract lines, planes and cylinders from, and how."""

    station: Station = Field(title="Station")
    """The station, its scan and the photos taken there."""
    features: FeatureOptionsRequest = Field(default_factory=FeatureOptionsRequest, title="Features")
    """What counts as a feature."""
    photo_lines: PhotoLineOptionsRequest = Field(default_factory=PhotoLineOptionsRequest, title="Lines from photos")
    """Which edges of the photos become lines in space."""
