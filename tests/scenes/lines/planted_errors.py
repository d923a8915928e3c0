"""Scenes with one planted error: a wrong correspondence, a plane that moved between the scans, a shifted line."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np

from algorithms.adjustment.line_adjustment import LineAdjustment
from algorithms.adjustment.options import AdjustmentOptions
from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.geometry.lines import bases_of
from tests.scenes.buildings.plane_rooms import PlaneRooms, observed_rooms, plane_rooms
from tests.scenes.lines.line_scenes import (
    LineScene,
    ObservedPair,
    bridge_lines,
    facade_lines,
    generic_lines,
    observed_pair,
    room_lines,
)

NOISES_M = (0.002, 0.006)
"""Smallest and largest noise of points."""
NEIGHBOURS_M = (0.2, 1.0)
"""How far a parallel neighbour lies away that a line is taken for."""
TILTS_RAD = (0.02, 0.035)
"""How far another direction differs that still passes the gates of matching."""
GATE_M = 0.1
"""How far a line of another direction lies away at most."""
DOOR_SHIFT_M = 0.05
LINE_SHIFT_M = 0.020
DETECTABLE_SHARE = 1.0 / 1.5
"""A line is shifted only where its smallest detectable errors (found with 80 %) are below this share of the shift:
the shift of a short or noisy line nobody could find."""
MOST_LEVERAGE = 0.9
"""Of one plane on the pose that controls it; see `separable_planes`."""
LINE_COUNTS = (8, 60)


@dataclass(frozen=True, eq=False)
class Planted:
    """An observed pair with one error in it."""

    pair: ObservedPair
    wrong: np.ndarray
    """(b,) True for the correspondences that the error made wrong: lines first, then planes."""


@dataclass(frozen=True)
class Outcome:
    """What the adjustment made of a planted error."""

    found: bool
    """Every wrong correspondence was removed, and named in the removals."""
    false_removals: int
    """Good correspondences that are not used in the end."""
    good: int
    """Good correspondences."""


def outcome_of(planted: Planted, result: LineAdjustment) -> Outcome:
    """Compare what was removed with what was wrong."""
    states = np.concatenate([result.lines.states, result.planes.states])
    removed = states == CorrespondenceState.REMOVED
    pair = planted.pair
    numbers = pair.correspondences if pair.planes is None else np.vstack([pair.correspondences, pair.planes.pairs])
    kinds = ["line"] * len(pair.correspondences) + ["plane"] * (len(numbers) - len(pair.correspondences))
    named = {(r.kind, r.target_number, r.source_number) for r in result.removals}
    wrong = {(kinds[k], int(numbers[k, 0]), int(numbers[k, 1])) for k in np.flatnonzero(planted.wrong)}
    return Outcome(
        found=bool(removed[planted.wrong].all()) and wrong <= named,
        false_removals=int((removed & ~planted.wrong).sum()),
        good=int((~planted.wrong).sum()),
    )


def adjusted(planted: Planted) -> LineAdjustment:
    """Adjust as the service does."""
    return planted.pair.adjusted(AdjustmentOptions())


def _line_scene(rng: np.random.Generator) -> LineScene:
    """Draw one of the kinds of scenes with 8 to 60 lines."""
    count = int(rng.integers(*LINE_COUNTS, endpoint=True))
    makers: tuple[Callable[[np.random.Generator], LineScene], ...] = (
        partial(generic_lines, count=count),
        partial(facade_lines, count=count),
        partial(room_lines, rooms=int(rng.integers(1, 5, endpoint=True))),
        bridge_lines,
    )
    return makers[int(rng.integers(len(makers)))](rng)


def _rooms(rng: np.random.Generator) -> PlaneRooms:
    """Draw rooms of planes with 8 to 60 lines."""
    rooms, bodies = int(rng.integers(1, 2, endpoint=True)), int(rng.integers(0, 3, endpoint=True))
    most = min(12 * (rooms + bodies), LINE_COUNTS[1])
    return plane_rooms(rng, lines=int(rng.integers(LINE_COUNTS[0], most, endpoint=True)), rooms=rooms, bodies=bodies)


def _pipes(rng: np.random.Generator) -> LineScene:
    return generic_lines(rng, int(rng.integers(0, 3, endpoint=True)))


def _across(direction: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw a unit vector perpendicular to a direction."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return np.asarray(bases_of(direction[None])[0] @ np.array([np.cos(angle), np.sin(angle)]))


def _flags(count: int, which: int) -> np.ndarray:
    """Give (count,) False, and True for one; -1 for none."""
    return np.arange(count) == which


def wrong_correspondence_of_lines(rng: np.random.Generator) -> Planted:
    """Take one of some free lines for a parallel neighbour, or for a line of a slightly other direction."""
    scene = _line_scene(rng)
    k = int(rng.integers(len(scene)))
    side, axis = (_across(scene.directions[k], rng) for _ in range(2))
    if rng.random() < 0.5:
        other = scene.moved(k, rng.uniform(*NEIGHBOURS_M) * side)
    else:
        other = scene.moved(k, rng.uniform(0.0, GATE_M) * side, rng.uniform(*TILTS_RAD) * axis)
    pair = observed_pair(scene, rng, noise_m=rng.uniform(*NOISES_M), source_scene=other)
    return Planted(pair, _flags(len(scene), k))


def shifted_line(rng: np.random.Generator) -> Planted:
    """Shift one of some free lines by 20 mm, one whose shift can be found."""
    while True:
        scene, noise = _line_scene(rng), rng.uniform(*NOISES_M)
        clean = observed_pair(scene, rng, noise_m=noise)
        detectable = clean.adjusted().lines.detectable[:, 2:].max(axis=1)
        possible = np.flatnonzero(detectable < DETECTABLE_SHARE * LINE_SHIFT_M)
        if len(possible):
            break
    k = int(rng.choice(possible))
    line = int(clean.correspondences[k, 1])
    direction = clean.source.directions[line]
    anchors = clean.source.anchors.copy()
    anchors[line] += LINE_SHIFT_M * _across(direction, rng)
    return Planted(replace(clean, source=replace(clean.source, anchors=anchors)), _flags(len(scene), k))


def wrong_correspondence_of_edges(rng: np.random.Generator) -> Planted:
    """Take one edge of rooms for the edge of a parallel plane (a niche), or of a slightly turned one."""
    rooms, pipes = _rooms(rng), _pipes(rng)
    k, end = int(rng.integers(len(rooms.edges))), int(rng.integers(2))
    sense = rng.choice([-1.0, 1.0])
    if rng.random() < 0.5:
        other = rooms.with_edge_elsewhere(k, end, sense * rng.uniform(*NEIGHBOURS_M))
    else:
        other = rooms.with_edge_elsewhere(k, end, sense * rng.uniform(0.0, GATE_M), rng.uniform(*TILTS_RAD))
    return _edges_of(rooms, other, pipes, _flags(len(rooms.edges), k), _flags(len(rooms.normals), -1), rng)


def shifted_edge(rng: np.random.Generator) -> Planted:
    """Let one edge of rooms lie on a plane 20 mm before the true one (a skirting board)."""
    rooms, pipes = _rooms(rng), _pipes(rng)
    k, end = int(rng.integers(len(rooms.edges))), int(rng.integers(2))
    other = rooms.with_edge_elsewhere(k, end, LINE_SHIFT_M)
    return _edges_of(rooms, other, pipes, _flags(len(rooms.edges), k), _flags(len(rooms.normals), -1), rng)


def separable_planes(rooms: PlaneRooms) -> np.ndarray:
    """Find the planes whose motion along the normal cannot be taken for that of another plane.

    In a bare room nobody can say which of two opposite walls has moved: without the one, nothing controls the other.
    So without the plane, every other must still be controlled by the rest: less than `MOST_LEVERAGE` of its offset
    is explained by the pose that follows from all.
    """
    planes = np.unique(np.concatenate([rooms.edges.ravel(), np.flatnonzero(rooms.matched)]))
    normals, centred = rooms.normals[planes], rooms.middles[planes] - rooms.middles[planes].mean(axis=0)
    axes, sizes = rooms.axes[planes], rooms.sizes[planes]
    offsets = np.hstack([np.cross(centred, normals), normals])
    tilts = np.zeros((len(planes), 2, 6))
    tilts[:, :, :3] = np.swapaxes(np.cross(normals[:, :, None], axes, axis=1), 1, 2)
    tilts *= sizes[:, :, None] / np.sqrt(12.0)  # a plane's tilt is known sqrt(12) / size times worse than its offset
    information = np.einsum("ni,nj->nij", offsets, offsets) + np.einsum("nki,nkj->nij", tilts, tilts)
    information *= sizes.prod(axis=1)[:, None, None]
    separable = []
    for k, plane in enumerate(planes):
        rest = np.delete(np.arange(len(planes)), k)
        normal_matrix = information[rest].sum(axis=0)
        if np.linalg.matrix_rank(normal_matrix, tol=1e-6 * np.trace(normal_matrix)) < 6:
            continue
        leverage = np.einsum("ni,ij,nj->n", offsets[rest], np.linalg.inv(normal_matrix), offsets[rest])
        if (leverage * sizes[rest].prod(axis=1)).max() < MOST_LEVERAGE and plane in rooms.edges:
            separable.append(plane)
    return np.array(separable, dtype=np.int64)


def opened_door(rng: np.random.Generator) -> Planted:
    """Move one plane of rooms by 5 cm between the scans, with all edges that lie in it."""
    possible = np.empty(0)
    while len(possible) == 0:
        rooms, pipes = _rooms(rng), _pipes(rng)
        possible = separable_planes(rooms)
    plane = int(rng.choice(possible))
    other = rooms.with_plane_moved(plane, rng.choice([-1.0, 1.0]) * DOOR_SHIFT_M)
    in_plane = (rooms.edges == plane).any(axis=1)
    return _edges_of(rooms, other, pipes, in_plane, _flags(len(rooms.normals), plane), rng)


def _edges_of(
    rooms: PlaneRooms,
    other: PlaneRooms,
    pipes: LineScene,
    wrong_edges: np.ndarray,
    wrong_planes: np.ndarray,
    rng: np.random.Generator,
) -> Planted:
    """See rooms that changed between the scans."""
    pair = observed_rooms(rooms, rng, noise_m=rng.uniform(*NOISES_M), source_rooms=other, pipes=pipes)
    no_pipe = np.zeros(len(pipes), dtype=bool)
    return Planted(pair, np.concatenate([wrong_edges, no_pipe, wrong_planes[rooms.matched]]))


PLANTED_ERRORS: Mapping[str, Callable[[np.random.Generator], Planted]] = MappingProxyType(
    {
        "wrong correspondence among lines": wrong_correspondence_of_lines,
        "line shifted 20 mm": shifted_line,
        "wrong correspondence among edges of planes": wrong_correspondence_of_edges,
        "edge shifted 20 mm": shifted_edge,
        "door opened 5 cm": opened_door,
    }
)
"""Draws of scenes with one error, by what was done."""
