"""Clean registered scans step by step, and count what every step took away."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Flags, Indices, Labels, Points, Scalars, Vector3
from algorithms.cleaning.best_view import beam_cosines, best_views, point_normals
from algorithms.cleaning.comet_tails import comet_tails
from algorithms.cleaning.crop import (
    at_distance,
    check_box,
    check_distance,
    check_polygon,
    in_box,
    in_polygon,
)
from algorithms.cleaning.moved_objects import in_free_space, seen_space, whole_pieces
from algorithms.cleaning.options import CleaningOptions, MovedObjects
from algorithms.cleaning.smoothing import SmoothedCloud, SmoothingPass, smoothed
from algorithms.cleaning.thinning import curvature_thinned, voxel_thinned
from algorithms.errors import InvalidInputError
from algorithms.progress import Progress, ProgressSection
from algorithms.scans.mixed_pixels import angular_step
from algorithms.scans.scan import Scan

CLOUD_STEP_RAD = float(np.radians(0.2))
"""The angle between the points of a scan without rows and columns is not known; range images take this."""


@dataclass(frozen=True, eq=False)
class PlacedScan:
    """A scan and where it lies."""

    scan: Scan
    common_from_scan: RigidTransform
    """Maps the reduced points of the scan to the common frame less its origin."""

    def points(self) -> Points:
        """Give the points in the common frame less its origin, (n, 3) [m]."""
        return np.asarray(self.common_from_scan.apply(self.scan.points))


def placed(scan: Scan, world_from_scan: RigidTransform, origin_m: Vector3) -> PlacedScan:
    """Place a scan by the pose of its full coordinates; `origin_m` of the common frame keeps numbers small."""
    rotation = world_from_scan.rotation
    shift = world_from_scan.translation - origin_m + rotation.apply(scan.origin_m)
    return PlacedScan(scan, RigidTransform.from_components(shift, rotation))


@dataclass(frozen=True)
class StepCount:
    """What one step did to the points of one station or of all."""

    step: str
    """Name of the option that asked for it."""
    station: str
    before: int
    """Points before the step."""
    removed: int
    """Points that it left out."""
    marked: int = 0
    """Points that it marked and kept."""


@dataclass(frozen=True, eq=False)
class CleanedStation:
    """What is left of a station."""

    numbers: Indices
    """(m,) points of its scan that are left."""
    points: Points
    """(m, 3) where they are, common frame less its origin [m]."""
    moved: Flags
    """(m,) True for points that other stations looked through."""


@dataclass(frozen=True, eq=False)
class CleanedStations:
    """What is left, and how it came to that."""

    stations: Sequence[CleanedStation]
    steps: Sequence[StepCount]
    """In the order in which they were taken, stations within steps."""
    smoothing: Sequence[SmoothingPass]
    remarks: Sequence[str]
    """What could not be done, and why, for people."""


@dataclass(eq=False)
class _Work:
    """The state between steps."""

    stations: Sequence[PlacedScan]
    origin_m: Vector3
    kept: list[Array]
    """(m,) per station, the points that are left; stations have different numbers of points."""
    moved: list[Array]
    """(n,) per station, of all its points."""
    steps: list[StepCount]
    remarks: list[str]

    def keep(self, step: str, station: int, flags: Flags) -> None:
        """Keep the flagged ones of the points that are left of a station, and count."""
        before = len(self.kept[station])
        self.kept[station] = self.kept[station][flags]
        self._count(step, station, before)

    def _count(self, step: str, station: int, before: int, marked: int = 0) -> None:
        name = self.stations[station].scan.name
        self.steps.append(StepCount(step, name, before, before - len(self.kept[station]), marked))

    def mark(self, step: str, station: int, flags: Flags) -> None:
        """Mark the flagged ones of the points that are left of a station, and count."""
        self.moved[station][self.kept[station][flags]] = True
        self._count(step, station, len(self.kept[station]), int(flags.sum()))

    def points(self, station: int) -> Points:
        """Give the points that are left of a station in the common frame."""
        placed_scan = self.stations[station]
        return np.asarray(placed_scan.common_from_scan.apply(placed_scan.scan.points[self.kept[station]]))

    def joined(self) -> tuple[Points, Labels]:
        """Give the points that are left of all stations, and each one's station."""
        counts = [len(kept) for kept in self.kept]
        return (
            np.concatenate([self.points(k) for k in range(len(self.stations))]),
            np.repeat(np.arange(len(counts), dtype=np.int32), counts),
        )

    def keep_of_joined(self, step: str, flags: Flags) -> None:
        """Keep the flagged ones of `joined`."""
        ends = np.cumsum([len(kept) for kept in self.kept])[:-1]
        for station, part in enumerate(np.split(flags, ends)):
            self.keep(step, station, part)

    def require_points(self, step: str) -> None:
        """Refuse to go on with nothing."""
        if not sum(len(kept) for kept in self.kept):
            before = sum(count.before for count in self.steps if count.step == step)
            raise InvalidInputError(step, f"none of the {before} points is left", "check its place, frame and size")


