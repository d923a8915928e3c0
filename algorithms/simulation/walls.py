"""Walls with openings: reveals, frames and panes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from algorithms.arrays import Array, Matrix3, Vector3
from algorithms.simulation.materials import GLASS, WOOD, Material
from algorithms.simulation.parts import Part, polygons

SIDES = ((0, 1), (1, 2), (2, 3), (3, 0))
"""Corner numbers of a quadrangle's sides."""


@dataclass(frozen=True)
class Opening:
    """A rectangular hole in a wall, in wall coordinates (along, up) [m]."""

    left_m: float
    right_m: float
    sill_m: float
    lintel_m: float
    frame_depth_m: float | None = 0.14
    """How deep behind the face the frame stands; None for an open passage."""
    glazed: bool = True
    """A pane in the frame; otherwise a wooden leaf."""
    frame_width_m: float = 0.08

    @property
    def rectangle(self) -> tuple[float, float, float, float]:
        """Give (left, right, sill, lintel) [m]."""
        return self.left_m, self.right_m, self.sill_m, self.lintel_m


@dataclass(frozen=True, eq=False)
class WallFrame:
    """Where a wall stands: wall coordinates (along, up, outwards) to world."""

    origin_m: Vector3
    axes: Matrix3
    """Columns: along the wall, up, outwards (right-handed)."""

    def at(self, along_up: Array, outwards_m: float = 0.0) -> Array:
        """Map wall coordinates (k, 2) to world (k, 3) [m]."""
        flat = np.column_stack([np.asarray(along_up, dtype=np.float64), np.full(len(along_up), outwards_m)])
        return np.asarray(self.origin_m + flat @ self.axes.T)


def wall_frame(start_m: tuple[float, float], end_m: tuple[float, float], base_m: float = 0.0) -> WallFrame:
    """Stand a wall on the ground line start -> end; its outer side is on the right of that direction."""
    start, end = np.array(start_m, dtype=np.float64), np.array(end_m, dtype=np.float64)
    x, y = (end - start) / np.linalg.norm(end - start)
    return WallFrame(np.array([start[0], start[1], base_m]), np.array([[x, 0.0, y], [y, 0.0, -x], [0.0, 1.0, 0.0]]))


def _rectangle(left: float, right: float, low: float, high: float) -> Array:
    return np.array([[left, low], [right, low], [right, high], [left, high]])


def sheet_cells(top: Array, low_m: float, holes: Sequence[tuple[float, float, float, float]]) -> list[Array]:
    """Cut a wall face with holes into convex cells.

    The face is swept in vertical strips between all abscissae where its top line bends or a hole begins or ends.

    Parameters
    ----------
    top
        (k, 2) polyline of the upper rim, ascending in the first column [m].
    low_m
        Height of the straight lower rim.
    holes
        (left, right, low, high) rectangles below the top line [m]; they may not overlap.

    Returns
    -------
    Rings (3 or 4, 2).
    """
    cuts = np.unique(np.concatenate([top[:, 0], *(np.array(h[:2]) for h in holes)]))
    cells = []
    for left, right in pairwise(cuts):
        rim_left, rim_right = np.interp([left, right], top[:, 0], top[:, 1])
        here = sorted((h for h in holes if h[0] <= left and h[1] >= right), key=lambda h: h[2])
        floor = low_m
        for _, _, low, high in here:
            if low > floor:
                cells.append(_rectangle(left, right, floor, low))
            floor = high
        ring = np.array([[left, floor], [right, floor], [right, rim_right], [left, rim_left]])
        keep = [True, True, rim_right > floor, rim_left > floor]
        cells.append(ring[keep])
    return cells


