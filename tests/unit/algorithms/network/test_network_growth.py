"""Which pairs of many stations are tried."""

from collections.abc import Callable
from itertools import combinations
from math import log2
from typing import Any

import numpy as np
import pytest
from scipy import sparse
from scipy.spatial.transform import RigidTransform

from algorithms.geometry.planes import Planes
from algorithms.geometry.poses import PoseEstimate
from algorithms.network import candidate_pairs
from algorithms.network.candidate_pairs import Tried, first_pairs, most_pairs, next_pairs
from algorithms.network.loop_closure import examine_loops
from algorithms.network.pose_graph import chained_parts
from algorithms.network.similarity import Likeness, appearance, likeness
from algorithms.network.whereabouts import Whereabouts, whereabouts_of
from service.processes.register.plan import RegisterPlan
from tests.scenes.buildings.city_block import city_block
from tests.scenes.buildings.plane_rooms import PlaneRooms, plane_rooms, seen_from
from tests.scenes.lines.line_scenes import LineScene, random_motion

NO_LINES = LineScene(np.empty((0, 3)), np.empty((0, 3)))


def surface_at(x: float, size: float = 10.0) -> np.ndarray:
    """Give a floor around a place along a corridor."""
    steps = np.arange(-0.5 * size, 0.5 * size, 0.5)
    return np.array([(x + a, b, 0.1) for a in steps for b in (-0.4, 0.4)])


def unlike(stations: int) -> Likeness:
    """Let no two scans have anything in common."""
    return alike_by(np.eye(stations))


def alike_by(descriptions: np.ndarray) -> Likeness:
    """Let scans be alike as descriptions of length one are."""
    return Likeness(sparse.csr_array((len(descriptions), 0)), descriptions.astype(np.float32))


def apart(places: Whereabouts, stations: int) -> set[tuple[int, int]]:
    """Give the pairs that are apart, one by one and all at once."""
    found = {pair for pair in combinations(range(stations), 2) if places.are_apart(*pair)}
    matrix = places.apart_from(np.arange(stations), stations)
    assert {(int(a), int(b)) for a, b in zip(*np.nonzero(matrix), strict=True)} == found | {(b, a) for a, b in found}
    return found


def grown(
    stations: int, works: Callable[[int, int], bool], alike: Likeness | None = None, spacing_m: float = 3.0
) -> tuple[list[tuple[int, int]], list[list[int]]]:
    """Let a corridor of stations grow: which pairs were tried, and the parts in the end."""
    similar = unlike(stations) if alike is None else alike
    surfaces = [surface_at(0.0) for _ in range(stations)]
    tried: list[tuple[int, int]] = []
    fresh = first_pairs(similar)
    while fresh:
        assert not set(fresh) & set(tried)
        tried += fresh
        accepted = [pair for pair in tried if works(*pair)]
        parts = parts_of(stations, accepted)
        poses = {
            k: RigidTransform.from_translation([spacing_m * (k - part[0]), 0.0, 0.0]) for part in parts for k in part
        }
        fresh = next_pairs(similar, surfaces, Tried(tried, accepted, poses, parts))
    return tried, parts_of(stations, [pair for pair in tried if works(*pair)])


def parts_of(stations: int, pairs: list[tuple[int, int]]) -> list[list[int]]:
    part = list(range(stations))
    for first, second in pairs:
        old, new = max(part[first], part[second]), min(part[first], part[second])
        part = [new if each == old else each for each in part]
    return [[k for k in range(stations) if part[k] == each] for each in sorted(set(part))]


@pytest.mark.parametrize("stations", [2, 5, 8])
def test_of_few_stations_every_pair_is_tried_at_once(stations: int) -> None:
    tried, _ = grown(stations, lambda a, b: abs(a - b) < 2)
    assert tried == list(combinations(range(stations), 2))


