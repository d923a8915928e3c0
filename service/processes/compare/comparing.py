"""The step of `compare`: read, measure, describe, store."""

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from pydantic import TypeAdapter
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Flags, Points, Scalars, Vector3
from algorithms.deviations.colour_classes import deviation_classes
from algorithms.deviations.cylinders import core_normals
from algorithms.deviations.joint_poses import StationPairs
from algorithms.deviations.m3c2 import M3C2, m3c2
from algorithms.deviations.options import M3C2Options
from algorithms.deviations.orientation import Orientation, OrientedBy, Side, orientation
from algorithms.deviations.rasters import viewed_along
from algorithms.deviations.signed_distances import (
    PlaneSet,
    SignedDistances,
    cloud_normals,
    from_cloud,
    from_mesh,
    from_planes,
)
from algorithms.deviations.statistics import Histogram, histogram_of
from algorithms.deviations.triangles import Mesh, condition_of
from algorithms.progress import NoProgress
from algorithms.scans.voxel_grid import fullest_of_voxels
from schemas.results.deviations_result import (
    CompareDocument,
    CompareProvenance,
    DeviationHistogram,
    M3C2Figures,
    MeshFigures,
    PlaneFigures,
)  # fmt: skip
from schemas.results.registration_result import Artifact
from schemas.values.units import unit_named
from service.errors import InvalidRequestError
from service.formats.meshes import read_mesh
from service.formats.writers import PointPiece, ScalarField, StationCloud, writer_of
from service.formats.writers.grid_files import Files
from service.names.content_keys import content_key
from service.ports import Json, StepContext
from service.processes.compare.drawings import histogram_svg, points_png
from service.processes.compare.raster_part import compared_surfaces
from service.processes.compare.shown_deviations import store_deviation_scene
from service.processes.compare.surfaces import StationsInWorld, pose_pairs, read_stations
from service.use_cases.documents.deviation_documents import deviation_figures
from service.use_cases.steps.output_files import artifact, output_file
from service.use_cases.steps.placed_stations import in_metres_stem, renamed
from service.use_cases.steps.run_lines_report import software

CLASSES = 41
"""Of the histogram; odd, so that zero is in the middle of one."""
LIMIT_QUANTILE = 0.98
"""Share of deviations inside the histogram's borders and the colours' last classes."""
SEED = 20
"""The same input gives the same bytes."""
SCALARS = (
    ScalarField("deviation_mm", "signed deviation [mm]"),
    ScalarField("lod_mm", "level of detection [mm]"),
    ScalarField("significant", "1: exceeds the level", "u1"),
)
ARBITRARY_SCALAR = ScalarField("deviation_mm", "deviation [mm], sign arbitrary")
"""Descriptions have at most 32 characters in LAS."""


@dataclass(eq=False)
class _Compared:
    """What was measured, where."""

    method: str
    places: Points
    deviations_m: Scalars
    signed: Flags
    m3c2: M3C2 | None = None
    mesh: MeshFigures | None = None
    nearest: Array | None = None
    sides: Orientation | None = None
    """None: the reference itself has sides."""
    remarks: list[str] = field(default_factory=list)

    @property
    def is_signed(self) -> bool:
        """Whether it is known which side is positive."""
        return self.sides is None or not self.sides.is_arbitrary


