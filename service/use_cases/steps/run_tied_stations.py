"""Adjust all stations of a `register` job with their targets and the control, and choose the world frame."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.hybrid.station_frames import relative_to, smallest_trace
from algorithms.adjustment.testing import GlobalVerdict, global_test
from algorithms.arrays import Array, Vector3
from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.point_sets import PointSet
from algorithms.geometry.poses import PoseEstimate
from algorithms.geometry.topocentric import TopocentricFrame
from algorithms.network.instrument_responses import without_instrument_errors
from algorithms.network.pose_graph import adjust_pose_graph, connected_stations
from algorithms.network.tied_network import (
    KnownTargets,
    RegisteredGroup,
    TiedNetwork,
    doubts_of_control,
    tied_network,
)
from algorithms.network.tracks import StationFeatures
from algorithms.probabilities import chi2_sf
from algorithms.targets.common_points import TargetSet
from schemas.results.control_result import ControlResult
from service.names.pair_statuses import IN_PLACE
from service.ports import Json, StepContext
from service.use_cases.documents.control_documents import (
    ControlFrame,
    point_documents,
    project_documents,
    scale_document,
    system_document,
    target_results,
)
from service.use_cases.steps.feature_store import load_features
from service.use_cases.steps.run_network import stored_links
from service.use_cases.steps.station_targets import target_set
from service.use_cases.steps.target_lists import covariance_rows

ALPHA_GLOBAL = 0.05
ALPHA_ADJUSTED = 0.001
"""Share of good networks that are called doubtful for their variance factor."""
DETERMINING = 3
"""Control points that determine a frame without any to spare."""
FIRST, CONTROL, FREE = "first-station", "control", "free"


@dataclass(frozen=True, eq=False)
class _Control:
    """Known points as given, and in the adjustment's frame."""

    given: Sequence[Json]
    frame: ControlFrame
    values: Array
    covariances: Array

    def known(self) -> KnownTargets | None:
        if not self.given:
            return None
        points = PointSet(self.values, self.covariances)
        names = tuple(point["name"] for point in self.given)
        return KnownTargets(TargetSet(names, points), np.array([point["use"] == "check" for point in self.given]))


def tie_stations(context: StepContext, arguments: Json) -> Json:
    """Adjust stations, targets and control together, and store poses and documents."""
    names: list[str] = arguments["names"]
    inputs = arguments["inputs"]
    origins, sets = {}, {}
    place = {name: number for number, name in enumerate(names)}
    given = {place[name]: own for name, own in inputs["targets"].items()}
    for number, key in enumerate(arguments["features"]):
        features = load_features(context.blobs.local_path(key))
        origins[number] = features.origin_m
        found = target_set(given.get(number), features.origin_m)
        if found is not None:
            sets[number] = StationFeatures.of_features(features, found)
    for station, errors in _errors_taken_off(context, arguments).items():
        if station in sets:
            sets[station] = without_instrument_errors(sets[station], errors)
    control = _control(inputs)
    context.progress.report(0.3, "adjusting stations, targets and control")
    groups = _groups(context, arguments, names)
    why, tied = "", None
    try:
        tied = tied_network({station: own.targets for station, own in sets.items()}, groups, control.known())
    except (TooFewCorrespondencesError, DegenerateGeometryError) as error:
        why = str(error)
    known, doubts = control.known(), tuple[str, ...]()
    if tied is not None and known is not None and tied.in_control_frame:
        doubts = doubts_of_control(tied, known)
    told = _document(tied, why, control, given, names, origins, inputs)
    if doubts:
        changed = {"status": "doubtful", "reasons": [*doubts, *told.reasons]}
        told = told.model_copy(update={**changed, "global_from_project": None, "stations": []})
        tied = _without_control(sets, groups)
    poses = _poses(tied, control, names, origins, inputs["fix"])
    if poses["poses"] is None:  # the stations keep the poses that the scans say
        told = told.model_copy(update={"frame": f"that of {names[0]}"})
    document = {
        "control": told.model_dump(by_alias=True),
        **poses,
        "places": _places(tied, control, names, origins, poses["poses"]),
        "contradicted": {} if tied is None else _contradicted(tied, names),
    }
    key = f"jobs/{arguments['job_id']}/tied.json"
    context.blobs.write_bytes(key, json.dumps(document).encode())
    return {"tied": key}


