"""Choose the pairs of many stations that are tried next."""

from collections.abc import Sequence

import numpy as np

from algorithms.geometry.poses import PoseEstimate
from algorithms.network.candidate_pairs import Tried, first_pairs, next_pairs
from algorithms.network.links import StationLink
from algorithms.network.loop_closure import examine_loops
from algorithms.network.pose_graph import chained_parts
from algorithms.network.similarity import appearance, likeness
from algorithms.network.whereabouts import whereabouts_of
from service.names.pair_statuses import IN_PLACE
from service.ports import Json, StepContext
from service.use_cases.steps.feature_store import load_members
from service.use_cases.steps.run_network import stored_links
from service.use_cases.steps.station_priors import approximate_pose

MOST_POINTS = 2000
"""Points of a scan that tell where its surfaces are, roughly."""


def choose_pairs(context: StepContext, arguments: Json) -> Json:
    """Give the names of the pairs of the next round; none when the network is as good as it gets."""
    names: list[str] = arguments["names"]
    profiles, surfaces = [], []
    poses: dict[int, PoseEstimate] = {}
    for number, key in enumerate(arguments["features"]):
        planes, points, origin_m = load_members(context.blobs.local_path(key), "planes", "surface.points", "origin_m")
        profiles.append(appearance(planes))
        surfaces.append(np.ascontiguousarray(points[:: max(len(points) // MOST_POINTS, 1)]))
        approximate = arguments.get("known", {}).get(names[number], {}).get("approximate_pose")
        if approximate is not None:
            poses[number] = approximate_pose(approximate, origin_m)
        context.progress.report((number + 1) / len(names), "comparing scans")
    alike = likeness(profiles)
    whereabouts = whereabouts_of(surfaces, poses)
    if arguments["pairs"]:
        links = [link for link in stored_links(context, arguments["pairs"], names, IN_PLACE) if not link.of_targets]
        place = {name: number for number, name in enumerate(names)}
        tried = [(place[pair["target"]], place[pair["source"]]) for pair in arguments["pairs"]]
        chosen = next_pairs(alike, surfaces, _known(links, names, tried), whereabouts)
    else:
        chosen = first_pairs(alike, whereabouts)
    return {"pairs": [[names[target], names[source]] for target, source in chosen]}


def _known(links: Sequence[StationLink], names: Sequence[str], tried: Sequence[tuple[int, int]]) -> Tried:
    """Chain what is consistent, part by part of the network."""
    verdict = examine_loops(links, names)
    used = [link for number, link in enumerate(links) if number not in verdict.rejected]
    parts, poses = chained_parts(used, len(names))
    return Tried(tried, [link.stations for link in used], poses, parts)