@pytest.mark.parametrize("stations", [20, 60])
def test_a_corridor_in_order_connects_and_every_station_gets_loops(stations: int) -> None:
    tried, parts = grown(stations, lambda a, b: abs(a - b) <= 2)
    assert len(parts) == 1
    accepted = [pair for pair in tried if abs(pair[0] - pair[1]) <= 2]
    degrees = np.bincount(np.array(accepted).ravel(), minlength=stations)
    assert degrees[1:-1].min() >= 3
    assert len(tried) < 8 * stations


def test_the_number_of_pairs_is_bounded_where_nothing_fits() -> None:
    for stations in (20, 100):
        tried, parts = grown(stations, lambda a, b: False)  # noqa: ARG005 - whatever pair
        assert len(parts) == stations
        assert len(tried) <= most_pairs(stations) <= stations * (4 + 2 * log2(stations))


def test_of_very_many_stations_four_pairs_are_tried_for_each() -> None:
    bounds = [most_pairs(n) for n in range(2, 3000)]
    assert all(np.diff(bounds) >= 0)
    assert most_pairs(200) == np.ceil(200 * (3.0 + 2.0 * log2(200)))
    assert most_pairs(5000) == 20_000


def test_a_first_round_that_would_be_too_large_keeps_what_known_positions_say() -> None:
    n = 1200
    positions = {k: np.array([5.0 * (7 * k % n), 0.0, 0.0]) for k in range(n)}  # neighbours are far apart in the list
    whereabouts = Whereabouts(positions)
    chosen = first_pairs(unlike(n), whereabouts)
    assert len(chosen) == 3 * n
    near = whereabouts.nearest(4)
    assert set(near) <= set(chosen)


def test_surfaces_overlap_by_the_cells_that_both_occupy() -> None:
    rng = np.random.default_rng(7)
    n = 12
    surfaces = [rng.uniform(0.0, 4.0, size=(60, 3)) for _ in range(n)]
    poses = {k: RigidTransform.from_translation([1.5 * k, 0.0, 0.0]) for k in range(n)}
    cells = [{tuple(row) for row in np.floor(poses[k].apply(surfaces[k])).tolist()} for k in range(n)]
    shares = {
        (a, b): len(cells[a] & cells[b]) / min(len(cells[a]), len(cells[b])) for a, b in combinations(range(n), 2)
    }
    tried = Tried([], [], poses, [list(range(n))])
    chosen = next_pairs(unlike(n), surfaces, tried)
    assert chosen
    assert min(shares[pair] for pair in chosen) >= 0.15
    degrees, expected = np.zeros(n, dtype=int), []
    for pair in sorted(shares, key=lambda pair: (-shares[pair], pair)):
        if shares[pair] >= 0.15 and (degrees[list(pair)] < 3).any():
            degrees[list(pair)] += 1
            expected.append(pair)
    assert chosen == sorted(expected)


def test_a_gap_in_the_order_is_bridged_by_likeness() -> None:
    # stations 0-9 and 10-19 are two corridors, which only the pair (2, 17) connects
    descriptions = np.eye(20)
    descriptions[17, [2, 17]] = 0.9, np.sqrt(1.0 - 0.9**2)
    alike = alike_by(descriptions)
    _, parts = grown(20, lambda a, b: ((a < 10) == (b < 10) and abs(a - b) == 1) or {a, b} == {2, 17}, alike)
    assert len(parts) == 1


def test_a_part_asks_for_few_pairs_however_many_stations_it_has() -> None:
    n = 400
    parts = [list(range(200)), list(range(200, 300)), list(range(300, 400))]
    poses = {k: RigidTransform.from_translation([50.0 * k, 0.0, 0.0]) for k in range(n)}  # none overlap
    accepted = [(k, k + 1) for part in parts for k in part[:-1]]
    chosen = next_pairs(unlike(n), [surface_at(0.0)] * n, Tried(accepted, accepted, poses, parts))
    assert 0 < len(chosen) <= 2 * 3 * 10
    assert all(parts_of(n, [*accepted, pair]) != parts_of(n, accepted) for pair in chosen[:3])


