"""Problem documents (RFC 9457): every error of the service has this body."""

from pydantic import BaseModel, ConfigDict


class FieldFaultDocument(BaseModel):
    """One bad field of a request."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    pointer: str
    """JSON pointer (RFC 6901) into the request body; for a form, the name of its field first."""
    detail: str
    """What is wrong with it."""


class ProblemDocument(BaseModel):
    """What went wrong."""

    model_config = ConfigDict(use_attribute_docstrings=True, extra="allow")

    type: str
    """URI of the kind of problem; the OGC exception type where the standard names one."""
    title: str
    """Short name of the kind of problem."""
    status: int
    """HTTP status."""
    detail: str
    """What happened, and what to do about it."""
    instance: str | None = None
    """Path of the request."""
    errors: list[FieldFaultDocument] | None = None
    """Every bad field of the request."""
