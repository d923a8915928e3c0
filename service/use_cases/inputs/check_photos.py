"""Check what the schema of a request cannot know of photos: that they exist, fit their camera and have a pose."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from algorithms.errors import InvalidInputError
from schemas.requests.register_inputs import ScanReference
from schemas.values.photos import CameraRequest, PhotoReference, StationPhoto
from service.errors import FieldFault, InvalidRequestError
from service.names.identifiers import is_identifier
from service.ports import FileStore, Json, StoredFile
from service.use_cases.inputs.check_cameras import camera_faults, place_faults
from service.use_cases.inputs.validate_request import WRONG_FIELDS, pointer_to

if TYPE_CHECKING:
    from algorithms.geometry.cameras import Camera


def check_photo(photo: PhotoReference, files: FileStore) -> None:
    """Check the photo of `detect-edges`.

    Raises
    ------
    InvalidRequestError
        With a pointer to every bad field.
    """
    faults = list(photo_faults(photo, files, "/inputs/photo"))
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


def photo_faults(photo: PhotoReference, files: FileStore, where: str) -> Iterable[FieldFault]:
    """Name what is wrong with the file, the number or the camera of a photo; a camera need not be known.

    Parameters
    ----------
    photo
        As requested.
    files
        Where its file should be.
    where
        Pointer to it in the request.
    """
    found = _found(photo, files, where)
    if isinstance(found, FieldFault):
        yield found
    elif photo.camera is not None:
        yield from _camera_faults(photo.camera, found, f"{where}/camera")


def station_photo_faults(
    photos: Sequence[StationPhoto], scan: ScanReference, files: FileStore, where: str
) -> Iterable[FieldFault]:
    """Name what is wrong with the photos of a station: each needs a file, a camera and a pose.

    Parameters
    ----------
    photos, scan
        Of the station.
    files
        Where their files should be.
    where
        Pointer to the list of photos in the request.
    """
    seen: set[tuple[str, int]] = set()
    bounds_m = _bounds_m(scan, files)
    for number, photo in enumerate(photos):
        here = where + pointer_to(number)
        if (photo.file, photo.index) in seen:
            yield FieldFault(here, "this photo is listed twice")
        seen.add((photo.file, photo.index))
        yield from photo_faults(photo, files, here)
        found = _found(photo, files, here)
        document = None if isinstance(found, FieldFault) else found
        if document is not None and photo.camera is None and document.get("camera") is None:
            remark = " ".join(document.get("remarks", []))
            yield FieldFault(
                f"{here}/camera",
                f"the interior orientation is missing: give it, the file does not carry it. {remark}".rstrip(),
            )
        yield from _pose_faults(photo, document, scan, bounds_m, here)


def _bounds_m(scan: ScanReference, files: FileStore) -> Sequence[Sequence[float]] | None:
    """Give the corners of a scan; None where they are not known."""
    file = files.get(scan.file) if scan.file is not None and is_identifier(scan.file) else None
    document = next((each for each in file.scans if each["index"] == scan.index), None) if file is not None else None
    return None if document is None else document.get("bounds_m")


def _found(photo: PhotoReference, files: FileStore, where: str) -> Json | FieldFault:
    """Give the document of a photo, or what is wrong with the reference."""
    file = files.get(photo.file) if is_identifier(photo.file) else None
    if file is None:
        return FieldFault(f"{where}/file", f"there is no file '{photo.file}'; POST /files uploads one")
    if not file.photos:
        return FieldFault(f"{where}/file", f"the file '{file.name}' holds no photo")
    document = next((each for each in file.photos if each["index"] == photo.index), None)
    if document is None:
        return FieldFault(f"{where}/index", _numbers(file))
    if document.get("refused"):
        return FieldFault(
            f"{where}/index", f"photo {photo.index} of '{file.name}' cannot be used: {document['refused']}"
        )
    return document


def _numbers(file: StoredFile) -> str:
    numbers = [str(each["index"]) for each in file.photos]
    listed = ", ".join(numbers[:20]) + (", …" if len(numbers) > 20 else "")
    return f"the file '{file.name}' holds {len(numbers)} photo(s), numbered {listed}"


def _camera_faults(camera: CameraRequest, photo: Json, where: str) -> Iterable[FieldFault]:
    wrong = [side for side in ("width", "height") if getattr(camera, side) != photo[side]]
    for side in wrong:
        detail = f"the photo has a {side} of {photo[side]} px; a camera is calibrated for one size of photo"
        yield FieldFault(f"{where}/{side}", detail)
    if len(wrong) == 2 and (camera.width, camera.height) == (photo["height"], photo["width"]):
        detail = "width and height are exchanged: they count the columns and rows of the photo as it is stored"
        yield FieldFault(where, detail)
    impossible = list(camera_faults(camera, where))
    yield from impossible
    if not wrong and not impossible:
        try:
            camera_of(camera.model_dump())
        except InvalidInputError as fault:
            yield FieldFault(where, f"{fault.why} ({fault.advice})")


def _pose_faults(
    photo: StationPhoto,
    document: Json | None,
    scan: ScanReference,
    bounds_m: Sequence[Sequence[float]] | None,
    where: str,
) -> Iterable[FieldFault]:
    chain = [name for name in ("mount", "cop", "cop_gon") if getattr(photo, name) is not None]
    if photo.scan_from_camera is not None:
        yield from place_faults(photo.scan_from_camera, bounds_m, f"{where}/scan_from_camera")
        yield from (
            FieldFault(f"{where}/{name}", "give either scan_from_camera, or mount with cop or cop_gon")
            for name in chain
        )
    elif "mount" in chain and len(chain) == 3:
        yield FieldFault(f"{where}/cop_gon", "the angle of the head is given twice: as cop and as cop_gon")
    elif chain == ["mount"]:
        yield FieldFault(f"{where}/cop", "the angle of the head is missing: give cop (matrix) or cop_gon (angle)")
    elif chain and "mount" not in chain:
        yield FieldFault(f"{where}/mount", "the mount matrix is missing: scan_from_camera = M_COP M_mount⁻¹")
    elif not chain and document is not None:
        yield from _stored_pose_faults(photo, document, scan, f"{where}/scan_from_camera")


def _stored_pose_faults(photo: StationPhoto, document: Json, scan: ScanReference, where: str) -> Iterable[FieldFault]:
    if document.get("scan_from_camera") is None:
        detail = "the pose of the camera is missing: give it (or mount with cop), the file does not carry it."
        yield FieldFault(where, f"{detail} {' '.join(document.get('remarks', []))}".rstrip())
    elif photo.file != scan.file or document.get("scan") != scan.index:
        yield FieldFault(
            where,
            f"the file has the pose of the camera in the frame of its scan {document.get('scan')}, which is not the "
            "scan of this station: give the pose in this scan's frame",
        )


def camera_of(document: dict[str, Any]) -> "Camera":
    """Build the camera of a request or a file document.

    Raises
    ------
    InvalidInputError
        No camera can have these parameters.
    """
    from algorithms.geometry.cameras import Camera  # here: the web process knows no numpy until the first camera comes

    return Camera(**{name: value for name, value in document.items() if name != "model"})
