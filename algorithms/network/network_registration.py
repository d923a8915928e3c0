"""Many stations from registered pairs: loops, start values, one adjustment, and what became of each station."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.options import AdjustmentOptions
from algorithms.adjustment.solver import Solution
from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError
from algorithms.geometry.poses import PoseEstimate
from algorithms.network.instrument_calibration import (
    InstrumentCalibration,
    InstrumentSearch,
    calibrate_instruments,
    widened_by_tolerances,
)
from algorithms.network.joint_adjustment import JointAdjustment
from algorithms.network.links import StationLink
from algorithms.network.loop_closure import (
    LoopVerdict,
    agreeing_links,
    bridges,
    examine_loops,
    loop_covariance_factor,
)
from algorithms.network.open_stations import DeterminedStations, adjust_determined
from algorithms.network.pose_graph import adjust_pose_graph, connected_stations
from algorithms.network.station_fusion import (
    FusedStations,
    StationCovariances,
    fused_stations,
    share_of_features,
    with_shared_scans,
)
from algorithms.network.surface_control import SurfaceControl
from algorithms.network.surface_decisions import decided_by_surfaces
from algorithms.network.tied_network import RegisteredGroup, same_targets
from algorithms.network.tracks import StationFeatures, Tracks, build_tracks

DEFAULT_OPTIONS = AdjustmentOptions()
MOST_NAMED = 20
"""Stations that a remark names."""


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
    """The adjustment of all stations to lines and planes; None: there is none, `remarks` says why."""
    uncontrolled: tuple[int, ...]
    """Numbers of used links that lie in no loop of used or confirmed ones: nothing checks them."""
    confirmed: tuple[int, ...]
    """Numbers of those doubtful links that agree with the poses which accepted ones lead to; they are used too."""
    loop_factor: float
    """By which the covariances of the poses were multiplied because loops close worse than those of pairs say."""
    feature_share: float
    """Weight of the adjustment to lines and planes in the poses, 0..1; the rest is that of the registrations."""
    difference_factor: float
    """By which the covariances were multiplied because these two differ by more than chance."""
    remarks: tuple[str, ...]
    """What the reader should know, in words."""
    instruments: InstrumentCalibration | None = None
    """Errors of instruments and tripods; None: nobody asked, or they could not be looked for, `remarks` says why."""
    covariances: StationCovariances | None = None
    """Of the poses of all stations but the first, in their order; None: there is no other."""
    left_out: tuple[int, ...] = ()
    """Connected stations that lines and planes leave open: registrations alone hold them."""

    @property
    def variance_factor(self) -> float:
        """Factor on the covariances that follow from the scans' own noise: residuals and loops together (MATH 6.5)."""
        features = 1.0 if self.joint is None or self.feature_share == 0.0 else self.joint.variance_factor
        return self.loop_factor * self.difference_factor * features


def register_network(
    features: Mapping[int, StationFeatures],
    links: Sequence[StationLink],
    names: Sequence[str],
    options: AdjustmentOptions = DEFAULT_OPTIONS,
    *,
    doubtful: Sequence[StationLink] = (),
    control: SurfaceControl | None = None,
    instruments: InstrumentSearch | None = None,
) -> NetworkRegistration:
    """Find the poses of all stations that consistent registrations connect to the first one (MATH 6.4, 6.5).

    Loops of registrations are tested and wrong ones left out; a pose graph of the others gives start values; then all
    stations are adjusted at once to the planes and lines that two or more of them see. As far as the registrations rest
    on surfaces, the poses are those of the pose graph (`fused_stations`).

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
    doubtful
        Registrations that connect no station, but are used between stations that others connect where they agree.
    control
        Tests stations against each other where loops leave something open; None: that stays open.
    instruments
        Errors of instruments and tripods to look for; None: none.
    """
    verdict = examine_loops(links, names)
    if control is not None:
        verdict = decided_by_surfaces(links, verdict, names, control)
    usable = [link for number, link in enumerate(links) if number not in verdict.rejected]
    stations = connected_stations(usable, 0)
    inside = set(stations)
    kept = [link for link in usable if link.target in inside]
    fixed = PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))
    if not kept:
        unsought = "errors of the instrument cannot be looked for: nothing is registered"
        remarks: tuple[str, ...] = () if instruments is None else (unsought,)
        return NetworkRegistration({0: fixed}, verdict, None, None, verdict.uncontrolled, (), 1.0, 1.0, 1.0, remarks)
    graph = adjust_pose_graph(kept, stations)
    verdict, again = _taken_back(links, verdict, stations, graph)
    confirmed = agreeing_links(doubtful, stations, graph, verdict.variance_factor)
    if confirmed or again:
        kept = [*kept, *again, *(doubtful[number] for number in confirmed)]
        graph = adjust_pose_graph(kept, stations)
    start = {station: graph.unknowns.poses[k] for k, station in enumerate(stations)}
    tracks = build_tracks(features, kept, start)
    determined, remarks = _adjusted(features, tracks, stations, start, options, names)
    joint = None if determined is None else determined.joint
    calibration, words = _calibrated(features, tracks, stations, graph, options, instruments)
    remarks = (*remarks, *words)
    share = share_of_features(kept)
    if calibration is not None and instruments is not None and instruments.apply and calibration.estimated:
        if calibration.of_surfaces is None or len(calibration.of_surfaces.stations) < len(stations):
            remarks = (*remarks, "the errors of the instrument are not taken off: planes and pipes leave a pose open")
        else:
            joint, share = calibration.of_surfaces, 1.0
    factor = loop_covariance_factor(kept)
    shared = with_shared_scans(kept)
    fused = fused_stations(joint, adjust_pose_graph(shared, stations), share, shared, stations)
    found = zip(stations[1:], fused.poses, strict=True)
    return NetworkRegistration(
        poses={0: fixed, **{station: pose.with_covariance_scaled(factor) for station, pose in found}},
        loops=verdict,
        tracks=tracks,
        joint=joint,
        uncontrolled=_uncontrolled(links, verdict, kept),
        confirmed=confirmed,
        loop_factor=factor,
        feature_share=fused.feature_share,
        difference_factor=fused.factor,
        remarks=(*remarks, *_in_words(fused, joint)),
        instruments=calibration,
        covariances=fused.covariances.scaled(factor),
        left_out=() if determined is None else determined.left_out,
    )


