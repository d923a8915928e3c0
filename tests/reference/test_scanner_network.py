"""A network of twenty scans and 743 polar observations against its reference adjustment (MATH 6, 8)."""

import json
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.datum import DatumSelection, motion_basis, s_transformation
from algorithms.adjustment.network_adjustment import NetworkAdjustment, adjust_network
from algorithms.adjustment.observations.polar import Polar
from algorithms.adjustment.options import NetworkOptions
from algorithms.adjustment.problem import Problem
from algorithms.adjustment.unknowns import UnknownKind, Unknowns
from algorithms.adjustment.variance_components import helmert_factors
from algorithms.geometry.angles import GON_PER_RAD, angle_covariance, rotation_from_angles
from algorithms.geometry.rotations import rotation_between_directions

VECTORS = Path(__file__).parents[2].parent / "shared" / "data" / "vectors"
RELATIVE = 1e-4  # of sigma0, groups and standard deviations: the vectors' own promise (MATH 8)
COORDINATES = 1e-6  # m: the digits of the vectors
ONLY_ADJUST = NetworkOptions(robust=False, snooping=False)
GROUPS = ("detail_a", "detail_z", "detail_s", "pano_a", "pano_z", "pano_s")
COMPONENTS = (("horizontal", GON_PER_RAD), ("zenith", GON_PER_RAD), ("distance", 1.0))


@dataclass(frozen=True, eq=False)
class Network:
    problem: Problem
    start: Unknowns
    groups: np.ndarray
    stations: list[str]
    points: list[str]


def vectors(name: str) -> dict[str, Any]:
    path = VECTORS / f"ref_scans_only_{name}.json"
    if not path.exists():
        pytest.skip(f"test vectors not found: {path}")
    return json.loads(path.read_text())


@cache
def network() -> Network:
    data = vectors("input")
    stations, points = [s["id"] for s in data["stations"]], list(data["points_approx"])
    approximate = [s["approx"] for s in data["stations"]]
    poses = [
        RigidTransform.from_components(
            [a["X"], a["Y"], a["Z"]], rotation_from_angles(*(a[k] / GON_PER_RAD for k in ("omega", "phi", "kappa")))
        )
        for a in approximate
    ]
    rows = [
        (stations.index(o["station"]), points.index(o["point"]), k, o[name] / unit, o[f"sigma_{name}"] / unit, group)
        for o in data["observations"]["polar"]
        for k, (name, unit) in enumerate(COMPONENTS)
        if name in o
        for group in [k + (0 if o["scan"].startswith("6") else 3)]
    ]
    station, point, component, value, std, group = (np.array(column) for column in zip(*rows, strict=True))
    polar = Polar(station.astype(np.int64), point.astype(np.int64), component.astype(np.int32), value, std)
    start = Unknowns(
        RigidTransform.concatenate(poses),
        np.array([data["points_approx"][p] for p in points], dtype=np.float64),
        np.zeros(len(stations), dtype=bool),
        np.zeros(len(points), dtype=bool),
    )
    return Network(Problem((polar,)), start, group.astype(np.int64), stations, points)


@cache
def free() -> NetworkAdjustment:
    net = network()
    datum = DatumSelection.of_everything(net.start)
    return adjust_network(net.problem, net.start, datum, groups=net.groups, options=ONLY_ADJUST)


def minimal_columns(net: Network, start: Unknowns) -> np.ndarray:
    first = start.first_columns(UnknownKind.POINT, np.array([net.points.index(p) for p in ("401", "402", "403")]))
    return np.array([first[0], first[0] + 1, first[0] + 2, first[1] + 1, first[1] + 2, first[2] + 2])


@cache
def minimal() -> NetworkAdjustment:
    net, held = network(), vectors("expected_minimal")["datum"]["values"]
    points = net.start.points.copy()
    for name, value in held.items():
        points[net.points.index(name[:-1]), "XYZ".index(name[-1])] = value
    start = replace(net.start, points=points)
    return adjust_network(net.problem, start, minimal_columns(net, start), groups=net.groups, options=ONLY_ADJUST)


