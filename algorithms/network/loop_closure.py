"""Find wrong registrations by loops: going round, every loop must end where it began (MATH 6.5).

A loop of registrations whose closing error is larger than their covariances allow holds a wrong one. Which one, the
other loops tell: the explanation with the fewest wrong registrations is taken that breaks every failing loop, where a
passing loop with exactly one wrong registration would be a coincidence and counts like one more. Where several
explanations are equally good, nobody can say which is true: none of the registrations they blame is used.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
from scipy import stats
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations.relative_poses import RelativePoses
from algorithms.adjustment.solver import Solution
from algorithms.adjustment.unknowns import UnknownKind
from algorithms.geometry.poses import PoseEstimate
from algorithms.network.links import StationLink
from algorithms.network.wrong_links import Blame, wrong_links

if TYPE_CHECKING:
    import networkx as nx

FLOOR_NOISES = 2.0
"""Loops allow each registration an error of so many noises of single points besides its covariance: uneven walls."""

MOST_VARIANCE_FACTOR = 9.0
"""Covariances are at most so far from the truth: loops that miss by more hold a wrong registration."""

CLOSURE_DEGREES = 6.0

ALPHA = 0.001
"""Probability that a loop of good registrations fails, where their covariances are right."""


@dataclass(frozen=True)
class Loop:
    """A closed way along registrations, and how well it closes."""

    links: tuple[int, ...]
    """Numbers of the registrations."""
    stations: tuple[int, ...]
    """Stations in order; the first follows the last again."""
    turn_rad: float
    """Closing error: angle [rad]."""
    shift_m: float
    """Closing error: shift of the features of the first link [m]."""
    statistic: float
    """T of the closing error, variance factor included; chi-square with 6 degrees of freedom."""
    passed: bool


@dataclass(frozen=True, eq=False)
class LoopVerdict:
    """Which registrations are consistent with each other."""

    loops: tuple[Loop, ...]
    variance_factor: float
    """By which covariances were enlarged: what most loops say, at least 1."""
    critical: float
    """Limit of T."""
    rejected: dict[int, str]
    """Registrations that are not used, with the reason; names of stations by `names` of `examine_loops`."""
    alternatives: dict[int, tuple[int, ...]]
    """Rejected registrations of which perhaps only some are wrong, with those that may be wrong instead."""
    uncontrolled: tuple[int, ...]
    """Used registrations that lie in no loop of used ones: nothing checks them."""


def examine_loops(links: Sequence[StationLink], names: Sequence[str]) -> LoopVerdict:
    """Test all triangles, and the shortest loop of every registration that is in none (MATH 6.5).

    What is left is tested anew, with the loops that are shortest then, until all loops pass.

    The errors of the registrations of a loop count as independent. They share scans; what is shared mostly cancels in a
    closing error, so the test is on the cautious side of calling a loop wrong. O(links x neighbours).

    Parameters
    ----------
    links
        Registrations.
    names
        Of the stations, for the reasons.
    """
    critical = float(stats.chi2.isf(ALPHA, CLOSURE_DEGREES))
    tested: dict[frozenset[int], tuple[Way, _Closing]] = {}
    rejected: dict[int, str] = {}
    alternatives: dict[int, tuple[int, ...]] = {}
    kept, factor, loops = list(range(len(links))), 1.0, tuple[Loop, ...]()
    while True:
        fresh = {key: way for way in short_loops(links, kept) if (key := frozenset(way.links)) not in tested}
        tested |= {key: (way, _closing(links, way, FLOOR_NOISES)) for key, way in fresh.items()}
        if not loops:  # later rounds hold few loops, and what was removed has spoilt some of the first ones
            factor = _variance_factor(np.array([closing.statistic for _, closing in tested.values()]))
        loops = tuple(_tested(way, closing, factor, critical) for way, closing in tested.values())
        open_loops = [loop for loop in loops if not rejected.keys() & set(loop.links)]
        failing = [loop.links for loop in open_loops if not loop.passed]
        if not failing:
            return LoopVerdict(loops, factor, critical, rejected, alternatives, bridges(links, kept))
        blamed = wrong_links(failing, [loop.links for loop in open_loops if loop.passed])
        rejected |= {number: _reason(number, blame, links, loops, names) for number, blame in blamed.items()}
        alternatives |= {number: blame.alternatives for number, blame in blamed.items() if blame.alternatives}
        kept = [number for number in kept if number not in rejected]


def _tested(way: "Way", closing: "_Closing", factor: float, critical: float) -> Loop:
    statistic = closing.statistic / factor
    return Loop(way.links, way.stations, closing.turn_rad, closing.shift_m, statistic, statistic <= critical)


def bridges(links: Sequence[StationLink], kept: Sequence[int]) -> tuple[int, ...]:
    """Give those of the kept registrations without which the network would fall apart: no loop holds them."""
    import networkx as nx

    graph: nx.Graph[int] = nx.Graph()
    parallel: dict[tuple[int, int], list[int]] = {}
    for number in kept:
        ends = (min(links[number].stations), max(links[number].stations))
        parallel.setdefault(ends, []).append(number)
        graph.add_edge(*ends)
    edges = cast("list[tuple[int, int]]", list(nx.bridges(graph)))
    found = [parallel[min(edge), max(edge)] for edge in edges]
    return tuple(sorted(numbers[0] for numbers in found if len(numbers) == 1))


def agreeing_links(
    links: Sequence[StationLink], stations: Sequence[int], graph: Solution, variance_factor: float
) -> tuple[int, ...]:
    """Find those of further registrations that agree with the poses that others give (MATH 6.5).

    A registration that is doubtful by itself and yet finds the pose that others lead to is confirmed by them, and they
    by it: so it closes a loop.

    Parameters
    ----------
    links
        Registrations that took no part in the pose graph.
    stations
        Stations of the pose graph, in the order of its unknowns.
    graph
        The adjusted pose graph.
    variance_factor
        That of the loops.

    Returns
    -------
    Numbers of the links between these stations that pass the test of loops.
    """
    place = {station: k for k, station in enumerate(stations)}
    critical = float(stats.chi2.isf(ALPHA, CLOSURE_DEGREES))
    found = []
    for number, link in enumerate(links):
        if link.target not in place or link.source not in place:
            continue
        pose = link.with_floor(FLOOR_NOISES).target_from_source
        ends = np.array([place[link.target], place[link.source]], dtype=np.int64)
        observed = RigidTransform.concatenate([pose.target_from_source])
        equations = RelativePoses(ends[:1], ends[1:], observed, pose.covariance[None]).equations(graph.unknowns)
        covariance = equations.noise_jacobians[0][0] @ pose.covariance @ equations.noise_jacobians[0][0].T
        columns = graph.unknowns.first_columns(UnknownKind.POSE, ends)
        free = [(int(c), d.jacobians[0]) for c, d in zip(columns, equations.derivatives, strict=True) if c >= 0]
        jacobian = np.hstack([by_pose for _, by_pose in free])
        rows = np.concatenate([np.arange(first, first + 6) for first, _ in free])
        covariance = covariance + jacobian @ graph.inverse.blocks(rows[None])[0] @ jacobian.T
        residual = equations.residuals[0]
        if float(residual @ np.linalg.solve(covariance, residual)) / variance_factor <= critical:
            found.append(number)
    return tuple(found)


def loop_covariance_factor(links: Sequence[StationLink]) -> float:
    """Say by how much the covariances of registrations are too small, as their closing errors show (MATH 6.5).

    The mean T of the loops, without allowance for uneven walls, over its expectation. The noise that scans share
    cancels in loops, so they rather close too well; where they close worse than the covariances say, the scans have
    errors that no residual of a pair shows.

    Parameters
    ----------
    links
        Registrations that are used: they have passed the test of loops.

    Returns
    -------
    The factor; 1 where the mean is not above 1 by two of its own standard deviations, those of as many loops as are
    independent of each other.
    """
    statistics = [_closing(links, way, 0.0).statistic for way in short_loops(links)]
    if not statistics:
        return 1.0
    stations = {station for link in links for station in link.stations}
    independent = max(len(links) - len(stations) + 1, 1)
    factor = float(np.mean(statistics)) / CLOSURE_DEGREES
    return factor if factor > 1.0 + 2.0 * np.sqrt(2.0 / (CLOSURE_DEGREES * independent)) else 1.0


@dataclass(frozen=True)
class Way:
    """A closed way, not yet tested."""

    links: tuple[int, ...]
    stations: tuple[int, ...]


def short_loops(links: Sequence[StationLink], kept: Sequence[int] | None = None) -> list[Way]:
    """Give all triangles, and for each registration in none the shortest loop through it; none twice.

    Parameters
    ----------
    links
        Registrations.
    kept
        Numbers of those that count; None: all.
    """
    import networkx as nx

    graph: nx.Graph[int] = nx.Graph()
    ways: dict[frozenset[int], Way] = {}
    for number in range(len(links)) if kept is None else kept:
        link = links[number]
        if graph.has_edge(*link.stations):  # a second registration of the same two stations
            first = int(graph.edges[link.stations]["number"])
            ways[frozenset((first, number))] = Way((first, number), link.stations)
        else:
            graph.add_edge(*link.stations, number=number)
    edges = [(int(u), int(v), int(graph.edges[u, v]["number"])) for u, v in graph.edges]
    for u, v, _ in edges:
        for w in sorted(set(graph[u]) & set(graph[v])):
            _add(ways, graph, sorted((u, v, w)))
    in_triangle = {number for way in ways.values() for number in way.links if len(way.links) > 2}
    for u, v, number in edges:
        if number in in_triangle:
            continue
        graph.remove_edge(u, v)
        around = nx.shortest_path(graph, v, u) if nx.has_path(graph, v, u) else []
        graph.add_edge(u, v, number=number)
        if around:
            _add(ways, graph, around)
    return list(ways.values())


def _add(ways: dict[frozenset[int], Way], graph: "nx.Graph[int]", stations: Sequence[int]) -> None:
    """Add a closed way unless it is known."""
    around = [*stations[1:], stations[0]]
    numbers = tuple(int(graph.edges[u, v]["number"]) for u, v in zip(stations, around, strict=True))
    ways.setdefault(frozenset(numbers), Way(numbers, tuple(stations)))


@dataclass(frozen=True)
class _Closing:
    turn_rad: float
    shift_m: float
    statistic: float


def _closing(links: Sequence[StationLink], way: Way, floor_noises: float) -> _Closing:
    """Go round and compare with the identity; the shift is that of the first link's features."""
    round_trip = PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))
    for station, number in zip(way.stations, way.links, strict=True):
        round_trip = round_trip.after(links[number].with_floor(floor_noises).from_station(station))
    first = links[way.links[0]]
    place = first.centroid_m if first.target == way.stations[0] else first.from_station(
        way.stations[0]
    ).target_from_source.apply(first.centroid_m)  # fmt: skip
    turn = round_trip.rotation.as_rotvec()
    shift = round_trip.target_from_source.apply(place) - place
    centred = round_trip.moved_to_origins(-place, -place)  # the same motion about the features: well conditioned
    error = np.concatenate([turn, shift])
    statistic = float(error @ np.linalg.solve(centred.covariance, error))
    return _Closing(float(np.linalg.norm(turn)), float(np.linalg.norm(shift)), statistic)