def test_what_no_loop_holds_is_controlled_first(monkeypatch: pytest.MonkeyPatch) -> None:
    # two triangles and the pair (2, 3) between them; further pairs over it overlap less than those inside
    n = 9
    accepted = [(0, 1), (0, 2), (1, 2), (2, 3), (3, 4), (3, 5), (4, 5), (6, 7), (7, 8)]
    poses = {k: RigidTransform.from_translation([2.0 * (k % 6) + 100.0 * (k > 5), 0.0, 0.0]) for k in range(n)}
    parts = [list(range(6)), [6, 7, 8]]
    monkeypatch.setattr(candidate_pairs, "most_pairs", lambda stations: len(accepted) + 2 + 0 * stations)
    monkeypatch.setattr(candidate_pairs, "_joining", lambda *known: [])  # noqa: ARG005 - whatever is known
    chosen = next_pairs(unlike(n), [surface_at(0.0)] * n, Tried(accepted, accepted, poses, parts))
    assert (6, 8) in chosen
    (other,) = set(chosen) - {(6, 8)}
    assert other in {(1, 3), (2, 4)}


@pytest.mark.slow
def test_a_city_holds_together_by_four_pairs_tried_for_each_station(monkeypatch: pytest.MonkeyPatch) -> None:
    n = 150
    monkeypatch.setattr(candidate_pairs, "MOST_SEARCHED", 4 * n)
    block, rng = city_block(n, np.random.default_rng(8)), np.random.default_rng(9)
    alike = likeness([appearance(block.features[k].planes) for k in range(n)])
    tried: list[tuple[int, int]] = []
    links, fresh, largest = [], first_pairs(alike), 0
    while fresh:
        tried += fresh
        links += block.registered(fresh, rng)
        rejected = examine_loops(links, block.names).rejected
        used = [link for number, link in enumerate(links) if number not in rejected]
        parts, poses = chained_parts(used, n)
        largest = max(len(part) for part in parts)
        fresh = next_pairs(alike, block.surfaces, Tried(tried, [link.stations for link in used], poses, parts))
    assert len(tried) <= 4 * n
    everything = block.registered(list(combinations(range(n), 2)), rng)
    reachable = max(len(part) for part in chained_parts(everything, n)[0])
    assert largest > 0.95 * reachable


def test_known_positions_bring_the_nearest_stations_together() -> None:
    rng = np.random.default_rng(1)
    order = rng.permutation(30)
    positions = np.zeros((30, 3))
    positions[order, 0] = 4.0 * np.arange(30)
    pairs = set(first_pairs(unlike(30), Whereabouts(dict(enumerate(positions)))))
    assert {tuple(sorted((int(order[k]), int(order[k + 1])))) for k in range(29)} <= pairs


def test_scans_are_compared_in_pieces_as_all_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(6)
    alike = alike_by(rng.random((40, 30)))
    whole = first_pairs(alike)
    monkeypatch.setattr(candidate_pairs, "ROWS_AT_ONCE", 7)
    assert first_pairs(alike) == whole


def test_scans_of_the_same_rooms_are_more_alike_than_others() -> None:
    rng = np.random.default_rng(5)
    profiles = []
    for _ in range(4):
        rooms = plane_rooms(rng, lines=20, rooms=2, bodies=3)
        for _ in range(2):
            order = rng.permutation(len(rooms.normals))
            _, planes = seen_from(rooms, NO_LINES, random_motion(rng), order, 0.002, rng)
            profiles.append(appearance(planes))
    alike = likeness(profiles).rows(np.arange(8)) - 2.0 * np.eye(8)
    assert [int(np.argmax(row)) for row in alike] == [1, 0, 3, 2, 5, 4, 7, 6]


