"""What `compare` compares, read and put into one frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Labels, Matrix6, Points, Vector3
from algorithms.deviations.joint_poses import JointPoses
from algorithms.geometry.poses import PoseEstimate
from algorithms.scans.scan import Scan
from algorithms.scans.sensor_position import estimate_sensor_position
from service.errors import InvalidRequestError
from service.ports import Json, StepContext
from service.use_cases.documents.comparison_documents import reference_pose
from service.use_cases.steps.job_poses import job_result
from service.use_cases.steps.placed_stations import world_crs
from service.use_cases.steps.run_features import read_stored_scan

SEED, MOST_DRAWN = 20, 40_000
IN_WORLD = PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))
"""The pose of a scan whose coordinates are those of the world."""


@dataclass(frozen=True, eq=False)
class StationsInWorld:
    """Scans of some stations in the world frame, reduced by an origin."""

    points: Points
    """(n, 3) [m]."""
    labels: Labels
    """(n,) station of each point."""
    poses: tuple[PoseEstimate, ...]
    """World from scan of each station, full coordinates; without covariance where none is known."""
    jobs: tuple[tuple[str, str] | None, ...]
    """Job and name there of each station whose pose is of a job."""
    sensors_m: Points
    """(stations, 3) where the instruments stood, reduced [m]; NaN where nobody knows."""
    crs_wkt: str | None = None
    """Coordinate reference system of the world, WKT 1; None: not known."""
    is_converted: bool = False
    """Whether coordinates of a file were in another unit than metres."""

    def instruments_of(self, labels: Labels) -> Points | None:
        """Return where the instruments of some stations stood, (n, 3) reduced [m]; None where one is not known."""
        return self.sensors_m[labels] if np.isfinite(self.sensors_m).all() else None


def read_stations(
    context: StepContext, stations: Sequence[Json], origin_m: Vector3 | None, remarks: list[str]
) -> tuple["StationsInWorld", Vector3]:
    """Read the scans of stations and move them into the world.

    Parameters
    ----------
    context
        Of the step.
    stations
        Scan and pose of each.
    origin_m
        Subtracted from the coordinates; None: whole metres near the first station's points.
    remarks
        Grow by what was left out of the scans.

    Returns
    -------
    The stations, and the origin.
    """
    parts, labels, poses, jobs, sensors, systems, is_converted = [], [], [], [], [], [], False
    for number, station in enumerate(stations):
        context.progress.report(0.3 * number / len(stations), f"reading {station['name']}")
        scan = read_stored_scan(context, station["scan"])
        remarks += [f"{station['name']}: {note}" for note in scan.notes]
        given = station["world_from_scan"]
        pose = IN_WORLD if given is None else reference_pose(given)
        moved_origin = np.asarray(pose.target_from_source.apply(scan.origin_m))
        if origin_m is None:
            origin_m = np.round(moved_origin + pose.rotation.apply(scan.points.mean(axis=0)))
        parts.append(pose.rotation.apply(scan.points) + (moved_origin - origin_m))
        labels.append(np.full(len(scan), number, dtype=np.int32))
        sensor = instrument_of(scan)
        sensors.append(pose.rotation.apply(sensor) + (moved_origin - origin_m))
        poses.append(pose)
        of_job = isinstance(given, dict) and "jobID" in given
        systems.append(scan.crs_wkt)
        is_converted |= bool(scan.unit_before)
        jobs.append((given["jobID"], given["station"]) if of_job else None)
    if origin_m is None:
        raise InvalidRequestError("no station is left to compare: none of them has a pose")
    crs_wkt, why_none = world_crs(systems, [pose.target_from_source for pose in poses])
    remarks += [why_none] if why_none else []
    found = StationsInWorld(
        np.concatenate(parts), np.concatenate(labels), tuple(poses), tuple(jobs), np.asarray(sensors), crs_wkt,
        is_converted,
    )  # fmt: skip
    return found, origin_m


def instrument_of(scan: Scan) -> Vector3:
    """Return where the instrument of a scan stood in its reduced frame (3,) [m]; NaN where nobody knows.

    Formats that name no instrument: the origin of the file is its place, if all is seen from there.
    """
    if scan.sensor_m is not None:
        return scan.sensor_m
    rng = np.random.default_rng(SEED)
    drawn = scan.points[np.sort(rng.permutation(len(scan.points))[:MOST_DRAWN])]
    found = estimate_sensor_position(drawn, np.zeros_like(drawn), candidate_m=-scan.origin_m, rng=rng)
    confirmed = found.confirms_candidate and found.position_m is not None
    return np.asarray(found.position_m) if confirmed else np.full(3, np.nan)


def pose_pairs(
    context: StepContext, first: StationsInWorld, second: StationsInWorld, stated: Sequence[Sequence[float]] | None,
    origin_m: Vector3, remarks: list[str],
) -> dict[tuple[int, int], JointPoses]:  # fmt: skip
    """Give the joint poses of every station of the reference with every one of the cloud, reduced frame."""
    if stated is not None:
        positions = np.stack([first.poses[0].translation_m, second.poses[0].translation_m])
        return {(0, 0): JointPoses(positions, np.asarray(stated, dtype=np.float64)).moved(origin_m)}
    pairs = {}
    assumed = False
    for i, one in enumerate(first.poses):
        for j, two in enumerate(second.poses):
            cross = _cross_covariance(context, first.jobs[i], second.jobs[j])
            if cross is None:
                cross = np.zeros((6, 6))
                assumed |= bool(one.covariance.any() and two.covariance.any())
            covariance = np.block([[one.covariance, cross], [cross.T, two.covariance]])
            positions = np.stack([one.translation_m, two.translation_m])
            pairs[i, j] = JointPoses(positions, covariance).moved(origin_m)
    if assumed:
        remarks.append(
            "the errors of the stations' poses are taken as independent, because nothing says what they share: where "
            "they share much, the levels of detection are too large"
        )
    if not any(pose.covariance.any() for pose in (*first.poses, *second.poses)):
        remarks.append(
            "no pose comes with a covariance: they count as free of error, and the levels of detection do not know "
            "the errors of the registration"
        )
    return pairs


def _cross_covariance(
    context: StepContext, first: tuple[str, str] | None, second: tuple[str, str] | None
) -> Matrix6 | None:
    """Give what the errors of two stations of one job share, (6, 6); None where nothing says it."""
    if first is None or second is None or first[0] != second[0]:
        return None
    job_id = first[0]
    stations = job_result(context, job_id)["stations"]
    if first[1] == second[1]:
        own = next(each["world_from_scan"] for each in stations if each["name"] == first[1])
        return np.asarray(own["covariance"], dtype=np.float64) if own and own["covariance"] else None
    return joint_block(job_result(context, job_id), first[1], second[1])


def joint_block(result: Json, first: str, second: str) -> Matrix6 | None:
    """Read the covariance (6, 6) between two stations of a network from its result; None where it is not there."""
    joint = (result.get("network") or {}).get("joint_covariance")
    if joint is None or first not in joint["stations"] or second not in joint["stations"]:
        return None
    row, column = (6 * joint["stations"].index(name) for name in (first, second))
    return np.array([line[column : column + 6] for line in joint["matrix"][row : row + 6]], dtype=np.float64)