def _variance_factor(statistics: np.ndarray) -> float:
    """Say by how much covariances are too small: the median T over its expectation, within 1 and the limit."""
    if len(statistics) == 0:
        return 1.0
    median = float(np.median(statistics)) / float(stats.chi2.median(CLOSURE_DEGREES))
    return float(np.clip(median, 1.0, MOST_VARIANCE_FACTOR))


def _reason(
    number: int, blame: Blame, links: Sequence[StationLink], loops: Sequence[Loop], names: Sequence[str]
) -> str:
    failing = [loop for loop in loops if number in loop.links and not loop.passed]
    worst = max(failing, key=lambda loop: loop.statistic) if failing else None
    told = ""
    if worst is not None:
        way = " – ".join(names[station] for station in (*worst.stations, worst.stations[0]))
        told = (
            f"the loop {way} does not close by {np.degrees(worst.turn_rad) / 0.9:.2f} gon and "
            f"{worst.shift_m:.3f} m ({len(failing)} such loop{'s' if len(failing) > 1 else ''})"
        )
    if blame.alternatives:
        others = ", ".join(f"{names[links[k].target]} – {names[links[k].source]}" for k in sorted(blame.alternatives))
        return f"{told}; whether this registration is wrong or {others}, no other loop tells"
    return told
