"""The stage before those of a process that takes stations with poses: those of finished jobs and of files are read."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from service.ports import Json, Plan, StepCall
from service.use_cases.inputs.file_poses import pose_source, scans_by_number, with_file_poses

READING_WEIGHT = 0.01


@dataclass(frozen=True)
class PosesFirst:
    """Read the poses that jobs gave the stations of a request, or that files state, and go on as if it had stated them.

    The plan then sees with every station ``world_from_scan``: ``{"matrix", "covariance" or None, ...}``, or None where
    the file's coordinates are those of the world. Stations that their job gave no pose are not there any more; they
    stand in ``job["left_out"]``, with the reason by name. ``job["poses_from"]`` tells by input and name of the station
    where the poses are from.
    """

    plan: Plan
    """What comes then."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the next stage: poses, if any are those of a job, then those of the plan."""
        wanted = [
            [station["world_from_scan"]["jobID"], _name_in_job(station)] for station in _stations_of_jobs(job["inputs"])
        ]
        if not wanted:
            return self.plan.next_stage(_with_poses(job, {}), outputs)
        if not outputs:
            results = [f"jobs/{job_id}/result.json" for job_id in dict.fromkeys(job_id for job_id, _ in wanted)]
            arguments = {"job_id": job["id"], "stations": wanted, "reads": results}
            return [StepCall("read-poses", arguments, "reading the poses", weight=READING_WEIGHT)]
        return self.plan.next_stage(_with_poses(job, outputs[0][0]["poses"]), outputs[1:])

    def total_weight(self, job: Json) -> float:
        """Add reading poses to what the plan takes."""
        weight = READING_WEIGHT if any(_stations_of_jobs(job["inputs"])) else 0.0
        return self.plan.total_weight(_with_poses(job, {})) + weight


def about_poses(job: Json) -> Json:
    """Return what the step of a process with one list of stations is told of them.

    Parameters
    ----------
    job
        As its plan sees it.
    """
    return {"left_out": job.get("left_out", {}), "poses_from": job.get("poses_from", {}).get("stations", {})}


def _with_poses(job: Json, poses: Mapping[str, Mapping[str, Json]]) -> Json:
    """Put poses in the place of jobs; before they are known, the stations stay as they are."""
    left_out: dict[str, str] = {}

    def posed(station: Json) -> Json | None:
        pose = station.get("world_from_scan") or {}
        if isinstance(pose, list):
            return {**station, "world_from_scan": {"matrix": pose, "covariance": None}}
        if not poses or "jobID" not in pose:
            return station
        found = poses[pose["jobID"]][_name_in_job(station)]
        if "reason" in found:
            left_out[station["name"]] = found["reason"]
            return None
        return {**station, "world_from_scan": {**found, "jobID": pose["jobID"], "station": _name_in_job(station)}}

    find, from_files = scans_by_number(job.get("files", {})), job["inputs"].get("poses") != "ignore"
    inputs: Json = {}
    poses_from: dict[str, dict[str, str]] = {}
    for name, given in job["inputs"].items():
        inputs[name] = given
        if not _are_stations(given):
            continue
        stations = with_file_poses(given, find) if from_files else given
        used = [(stated, found) for stated, each in zip(given, stations, strict=True) if (found := posed(each))]
        inputs[name] = [each for _, each in used]
        poses_from[name] = {
            each["name"]: pose_source(stated.get("world_from_scan"), each.get("world_from_scan"))
            for stated, each in used
        }
    return {**job, "inputs": inputs, "left_out": left_out, "poses_from": poses_from}


def _stations_of_jobs(inputs: Json) -> Iterator[Json]:
    for given in inputs.values():
        if _are_stations(given):
            yield from (station for station in given if _is_of_job(station.get("world_from_scan")))


def _are_stations(given: Any) -> bool:
    return isinstance(given, list) and all(isinstance(each, dict) and "scan" in each for each in given)


def _is_of_job(pose: Any) -> bool:
    return isinstance(pose, dict) and "jobID" in pose


def _name_in_job(station: Json) -> str:
    return str(station["world_from_scan"].get("station") or station["name"])
