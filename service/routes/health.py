"""Liveness and readiness."""

from fastapi import Response

from schemas.health import Liveness, Readiness
from service.dependencies import WholeServiceDependency
from service.routes.readable_router import ReadableRouter
from service.use_cases.check_readiness import check_readiness

router = ReadableRouter(tags=["health"])


@router.get("/healthz", summary="Does the process live?")
async def healthz() -> Liveness:
    """Answer."""
    return Liveness()


@router.get("/readyz", summary="Can jobs be taken and run?", responses={503: {"model": Readiness}})
def readyz(adapters: WholeServiceDependency, response: Response) -> Readiness:
    """Check database, storage and workers; 503 when one of them is missing."""
    readiness = check_readiness(adapters.jobs, adapters.blobs, adapters.queue)
    response.status_code = 200 if readiness.status == "ready" else 503
    return readiness
