"""The landing page and what the service conforms to."""

from pydantic import Field

from schemas.values.base import ResponseModel
from schemas.values.links import Link


class LandingPage(ResponseModel):
    """Where to find what."""

    title: str
    """Name of the service."""
    description: str
    """What it is, in words."""
    version: str
    """Version of the service."""
    links: list[Link]
    """Where to go from here."""


class Conformance(ResponseModel):
    """Conformance classes that the service declares."""

    conforms_to: list[str] = Field(serialization_alias="conformsTo")
    """URIs of the conformance classes."""
