"""The step of `orient`: read, move, describe, store."""

import json
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Points, Vector3
from algorithms.closest_points.many_clouds import Cloud, OrientedClouds, orient_clouds
from algorithms.closest_points.simultaneous import CloudPairs
from algorithms.deviations.signed_distances import cloud_normals
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.progress import ProgressSection
from schemas.requests.orient import OrientDocument, OrientedStation, OrientedTies, OrientRound
from service.errors import FieldFault, InvalidRequestError
from service.ports import Json, StepContext
from service.use_cases.documents.pose_documents import matrix_rows
from service.use_cases.steps.output_files import artifact, output_file
from service.use_cases.steps.placed_stations import pose_of, read_stations

NORMAL_VOXELS = 2.5
"""Radius of the neighbourhoods that tell normals, in voxels."""


def orient(context: StepContext, arguments: Json) -> Json:
    """Move the clouds, and store document and poses.

    Raises
    ------
    InvalidRequestError
        Fewer than two stations have a pose, or a station that is to stay fixed has none.
    TooFewCorrespondencesError
        A cloud lies on no other.
    DegenerateGeometryError
        The clouds leave a motion free.
    """
    job_id, options, stations = arguments["job_id"], arguments["options"], arguments["stations"]
    names = [station["name"] for station in stations]
    fixed_names = options["fixed"] or names[:1]
    tied_names = [tie[end] for tie in options["ties"] for end in ("first", "second")]
    missing = [name for name in (*fixed_names, *tied_names) if name not in names]
    if len(names) < 2 or missing:
        why = f"station '{missing[0]}' has no pose" if missing else "fewer than two stations have a pose"
        raise InvalidRequestError(why, [FieldFault("/inputs/stations", why)])
    frame = read_stations(context, stations)
    clouds = [_cloud(each.scan.name, each.points(), options["voxel_m"]) for each in frame.stations]
    still = [RigidTransform.identity()] * len(clouds)
    ties = [_tie(tie, names, stations, frame.origin_m) for tie in options["ties"]]
    found = orient_clouds(
        clouds,
        still,
        fixed={names.index(name) for name in fixed_names},
        ties=ties,
        max_distance_m=options["max_distance_m"],
        max_angle_rad=options["max_angle_gon"] / GON_PER_RAD,
        max_rounds=options["max_rounds"],
        least_step_m=options["least_step_m"],
        progress=ProgressSection(context.progress, 0.4, 1.0),
    )
    out = RigidTransform.from_translation(frame.origin_m)
    poses = [
        out * moved * out.inv() * pose_of(station)
        for moved, station in zip(found.world_from_cloud, stations, strict=True)
    ]
    with output_file(context, job_id, "poses.json") as path:
        rows = {name: matrix_rows(pose) for name, pose in zip(names, poses, strict=True)}
        path.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    document = OrientDocument(
        stations=[
            _station(cloud, pose, moved, fixed=cloud.name in fixed_names)
            for cloud, pose, moved in zip(clouds, poses, found.world_from_cloud, strict=True)
        ],
        rounds=[OrientRound(misfit_m=each.misfit_m, step_m=each.step_m, pairs=each.pairs) for each in found.rounds],
        neighbours=[(names[i], names[j]) for i, j in found.neighbours],
        ties=[
            OrientedTies(first=names[each.first], second=names[each.second], distances_m=_apart(each, found))
            for each in ties
        ],
        converged=found.converged,
        left_out=arguments["left_out"],
        poses_from=arguments["poses_from"],
        remarks=frame.notes(),
        artifacts=[artifact(context, job_id, "poses.json", "application/json")],
    )
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"stations": len(stations)}


def _tie(tie: Json, names: Sequence[str], stations: Sequence[Json], origin_m: Vector3) -> CloudPairs:
    """Put tie points where the stations are in the common frame."""
    first, second = (names.index(tie[end]) for end in ("first", "second"))
    ends = np.array(tie["points"], dtype=np.float64).reshape(-1, 2, 3)
    points, others = (pose_of(stations[k]).apply(ends[:, end]) - origin_m for end, k in enumerate((first, second)))
    return CloudPairs(first, second, points, others, np.full(len(ends), float(tie["weight"])))


def _apart(tie: CloudPairs, found: OrientedClouds) -> list[float]:
    poses = found.world_from_cloud
    gaps = poses[tie.first].apply(tie.points) - poses[tie.second].apply(tie.others)
    return [float(each) for each in np.linalg.norm(gaps, axis=1)]


def _cloud(name: str, points: Points, voxel_m: float) -> Cloud:
    """Keep one point of each voxel, with its normal."""
    places = np.floor((points - points.min(axis=0)) / voxel_m).astype(np.int64)
    _, firsts = np.unique(places, axis=0, return_index=True)
    kept = np.ascontiguousarray(points[np.sort(firsts)])
    normals = cloud_normals(kept, NORMAL_VOXELS * voxel_m)
    surface = np.abs(normals).sum(axis=1) > 0.0
    return Cloud(name, np.ascontiguousarray(kept[surface]), np.ascontiguousarray(normals[surface]))


def _station(cloud: Cloud, pose: RigidTransform, moved: RigidTransform, *, fixed: bool) -> OrientedStation:
    middle = cloud.points.mean(axis=0) if len(cloud.points) else np.zeros(3)
    return OrientedStation(
        name=cloud.name,
        fixed=fixed,
        points=len(cloud.points),
        world_from_scan=matrix_rows(pose),
        rotation_gon=float(moved.rotation.magnitude()) * GON_PER_RAD,
        shift_m=float(np.linalg.norm(moved.apply(middle) - middle)),
    )
