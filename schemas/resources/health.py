"""Liveness and readiness."""

from typing import Literal

from schemas.values.base import ResponseModel


class Liveness(ResponseModel):
    """The process answers."""

    status: Literal["ok"] = "ok"
    """It answers."""


class Check(ResponseModel):
    """One thing the service needs."""

    ok: bool
    """Whether it is as it should be."""
    detail: str
    """What was found."""


class Readiness(ResponseModel):
    """Whether the service can take and run jobs now."""

    status: Literal["ready", "not-ready"]
    """Whether it is ready."""
    checks: dict[str, Check]
    """database, storage and workers; `open3d` where a library is missing without which some processes cannot run."""
