"""What a finished `register` job says of the poses of its stations."""

import json
from collections.abc import Mapping

from service.errors import InvalidRequestError
from service.names.result_lists import placed_key
from service.ports import Json, StepContext


def read_poses(context: StepContext, arguments: Json) -> Json:
    """Give the poses of stations, by job and name: ``{"matrix", "covariance"}``, or ``{"reason"}`` where there is none.

    Raises
    ------
    InvalidRequestError
        A job is gone meanwhile, or none of the stations has a pose.
    """
    poses: dict[str, dict[str, Json]] = {}
    known: dict[str, Mapping[str, Json]] = {}
    for job_id, name in arguments["stations"]:
        if job_id not in known:
            known[job_id] = {station["name"]: station for station in job_result(context, job_id)["stations"]}
        poses.setdefault(job_id, {})[name] = _pose(known[job_id].get(name), name)
    found = [pose for of_job in poses.values() for pose in of_job.values()]
    if all("reason" in pose for pose in found):
        raise InvalidRequestError(f"none of the stations has a pose: {found[0]['reason']}")
    return {"poses": poses}


def job_result(context: StepContext, job_id: str) -> Json:
    """Give the result document of a finished job; of a registration with the covariances of poses, pairs and network.

    Raises
    ------
    InvalidRequestError
        It has been removed.
    """
    try:
        return result_with_stations(context, f"jobs/{job_id}/result.json")
    except FileNotFoundError:
        raise InvalidRequestError(f"job '{job_id}', whose result is needed, has been removed meanwhile") from None


def result_with_stations(context: StepContext, key: str) -> Json:
    """Read a result document; of a large network with its stations and features, which do not stand in it.

    Parameters
    ----------
    context
        Of the step.
    key
        Of the document.

    Raises
    ------
    FileNotFoundError
        It has been removed.
    """
    document: Json = json.loads(context.blobs.local_path(key).read_bytes())
    if document.get("lists"):
        document |= json.loads(context.blobs.local_path(placed_key(key.split("/")[1])).read_bytes())
    return document


def _pose(station: Json | None, name: str) -> Json:
    if station is None:
        return {"reason": f"the job has no station '{name}'"}
    pose = station["world_from_scan"]
    if pose is None:
        return {"reason": f"'{name}' is {station['status']}: {station.get('reason') or 'no reason is given'}"}
    if pose.get("undetermined"):
        return {"reason": f"'{name}' has no determined pose: {pose['undetermined']}"}
    return {"matrix": pose["matrix"], "covariance": pose["covariance"]}
