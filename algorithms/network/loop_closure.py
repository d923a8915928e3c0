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
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.observations.relative_poses import RelativePoses
from algorithms.adjustment.solver import Solution
from algorithms.adjustment.unknowns import UnknownKind
from algorithms.arrays import Array
from algorithms.geometry.rotations import cross_matrices
from algorithms.network.links import StationLink
from algorithms.network.wrong_links import Blame, wrong_links
from algorithms.probabilities import chi2_isf, chi2_ppf

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
    critical = float(chi2_isf(ALPHA, CLOSURE_DEGREES))
    tested: dict[frozenset[int], tuple[Way, _Closing]] = {}
    rejected: dict[int, str] = {}
    alternatives: dict[int, tuple[int, ...]] = {}
    kept, factor, loops = list(range(len(links))), 1.0, tuple[Loop, ...]()
    closings = _Closings(links, FLOOR_NOISES)
    while True:
        fresh = {key: way for way in short_loops(links, kept) if (key := frozenset(way.links)) not in tested}
        tested |= dict(zip(fresh, zip(fresh.values(), closings.of([*fresh.values()]), strict=True), strict=True))
        if not loops:  # later rounds hold few loops, and what was removed has spoilt some of the first ones
            factor = _variance_factor(np.array([closing.statistic for _, closing in tested.values()]))
        loops = tuple(_tested(way, closing, factor, critical) for way, closing in tested.values())
        open_loops = [loop for loop in loops if not rejected.keys() & set(loop.links)]
        failing = [loop.links for loop in open_loops if not loop.passed]
        if not failing:
            return LoopVerdict(loops, factor, critical, rejected, alternatives, bridges(links, kept))
        blamed = wrong_links(failing, [loop.links for loop in open_loops if loop.passed])
        failed: dict[int, list[Loop]] = {}
        for loop in loops:
            if not loop.passed:
                for number in loop.links:
                    failed.setdefault(number, []).append(loop)
        rejected |= {number: _reason(failed.get(number, ()), blame, links, names) for number, blame in blamed.items()}
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
    critical = float(chi2_isf(ALPHA, CLOSURE_DEGREES))
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
    statistics = [closing.statistic for closing in _Closings(links, 0.0).of(short_loops(links))]
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
    settled = {number for way in ways.values() for number in way.links if len(way.links) > 2}
    # in no loop, however long
    settled |= {int(graph.edges[cast("tuple[int, int]", edge)]["number"]) for edge in nx.bridges(graph)}
    for u, v, number in edges:
        if number in settled:
            continue
        graph.remove_edge(u, v)
        around = nx.shortest_path(graph, v, u)
        graph.add_edge(u, v, number=number)
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


class _Closings:
    """Goes round loops, many at once, and compares with the identity.

    Parameters
    ----------
    links
        Registrations.
    floor_noises
        Error that each of them is allowed besides its covariance (`StationLink.with_floor`).
    """

    def __init__(self, links: Sequence[StationLink], floor_noises: float) -> None:
        self._targets = np.array([link.target for link in links], dtype=np.int64)
        matrices = np.array([link.target_from_source.target_from_source.as_matrix() for link in links])
        covariances = np.array([link.with_floor(floor_noises).target_from_source.covariance for link in links])
        centroids = np.array([link.centroid_m for link in links]).reshape(-1, 3)
        # of no links too
        matrices, covariances = matrices.reshape(-1, 4, 4), covariances.reshape(-1, 6, 6)
        rotations, translations = matrices[:, :3, :3], matrices[:, :3, 3]
        back = np.swapaxes(rotations, 1, 2)
        by_pose = np.zeros((len(links), 6, 6))  # as `inversion_jacobian`
        by_pose[:, :3, :3] = by_pose[:, 3:, 3:] = -back
        by_pose[:, 3:, :3] = -back @ cross_matrices(translations)
        # target from source, and source from target
        self._rotations = np.stack([rotations, back])
        self._translations = np.stack([translations, -_turned(back, translations)])
        self._covariances = np.stack([covariances, by_pose @ covariances @ np.swapaxes(by_pose, 1, 2)])
        self._centroids = np.stack([centroids, _turned(back, centroids - translations)])

    def of(self, ways: "Sequence[Way]") -> list[_Closing]:
        """Give the closing errors; the shift is that of the first registration's features."""
        found: dict[int, _Closing] = {}
        lengths = np.array([len(way.links) for way in ways], dtype=np.int64)
        for length in np.unique(lengths).tolist():
            which = np.flatnonzero(lengths == length).tolist()
            found.update(zip(which, self._of_equal([ways[k] for k in which]), strict=True))
        return [found[k] for k in range(len(ways))]

    def _of_equal(self, ways: "Sequence[Way]") -> list[_Closing]:
        """Chain the registrations of loops of one length, as `PoseEstimate.after` does."""
        links = np.array([way.links for way in ways], dtype=np.int64)
        stations = np.array([way.stations for way in ways], dtype=np.int64)
        backwards = (self._targets[links] != stations).astype(np.int64)
        n = len(ways)
        rotation, translation, covariance = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), np.zeros((n, 6, 6))
        for way, number in zip(backwards.T, links.T, strict=True):
            arm = _turned(rotation, self._translations[way, number])
            by_first, by_next = np.tile(np.eye(6), (n, 1, 1)), np.zeros((n, 6, 6))
            by_first[:, 3:, :3] = -cross_matrices(arm)
            by_next[:, :3, :3] = by_next[:, 3:, 3:] = rotation
            covariance = by_first @ covariance @ np.swapaxes(by_first, 1, 2)
            covariance += by_next @ self._covariances[way, number] @ np.swapaxes(by_next, 1, 2)
            rotation, translation = rotation @ self._rotations[way, number], translation + arm
        place = self._centroids[backwards[:, 0], links[:, 0]]
        moved = _turned(rotation, place)
        turn, shift = Rotation.from_matrix(rotation).as_rotvec(), moved + translation - place
        about = np.tile(np.eye(6), (n, 1, 1))  # the same motion about the features: well conditioned
        about[:, 3:, :3] = -cross_matrices(moved)
        centred = about @ covariance @ np.swapaxes(about, 1, 2)
        error = np.hstack([turn, shift])
        statistics = np.einsum("ni,ni->n", error, np.linalg.solve(centred, error[:, :, None])[:, :, 0])
        turns, shifts = np.linalg.norm(turn, axis=1), np.linalg.norm(shift, axis=1)
        return [_Closing(*row) for row in np.column_stack([turns, shifts, statistics]).tolist()]


def _turned(rotations: Array, vectors: Array) -> Array:
    return np.asarray(np.einsum("nij,nj->ni", rotations, vectors))


def _variance_factor(statistics: np.ndarray) -> float:
    """Say by how much covariances are too small: the median T over its expectation, within 1 and the limit."""
    if len(statistics) == 0:
        return 1.0
    median = float(np.median(statistics)) / float(chi2_ppf(0.5, CLOSURE_DEGREES))
    return float(np.clip(median, 1.0, MOST_VARIANCE_FACTOR))


def _reason(failing: Sequence[Loop], blame: Blame, links: Sequence[StationLink], names: Sequence[str]) -> str:
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
