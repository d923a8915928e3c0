"""The methods that `register` offers, each with its options."""

from typing import Annotated, Literal

from pydantic import Field

from schemas.base import RequestModel


class AutoMethod(RequestModel):
    """Let the service choose the method; its defaults hold."""

    method: Literal["auto"] = "auto"
    """Name of the method."""


class LinesMethod(RequestModel):
    """Placeholder in this working copy only."""

    method: Literal["lines"] = "lines"


MethodRequest = Annotated[AutoMethod | LinesMethod, Field(discriminator="method")]
