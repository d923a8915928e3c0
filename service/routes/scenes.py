"""What a viewer shows of a job."""

from fastapi import Response

from schemas.results.scene import ServedScene
from service.dependencies import AdaptersDependency
from service.routes.downloads import DOWNLOAD_RESPONSES, Download
from service.routes.paging import LimitParameter, OffsetParameter
from service.routes.problems import PROBLEM_RESPONSES
from service.routes.readable_router import ReadableRouter
from service.use_cases.jobs.find_job import find_job
from service.use_cases.jobs.find_scene import MOST_STATIONS, find_points, find_scene

router = ReadableRouter(tags=["jobs"], responses=PROBLEM_RESPONSES)


@router.get(
    "/jobs/{job_id}/scene", summary="What a viewer shows of a registration or comparison", response_model=ServedScene
)
def get_scene(
    job_id: str, adapters: AdaptersDependency, limit: LimitParameter = MOST_STATIONS, offset: OffsetParameter = 0
) -> Response:
    """Give stations, their poses before and after, features, possible poses of each pair, and where the points are.

    Of a large network `limit` (100 at most) and `offset` choose stations, with the pairs among them; smaller ones are
    given whole. Of a comparison: where its coloured points are, and what their colours say.
    """
    scene = find_scene(job_id, adapters.jobs, adapters.blobs, limit, offset)
    return Response(scene.model_dump_json(by_alias=True), media_type="application/json")


@router.get(
    "/jobs/{job_id}/scene/points/{number}", summary="Points of one station for a viewer", responses=DOWNLOAD_RESPONSES
)
def get_scene_points(job_id: str, number: int, adapters: AdaptersDependency) -> Response:
    """Send the blocks of points of a station, by its number from 0, or the range of them that was asked for."""
    found = find_points(job_id, number, adapters.jobs, adapters.blobs)
    job = find_job(job_id, adapters.jobs)
    return Download(
        found,
        identity=f"{job_id}-points-{number}",
        modified=job.finished or job.created,
        media_type="application/octet-stream",
    )