def wall(
    frame: WallFrame,
    top: Array,
    openings: Sequence[Opening],
    material: Material,
    *,
    low_m: float = 0.0,
    reveal_m: float = 0.30,
) -> list[Part]:
    """Build one face of a wall with its openings.

    The face has no thickness; each opening is lined by reveals going `reveal_m` inwards (none below an opening that
    stands on the lower rim), and closed by a frame with a pane or a leaf where it has one.

    Parameters
    ----------
    frame
        Where the wall stands.
    top
        (k, 2) upper rim in wall coordinates, from the wall's start to its end [m].
    openings
        Not overlapping, inside the face.
    material
        Of face and reveals.
    low_m
        Height of the lower rim above the frame's origin [m].
    reveal_m
        Depth of the reveals [m]; 0 for none.
    """
    top = np.asarray(top, dtype=np.float64)
    cells = sheet_cells(top, low_m, [o.rectangle for o in openings])
    face = polygons([frame.at(c) for c in cells], material, with_edges=False)
    parts = [Part(face.vertices, face.triangles, _rim_edges(frame, top, low_m, openings), material)]
    for opening in openings:
        if reveal_m > 0.0:
            ring = _rectangle(*opening.rectangle)
            front, back = frame.at(ring), frame.at(ring, -reveal_m)
            sides = SIDES if opening.sill_m > low_m else SIDES[1:]
            parts.append(polygons([np.stack([front[i], front[j], back[j], back[i]]) for i, j in sides], material))
        if opening.frame_depth_m is not None:
            parts += _filling(frame, opening, opening.frame_depth_m)
    return parts


def _rim_edges(frame: WallFrame, top: Array, low_m: float, openings: Sequence[Opening]) -> Array:
    """Give the edges (e, 2, 3) around a wall's face; the lower one is cut where openings reach it."""
    gaps = sorted((o.left_m, o.right_m) for o in openings if o.sill_m <= low_m)
    feet = np.array([top[0, 0], *(x for gap in gaps for x in gap), top[-1, 0]]).reshape(-1, 2)
    low = [np.array([[left, low_m], [right, low_m]]) for left, right in feet if right > left]
    ends = [np.array([[x, low_m], [x, z]]) for x, z in (top[0], top[-1])]
    return np.stack([frame.at(edge) for edge in (*low, *ends, *(top[k : k + 2] for k in range(len(top) - 1)))])


def partition(
    start_m: tuple[float, float],
    end_m: tuple[float, float],
    height_m: float,
    thickness_m: float,
    openings: Sequence[Opening],
    material: Material,
) -> list[Part]:
    """Build a wall between two rooms, centred on the ground line start -> end, open at both ends.

    Openings count from `start_m`; they are passages unless filled from the right side of that direction.
    """
    start, end = np.array(start_m, dtype=np.float64), np.array(end_m, dtype=np.float64)
    along = (end - start) / np.linalg.norm(end - start)
    right = 0.5 * thickness_m * np.array([along[1], -along[0]])
    length = float(np.linalg.norm(end - start))
    top = np.array([[0.0, height_m], [length, height_m]])
    mirrored = [replace(o, left_m=length - o.right_m, right_m=length - o.left_m, frame_depth_m=None) for o in openings]
    right_face = wall_frame(_pair(start + right), _pair(end + right))
    left_face = wall_frame(_pair(end - right), _pair(start - right))
    return [
        *wall(right_face, top, openings, material, reveal_m=thickness_m),
        *wall(left_face, top, mirrored, material, reveal_m=0.0),
    ]


def _pair(point: Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def _filling(frame: WallFrame, opening: Opening, depth_m: float) -> list[Part]:
    """Build frame and pane, or the leaf of a door, set back from the face by `depth_m`."""
    left, right, low, high = opening.rectangle
    if not opening.glazed:
        return [polygons([frame.at(_rectangle(left, right, low, high), -depth_m)], WOOD)]
    w, thickness = opening.frame_width_m, 0.06
    inner = (left + w, right - w, low + w, high - w)
    ring, hole = _rectangle(left, right, low, high), _rectangle(*inner)
    outer_face, inner_face = frame.at(ring, -depth_m), frame.at(hole, -depth_m)
    deep = frame.at(hole, -depth_m - thickness)
    rings = [np.stack([outer_face[i], outer_face[j], inner_face[j], inner_face[i]]) for i, j in SIDES]
    rings += [np.stack([inner_face[i], inner_face[j], deep[j], deep[i]]) for i, j in SIDES]
    return [polygons(rings, WOOD), polygons([deep], GLASS)]
