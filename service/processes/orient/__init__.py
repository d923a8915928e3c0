"""Process `orient`: clouds with approximate poses, laid on each other all at once."""

from collections.abc import Sequence
from dataclasses import dataclass

from schemas.requests.orient import OrientDocument, OrientInputs
from service.errors import FieldFault, InvalidRequestError
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.check_stations import posed_station_faults
from service.use_cases.inputs.validate_request import WRONG_FIELDS, pointer_to
from service.use_cases.steps.posed_plan import PosesFirst, about_poses
from service.use_cases.steps.station_calls import scan_of


@dataclass(frozen=True)
class OrientPlan:
    """One step: all clouds go in, their poses come out."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `orient`."""
        if outputs:
            return None
        inputs = job["inputs"]
        arguments = {
            "job_id": job["id"],
            "stations": [
                {
                    "name": station["name"],
                    "scan": scan_of(job, station),
                    "world_from_scan": station.get("world_from_scan"),
                }
                for station in inputs["stations"]
            ],
            "options": {name: value for name, value in inputs.items() if name != "stations"},
            **about_poses(job),
        }
        return [StepCall("orient-clouds", arguments, "laying the clouds on each other")]

    def total_weight(self, job: Json) -> float:
        """Count the stations."""
        return float(len(job["inputs"]["stations"]))


def _check(inputs: OrientInputs, stored: Stored) -> None:
    if not isinstance(inputs.stations, list):  # stations of a job are listed before
        return
    faults = list(posed_station_faults(inputs, stored.files))
    names = {station.name for station in inputs.stations}
    named = [(pointer_to("inputs", "fixed", number), name) for number, name in enumerate(inputs.fixed or ())]
    for number, tie in enumerate(inputs.ties):
        where = pointer_to("inputs", "ties", number)
        named += [(f"{where}/first", tie.first), (f"{where}/second", tie.second)]
        if tie.first == tie.second:
            faults.append(FieldFault(where, f"station '{tie.first}' is tied to itself"))
    faults += [FieldFault(where, f"there is no station '{name}'") for where, name in named if name not in names]
    if len(inputs.stations) < 2:
        faults.append(FieldFault("/inputs/stations", "two stations or more are laid on each other"))
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


ORIENT = Process(
    id="orient",
    title="Lay clouds on each other all at once",
    description="Moves scans with approximate poses until all of them lie on each other, by closest points along the "
    "normals and one linear system a round (Hofer and Pottmann 2004); stations that are named stay fixed, and tie "
    "points, found in photos or picked, hold what the surfaces leave free. Poses come without standard deviations; "
    "`register` gives those.",
    inputs=OrientInputs,
    outputs=OrientDocument,
    plan=PosesFirst(OrientPlan()),
    steps={"orient-clouds": "service.processes.orient.orienting:orient"},
    check=_check,
)
