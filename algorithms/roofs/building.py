"""A building from its ground plan and the points of its roof: roof faces, vertical walls, ground."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Points
from algorithms.deviations.signed_distances import inside_polygon
from algorithms.deviations.triangles import Mesh, condition_of
from algorithms.errors import InvalidInputError
from algorithms.meshing.reconstruction import enclosed_volume
from algorithms.meshing.repair import ears_of
from algorithms.roofs.faces import Faces, faces_of, heights_at, outline_of
from algorithms.roofs.options import RoofOptions
from algorithms.roofs.partition import area_of, divided
from algorithms.roofs.planes import LEAST_NEIGHBOURS, MAD, TOLERANCE, RoofPlane, least_points, roof_planes
from algorithms.roofs.surroundings import share_above

ROOF, WALL, GROUND = "RoofSurface", "WallSurface", "GroundSurface"
"""As CityJSON calls them."""
JOINED_M = 0.05
"""Heights at one corner that differ by less than this beyond the noise are one."""
PLANE_M = 8e-3
"""Corners of a polygon lie so near its plane."""
AROUND_M, LOW = 3.0, 0.1
"""The ground is this quantile of the heights of points so near around the plan, each the median of those beside it."""
SMOOTHED = 16
GATHERED, MOST_STEPS = 2.0, 20
"""The ground's level is the middle of the smoothed heights so many of their standard deviations about it."""
MEDIAN = 1.2533
"""Standard deviation of a median by that of a mean."""
LEAST_RIM = 0.15
"""A building stands above its surroundings along so much of its plan's rim; its neighbours may take the rest."""


@dataclass(frozen=True, eq=False)
class BuildingSurface:
    """One plane polygon of a building."""

    kind: str
    rings: Sequence[Array]
    """Each (k,) vertices; the outer one first, anticlockwise from outside."""
    plane: int | None
    """Of a roof face; None of others."""


@dataclass(frozen=True, eq=False)
class BuildingModel:
    """A building in plane polygons."""

    vertices: Points
    """(v, 3) [m]."""
    surfaces: Sequence[BuildingSurface]
    planes: Sequence[RoofPlane]
    ground_m: float
    points: int
    """Points over the plan and above the ground."""
    mesh: Mesh
    """The same in triangles."""

    @property
    def watertight(self) -> bool:
        """Whether the polygons bound a body."""
        return condition_of(self.mesh).is_closed

    @property
    def volume_m3(self) -> float:
        """What they enclose [m³]."""
        return enclosed_volume(self.mesh)


