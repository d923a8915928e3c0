"""What all request and response bodies share."""

from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from pydantic_core import PydanticCustomError


class RequestModel(BaseModel):
    """Refuse unknown fields, NaN and infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, allow_inf_nan=False)


class ResponseModel(BaseModel):
    """Describe what the service answers."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


def _refuse_content(value: Any) -> Any:
    if value is None or value == []:
        return value
    raise PydanticCustomError("not_supported_yet", "not supported yet by this version; leave it out")


NotYetList = Annotated[list[Any], BeforeValidator(_refuse_content), Field(max_length=0)]
"""A list of the contract that this version does not use: only the empty list is accepted."""
