"""Where the stations of a registration came to lie, or why they have no pose; what the network makes of pairs."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.geometry.poses import PoseEstimate
from schemas.results.registration_result import Pair, Station
from schemas.values.poses import Pose
from service.names.pair_statuses import IN_PLACE, STATUSES
from service.ports import Json
from service.use_cases.documents.pose_documents import fixed_pose_document, pose_document


@dataclass(frozen=True)
class StationPose:
    """A station's pose in the common frame, or why it has none."""

    station: Station
    estimate: PoseEstimate | None


def placed_stations(
    names: Sequence[str], pairs: Sequence[Pair], network: Json | None, tied: Json | None
) -> list[StationPose]:
    """Give the poses of all stations.

    Parameters
    ----------
    names
        Of the stations, in order.
    pairs
        All that were tried; of three stations or more only their names, statuses and first reasons are looked at.
    network
        What `adjust_network` stored; None: there are two stations.
    tied
        What `tie_stations` stored; None: there are no targets and no control.
    """
    return _station_poses(names, pairs, network) if tied is None else _tied_poses(names, pairs, network, tied)


def relative_to_first(poses: Sequence[StationPose], tied: Json | None) -> Sequence[StationPose]:
    """Give the poses in the frame of the first station, for what is told relative to it."""
    if tied is None or tied["poses"] is None or tied["relative"] is None:
        return poses
    told = {name: _stored(pose) for name, pose in tied["relative"].items()}
    return [StationPose(pose.station, told.get(pose.station.name)) for pose in poses]


def overall_status(stations: Sequence[Station]) -> str:
    """Say in a word how many stations have a pose."""
    unregistered = sum(station.status == "unregistered" for station in stations)
    if unregistered == 0:
        return "registered"
    others = len(stations) - any(station.status == "fixed" for station in stations)
    return "not-registered" if unregistered == others else "partly-registered"


@dataclass(frozen=True)
class PairsInNetwork:
    """What is to be said of pairs beyond themselves."""

    rejected: Mapping[tuple[str, str], str]
    """Pairs (target, source) that contradict others, with the reason."""
    warnings: Mapping[str, Sequence[str]]
    """Of the scan of each station."""

    @staticmethod
    def of(network: Json | None, features: Sequence[Json]) -> "PairsInNetwork":
        """Read it from what the adjustment of all stations stored, and from the outputs of the features."""
        links = [] if network is None else network["network"]["links"]
        rejected = {(link["target"], link["source"]): link["reason"] for link in links if link["state"] == "rejected"}
        said = {output["counts"]["station"]: output["counts"].get("warnings", []) for output in features}
        return PairsInNetwork(rejected, said)

    def judged(self, pair: Pair) -> Pair:
        """Take back the acceptance of a pair that contradicts others, and add what is to be said of its scans."""
        reason = self.rejected.get((pair.target, pair.source))
        taken_back = reason is not None and pair.status in IN_PLACE
        reasons = [*([reason] if taken_back else []), *pair.reasons]
        reasons += [*self.warnings[pair.target], *self.warnings[pair.source]]
        return pair.model_copy(
            update={
                "status": "rejected" if taken_back else pair.status,
                "reasons": list(dict.fromkeys(reasons)),
            }
        )


def _tied_poses(names: Sequence[str], pairs: Sequence[Pair], network: Json | None, tied: Json) -> list[StationPose]:
    """Give the poses from the adjustment with targets and control; where there is none, those of the scans.

    Without poses in the frame that was asked for the first station carries the frame, and the result says why.
    """
    if tied["poses"] is None:
        return _station_poses(names, pairs, network)
    found, tried = [], _by_station(pairs)
    for name in names:
        pose = tied["poses"].get(name)
        if name == tied["fixed"]:
            fixed = Station(name=name, status="fixed", world_from_scan=fixed_pose_document(name))
            found.append(StationPose(fixed, PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))))
        elif pose is None:
            why = _why_not(name, tried.get(name, []))
            station = Station(name=name, status="unregistered", reason=why, world_from_scan=None)
            found.append(StationPose(station, None))
        else:
            registered = _registered(name, _stored(pose), None, a_posteriori=pose["a_posteriori"])
            doubt = registered.station.model_copy(update={"reason": tied["contradicted"].get(name)})
            found.append(replace(registered, station=doubt))
    return found


