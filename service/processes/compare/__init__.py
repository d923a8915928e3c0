"""Process `compare`: how far a cloud lies from another cloud, a mesh or planes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from schemas.requests.compare_inputs import CompareInputs, DeviationsOutput
from schemas.results.deviations_result import CompareDocument
from service.errors import FieldFault, InvalidRequestError
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.check_stations import posed_station_faults
from service.use_cases.inputs.validate_request import WRONG_FIELDS
from service.use_cases.steps.posed_plan import PosesFirst
from service.use_cases.steps.station_calls import scan_of

MESH_ENDINGS = (".ply", ".obj", ".stl")


@dataclass(frozen=True)
class ComparePlan:
    """One step that reads both and compares."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `compare`."""
        if outputs:
            return None
        inputs = job["inputs"]
        mesh = inputs.get("mesh")
        arguments = {
            "job_id": job["id"],
            "inputs": inputs,
            "cloud": _stations(job, inputs["cloud"]),
            "reference": _stations(job, inputs.get("reference") or []),
            "mesh": None if mesh is None else _file(job, mesh["file"]),
            "wanted": job.get("wanted") or {},
            "left_out": job.get("left_out") or {},
            "poses_from": job.get("poses_from") or {},
            "reads": sorted(_results_of_jobs(inputs)),
        }
        return [StepCall("compare", arguments, "comparing", weight=4.0)]

    def total_weight(self, job: Json) -> float:  # noqa: ARG002 - the same for every job
        """Count the only step."""
        return 4.0


def _stations(job: Json, stations: Sequence[Json]) -> list[Json]:
    return [
        {"name": station["name"], "scan": scan_of(job, station), "world_from_scan": station.get("world_from_scan")}
        for station in stations
    ]


def _file(job: Json, file_id: str) -> Json:
    file = job["files"][file_id]
    return {"sha256": file["sha256"], "filename": file["name"]}


def _results_of_jobs(inputs: Json) -> set[str]:
    """Name the results in which the covariance between stations stands."""
    stations = [*inputs["cloud"], *(inputs.get("reference") or [])]
    poses = [station.get("world_from_scan") for station in stations]
    return {f"jobs/{pose['jobID']}/result.json" for pose in poses if isinstance(pose, dict) and "jobID" in pose}


def _check(inputs: CompareInputs, stored: Stored) -> None:
    faults = [fault for name in ("cloud", "reference") for fault in posed_station_faults(inputs, stored.files, name)]
    if inputs.mesh is not None:
        file = stored.files.get(inputs.mesh.file)
        if file is None:
            faults.append(FieldFault("/inputs/mesh/file", f"there is no file '{inputs.mesh.file}'"))
        elif not file.name.lower().endswith(MESH_ENDINGS):
            why = f"'{file.name}' is no mesh: meshes are files named {', '.join('*' + each for each in MESH_ENDINGS)}"
            faults.append(FieldFault("/inputs/mesh/file", why))
    if inputs.joint_covariance is not None:
        faults += _covariance_faults(inputs)
    names = [plane.name for plane in inputs.planes or []]
    faults += [
        FieldFault(f"/inputs/planes/{k}/name", f"the name '{name}' is used twice")
        for k, name in enumerate(names)
        if name in names[:k]
    ]
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


def _covariance_faults(inputs: CompareInputs) -> Iterator[FieldFault]:
    where = "/inputs/joint_covariance"
    if inputs.reference is None:
        yield FieldFault(where, "it is that of two stations, but there is no reference cloud")
    elif any(not isinstance(each, list) or len(each) != 1 for each in (inputs.cloud, inputs.reference)):
        yield FieldFault(where, "it is that of two stations: cloud and reference must have one each")


COMPARE = Process(
    id="compare",
    title="Compare a cloud with a cloud, a mesh or planes",
    description="Gives signed distances of a cloud from another cloud (M3C2 with a level of detection that knows the "
    "errors of both poses and those that neighbouring points share), from a triangle mesh or from planes: statistics, "
    "histogram, coloured points, and on request a raster comparison with a test for patterns and maps of quality.",
    inputs=CompareInputs,
    outputs=CompareDocument,
    plan=PosesFirst(ComparePlan()),
    steps={"compare": "service.processes.compare.comparing:compare"},
    check=_check,
    file_outputs={"deviations": DeviationsOutput},
)
