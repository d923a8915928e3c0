"""A service that shows a scene which nothing was computed for: the web application over files, with all its routes."""

import json
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import uvicorn
from scipy.spatial.transform import RigidTransform

from service.adapters.files.local_files import LocalFiles
from service.dependencies import Adapters
from service.names.scene_keys import scene_key
from service.ports import Job, JobStatus
from service.settings import Settings
from tests.api.conftest import FakeSteps
from tests.doubles.application import create_app
from tests.doubles.memory import MemoryFileStore, MemoryJobLog, MemoryJobStore, MemoryQueue

JOB, NOW = "job0", datetime(2026, 1, 1, tzinfo=UTC)
NOISE_STD_M = 0.002
FACES = ((0, -1), (0, 1), (1, -1), (1, 1), (2, -1), (2, 1))


@dataclass(frozen=True)
class ShownStation:
    """A station in the middle of a room whose walls, floor and ceiling it sees."""

    name: str
    half_m: tuple[float, float, float]
    """Half of length, depth and height of the room."""
    pose: RigidTransform
    points: str
    """Key of the blocks of its points; their list is there under the same with `.json`."""
    point_count: int = 0
    planes: bool = True
    file: str = ""
    """Uploaded file that it is of, for jobs that name it."""


@dataclass
class ServedScene:
    """The service while it runs."""

    url: str
    blobs: LocalFiles
    jobs: MemoryJobStore
    inputs: dict[str, Any] = field(default_factory=dict)

    def finish(self, job_id: str, process: str, inputs: Mapping[str, Any], result: Mapping[str, Any] | None) -> None:
        """Enter a finished job with its result."""
        self.jobs.create_and_enqueue(Job(job_id, process, dict(inputs), JobStatus.ACCEPTED, NOW, updated=NOW))
        self.jobs.start(job_id, NOW)
        self.jobs.succeed(job_id, NOW)
        if result is not None:
            self.blobs.write_bytes(f"jobs/{job_id}/result.json", json.dumps(result).encode())


def room_planes(station: ShownStation) -> list[dict[str, Any]]:
    """Give the six sides of a room, with normals inwards."""
    half, planes = np.array(station.half_m), []
    for number, (axis, side) in enumerate(FACES, start=1):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        corners = np.zeros((4, 3))
        corners[:, axis] = side * half[axis]
        corners[:, u] = half[u] * np.array([-1, 1, 1, -1])
        corners[:, v] = half[v] * np.array([-1, -1, 1, 1])
        normal = np.zeros(3)
        normal[axis] = -side
        shape = {"normal": normal.tolist(), "boundary_m": corners.tolist()}
        planes.append({"id": f"{station.name}/P{number}", "state": "alone", **shape})
    return planes


def scene_of(stations: Sequence[ShownStation]) -> dict[str, Any]:
    """Describe the stations as a finished registration does."""
    described, poses = [], {}
    for station in stations:
        half = np.array(station.half_m)
        poses[station.name] = station.pose.as_matrix().tolist()
        described.append(
            {
                "name": station.name,
                "status": "registered",
                "world_from_scan": poses[station.name],
                "covariance": (1e-6 * np.eye(6)).tolist(),
                "noise_std_m": NOISE_STD_M,
                "points": station.point_count,
                "sensor_m": [0, 0, 0],
                "bounds_m": [(-half).tolist(), half.tolist()],
                "lines": [],
                "planes": room_planes(station) if station.planes else [],
                "cylinders": [],
            }
        )
    stage = {"name": "result", "title": "the result", "poses": poses}
    points = [[station.points, f"{station.points}.json"] for station in stations]
    return {"stations": described, "stages": [stage], "pairs": [], "points": points}


@contextmanager
def served_scene(home: Path, blobs: LocalFiles, stations: Sequence[ShownStation]) -> Iterator[ServedScene]:
    """Serve a scene whose points are in `blobs` already."""
    blobs.write_bytes(scene_key(JOB), json.dumps(scene_of(stations)).encode())
    jobs = MemoryJobStore()
    adapters = Adapters(jobs, MemoryFileStore(), blobs, MemoryQueue(), FakeSteps(blobs), MemoryJobLog())  # type: ignore[arg-type]
    application = create_app(Settings(data_dir=home / "data"), adapters)
    server = uvicorn.Server(uvicorn.Config(application, port=0, log_level="warning"))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.02)
    served = ServedScene(f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}", blobs, jobs)
    listed = [{"name": each.name, "scan": {"file": each.file, "index": 0}} for each in stations]
    served.finish(JOB, "register", {"stations": listed}, None)
    yield served
    server.should_exit = True
    thread.join()
