"""Control in a map projection over five kilometres, left-handed axes, and the chain of the project's frames."""

import numpy as np
import pytest
from pyproj import Transformer
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.point_sets import PointSet
from algorithms.geometry.topocentric import TopocentricFrame
from algorithms.network.tied_network import KnownTargets, TiedNetwork, tied_network
from algorithms.targets.common_points import TargetSet
from service.ports import Json
from service.use_cases.documents.control_documents import (
    ControlFrame,
    point_documents,
    project_documents,
    scale_document,
    system_document,
)

STD_M = 5e-5
"""Small, so that what is left is the projection's."""
UTM = "EPSG:25832"
RNG = np.random.default_rng(5)
LONGITUDE, LATITUDE = 9.02, 48.75


def ground() -> np.ndarray:
    """Give places over 5 km in a Cartesian frame of the earth, (n, 3)."""
    along = np.linspace(-2500.0, 2500.0, 24)
    return np.column_stack([along, RNG.uniform(-300.0, 300.0, 24), RNG.uniform(0.0, 120.0, 24)])


GROUND = ground()
PIPELINE = Transformer.from_pipeline(
    "+proj=pipeline +step +inv +proj=topocentric +ellps=GRS80 "
    f"+lon_0={LONGITUDE} +lat_0={LATITUDE} +h_0=300 +step +inv +proj=cart +ellps=GRS80 "
    "+step +proj=utm +zone=32 +ellps=GRS80"
)
PROJECTED = np.column_stack(PIPELINE.transform(*GROUND.T))
"""(n, 3) easting, northing, ellipsoidal height of the same places, by PROJ alone."""
STATIONS = tuple(
    RigidTransform.from_components([x, 0.0, 60.0], Rotation.from_euler("z", turn))
    for x, turn in ((-2000.0, 0.4), (-700.0, 2.0), (700.0, -1.0), (2000.0, 3.0))
)
CONTROL = (0, 5, 11, 17, 23)


def adjusted(frame: ControlFrame, given: np.ndarray) -> tuple[TiedNetwork, list[Json], np.ndarray, np.ndarray]:
    rng = np.random.default_rng(8)
    targets = {}
    for number, pose in enumerate(STATIONS):
        near = np.flatnonzero(np.abs(GROUND[:, 0] - pose.translation[0]) < 1300.0)
        places = pose.inv().apply(GROUND[near]) + STD_M * rng.normal(size=(len(near), 3))
        targets[number] = TargetSet(tuple(f"P{k}" for k in near), PointSet.with_std(places, STD_M))
    points = [
        {"name": f"P{k}", "use": "control" if k in CONTROL else "check", "x": x, "y": y, "z": z}
        for k, (x, y, z) in enumerate(given.tolist())
    ]
    values = frame.to_local(given)
    covariances = frame.local_covariances(np.tile(STD_M**2 * np.eye(3), (len(given), 1, 1)), values)
    known = KnownTargets(
        TargetSet(tuple(each["name"] for each in points), PointSet(values, covariances)),
        np.array([each["use"] == "check" for each in points]),
    )
    return tied_network(targets, [], known), points, values, covariances


def utm_frame(*, north_first: bool = False) -> ControlFrame:
    origin = np.round(PROJECTED.mean(axis=0))
    return ControlFrame(origin, north_first, TopocentricFrame(UTM, origin))


def test_check_points_over_5_km_of_utm_are_met_to_a_millimetre() -> None:
    frame = utm_frame()
    tied, points, values, covariances = adjusted(frame, PROJECTED)
    told = point_documents(points, values, covariances, tied, frame, ["A", "B", "C", "D"])
    checks = [each for each in told if each.use == "check"]
    assert len(checks) == 19
    misses = np.array([each.difference_m for each in checks])
    assert np.abs(misses).max() < 0.001
    xyz = np.array([each.xyz_m for each in told])
    np.testing.assert_allclose(xyz, PROJECTED, atol=0.001)
    assert tied.adjustment.scale is not None
    assert not tied.adjustment.scale.significant


def test_the_same_control_without_its_system_shows_the_scale_and_names_the_projection() -> None:
    frame = ControlFrame(np.round(PROJECTED.mean(axis=0)))
    tied, *_ = adjusted(frame, PROJECTED)
    assert tied.adjustment.scale is not None
    scale = scale_document(tied.adjustment.scale, None)
    assert scale.significant
    assert -470.0 < scale.value_ppm < -430.0  # 0.9996 and a height of about 360 m
    assert scale.advice is not None
    assert "map projection" in scale.advice
    assert "crs" in scale.advice


def test_left_handed_axes_are_read_and_written() -> None:
    frame = utm_frame(north_first=True)
    given = PROJECTED[:, [1, 0, 2]]
    tied, points, values, covariances = adjusted(frame, given)
    told = point_documents(points, values, covariances, tied, frame, ["A", "B", "C", "D"])
    np.testing.assert_allclose([each.xyz_m for each in told], given, atol=0.001)


@pytest.mark.parametrize("north_first", [False, True])
def test_the_chain_of_project_and_global_frame_is_the_pose(north_first: bool) -> None:
    origin = np.array([3_500_000.0, 5_400_000.0, 300.0])
    frame = ControlFrame(origin, north_first)
    tied, *_ = adjusted(frame, (GROUND + origin)[:, [1, 0, 2]] if north_first else GROUND + origin)
    shift = {k: np.array([1000.0, -2000.0, 10.0]) * k for k in range(4)}
    pop, stations = project_documents(tied, ["A", "B", "C", "D"], shift, frame)
    matrix = np.array(pop)
    assert np.sign(np.linalg.det(matrix[:3, :3])) == (-1 if north_first else 1)
    for station in stations:
        number = "ABCD".index(station.name)
        sop = np.array(station.project_from_scan)
        np.testing.assert_allclose(np.linalg.det(sop[:3, :3]), 1.0, atol=1e-12)
        in_file = np.append(np.array([3.0, 4.0, 1.0]) + shift[number], 1.0)
        expected = STATIONS[number].apply([3.0, 4.0, 1.0]) + origin
        np.testing.assert_allclose(
            (matrix @ sop @ in_file)[:3], expected[[1, 0, 2]] if north_first else expected, atol=0.002
        )


def test_the_map_into_the_projection_is_good_to_a_millimetre_near_the_station() -> None:
    frame = utm_frame()
    tied, *_ = adjusted(frame, PROJECTED)
    _, stations = project_documents(tied, ["A", "B", "C", "D"], {k: np.zeros(3) for k in range(4)}, frame)
    for station in stations:
        number = "ABCD".index(station.name)
        place = np.array([60.0, -50.0, 4.0])
        told = np.array(station.system_from_scan) @ np.append(place, 1.0)
        expected = np.array(PIPELINE.transform(*STATIONS[number].apply(place)))
        np.testing.assert_allclose(told[:3], expected, atol=0.0015)


def test_the_system_tells_scale_convergence_and_what_was_assumed_of_heights() -> None:
    system = system_document(utm_frame())
    assert system is not None
    assert -460.0 < system.scale_ppm < -440.0
    np.testing.assert_allclose(
        system.convergence_gon, (LONGITUDE - 9.0) * np.sin(np.radians(LATITUDE)) / 0.9, atol=1e-3
    )
    assert "ellipsoid" in system.heights
