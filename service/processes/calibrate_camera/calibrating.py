"""The step of `calibrate-camera`: read, calibrate, describe, store."""

import json
import time

import numpy as np

from algorithms.adjustment.hybrid.reliability import observation_tests
from algorithms.calibration.solution import Calibration, CalibrationOptions, calibrate
from algorithms.progress import ProgressSection
from schemas.results.calibration_result import CalibrationDocument, CalibrationProvenance, CameraExport
from schemas.results.registration_result import Artifact
from service.formats.writers.csv_table import csv_text
from service.ports import Json, StepContext
from service.processes.calibrate_camera.documents import (
    before_after_document,
    camera_document,
    correlation_documents,
    coverage_document,
    halves_document,
    mount_document,
    parameter_documents,
    photo_documents,
    projection_documents,
    worst_documents,
)
from service.processes.calibrate_camera.reading import read_field
from service.use_cases.steps.run_lines_report import software

POWER = 0.80


def calibrate_camera(context: StepContext, arguments: Json) -> Json:
    """Calibrate, and store result document and downloads."""
    inputs, job_id = arguments["inputs"], arguments["job_id"]
    started = time.perf_counter()
    read = read_field(context, inputs, arguments["files"])
    done_reading = time.perf_counter()
    options = CalibrationOptions(inputs["scaled_stds"], inputs["gross_errors"], inputs["alpha"], POWER)
    done = calibrate(read.field, options, progress=ProgressSection(context.progress, 0.3, 0.8))
    calibrated = time.perf_counter()
    context.progress.report(0.8, "comparing halves")
    document = calibration_document(done, inputs, read.remarks)
    document.provenance.timings_s.update(
        read=done_reading - started, calibrate=calibrated - done_reading, describe=time.perf_counter() - calibrated
    )
    files = download_files(document, done, inputs)
    document.artifacts = [
        Artifact(name=name, type=media, bytes=len(data), href=f"/jobs/{job_id}/artifacts/{name}")
        for name, (media, data) in files.items()
    ]
    for name, (_, data) in files.items():
        context.blobs.write_bytes(f"jobs/{job_id}/artifacts/{name}", data)
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"sigma0": document.sigma0, "redundancy": document.redundancy}


def calibration_document(done: Calibration, inputs: Json, remarks: list[str]) -> CalibrationDocument:
    """Describe a calibration without its downloads."""
    found, field, alpha = done.estimate, done.field, inputs["alpha"]
    tests = observation_tests(done.network, found, np.ones(len(done.network.stds)), alpha, POWER)
    squares = np.sum(np.square(done.residuals[done.used]), axis=1)
    camera, exports = camera_document(done)
    coverage, halves = coverage_document(done, alpha), halves_document(done)
    remarks = [*remarks, *_remarks(done, coverage.empty, halves.verdict, exports)]
    return CalibrationDocument(
        model=inputs["camera"]["model"], observations=found.used, unknowns=done.network.layout.count,
        redundancy=found.redundancy, sigma0=found.sigma0, rms_px=float(np.sqrt(squares.mean())),
        image_std_px=float(np.median(field.image_stds)), std_factor=done.std_factor,
        parameters=parameter_documents(done, alpha), covariance=done.covariance.tolist(), covariance_of=done.names,
        correlations=correlation_documents(done), camera=camera, exports=exports,
        mount=mount_document(done, inputs["distances_m"]), projection=projection_documents(done, inputs["distances_m"]),
        halves=halves, coverage=coverage, photos=photo_documents(done),
        worst=worst_documents(done, tests.statistics[: len(field.photos)]),
        before_after=before_after_document(done, inputs["earlier"], inputs["camera"]["model"], alpha),
        artifacts=[], remarks=remarks,
        provenance=CalibrationProvenance(
            software=software(), options={k: v for k, v in inputs.items() if k not in {"field", "photos"}}, timings_s={}
        ),
    )  # fmt: skip


def _remarks(done: Calibration, empty: list[str], verdict: str | None, exports: list[CameraExport]) -> list[str]:
    remarks = [f"{copy} shows what {first} shows; it was counted once" for copy, first in done.repeated]
    if done.turned:
        remarks.append(f"turned by 180° to fit the camera of the other photos: {', '.join(done.turned)}")
    if empty:
        remarks.append(f"no targets were seen at: {', '.join(empty)}; there the distortion is extrapolated")
    if verdict == "differ":
        remarks.append("halves of the photos differ by more than their covariances allow: try another lens model")
    if exports[0].largest_difference_px > 0.0:
        largest = exports[0].largest_difference_px
        remarks.append(f"`camera` was fitted to the calibrated lens and misses it by up to {largest:.2g} px")
    return remarks


