"""What a viewer shows of a job: its scene, and the points of its stations."""

import json
from contextlib import suppress
from pathlib import Path

from schemas.results.scene import Scene, SceneCloud, ServedScene, StoredScene
from service.errors import ArtifactNotFoundError, ResultNotReadyError
from service.names.scene_keys import scene_key
from service.ports import BlobStore, JobStatus, JobStore, Json
from service.use_cases.jobs.find_job import find_job

SCENE = "scene"
"""What it is called in messages."""


def find_scene(job_id: str, jobs: JobStore, blobs: BlobStore) -> ServedScene:
    """Give the scene of a job, and where the points of its stations are.

    Raises
    ------
    NoSuchJobError
        There is no such job.
    ResultNotReadyError
        It has not finished.
    ArtifactNotFoundError
        It is none that registers or compares, or was made before there were scenes.
    """
    stored = _stored(job_id, jobs, blobs)
    clouds = []
    for number, station in enumerate(stored.stations):
        # a job that was begun by an older version has none
        blocks = _listed(stored.points[number][1], blobs) if number < len(stored.points) else None
        href = None if blocks is None else f"/jobs/{job_id}/scene/points/{number}"
        clouds.append(SceneCloud(station=station.name, href=href, blocks=blocks))
    shown = {name: getattr(stored, name) for name in Scene.model_fields}
    return ServedScene(**shown, clouds=clouds)


def find_points(job_id: str, number: int, jobs: JobStore, blobs: BlobStore) -> Path:
    """Find the blocks of points of one station.

    Raises
    ------
    NoSuchJobError
        There is no such job.
    ResultNotReadyError
        It has not finished.
    ArtifactNotFoundError
        It has no such station, or the points are gone with the file that was uploaded.
    """
    stored = _stored(job_id, jobs, blobs)
    if 0 <= number < len(stored.points):
        with suppress(FileNotFoundError):
            return blobs.local_path(stored.points[number][0])
    raise ArtifactNotFoundError(job_id, f"{SCENE}/points/{number}")


def _stored(job_id: str, jobs: JobStore, blobs: BlobStore) -> StoredScene:
    job = find_job(job_id, jobs)
    if job.status is not JobStatus.SUCCESSFUL:
        raise ResultNotReadyError(job_id, job.status.value)
    try:
        return StoredScene.model_validate_json(blobs.local_path(scene_key(job_id)).read_bytes())
    except FileNotFoundError:
        raise ArtifactNotFoundError(job_id, SCENE) from None


def _listed(key: str, blobs: BlobStore) -> Json | None:
    try:
        found: Json = json.loads(blobs.local_path(key).read_bytes())
    except FileNotFoundError:
        return None
    return found
