"""Stations of finished jobs in the place of those that a request would list."""

from collections.abc import Iterator
from typing import Any, TypeVar

from pydantic import BaseModel

from schemas.requests.posed_stations import PosedStation, PoseOfJob, StationsOfJob
from schemas.requests.register_inputs import Station
from service.errors import FieldFault, InvalidRequestError
from service.names.identifiers import is_identifier
from service.ports import Job, JobStatus, JobStore, Stored
from service.use_cases.inputs.validate_request import WRONG_FIELDS, pointer_to

ModelT = TypeVar("ModelT", bound=BaseModel)
GIVES_POSES = "register"


def with_stations_of_jobs(inputs: ModelT, stored: Stored) -> ModelT:
    """Put in the place of every job whose stations are wanted the stations themselves; each gets its pose of that job.

    Raises
    ------
    InvalidRequestError
        With a pointer to every job that is not there, gives no poses, or has no such station.
    """
    changed: dict[str, Any] = {}
    faults: list[FieldFault] = []
    for name in type(inputs).model_fields:
        given, where = getattr(inputs, name), pointer_to("inputs", name)
        if isinstance(given, StationsOfJob):
            found = _job(given.job_id, stored.jobs)
            if isinstance(found, str):
                faults.append(FieldFault(f"{where}/jobID", found))
                continue
            stations = _stations(found)
            wanted = stations if given.names is None else {each: stations.get(each) for each in given.names}
            faults += [
                FieldFault(f"{where}/names/{k}", f"job '{given.job_id}' has no station '{each}'")
                for k, each in enumerate(wanted)
                if wanted[each] is None
            ]
            changed[name] = [station for station in wanted.values() if station is not None]
        elif isinstance(given, list):
            for k, station in enumerate(given):
                pose = station.world_from_scan if isinstance(station, PosedStation) else None
                if isinstance(pose, PoseOfJob):
                    faults += _pose_faults(station.name, pose, stored.jobs, f"{where}/{k}/world_from_scan")
    most = stored.settings.max_stations
    for name in type(inputs).model_fields:
        stations = changed.get(name, getattr(inputs, name))
        if isinstance(stations, list) and len(stations) > most and _are_stations(stations):
            detail = f"{len(stations)} stations, the limit of this service is {most}"
            faults.append(FieldFault(pointer_to("inputs", name), detail))
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)
    return inputs.model_copy(update=changed) if changed else inputs


def _are_stations(given: list[Any]) -> bool:
    return isinstance(given[0], PosedStation | Station)


def _pose_faults(own_name: str, pose: PoseOfJob, jobs: JobStore, where: str) -> Iterator[FieldFault]:
    found = _job(pose.job_id, jobs)
    name = pose.station or own_name
    if isinstance(found, str):
        yield FieldFault(f"{where}/jobID", found)
    elif name not in _stations(found):
        yield FieldFault(where, f"job '{pose.job_id}' has no station '{name}'")


def _job(job_id: str, jobs: JobStore) -> Job | str:
    """Give a job that has poses, or what is wrong with it."""
    job = jobs.whole(job_id) if is_identifier(job_id) else None
    if job is None:
        return f"there is no job '{job_id}'"
    if job.process_id != GIVES_POSES:
        return f"job '{job_id}' is of the process '{job.process_id}': only those of '{GIVES_POSES}' give poses"
    if job.status is not JobStatus.SUCCESSFUL:
        return f"job '{job_id}' is {job.status.value}: it has no poses"
    return job


def _stations(job: Job) -> dict[str, PosedStation]:
    """Give what a job says of its stations, by name, each with its pose of that job."""
    pose = {"jobID": job.id}
    return {
        station["name"]: PosedStation.model_validate(
            {**{key: station[key] for key in ("name", "scan", "photos") if key in station}, "world_from_scan": pose}
        )
        for station in job.inputs["stations"]
    }
