"""Describe mounts that edges tell of."""

import math
from collections.abc import Sequence
from typing import Literal, TypeAlias, cast

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Matrix6
from algorithms.calibration.edge_images import moved_mounts
from algorithms.calibration.natural_edges import PARAMETERS, EdgeCalibration, FoundMount
from algorithms.geometry.camera_mounts import CameraAxes, camera_from_axes
from algorithms.geometry.rotations import cross_matrix
from algorithms.photos.station_photo import mount_covariance
from schemas.results.mounts_result import (
    FoundMountDocument,
    Matrix4,
    MountChange,
    MountParameter,
    MountPhoto,
    OpenMount,
)
from service.ports import Json

GON = 200.0 / math.pi
Status: TypeAlias = Literal["confirmed", "wrong", "ambiguous", "undetermined"]
UNITS = np.array([GON] * 3 + [1e3] * 3)
LEAST_SHARE = 0.1
"""Smaller shares of an open combination are not named."""
ADVICE = {
    "rotation": "photograph edges of other directions, horizontal as well as vertical ones, all over the format",
    "shift": "photograph edges much nearer and much farther than those found, in one photo or in several stations: "
    "with all of them equally far a shift looks like a rotation",
}


def mount_std_of(photo: Json) -> Matrix6:
    """Give the covariance (6, 6) of a stated pose: equal about all axes, so in any axes."""
    std = photo["mount_std"]
    return mount_covariance(std["rotation_gon"] / GON, std["translation_m"])


def stated_mount(photo: Json) -> RigidTransform | None:
    """Give a stated M_mount in the axes right-down-forward; None where the pose was stated otherwise."""
    if photo.get("mount") is None:
        return None
    axes = CameraAxes(photo.get("camera_axes", CameraAxes.RIGHT_DOWN_FORWARD.value))
    return camera_from_axes(axes) * RigidTransform.from_matrix(np.array(photo["mount"]))


def mount_document(
    found: FoundMount, name: str, photos: list[str], stated: RigidTransform | None, std: Matrix6, inputs: Json
) -> FoundMountDocument:
    """Describe a mount."""
    status = _status(found)
    correction = moved_mounts(RigidTransform.identity(), found.error)
    stds, detectable = found.stds, found.detectable
    parameters = [
        MountParameter(
            name=PARAMETERS[k], unit="gon" if k < 3 else "mm",
            value=float(found.error[k] * UNITS[k]) if found.determined[k] else None,
            std=float(stds[k] * UNITS[k]) if found.determined[k] else None,
            detectable=float(detectable[k] * UNITS[k]) if np.isfinite(detectable[k]) else None,
        )
        for k in range(6)
    ]  # fmt: skip
    tested = found.degrees_of_freedom > 0
    return FoundMountDocument(
        name=name, photos=photos, status=status, text=_words(found, name, status), parameters=parameters,
        covariance=found.covariance.tolist(), correction=rows_of(correction),
        mount=None if stated is None else rows_of(correction.inv() * stated),
        open=_open(found), statistic=found.statistic if tested else None,
        degrees_of_freedom=found.degrees_of_freedom, critical=found.critical if tested else None,
        allowed_by_std=found.statistic_if(std) <= found.critical if tested else None,
        edges=int(found.pair_counts.sum()), candidates=found.candidate_count, rivalry=found.rivalry,
        median_before_px=_finite(found.median_before_px), median_after_px=_finite(found.median_after_px),
        changes=[_change(found, distance) for distance in inputs["distances_m"]],
    )  # fmt: skip


def _status(found: FoundMount) -> Status:
    if found.degrees_of_freedom == 0:
        return "undetermined"
    if found.ambiguous:
        return "ambiguous"
    if found.wrong:
        return "wrong"
    return "confirmed" if found.degrees_of_freedom == 6 else "undetermined"


