"""Chain pairwise poses into one frame along the best connected tree of stations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.geometry.poses import PoseEstimate


@dataclass(frozen=True, eq=False)
class StationLink:
    """An accepted registration of two stations."""

    target: str
    source: str
    target_from_source: PoseEstimate
    """Pose between the full coordinates of both scans."""

    @property
    def weakness(self) -> float:
        """Rate the link for choosing a tree: the trace of the translation covariance [m2]; small is good."""
        return float(np.trace(self.target_from_source.covariance[3:, 3:]))


def chain_poses(stations: Sequence[str], links: Sequence[StationLink]) -> Mapping[str, PoseEstimate]:
    """Give the pose of every station that links connect to the first one, in the first one's frame.

    The tree with the smallest sum of translation variances is used; covariances are propagated along it, the links
    being independent of each other only as far as they share no scan (a joint adjustment would know better).

    Parameters
    ----------
    stations
        Names; the first is fixed.
    links
        Accepted pairs.

    Returns
    -------
    Poses first-station from station by name; stations without connection are absent.
    """
    import networkx as nx  # half a second that only a report needs

    graph: nx.Graph[str] = nx.Graph()
    graph.add_nodes_from(stations)
    for number, link in enumerate(links):
        known = graph.get_edge_data(link.target, link.source)
        if known is None or link.weakness < known["weight"]:
            graph.add_edge(link.target, link.source, weight=link.weakness, number=number)
    tree = nx.minimum_spanning_tree(graph)
    poses = {stations[0]: PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))}
    for parent, child in nx.bfs_edges(tree, stations[0]):
        link = links[tree.edges[parent, child]["number"]]
        parent_from_child = link.target_from_source if link.target == parent else link.target_from_source.inverse()
        poses[child] = poses[parent].after(parent_from_child)
    return poses