def check_options(options: CleaningOptions) -> None:
    """Refuse crops that keep nothing, whatever the points are.

    Raises
    ------
    InvalidInputError
        A box, polygon or range of distances is empty.
    """
    if options.box is not None:
        check_box(options.box)
    if options.polygon is not None:
        check_polygon(options.polygon)
    if options.distance is not None:
        check_distance(options.distance)


def clean_stations(
    stations: Sequence[PlacedScan], origin_m: Vector3, options: CleaningOptions, progress: Progress
) -> CleanedStations:
    """Take the wanted steps in the order of the options.

    Parameters
    ----------
    stations
        Registered scans.
    origin_m
        Of the common frame: boxes and polygons are given in full coordinates [m].
    options
        The steps.
    progress
        Is told the steps.

    Raises
    ------
    InvalidInputError
        A crop is empty by itself, or a step left no point at all.
    """
    check_options(options)
    work = _Work(
        stations,
        origin_m,
        [np.arange(len(each.scan)) for each in stations],
        [np.zeros(len(each.scan), dtype=np.bool_) for each in stations],
        [],
        [],
    )
    steps: list[tuple[str, object, Callable[[_Work, CleaningOptions], None]]] = [
        ("comet_tails", options.comet_tails or None, _leave_out_tails),
        ("box", options.box, _crop_to_box),
        ("polygon", options.polygon, _crop_to_polygon),
        ("distance", options.distance, _crop_to_distance),
        ("moved_objects", options.moved_objects, _treat_moved_objects),
        ("best_view", options.best_view, _keep_best_views),
        ("voxel", options.voxel, _thin_evenly),
    ]
    for number, (name, wanted, step) in enumerate(steps):
        progress.report(0.6 * number / len(steps), name.replace("_", " "))
        if wanted is not None:
            step(work, options)
            work.require_points(name)
    points, labels = work.joined()
    cloud = SmoothedCloud(points, np.arange(len(points)), [])
    if options.smoothing is not None:
        cloud = smoothed(points, options.smoothing, ProgressSection(progress, 0.6, 0.9))
        work.keep_of_joined("smoothing", _flags(cloud.numbers, len(points)))
        work.require_points("smoothing")
    points, labels = cloud.points, labels[cloud.numbers]
    if options.curvature is not None:
        progress.report(0.9, "thinning by curvature")
        flags = curvature_thinned(points, options.curvature.share)
        work.keep_of_joined("curvature", flags)
        points, labels = points[flags], labels[flags]
    left = [
        CleanedStation(work.kept[k], points[labels == k], work.moved[k][work.kept[k]]) for k in range(len(stations))
    ]
    return CleanedStations(left, work.steps, cloud.passes, work.remarks)


def _flags(numbers: Indices, count: int) -> Flags:
    out = np.zeros(count, dtype=np.bool_)
    out[numbers] = True
    return out