def _in_words(fused: FusedStations, joint: JointAdjustment | None) -> list[str]:
    """Say what the poses rest on, where it is not lines and planes alone."""
    if joint is None or fused.feature_share == 1.0:
        return []
    differ = f"; they differ by more than chance, so all variances are {fused.factor:.1f} times larger"
    remark = (
        f"lines and planes, adjusted together, give {fused.feature_share:.0%} of the poses, and the registrations of "
        f"pairs, which use the surfaces too, the rest{differ if fused.factor > 1.0 else ''}"
    )
    return [remark]


def _taken_back(
    links: Sequence[StationLink], verdict: LoopVerdict, stations: Sequence[int], graph: Solution
) -> tuple[LoopVerdict, list[StationLink]]:
    """Take back into use what was blamed beside wrong registrations, but agrees with the poses that others lead to."""
    numbers = sorted(verdict.rejected)
    agreeing = agreeing_links([links[k] for k in numbers], stations, graph, verdict.variance_factor)
    again = {numbers[place] for place in agreeing}
    rejected = {number: reason for number, reason in verdict.rejected.items() if number not in again}
    return replace(verdict, rejected=rejected), [links[number] for number in sorted(again)]


def _adjusted(
    features: Mapping[int, StationFeatures],
    tracks: Tracks,
    stations: Sequence[int],
    start: Mapping[int, RigidTransform],
    options: AdjustmentOptions,
    names: Sequence[str],
) -> tuple[DeterminedStations | None, tuple[str, ...]]:
    """Adjust all stations that lines and planes determine; say which they do not, or why none."""
    try:
        found = adjust_determined(features, tracks, stations, start, options)
    except (DegenerateGeometryError, TooFewCorrespondencesError) as error:
        remark = (
            f"the stations could not be adjusted together to lines and planes ({error}); their poses are adjusted to "
            "the registrations of pairs"
        )
        return None, (remark,)
    remarks = [] if found.joint.solution.converged else ["the adjustment of all stations did not settle"]
    if found.left_out:
        named = ", ".join(names[station] for station in found.left_out[:MOST_NAMED])
        more = len(found.left_out) - MOST_NAMED
        remarks.append(
            f"{len(found.left_out)} of {len(stations)} stations are held by the registrations of pairs alone, because "
            f"the lines and planes that they share with others leave them open: {named}"
            f"{f' and {more} more' if more > 0 else ''}"
        )
    return found, tuple(remarks)


def _calibrated(
    features: Mapping[int, StationFeatures],
    tracks: Tracks,
    stations: Sequence[int],
    graph: Solution,
    options: AdjustmentOptions,
    search: InstrumentSearch | None,
) -> tuple[InstrumentCalibration | None, tuple[str, ...]]:
    """Look for errors of instruments and tripods; where that is not possible, say why."""
    sought = [] if search is None else search.among(stations)
    if not sought:
        return None, ()
    start = {station: graph.unknowns.poses[k] for k, station in enumerate(stations)}
    size = 6 * (len(stations) - 1)
    group = RegisteredGroup(
        stations[0], {station: start[station] for station in stations[1:]}, graph.cofactors[:size, :size]
    )
    points = same_targets(widened_by_tolerances({k: features[k] for k in stations}, sought), group)
    try:
        return calibrate_instruments(features, replace(tracks, points=points), stations, start, sought, options), ()
    except (DegenerateGeometryError, TooFewCorrespondencesError) as error:
        return None, (
            f"errors of the instrument could not be looked for: planes, pipes and targets alone do not do ({error})",
        )


def _uncontrolled(links: Sequence[StationLink], verdict: LoopVerdict, kept: Sequence[StationLink]) -> tuple[int, ...]:
    """Give the used links that neither other links nor confirmed doubtful ones control."""
    still = {kept[number].stations for number in bridges(kept, range(len(kept)))}
    inside = {link.stations for link in kept}
    return tuple(
        number
        for number in verdict.uncontrolled
        if links[number].stations in still or links[number].stations not in inside
    )
