"""Measure the found targets in the photos of their station, and write them as other processes take them."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array
from algorithms.geometry.angles import angles_from_rotation
from algorithms.geometry.camera_mounts import CameraAxes, camera_from_axes
from algorithms.geometry.cameras import Camera
from algorithms.photos.station_photo import StationPhoto
from algorithms.targets.finding import TargetsOfScan
from algorithms.targets.photo_agreement import ImagePoint, NotSeen
from algorithms.targets.photo_points import find_in_photo
from schemas.results.targets_result import PhotoTargetDocument, PhotoTargetsDocument, TargetDocument, UnseenTarget
from service.formats.writers.csv_table import csv_text
from service.ports import Json, StepContext
from service.use_cases.steps.station_photos import read_station_photo

GON = 200.0 / math.pi
CSV_COLUMNS = (
    *("photo", "target", "x_px", "y_px", "cov_xx_px2", "cov_xy_px2", "cov_yy_px2"),
    *("expected_x_px", "expected_y_px", "statistic", "agreement", "contrast"),
)


@dataclass(frozen=True, eq=False)
class SeenPhoto:
    """A photo without its pixels, and what it shows."""

    name: str
    request: Json
    camera: Camera
    scan_from_camera: Array
    """(4, 4)."""
    answers: list[ImagePoint | NotSeen]

    @property
    def points(self) -> list[ImagePoint]:
        """Give what was measured."""
        return [each for each in self.answers if isinstance(each, ImagePoint)]


def seen_in_photos(
    context: StepContext, photos: Sequence[Json], targets: TargetsOfScan, origin: Array
) -> list[SeenPhoto]:
    """Measure targets in one photo after the other; parameters and errors as `find_in_photo`, `read_station_photo`."""
    seen: list[SeenPhoto] = []
    for number, request in enumerate(photos):
        context.progress.report(0.5 + 0.5 * number / len(photos), "photos")
        photo: StationPhoto = read_station_photo(request, context)
        name = request["filename"] if request["index"] == 0 else f"{request['filename']} {request['index']}"
        if name in {each.name for each in seen}:
            name = f"{name} ({number + 1})"
        answers = find_in_photo(photo, targets.found, origin)
        seen.append(SeenPhoto(name, request, photo.camera, photo.scan_from_camera.as_matrix(), answers))
    return seen


def photo_documents(seen: Sequence[SeenPhoto], names: Sequence[str]) -> list[PhotoTargetsDocument]:
    """Describe what photos show of targets with names."""
    return [
        PhotoTargetsDocument(
            name=photo.name,
            file=photo.request["file"],
            index=photo.request["index"],
            points=[
                PhotoTargetDocument(
                    target=names[point.target],
                    x_px=float(point.image_px[0]),
                    y_px=float(point.image_px[1]),
                    covariance_px2=_rows(point.covariance_px2),
                    std_px=math.sqrt(0.5 * float(np.trace(point.covariance_px2))),
                    expected_px=(float(point.expected_px[0]), float(point.expected_px[1])),
                    expected_covariance_px2=_rows(point.expected_covariance_px2),
                    statistic=point.statistic,
                    agreement=point.agreement,
                    contrast=point.contrast,
                )
                for point in photo.points
            ],
            not_seen=[
                UnseenTarget(target=names[each.target], reason=each.reason)
                for each in photo.answers
                if isinstance(each, NotSeen) and each.reason
            ],
        )
        for photo in seen
    ]


def _rows(covariance: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    (xx, xy), (yx, yy) = covariance.tolist()
    return (xx, xy), (yx, yy)


def image_files(
    station: str, seen: Sequence[SeenPhoto], targets: Sequence[TargetDocument]
) -> dict[str, tuple[str, bytes]]:
    """Write the image points as a table, and as requests for `adjust` and `calibrate-camera`; none without points."""
    if not any(photo.points for photo in seen):
        return {}
    files = {"image-points.csv": ("text/csv", _table(seen, targets).encode())}
    files["hybrid-network.json"] = ("application/json", json.dumps(hybrid_network(station, seen, targets)).encode())
    files["calibration-field.json"] = ("application/json", json.dumps(calibration_field(seen, targets)).encode())
    return files


def _table(seen: Sequence[SeenPhoto], targets: Sequence[TargetDocument]) -> str:
    rows = []
    for photo in seen:
        for point in photo.points:
            (xx, xy), (_, yy) = point.covariance_px2.tolist()
            measured = (*point.image_px.tolist(), xx, xy, yy, *point.expected_px.tolist())
            name = targets[point.target].name
            rows.append([photo.name, name, *measured, point.statistic, point.agreement, point.contrast])
    return csv_text(CSV_COLUMNS, rows)


def calibration_field(seen: Sequence[SeenPhoto], targets: Sequence[TargetDocument]) -> Json:
    """Give the layout `calibration-field/1`: targets in the scan's frame, photos of one camera, image points."""
    shown = sorted({point.target for photo in seen for point in photo.points})
    photos = [photo for photo in seen if photo.points]
    return {
        "format": "calibration-field/1",
        "targets": [
            {"name": targets[k].name, "xyz_m": targets[k].xyz_m, "covariance_m2": targets[k].covariance_m2}
            for k in shown
        ],
        "photos": [{"name": photo.name, "cop_gon": head_angle_gon(photo.request)} for photo in photos],
        "image_points": [
            {
                "photo": photo.name,
                "target": targets[point.target].name,
                "x": float(point.image_px[0]),
                "y": float(point.image_px[1]),
                "std_px": math.sqrt(0.5 * float(np.trace(point.covariance_px2))),
            }
            for photo in photos
            for point in photo.points
        ],
    }


