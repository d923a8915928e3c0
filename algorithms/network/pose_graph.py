"""Start values for many stations: a tree of registrations, then all of them together (MATH 1.4, 6.5)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations.relative_poses import RelativePoses
from algorithms.adjustment.problem import Problem
from algorithms.adjustment.solver import Solution, solve
from algorithms.adjustment.unknowns import Unknowns
from algorithms.network.links import StationLink

if TYPE_CHECKING:
    import networkx as nx

MAX_ITERATIONS = 30


def connected_stations(links: Sequence[StationLink], base: int) -> list[int]:
    """Give the stations that registrations connect to a base, in ascending order, the base among them."""
    known, fresh = {base}, [base]
    neighbours: dict[int, set[int]] = {}
    for link in links:
        neighbours.setdefault(link.target, set()).add(link.source)
        neighbours.setdefault(link.source, set()).add(link.target)
    while fresh:
        more = neighbours.get(fresh.pop(), set()) - known
        known |= more
        fresh += more
    return sorted(known)


def tree_poses(links: Sequence[StationLink], base: int) -> dict[int, RigidTransform]:
    """Chain registrations along the tree with the smallest sum of position variances.

    Parameters
    ----------
    links
        Registrations.
    base
        Station whose frame is used.

    Returns
    -------
    Base from station of every connected station.
    """
    import networkx as nx

    tree = _spanning_tree(links)
    tree.add_node(base)
    poses = {base: RigidTransform.identity()}
    for parent, child in nx.bfs_edges(tree, base):
        poses[child] = links[tree.edges[parent, child]["number"]].seen_from(parent, poses[parent])
    return poses


def chained_parts(links: Sequence[StationLink], count: int) -> tuple[list[list[int]], dict[int, RigidTransform]]:
    """Chain registrations in every part of a network.

    Parameters
    ----------
    links
        Registrations.
    count
        Number of stations.

    Returns
    -------
    parts
        Stations that registrations connect, each part in ascending order; single stations too.
    poses
        First station of the part from station, of all stations.
    """
    import networkx as nx

    tree = _spanning_tree(links)
    tree.add_nodes_from(range(count))
    parts: list[list[int]] = []
    poses: dict[int, RigidTransform] = {}
    for base in range(count):
        if base in poses:
            continue
        part = [base]
        poses[base] = RigidTransform.identity()
        for parent, child in nx.bfs_edges(tree, base):
            poses[child] = links[tree.edges[parent, child]["number"]].seen_from(parent, poses[parent])
            part.append(child)
        parts.append(sorted(part))
    return parts, poses


def _spanning_tree(links: Sequence[StationLink]) -> "nx.Graph[int]":
    """Give the tree, or one of each part, with the smallest sum of position variances; edges have the link's number."""
    import networkx as nx  # half a second that only networks need

    graph: nx.Graph[int] = nx.Graph()
    for number, link in enumerate(links):
        known = graph.get_edge_data(*link.stations)
        weakness = link.weakness_m2
        if known is None or weakness < known["weight"]:
            graph.add_edge(*link.stations, weight=weakness, number=number)
    return nx.minimum_spanning_tree(graph)


def adjust_pose_graph(links: Sequence[StationLink], stations: Sequence[int]) -> Solution:
    """Adjust the poses of connected stations to all registrations between them (MATH 3.1, 6.5).

    The registrations count as independent, which overlapping ones are not: good start values, and covariances that are
    good where no two registrations share features.

    Parameters
    ----------
    links
        Registrations between these stations.
    stations
        Numbers of the stations; the first one is fixed and defines the frame. Their places in this list are the numbers
        of the poses in the solution.
    """
    start = tree_poses(links, stations[0])
    unknowns = unknowns_of([start[station] for station in stations])
    problem = Problem((observed_links(links, stations),))
    return solve(problem, unknowns, np.zeros((unknowns.count, 0)), MAX_ITERATIONS)


def observed_links(links: Sequence[StationLink], stations: Sequence[int]) -> RelativePoses:
    """Take registrations for observations of the poses of stations, numbered by their places in a list."""
    place = {station: k for k, station in enumerate(stations)}
    return RelativePoses(
        np.array([place[link.target] for link in links], dtype=np.int64),
        np.array([place[link.source] for link in links], dtype=np.int64),
        RigidTransform.concatenate([link.target_from_source.target_from_source for link in links]),
        np.array([link.target_from_source.covariance for link in links]),
    )


def unknowns_of(poses: Sequence[RigidTransform], mounts: int = 0) -> Unknowns:
    """Give the unknowns of stations of which the first is fixed, followed by mounts of photos at the identity."""
    poses = [*poses, *[RigidTransform.identity()] * mounts]
    fixed = np.zeros(len(poses), dtype=bool)
    fixed[0] = True
    return Unknowns(RigidTransform.concatenate(list(poses)), np.empty((0, 3)), fixed, np.zeros(0, dtype=bool))
