"""Stations of virtual scenes with a scan and photos each, and pairs of them registered as the service does it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from types import MappingProxyType

import numpy as np
from scipy import stats
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.photo_lines.photo_line_options import PhotoLineOptions
from algorithms.features.photo_lines.photo_lines import add_photo_lines
from algorithms.features.scan_features import ScanFeatures
from algorithms.photos.station_photo import StationPhoto, mount_covariance
from algorithms.progress import NoProgress
from algorithms.registration.base import PairResult, RegistrationProblem
from algorithms.registration.lines import LinesMethod
from algorithms.scans.scan import Scan
from algorithms.simulation.bridge import _banks, bridge_parts
from algorithms.simulation.rendering import station_photos
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scene import Scene, scene_from_parts
from algorithms.simulation.scenes import SCENES
from algorithms.simulation.stations import station_pose
from algorithms.simulation.sun import MORNING, Daylight
from algorithms.simulation.virtual_camera import VirtualCamera, head_angle_towards, scanner_camera

GON = np.pi / 200.0
MOST_NEES = float(stats.chi2.isf(0.001, 6))
"""Squared error of a pose in standard deviations that one honest pose in a thousand exceeds."""
SCANNER = VirtualScanner(rows=500, columns=1200)
"""Every 0.3 degrees: 0.4 million points at most."""
HALF, FULL = 0.5, 1.0
"""Scales of the photos: 1504 by 1000 and 3008 by 2000 pixels."""
TOWARDS_M: Mapping[str, tuple[tuple[float, float, float], ...]] = MappingProxyType(
    {
        "house_front": ((5.5, 0.0, 2.5),),
        "bridge": ((0.0, 0.0, 4.0),),
        "bare_bridge": ((0.0, 0.0, 4.0),),
    }
)
"""What the photos of every station look at, one after the other."""
DOWNSTREAM: Mapping[str, RigidTransform] = MappingProxyType(
    {
        "opposite": station_pose((9.6, 14.4, 2.2), 0.8, 0.012, 0.01),
        "beyond": station_pose((-10.0, 14.2, 2.2), 2.1, 0.01, -0.015),
    }
)
"""Other places for the bridge's second station: the far side of the bridge, on the right and on the left bank."""
SHIFT_M, LARGEST_TILT_RAD = 0.1, np.radians(6.0)
"""How far set-ups lie from the recommended ones along each axis, and how much more they are tilted."""
FAR_M = 50.0
"""Files put their origin up to so far from the instrument, along each axis."""
MOUNT_STD = (0.001, 0.0001)
"""Of rotation [gon] and translation [m]: the virtual camera sits where it is said to sit."""


@dataclass(frozen=True, eq=False)
class Station:
    """What was recorded at one station, in the frame of its file."""

    scan: Scan
    photos: tuple[StationPhoto, ...]
    """With the true poses; `features_of` tells how well they are known."""
    world_from_scan: RigidTransform