def compare(context: StepContext, arguments: Json) -> Json:
    """Compare, and store result document and downloads."""
    started = time.perf_counter()
    inputs, job_id = arguments["inputs"], arguments["job_id"]
    remarks = [f"station '{name}' was left out: {why}" for name, why in arguments["left_out"].items()]
    cloud, origin = read_stations(context, arguments["cloud"], None, remarks)
    reference = None
    if arguments["reference"]:
        reference, _ = read_stations(context, arguments["reference"], origin, remarks)
    read = time.perf_counter()
    if reference is not None and inputs["method"] == "m3c2":
        compared = _by_m3c2(context, inputs, reference, cloud, origin)
    elif reference is not None:
        compared = _by_nearest(inputs, reference, cloud, origin)
    elif arguments["mesh"] is not None:
        compared = _by_mesh(context, inputs, arguments["mesh"], cloud, origin)
    else:
        compared = _by_planes(inputs, cloud, origin)
    compared.remarks[:0] = remarks
    _require_deviations(compared, inputs, origin)
    measured = time.perf_counter()
    context.progress.report(0.85, "pictures")
    view = np.asarray(inputs["view"], dtype=np.float64)
    limit = _limit(compared.deviations_m)
    histogram = histogram_of(compared.deviations_m, limit, CLASSES)
    files: Files = {
        "histogram.svg": ("image/svg+xml", histogram_svg(histogram, limit).encode()),
        "deviations.png": ("image/png", points_png(viewed_along(compared.places, view), compared.deviations_m, limit)),
    }
    pattern = None
    if inputs.get("raster") is not None and reference is not None:
        context.progress.report(0.9, "rasters")
        pattern, maps = compared_surfaces(reference.points, cloud.points, inputs["raster"], view, origin, cloud.crs_wkt)
        files |= renamed(maps, is_converted=cloud.is_converted)
    elif inputs.get("raster") is not None:
        compared.remarks.append("rasters are made of two clouds; there is no reference cloud")
    document = CompareDocument(
        poses_from=arguments["poses_from"],
        method=compared.method,
        points=len(cloud.points),
        without_deviation=int((~np.isfinite(compared.deviations_m)).sum()),
        without_sign=int((np.isfinite(compared.deviations_m) & ~compared.signed).sum()),
        positive_side=_positive_side(compared),
        figures=deviation_figures(
            compared.deviations_m,
            compared.places + origin,
            inputs["tolerance_m"],
            signed=compared.is_signed,
        ),
        histogram=_histogram(histogram),
        m3c2=_m3c2_figures(compared.m3c2, inputs["m3c2"]),
        mesh=compared.mesh,
        planes=_plane_figures(compared, inputs, origin),
        pattern=pattern,
        deviations=_deviations(context, arguments, compared, origin, limit, cloud),
        artifacts=[
            Artifact(name=name, type=media, bytes=len(data), href=f"/jobs/{job_id}/artifacts/{name}")
            for name, (media, data) in files.items()
        ],
        remarks=compared.remarks,
        provenance=CompareProvenance(
            software=software(),
            inputs=inputs,
            timings_s={"read": read - started, "compare": measured - read, "write": time.perf_counter() - measured},
        ),
    )
    for name, (_, data) in files.items():
        context.blobs.write_bytes(f"jobs/{job_id}/artifacts/{name}", data)
    significant = None if compared.m3c2 is None else compared.m3c2.significant
    names = [station["name"] for station in arguments["cloud"]]
    store_deviation_scene(
        context, job_id, names, compared.places, origin, compared.deviations_m, significant, limit,
        signed=compared.is_signed,
    )  # fmt: skip
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"deviations": document.figures.count}


def _by_m3c2(
    context: StepContext, inputs: Json, reference: StationsInWorld, cloud: StationsInWorld, origin: Vector3
) -> _Compared:
    options = TypeAdapter(M3C2Options).validate_python(inputs["m3c2"])
    remarks: list[str] = []
    chosen = fullest_of_voxels(reference.points, inputs["core_spacing_m"], np.ones(len(reference.points)))
    cores = reference.points[chosen]
    first = reference.labels[chosen]
    second = np.zeros(len(cores), dtype=np.int32)
    if len(cloud.poses) > 1:
        second = cloud.labels[np.asarray(cKDTree(cloud.points).query(cores)[1])]
    pairs = pose_pairs(context, reference, cloud, inputs.get("joint_covariance"), origin, remarks)
    fitted, _ = core_normals(reference.points, cores, options.normal_radii_m)
    sides = orientation(fitted, cores, reference.instruments_of(first), _stated(inputs, origin))
    found = m3c2(
        reference.points, cloud.points, cores, StationPairs(pairs, first, second), options, normals=sides.normals,
        rng=np.random.default_rng(SEED), progress=context.progress,
    )  # fmt: skip
    if options.waviness_std_m is None and found.waviness.samples == 0:
        remarks.append("too few core points tell errors that neighbouring points share: the levels do not know them")
    return _Compared(
        "m3c2", cores, found.distances_m, np.isfinite(found.distances_m), m3c2=found, remarks=remarks, sides=sides
    )


def _stated(inputs: Json, origin: Vector3) -> Side | None:
    """Return the positive side as the request states it."""
    towards = inputs.get("towards")
    if towards is None:
        return None
    if towards.get("point_m") is not None:
        return Side(point_m=np.asarray(towards["point_m"], dtype=np.float64) - origin)
    return Side(direction=np.asarray(towards["direction"], dtype=np.float64))