def ground_height_m(points: Points, outline: Array) -> tuple[float, float]:
    """Return the height of the ground about a plan: the level about which low smoothed points beside it gather.

    Of raw heights a low quantile lies below level ground by their noise. From it the level climbs to where as many
    smoothed heights lie above as below, within their noise: to the middle of level ground, hardly at all on slopes.

    Parameters
    ----------
    points
        (n, 3) of the site [m].
    outline
        (k, 2) corners of the plan [m].

    Returns
    -------
    The height and its standard deviation [m].

    Raises
    ------
    InvalidInputError
        There are none.
    """
    low, high = outline.min(axis=0) - AROUND_M, outline.max(axis=0) + AROUND_M
    near = ((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1)
    beside = points[near][~inside_polygon(points[near, :2], outline)]
    if len(beside) < LEAST_NEIGHBOURS:
        raise InvalidInputError(
            "plan", f"no ground within {AROUND_M:g} m around it", "state its height (`ground_m`), or give points of it"
        )
    together = min(SMOOTHED, len(beside))
    _, nearest = cKDTree(beside[:, :2]).query(beside[:, :2], k=together)
    smooth = np.median(beside[nearest, 2], axis=1)
    noise = MEDIAN * MAD * float(np.median(np.abs(beside[:, 2] - smooth))) / np.sqrt(together)
    level = float(np.quantile(smooth, LOW))
    for _ in range(MOST_STEPS):
        gathered = smooth[np.abs(smooth - level) <= GATHERED * noise]
        if len(gathered) == 0 or (there := float(np.median(gathered))) == level:
            break
        level = there
    # smoothed heights of neighbours share their points
    return level, MEDIAN * noise * np.sqrt(together / max(len(gathered), 1))


def modelled_building(points: Points, outline: Array, ground_m: float, options: RoofOptions) -> BuildingModel:
    """Model a building.

    Parameters
    ----------
    points
        (n, 3) of the site; x and y near the origin [m].
    outline
        (k, 2) corners of the ground plan in order, either way round [m].
    ground_m
        Height of the ground [m].
    options
        What counts as a roof.

    Raises
    ------
    InvalidInputError
        Too few points are above the plan, or what is there is terrain.
    """
    outline = outline if area_of(outline) > 0.0 else outline[::-1]
    high = points[points[:, 2] >= ground_m + options.least_height_m]
    over = high[inside_polygon(high[:, :2], outline)]
    if len(over) < LEAST_NEIGHBOURS:
        raise InvalidInputError("plan", f"only {len(over)} points of a roof lie over it", "check its coordinates")
    share = share_above(points, outline, options.least_height_m)
    if share is not None and share < LEAST_RIM:
        raise InvalidInputError(
            "plan", f"what lies over it stands above its surroundings along {100.0 * share:.0f} % of its sides only",
            "terrain and yards are no buildings: check its coordinates, or lower `least_height_m`",
        )  # fmt: skip
    planes, labels = roof_planes(over, options)
    if not planes:  # as the source: what has no plane gets a horizontal one
        heights = over[:, 2]
        level = float(heights.mean())
        planes = [RoofPlane(np.array([0.0, 0.0, level]), 0, len(over), float(heights.std()), float(heights.std()))]
        labels = np.zeros(len(over), dtype=np.int64)
    joined_m = TOLERANCE * options.noise_m + JOINED_M
    plan = divided(outline, planes, over, labels, least_points(over, options), options.least_area_m2)
    corners, faces, met = faces_of(plan, planes, over, labels, outline, joined_m)
    return _solid(corners, faces, met, ground_m, len(over), joined_m)


@dataclass(eq=False)
class _Columns:
    """The heights at each corner of the plan, and the vertices made of them."""

    corners: Array
    heights: list[list[float]]
    numbers: dict[tuple[int, float], int]

    def vertex(self, corner: int, height: float) -> int:
        return self.numbers.setdefault((corner, height), len(self.numbers))

    def between(self, corner: int, low: float, high: float) -> list[int]:
        """Give the vertices of a corner from one height to another, both included, upward."""
        return [self.vertex(corner, each) for each in self.heights[corner] if low <= each <= high]

    def vertices(self) -> Points:
        return np.array([[*self.corners[corner], height] for corner, height in self.numbers])


def _solid(
    corners: Array, faces: Faces, planes: Sequence[RoofPlane], ground_m: float, points: int, joined_m: float
) -> BuildingModel:
    tops = heights_at(corners, faces, planes, joined_m)
    columns = _Columns(corners, [[ground_m] for _ in corners], {})
    for corner, level in sorted({(corner, level) for (corner, _), level in tops.items()}):
        columns.heights[corner].append(level)
    surfaces = [
        BuildingSurface(ROOF, each, plane)
        for plane, rings in faces
        for each in _plane_parts(columns, [_top(columns, tops, ring, plane) for ring in rings])
    ]
    surfaces += _walls(columns, tops, faces, ground_m)
    surfaces += [
        BuildingSurface(
            GROUND,
            [np.array([columns.vertex(corner, ground_m) for corner in ring.tolist()])[::-1] for ring in rings],
            None,
        )
        for rings in outline_of(corners, faces)
    ]
    vertices = columns.vertices()
    return BuildingModel(vertices, surfaces, planes, ground_m, points, triangulated(vertices, surfaces))


def _plane_parts(columns: _Columns, rings: Sequence[Array]) -> Sequence[Sequence[Array]]:
    """Cut a face whose corners lie in no plane, where more than three meet, into triangles."""
    vertices, ring = columns.vertices(), np.concatenate(rings)
    centred = vertices[ring] - vertices[ring].mean(axis=0)
    normal = np.linalg.svd(centred, full_matrices=False)[2][-1]
    if len(ring) == 3 or np.abs(centred @ normal).max() <= PLANE_M:
        return [rings]
    return [[each] for each in ring[ears_of(vertices[ring, :2], [len(each) for each in rings])]]


def _top(columns: _Columns, tops: Mapping[tuple[int, int], float], ring: Array, plane: int) -> Array:
    return np.array([columns.vertex(corner, tops[corner, plane]) for corner in ring.tolist()])


def _walls(
    columns: _Columns,
    tops: Mapping[tuple[int, int], float],
    faces: Faces,
    ground_m: float,
) -> list[BuildingSurface]:
    """Put a wall below every side of a face down to what lies beside it: a lower face, or the ground."""
    sides = {
        (start, end): plane
        for plane, rings in faces
        for ring in rings
        for start, end in zip(ring.tolist(), np.roll(ring, -1).tolist(), strict=True)
    }
    walls = []
    for (start, end), plane in sides.items():
        beside = sides.get((end, start))
        foot = {k: ground_m if beside is None else tops[k, beside] for k in (start, end)}
        top = {k: tops[k, plane] for k in (start, end)}
        if all(top[k] <= foot[k] for k in (start, end)) or top[start] + top[end] <= foot[start] + foot[end]:
            continue
        right = columns.between(end, foot[end], top[end])
        left = columns.between(start, foot[start], top[start])[::-1]
        ring = [*left[-1:], *right, *left[:-1]]
        if len(ring) >= 3:
            walls.append(BuildingSurface(WALL, [np.array(ring)], None))
    return walls


def triangulated(vertices: Points, surfaces: Sequence[BuildingSurface]) -> Mesh:
    """Cut all polygons into triangles that look as they do."""
    triangles = []
    for surface in surfaces:
        ring = np.concatenate(surface.rings)
        outer = vertices[surface.rings[0]]
        outer = outer - outer[0]
        normal = np.cross(outer, np.roll(outer, -1, axis=0)).sum(axis=0)
        axis = int(np.argmax(np.abs(normal)))
        flat = np.delete(vertices[ring], axis, axis=1)
        triangles.append(ring[ears_of(flat, [len(each) for each in surface.rings])])
    return Mesh(vertices, np.concatenate(triangles))
