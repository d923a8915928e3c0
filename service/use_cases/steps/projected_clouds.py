"""Registered points in the map projection of the control, for files whose points are those of the world."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from algorithms.geometry.topocentric import TopocentricFrame
from schemas.values.crs import wkt_1
from service.formats.writers import PointPiece, StationCloud
from service.formats.writers.placed import in_world
from service.ports import Json
from service.use_cases.steps.registered_calls import RIGID

NOT_MET = (
    "the control was not met: all is in the frame of the first station, and no coordinate reference system is named"
)
LOCAL = (
    "the poses are in the local frame of the control of the job that they were taken from (east, north, up at the "
    "origin in its `control.system`), which is not `crs`: no coordinate reference system is named"
)


@dataclass(frozen=True, eq=False)
class WorldSystem:
    """In which system registered points are written."""

    crs_wkt: str | None
    """What files say of it, WKT 1; None: nothing."""
    projection: TopocentricFrame | None = None
    """From the world frame, which is local then, to that system; None: points are written in the world frame."""
    notes: tuple[str, ...] = ()

    def cloud(self, cloud: StationCloud) -> StationCloud:
        """Give a cloud of the world frame in this system, point by point: no rigid motion does that."""
        if self.projection is None:
            return replace(cloud, crs_wkt=self.crs_wkt or (None if self.notes else cloud.crs_wkt))
        frame, pose = self.projection, cloud.pose
        origin = np.round(frame.from_local(pose.apply(cloud.origin_m)[None])[0])
        sensor = cloud.sensor_in_scan_m

        def pieces() -> Iterator[PointPiece]:
            for piece in cloud.pieces():
                yield replace(piece, points=frame.from_local(in_world(cloud, piece, np.zeros(3))) - origin)

        return replace(
            cloud,
            pieces=pieces,
            origin_m=origin,
            world_from_scan=None,
            sensor_in_scan_m=None if sensor is None else frame.from_local(pose.apply(sensor)[None])[0],
            facts=None,
            crs_wkt=self.crs_wkt,
        )


def world_system(options: Json, result: Json | None, pose_documents: Sequence[Json] = ()) -> WorldSystem:
    """Say in which system the points are written.

    Parameters
    ----------
    options
        Of the files; `control` says what holds the world frame of a registration with control.
    result
        Its result document; None: the request has the poses.
    pose_documents
        Result documents that the request took poses from.
    """
    stated = None if options["crs"] is None else wkt_1(options["crs"])
    if stated is not None and any((each.get("control") or {}).get("system") for each in pose_documents):
        return WorldSystem(None, notes=(LOCAL,))
    control = options.get("control")
    if control is None or result is None:
        return WorldSystem(stated)
    found = result.get("control") or {}
    if found.get("global_from_project") is None:
        return WorldSystem(None, notes=(NOT_MET,))
    if control["crs"] is None:
        return WorldSystem(stated)
    if options["format"] in RIGID:
        note = (
            f"in the local frame of the control (east, north, up at the origin in `control.system`), not in "
            f"{control['crs'][:60]}: poses are rigid, a projection is not"
        )
        return WorldSystem(None, notes=(note,))
    origin = np.array(found["system"]["origin"], dtype=np.float64)
    frame = TopocentricFrame(control["crs"], origin, control["geoid_undulation_m"])
    return WorldSystem(wkt_1(control["crs"]), frame)