def stds(result: NetworkAdjustment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Standard deviations of points [m], positions [m] and angles [gon]."""
    covariance, unknowns = result.solution.cofactors, result.solution.unknowns
    poses = 6 * len(network().stations)
    all_stds = np.sqrt(np.diag(covariance))
    angles = [
        np.sqrt(np.diag(angle_covariance(unknowns.poses.rotation[k], covariance[6 * k : 6 * k + 3, 6 * k : 6 * k + 3])))
        for k in range(poses // 6)
    ]
    return all_stds[poses:].reshape(-1, 3), all_stds[:poses].reshape(-1, 6)[:, 3:], np.array(angles) * GON_PER_RAD


def expected(data: dict[str, Any], kind: str, key: str) -> np.ndarray:
    names = network().points if kind == "points" else network().stations
    return np.array([data[kind][name][key] for name in names])


@pytest.mark.parametrize("name", ["free", "minimal"])
def test_sigma0_and_redundancy_are_those_of_the_reference(name: str) -> None:
    data, result = vectors(f"expected_{name}"), {"free": free, "minimal": minimal}[name]()
    assert result.solution.converged
    assert result.solution.redundancy == data["redundancy"]
    np.testing.assert_allclose(result.solution.omega, data["vPv"], rtol=RELATIVE)
    np.testing.assert_allclose(result.solution.sigma0, data["sigma0"], rtol=RELATIVE)
    np.testing.assert_allclose(result.components.redundancy.sum(), data["sum_r"], rtol=1e-9)
    test = data["global_test"]
    np.testing.assert_allclose([result.global_test.lower, result.global_test.upper], [test["lower"], test["upper"]])


def test_the_groups_have_the_reference_redundancies_and_factors() -> None:
    figures, groups = free().groups, vectors("expected_free")["groups"]
    assert figures.counts.tolist() == [groups[g]["N"] for g in GROUPS]
    np.testing.assert_allclose(figures.redundancies, [groups[g]["r"] for g in GROUPS], rtol=RELATIVE)
    np.testing.assert_allclose(figures.factors, [groups[g]["S_gr"] for g in GROUPS], rtol=RELATIVE)


@pytest.mark.parametrize("name", ["free", "minimal"])
def test_standard_deviations_are_those_of_the_reference_in_the_same_datum(name: str) -> None:
    data, result = vectors(f"expected_{name}"), {"free": free, "minimal": minimal}[name]()
    points, positions, angles = stds(result)
    digits = 6e-8  # the reference prints seven decimals of metres, six of gon
    # the reference holds coordinates by observations of 1 µm, here they are held exactly
    held = expected(data, "points", "sigma") <= 1e-6
    np.testing.assert_allclose(np.where(held, 1e-6, points), expected(data, "points", "sigma"), RELATIVE, digits)
    np.testing.assert_allclose(positions, expected(data, "stations", "sigma_xyz"), rtol=RELATIVE, atol=digits)
    np.testing.assert_allclose(angles, expected(data, "stations", "sigma_gon"), rtol=RELATIVE, atol=6e-7)


def test_coordinates_in_the_minimal_datum_are_those_of_the_reference() -> None:
    data, unknowns = vectors("expected_minimal"), minimal().solution.unknowns
    np.testing.assert_allclose(unknowns.points, expected(data, "points", "xyz"), atol=COORDINATES)
    np.testing.assert_allclose(unknowns.poses.translation, expected(data, "stations", "xyz"), atol=COORDINATES)


def test_coordinates_of_the_free_network_are_those_of_the_reference_after_a_rigid_alignment() -> None:
    reference = expected(vectors("expected_free"), "points", "xyz")
    points = free().solution.unknowns.points
    centred, other = points - points.mean(axis=0), reference - reference.mean(axis=0)
    rotation = rotation_between_directions(centred, other)
    np.testing.assert_allclose(rotation.apply(centred), other, atol=COORDINATES)


def test_the_largest_test_values_and_detectable_errors_are_those_of_the_reference() -> None:
    net, result, polar = network(), free(), network().problem.observations[0]
    for row in vectors("expected_free")["largest_w"]:
        which = (
            (polar.stations == net.stations.index(row["station"]))
            & (polar.points == net.points.index(str(row["point"])))
            & (polar.components == "azs".index(row["comp"]))
            & ((net.groups >= 3) == (row["scan"] >= 7000))
        )
        (k,) = np.flatnonzero(which)
        np.testing.assert_allclose(abs(result.components.w[k]), abs(row["w"]), rtol=RELATIVE)
        np.testing.assert_allclose(result.components.redundancy[k], row["r"], rtol=RELATIVE)
        np.testing.assert_allclose(result.components.detectable[k] / polar.stds[k], row["mdb_in_sigma"], rtol=RELATIVE)


def test_the_s_transformation_carries_the_free_network_to_the_minimal_datum() -> None:
    net, solution = network(), free().solution
    held = np.zeros((solution.unknowns.count, 6))
    held[minimal_columns(net, solution.unknowns), np.arange(6)] = 1.0
    carried = s_transformation(motion_basis(solution.unknowns), held) @ solution.cofactors
    carried = carried @ s_transformation(motion_basis(solution.unknowns), held).T
    # the other datum is linearised at coordinates that differ by some millimetres in ten metres
    np.testing.assert_allclose(
        np.sqrt(np.diag(carried)), np.sqrt(np.diag(minimal().solution.cofactors)), rtol=2e-3, atol=1e-9
    )


def spoiled(errors_in_std: np.ndarray) -> Problem:
    polar = network().problem.observations[0]
    return Problem((replace(polar, values=polar.values + errors_in_std * polar.stds),))


def planted(seed: int) -> np.ndarray:
    """56 gross errors of 6 to 100 standard deviations in well controlled observations, spread over the network."""
    rng, size = np.random.default_rng(seed), len(network().problem)
    controlled = np.flatnonzero(free().components.redundancy > 0.5)
    errors = np.zeros(size)
    which = rng.choice(controlled, 56, replace=False)
    errors[which] = rng.choice([-1.0, 1.0], 56) * np.exp(rng.uniform(np.log(8.0), np.log(100.0), 56))
    return errors


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_of_56_gross_errors_at_least_54_are_found_and_at_most_3_good_observations_removed(seed: int) -> None:
    net, errors = network(), planted(seed)
    result = adjust_network(spoiled(errors), net.start, DatumSelection.of_everything(net.start), groups=net.groups)
    removed = ~result.snooping.used
    assert int((removed & (errors != 0.0)).sum()) >= 54
    assert int((removed & (errors == 0.0)).sum()) <= 3


def test_wrong_standard_deviations_of_groups_are_recovered_within_three_of_their_standard_deviations() -> None:
    net = network()
    wrong = np.array([0.6, 1.5, 0.8, 1.3, 0.7, 1.2])
    polar = net.problem.observations[0]
    problem = Problem((replace(polar, stds=polar.stds * wrong[net.groups]),))
    result = adjust_network(
        problem,
        net.start,
        DatumSelection.of_everything(net.start),
        groups=net.groups,
        options=NetworkOptions(robust=False, variance_components=True, max_removed_share=0.0),
    )
    components = result.variance_components
    assert components is not None
    assert components.converged
    # the data themselves were made with the undisturbed standard deviations, up to their own estimates (S_gr)
    np.testing.assert_array_less(np.abs(components.factors * wrong - 1.0), 3.0 * components.factor_stds * wrong)
    np.testing.assert_allclose(result.solution.sigma0, 1.0, atol=0.01)


def test_helmert_and_foerstner_agree_where_the_factors_are_settled() -> None:
    net = network()
    options = NetworkOptions(robust=False, variance_components=True, max_removed_share=0.0)
    datum = DatumSelection.of_everything(net.start)
    result = adjust_network(net.problem, net.start, datum, groups=net.groups, options=options)
    np.testing.assert_allclose(helmert_factors(result.solution, net.groups, 6), 1.0, atol=0.015)