def _stored(pose: Json) -> PoseEstimate:
    return PoseEstimate(RigidTransform.from_matrix(np.array(pose["matrix"])), np.array(pose["covariance"]))


def _station_poses(names: Sequence[str], pairs: Sequence[Pair], network: Json | None) -> list[StationPose]:
    """Give the poses from the adjustment of all stations, of two stations that of their pair."""
    known = _pair_poses(names, pairs) if network is None else _network_poses(names, network)
    tried = _by_station(pairs)
    fixed = Station(name=names[0], status="fixed", world_from_scan=fixed_pose_document(names[0]))
    poses = [StationPose(fixed, PoseEstimate(RigidTransform.identity(), np.zeros((6, 6))))]
    for name in names[1:]:
        if name in known:
            poses.append(known[name])
        else:
            why = _why_not(name, tried.get(name, []))
            station = Station(name=name, status="unregistered", reason=why, world_from_scan=None)
            poses.append(StationPose(station, None))
    return poses


def _pair_poses(names: Sequence[str], pairs: Sequence[Pair]) -> dict[str, StationPose]:
    """Give the pose of the second of two stations from their pair."""
    for pair in pairs:
        own = pair.target_from_source
        if pair.status not in IN_PLACE or own is None or names[0] not in {pair.target, pair.source}:
            continue
        name, is_direct = (pair.source, True) if pair.target == names[0] else (pair.target, False)
        estimate = _estimate(own) if is_direct else _estimate(own).inverse()
        centroid = own.std_at_centroid_m.point_m if is_direct and own.std_at_centroid_m else None
        return {name: _registered(name, estimate, centroid, a_posteriori=own.covariance_sigma0 == "a-posteriori")}
    return {}


def _network_poses(names: Sequence[str], network: Json) -> dict[str, StationPose]:
    """Give the poses that the adjustment of all stations stored."""
    return {
        name: _registered(name, _stored(pose), pose["centroid_m"], a_posteriori=pose["a_posteriori"])
        for name, pose in network["poses"].items()
        if name != names[0]
    }


def _registered(
    name: str, estimate: PoseEstimate, centroid_m: Sequence[float] | None, *, a_posteriori: bool
) -> StationPose:
    document = pose_document(
        estimate,
        target="world",
        source=name,
        centroid_m=None if centroid_m is None else np.array(centroid_m),
        a_posteriori=a_posteriori,
    )
    return StationPose(Station(name=name, status="registered", world_from_scan=document), estimate)


def _estimate(pose: Pose) -> PoseEstimate:
    return PoseEstimate(RigidTransform.from_matrix(np.array(pose.matrix)), np.array(pose.covariance))


def _by_station(pairs: Sequence[Pair]) -> dict[str, list[Pair]]:
    found: dict[str, list[Pair]] = {}
    for pair in pairs:
        for name in {pair.target, pair.source}:
            found.setdefault(name, []).append(pair)
    return found


def _why_not(name: str, tried: Sequence[Pair]) -> str:
    """Say why a station has no pose, by the pairs with it that were tried."""
    if not tried:
        return "no pair with this station was tried"
    counts = ", ".join(f"{count} {status}" for status, count in Counter(pair.status for pair in tried).items())
    if any(pair.status in IN_PLACE for pair in tried):
        return f"connected only to stations that are not connected to the first one ({counts})"
    nearest = min(tried, key=lambda pair: STATUSES.index(pair.status))
    other = nearest.source if nearest.target == name else nearest.target
    reason = f"; with {other}: {nearest.reasons[0]}" if nearest.reasons else ""
    return f"no pair was accepted ({counts}){reason}"
