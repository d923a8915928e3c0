"""Read the photos of a station with their cameras and poses, and add their lines to those of the scan."""

import math
from collections.abc import Sequence

import numpy as np
from pydantic import TypeAdapter
from scipy.spatial.transform import RigidTransform

from algorithms.features.photo_lines.photo_line_options import PhotoLineOptions
from algorithms.features.photo_lines.photo_lines import add_photo_lines
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.camera_mounts import CameraAxes, scan_from_camera_with_axes, scan_from_mounted_camera
from algorithms.photos.station_photo import StationPhoto, mount_covariance
from algorithms.progress import Progress
from algorithms.scans.scan import Scan
from service.errors import UnreadableFileError
from service.formats import read_photo
from service.formats.photo import PhotoInfo
from service.names.content_keys import content_key
from service.ports import Json, StepContext
from service.use_cases.inputs.check_photos import camera_of
from service.use_cases.limits.read_limits import read_limits

GON = math.pi / 200.0


def with_photo_lines(
    features: ScanFeatures, scan: Scan, photos: Sequence[Json], options: Json, context: StepContext, progress: Progress
) -> ScanFeatures:
    """Add the lines of the photos of a station.

    Parameters
    ----------
    features, scan
        Of the station.
    photos
        As requested, each with the name of its file beside it.
    options
        Of detection and projection.
    context
        Where the files are.
    progress
        Is told the steps.

    Raises
    ------
    UnreadableFileError
        A photo cannot be read, or neither request nor file has its camera or pose.
    """
    chosen = TypeAdapter(PhotoLineOptions).validate_python(options)
    read = (read_station_photo(photo, context) for photo in photos)
    return add_photo_lines(features, scan, read, chosen, count=len(photos), progress=progress)


def read_station_photo(photo: Json, context: StepContext) -> StationPhoto:
    """Read one photo with its camera and pose; parameters and errors as `with_photo_lines`."""
    path = context.blobs.local_path(content_key(photo["sha256"]))
    found = read_photo(path, photo["filename"], photo["index"], read_limits(context))
    camera = found.info.camera if photo.get("camera") is None else camera_of(photo["camera"])
    pose = pose_of_camera(photo, found.info)
    if found.image is None or camera is None or pose is None:
        raise UnreadableFileError(photo["filename"], "camera or pose is not known", f"photo {photo['index']}")
    std = photo["mount_std"]
    return StationPhoto(
        image=found.image,
        camera=camera,
        scan_from_camera=pose,
        mount_covariance=mount_covariance(std["rotation_gon"] * GON, std["translation_m"]),
    )


def pose_of_camera(photo: Json, stored: PhotoInfo) -> RigidTransform | None:
    """Give scan_from_camera of a request, in OpenCV's axes: given, chained, or that of the file."""
    axes = CameraAxes(photo.get("camera_axes", CameraAxes.RIGHT_DOWN_FORWARD.value))
    if photo.get("scan_from_camera") is not None:
        return scan_from_camera_with_axes(_motion(photo["scan_from_camera"]), axes)
    if photo.get("mount") is None:
        return stored.scan_from_camera
    cop_rad = photo["cop_gon"] * GON if photo.get("cop") is None else _head_angle(photo["cop"])
    return scan_from_mounted_camera(_motion(photo["mount"]), cop_rad, axes)


def _motion(rows: list[list[float]]) -> RigidTransform:
    return RigidTransform.from_matrix(np.array(rows))


def _head_angle(rows: list[list[float]]) -> float:
    """Give the angle of a rotation about z [rad]."""
    return math.atan2(rows[1][0], rows[0][0])
