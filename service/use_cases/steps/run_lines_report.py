"""Write the result document of `extract-lines`."""

import math
from collections.abc import Sequence
from importlib.metadata import version

import numpy as np

from algorithms.features.mount_test import MountTest
from algorithms.features.photo_lines.outlines import Outline, outlines
from algorithms.features.scan_features import ScanFeatures
from schemas.results.lines_result import LinesDocument, MountTestDocument, TestedMount
from schemas.results.registration_result import Artifact, FeatureCount, InputFile, Provenance
from service.ports import Json, StepContext
from service.use_cases.documents.feature_documents import (
    extracted_cylinders,
    extracted_lines,
    extracted_outlines,
    extracted_planes,
    vector,
)
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
        lines=extracted_lines(features),
        planes=extracted_planes(features),
        outlines=extracted_outlines(features, found),
        cylinders=extracted_cylinders(features),
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
