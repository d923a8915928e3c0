"""Inputs that are the stations of a finished job: listed with their poses, which are read before all else."""

import json
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import pytest

from schemas.requests.execution import FileOutputRequest
from schemas.requests.posed_stations import PosedInputs, PosedStations
from schemas.values.poses import Document
from service.errors import InvalidRequestError
from service.ports import Job, JobStatus, Json, Process, StepCall, StepContext, Stored, StoredFile
from service.settings import Settings
from service.use_cases.inputs.check_stations import posed_station_faults
from service.use_cases.jobs.submit_job import Execution, check_execution
from service.use_cases.steps.job_poses import read_poses
from service.use_cases.steps.posed_plan import PosesFirst
from tests.doubles.memory import MemoryBlobStore, MemoryFileStore, MemoryJobStore

NOW = datetime(2026, 1, 31, tzinfo=UTC)
POSE = [[1.0, 0.0, 0.0, 5.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
COVARIANCE = [[1e-8 * (i == j) for j in range(6)] for i in range(6)]
RESULT = {
    "stations": [
        {"name": "S1", "status": "fixed", "world_from_scan": {"matrix": POSE, "covariance": COVARIANCE}},
        {"name": "S2", "status": "registered", "world_from_scan": {"matrix": POSE, "covariance": COVARIANCE}},
        {"name": "S3", "status": "unregistered", "reason": "no pair was accepted", "world_from_scan": None},
    ]
}


class Inputs(PosedInputs):
    stations: PosedStations


class Wanted(FileOutputRequest):
    format: Literal["e57", "laz"] = "e57"
    merged: bool = False


class Result(Document):
    text: str
    moved: list[str] | None = None


@dataclass(frozen=True)
class OneEach:
    def next_stage(self, job: Json, outputs: Any) -> list[StepCall] | None:
        return (
            None if outputs else [StepCall("move", station, station["name"]) for station in job["inputs"]["stations"]]
        )

    def total_weight(self, job: Json) -> float:
        return float(len(job["inputs"]["stations"]))


class Progress:
    def report(self, fraction: float, message: str) -> None:
        pass


def check(inputs: Inputs, stored: Stored) -> None:
    faults = list(posed_station_faults(inputs, stored.files))
    if faults:
        raise InvalidRequestError("wrong", faults)


MOVE = Process("move", "Move", "Moves.", Inputs, Result, PosesFirst(OneEach()), {}, check, {"moved": Wanted})


def scan(index: int) -> Json:
    return {"index": index, "name": "s", "points": 9, "bounds_m": [[0.0] * 3, [1.0] * 3]}


@pytest.fixture
def stored(tmp_path: Path) -> Stored:
    files, jobs = MemoryFileStore(), MemoryJobStore()
    for k in range(1, 4):
        files.add(StoredFile(f"f{k}", f"{k}.ply", 9, f"{k}" * 64, "ply", "scan", NOW, scans=(scan(0),)))
    stations = [{"name": f"S{k}", "scan": {"file": f"f{k}", "index": 0}, "photos": []} for k in range(1, 4)]
    for job_id, status in (("done", JobStatus.SUCCESSFUL), ("runs", JobStatus.RUNNING)):
        jobs.create_and_enqueue(Job(job_id, "register", {"stations": stations}, status, NOW))
    jobs.create_and_enqueue(Job("lines", "extract-lines", {}, JobStatus.SUCCESSFUL, NOW))
    return Stored(files, jobs, Settings(data_dir=tmp_path))


def checked(stored: Stored, stations: Any, **more: Any) -> Execution:
    return check_execution(MOVE, {"inputs": {"stations": stations}, **more}, stored)


def faults(stored: Stored, stations: Any, **more: Any) -> dict[str, str]:
    with pytest.raises(InvalidRequestError) as refused:
        checked(stored, stations, **more)
    return {fault.pointer: fault.detail for fault in refused.value.faults}


def job_of(execution: Execution) -> Json:
    return {"id": "j", "process_id": "move", "inputs": execution.inputs, "files": {}}


def context(blobs: MemoryBlobStore) -> StepContext:
    return StepContext(blobs, Progress())


def test_the_stations_of_a_job_stand_in_the_inputs_with_their_files_and_poses(stored: Stored) -> None:
    execution = checked(stored, {"jobID": "done"})
    assert [station["name"] for station in execution.inputs["stations"]] == ["S1", "S2", "S3"]
    assert [station["world_from_scan"]["jobID"] for station in execution.inputs["stations"]] == ["done"] * 3
    assert execution.file_ids == ("f1", "f2", "f3")


def test_some_of_the_stations_may_be_chosen_by_name(stored: Stored) -> None:
    execution = checked(stored, {"jobID": "done", "names": ["S2"]})
    assert execution.file_ids == ("f2",)


@pytest.mark.parametrize(
    ("stations", "pointer", "words"),
    [
        ({"jobID": "none"}, "/inputs/stations/jobID", "there is no job"),
        ({"jobID": "../x"}, "/inputs/stations/jobID", "there is no job"),
        ({"jobID": "runs"}, "/inputs/stations/jobID", "is running"),
        ({"jobID": "lines"}, "/inputs/stations/jobID", "only those of 'register' give poses"),
        ({"jobID": "done", "names": ["S2", "S9"]}, "/inputs/stations/names/1", "no station 'S9'"),
        (
            [{"name": "A", "scan": {"file": "f1"}, "world_from_scan": {"jobID": "done"}}],
            "/inputs/stations/0/world_from_scan",
            "no station 'A'",
        ),
        (
            [{"name": "A", "scan": {"file": "f9"}, "world_from_scan": POSE}],
            "/inputs/stations/0/scan/file",
            "there is no file 'f9'",
        ),
        (
            [{"name": "A", "scan": {"file": "f1"}, "world_from_scan": [[2.0, 0.0, 0.0, 0.0], *POSE[1:]]}],
            "/inputs/stations/0/world_from_scan",
            "not a rotation",
        ),
    ],
)
def test_what_cannot_give_stations_is_named(stored: Stored, stations: Any, pointer: str, words: str) -> None:
    found = faults(stored, stations)
    assert list(found) == [pointer]
    assert words in found[pointer]


def test_jobs_of_other_projects_do_not_exist(stored: Stored) -> None:
    theirs = Stored(stored.files, stored.jobs.of("office"), stored.settings)
    assert faults(theirs, {"jobID": "done"}) == {"/inputs/stations/jobID": "there is no job 'done'"}


def test_poses_are_read_first_and_stations_without_one_are_left_out_with_the_reason(stored: Stored) -> None:
    job = job_of(checked(stored, {"jobID": "done"}))
    (reading,) = MOVE.plan.next_stage(job, []) or []
    assert reading.arguments["reads"] == ["jobs/done/result.json"]
    blobs = MemoryBlobStore()
    blobs.write_bytes("jobs/done/result.json", json.dumps(RESULT).encode())
    poses = read_poses(context(blobs), reading.arguments)
    stage = MOVE.plan.next_stage(job, [[poses]]) or []
    assert [call.label for call in stage] == ["S1", "S2"]
    assert stage[0].arguments["world_from_scan"]["matrix"] == POSE
    assert stage[0].arguments["world_from_scan"]["covariance"] == COVARIANCE
    assert MOVE.plan.next_stage(job, [[poses], [{}, {}]]) is None
    seen: list[Json] = []

    class Looking(OneEach):
        def next_stage(self, job: Json, outputs: Any) -> list[StepCall] | None:
            seen.append(job)
            return super().next_stage(job, outputs)

    PosesFirst(Looking()).next_stage(job, [[poses]])
    assert seen[0]["left_out"] == {"S3": "'S3' is unregistered: no pair was accepted"}


def test_stations_with_poses_of_their_own_need_no_reading(stored: Stored) -> None:
    stations = [
        {"name": "A", "scan": {"file": "f1"}, "world_from_scan": POSE},
        {"name": "B", "scan": {"file": "f2"}, "world_from_scan": {"matrix": POSE, "covariance": COVARIANCE}},
        {"name": "C", "scan": {"file": "f3"}},
    ]
    calls = MOVE.plan.next_stage(job_of(checked(stored, stations)), []) or []
    poses = [call.arguments["world_from_scan"] for call in calls]
    assert poses[0] == {"matrix": POSE, "covariance": None}
    assert poses[1]["covariance"] == COVARIANCE
    assert poses[2] is None


def test_a_job_that_was_removed_meanwhile_or_gives_no_pose_at_all_is_an_error() -> None:
    blobs = MemoryBlobStore()
    with pytest.raises(InvalidRequestError, match="has been removed meanwhile"):
        read_poses(context(blobs), {"stations": [["done", "S1"]]})
    blobs.write_bytes("jobs/done/result.json", json.dumps(RESULT).encode())
    with pytest.raises(InvalidRequestError, match="no pair was accepted"):
        read_poses(context(blobs), {"stations": [["done", "S3"]]})


def test_outputs_that_are_files_are_asked_for_by_format_and_options(stored: Stored) -> None:
    execution = checked(stored, {"jobID": "done"}, outputs={"moved": {"format": "laz", "merged": True}, "text": {}})
    assert set(execution.outputs or ()) == {"moved", "text"}
    assert dict(execution.files) == {"moved": {"transmissionMode": "reference", "format": "laz", "merged": True}}
    assert checked(stored, {"jobID": "done"}).files == {}


@pytest.mark.parametrize(
    ("outputs", "pointer"),
    [
        ({"moved": {"format": "doc"}}, "/outputs/moved/format"),
        ({"moved": {"fromat": "laz"}}, "/outputs/moved/fromat"),
        ({"text": {"format": "laz"}}, "/outputs/text/format"),
        ({"other": {}}, "/outputs/other"),
    ],
)
def test_outputs_that_cannot_be_made_are_named(stored: Stored, outputs: Json, pointer: str) -> None:
    assert list(faults(stored, {"jobID": "done"}, outputs=outputs)) == [pointer]


def test_more_stations_than_the_service_takes_are_refused(stored: Stored) -> None:
    small = replace(stored, settings=stored.settings.model_copy(update={"max_stations": 2}))
    three = [{"name": f"S{k}", "scan": {"file": f"f{k}"}} for k in range(1, 4)]
    assert faults(small, three) == {"/inputs/stations": "3 stations, the limit of this service is 2"}
    assert faults(small, {"jobID": "done"}) == {"/inputs/stations": "3 stations, the limit of this service is 2"}
    assert checked(small, three[:2])
