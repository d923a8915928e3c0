"""Inputs of the process `extract-lines`."""

from typing import TYPE_CHECKING

from pydantic import Field

from algorithms.features.options import FeatureOptions
from schemas.base import RequestModel
from schemas.edge_options import PhotoLineOptionsRequest
from schemas.method_options import options_model
from schemas.register_inputs import Station

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