def _without_control(sets: Mapping[int, StationFeatures], groups: Sequence[RegisteredGroup]) -> TiedNetwork | None:
    """Tie stations by their targets and scans alone; None where these do not."""
    try:
        return tied_network({station: own.targets for station, own in sets.items()}, groups, None)
    except (TooFewCorrespondencesError, DegenerateGeometryError):
        return None


def _errors_taken_off(context: StepContext, arguments: Json) -> dict[int, Array]:
    """Give the errors of instruments that the poses of the network are without, by station."""
    if arguments.get("network") is None:
        return {}
    with np.load(context.blobs.local_path(arguments["network"]), allow_pickle=False) as stored:
        return dict(zip(stored["stations"].tolist(), stored["instrument_errors"], strict=True))


def _control(inputs: Json) -> _Control:
    """Carry the control to a Cartesian frame near it."""
    given: Sequence[Json] = inputs["control"]
    north_first = inputs["control_axes"] == "north-east-height"
    if not given:
        return _Control(given, ControlFrame(np.zeros(3), north_first), np.zeros((0, 3)), np.zeros((0, 3, 3)))
    places = np.array([[point["x"], point["y"], point["z"]] for point in given], dtype=np.float64)
    enh = places[:, [1, 0, 2]] if north_first else places
    origin = np.round(enh.mean(axis=0))
    crs = inputs.get("crs")
    projection = None if crs is None else TopocentricFrame(crs, origin, inputs["geoid_undulation_m"])
    frame = ControlFrame(origin, north_first, projection)
    local = frame.to_local(places)
    covariances = np.array([covariance_rows(point) for point in given])
    return _Control(given, frame, local, frame.local_covariances(covariances, local))


def _groups(context: StepContext, arguments: Json, names: Sequence[str]) -> list[RegisteredGroup]:
    """Give the stations that scans register together: the network's, and what else accepted pairs connect."""
    links = [link for link in stored_links(context, arguments["pairs"], names, IN_PLACE) if not link.of_targets]
    groups = []
    if arguments.get("network") is not None:
        with np.load(context.blobs.local_path(arguments["network"]), allow_pickle=False) as stored:
            stations = stored["stations"].tolist()
            if len(stations) > 1:
                poses = {
                    station: RigidTransform.from_matrix(matrix)
                    for station, matrix in zip(stations[1:], stored["matrices"][1:], strict=True)
                }
                groups.append(RegisteredGroup(stations[0], poses, stored["covariance"]))
    taken = {station for group in groups for station in group.stations}
    if arguments.get("network") is not None:
        links = [link for link in links if not taken & set(link.stations) and 0 not in link.stations]
    while links:
        stations = connected_stations(links, min(links[0].stations))
        own = [link for link in links if link.target in stations]
        solution = adjust_pose_graph(own, stations)
        poses = {station: solution.unknowns.poses[k] for k, station in enumerate(stations) if k > 0}
        size = 6 * len(poses)
        groups.append(RegisteredGroup(stations[0], poses, solution.cofactors[:size, :size]))
        links = [link for link in links if link.target not in stations]
    return groups


def _factor(tied: TiedNetwork) -> float:
    """Give the variance factor: sigma0² where the global test finds the residuals too large."""
    found = tied.adjustment
    test = global_test(found.omega, found.redundancy, ALPHA_GLOBAL)
    return found.omega / found.redundancy if test.verdict is GlobalVerdict.TOO_LARGE else 1.0