def _leave_out_tails(work: _Work, options: CleaningOptions) -> None:
    """Find comet tails in the raw rasters, before anything else takes neighbours away."""
    del options
    for k, station in enumerate(work.stations):
        try:
            tails = comet_tails(station.scan)
        except InvalidInputError as error:
            work.remarks.append(str(error))
            continue
        work.keep("comet_tails", k, ~tails[work.kept[k]])


def _crop_to_box(work: _Work, options: CleaningOptions) -> None:
    for k in range(len(work.stations)):
        if options.box is not None:
            work.keep("box", k, in_box(work.points(k), options.box, work.origin_m))


def _crop_to_polygon(work: _Work, options: CleaningOptions) -> None:
    for k in range(len(work.stations)):
        if options.polygon is not None:
            work.keep("polygon", k, in_polygon(work.points(k), options.polygon, work.origin_m))


def _crop_to_distance(work: _Work, options: CleaningOptions) -> None:
    for k, station in enumerate(work.stations):
        if station.scan.sensor_m is None:
            work.remarks.append(f"scan {station.scan.name}: not cropped by distance, its instrument's place is unknown")
        elif options.distance is not None:
            ranges: Scalars = np.linalg.norm(station.scan.points[work.kept[k]] - station.scan.sensor_m, axis=1)
            work.keep("distance", k, at_distance(ranges, options.distance))


def _treat_moved_objects(work: _Work, options: CleaningOptions) -> None:
    """Compare every station with what all others saw; nothing is taken away before all were compared."""
    wanted = options.moved_objects
    if wanted is None:
        return
    marks = [np.zeros(len(kept), dtype=np.bool_) for kept in work.kept]
    normals = [_common_normals(station)[work.kept[k]] for k, station in enumerate(work.stations)]
    for j, station in enumerate(work.stations):
        if station.scan.sensor_m is None:
            work.remarks.append(
                f"scan {station.scan.name}: its instrument's place is unknown, so is what it looked through"
            )
            continue
        sensor = np.asarray(station.common_from_scan.apply(station.scan.sensor_m))
        # what was cropped away was seen all the same
        seen = seen_space(station.points(), sensor, _step_rad(station.scan))
        for k in range(len(work.stations)):
            if k != j:
                marks[k] |= in_free_space(work.points(k), normals[k], seen, wanted)
    for k, station in enumerate(work.stations):
        _apply_marks(
            work, k, whole_pieces(work.points(k), marks[k], _spacing_m(station.scan), wanted.least_points), wanted
        )


def _apply_marks(work: _Work, station: int, flags: Flags, wanted: MovedObjects) -> None:
    if wanted.remove:
        work.keep("moved_objects", station, ~flags)
    else:
        work.mark("moved_objects", station, flags)


def _common_normals(station: PlacedScan) -> Points:
    return np.ascontiguousarray(station.common_from_scan.rotation.apply(point_normals(station.scan)))


def _step_rad(scan: Scan) -> float:
    """Give the angle between neighbouring points [rad]."""
    if scan.grid is None or scan.sensor_m is None:
        return CLOUD_STEP_RAD
    return angular_step(scan.points, scan.grid, scan.sensor_m)


def _spacing_m(scan: Scan) -> float:
    """Give the distance of neighbouring points at a common range [m]."""
    if scan.sensor_m is None:
        return 0.0
    few = scan.points[:: max(1, len(scan) // 10_000)]
    return _step_rad(scan) * float(np.median(np.linalg.norm(few - scan.sensor_m, axis=1)))


def _keep_best_views(work: _Work, options: CleaningOptions) -> None:
    if options.best_view is None:
        return
    cosines = [
        beam_cosines(station.scan, point_normals(station.scan))[work.kept[k]] for k, station in enumerate(work.stations)
    ]
    points, labels = work.joined()
    work.keep_of_joined("best_view", best_views(points, labels, np.concatenate(cosines), options.best_view.voxel_m))


def _thin_evenly(work: _Work, options: CleaningOptions) -> None:
    if options.voxel is not None:
        work.keep_of_joined("voxel", voxel_thinned(work.joined()[0], options.voxel.voxel_m))
