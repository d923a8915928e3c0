"""Process `simulate`: what a network of set-ups would give, before anybody has been there."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

from schemas.requests.simulate_inputs import SimulateInputs
from schemas.results.simulation_result import SimulationDocument
from service.errors import FieldFault, InvalidRequestError
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.validate_request import WRONG_FIELDS, pointer_to

ALL_PAIRS_UP_TO, NEIGHBOURS = 8, 6
"""Of more stations each is registered to so many nearest ones."""
MESH_ENDINGS = (".ply", ".obj", ".stl")
METHOD = {"method": "auto"}


@dataclass(frozen=True)
class SimulatePlan:
    """Set-ups, a scan each, then, where it is wanted, the registration of what was scanned; one report."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the next stage of `simulate`."""
        scene = _scene(job)
        if len(outputs) == 0:
            return [StepCall("plan-setups", {"job_id": job["id"], **scene}, "building the scene", weight=0.1)]
        setups = outputs[0][0]["setups"]
        if len(outputs) == 1:
            return [
                StepCall(
                    "simulate-station",
                    {"job_id": job["id"], "number": number, "setup": setup, "inputs": job["inputs"], **scene},
                    f"scanning from {setup['name']}",
                    weight=2.0,
                )
                for number, setup in enumerate(setups)
            ]
        expect = job["inputs"]["expect"] and len(setups) > 1
        if expect and len(outputs) == 2:
            return _pair_calls(job, setups, outputs[1])
        is_network = expect and len(setups) > 2
        if is_network and len(outputs) == 3:
            arguments = {
                "job_id": job["id"],
                "names": [setup["name"] for setup in setups],
                "features": [output["features"] for output in outputs[1]],
                "pairs": outputs[2],
                "method": METHOD,
            }
            return [StepCall("adjust-network", arguments, "adjusting all stations", weight=0.3)]
        if len(outputs) == 2 + expect + is_network:
            arguments = {
                "job_id": job["id"],
                "inputs": job["inputs"],
                "scene": outputs[0][0],
                "stations": outputs[1],
                "pairs": outputs[2] if expect else None,
                "network": outputs[3][0]["network"] if is_network else None,
            }
            return [StepCall("report-simulation", arguments, "writing the report", weight=0.2)]
        return None

    def total_weight(self, job: Json) -> float:
        """Add up the stations that are stated, or some, and their pairs."""
        count = len(job["inputs"]["stations"] or ()) or 4
        pairs = count * (count - 1) / 2.0 if count <= ALL_PAIRS_UP_TO else count * NEIGHBOURS / 2.0
        return 0.6 + 2.0 * count + (2.0 * pairs if job["inputs"]["expect"] else 0.0)


def _scene(job: Json) -> Json:
    """Give what steps must know of the scene and the set-ups."""
    inputs = job["inputs"]
    mesh = inputs.get("mesh")
    file = None
    if mesh is not None:
        known = job["files"][mesh["file"]]
        file = {**mesh, "sha256": known["sha256"], "filename": known["name"]}
    return {
        "scene": inputs.get("scene"),
        "mesh": file,
        "planes": inputs.get("planes"),
        "stated": inputs.get("stations"),
    }


def _pair_calls(job: Json, setups: Sequence[Json], stations: Sequence[Json]) -> list[StepCall]:
    """Register the scans of neighbouring set-ups, as if nothing were known of them."""
    sides = [
        {"name": setup["name"], "features": output["features"], "known": None, "scan": None}
        for setup, output in zip(setups, stations, strict=True)
    ]
    return [
        StepCall(
            "register-pair",
            {"job_id": job["id"], "number": number, "target": sides[i], "source": sides[j], "method": METHOD},
            f"registering {sides[j]['name']} to {sides[i]['name']}",
            weight=2.0,
        )
        for number, (i, j) in enumerate(pairs_to_try([setup["position_m"] for setup in setups]))
    ]


def pairs_to_try(positions_m: Sequence[Sequence[float]]) -> list[tuple[int, int]]:
    """Choose the pairs of set-ups that are registered: all of few stations, of many each with its nearest ones.

    Parameters
    ----------
    positions_m
        Of the instruments.
    """
    everybody = range(len(positions_m))
    if len(positions_m) <= ALL_PAIRS_UP_TO:
        return list(combinations(everybody, 2))
    chosen: set[tuple[int, int]] = set()
    for i in everybody:
        distances = sorted((_distance(positions_m[i], positions_m[j]), j) for j in everybody if j != i)
        chosen |= {(min(i, j), max(i, j)) for _, j in distances[:NEIGHBOURS]}
    return sorted(chosen)


def _distance(first: Sequence[float], second: Sequence[float]) -> float:
    return math.dist(first, second)


def _check(inputs: SimulateInputs, stored: Stored) -> None:
    faults = list(_faults(inputs, stored))
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


def _faults(inputs: SimulateInputs, stored: Stored) -> Iterator[FieldFault]:
    if inputs.mesh is not None:
        file = stored.files.get(inputs.mesh.file)
        if file is None:
            yield FieldFault("/inputs/mesh/file", f"there is no file '{inputs.mesh.file}'; POST /files uploads one")
        elif not file.name.lower().endswith(MESH_ENDINGS):
            why = f"'{file.name}' is no mesh: meshes are files named {', '.join('*' + each for each in MESH_ENDINGS)}"
            yield FieldFault("/inputs/mesh/file", why)
    names = [station.name for station in inputs.stations or ()]
    # what is planned of every two of them stands in one document
    most = min(stored.settings.max_stations, stored.settings.max_whole_stations)
    if len(names) > most:
        yield FieldFault("/inputs/stations", f"{len(names)} stations, the limit of this service is {most}")
    for k, name in enumerate(names):
        if name in names[:k]:
            yield FieldFault(pointer_to("inputs", "stations", k, "name"), f"the name '{name}' is used twice")


SIMULATE = Process(
    id="simulate",
    title="Simulate scans and plan a network",
    description="Scans a scene (built in, a mesh or planes) from planned set-ups with the data sheet of an instrument, "
    "with noise by distance, incidence and reflectance, footprints that mix at edges, and photos on request; writes "
    "scans whose true poses are known, and says which overlaps, links and standard deviations such a network would "
    "have.",
    inputs=SimulateInputs,
    outputs=SimulationDocument,
    plan=SimulatePlan(),
    steps={
        "plan-setups": "service.processes.simulate.scanning:plan_setups",
        "simulate-station": "service.processes.simulate.scanning:simulate_station",
        "report-simulation": "service.processes.simulate.report:report_simulation",
    },
    check=_check,
)