def _words(found: FoundMount, name: str, status: Status) -> str:
    edges = f"{int(found.pair_counts.sum())} edges of the photos show lines of the scan"
    turn = np.linalg.norm(found.error[:3]) * GON
    shift = np.linalg.norm(found.error[3:]) * 1e3
    said = f"{turn:.3f} gon and {shift:.1f} mm"
    if status == "wrong":
        words = (
            f"{name}: the stated mount is wrong by {said} ({edges}, T = {found.statistic:.1f} > {found.critical:.1f}); "
            f"their median gap falls from {found.median_before_px:.2f} to {found.median_after_px:.2f} px"
        )
    elif status == "confirmed":
        words = f"{name}: the stated mount fits ({edges}, T = {found.statistic:.1f}, limit {found.critical:.1f})"
    elif status == "ambiguous":
        words = (
            f"{name}: another rotation explains the edges nearly as well ({edges}), so no correction is given; add "
            "photos or stations with other edges, or look less far"
        )
    elif found.degrees_of_freedom:
        words = f"{name}: what can be tested fits ({edges}), but not all of the mount can"
    else:
        words = f"{name}: too few edges to tell anything of the mount ({edges})"
    return "; ".join([words, *dict.fromkeys(each.advice for each in _open(found))])


def _open(found: FoundMount) -> list[OpenMount]:
    described = []
    for direction in found.open_directions:
        shares = direction * np.sign(direction[np.argmax(np.abs(direction))])
        order = [k for k in np.argsort(-np.abs(shares)).tolist() if abs(shares[k]) > LEAST_SHARE]
        in_units = shares * found.reach * UNITS * np.array([1e3] * 3 + [1.0] * 3)
        kind = "rotation" if order[0] < 3 else "shift"
        described.append(OpenMount(parameters={PARAMETERS[k]: float(in_units[k]) for k in order}, advice=ADVICE[kind]))
    return described


def _change(found: FoundMount, distance_m: float) -> MountChange:
    jacobian = np.hstack([-cross_matrix(np.array([0.0, 0.0, distance_m])), np.eye(3)])
    largest = float(np.linalg.eigvalsh(jacobian @ found.covariance @ jacobian.T)[-1])
    return MountChange(
        distance_m=distance_m,
        change_mm=1e3 * float(np.linalg.norm(jacobian @ found.error)),
        std_mm=1e3 * math.sqrt(max(largest, 0.0)),
    )


def photo_documents(
    done: EdgeCalibration,
    stations: Sequence[int],
    requested: Sequence[Json],
    inputs: Json,
    poses: Sequence[RigidTransform],
) -> list[MountPhoto]:
    """Describe the photos."""
    counted: dict[int, int] = {}
    described = []
    for q, (station, photo, pose) in enumerate(zip(stations, requested, poses, strict=True)):
        counted[station] = counted.get(station, 0) + 1
        left = done.residuals[done.pairs.photos == q]
        described.append(
            MountPhoto(
                station=inputs["stations"][station]["name"], photo=counted[station], file=photo["filename"],
                edges=len(left), rms_px=float(np.sqrt(np.mean(np.square(left)))) if len(left) else None,
                scan_from_camera=rows_of(pose),
            )
        )  # fmt: skip
    return described


def corrected_photo(requested: Json, found: MountPhoto, mount: FoundMountDocument) -> Json:
    """Give a photo of a photo list: as requested, its pose and how well it is known from the edges."""
    kept = {
        key: value
        for key, value in requested.items()
        if key in {"index", "camera", "camera_axes", "mount", "cop", "cop_gon", "scan_from_camera", "mount_std"}
        and value is not None
    }
    if mount.status != "wrong":
        return {"file": requested["filename"], **kept}
    for key in ("camera_axes", "mount", "cop", "cop_gon"):
        kept.pop(key, None)
    kept["scan_from_camera"] = [list(row) for row in found.scan_from_camera]
    spread = np.sqrt(np.diag(np.array(mount.covariance)))
    kept["mount_std"] = {
        "rotation_gon": float(spread[:3].max() * GON),
        "translation_m": float(spread[3:].max()),
    }
    return {"file": requested["filename"], **kept}


def rows_of(motion: RigidTransform) -> Matrix4:
    """Give a motion as rows."""
    return cast("Matrix4", tuple(tuple(float(value) for value in row) for row in motion.as_matrix().tolist()))


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
