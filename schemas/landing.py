"""The landing page and what the service conforms to."""

from pydantic import Field

from schemas.base import ResponseModel
from schemas.links import Link


class LandingPage(ResponseModel):
    """Where to find what."""

    title: str
    description: str
    version: str
    links: list[Link]


class Conformance(ResponseModel):
    """Conformance classes that the service declares."""

    conforms_to: list[str] = Field(serialization_alias="conformsTo")
    """URIs of the conformance classes."""
