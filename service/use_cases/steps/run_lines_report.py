"""Write the result document of `extract-lines`."""

import math
from collections.abc import Sequence
from importlib.metadata import version
from typing import cast

import numpy as np

from algorithms.arrays import Array
from algorithms.features.mount_test import MountTest
from algorithms.features.photo_lines.outlines import Outline, outlines
from algorithms.features.photo_lines.projection_options import SpaceEdgeKind
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.lines import LineSource
from schemas.lines_result import (
    ExtractedCylinder,
    ExtractedLine,
    ExtractedOutline,
    ExtractedPlane,
    LinesDocument,
    MountTestDocument,
    TestedMount,
    Vector,
)
from schemas.registration_result import Artifact, FeatureCount, InputFile, Provenance
from service.ports import Json, StepContext
from service.use_cases.documents.feature_names import line_name, plane_name
from service.use_cases.steps.feature_store import load_features
from service.use_cases.steps.run_features import SEED


def report_lines(context: StepContext, arguments: Json) -> Json:
    """Put the features of one scan into the file's coordinates and store them as the job's result."""
    extracted = arguments["features"]
    station = arguments["inputs"]["station"]
    features = load_features(context.blobs.local_path(extracted["features"]))
    found = outlines_of(features)
    document = LinesDocument(
        station=station["name"],
        features=FeatureCount(**extracted["counts"]),
        lines=_lines(features),
        planes=_planes(features),
        outlines=_outlines(features, found),
        cylinders=_cylinders(features),
        sensor_m=None if features.sensor_m is None else vector(features.sensor_m + features.origin_m),
        mount_test=None if features.mount_test is None else mount_document(features.mount_test),
        artifacts=[_drawing(context, arguments, features, found), *_pictures(context, arguments, features)],
        provenance=Provenance(
            software=software(),
            method={
                "features": arguments["inputs"].get("features") or {},
                "photo_lines": arguments["inputs"].get("photo_lines") or {},
            },
            seed=SEED,
            inputs=input_files(station, extracted),
            timings_s=extracted["timings_s"],
        ),
    )
    context.blobs.write_bytes(
        f"jobs/{arguments['job_id']}/result.json", document.model_dump_json(by_alias=True).encode()
    )
    return {}


def outlines_of(features: ScanFeatures) -> list[Outline]:
    """Find the closed outlines that the photos show on the planes."""
    edges = features.photo_edges
    if edges is None:
        return []
    return outlines(features.lines, edges.line_kinds, edges.line_normals, features.planes)


def _drawing(context: StepContext, arguments: Json, features: ScanFeatures, found: Sequence[Outline]) -> Artifact:
    """Draw lines and outlines as DXF and store the drawing as a download."""
    from service.use_cases.reports.extracted_drawing import extracted_dxf

    data, name = extracted_dxf(features, found), "lines.dxf"
    context.blobs.write_bytes(f"jobs/{arguments['job_id']}/artifacts/{name}", data)
    href = f"/jobs/{arguments['job_id']}/artifacts/{name}"
    return Artifact(name=name, type="image/vnd.dxf", bytes=len(data), href=href)


def _pictures(context: StepContext, arguments: Json, features: ScanFeatures) -> list[Artifact]:
    """Draw the lines into each photo and store the pictures as downloads."""
    artifacts = []
    for number, photo in enumerate(arguments.get("photos", [])):
        from service.use_cases.reports.edges_drawing import lines_png
        from service.use_cases.steps.station_photos import read_station_photo

        read, name = read_station_photo(photo, context), f"photo-{number + 1}.png"
        data = lines_png(read.image, read.camera, read.scan_from_camera, features)
        context.blobs.write_bytes(f"jobs/{arguments['job_id']}/artifacts/{name}", data)
        href = f"/jobs/{arguments['job_id']}/artifacts/{name}"
        artifacts.append(Artifact(name=name, type="image/png", bytes=len(data), href=href))
    return artifacts


def mount_document(test: MountTest) -> MountTestDocument:
    """Put the test of the cameras' mounts into words and figures, angles in gon."""
    gon = 200.0 / math.pi
    errors, stds = test.mount_errors, np.sqrt(np.einsum("qii->qi", test.error_covariances))
    tested = test.degrees_of_freedom > 0
    return MountTestDocument(
        statistic=test.statistic if tested else None,
        degrees_of_freedom=test.degrees_of_freedom,
        critical=test.critical if tested else None,
        passed=test.passed,
        reason=test.untested_in_words(),
        text=test.in_words(),
        photos=[
            TestedMount(
                photo=q,
                lines=int(test.pair_counts[q]),
                degrees_of_freedom=int(degrees),
                statistic=float(test.statistics[q]) if degrees else None,
                critical=float(test.criticals[q]) if degrees else None,
                passed=bool(test.statistics[q] <= test.criticals[q]) if degrees else None,
                rotation_gon=vector(errors[q, :3] * gon) if degrees else None,
                translation_m=vector(errors[q, 3:]) if degrees else None,
                rotation_std_gon=vector(stds[q, :3] * gon) if degrees else None,
                translation_std_m=vector(stds[q, 3:]) if degrees else None,
            )
            for q, degrees in enumerate(test.degrees_of_freedom_each)
        ],
    )


