"""Process `mesh`: a triangle mesh of registered scans."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from schemas.requests.mesh_inputs import MeshInputs, MeshOutput
from schemas.requests.mesh_patches import PatchesOutput
from schemas.results.mesh_result import MeshingDocument
from service.errors import FieldFault, InvalidRequestError
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.check_stations import posed_station_faults
from service.use_cases.inputs.validate_request import WRONG_FIELDS
from service.use_cases.steps.posed_plan import PosesFirst, about_poses
from service.use_cases.steps.station_calls import photos_of, scan_of

PASSED = ("cleaning", "surface", "lines", "cuts", "plinth", "patches", "texture", "contours", "tolerance_m")
"""Inputs that the step is told as they are."""


@dataclass(frozen=True)
class MeshPlan:
    """One step: all stations go in, a mesh comes out."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `mesh`."""
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
                    "photos": photos_of(job, station),
                }
                for station in inputs["stations"]
            ],
            **{name: inputs[name] for name in PASSED},
            **about_poses(job),
            **{f"wanted_{name}": (job.get("wanted") or {}).get(name) for name in ("mesh", "patch_file")},
        }
        return [StepCall("mesh-stations", arguments, "laying the mesh", weight=self.total_weight(job))]

    def total_weight(self, job: Json) -> float:
        """Count the stations."""
        return float(len(job["inputs"]["stations"]))


def _check(inputs: MeshInputs, stored: Stored) -> None:
    faults = list(_name_faults(inputs))
    faults += posed_station_faults(inputs, stored.files)
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


def _name_faults(inputs: MeshInputs) -> Iterator[FieldFault]:
    names = [patch.name for patch in inputs.patches]
    for k, name in enumerate(names):
        if name in names[:k]:
            yield FieldFault(f"/inputs/patches/{k}/name", f"the name '{name}' is used twice")


MESH = Process(
    id="mesh",
    title="Lay a mesh through registered scans",
    description="Lays a triangle mesh through registered scans (Poisson, or a rolling ball), leaves out small parts, "
    "closes holes, smooths, cuts by planes, keeps a share of the triangles, joins it with the plinth it stands on, "
    "lists what is wrong with it, and tells surface, volume and the distances of the points. Lays photos on "
    "it, and contours measured in them; fits B-spline surfaces over rectangles and cylinders.",
    inputs=MeshInputs,
    outputs=MeshingDocument,
    plan=PosesFirst(MeshPlan()),
    steps={"mesh-stations": "service.processes.mesh.meshing:mesh"},
    check=_check,
    needs_open3d=lambda _inputs, _wanted: True,
    file_outputs={"mesh": MeshOutput, "patch_file": PatchesOutput},
)
