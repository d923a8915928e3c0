"""Texture of a mesh from oriented photos: for every triangle the photo that shows it best, and all in one atlas.

The source leaves the texture on the surface model as an outlook (Haring 2003, ch. 6). Of each photo the triangles that
it shows whole are found by rays to their corners and centres; neighbours that take one photo make a chart, laid out as
they lie in the photo (after Waechter, Moehrle and Goesele 2014, without their seam levelling: gains of whole photos are
balanced instead). Every texel is taken from its own place on its triangle, so that perspective and lens distortion are
exact on large triangles too.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, UInt8
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from algorithms.arrays import Array, Points
from algorithms.colouring.balance import Balance, balance_of, no_balance
from algorithms.colouring.options import ColouringOptions
from algorithms.colouring.photo_views import PlacedPhoto, radius_of, sampled, weights_of
from algorithms.deviations.triangles import Mesh
from algorithms.errors import InvalidInputError
from algorithms.meshing.faults import edges_of
from algorithms.progress import Progress
from algorithms.scans.triangle_tree import TriangleTree

SAMPLE = 60_000
"""About so many triangles tell the balance of the photos."""
OFF_SURFACE = 0.05
"""Rays start this share of the mean edge off the surface, so that a triangle does not hide itself."""
ALMOST_AS_GOOD = 0.5
"""A triangle joins the photo of two of its neighbours where its own say there is at least this share of the best."""
JOINING_ROUNDS = 3
PADDING = 2
"""Texels about a chart."""
GREY = 128
"""Of what no photo shows."""
SHRINK = 0.93
TEXELS_AT_ONCE = 1 << 21
RAYS_AT_ONCE = 1 << 20


@dataclass(frozen=True, eq=False)
class Texture:
    """An image and where the corners of the triangles lie in it."""

    image: UInt8[Array, "h w 3"]
    """Red, green, blue; texels without a triangle repeat the nearest one that has."""
    corners: Float64[Array, "t 3 2"]
    """(t, 3, 2) of each triangle's corners columns and rows in the image, 0, 0 the middle of its first texel."""
    photo_of: Array
    """(t,) photo of each triangle, -1 where none shows it."""
    texels_per_pixel: float
    """Scale of the photos in the image."""
    charts: int
    """Pieces."""
    balance: Balance


@dataclass(frozen=True, eq=False)
class _Shown:
    """What a photo shows of a mesh."""

    faces: Array
    """(m,) triangles."""
    weights: Array
    """(m,) say of the photo there."""


def textured(
    mesh: Mesh, photos: Sequence[PlacedPhoto], options: ColouringOptions, size_px: int, progress: Progress
) -> Texture:
    """Lay photos on a mesh.

    Parameters
    ----------
    mesh
        Triangles in the frame of the photos' poses, normals outward [m].
    photos
        With cameras and poses; read one at a time.
    options
        Angles and powers of the photos' say, balance; what hides is the mesh itself, without a margin.
    size_px
        Largest side of the image.

    Raises
    ------
    InvalidInputError
        No photo shows a triangle, or its charts do not fit the image however small.
    """
    normals = _unit_normals(mesh)
    shown: list[_Shown] = []
    for number, photo in enumerate(photos):
        progress.report(0.3 * number / len(photos), f"looking at {photo.name}")
        shown.append(_shown_by(photo, mesh, normals, options))
    photo_of = _chosen(mesh, shown)
    if (photo_of < 0).all():
        raise InvalidInputError("photos", "none of them shows a triangle", "check cameras, mounts and poses")
    balance = _balanced(mesh, photos, shown) if options.balance else no_balance(len(photos))
    charts = _charts(mesh, photo_of)
    corners = np.zeros((len(mesh.triangles), 3, 2))
    for number, photo in enumerate(photos):
        own = np.flatnonzero(photo_of == number)
        corners[own] = _pixels(photo, mesh.vertices[mesh.triangles[own]].reshape(-1, 3)).reshape(-1, 3, 2)
    corners, shape, scale = _laid_out(corners, charts, size_px)
    image = np.full((*shape, 3), GREY, dtype=np.uint8)
    filled = np.zeros(shape, dtype=np.bool_)
    filled[: 2 * PADDING, : 2 * PADDING] = True  # what no photo shows
    for number, photo in enumerate(photos):
        own = np.flatnonzero(photo_of == number)
        progress.report(0.4 + 0.5 * number / len(photos), f"laying {photo.name} on the mesh")
        if len(own):
            pixels_of_photo = photo.read()
            for rows, columns, places in _texels(corners[own], mesh.vertices[mesh.triangles[own]], shape):
                pixels = _pixels(photo, places)
                colors = balance.balanced(number, sampled(pixels_of_photo, pixels), radius_of(photo.camera, pixels))
                image[rows, columns] = np.clip(np.rint(colors), 0.0, 255.0)
                filled[rows, columns] = True
    progress.report(0.9, "filling between the charts")
    nearest = distance_transform_edt(~filled, return_distances=False, return_indices=True)
    return Texture(image[tuple(nearest)], corners, photo_of, scale, int(charts.max()) + 1, balance)