def parallel_planes(offsets: list[float], looks: list[float]) -> Planes:
    """Give walls across x at some offsets that look along x (1) or against it (-1)."""
    rooms = PlaneRooms(
        np.array([[look, 0.0, 0.0] for look in looks]), np.array([[x, 0.0, 0.0] for x in offsets]),
        np.tile([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], (len(looks), 1, 1)), np.full((len(looks), 2), 4.0),
        np.ones(len(looks), dtype=bool), np.zeros((0, 2), np.int64), np.zeros((0, 3)), np.zeros(0),
    )  # fmt: skip
    rng = np.random.default_rng(3)
    return seen_from(rooms, NO_LINES, random_motion(rng), rng.permutation(len(looks)), 1e-6, rng)[1]


def test_two_distances_between_three_planes_tell_more_than_single_ones() -> None:
    # each of the first three distances is in the third scan too, but never next to each other
    walls = [parallel_planes(places, [1.0, -1.0, 1.0]) for places in ([0.0, 2.03, 5.17], [1.0, 3.03, 6.17])]
    walls.append(parallel_planes([0.0, 2.03, 9.0], [1.0, -1.0, 1.0]))
    alike = likeness([appearance(planes) for planes in walls]).rows(np.arange(3))
    assert alike[0, 1] > 1.0
    assert alike[0, 2] < 0.25


def test_it_does_not_matter_from_which_end_parallel_planes_are_read() -> None:
    walls = (
        parallel_planes([0.0, 2.03, 5.17], [1.0, -1.0, 1.0]),
        parallel_planes([0.0, -2.03, -5.17], [-1.0, 1.0, -1.0]),
    )
    first, second = (appearance(planes) for planes in walls)
    np.testing.assert_array_equal(first.triples, second.triples)
    np.testing.assert_allclose(first.triple_weights, second.triple_weights, atol=1e-3)


def job(stations: int, pairs: Any = "auto") -> dict[str, Any]:
    names = [f"S{k}" for k in range(stations)]
    return {
        "id": "j",
        "inputs": {
            "stations": [{"name": name, "scan": {"file": name, "index": 0}} for name in names],
            "pairs": pairs,
            "method": {"method": "auto"},
        },
        "files": {name: {"name": f"{name}.ply", "sha256": name} for name in names},
    }


def stages(stations: int, rounds: list[list[list[str]]], pairs: Any = "auto") -> list[list[str]]:
    """Run a plan with given choices; give the names of the steps of each stage."""
    outputs: list[list[dict[str, Any]]] = []
    names: list[list[str]] = []
    left = [*rounds, []]
    document = job(stations, pairs)
    while (stage := RegisterPlan().next_stage(document, outputs)) is not None:
        names.append([call.name for call in stage])
        outputs.append(
            [
                {"pairs": left.pop(0)}
                if call.name == "choose-pairs"
                else {"features": "f", "network": "n", "pair": call.arguments.get("number")}
                for call in stage
            ]
        )
    return names


def report(stations: int) -> list[str]:
    """Give the last stage: the report, and beside it what a viewer shows of each scan."""
    return ["report-registration", *["viewer-points"] * stations]


def test_two_stations_need_features_a_pair_and_a_report() -> None:
    assert stages(2, []) == [["features"] * 2, ["register-pair"], report(2)]


def test_three_stations_are_adjusted_together() -> None:
    assert stages(3, []) == [
        ["features"] * 3,
        ["register-pair"] * 3,
        ["adjust-network"],
        report(3),
    ]


def test_many_stations_grow_in_rounds_until_nothing_is_left_to_try() -> None:
    first, second = [["S0", "S1"], ["S1", "S2"]], [["S0", "S2"]]
    assert stages(9, [first, second]) == [
        ["features"] * 9,
        ["choose-pairs"],
        ["register-pair"] * 2,
        ["choose-pairs"],
        ["register-pair"],
        ["choose-pairs"],
        ["adjust-network"],
        report(9),
    ]


def test_given_pairs_of_many_stations_are_all_that_is_tried() -> None:
    assert stages(9, [], [["S0", "S1"], ["S3", "S1"]])[1:] == [
        ["register-pair"] * 2,
        ["adjust-network"],
        report(9),
    ]


