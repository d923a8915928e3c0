"""The network of stations, as clients read it."""

from collections.abc import Sequence

from algorithms.geometry.angles import GON_PER_RAD
from algorithms.network.joint_adjustment import JointAdjustment, RemovedMember
from algorithms.network.links import StationLink
from algorithms.network.network_registration import NetworkRegistration
from algorithms.network.track_observations import TrackKind
from algorithms.network.tracks import Member, Tracks
from schemas.results.network import LoopClosure, Network, NetworkAdjustment, NetworkLink, RemovedFeature, TrackCounts
from service.use_cases.documents.adjustment_documents import global_test_document
from service.use_cases.documents.feature_names import line_name, plane_name


def network_document(
    result: NetworkRegistration,
    links: Sequence[StationLink],
    doubtful: Sequence[StationLink],
    names: Sequence[str],
) -> Network:
    """Describe a network.

    Parameters
    ----------
    result
        The network.
    links, doubtful
        The accepted and the doubtful registrations it was made of.
    names
        Of the stations.
    """
    adjustment = (
        None
        if result.joint is None or result.tracks is None
        else _adjustment(result.joint, result.tracks, result.left_out, names)
    )
    return Network(
        links=[
            NetworkLink(
                target=names[link.target],
                source=names[link.source],
                state=_state(number, link, result),
                reason=result.loops.rejected.get(number),
            )
            for number, link in enumerate(links)
        ]
        + [
            NetworkLink(target=names[doubtful[k].target], source=names[doubtful[k].source], state="confirmed")
            for k in result.confirmed
        ],
        loops=[
            LoopClosure(
                stations=[names[station] for station in loop.stations],
                rotation_gon=loop.turn_rad * GON_PER_RAD,
                translation_m=loop.shift_m,
                statistic=loop.statistic,
                critical=result.loops.critical,
                passed=loop.passed,
            )
            for loop in result.loops.loops
        ],
        loop_variance_factor=result.loops.variance_factor,
        loop_covariance_factor=result.loop_factor,
        covariance_factor=result.variance_factor,
        feature_share=result.feature_share,
        adjustment=adjustment,
        remarks=list(result.remarks),
    )


def _state(number: int, link: StationLink, result: NetworkRegistration) -> str:
    if number in result.loops.rejected:
        return "rejected"
    if link.target not in result.poses:
        return "not-connected"
    return "uncontrolled" if number in result.uncontrolled else "used"


def _adjustment(
    joint: JointAdjustment, tracks: Tracks, left_out: Sequence[int], names: Sequence[str]
) -> NetworkAdjustment:
    solution = joint.solution
    return NetworkAdjustment(
        model="gauss-helmert-tracks",
        datum=f"station {names[joint.stations[0]]} is fixed",
        observations=joint.observation_count,
        unknowns=solution.unknowns.count,
        redundancy=solution.redundancy,
        sigma0_prior=1.0,
        sigma0=solution.sigma0,
        variance_factor=joint.variance_factor,
        test_variance_factor=joint.test_variance_factor,
        iterations=solution.iterations,
        converged=solution.converged,
        global_test=global_test_document(joint.global_test),
        tracks=TrackCounts(
            planes=sum(track.kind is TrackKind.PLANE for track in joint.tracks),
            lines=sum(track.kind is TrackKind.LINE for track in joint.tracks),
            features=sum(len(track.members) for track in joint.tracks),
            edges=tracks.edges,
            lost_edges=tracks.lost_edges,
            conflicts=tracks.conflicts,
        ),
        left_out=[names[station] for station in left_out],
        removed=[_removed(entry, tracks, names) for entry in joint.removed],
    )


def _removed(entry: RemovedMember, tracks: Tracks, names: Sequence[str]) -> RemovedFeature:
    is_plane = entry.track < len(tracks.planes)
    members = tracks.planes[entry.track] if is_plane else tracks.lines[entry.track - len(tracks.planes)]
    return RemovedFeature(
        feature=_name(entry.member, names, is_plane=is_plane),
        others=[_name(member, names, is_plane=is_plane) for member in members if member != entry.member],
        statistic=entry.statistic,
        critical=entry.critical,
    )


def _name(member: Member, names: Sequence[str], *, is_plane: bool) -> str:
    station, number = member
    return f"{names[station]}/{plane_name(number) if is_plane else line_name(number)}"
