"""What all request and response bodies share."""

from pydantic import BaseModel, ConfigDict


class RequestModel(BaseModel):
    """Refuse unknown fields, NaN and infinity."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, use_attribute_docstrings=True, allow_inf_nan=False, defer_build=True
    )


class ResponseModel(BaseModel):
    """Describe what the service answers."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, defer_build=True)