def test_pairs_are_numbered_through_over_all_rounds() -> None:
    outputs: list[list[dict[str, Any]]] = [[{"features": "f"}] * 9, [{"pairs": [["S0", "S1"], ["S1", "S2"]]}]]
    outputs += [[{"pair": 0}, {"pair": 1}], [{"pairs": [["S0", "S2"]]}]]
    (call,) = RegisterPlan().next_stage(job(9), outputs) or []
    assert (call.arguments["number"], call.arguments["target"]["name"]) == (2, "S0")


def test_each_round_says_what_became_of_the_pairs_before() -> None:
    outputs: list[list[dict[str, Any]]] = [[{"features": "f"}] * 9]
    (first,) = RegisterPlan().next_stage(job(9), outputs) or []
    outputs += [[{"pairs": [["S0", "S1"], ["S1", "S2"]]}], [{"status": "accepted"}, {"status": "rejected"}]]
    (second,) = RegisterPlan().next_stage(job(9), outputs) or []
    assert first.label == "choosing pairs of stations, round 1"
    assert second.label == "choosing pairs of stations, round 2, 1 of 2 tried so far in place"


def test_each_pair_and_each_scan_of_many_says_how_far_its_stage_is() -> None:
    scans = RegisterPlan().next_stage(job(9), []) or []
    outputs: list[list[dict[str, Any]]] = [[{"features": "f"}] * 9, [{"pairs": [["S0", "S1"], ["S1", "S2"]]}]]
    pairs = RegisterPlan().next_stage(job(9), outputs) or []
    assert scans[3].label == "scan 4 of 9, features of S3"
    assert [call.label for call in pairs][1] == "round 1, pair 2 of 2, registering S2 to S1"


def test_growth_ends_even_if_there_is_always_something_to_try() -> None:
    assert len(stages(9, [[["S0", "S1"]]] * 12)) == 1 + 24 + 2


def roughly(x: float, *, turn_rad: float = 0.05, shift_m: float = 0.5) -> PoseEstimate:
    """Give an approximate pose along the corridor."""
    covariance = np.diag([turn_rad**2] * 3 + [shift_m**2] * 3)
    return PoseEstimate(RigidTransform.from_translation([x, 0.0, 0.0]), covariance)


def test_stations_whose_scans_cannot_reach_each_other_are_apart() -> None:
    surfaces = [surface_at(0.0)] * 4
    places = whereabouts_of(surfaces, {k: roughly(15.0 * k) for k in range(4)})
    # boxes of 10 m, widened by 2.5 m for the place and 1.3 m for the turn on either side
    assert apart(places, 4) == {(0, 2), (0, 3), (1, 3)}


def test_an_unknown_orientation_lets_a_scan_reach_around_its_station() -> None:
    surfaces = [surface_at(20.0)] * 3
    poses = {0: roughly(0.0, turn_rad=2.0), 1: roughly(0.0), 2: roughly(-45.0)}
    assert not whereabouts_of(surfaces, poses).are_apart(0, 1)


def test_nothing_is_concluded_from_a_pose_far_from_all_others() -> None:
    surfaces = [surface_at(0.0)] * 4
    places = whereabouts_of(surfaces, {0: roughly(0.0), 1: roughly(10.0), 2: roughly(9e4), 3: roughly(15.0)})
    assert apart(places, 4) == set()
    assert set(places.positions_m) == {0, 1, 3}


def test_stations_that_are_apart_are_never_paired() -> None:
    n = 30
    surfaces = [surface_at(0.0)] * n
    places = whereabouts_of(surfaces, {k: roughly(6.0 * k) for k in range(n)})
    alike = alike_by(np.ones((n, 1)))
    tried, fresh = [], first_pairs(alike, places)
    while fresh:
        tried += fresh
        parts = [[k] for k in range(n)]
        nothing = Tried(tried, [], {k: RigidTransform.identity() for k in range(n)}, parts)
        fresh = next_pairs(alike, surfaces, nothing, places)
    assert tried
    assert not any(places.are_apart(*pair) for pair in tried)