def _by_nearest(inputs: Json, reference: StationsInWorld, cloud: StationsInWorld, origin: Vector3) -> _Compared:
    radius = max(inputs["m3c2"]["normal_radii_m"])
    normals = cloud_normals(reference.points, radius)
    sides = orientation(normals, reference.points, reference.instruments_of(reference.labels), _stated(inputs, origin))
    found = from_cloud(cloud.points, reference.points, sides.normals, inputs["max_distance_m"])
    compared = _of_distances(cloud.points, found)
    compared.sides = sides
    return compared


def _by_mesh(context: StepContext, inputs: Json, file: Json, cloud: StationsInWorld, origin: Vector3) -> _Compared:
    context.progress.report(0.35, "reading the mesh")
    mesh, dropped = read_mesh(context.blobs.local_path(content_key(file["sha256"])), file["filename"])
    unit = unit_named(inputs["mesh"].get("unit") or "m")
    mesh = Mesh(mesh.vertices * (1.0 if unit is None else unit.metres) - origin, mesh.triangles)
    condition = condition_of(mesh, dropped)
    context.progress.report(0.5, "distances from the mesh")
    compared = _of_distances(cloud.points, from_mesh(cloud.points, mesh, inputs["max_distance_m"]))
    compared.mesh = MeshFigures(
        triangles=len(mesh.triangles), closed=condition.is_closed, border_edges=condition.border_edges,
        crowded_edges=condition.crowded_edges, contradicting_edges=condition.contradicting_edges,
        dropped_triangles=condition.dropped_triangles,
    )  # fmt: skip
    if condition.border_edges:
        compared.remarks.append(
            f"the mesh has holes or ends ({condition.border_edges} edges of one triangle only): beside them a point "
            "has no side, and its deviation counts as positive"
        )
    if condition.contradicting_edges or condition.crowded_edges:
        compared.remarks.append(
            f"{condition.contradicting_edges} edges join triangles that look to opposite sides, and "
            f"{condition.crowded_edges} edges have three triangles or more: signs may be wrong there"
        )
    return compared


def _by_planes(inputs: Json, cloud: StationsInWorld, origin: Vector3) -> _Compared:
    planes = inputs["planes"]
    normals = np.array([plane["normal"] for plane in planes], dtype=np.float64)
    found = from_planes(
        cloud.points,
        PlaneSet(
            np.array([plane["point_m"] for plane in planes], dtype=np.float64) - origin,
            normals / np.linalg.norm(normals, axis=1)[:, None],
            tuple(
                None if plane.get("outline_m") is None else np.array(plane["outline_m"], dtype=np.float64) - origin
                for plane in planes
            ),
        ),
        inputs["max_distance_m"],
    )
    return _of_distances(cloud.points, found)


def _of_distances(points: Points, found: SignedDistances) -> _Compared:
    return _Compared("nearest", points, found.distances_m, found.signed, nearest=found.nearest)


def _require_deviations(compared: _Compared, inputs: Json, origin: Vector3) -> None:
    """Say clearly that nothing was near enough.

    Raises
    ------
    InvalidRequestError
        No point has a deviation.
    """
    if np.isfinite(compared.deviations_m).any():
        return
    reach = inputs["m3c2"]["max_distance_m"] if compared.method == "m3c2" else inputs["max_distance_m"]
    middle = compared.places.mean(axis=0) + origin
    raise InvalidRequestError(
        f"cloud and reference have nothing in common: no point lies within {reach:g} m of the other surface; the "
        f"points are about ({middle[0]:.1f}, {middle[1]:.1f}, {middle[2]:.1f}) m. Check that both are in the same "
        "coordinate system and unit, or allow larger distances"
    )


SIDES: Mapping[OrientedBy, Literal["stated", "instruments", "up", "arbitrary"]] = {
    OrientedBy.STATED: "stated",
    OrientedBy.INSTRUMENTS: "instruments",
    OrientedBy.UP: "up",
    OrientedBy.NEIGHBOURS: "arbitrary",
}
ABOVE = "where the instruments stood is not known, and the reference is a terrain: what lies above it is positive"
ARBITRARY = (
    "the sign is arbitrary: where the instruments stood is not known, and the reference is no terrain. Both sides are "
    "told apart, but nothing says which is positive: state `towards`, a point or a direction"
)


