"""Scans that differ by more than a motion: what is found, what is not, and what the pose's covariance then holds."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.poses import PoseEstimate
from algorithms.progress import NoProgress
from algorithms.registration.deformed_fit import (
    COUNTS,
    Deformation,
    DeformationKind,
    DeformedFit,
    MotionAlone,
    fit_deformed,
)
from algorithms.registration.rigidity import explained_by_a_bend, rigidity
from algorithms.scans.scan import Scan
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scenes import SCENES
from tests.scenes.buildings.distorted_scans import bent, scaled, stretched

SCANNER = VirtualScanner(rows=300, columns=720, range_noise_std_m=0.002)
STATIONS = (1, 2)

Distortion = Callable[[np.ndarray], np.ndarray]


@cache
def stations() -> tuple[tuple[RigidTransform, RigidTransform], tuple[np.ndarray, np.ndarray]]:
    """Give poses and points of two stations of an office, in their own frames."""
    scene = SCENES["office"]()
    poses = tuple(scene.stations[k] for k in STATIONS)
    scans = [scan_scene(scene, pose, SCANNER, np.random.default_rng(k)) for k, pose in enumerate(poses)]
    clouds = tuple(scan.points + scan.origin_m for scan in scans)
    return (poses[0], poses[1]), (clouds[0], clouds[1])


def features(points: np.ndarray) -> ScanFeatures:
    scan = Scan(
        points=np.ascontiguousarray(points), origin_m=np.zeros(3), name="", grid=None, intensity=None, color=None,
        sensor_m=np.zeros(3), world_from_scan=None,
    )  # fmt: skip
    return extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))


@cache
def target() -> ScanFeatures:
    return features(stations()[1][0])


def source(distortion: Distortion = lambda points: points) -> ScanFeatures:
    return features(distortion(stations()[1][1]))


def truth() -> RigidTransform:
    first, second = stations()[0]
    return first.inv() * second


def pose() -> RigidTransform:
    """Give a pose that is a little off: what a part of a distorted scan would lead to."""
    turn = Rotation.from_rotvec([1e-3, -1e-3, 1e-3])
    return RigidTransform.from_components(np.asarray(truth().translation) + 0.005, turn * truth().rotation)


@pytest.mark.slow
def test_two_scans_of_one_office_differ_by_a_motion_only() -> None:
    found = rigidity(target(), source(), truth())
    assert found.kind is None
    assert found.doubts() == []
    assert found.scale is not None
    assert abs(found.scale.value) < 4.0 * found.scale.std


@pytest.mark.slow
@pytest.mark.parametrize("axes", [slice(0, 3), slice(2, 3)])
def test_scans_whose_coordinates_are_rounded_differ_by_a_motion_only(axes: slice) -> None:
    # in the building's axes, so that every wall falls on one step
    rounded = []
    for pose, points in zip(*stations(), strict=True):
        levelled = pose.rotation.apply(points)
        levelled[:, axes] = np.round(levelled[:, axes] / 0.01) * 0.01
        rounded.append(features(levelled))
    first, second = stations()[0]
    # as far off as rounding leaves a pose
    off = np.array([0.002, -0.001, 0.003])
    shift = RigidTransform.from_translation(np.asarray(second.translation) - np.asarray(first.translation) + off)
    found = rigidity(rounded[0], rounded[1], shift)
    assert rounded[0].rounding is not None
    assert found.kind is None
    assert found.scale is not None
    assert abs(found.scale.value) < 4.0 * found.scale.std


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.003])
def test_a_scale_is_found_to_its_standard_deviation(factor: float) -> None:
    found = rigidity(target(), source(lambda points: scaled(points, factor)), pose())
    assert found.kind is DeformationKind.SCALE
    assert found.scale is not None
    assert found.scale.value == pytest.approx(factor - 1.0, abs=4.0 * found.scale.std + 1e-4)
    assert "of the surface fits" in found.doubts()[0]


def one_end_laid_on_itself(factors: np.ndarray) -> RigidTransform:
    """Give the pose in which a place 4 m from the source's instrument lies right after it was moved by its factors."""
    place = np.array([3.0, -2.5, 1.0])
    shift = truth().rotation.apply(place - factors * place)
    return RigidTransform.from_components(np.asarray(truth().translation) + shift, truth().rotation)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.93, 1.06])
def test_a_scale_of_per_cents_is_found_from_where_one_end_fits_once_something_is_doubtful(factor: float) -> None:
    distorted = source(lambda points: scaled(points, factor))
    found = rigidity(target(), distorted, one_end_laid_on_itself(np.full(3, factor)), is_doubtful=True)
    assert found.kind is DeformationKind.SCALE
    assert found.scale is not None
    assert found.scale.value == pytest.approx(factor - 1.0, abs=4.0 * found.scale.std + 1e-4)


@pytest.mark.slow
def test_a_stretch_of_per_cents_along_one_axis_is_found_once_something_is_doubtful() -> None:
    distorted = source(lambda points: stretched(points, 1.05, 2))
    start = one_end_laid_on_itself(np.array([1.0, 1.0, 1.05]))
    found = rigidity(target(), distorted, start, is_doubtful=True)
    assert found.kind is DeformationKind.STRAIN
    assert found.stretch is not None
    assert found.stretch.value == pytest.approx(0.05, abs=2e-3)
    assert found.stretch.direction_in_source is not None
    assert found.stretch.direction_in_source[2] > 0.98


