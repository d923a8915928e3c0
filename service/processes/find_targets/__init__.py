"""Process `find-targets`: spheres, boards and retro-reflective targets of one scan and its station's photos."""

from collections.abc import Sequence
from dataclasses import dataclass

from schemas.requests.find_targets_inputs import FindTargetsInputs
from schemas.results.targets_result import TargetsDocument
from service.errors import FieldFault, InvalidRequestError
from service.names.content_keys import content_key
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.check_stations import check_station
from service.use_cases.inputs.validate_request import WRONG_FIELDS, pointer_to
from service.use_cases.steps.station_calls import photos_of


@dataclass(frozen=True)
class FindTargetsPlan:
    """One step: a scan goes in, its targets come out."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `find-targets`."""
        if outputs:
            return None
        station = job["inputs"]["station"]
        reference = station["scan"]
        file = job["files"][reference["file"]]
        found: Json = next((each for each in file.get("scans", []) if each["index"] == reference["index"]), {})
        arguments = {
            "job_id": job["id"],
            "inputs": job["inputs"],
            "station": station["name"],
            "filename": file["name"],
            "sha256": file["sha256"],
            "index": reference["index"],
            "columns": reference.get("columns") or found.get("text_columns"),
            "unit": reference.get("unit"),
            "photos": (photos := photos_of(job, station)),
            # what is always read is named as such
            "reads": [content_key(each["sha256"]) for each in (file, *photos)],
        }
        return [StepCall("find-targets", arguments, f"targets of {station['name']}")]

    def total_weight(self, job: Json) -> float:  # noqa: ARG002 - the same for every job
        """Count the only step."""
        return 1.0


def _check(inputs: FindTargetsInputs, stored: Stored) -> None:
    check_station(inputs.station, stored.files)
    seen: set[str] = set()
    faults = []
    for number, point in enumerate(inputs.names):
        if point.name in seen:
            faults.append(
                FieldFault(pointer_to("inputs", "names", number, "name"), f"{point.name!r} stands there twice")
            )
        seen.add(point.name)
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


FIND_TARGETS = Process(
    id="find-targets",
    title="Find targets in a scan and its photos",
    description="Finds survey targets of given kinds and sizes in one scan: spheres in any, black-and-white boards and "
    "retro-reflective squares and cylinders in its intensities; each centre with its 3x3 covariance, what was taken "
    "for none with the reason, and names by the distances to those of a list. In the photos of the station boards and "
    "squares are measured in the windows that the scan gives, as image observations for adjust and calibrate-camera.",
    inputs=FindTargetsInputs,
    outputs=TargetsDocument,
    plan=FindTargetsPlan(),
    steps={"find-targets": "service.processes.find_targets.finding:find_targets_of_scan"},
    check=_check,
)