def head_angle_gon(photo: Json) -> float | None:
    """Give the angle of the head of a requested photo [gon]; None where it has a pose instead."""
    if photo.get("cop") is not None:
        return math.atan2(photo["cop"][1][0], photo["cop"][0][0]) * GON
    return photo.get("cop_gon")


def hybrid_network(station: str, seen: Sequence[SeenPhoto], targets: Sequence[TargetDocument]) -> Json:
    """Give the layout `hybrid-network/1`: the station, its targets as coordinates, its photos with observed mounts.

    Networks of several stations are joined by joining these lists.
    """
    photos = [photo for photo in seen if photo.points]
    shown = sorted({point.target for photo in photos for point in photo.points})
    cameras: list[Camera] = []
    for photo in photos:
        if photo.camera not in cameras:
            cameras.append(photo.camera)
    stations: list[Json] = [{"id": station}]
    for photo in photos:
        carried = {"id": _id(station, photo), "type": "photo", "carrier": station, "mount": _id(station, photo)}
        stations.append({**carried, "camera": f"{station}: camera {cameras.index(photo.camera) + 1}"})
    return {
        "format": "hybrid-network/1",
        "stations": stations,
        "cameras": [{"id": f"{station}: camera {k}", **network_camera(each)} for k, each in enumerate(cameras, 1)],
        "mounts": [
            {
                "id": _id(station, photo),
                "approx": _mount_pose(photo.scan_from_camera),
                "state": "observed",
                "rotation_std": photo.request["mount_std"]["rotation_gon"],
                "translation_std_m": photo.request["mount_std"]["translation_m"],
            }
            for photo in photos
        ],
        "points_approx": {targets[k].name: targets[k].xyz_m for k in shown},
        "observations": {
            "coordinates": [
                {
                    "station": station,
                    "point": targets[k].name,
                    "xyz": targets[k].xyz_m,
                    "covariance": targets[k].covariance_m2,
                }
                for k in shown
            ],
            "image": [
                {
                    "photo": _id(station, photo),
                    "point": targets[point.target].name,
                    "x": float(point.image_px[0]),
                    "sigma_x": math.sqrt(float(point.covariance_px2[0, 0])),
                    "y": -float(point.image_px[1]),
                    "sigma_y": math.sqrt(float(point.covariance_px2[1, 1])),
                }
                for photo in photos
                for point in photo.points
            ],
        },
    }


def _id(station: str, photo: SeenPhoto) -> str:
    return f"{station}: {photo.name}"


def _mount_pose(scan_from_camera: Array) -> Json:
    """Give the pose of a camera (right, up, backward) in its scan's frame, which is the station's, in gon."""
    from scipy.spatial.transform import Rotation

    axes = camera_from_axes(CameraAxes.RIGHT_UP_BACKWARD).rotation.as_matrix()
    angles = angles_from_rotation(Rotation.from_matrix(scan_from_camera[:3, :3] @ axes)) * GON
    place = dict(zip("XYZ", scan_from_camera[:3, 3].tolist(), strict=True))
    return {**place, **dict(zip(("omega", "phi", "kappa"), angles.tolist(), strict=True))}


def network_camera(camera: Camera) -> Json:
    """Give a camera as networks have it: image points x to the right and y up from the centre of the first pixel.

    Brown's terms are per pixel there: A1 = k1 / c², B1 = p2 / c, B2 = -p1 / c with y up, and C1 = fx / fy - 1 stretches
    the ideal x, where it should stretch the distorted one: 1e-4 of the distortion for pixels that are square to that.
    """
    c = camera.fy
    terms = {"A1": camera.k1 / c**2, "A2": camera.k2 / c**4, "A3": camera.k3 / c**6}
    terms |= {"B1": camera.p2 / c, "B2": -camera.p1 / c, "C1": camera.fx / camera.fy - 1.0}
    return {"principal_distance_px": c, "x0_px": camera.cx, "y0_px": -camera.cy, "distortion": terms}
