"""Model the planes of a job, and write the result of `model-planes`."""

import numpy as np

from algorithms.arrays import Vector3
from algorithms.errors import InvalidInputError
from algorithms.meshing.captured_planes import captured
from algorithms.meshing.options import PlaneRelation
from algorithms.meshing.plane_models import PlaneConstraint, PlaneModel, adjusted_planes, corner_of
from schemas.results.model_planes_result import ModelledCorner, ModelledPlane, ModelPlanesDocument
from service.ports import Json, StepContext
from service.use_cases.steps.cleaned_clouds import CLEANED, cleaned_frame

MGON = 200_000.0 / np.pi


def model_planes(context: StepContext, arguments: Json) -> Json:
    """Capture and adjust the planes, and store the document.

    Raises
    ------
    InvalidInputError
        A seed lies on no plane.
    """
    cleaned = cleaned_frame(context, arguments["stations"], arguments["cleaning"])
    origin = cleaned.frame.origin_m
    points = np.concatenate([left.points for _, left in cleaned.stations()])
    parts = []
    for number, plane in enumerate(arguments["planes"]):
        context.progress.report(CLEANED + 0.1 * number / len(arguments["planes"]), plane["name"])
        seed = np.array(plane["seed_m"], dtype=np.float64) - origin
        try:
            parts.append(points[captured(points, seed, arguments["tolerance_m"], plane["reach_m"])])
        except InvalidInputError as fault:
            raise InvalidInputError(f"plane '{plane['name']}'", str(fault), fault.advice) from None
    names = [plane["name"] for plane in arguments["planes"]]
    constraints = [
        PlaneConstraint(PlaneRelation(each["relation"]), *(names.index(name) for name in each["planes"]))
        for each in arguments["constraints"]
    ]
    model = adjusted_planes(parts, constraints)
    document = ModelPlanesDocument(
        planes=[_plane(model, k, name, len(parts[k]), origin) for k, name in enumerate(names)],
        corners=[_corner(model, names, corner, origin) for corner in arguments["corners"]],
        std_m=model.std_m,
        redundancy=model.redundancy,
        iterations=model.iterations,
        left_out=arguments["left_out"],
        poses_from=arguments["poses_from"],
        remarks=[*cleaned.frame.notes(), *cleaned.cleaned.remarks],
    )
    key = f"jobs/{arguments['job_id']}/result.json"
    context.blobs.write_bytes(key, document.model_dump_json(by_alias=True).encode())
    return {"planes": len(names)}


def _plane(model: PlaneModel, k: int, name: str, points: int, origin_m: Vector3) -> ModelledPlane:
    block = model.covariance[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
    small, large = np.sqrt(np.maximum(np.linalg.eigvalsh(block[:2, :2]), 0.0)).tolist()
    return ModelledPlane(
        name=name,
        normal=_three(model.normals[k]),
        point_m=_three(model.centroids[k] + origin_m),
        normal_std_mgon=(small * MGON, large * MGON),
        across_std_m=float(np.sqrt(block[2, 2])),
        points=points,
        rms_m=float(model.rms_m[k]),
    )


def _corner(model: PlaneModel, names: list[str], planes: list[str], origin_m: Vector3) -> ModelledCorner:
    one, two, three = (names.index(name) for name in planes)
    corner, covariance = corner_of(model, (one, two, three))
    return ModelledCorner(
        planes=(planes[0], planes[1], planes[2]), point_m=_three(corner + origin_m), covariance_m2=covariance.tolist()
    )


def _three(values: Vector3) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
