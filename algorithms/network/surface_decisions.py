"""Let surfaces decide where loops cannot: between registrations of which one is wrong, and on those in no loop."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

from scipy.spatial.transform import RigidTransform

from algorithms.network.links import StationLink
from algorithms.network.loop_closure import LoopVerdict, bridges
from algorithms.network.pose_graph import tree_poses
from algorithms.network.surface_control import SurfaceControl, SurfaceEvidence
from algorithms.network.wrong_links import Blame, wrong_links

MOST_STEPS = 3
"""Stations so many registrations away from a registration still tell whether it is right."""


def decided_by_surfaces(
    links: Sequence[StationLink], verdict: LoopVerdict, names: Sequence[str], control: SurfaceControl
) -> LoopVerdict:
    """Settle what the loops left open (MATH 6.5).

    Of registrations that loops blame alternatively, one is taken back into use where nothing stands in free space with
    it while something does with each of the others. Registrations in no loop are rejected where stations on their two
    sides stand in each other's free space; of several on the way between such stations all that may be the wrong one.

    Parameters
    ----------
    links
        Registrations.
    verdict
        Of the loops.
    names
        Of the stations, for the reasons.
    control
        Tests parts of the network against each other.
    """
    rejected, alternatives = dict(verdict.rejected), dict(verdict.alternatives)
    for group in sorted({tuple(sorted((number, *others))) for number, others in verdict.alternatives.items()}):
        kept = [number for number in range(len(links)) if number not in rejected]
        found = {number: _worst(_across(links, kept, number, control)) for number in group}
        right = [number for number, evidence in found.items() if evidence is not None and evidence.is_harmless]
        wrong = {k: _reason(evidence, names) for k, evidence in found.items() if evidence and evidence.contradicts}
        if len(right) == 1 and len(wrong) == len(group) - 1:
            rejected.pop(right[0])
            rejected |= wrong
            for number in group:
                alternatives.pop(number, None)
    kept = [number for number in range(len(links)) if number not in rejected]
    blamed = _wrong_bridges(links, kept, control)
    for number, (blame, evidence) in blamed.items():
        others = " – ".join(names[station] for k in blame.alternatives for station in links[k].stations)
        rejected[number] = _reason(evidence, names) + (f"; the wrong one may also be {others}" if others else "")
        if blame.alternatives:
            alternatives[number] = blame.alternatives
    kept = [number for number in kept if number not in blamed]
    return replace(verdict, rejected=rejected, alternatives=alternatives, uncontrolled=bridges(links, kept))


def _wrong_bridges(
    links: Sequence[StationLink], kept: Sequence[int], control: SurfaceControl
) -> dict[int, tuple[Blame, SurfaceEvidence]]:
    """Test what no loop holds by stations on both sides.

    Two stations that were tested act like a registration between them: with the registrations of the way from one to
    the other they make a loop, which passes or fails.
    """
    open_links = bridges(links, kept)
    tested: dict[tuple[int, int], SurfaceEvidence] = {}
    for number in open_links:
        others = [other for other in kept if other != number]
        own = set(links[number].stations)  # fit already, or they would not be registered
        found = _across(links, others, number, control)
        tested |= {evidence.stations: evidence for evidence in found if set(evidence.stations) != own}
    ways = {pair: _open_way(links, kept, open_links, pair) for pair in tested}
    failing = {pair: ways[pair] for pair, evidence in tested.items() if evidence.contradicts}
    passing = [ways[pair] for pair, evidence in tested.items() if evidence.confirms]
    blamed = wrong_links(list(failing.values()), passing)
    return {
        number: (blame, min((tested[pair] for pair, way in failing.items() if number in way), key=_score))
        for number, blame in blamed.items()
    }


def _open_way(
    links: Sequence[StationLink], kept: Sequence[int], open_links: Collection[int], pair: tuple[int, int]
) -> tuple[int, ...]:
    """Give those registrations on the way between two stations that no loop holds."""
    import networkx as nx

    graph: nx.Graph[int] = nx.Graph()
    for number in kept:
        graph.add_edge(*links[number].stations, number=number)
    way = nx.shortest_path(graph, *pair)
    numbers = (int(graph.edges[u, v]["number"]) for u, v in pairwise(way))
    return tuple(number for number in numbers if number in open_links)


def _score(evidence: SurfaceEvidence) -> float:
    return evidence.score


def _worst(found: Sequence[SurfaceEvidence]) -> SurfaceEvidence | None:
    return min(found, key=_score, default=None)


def _across(
    links: Sequence[StationLink], kept: Sequence[int], number: int, control: SurfaceControl
) -> list[SurfaceEvidence]:
    """Test the stations on both sides of a registration; nothing where others connect its sides too.

    Parameters
    ----------
    links
        All registrations.
    kept
        Numbers of those that count, without the tested one.
    number
        The tested one.
    control
        Tests the stations.
    """
    link = links[number]
    ones, others = (_near(links, kept, station) for station in link.stations)
    if ones.keys() & others.keys():
        return []
    inside = ones.keys() | others.keys()
    within = [links[k] for k in kept if links[k].target in inside and links[k].source in inside]
    poses: Mapping[int, RigidTransform] = tree_poses([*within, link], link.target)
    return control.between(poses, _known(ones, poses), _known(others, poses))


def _near(links: Sequence[StationLink], kept: Sequence[int], start: int) -> dict[int, int]:
    """Give the stations up to some registrations away, with their distance."""
    steps, fresh = {start: 0}, [start]
    for step in range(1, MOST_STEPS + 1):
        reached = set()
        for number in kept:
            ends = links[number].stations
            for here, there in (ends, ends[::-1]):
                if here in fresh and there not in steps:
                    reached.add(there)
        steps.update(dict.fromkeys(sorted(reached), step))
        fresh = sorted(reached)
    return steps


def _known(stations: Collection[int], poses: Mapping[int, RigidTransform]) -> list[int]:
    return sorted(station for station in stations if station in poses)


def _reason(evidence: SurfaceEvidence, names: Sequence[str]) -> str:
    one, other = (names[station] for station in evidence.stations)
    return (
        f"with this registration {evidence.violation_share:.1%} of the surfaces of {one} and {other} would stand where "
        "the other one looked through"
    )