@dataclass(frozen=True, eq=False)
class Pair:
    """Two stations' features, the result, and how far it is from the truth."""

    target: ScanFeatures
    source: ScanFeatures
    result: PairResult
    true: RigidTransform
    """Target from source."""
    instrument_m: np.ndarray
    """(3,) the source's instrument in its file's frame."""

    @property
    def status(self) -> str:
        """Of the result."""
        return self.result.status.value

    @property
    def error(self) -> np.ndarray:
        """(6,) rotation vector (left, target axes) [rad] and translation [m], true minus found."""
        found = self._found
        turn = (self.true.rotation * found.rotation.inv()).as_rotvec()
        return np.concatenate([turn, self.true.translation - found.translation])

    @property
    def rotation_error_gon(self) -> float:
        """Angle between the true and the found rotation."""
        return float(np.linalg.norm(self.error[:3]) / GON)

    @property
    def position_error_m(self) -> float:
        """How far the source's instrument lies from its true place."""
        return float(np.linalg.norm(self.true.apply(self.instrument_m) - self._found.apply(self.instrument_m)))

    @property
    def covariance(self) -> np.ndarray:
        """(6, 6) as reported."""
        assert self.result.fine is not None
        return self.result.fine.pose.covariance

    @property
    def nees(self) -> float:
        """Squared error in standard deviations: chi-square with 6 degrees of freedom where the covariance is honest."""
        return float(self.error @ np.linalg.solve(self.covariance, self.error))

    @property
    def position_std_m(self) -> float:
        """Largest standard deviation of the source's instrument in any direction."""
        assert self.result.fine is not None
        lever = self._found.apply(self.instrument_m) - self._found.translation
        x, y, z = lever
        by_pose = np.hstack([np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]]), np.eye(3)])
        return float(np.sqrt(np.linalg.eigvalsh(by_pose @ self.covariance @ by_pose.T)[-1]))

    @property
    def rotation_std_gon(self) -> float:
        """Largest standard deviation of the rotation about any axis."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]) / GON)

    @property
    def words(self) -> str:
        """Give status, reasons and figures for messages."""
        figures = ""
        if self.result.fine is not None:
            figures = (
                f" {self.rotation_error_gon:.5f} gon, {self.position_error_m * 1e3:.2f} mm, normalised {self.nees:.1f}"
            )
        return f"{self.status}{figures}: {'; '.join(self.result.reasons)}"

    @property
    def _found(self) -> RigidTransform:
        assert self.result.fine is not None
        return self.result.fine.pose.target_from_source


def bare_bridge_scene() -> Scene:
    """Build the bridge between its banks without anything that tells one end from the other."""
    return scene_from_parts("bare_bridge", [*bridge_parts(), *_banks()], SCENES["bridge"]().stations)


def record(
    scene: Scene,
    number: int,
    rng: np.random.Generator,
    *,
    camera: VirtualCamera,
    daylight: Daylight = MORNING,
    scanner: VirtualScanner = SCANNER,
) -> Station:
    """Scan and photograph a scene from near a recommended station; the file's frame is any frame.

    Parameters
    ----------
    scene
        One of `TOWARDS_M`.
    number
        Of the recommended station.
    rng
        Of set-up, file's frame and noise.
    camera, scanner
        Data sheets.
    daylight
        Of all photos.
    """
    pose = _set_up(scene.stations[number], rng)
    scan = scan_scene(scene, pose, scanner, rng)
    cameras = [
        camera.scan_from_camera(head_angle_towards(pose, np.array(point_m))) for point_m in TOWARDS_M[scene.name]
    ]
    file_from_scan = RigidTransform.from_components(rng.uniform(-FAR_M, FAR_M, 3), Rotation.random(rng=rng))
    photos = tuple(
        StationPhoto(photo.image, photo.camera, file_from_scan * photo.scan_from_camera, np.eye(6))
        for photo in station_photos(scene, pose, camera, cameras, rng, daylight)
    )
    moved = replace(
        scan,
        points=file_from_scan.apply(scan.points),
        sensor_m=np.asarray(file_from_scan.translation, dtype=np.float64),
    )
    return Station(moved, photos, pose * file_from_scan.inv())


def features_of(
    station: Station,
    *,
    mount_std: tuple[float, float] = MOUNT_STD,
    mount_error_rad: Sequence[float] = (0.0, 0.0, 0.0),
    with_photos: bool = True,
) -> ScanFeatures:
    """Extract the features of a station as the service does.

    Parameters
    ----------
    station
        What was recorded.
    mount_std
        How well the photos' poses are said to be known: rotation [gon], translation [m].
    mount_error_rad
        (3,) rotation vector in camera axes by which all stated poses are wrong.
    with_photos
        False: the scan alone.
    """
    features = extract_features(station.scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))
    if not with_photos:
        return features
    wrong = RigidTransform.from_rotation(Rotation.from_rotvec(np.asarray(mount_error_rad)))
    covariance = mount_covariance(mount_std[0] * GON, mount_std[1])
    photos = [
        replace(photo, scan_from_camera=photo.scan_from_camera * wrong, mount_covariance=covariance)
        for photo in station.photos
    ]
    return add_photo_lines(features, station.scan, photos, PhotoLineOptions(), count=len(photos), progress=NoProgress())


def registered(stations: tuple[Station, Station], target: ScanFeatures, source: ScanFeatures) -> Pair:
    """Register the features of two stations, target first."""
    result = LinesMethod().register(RegistrationProblem(target, source), progress=NoProgress())
    true = stations[0].world_from_scan.inv() * stations[1].world_from_scan
    assert stations[1].scan.sensor_m is not None
    return Pair(target, source, result, true, stations[1].scan.sensor_m)


@cache
def stations_of(scene_name: str, seed: int, scale: float = HALF, second: str = "second") -> tuple[Station, Station]:
    """Record two stations of a scene; the seed decides set-ups, frames and noise."""
    scene = bare_bridge_scene() if scene_name == "bare_bridge" else SCENES[scene_name]()
    if second != "second":
        scene = replace(scene, stations=(scene.stations[0], DOWNSTREAM[second]))
    camera = VirtualCamera(camera=scanner_camera(scale))
    first, other = (record(scene, k, np.random.default_rng([seed, k]), camera=camera) for k in (0, 1))
    return first, other


@cache
def pair_of(
    scene_name: str, seed: int, *, scale: float = HALF, second: str = "second", with_photos: bool = True
) -> Pair:
    """Register two stations of a scene, with or without their photos.

    Parameters
    ----------
    scene_name
        One of `TOWARDS_M`.
    seed
        Of everything random.
    scale
        Of the photos.
    second
        Where the second station is: as the scene recommends, or one of `DOWNSTREAM`.
    with_photos
        False: the scans alone.
    """
    stations = stations_of(scene_name, seed, scale, second)
    target, source = (features_of(station, with_photos=with_photos) for station in stations)
    return registered(stations, target, source)


def _set_up(station: RigidTransform, rng: np.random.Generator) -> RigidTransform:
    """Put an instrument near a station, turned about the vertical and a little tilted."""
    axis = np.append(rng.normal(size=2), 0.0)
    tilt = Rotation.from_rotvec(rng.uniform(0.0, LARGEST_TILT_RAD) * axis / np.linalg.norm(axis))
    turn = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
    place = station.translation + rng.uniform(-SHIFT_M, SHIFT_M, 3)
    return RigidTransform.from_components(place, turn * tilt * station.rotation)
