"""What each process computes, as stages of steps. Small JSON only: ids, options and keys of blobs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from service.ports import Json, Plan, StepCall

ALL_PAIRS_UP_TO = 8
"""Up to so many stations `pairs: auto` tries every pair; beyond, each station with those that follow it in the list."""
NEIGHBOURS = 7
REPORT_WEIGHT = 0.1


@dataclass(frozen=True)
class RegisterPlan:
    """Features per scan, then pairs, then one report."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the next stage of `register`."""
        inputs = job["inputs"]
        stations = inputs["stations"]
        if len(outputs) == 0:
            options, of_photos = inputs["method"].get("features"), inputs.get("photo_lines")
            return [_features_call(job, station, options, of_photos) for station in stations]
        features = {station["name"]: output for station, output in zip(stations, outputs[0], strict=True)}
        if len(outputs) == 1:
            return [
                StepCall(
                    "register-pair",
                    {
                        "job_id": job["id"],
                        "number": number,
                        "target": {"name": target, "features": features[target]["features"]},
                        "source": {"name": source, "features": features[source]["features"]},
                        "method": inputs["method"],
                    },
                    f"registering {source} to {target}",
                    weight=2.0,
                )
                for number, (target, source) in enumerate(pairs_to_try(inputs))
            ]
        if len(outputs) == 2:
            return [
                StepCall(
                    "report-registration",
                    {"job_id": job["id"], "inputs": inputs, "features": outputs[0], "pairs": outputs[1]},
                    "writing the report",
                    weight=REPORT_WEIGHT,
                )
            ]
        return None

    def total_weight(self, job: Json) -> float:
        """Add up features, pairs and report."""
        inputs = job["inputs"]
        return 2.0 * len(inputs["stations"]) + 2.0 * len(pairs_to_try(inputs)) + REPORT_WEIGHT


@dataclass(frozen=True)
class ExtractLinesPlan:
    """Features of one scan, then the document that lists them."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the next stage of `extract-lines`."""
        inputs = job["inputs"]
        if len(outputs) == 0:
            return [_features_call(job, inputs["station"], inputs.get("features"), inputs.get("photo_lines"))]
        if len(outputs) == 1:
            return [
                StepCall(
                    "report-lines",
                    {
                        "job_id": job["id"],
                        "inputs": inputs,
                        "features": outputs[0][0],
                        "photos": _photos_of(job, inputs["station"]),
                    },
                    "writing the lines",
                    weight=REPORT_WEIGHT,
                )
            ]
        return None

    def total_weight(self, job: Json) -> float:  # noqa: ARG002 - the same for every job
        """Add up features and report."""
        return 2.0 + REPORT_WEIGHT


@dataclass(frozen=True)
class DetectEdgesPlan:
    """One step: a photo goes in, its edges come out."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `detect-edges`."""
        if outputs:
            return None
        file = job["files"][job["inputs"]["photo"]["file"]]
        arguments = {
            "job_id": job["id"],
            "inputs": job["inputs"],
            "filename": file["name"],
            "sha256": file["sha256"],
        }
        return [StepCall("detect-edges", arguments, f"edges of {file['name']}")]

    def total_weight(self, job: Json) -> float:  # noqa: ARG002 - the same for every job
        """Count the only step."""
        return 1.0


@dataclass(frozen=True)
class EchoPlan:
    """One step that gives back what it got."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `echo`."""
        if outputs:
            return None
        return [StepCall("echo", {"job_id": job["id"], "inputs": job["inputs"]}, "echoing")]

    def total_weight(self, job: Json) -> float:  # noqa: ARG002 - the same for every job
        """Count the only step."""
        return 1.0


PLANS: Mapping[str, Plan] = {
    "register": RegisterPlan(),
    "extract-lines": ExtractLinesPlan(),
    "detect-edges": DetectEdgesPlan(),
    "echo": EchoPlan(),
}


def pairs_to_try(inputs: Json) -> Sequence[tuple[str, str]]:
    """List the (target, source) pairs that a `register` job tries."""
    if inputs["pairs"] != "auto":
        return [(target, source) for target, source in inputs["pairs"]]
    names = [station["name"] for station in inputs["stations"]]
    return [
        (names[i], names[j])
        for i, j in combinations(range(len(names)), 2)
        if len(names) <= ALL_PAIRS_UP_TO or j - i <= NEIGHBOURS
    ]


def _features_call(job: Json, station: Json, options: Json | None, photo_options: Json | None) -> StepCall:
    file = job["files"][station["scan"]["file"]]
    return StepCall(
        "features",
        {
            "name": station["name"],
            "file": station["scan"]["file"],
            "filename": file["name"],
            "sha256": file["sha256"],
            "index": station["scan"]["index"],
            "options": options or {},
            "photos": _photos_of(job, station),
            "photo_options": photo_options or {},
        },
        f"features of {station['name']}",
        weight=2.0,
    )


def _photos_of(job: Json, station: Json) -> list[Json]:
    """Give the photos of a station as requested, each with name and content of its file."""
    return [
        {**photo, "filename": job["files"][photo["file"]]["name"], "sha256": job["files"][photo["file"]]["sha256"]}
        for photo in station.get("photos", [])
    ]
