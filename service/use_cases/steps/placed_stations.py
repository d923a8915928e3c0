"""Read registered stations into one frame, and give what is left of them to the writers."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Colors, Indices, Points, Vector3
from algorithms.cleaning.cleaned_stations import PlacedScan, placed
from algorithms.errors import InvalidInputError
from schemas.values.crs import HEIGHTS_NEEDED
from service.formats.geocentric import geocentric_in_words
from service.formats.las_attributes import COLORS_16
from service.formats.writers import PointPiece, ScalarField, StationCloud
from service.formats.writers.base import POINTS_AT_ONCE
from service.formats.writers.grid_files import Files
from service.ports import Json, StepContext
from service.use_cases.steps.run_features import read_stored_scan

MOVED = "the coordinate reference system of the file is not named: its points were moved out of it"
TWO_SYSTEMS = "no coordinate reference system is named: the files state different ones"


@dataclass(frozen=True, eq=False)
class CommonFrame:
    """Stations in one frame whose origin is near them."""

    stations: Sequence[PlacedScan]
    origin_m: Vector3
    """Of the reduced common frame, in the world [m]."""

    @property
    def crs_wkt(self) -> str | None:
        """Coordinate reference system of the world, WKT 1; None: no file states one, or several do."""
        return next((each.scan.crs_wkt for each in self.stations if each.scan.crs_wkt), None)

    def file_stem(self, name: str) -> str:
        """Return the name of a written file without its ending: it says where units were converted."""
        return in_metres_stem(name, is_converted=any(each.scan.unit_before for each in self.stations))

    def renamed(self, files: Files) -> Files:
        """Return files by the names that say where units were converted; pictures have no coordinates."""
        return renamed(files, is_converted=any(each.scan.unit_before for each in self.stations))

    def require_heights(self) -> None:
        """Check that z may be a height.

        Raises
        ------
        InvalidInputError
            The coordinates are geocentric.
        """
        why = geocentric_in_words(self.crs_wkt, np.tile(self.origin_m, (2, 1)))
        if why:
            raise InvalidInputError("stations", why, HEIGHTS_NEEDED)

    def notes(self) -> list[str]:
        """Return what of the files is not in the scans, in words, for each station."""
        return [f"{each.scan.name}: {note}" for each in self.stations for note in each.scan.notes]


def in_metres_stem(name: str, *, is_converted: bool) -> str:
    """Return the name of a written file without its ending, `dtm-metres` where its source was in another unit."""
    return f"{name}-metres" if is_converted else name


def renamed(files: Files, *, is_converted: bool) -> Files:
    """Return files, those with coordinates by names that say where units were converted."""
    found: Files = {}
    for name, (media, content) in files.items():
        stem, _, ending = name.partition(".")
        is_picture = media in {"image/png", "image/svg+xml"}
        found[name if is_picture else f"{in_metres_stem(stem, is_converted=is_converted)}.{ending}"] = media, content
    return found


def pose_of(station: Json) -> RigidTransform:
    """Give world_from_scan; identity where the coordinates of the file are those of the world."""
    pose = station["world_from_scan"]
    return RigidTransform.identity() if pose is None else RigidTransform.from_matrix(np.array(pose["matrix"]))


def read_stations(context: StepContext, stations: Sequence[Json], *, attributes: bool = False) -> CommonFrame:
    """Read all stations; the origin of the common frame is the middle of the first.

    Parameters
    ----------
    attributes
        Whether the further numbers of the points are read, which go into a file that is written.
    """
    scans = []
    for number, station in enumerate(stations):
        context.progress.report(0.2 * number / len(stations), f"reading {station['name']}")
        scan = read_stored_scan(context, station["scan"], attributes=attributes)
        scans.append(replace(scan, name=station["name"]))
    poses = [pose_of(station) for station in stations]
    middle = scans[0].bounds_m.mean(axis=0) if len(scans[0]) else scans[0].origin_m
    origin = np.rint(poses[0].apply(middle))
    crs_wkt, note = world_crs([scan.crs_wkt for scan in scans], poses)
    scans = [
        replace(scan, crs_wkt=crs_wkt, notes=(*scan.notes, note) if note and scan.crs_wkt else scan.notes)
        for scan in scans
    ]
    return CommonFrame([placed(scan, pose, origin) for scan, pose in zip(scans, poses, strict=True)], origin)


def world_crs(stated: Sequence[str | None], poses: Sequence[RigidTransform]) -> tuple[str | None, str]:
    """Return the coordinate reference system of the world as files of stations state it, or None and why.

    Parameters
    ----------
    stated
        System of each file's coordinates, WKT 1.
    poses
        World from scan of each: those that do not move have coordinates of the world.
    """
    unmoved = {crs for crs, pose in zip(stated, poses, strict=True) if crs and is_identity(pose)}
    if len(unmoved) == 1:
        return unmoved.pop(), ""
    return None, (TWO_SYSTEMS if unmoved else MOVED) if any(stated) else ""


def is_identity(pose: RigidTransform) -> bool:
    """Tell whether a pose leaves all points where they are."""
    return bool((pose.as_matrix() == np.eye(4)).all())


def cloud_in_world(
    station: PlacedScan,
    origin_m: Vector3,
    numbers: Indices,
    points: Points,
    *,
    colors: Colors | None = None,
    scalars: Mapping[str, Array] | None = None,
    fields: tuple[ScalarField, ...] = (),
) -> StationCloud:
    """Give some points of a station, where they are now, as a cloud for a writer.

    Parameters
    ----------
    station, origin_m
        Of which the points are, and the origin of the common frame [m].
    numbers
        (m,) points of its scan.
    points
        (m, 3) where they are, in the reduced common frame [m].
    colors
        (m, 3); None: those of the scan.
    scalars, fields
        (m,) further numbers by name, and what they are.
    """
    scan = station.scan
    repainted = set() if colors is None else {each.name for each in COLORS_16}
    attributes = [each for each in scan.attributes if each.name not in {*(scalars or {}), *repainted}]
    extra = {each.name: scan.attributes[each][numbers] for each in attributes} | dict(scalars or {})
    own = None if scan.color is None else scan.color[numbers]
    shown = own if colors is None else colors

    def pieces() -> Iterator[PointPiece]:
        for start in range(0, len(points), POINTS_AT_ONCE):
            part = slice(start, start + POINTS_AT_ONCE)
            yield PointPiece(
                points[part],
                intensity=None if scan.intensity is None else scan.intensity[numbers[part]],
                color=None if shown is None else shown[part],
                scalars={name: values[part] for name, values in extra.items()},
            )

    return StationCloud(
        name=scan.name,
        pieces=pieces,
        origin_m=origin_m,
        has_intensity=scan.intensity is not None,
        intensity_scale=scan.intensity_scale,
        has_color=shown is not None,
        scalars=(*attributes, *fields),
        crs_wkt=scan.crs_wkt,
        notes=scan.notes,
    )
