"""Fit the patches of a job, and write them."""

from collections.abc import Sequence

import numpy as np

from algorithms.arrays import Points, Vector3
from algorithms.deviations.triangles import Mesh
from algorithms.errors import InvalidInputError
from algorithms.meshing.spline_patches import (
    CylinderPatch,
    HeightFieldPatch,
    Patch,
    SplinePatch,
    fitted_patch,
    tessellated,
)
from schemas.results.mesh_result import SplinePatchFigures
from schemas.results.registration_result import Artifact
from service.formats.mesh_writers import MESH_WRITERS
from service.formats.spline_writers import write_iges, write_json
from service.ports import Json, StepContext
from service.use_cases.steps.output_files import artifact, output_file

PER_SPAN = 4
"""Squares along a side of a span, where patches are written as triangles."""
SPLINE_WRITERS = {"json": (write_json, "application/json"), "igs": (write_iges, "model/iges")}


def fitted_patches(points: Points, wanted: Sequence[Json], origin_m: Vector3) -> Sequence[SplinePatch]:
    """Fit all patches to the points, in the common frame.

    Raises
    ------
    InvalidInputError
        A patch has too few points; named.
    """
    made = []
    for each in wanted:
        try:
            made.append(
                fitted_patch(points, _patch(each, origin_m), each["degree"], each["tolerance_m"], each["most_spans"])
            )
        except InvalidInputError as fault:
            raise InvalidInputError(f"patch '{each['name']}'", str(fault), fault.advice) from None
    return made


def _patch(wanted: Json, origin_m: Vector3) -> Patch:
    def place(name: str) -> Vector3:
        return np.array(wanted[name], dtype=np.float64)

    if wanted["kind"] == "height-field":
        side_u, side_v = place("side_u_m"), place("side_v_m")
        side_v -= (side_v @ side_u) / (side_u @ side_u) * side_u
        return HeightFieldPatch(place("corner_m") - origin_m, side_u, side_v, wanted["reach_m"])
    return CylinderPatch(
        start_m=place("start_m") - origin_m,
        end_m=place("end_m") - origin_m,
        towards=place("towards"),
        from_rad=float(np.radians(wanted["from_deg"])),
        to_rad=float(np.radians(wanted["to_deg"])),
        least_radius_m=wanted["least_radius_m"],
        largest_radius_m=wanted["largest_radius_m"],
    )


def patch_figures(wanted: Sequence[Json], patches: Sequence[SplinePatch]) -> list[SplinePatchFigures]:
    """Say of every patch how large it is and how well it fits."""
    return [
        SplinePatchFigures(
            name=each["name"],
            points=patch.points,
            spans=(_spans(patch.knots_u), _spans(patch.knots_v)),
            control_points=patch.control_m.shape[0] * patch.control_m.shape[1],
            rms_m=patch.rms_m,
            largest_m=float(np.abs(patch.distances_m).max()),
            std_m=patch.std_m,
            surface_std_m=patch.surface_std_m,
            misfit_m=patch.misfit_m,
            missed_spans=patch.missed_spans,
        )
        for each, patch in zip(wanted, patches, strict=True)
    ]


def _spans(knots: np.ndarray) -> int:
    return int(((knots[:-1] >= 0.0) & (knots[1:] <= 1.0) & (np.diff(knots) > 0.0)).sum())


def write_patches(
    context: StepContext, job_id: str, name: str, wanted: Sequence[Json], patches: Sequence[SplinePatch],
    origin_m: Vector3,
) -> Artifact:  # fmt: skip
    """Write all patches into one file."""
    if name in SPLINE_WRITERS:
        write, media_type = SPLINE_WRITERS[name]
        with output_file(context, job_id, f"patches.{name}") as path:
            write(path, [each["name"] for each in wanted], patches, origin_m)
        return artifact(context, job_id, f"patches.{name}", media_type)
    writer = MESH_WRITERS[name]
    filename = f"patches{writer.ending}"
    with output_file(context, job_id, filename) as path:
        writer.write(path, _together([tessellated(patch, PER_SPAN) for patch in patches]), origin_m, None)
    return artifact(context, job_id, filename, writer.media_type)


def _together(meshes: Sequence[Mesh]) -> Mesh:
    firsts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.triangles + first for mesh, first in zip(meshes, firsts, strict=True)]),
    )
