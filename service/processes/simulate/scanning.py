"""Build the scene, and scan it from one set-up."""

import json
import shutil
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.matching.options import MatchingOptions
from algorithms.matching.symmetries import with_symmetries
from algorithms.progress import ProgressSection
from algorithms.scans.scan import Scan
from algorithms.simulation.given_scenes import GivenPlane, scene_of_mesh, scene_of_planes
from algorithms.simulation.instruments import INSTRUMENTS
from algorithms.simulation.reflectances import material_of
from algorithms.simulation.rendering import station_photos
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scene import Scene
from algorithms.simulation.scenes import SCENES
from algorithms.simulation.stations import station_pose
from algorithms.simulation.systematic_errors import IN_ADJUSTMENT, SystematicErrors
from algorithms.simulation.virtual_camera import VirtualCamera, scanner_camera, top_mount
from schemas.values.units import unit_named
from service.errors import FieldFault, InvalidRequestError
from service.formats.meshes import read_mesh
from service.formats.photo import camera_document
from service.formats.writers import cloud_of, writer_of
from service.names.content_keys import content_key
from service.ports import Json, StepContext
from service.use_cases.documents.pose_documents import matrix_rows
from service.use_cases.steps.feature_store import save_features
from service.use_cases.steps.output_files import artifact, output_file

RAD_PER_GON = np.pi / 200.0
SAMPLE = 60_000
"""Points of each scan by which overlaps are told."""
RAD_PER_MGON = 1e-3 * RAD_PER_GON
FEW_POINTS = 100
"""A scan of fewer is no scan."""


def plan_setups(context: StepContext, arguments: Json) -> Json:
    """Build the scene to learn whether it can be built, and give its set-ups.

    Raises
    ------
    InvalidInputError
        A plane of the scene has no outline.
    InvalidRequestError
        A built-in scene has no set-ups of its own, and none are stated.
    """
    scene = scene_of(context, arguments)
    if arguments["stated"] is not None:
        poses = [_stated_pose(station) for station in arguments["stated"]]
        names = [station["name"] for station in arguments["stated"]]
    else:
        poses = list(scene.stations)
        names = [f"{scene.name}-{number}" for number in range(1, len(poses) + 1)]
    if not poses:
        raise InvalidRequestError(
            f"the scene '{scene.name}' recommends no set-ups",
            [FieldFault("/inputs/stations", "say where the scanner stands")],
        )
    return {
        "scene": scene.name,
        "triangles": len(scene.triangles),
        "setups": [
            {
                "name": name,
                "world_from_scan": pose.as_matrix().tolist(),
                "position_m": np.asarray(pose.translation).tolist(),
            }
            for name, pose in zip(names, poses, strict=True)
        ],
    }


def scene_of(context: StepContext, arguments: Json) -> Scene:
    """Build the scene of a job.

    Parameters
    ----------
    context
        Of the step.
    arguments
        One of `scene`, `mesh` and `planes`.

    Raises
    ------
    InvalidInputError
        A plane of it has no outline.
    UnreadableFileError
        The file of the mesh is none.
    """
    if arguments["scene"] is not None:
        return SCENES[arguments["scene"]]()
    mesh = arguments["mesh"]
    if mesh is not None:
        found, _ = read_mesh(context.blobs.local_path(content_key(mesh["sha256"])), mesh["filename"])
        unit = unit_named(mesh["unit"] or "m")
        scale = 1.0 if unit is None else unit.metres
        material = material_of(mesh["material"], mesh["reflectance"])
        return scene_of_mesh("mesh", found.vertices * scale, found.triangles, material)
    return scene_of_planes(
        "planes",
        [
            GivenPlane(
                plane["name"],
                np.array(plane["outline_m"], dtype=np.float64),
                material_of(plane["material"], plane["reflectance"]),
            )
            for plane in arguments["planes"]
        ],
    )


def scanner_of(inputs: Json, station: str | None = None) -> VirtualScanner:
    """Give the scanner of a job: an instrument with step, air and errors of the request, on the tripod of a station.

    Raises
    ------
    InvalidInputError
        The instrument cannot turn by so little.
    """
    step = inputs["step_gon"]
    instrument = INSTRUMENTS[inputs["instrument"]]
    scanner = instrument.with_step(None if step is None else step * RAD_PER_GON, shots=inputs["shots"])
    return replace(
        scanner,
        attenuation_db_per_km=inputs["attenuation_db_per_km"],
        intensity_reference_m=inputs["intensity_reference_m"],
        systematic=_errors_of(inputs["errors"], station),
    )


def _errors_of(errors: Json | None, station: str | None) -> SystematicErrors:
    if errors is None:
        return IN_ADJUSTMENT
    drift: Json = next((each for each in errors["tripods"] if each["station"] == station), {})
    return SystematicErrors(
        range_offset_m=1e-3 * errors["range_offset_mm"],
        range_scale_error=1e-6 * errors["range_scale_ppm"],
        incidence_offset_m=1e-3 * errors["incidence_offset_mm"],
        vertical_index_error_rad=RAD_PER_MGON * errors["vertical_index_mgon"],
        collimation_error_rad=RAD_PER_MGON * errors["collimation_mgon"],
        trunnion_error_rad=RAD_PER_MGON * errors["trunnion_mgon"],
        drift_rad=(
            RAD_PER_MGON * drift.get("tilt_x_mgon", 0.0),
            RAD_PER_MGON * drift.get("tilt_y_mgon", 0.0),
            RAD_PER_MGON * drift.get("heading_mgon", 0.0),
        ),
        drift_bend_rad=tuple(RAD_PER_MGON * each for each in drift.get("bend_mgon", (0.0, 0.0, 0.0))),
    )


