"""What no schema can know of a calibration: names that must be there, and parameters of the chosen model."""

from collections.abc import Iterator, Sequence
from typing import TypeAlias

from schemas.requests.calibrate_camera_inputs import CalibrateCameraInputs, CalibrationField
from service.errors import FieldFault, InvalidRequestError
from service.ports import Stored
from service.use_cases.inputs.check_photos import photo_faults
from service.use_cases.inputs.validate_request import WRONG_FIELDS, pointer_to

MOST_FAULTS = 50
SYMMETRY = 1e-9
Covariance: TypeAlias = tuple[tuple[float, ...], ...]
LENS_PARAMETERS = {
    "opencv": ("f", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "b"),
    "brown": ("c", "x0", "y0", "K1", "K2", "K3", "P1", "P2", "b"),
    "brown-affinity-after": ("c", "x0", "y0", "K1", "K2", "K3", "P1", "P2", "b"),
}
"""Names of `algorithms.calibration.lenses`, which would load scipy into the web process."""


def check_calibration(inputs: CalibrateCameraInputs, stored: Stored) -> None:
    """Refuse what cannot be calibrated, with a pointer to every bad field.

    Raises
    ------
    InvalidRequestError
        Names that are unknown or used twice, parameters of another model, photos that are not there.
    """
    faults = list(_camera_faults(inputs))
    if inputs.field is not None:
        faults += _field_faults(inputs.field, mounted=inputs.mount is not None)
    for number, photo in enumerate(inputs.photos):
        faults += photo_faults(photo, stored.files, pointer_to("inputs", "photos", number))
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults[:MOST_FAULTS])


def _camera_faults(inputs: CalibrateCameraInputs) -> Iterator[FieldFault]:
    camera = inputs.camera
    known = LENS_PARAMETERS[camera.model]
    why = f"the model {camera.model} has {', '.join(known)}"
    for k, name in enumerate(camera.unknown or ()):
        if name not in known:
            yield FieldFault(pointer_to("inputs", "camera", "unknown", k), why)
    given: list[tuple[tuple[str, ...], Sequence[str]]] = [
        (("camera", "values"), list(camera.values)), (("camera", "std"), list(camera.std))
    ]  # fmt: skip
    if inputs.earlier is not None:
        given += [(("earlier", "values"), list(inputs.earlier.values)), (("earlier", "std"), list(inputs.earlier.std))]
        if known[0] not in inputs.earlier.values:
            yield FieldFault(pointer_to("inputs", "earlier", "values"), f"the principal distance {known[0]} is missing")
    for way, names in given:
        for each in names:
            if each not in known:
                yield FieldFault(pointer_to("inputs", *way, each), why)
    for name in camera.std:
        if name in known and name not in camera.values:
            yield FieldFault(pointer_to("inputs", "camera", "std", name), f"an observed {name} needs its value")


def _field_faults(field: CalibrationField, *, mounted: bool) -> Iterator[FieldFault]:
    where = ("inputs", "field")
    yield from _twice([target.name for target in field.targets], "targets")
    yield from _twice([photo.name for photo in field.photos], "photos")
    for k, target in enumerate(field.targets):
        here = pointer_to(*where, "targets", k)
        if target.xyz_m is None and (target.std_m is not None or target.covariance_m2 is not None):
            yield FieldFault(here, "a target without coordinates has no std or covariance")
        if target.std_m is not None and target.covariance_m2 is not None:
            yield FieldFault(here, "give either std_m or covariance_m2")
        if target.covariance_m2 is not None and not _positive_definite(target.covariance_m2):
            yield FieldFault(f"{here}/covariance_m2", "it is not symmetric and positive definite")
    for k, photo in enumerate(field.photos):
        if mounted and photo.cop_gon is None:
            yield FieldFault(pointer_to(*where, "photos", k, "cop_gon"), "with a mount every photo has its head angle")
    yield from _point_faults(field)


def _point_faults(field: CalibrationField) -> Iterator[FieldFault]:
    targets, photos = {target.name for target in field.targets}, {photo.name for photo in field.photos}
    pairs: set[tuple[str, str]] = set()
    for k, point in enumerate(field.image_points):
        here = pointer_to("inputs", "field", "image_points", k)
        if point.photo not in photos:
            yield FieldFault(f"{here}/photo", f"there is no photo {point.photo!r}")
        if point.target not in targets:
            yield FieldFault(f"{here}/target", f"there is no target {point.target!r}")
        if (point.photo, point.target) in pairs:
            yield FieldFault(here, f"{point.target!r} stands in that photo twice")
        pairs.add((point.photo, point.target))


def _twice(names: list[str], key: str) -> Iterator[FieldFault]:
    seen: set[str] = set()
    for k, name in enumerate(names):
        if name in seen:
            yield FieldFault(pointer_to("inputs", "field", key, k, "name"), f"{name!r} stands there twice")
        seen.add(name)


def _positive_definite(covariance: Covariance) -> bool:
    """Look at the leading minors; the web process has no linear algebra."""
    (a, b, c), (d, e, f), (g, h, i) = covariance
    scale = max(abs(a), abs(e), abs(i))
    symmetric = max(abs(b - d), abs(c - g), abs(f - h)) <= SYMMETRY * scale
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return symmetric and a > 0.0 and a * e - b * d > 0.0 and determinant > 0.0
