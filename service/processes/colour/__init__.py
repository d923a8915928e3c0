"""Process `colour`: registered scans in the colours of their photos."""

from collections.abc import Sequence
from dataclasses import dataclass

from schemas.requests.colour_inputs import ColouredOutput, ColourInputs
from schemas.requests.posed_stations import StationsOfJob
from schemas.results.colouring_result import ColouringDocument
from service.errors import FieldFault, InvalidRequestError
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.check_stations import posed_station_faults
from service.use_cases.inputs.validate_request import WRONG_FIELDS
from service.use_cases.steps.posed_plan import PosesFirst, about_poses
from service.use_cases.steps.station_calls import photos_of, scan_of


@dataclass(frozen=True)
class ColourPlan:
    """One step: scans and photos go in, coloured points come out."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `colour`."""
        if outputs:
            return None
        arguments = {
            "job_id": job["id"],
            "stations": [
                {
                    "name": station["name"],
                    "scan": scan_of(job, station),
                    "world_from_scan": station.get("world_from_scan"),
                    "photos": photos_of(job, station),
                }
                for station in job["inputs"]["stations"]
            ],
            "options": job["inputs"]["blending"],
            **about_poses(job),
            "wanted": (job.get("wanted") or {}).get("coloured_cloud"),
        }
        return [StepCall("colour-stations", arguments, "colouring")]

    def total_weight(self, job: Json) -> float:
        """Count the stations."""
        return float(len(job["inputs"]["stations"]))


def _check(inputs: ColourInputs, stored: Stored) -> None:
    if isinstance(inputs.stations, StationsOfJob):
        return
    faults = list(posed_station_faults(inputs, stored.files))
    if not faults and not any(station.photos or _has_images(station.scan.file, stored) for station in inputs.stations):
        faults.append(FieldFault("/inputs/stations", "no station has a photo with camera and pose"))
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


def _has_images(file_id: str, stored: Stored) -> bool:
    """Tell whether the file of a scan holds images with camera and pose."""
    file = stored.files.get(file_id)
    return file is not None and any(photo.get("camera") and photo.get("scan_from_camera") for photo in file.photos)


COLOUR = Process(
    id="colour",
    title="Colour registered scans by their photos",
    description="Gives every point the colour that the photos of all stations show: hidden points are told by depth, "
    "photos are blended by angle and distance, and differences of exposure and white balance between them taken out.",
    inputs=ColourInputs,
    outputs=ColouringDocument,
    plan=PosesFirst(ColourPlan()),
    steps={"colour-stations": "service.processes.colour.colouring:colour"},
    check=_check,
    file_outputs={"coloured_cloud": ColouredOutput},
)