def mount_error_of(errors: Json | None) -> RigidTransform:
    """Give where a camera really sits, as seen from where it is said to sit."""
    if errors is None:
        return RigidTransform.identity()
    return RigidTransform.from_components(
        1e-3 * np.array(errors["mount_shift_mm"]),
        Rotation.from_rotvec(RAD_PER_MGON * np.array(errors["mount_rotation_mgon"])),
    )


def simulate_station(context: StepContext, arguments: Json) -> Json:
    """Scan from one set-up: write the scan and its photos, and find its features where the network is wanted.

    Raises
    ------
    InvalidRequestError
        Next to nothing comes back.
    """
    job_id, number, inputs, setup = (arguments[name] for name in ("job_id", "number", "inputs", "setup"))
    pose = RigidTransform.from_matrix(np.array(setup["world_from_scan"]))
    context.progress.report(0.0, "scanning")
    scene = scene_of(context, arguments)
    # one generator for each set-up: what one returns does not depend on the others
    rng = np.random.default_rng([inputs["seed"], number])
    scan = replace(scan_scene(scene, pose, scanner_of(inputs, setup["name"]), rng), name=setup["name"])
    if len(scan) < FEW_POINTS:
        raise InvalidRequestError(
            f"from the set-up '{setup['name']}' only {len(scan)} points come back: it stands away from the scene, "
            "inside of something, or beyond the instrument's reach"
        )
    context.progress.report(0.3, "writing")
    output: Json = {"name": setup["name"], "points": len(scan), **_written(context, job_id, inputs, scan, pose)}
    output["photos"] = _photos(context, job_id, inputs, scene, pose, setup["name"], rng)
    # the step that lists them sees none of these files
    photos = [artifact(context, job_id, photo["file"], "image/png").model_dump() for photo in output["photos"]]
    output["artifacts"] += photos
    output["sample"] = f"jobs/{job_id}/simulated/{number}-sample.npz"
    output |= {"features": None, "lines": None, "planes": None}
    scratch = context.blobs.scratch()
    try:
        chosen = np.unique(np.linspace(0, len(scan) - 1, SAMPLE).astype(np.int64))
        np.savez(scratch / "sample.npz", points=pose.apply(scan.points[chosen]))
        context.blobs.put_file(output["sample"], scratch / "sample.npz")
        if inputs["expect"]:
            section = ProgressSection(context.progress, 0.5, 1.0)
            features = extract_features(scan, FeatureOptions(), progress=section, rng=np.random.default_rng(0))
            features = with_symmetries(features, MatchingOptions())
            output |= {"lines": len(features.lines), "planes": len(features.planes)}
            output["features"] = f"jobs/{job_id}/simulated/{number}.npz"
            save_features(scratch / "features.npz", features)
            context.blobs.put_file(output["features"], scratch / "features.npz")
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return output


def _stated_pose(station: Json) -> RigidTransform:
    angles = [station[name] * RAD_PER_GON for name in ("heading_gon", "tilt_x_gon", "tilt_y_gon")]
    return station_pose(station["position_m"], *angles)


def _written(context: StepContext, job_id: str, inputs: Json, scan: Scan, pose: RigidTransform) -> Json:
    """Write the scan as a download."""
    writer = writer_of(inputs["format"])
    filename = f"{scan.name}{writer.ending}"
    placed = replace(scan, world_from_scan=pose) if inputs["with_poses"] else scan
    with output_file(context, job_id, filename) as path:
        written = writer.write(path, [cloud_of(placed)], ProgressSection(context.progress, 0.3, 0.5))
    described = artifact(context, job_id, filename, writer.media_type).model_dump()
    return {"file": filename, "artifacts": [described], "notes": list(written.notes)}


def _photos(
    context: StepContext,
    job_id: str,
    inputs: Json,
    scene: Scene,
    pose: RigidTransform,
    name: str,
    rng: np.random.Generator,
) -> list[Json]:
    """Take the photos of a station, and describe them as a request of `register` may repeat it."""
    wanted = inputs["photos"]
    if wanted is None:
        return []
    import cv2

    mount = top_mount(down_rad=wanted["down_gon"] * RAD_PER_GON)
    camera = VirtualCamera(camera=scanner_camera(wanted["scale"]), mount=mount)
    stated = [camera.scan_from_camera(turn) for turn in _headings(wanted["count"])]
    poses = [each * mount_error_of(inputs["errors"]) for each in stated]
    described = []
    for number, photo in enumerate(station_photos(scene, pose, camera, poses, rng), start=1):
        filename = f"{name}-photo-{number}.png"
        encoded, image = cv2.imencode(".png", photo.image[..., ::-1])
        if not encoded:
            raise OSError(filename)
        with output_file(context, job_id, filename) as path:
            path.write_bytes(image.tobytes())
        described.append(
            {
                "file": filename,
                "camera": camera_document(photo.camera),
                "scan_from_camera": matrix_rows(photo.scan_from_camera),
                "stated_scan_from_camera": matrix_rows(stated[number - 1]),
            }
        )
    # as JSON, which the output of a step is
    return list(json.loads(json.dumps(described)))


def _headings(count: int) -> Sequence[float]:
    return [float(turn) for turn in np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)]
