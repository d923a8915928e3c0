"""Liveness and readiness."""

from typing import cast

from fastapi import Request, Response

from schemas.resources.health import Liveness, Readiness
from service.routes.readable_router import ReadableRouter
from service.use_cases.limits.check_readiness import ReadinessWatch

LOOK_AGAIN_S = "10"
"""When to ask again: what is restarted is back in seconds."""
router = ReadableRouter(tags=["health"])


@router.get("/healthz", summary="Does the process live?")
async def healthz() -> Liveness:
    """Answer."""
    return Liveness()


@router.get("/readyz", summary="Can jobs be taken and run?", responses={503: {"model": Readiness}})
async def readyz(request: Request, response: Response) -> Readiness:
    """Check database, storage and workers, at most once a second; 503 when one of them is missing."""
    readiness = await cast("ReadinessWatch", request.app.state.readiness).readiness()
    if readiness.status != "ready":
        response.status_code = 503
        response.headers["Retry-After"] = LOOK_AGAIN_S
    return readiness
