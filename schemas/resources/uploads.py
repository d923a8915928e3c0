"""Resumable uploads."""

from datetime import datetime
from typing import Literal

from schemas.values.base import ResponseModel
from schemas.values.links import Link
from schemas.values.problem import ProblemDocument


class UploadDocument(ResponseModel):
    """One resumable upload and how far it is."""

    id: str
    """Also the id of the file that it becomes."""
    name: str
    """As its owner called it."""
    length: int
    """Bytes of the whole file."""
    offset: int
    """Bytes that have arrived; continue here."""
    status: Literal["receiving", "finishing", "finished", "refused"]
    """`receiving` bytes; `finishing`: all are there and being inspected; `finished`: there is a `file`; `refused`: they
    are no file that can be used, `problem` says why."""
    file: str | None
    """Id of the file; null: there is none (yet)."""
    problem: ProblemDocument | None
    """Why it was refused."""
    created: datetime
    """When it was begun."""
    expires: datetime
    """When the service removes the upload unless it goes on; the file stays."""
    links: list[Link]
    """Where to go from here."""