def input_files(station: Json, extracted: Json) -> list[InputFile]:
    """List scan and photos of a station; `extracted` is the output of its features step."""
    scan, name, photos = station["scan"], station["name"], station.get("photos", [])
    hashes = extracted.get("photos", [])
    called = extracted.get("photo_names", [None] * len(hashes))  # steps done by an older version know no names
    return [
        InputFile(
            station=name,
            file=scan["file"],
            name=extracted.get("filename"),
            index=scan["index"],
            sha256=extracted["sha256"],
            unit=scan.get("unit"),
            columns=scan.get("columns"),
            instrument=extracted.get("instrument"),
        ),
        *(
            InputFile(station=name, kind="photo", file=photo["file"], name=own, index=photo["index"], sha256=sha256)
            for photo, sha256, own in zip(photos, hashes, called, strict=True)
        ),
    ]


def software() -> str:
    """Name program and version."""
    return f"tieline {version('tieline')}"


def vector(values: Array) -> Vector:
    """Turn a (3,) array into a JSON triple."""
    return cast("Vector", tuple(float(value) for value in values))


def _lines(features: ScanFeatures) -> list[ExtractedLine]:
    lines = features.lines
    starts, ends = lines.end_points
    surfaces = _surfaces(features)
    out = []
    for k in range(len(lines)):
        source = LineSource(int(lines.sources[k]))
        is_axis = source is LineSource.CYLINDER_AXIS
        parents = [int(p) for p in lines.parents[k] if p >= 0]
        out.append(
            ExtractedLine(
                name=line_name(k),
                source=source.label,
                anchor_m=vector(lines.anchors[k] + features.origin_m),
                direction=vector(lines.directions[k]),
                basis=(vector(lines.bases[k, :, 0]), vector(lines.bases[k, :, 1])),
                covariance=lines.covariances[k].tolist(),
                start_m=vector(starts[k] + features.origin_m),
                end_m=vector(ends[k] + features.origin_m),
                length_m=float(lines.lengths[k]),
                planes=[] if is_axis else [plane_name(p) for p in parents],
                cylinder=f"C{parents[0] + 1}" if is_axis else None,
                photo=None if lines.photos is None or lines.photos[k] < 0 else int(lines.photos[k]),
                surface=surfaces[k],
            )
        )
    return out


def _surfaces(features: ScanFeatures) -> list[str | None]:
    """Say what the edges of photos are in space, None for other lines."""
    if features.photo_edges is None:
        return [None] * len(features.lines)
    return [None if kind < 0 else SpaceEdgeKind(kind).label for kind in features.photo_edges.line_kinds.tolist()]


def _planes(features: ScanFeatures) -> list[ExtractedPlane]:
    planes = features.planes
    return [
        ExtractedPlane(
            name=plane_name(k),
            normal=vector(planes.normals[k]),
            centroid_m=vector(planes.centroids[k] + features.origin_m),
            basis=(vector(planes.bases[k, :, 0]), vector(planes.bases[k, :, 1])),
            covariance=planes.covariances[k].tolist(),
            noise_std_m=float(planes.noise_std_m[k]),
            points=int(planes.point_counts[k]),
            area_m2=float(planes.areas_m2[k]),
            boundary_m=[
                vector(corner)
                for corner in planes.centroids[k] + features.origin_m + planes.boundary_of(k) @ planes.bases[k].T
            ],
        )
        for k in range(len(planes))
    ]


def _outlines(features: ScanFeatures, found: Sequence[Outline]) -> list[ExtractedOutline]:
    return [
        ExtractedOutline(
            plane=plane_name(outline.plane),
            lines=[line_name(k) for k in outline.lines],
            corners_m=[vector(corner) for corner in outline.corners + features.origin_m],
            area_m2=outline.area_m2,
        )
        for outline in found
    ]


def _cylinders(features: ScanFeatures) -> list[ExtractedCylinder]:
    cylinders, lines = features.cylinders, features.lines
    axes = {int(lines.parents[k, 0]): int(k) for k in np.flatnonzero(lines.sources == LineSource.CYLINDER_AXIS)}
    return [
        ExtractedCylinder(
            name=f"C{k + 1}",
            axis=line_name(axes[k]),
            radius_m=float(cylinders.radii_m[k]),
            radius_std_m=float(cylinders.radius_std_m[k]),
            arc_gon=float(cylinders.arcs_rad[k]) * 200.0 / math.pi,
            seen_from="outside" if cylinders.convex[k] else "inside",
            points=int(cylinders.point_counts[k]),
        )
        for k in range(len(cylinders))
    ]