def download_files(document: CalibrationDocument, done: Calibration, inputs: Json) -> dict[str, tuple[str, bytes]]:
    """Write the camera for other programs, and all residuals."""
    camera = document.camera.model_dump()
    photo: Json = {"camera": camera}
    if document.mount is not None:
        photo["mount"] = document.mount.mount
        photo["camera_axes"] = "right-down-forward"
        if document.mount.std_gon is not None and document.mount.std_m is not None:
            std = {"rotation_gon": max(document.mount.std_gon), "translation_m": max(document.mount.std_m)}
            photo["mount_std"] = {name: max(value, 1e-6) for name, value in std.items()}
    return {
        "photo.json": ("application/json", json.dumps(photo, indent=1).encode()),
        "opencv.yml": ("application/yaml", opencv_yaml(document).encode()),
        "photomodeler.txt": ("text/plain", brown_text(document, inputs["camera"]["pixel_um"]).encode()),
        "riscan.xml": ("application/xml", riscan_xml(document).encode()),
        "residuals.csv": ("text/csv", residuals_csv(done).encode()),
    }


def opencv_yaml(document: CalibrationDocument) -> str:
    """Write the camera as OpenCV's FileStorage reads it."""
    c = document.camera
    matrix = [c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0]
    terms = [c.k1, c.k2, c.p1, c.p2, c.k3]
    lines = ["%YAML:1.0", "---", f"image_width: {c.width}", f"image_height: {c.height}"]
    for name, rows, columns, values in (("camera_matrix", 3, 3, matrix), ("distortion_coefficients", 5, 1, terms)):
        lines += [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}", "   dt: d"]
        lines.append(f"   data: [ {', '.join(f'{value:.17g}' for value in values)} ]")
    lines.append(f"avg_reprojection_error: {document.rms_px:.17g}")
    return "\n".join(lines) + "\n"


def riscan_xml(document: CalibrationDocument) -> str:
    """Write camera and mount as a RiSCAN PRO project has them under `calibrations`: OpenCV's terms, and M_mount."""
    from xml.etree.ElementTree import Element, SubElement, indent, tostring

    name, c = "calibrated", document.camera
    root = Element("calibrations")
    camera = SubElement(SubElement(root, "camcalibs"), "camcalib_opencv", name=name)
    inner = SubElement(camera, "internal_opencv")
    terms = {"nx": c.width, "ny": c.height, "fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy, "k1": c.k1, "k2": c.k2}
    for key, value in {**terms, "k3": c.k3, "k4": 0, "p1": c.p1, "p2": c.p2}.items():
        SubElement(inner, key).text = f"{value:.17g}"
    if document.mount is not None:
        mount = SubElement(SubElement(root, "mountcalibs"), "mountcalib", name=name)
        rows = (" ".join(f"{value:.17g}" for value in row) for row in document.mount.mount)
        SubElement(mount, "matrix").text = " ".join(rows)
    indent(root)
    return tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def brown_text(document: CalibrationDocument, pixel_um: float | None) -> str:
    """Write the camera as PhotoModeler has it: in millimetres where the pixel size is known, else in pixels."""
    export = next(each for each in document.exports if each.model == "brown")
    q, size = export.parameters, 1.0 if pixel_um is None else 1e-3 * pixel_um
    unit = "px" if pixel_um is None else "mm"
    stretch = 1.0 + q["b"]
    rows = [
        ("focal length", q["c"] * size), ("Xp principal point x", (q["x0"] + 0.5) * size * stretch),
        ("Yp principal point y", (q["y0"] + 0.5) * size), ("Fw format width", document.camera.width * size * stretch),
        ("Fh format height", document.camera.height * size), ("K1", q["K1"] / size**2), ("K2", q["K2"] / size**4),
        ("K3", q["K3"] / size**6), ("P1", q["P1"] / size), ("P2", q["P2"] / size),
    ]  # fmt: skip
    head = f"# Brown, correcting measured points; {unit}; principal point from the outer corner of the top left pixel\n"
    return head + "".join(f"{name}: {value:.12g}\n" for name, value in rows)


def residuals_csv(done: Calibration) -> str:
    """Give all image points with residuals, one a row."""
    columns = ("photo", "target", "x_px", "y_px", "std_px", "residual_x_px", "residual_y_px", "used")
    field, rows = done.field, []
    for photo, point, image, std, residual, used in zip(
        field.photos, field.points, field.images, field.image_stds, done.residuals, done.used, strict=True
    ):
        rows.append([
            field.photo_names[photo], field.target_names[point], *image.tolist(), std[0], *residual.tolist(), bool(used)
        ])  # fmt: skip
    return csv_text(columns, rows)