def _positive_side(compared: _Compared) -> Literal["stated", "instruments", "up", "arbitrary", "reference"]:
    """Return what the sign means, with a remark where nobody has said it."""
    if compared.sides is None:
        return "reference"
    remarks = {OrientedBy.UP: [ABOVE], OrientedBy.NEIGHBOURS: [ARBITRARY]}
    compared.remarks += remarks.get(compared.sides.by, [])
    return SIDES[compared.sides.by]


def _limit(deviations_m: Scalars) -> float:
    known = np.abs(deviations_m[np.isfinite(deviations_m)])
    return max(float(np.quantile(known, LIMIT_QUANTILE)), 1e-6)


def _histogram(histogram: Histogram) -> DeviationHistogram:
    return DeviationHistogram(
        edges_m=histogram.edges_m.tolist(), counts=histogram.counts.tolist(), below=histogram.below,
        above=histogram.above,
    )  # fmt: skip


def _m3c2_figures(found: M3C2 | None, options: Json) -> M3C2Figures | None:
    if found is None:
        return None
    measured = found.measured
    if not measured.any():
        raise InvalidRequestError(
            "no cylinder holds two points or more of both clouds, so no distance has a level of detection; "
            "larger cylinders (`m3c2.cylinder_radius_m`) hold more"
        )
    one, two = (float(np.median(counts[measured])) for counts in found.counts)
    return M3C2Figures(
        core_points=len(found.distances_m), measured=int(measured.sum()), significant=int(found.significant.sum()),
        expected_by_chance=options["alpha"] * int(measured.sum()),
        median_level_of_detection_m=float(np.median(found.levels_of_detection_m[measured])),
        median_pose_std_m=float(np.median(found.pose_std_m[measured])),
        waviness_std_m=found.waviness.std_m, waviness_samples=found.waviness.samples, median_points=(one, two),
    )  # fmt: skip


def _plane_figures(compared: _Compared, inputs: Json, origin: Vector3) -> list[PlaneFigures]:
    if inputs.get("planes") is None or compared.nearest is None:
        return []
    found = []
    for k, plane in enumerate(inputs["planes"]):
        here = compared.nearest == k
        figures = (
            deviation_figures(compared.deviations_m[here], compared.places[here] + origin, inputs["tolerance_m"])
            if here.any()
            else None
        )
        found.append(PlaneFigures(name=plane["name"], figures=figures))
    return found


def _deviations(
    context: StepContext,
    arguments: Json,
    compared: _Compared,
    origin: Vector3,
    limit: float,
    measured: StationsInWorld,
) -> list[Artifact] | None:
    """Write the points in the colours of their deviations, where wanted."""
    wanted: Mapping[str, Json] = arguments["wanted"]
    if "deviations" not in wanted:
        return None
    writer = writer_of(wanted["deviations"]["format"])
    name = f"{in_metres_stem('deviations', is_converted=measured.is_converted)}{writer.ending}"
    known = np.flatnonzero(np.isfinite(compared.deviations_m))
    colours = deviation_classes(limit).colours_of(compared.deviations_m[known])
    levels = np.full(len(known), np.nan) if compared.m3c2 is None else compared.m3c2.levels_of_detection_m[known]
    significant = np.zeros(len(known)) if compared.m3c2 is None else compared.m3c2.significant[known]
    numbers: dict[str, Array] = {
        "deviation_mm": (1e3 * compared.deviations_m[known]).astype(np.float32),
        "lod_mm": (1e3 * levels).astype(np.float32),
        "significant": significant.astype(np.uint8),
    }
    scalars: tuple[ScalarField, ...] = (SCALARS[0] if compared.is_signed else ARBITRARY_SCALAR,)
    scalars += SCALARS[1:] if compared.m3c2 is not None else ()

    def pieces() -> Iterator[PointPiece]:
        yield PointPiece(
            compared.places[known], color=colours, scalars={each.name: numbers[each.name] for each in scalars}
        )

    cloud = StationCloud("deviations", pieces, origin, has_color=True, scalars=scalars, crs_wkt=measured.crs_wkt)
    with output_file(context, arguments["job_id"], name) as path:
        writer.write(path, [cloud], NoProgress())
    return [artifact(context, arguments["job_id"], name, writer.media_type)]
