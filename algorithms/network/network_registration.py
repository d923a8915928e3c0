"""Many stations from registered pairs: loops, start values, one adjustment, and what became of each station."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.options import AdjustmentOptions
from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError
from algorithms.geometry.poses import PoseEstimate
from algorithms.network.joint_adjustment import JointAdjustment, adjust_jointly
from algorithms.network.links import StationLink
from algorithms.network.loop_closure import LoopVerdict, examine_loops
from algorithms.network.pose_graph import adjust_pose_graph, connected_stations
from algorithms.network.tracks import StationFeatures, Tracks, build_tracks

DEFAULT_OPTIONS = AdjustmentOptions()


@dataclass(frozen=True, eq=False)
class NetworkRegistration:
    """The poses of all stations that are connected to the first one, in its reduced frame."""

    poses: Mapping[int, PoseEstimate]
    """First station from station; that of the first one is the identity without error."""
    loops: LoopVerdict
    """Which registrations are consistent; their numbers are those of the given links."""
    tracks: Tracks | None
    """Objects that several stations see; None: no station is connected to the first one."""
    joint: JointAdjustment | None
    """The adjustment of all stations; None: the poses are those of the pose graph, `remarks` says why."""
    remarks: tuple[str, ...]
    """What the reader should know, in words."""


def register_network(
    features: Mapping[int, StationFeatures],
    links: Sequence[StationLink],
    names: Sequence[str],
    options: AdjustmentOptions = DEFAULT_OPTIONS,
) -> NetworkRegistration:
    """Find the poses of all stations that consistent registrations connect to the first one (MATH 6.4, 6.5).

    Loops of registrations are tested and wrong ones left out; a pose graph of the others gives start values; then all
    stations are adjusted at once to the planes and lines that two or more of them see.

    Parameters
    ----------
    features
        Of the stations, in their reduced frames; those of stations without registration may be missing.
    links
        Accepted registrations of two stations.
    names
        Of all stations, for the reasons; the first one defines the frame.
    options
        Of the adjustment.
    """
    verdict = examine_loops(links, names)
    usable = [link for number, link in enumerate(links) if number not in verdict.rejected]
    stations = connected_stations(usable, 0)
    kept = [link for link in usable if link.target in stations]
    fixed = PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))
    if not kept:
        return NetworkRegistration({0: fixed}, verdict, None, None, ())
    graph = adjust_pose_graph(kept, stations)
    start = {station: graph.unknowns.poses[k] for k, station in enumerate(stations)}
    tracks = build_tracks(features, kept, start)
    try:
        joint = adjust_jointly(features, tracks, stations, start, options)
    except (DegenerateGeometryError, TooFewCorrespondencesError) as error:
        poses = {
            station: PoseEstimate(start[station], graph.cofactors[6 * k : 6 * k + 6, 6 * k : 6 * k + 6])
            for k, station in enumerate(stations[1:])
        }
        remark = (
            f"the stations could not be adjusted together ({error}); their poses are adjusted to the registrations of "
            "pairs as if these were independent of each other"
        )
        return NetworkRegistration({0: fixed, **poses}, verdict, tracks, None, (remark,))
    poses = {station: PoseEstimate(joint.pose(station), joint.covariance(station)) for station in stations[1:]}
    remarks = () if joint.solution.converged else ("the adjustment of all stations did not settle",)
    return NetworkRegistration({0: fixed, **poses}, verdict, tracks, joint, remarks)