def _assumed_of_three(tied: TiedNetwork) -> str:
    """Return, in words, that three control points cannot tell a mistake in the order or sign of their axes."""
    upright = np.array([pose.rotation.as_matrix()[2, 2] for pose in tied.adjustment.poses])
    tilt_gon = float(np.arccos(np.clip(upright, -1.0, 1.0)).max()) * GON_PER_RAD
    return (
        "three control points fit their mirror image as well: that heights count upwards and axes are in the order "
        f"stated is assumed, and instruments lean by up to {tilt_gon:.1f} gon then; a fourth point would tell"
    )


def _passes(tied: TiedNetwork) -> bool:
    """Return whether the residuals are as small as the standard deviations promise, but for chance."""
    found = tied.adjustment
    return found.redundancy <= 0 or float(chi2_sf(found.omega, found.redundancy)) >= ALPHA_ADJUSTED


def _poses(
    tied: TiedNetwork | None, control: _Control, names: Sequence[str], origins: Mapping[int, Vector3], fix: str
) -> Json:
    """Give the poses in the frame that was asked for, and relative to the first station, between full coordinates."""
    if tied is None or (fix == CONTROL and not tied.in_control_frame):
        return {"poses": None, "fixed": None, "relative": None}
    factor = _factor(tied)
    found, covariance = tied.adjustment.poses, tied.adjustment.covariance * factor
    relative = None
    if 0 in tied.stations:
        first = relative_to(found, covariance, tied.stations.index(0))
        relative = _full(tied, *first, origins[0], names, origins, factor)
    if fix == CONTROL:
        told = _full(tied, found, covariance, control.frame.world_origin_m, names, origins, factor)
        return {"poses": told, "fixed": None, "relative": relative}
    base = 0 if fix in {FIRST, FREE} else names.index(fix)
    if base not in tied.stations:
        return {"poses": None, "fixed": None, "relative": relative}
    poses, moved = relative_to(found, covariance, tied.stations.index(base))
    if fix == FREE and len(poses) > 1:
        moved = smallest_trace(poses, moved)
    told = _full(tied, poses, moved, origins[base], names, origins, factor)
    return {"poses": told, "fixed": None if fix == FREE else names[base], "relative": relative}


def _places(
    tied: TiedNetwork | None,
    control: _Control,
    names: Sequence[str],
    origins: Mapping[int, Vector3],
    poses: Mapping[str, Json] | None,
) -> Json:
    """Give where control and check points are in the world: as known, and as adjusted where a station sees them.

    The adjustment's frame lies in the world as any of its stations says, from the told pose and the adjusted one.
    """
    if tied is None or poses is None or not tied.in_control_frame:
        return {}
    station = tied.stations[0]
    world_from_scan = RigidTransform.from_matrix(np.array(poses[names[station]]["matrix"]))
    scan_from_local = tied.adjustment.poses[0].inv()

    def in_world(local: Array) -> list[float]:
        told: list[float] = world_from_scan.apply(scan_from_local.apply(local) + origins[station]).tolist()
        return told

    found = {number: tied.adjustment.points[point] for number, point in tied.control.items()}
    return {
        point["name"]: {
            "known_m": in_world(control.values[number]),
            "place_m": in_world(found[number]) if number in found else None,
        }
        for number, point in enumerate(control.given)
    }


def _full(
    tied: TiedNetwork,
    poses: Sequence[RigidTransform],
    covariance: Array,
    origin_m: Vector3,
    names: Sequence[str],
    origins: Mapping[int, Vector3],
    factor: float,
) -> Json:
    """Give the poses between full coordinates, with where the targets of each station are."""
    told = {}
    for k, station in enumerate(tied.stations):
        own = slice(6 * k, 6 * k + 6)
        reduced = PoseEstimate(poses[k], covariance[own, own])
        pose = reduced.moved_to_origins(origin_m, origins[station])
        told[names[station]] = {
            "matrix": pose.target_from_source.as_matrix().tolist(),
            "covariance": pose.covariance.tolist(),
            "centroid_m": None,
            "a_posteriori": factor > 1.0,
        }
    return told


