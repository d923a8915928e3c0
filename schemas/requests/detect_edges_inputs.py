"""Inputs of the process `detect-edges`."""

from pydantic import Field

from schemas.requests.edge_options import EdgeOptionsRequest
from schemas.values.base import RequestModel
from schemas.values.photos import PhotoReference


class DetectEdgesInputs(RequestModel):
    """Which photo to find straight edges in, and how."""

    photo: PhotoReference = Field(title="Photo")
    """The photo; with its camera the lens distortion is removed from the edges."""
    edges: EdgeOptionsRequest = Field(default_factory=EdgeOptionsRequest, title="Edges")
    """What counts as a straight edge."""