def test_what_is_undone_lies_where_it_was_however_large_the_strain() -> None:
    deformation = Deformation(DeformationKind.STRAIN, 1.0, np.array([0.08, -0.05, 0.1, 0.02, 0.0, -0.03]))
    centre = np.array([4.0, -1.0, 2.0])
    fit = DeformedFit(truth(), centre, deformation, np.eye(6), np.eye(6), 0.001, 1.0, 1.0)
    points = np.random.default_rng(3).uniform(-10.0, 10.0, (20, 3))
    np.testing.assert_allclose(fit.undone(fit.apply(points)), points, atol=1e-12)


@pytest.mark.slow
def test_a_stretch_along_one_axis_is_found_with_its_axis() -> None:
    found = rigidity(target(), source(lambda points: stretched(points, 1.01, 0)), pose())
    assert found.kind is DeformationKind.STRAIN
    assert found.stretch is not None
    assert found.stretch.direction_in_source is not None
    assert found.stretch.value == pytest.approx(0.01, abs=2e-3)
    assert abs(found.stretch.direction_in_source[0]) > 0.98


@pytest.mark.slow
def test_a_bend_is_found() -> None:
    found = rigidity(target(), source(lambda points: bent(points, 0.03, 10.0)), pose())
    assert found.kind is not None


def fit_with(kind: DeformationKind, gain: float, explained_m: float) -> DeformedFit:
    """Give a fit that lays more surface on surface by a gain, and closes gaps of so large a standard deviation."""
    nothing = Deformation(kind, 1.0, np.zeros(1))
    spread = 0.003
    return DeformedFit(
        RigidTransform.identity(), np.zeros(3), nothing, np.zeros((1, 0)), np.zeros((0, 0)), spread, 1.0 + gain, 1.0,
        float(np.hypot(spread, explained_m)),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("gain", "explained_m", "bends"),
    [(0.04, 0.0, True), (0.02, 0.0025, True), (0.02, 0.0015, False), (0.005, 0.0025, False)],
)
def test_a_bend_counts_where_it_explains_surface_or_closes_gaps_as_large_as_the_noise(
    gain: float, explained_m: float, bends: bool
) -> None:
    scale, strain = (fit_with(kind, 0.0, 0.0) for kind in (DeformationKind.SCALE, DeformationKind.STRAIN))
    bend = fit_with(DeformationKind.BEND, gain, explained_m)
    assert explained_by_a_bend(scale, strain, bend, noise_m=0.002) is bends


@pytest.mark.slow
def test_the_widened_covariance_holds_where_the_instrument_stood() -> None:
    found = rigidity(target(), source(lambda points: scaled(points, 1.01)), pose())
    small = PoseEstimate(pose(), 1e-10 * np.eye(6))
    wide = found.widened(small)
    moved = np.asarray(truth().translation) - np.asarray(pose().translation)
    # one standard deviation and a half of the shift holds the place of the source's instrument, its frame's origin
    assert np.linalg.norm(moved) < 1.5 * np.sqrt(np.trace(wide.covariance[3:, 3:]))


@pytest.mark.slow
def test_exchanging_the_scans_says_the_same_of_the_other() -> None:
    other = source(lambda points: scaled(points, 1.01))
    one, two = rigidity(target(), other, pose()), rigidity(other, target(), pose().inv())
    assert one.kind is two.kind is DeformationKind.SCALE
    assert one.scale is not None
    assert two.scale is not None
    assert (1.0 + one.scale.value) * (1.0 + two.scale.value) == pytest.approx(1.0, abs=1e-9)
    small = PoseEstimate(pose(), 1e-10 * np.eye(6))
    np.testing.assert_allclose(
        one.widened(small).inverse().covariance, two.widened(small.inverse()).covariance, atol=1e-9
    )


@pytest.mark.parametrize("kind", list(DeformationKind))
def test_displacements_are_linear_in_their_coefficients(kind: DeformationKind) -> None:
    rng = np.random.default_rng(1)
    arms = rng.normal(size=(20, 3))
    count = Deformation(kind, 2.0, np.zeros(0)).fields(arms).shape[2]
    coefficients = rng.normal(size=count)
    shifts = Deformation(kind, 2.0, coefficients).displacements(arms)
    single = [Deformation(kind, 2.0, row).displacements(arms) for row in np.diag(coefficients)]
    np.testing.assert_allclose(shifts, np.sum(single, axis=0), atol=1e-12)


@pytest.mark.parametrize("kind", list(DeformationKind))
def test_displacements_and_their_parts_along_normals_follow_from_the_fields(kind: DeformationKind) -> None:
    rng = np.random.default_rng(2)
    arms, normals = rng.normal(0.0, 3.0, (2, 20, 3))
    coefficients = rng.normal(0.0, 0.01, COUNTS[kind])
    bent = Deformation(kind, 2.0, coefficients)
    np.testing.assert_allclose(bent.displacements(arms), bent.fields(arms) @ coefficients, atol=1e-12)
    along = np.einsum("ni,nik->nk", normals, bent.fields(arms))
    np.testing.assert_allclose(bent.fields_along(arms, normals), along, atol=1e-12)


def test_a_strain_is_the_matrix_that_displaces() -> None:
    rng = np.random.default_rng(2)
    arms, strain = rng.normal(size=(20, 3)), Deformation(DeformationKind.STRAIN, 1.0, rng.normal(size=6))
    np.testing.assert_allclose(strain.displacements(arms), arms @ strain.strain(), atol=1e-12)


def test_a_deformed_point_is_taken_back() -> None:
    fit = fit_deformed(
        MotionAlone(target(), source(lambda points: scaled(points, 1.003)), pose()), DeformationKind.SCALE
    )
    points = np.random.default_rng(3).uniform(-3.0, 3.0, (10, 3))
    # to the third order of a deformation of 0.3 % over some metres
    np.testing.assert_allclose(fit.undone(fit.apply(points)), points, atol=1e-6)