def _document(
    tied: TiedNetwork | None,
    why: str,
    control: _Control,
    given: Mapping[int, Sequence[Json]],
    names: Sequence[str],
    origins: Mapping[int, Vector3],
    inputs: Json,
) -> ControlResult:
    targets = target_results(given, tied, names)
    if tied is None:
        return ControlResult(
            status="not-determined", reasons=[why], frame="that of the first station", observations=0, sigma0=None,
            redundancy=0, points=[], targets=targets, scale=None, system=system_document(control.frame),
            global_from_project=None, stations=[],
        )  # fmt: skip
    found = tied.adjustment
    scale = None if found.scale is None else scale_document(found.scale, inputs.get("crs"))
    frame, factor = control.frame, _factor(tied)
    points = point_documents(control.given, control.values, control.covariances, tied, frame, names, factor)
    pop, stations = project_documents(tied, names, origins, frame, factor) if tied.in_control_frame else (None, [])
    reasons = [*_reasons(tied, names), *tied.remarks]
    reasons += [
        f"{point.use} point {point.name} is left out as a gross error, or its measurement is one (test value "
        f"{point.statistic:.0f}, limit {point.critical:.1f})"
        for point in points
        if point.state == "removed" and point.statistic is not None and point.critical is not None
    ]
    reasons += [
        f"check point {point.name} is missed by more than chance (test value {point.statistic:.0f}, limit "
        f"{point.critical:.1f})"
        for point in points
        if point.state == "check"
        and point.statistic is not None
        and point.critical is not None
        and point.statistic > point.critical
    ]
    if scale is not None and scale.advice is not None:
        reasons = [scale.advice, *reasons]
    if tied.in_control_frame and int(tied.adjustment.control.used.sum()) == DETERMINING:
        reasons.append(_assumed_of_three(tied))
    missing = [name for number, name in enumerate(names) if number not in tied.stations]
    if missing:
        reasons.append(f"without a place among the others: {', '.join(missing)}")
    return ControlResult(
        status="adjusted" if _passes(tied) else "doubtful",
        reasons=reasons,
        frame=_frame_in_words(inputs["fix"], frame, names),
        observations=int(found.seen.used.sum() + found.control.used.sum()),
        sigma0=found.sigma0,
        redundancy=found.redundancy,
        points=points,
        targets=targets,
        scale=scale,
        system=system_document(frame),
        global_from_project=pop,
        stations=stations,
    )


def _contradicted(tied: TiedNetwork, names: Sequence[str]) -> dict[str, str]:
    """Give the stations of which scans say something else than targets and control, by name, and what is said of it."""
    return {
        names[station]: (
            "targets and control contradict what the scans say of the stations to each other "
            f"({', '.join(names[each] for each in stations)}; test value {test.statistic:.0f} with {test.degrees} "
            "degrees of freedom): a target was moved or has a wrong name, or a registration is wrong"
        )
        for test, stations in zip(tied.adjustment.scans, tied.scanned, strict=True)
        if not test.agrees
        for station in stations
    }


def _reasons(tied: TiedNetwork, names: Sequence[str]) -> list[str]:
    """Name contradictions between targets and scans, and residuals that are too large as a whole."""
    said = list(dict.fromkeys(_contradicted(tied, names).values()))
    removed = [
        f"{names[station]}, target {number + 1}"
        for (station, number), row in tied.observations.items()
        if not tied.adjustment.seen.used[row]
    ]
    if removed:
        said.append(f"measured targets left out as gross errors: {', '.join(removed[:20])}")
    factor = _factor(tied)
    if factor > 1.0:
        said.append(
            f"the residuals are larger than the standard deviations say: all variances are {factor:.1f} times larger"
        )
    return said


def _frame_in_words(fix: str, frame: ControlFrame, names: Sequence[str]) -> str:
    if fix == CONTROL and frame.projection is not None:
        return f"east, north, up at the middle of the control in {frame.projection.crs}"
    if fix == CONTROL:
        return "that of the control: east, north, height"
    if fix == FREE:
        return f"axes of {names[0]}, standard deviations of the smallest trace over all stations"
    return f"that of {names[0] if fix == FIRST else fix}"