def _unit_normals(mesh: Mesh) -> Points:
    corners = mesh.vertices[mesh.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(across / np.maximum(np.linalg.norm(across, axis=1), np.finfo(np.float64).tiny)[:, None])


def _pixels(photo: PlacedPhoto, places: Array) -> Array:
    return photo.camera.image_from_camera(photo.common_from_camera.inv().apply(places))


def _shown_by(photo: PlacedPhoto, mesh: Mesh, normals: Points, options: ColouringOptions) -> _Shown:
    """Find the triangles that a photo shows whole, and its say in each."""
    camera = photo.camera
    in_camera = photo.common_from_camera.inv().apply(mesh.vertices)
    seen = np.flatnonzero(camera.projectable(in_camera))
    inside = np.zeros(len(in_camera), dtype=np.bool_)
    inside[seen] = camera.inside(camera.image_from_camera(in_camera[seen]))
    faces = np.flatnonzero(inside[mesh.triangles].all(axis=1))
    centres = in_camera[mesh.triangles[faces]].mean(axis=1)
    turned = photo.common_from_camera.rotation.inv().apply(normals[faces])
    weights = weights_of(camera, centres, turned, camera.image_from_camera(centres), options)
    faces, weights = faces[weights > 0.0], weights[weights > 0.0]
    free = _in_sight(np.asarray(photo.common_from_camera.translation), mesh, normals, faces)
    return _Shown(faces[free], weights[free])


def _in_sight(eye: Array, mesh: Mesh, normals: Array, faces: Array) -> Array:
    """Tell which triangles nothing hides, corners and centre, from an eye before them."""
    tree = TriangleTree(mesh.vertices, mesh.triangles)
    free = np.ones(len(faces), dtype=np.bool_)
    for start in range(0, len(faces), RAYS_AT_ONCE // 4):
        part = faces[start : start + RAYS_AT_ONCE // 4]
        corners = mesh.vertices[mesh.triangles[part]]
        centres = corners.mean(axis=1, keepdims=True)
        edge = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
        # corners are drawn in a little, for a fold beside one hides no triangle
        places = np.concatenate([0.9 * corners + 0.1 * centres, centres], axis=1)
        places = places + (OFF_SURFACE * edge[:, None] * normals[part])[:, None, :]
        hits = tree.meets_any(places.reshape(-1, 3), (eye - places).reshape(-1, 3), far=1.0)
        free[start : start + len(part)] = ~hits.reshape(-1, 4).any(axis=1)
    return free


def _chosen(mesh: Mesh, shown: Sequence[_Shown]) -> Array:
    """Give the photo of each triangle (t,), -1 for none: the one with the largest say, but for lone triangles."""
    count = len(mesh.triangles)
    best, photo_of = np.zeros(count), np.full(count, -1)
    for number, each in enumerate(shown):
        better = each.weights > best[each.faces]
        best[each.faces[better]] = each.weights[better]
        photo_of[each.faces[better]] = number
    pairs = _neighbours(mesh)
    for _ in range(JOINING_ROUNDS):
        joined = photo_of.copy()
        for number, each in enumerate(shown):
            beside = np.zeros(count, dtype=np.int64)
            for one, other in (pairs, pairs[::-1]):
                np.add.at(beside, one, photo_of[other] == number)
            good = each.weights >= ALMOST_AS_GOOD * best[each.faces]
            joined[each.faces[good & (beside[each.faces] >= 2)]] = number
        photo_of = joined
    return photo_of


def _neighbours(mesh: Mesh) -> tuple[Array, Array]:
    """Give the pairs of triangles that share an edge."""
    edges = edges_of(mesh)
    order = np.argsort(edges.of_side.ravel(), kind="stable")
    faces, own = order // 3, edges.of_side.ravel()[order]
    same = own[1:] == own[:-1]
    return faces[:-1][same], faces[1:][same]


def _charts(mesh: Mesh, photo_of: Array) -> Array:
    """Count through the pieces of neighbours that take one photo, (t,) each triangle's; -1 where it takes none."""
    one, other = _neighbours(mesh)
    alike = (photo_of[one] == photo_of[other]) & (photo_of[one] >= 0)
    count = len(photo_of)
    graph = coo_array((np.ones(int(alike.sum()), dtype=np.int8), (one[alike], other[alike])), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    charts = np.full(count, -1)
    shown = photo_of >= 0
    charts[shown] = np.unique(labels[shown], return_inverse=True)[1]
    return charts


def _balanced(mesh: Mesh, photos: Sequence[PlacedPhoto], shown: Sequence[_Shown]) -> Balance:
    """Estimate the gains of the photos at the centres of some triangles."""
    sample = np.arange(0, len(mesh.triangles), max(1, len(mesh.triangles) // SAMPLE))
    place = np.full(len(mesh.triangles), -1)
    place[sample] = np.arange(len(sample))
    centres = mesh.vertices[mesh.triangles[sample]].mean(axis=1)
    colors, radii = [], []
    for photo, each in zip(photos, shown, strict=True):
        rows = place[each.faces]
        rows = rows[rows >= 0]
        own, radius = np.full((len(sample), 3), np.nan), np.zeros(len(sample))
        if len(rows):
            pixels = _pixels(photo, centres[rows])
            own[rows], radius[rows] = sampled(photo.read(), pixels), radius_of(photo.camera, pixels)
        colors.append(own)
        radii.append(radius)
    return balance_of(colors, radii)


def _laid_out(corners: Array, charts: Array, size_px: int) -> tuple[Array, tuple[int, int], float]:
    """Lay charts beside each other: corners in the image (t, 3, 2), its rows and columns, texels per pixel."""
    count = int(charts.max()) + 1
    own = charts >= 0
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    for k in range(3):
        np.minimum.at(low, charts[own], corners[own, k])
        np.maximum.at(high, charts[own], corners[own, k])
    extents = high - low
    scale = min(1.0, float(np.sqrt(size_px**2 / np.prod(extents + 2 * PADDING, axis=1).sum())))
    while True:
        boxes = np.ceil(scale * extents).astype(np.int64) + 1 + 2 * PADDING
        places, shape = _shelves(boxes, size_px)
        if shape[0] <= size_px and shape[1] <= size_px:
            break
        scale *= SHRINK
        if scale < 1e-3:
            raise InvalidInputError(
                "texture", f"{count} pieces do not fit {size_px} by {size_px} pixels", "a larger `size_px`, or a "
                "smaller `surface.share` of triangles",
            )  # fmt: skip
    out = np.full_like(corners, float(PADDING))
    shift = places[charts[own]] + PADDING - scale * low[charts[own]]
    out[own] = scale * corners[own] + shift[:, None, :]
    return out, shape, scale


def _shelves(boxes: Array, size_px: int) -> tuple[Array, tuple[int, int]]:
    """Put boxes (k, 2: columns, rows) on shelves, the highest first, beginning right of what no photo shows."""
    places = np.zeros((len(boxes), 2), dtype=np.int64)
    width = int(min(size_px, max(np.sqrt(1.1 * boxes.prod(axis=1).sum()), boxes[:, 0].max() + 2 * PADDING)))
    column, row, height = 2 * PADDING, 0, 2 * PADDING
    for k in np.argsort(-boxes[:, 1], kind="stable").tolist():
        across, down = boxes[k].tolist()
        if column + across > width:
            column, row, height = 0, row + height, 0
        places[k] = column, row
        column, height = column + across, max(height, down)
    return places, (row + height, max(width, int((places[:, 0] + boxes[:, 0]).max())))


def _texels(corners: Array, vertices: Array, shape: tuple[int, int]) -> Iterator[tuple[Array, Array, Array]]:
    """Give the texels of triangles, rows and columns, with their places on the mesh (m, 3); some at a time."""
    low = np.maximum(np.floor(corners.min(axis=1)).astype(np.int64) - 1, 0)
    high = np.minimum(np.ceil(corners.max(axis=1)).astype(np.int64) + 1, np.array(shape)[::-1] - 1)
    sizes = np.maximum(high - low + 1, 0)
    ends = np.cumsum(sizes.prod(axis=1))
    start = 0
    while start < len(corners):
        before = int(ends[start - 1]) if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, before + TEXELS_AT_ONCE, side="right")))
        part = slice(start, stop)
        counts = sizes[part].prod(axis=1)
        owner = np.repeat(np.arange(start, stop), counts)
        number = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        columns = low[owner, 0] + number % sizes[owner, 0]
        rows = low[owner, 1] + number // sizes[owner, 0]
        a, ab, ac = corners[owner, 0], corners[owner, 1] - corners[owner, 0], corners[owner, 2] - corners[owner, 0]
        apart = np.column_stack([columns, rows]) - a
        area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            v = (apart[:, 0] * ac[:, 1] - apart[:, 1] * ac[:, 0]) / area
            w = (ab[:, 0] * apart[:, 1] - ab[:, 1] * apart[:, 0]) / area
        inside = np.minimum.reduce([v, w, 1.0 - v - w]) >= -1e-9
        owner, v, w = owner[inside], v[inside, None], w[inside, None]
        corner = vertices[owner]
        places = corner[:, 0] + v * (corner[:, 1] - corner[:, 0]) + w * (corner[:, 2] - corner[:, 0])
        yield rows[inside], columns[inside], places
        start = stop
