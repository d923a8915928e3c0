"""What a viewer shows of a job: its scene, and the points of its stations."""

import json
from contextlib import suppress
from pathlib import Path

from schemas.results.scene import (
    Matrix,
    Scene,
    SceneCloud,
    ScenePages,
    ScenePair,
    SceneStage,
    SceneStation,
    ServedScene,
    StoredScene,
)
from service.errors import ArtifactNotFoundError, ResultNotReadyError
from service.names.scene_keys import SCENE_PAIRS, SCENE_POINTS, SCENE_STATIONS, scene_key
from service.ports import BlobStore, JobStatus, JobStore, Json
from service.use_cases.jobs.find_job import find_job
from service.use_cases.jobs.find_rows import KeptRows

UNMOVED: Matrix = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
SCENE = "scene"
"""What it is called in messages."""


MOST_STATIONS = 100
"""Of a large network at once: what a browser shows."""


def find_scene(
    job_id: str, jobs: JobStore, blobs: BlobStore, limit: int = MOST_STATIONS, offset: int = 0
) -> ServedScene:
    """Give the scene of a job, and where the points of its stations are.

    Parameters
    ----------
    job_id, jobs, blobs
        The job, and where it is kept.
    limit, offset
        Which of its stations a large network shows, with the pairs among them; smaller ones show all.

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
    count, first = len(stored.stations), 0
    if stored.pages is not None:
        count, first = stored.pages.stations, offset
        stored = _part(job_id, stored, stored.pages, blobs, range(offset, offset + min(limit, MOST_STATIONS)))
    clouds = []
    for number, station in enumerate(stored.stations):
        # a job that was begun by an older version has none
        blocks = _listed(stored.points[number][1], blobs) if number < len(stored.points) else None
        href = None if blocks is None else f"/jobs/{job_id}/scene/points/{first + number}"
        clouds.append(SceneCloud(station=station.name, href=href, blocks=blocks))
    shown = {name: getattr(stored, name) for name in Scene.model_fields}
    return ServedScene(**shown, clouds=clouds, station_count=count, first_station=first)


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
    if stored.pages is not None and 0 <= number < stored.pages.clouds:
        kept = KeptRows(blobs, job_id, SCENE_POINTS, stored.pages.clouds)
        stored, number = stored.model_copy(update={"points": [json.loads(*kept.rows(number, number + 1))]}), 0
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


def _part(job_id: str, stored: StoredScene, pages: ScenePages, blobs: BlobStore, shown: range) -> StoredScene:
    """Give some stations of a large network, the pairs among them, and where the stations lay first and last."""
    kept = KeptRows(blobs, job_id, SCENE_STATIONS, pages.stations)
    stations = [SceneStation.model_validate_json(row) for row in kept.rows(shown.start, shown.stop)]
    kept = KeptRows(blobs, job_id, SCENE_PAIRS, len(pages.pairs))
    numbers = [number for number, pair in enumerate(pages.pairs) if all(station in shown for station in pair)]
    clouds = KeptRows(blobs, job_id, SCENE_POINTS, pages.clouds)
    names = {station.name for station in stations}
    placed = {each.name: each.world_from_scan for each in stations if each.world_from_scan is not None}
    return stored.model_copy(
        update={
            "stations": stations,
            "pairs": [ScenePair.model_validate_json(row) for row in kept.chosen(numbers)],
            "control": [point for point in stored.control if names & set(point.stations)],
            "stages": [
                SceneStage(name="files", title="as the files have them", poses=dict.fromkeys(names, UNMOVED)),
                SceneStage(name="result", title="the result", poses=placed),
            ],
            "points": [json.loads(row) for row in clouds.rows(shown.start, shown.stop)],
        }
    )


def _listed(key: str, blobs: BlobStore) -> Json | None:
    try:
        found: Json = json.loads(blobs.local_path(key).read_bytes())
    except FileNotFoundError:
        return None
    return found
