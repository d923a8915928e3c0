"""Photos of registered stations in their common frame, read when their pixels are needed."""

from collections.abc import Callable

from jaxtyping import UInt8
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array
from algorithms.colouring.photo_views import PlacedPhoto
from service.errors import UnreadableFileError
from service.formats import inspect_upload, read_photo
from service.names.content_keys import content_key
from service.ports import Json, StepContext
from service.use_cases.inputs.check_photos import camera_of
from service.use_cases.limits.read_limits import read_limits
from service.use_cases.steps.placed_stations import CommonFrame, pose_of
from service.use_cases.steps.station_photos import pose_of_camera


def placed_photos(context: StepContext, station: Json, frame: CommonFrame) -> list[PlacedPhoto]:
    """Give the photos of a station with cameras and poses: those of the request, else those that its file holds.

    Raises
    ------
    UnreadableFileError
        Neither request nor file has the camera or the pose of a requested photo.
    """
    common_from_world = RigidTransform.from_translation(-frame.origin_m)
    place = common_from_world * pose_of(station)
    requested = station["photos"] or _stored_photos(context, station["scan"])
    return [_placed(context, photo, station["name"], place) for photo in requested]


def _stored_photos(context: StepContext, scan: Json) -> list[Json]:
    """List the images of the scan's own file that have camera and pose."""
    path = context.blobs.local_path(content_key(scan["sha256"]))
    found = inspect_upload(path, scan["filename"], read_limits(context), scan.get("columns") or "")
    return [
        {"index": photo.index, "sha256": scan["sha256"], "filename": scan["filename"]}
        for photo in found.photos
        if photo.camera is not None and photo.scan_from_camera is not None and photo.scan == scan["index"]
    ]


def _placed(context: StepContext, photo: Json, station: str, place: RigidTransform) -> PlacedPhoto:
    """Place a photo; raises UnreadableFileError where neither request nor file has its camera or pose."""
    path = context.blobs.local_path(content_key(photo["sha256"]))
    found = read_photo(path, photo["filename"], photo["index"], read_limits(context))
    camera = found.info.camera if photo.get("camera") is None else camera_of(photo["camera"])
    pose = pose_of_camera(photo, found.info)
    if camera is None or pose is None:
        raise UnreadableFileError(photo["filename"], "camera or pose is not known", f"photo {photo['index']}")
    return PlacedPhoto(f"{photo['filename']} {photo['index']}", station, camera, place * pose, _reader(context, photo))


def _reader(context: StepContext, photo: Json) -> Callable[[], UInt8[Array, "h w 3"]]:
    """Give a function that reads the pixels of a photo: not all are kept in memory at once."""

    def read() -> UInt8[Array, "h w 3"]:
        path = context.blobs.local_path(content_key(photo["sha256"]))
        image = read_photo(path, photo["filename"], photo["index"], read_limits(context)).image
        if image is None:  # pragma: no cover - such a photo is refused by `read_photo`
            raise AssertionError
        return image

    return read
