"""Which surface an edge of a photo belongs to: occlusion, creases, edges on one plane."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from algorithms.arrays import Array, Flags, Labels, Points, Scalars, Vector3
from algorithms.features.photo_lines.edge_touches import EdgeTouches
from algorithms.features.photo_lines.projection_options import EdgeRejection, SpaceEdgeKind
from algorithms.features.photo_lines.side_planes import (
    BETWEEN_SHARE,
    BOTH_SHARE,
    COVERED,
    FEW_BESIDE,
    FRONT_SHARE,
    LEAST_INCIDENCE,
    OWN_SHARE,
    SAME_ANGLE_RAD,
    SAME_CHI_SQUARE,
    SAME_STEP_M,
    SIGNIFICANT,
    UNEVENNESS_M,
    SidePlanes,
)

DOWNWARDS = 0.5
"""Cosine between the nadir and the direction from an edge to a side that counts as below it."""

FACE_PX = 4.0
"""Faces narrower than this in the photo have their far end so near that both ends look like one edge, or that the far
one, where it is all that is seen, could not be told from the near one [px]."""
HORIZON = float(np.sin(np.deg2rad(6.0)))
"""Rays that rise by less may look down upon level surfaces, as scanners stand upright to a few degrees only."""
LEAST_TURN = 1e-3
"""Sine of the angle from which a face that bounds a body is seen: one of 0.3 m in 10 m is then 0.05 px wide."""


@dataclass(frozen=True, eq=False)
class EdgeOwners:
    """The plane of each of n edges, not yet with its final covariance."""

    kinds: Labels
    """(n,) `SpaceEdgeKind` values; of edges on one plane `SURFACE_EDGE`."""
    reasons: Labels
    """(n,) `EdgeRejection` values, 0 for edges that have a plane."""
    sides: Bool[Array, "n 2"]
    """(n, 2) which sides' points the plane is made of."""
    normals: Points
    """(n, 3) unit normals towards the camera."""
    centroids: Points
    """(n, 3) [m]."""
    variances_m2: Scalars
    """(n,) of single points across the plane."""
    counts: Scalars
    """(n,) points."""
    rows: Scalars
    """(n,) rows along the edge that they form."""


def edge_owners(
    planes: SidePlanes,
    projecting: Points,
    rays: Float64[Array, "n 3 3"],
    centre: Vector3,
    variances_m2: Float64[Array, "n 2"],
    uneven: Bool[Array, "n 2"],
    crowded: Bool[Array, "n 2"],
    touches: EdgeTouches,
    up: Vector3,
    min_angle_rad: float,
) -> EdgeOwners:
    """Decide to which plane each edge belongs.

    If both sides are one plane, both together make it. If two planes meet at the edge, the better determined one is
    taken; if they do not, the nearer one, as the farther ends behind it. Where the points right beside the edge speak
    against the plane, the edge is rejected.

    Parameters
    ----------
    planes
        Planes of both sides.
    projecting
        (n, 3) normals of the projecting planes.
    rays
        (n, 3, 3) unit rays through start, middle and end of the edges.
    centre
        (3,) projection centre [m].
    variances_m2
        (n, 2) variances of single points across the planes.
    uneven
        (n, 2) planes that are made of several surfaces: they own no edge, and leave open what is nearer.
    crowded
        (n, 2) sides on which another edge runs nearer than the points of the plane: the surface may end there.
    touches
        Where planes are seen to end at the edge.
    up
        (3,) unit direction upwards.
    min_angle_rad
        Least angle between projecting plane and surface.
    """
    exist: Array = planes.exist
    both: Array = np.asarray(exist.all(axis=1))
    steep = _steep_enough(planes, projecting, rays, min_angle_rad)
    ranges, stds = _ranges(planes, rays, centre, variances_m2)
    covered = (planes.covered >= COVERED) & planes.dense
    reach: Array = np.asarray(covered.all(axis=1))
    same = both & reach & _one_plane(planes, variances_m2, ranges, rays)
    beside_other = planes.on_plane[:, [0, 1], [1, 0]]
    others = planes.beside[:, ::-1]
    continues: Array = exist & ~both[:, None] & (beside_other >= 3) & (beside_other >= OWN_SHARE * others)
    nearer, meets, crossing = _depth_order(ranges, stds, planes, rays)
    usable = exist & ~uneven & steep & covered & (ranges > 0.0).all(axis=2)
    # offsets at the edge, across the line of sight, tell how well a side determines the line
    quality = np.where(usable, stds.max(axis=2), np.inf)
    owner = np.where(both & meets, np.argmin(quality, axis=1), np.where(both, nearer, np.argmax(exist, axis=1)))
    rows = np.arange(len(owner))
    sides = np.zeros((len(owner), 2), dtype=bool)
    sides[rows, owner] = True
    sides[same] = True
    kinds = np.where(same | continues.any(axis=1), SpaceEdgeKind.SURFACE_EDGE, SpaceEdgeKind.SILHOUETTE)
    kinds = np.where(both & meets & reach & ~same, SpaceEdgeKind.CREASE, kinds)
    front, on = planes.in_front[rows, owner], planes.on_plane[rows, owner].sum(axis=1)
    own, all_own = planes.on_plane[rows, owner, owner], planes.beside[rows, owner]
    unclear = (front >= 2) & (front > FRONT_SHARE * (front + on))
    unclear |= (own < OWN_SHARE * all_own) | (both & ~same & crossing)
    normals, centroids = planes.normals[rows, owner], planes.centroids[rows, owner]
    ends = kinds == SpaceEdgeKind.SILHOUETTE
    unclear |= ends & (beside_other[rows, owner] > BOTH_SHARE * others[rows, owner])
    unclear |= ends & planes.sparse[rows, 1 - owner]
    # where the surface is seen to end right here, no strip is left beside it that could own the edge
    doubted: Array = ends & ~touches.ends_here[rows, owner]
    unclear |= doubted & crowded[rows, owner]
    unclear |= doubted & both & (~steep | uneven)[rows, 1 - owner]
    explained = planes.on_plane[rows, :, 1 - owner].sum(axis=1)
    between: Array = others[rows, owner] - explained
    unclear |= doubted & both & (others[rows, owner] >= FEW_BESIDE) & (between > BETWEEN_SHARE * others[rows, owner])
    unclear |= (
        ends
        & planes.empty[rows, 1 - owner]
        & (_lies_above(centroids, projecting, centre, up) | _may_hide_a_top(centroids, projecting, rays, centre, up))
    )
    # side 0 is the brighter one: what is darker and not measured is hardly the sky, rather a body that does not reflect
    unclear |= ends & (owner == 0) & planes.empty[:, 1]
    narrow: Array = doubted | (ends & (touches.faces_px[rows, owner] < FACE_PX))
    unclear |= narrow & _may_hide_a_face(normals, centroids, projecting, rays, centre)
    reasons = np.full(len(owner), EdgeRejection.NONE, dtype=np.int32)
    reasons[unclear] = EdgeRejection.OCCLUSION_UNCLEAR
    reasons[uneven[rows, owner] & ~same] = EdgeRejection.NO_PLANE
    reasons[~covered[rows, owner]] = EdgeRejection.NOT_COVERED
    reasons[~np.where(same, steep.any(axis=1), steep[rows, owner])] = EdgeRejection.GRAZING
    reasons[~(ranges[rows, owner] > 0.0).all(axis=1)] = EdgeRejection.GRAZING
    reasons[~exist.any(axis=1)] = EdgeRejection.NO_PLANE
    union_normals, union_centroids, _ = _united(planes)
    normals[same], centroids[same] = union_normals[same], union_centroids[same]
    counts = np.where(same, planes.counts.sum(axis=1), planes.counts[rows, owner])
    weights = np.where(same[:, None], planes.counts, sides & exist)
    return EdgeOwners(
        kinds=kinds.astype(np.int32),
        reasons=reasons,
        sides=sides,
        normals=normals,
        centroids=centroids,
        variances_m2=np.einsum("ns,ns->n", weights, variances_m2) / np.maximum(weights.sum(axis=1), 1e-9),
        counts=counts,
        rows=np.where(same, planes.rows.sum(axis=1), planes.rows[rows, owner]),
    )


def _may_hide_a_face(
    normals: Points, centroids: Points, projecting: Points, rays: Float64[Array, "n 3 3"], centre: Vector3
) -> Flags:
    """Tell where the camera looks at the face that bounds a body beside a surface's end, if the body is rectangular.

    Where that face is turned away, the surface's end is what the photo shows. Where it is not, and the points tell
    nothing of it, it is a narrow strip, and its far end as likely the edge of the photo as its near one.
    """
    across = projecting - np.einsum("ni,ni->n", projecting, normals)[:, None] * normals
    lengths = np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    inside = np.einsum("ni,ni->n", projecting, centroids - centre)
    outwards = -np.where(inside > 0.0, 1.0, -1.0)[:, None] * across / lengths
    return np.asarray((np.einsum("ni,nei->ne", outwards, rays) < -LEAST_TURN).any(axis=1))


def _lies_above(centroids: Points, projecting: Points, centre: Vector3, up: Vector3) -> Flags:
    """Tell which surfaces end downwards.

    Below bodies there is no sky. Where nothing is measured there, a body that reflects nothing back, or is seen too
    flatly, hides their lower end.
    """
    return np.asarray(_upwards(centroids, projecting, centre, up) < -DOWNWARDS)


def _may_hide_a_top(
    centroids: Points, projecting: Points, rays: Float64[Array, "n 3 3"], centre: Vector3, up: Vector3
) -> Flags:
    """Tell which surfaces end upwards below the camera, or hardly above it.

    Where nothing is measured beyond there need not be sky: a level top, as of a bank, is seen too flatly to be
    measured, and what the photo shows may be the far end of it, or a shadow on it.
    """
    below = (rays @ up < HORIZON).any(axis=1)
    return np.asarray((_upwards(centroids, projecting, centre, up) > DOWNWARDS) & below)


def _upwards(centroids: Points, projecting: Points, centre: Vector3, up: Vector3) -> Scalars:
    """Give how far upwards the normals of the projecting planes point on the side that is not the surface's."""
    inside = np.einsum("ni,ni->n", projecting, centroids - centre)
    return np.asarray(-np.where(inside > 0.0, 1.0, -1.0) * (projecting @ up))


def _steep_enough(
    planes: SidePlanes, projecting: Points, rays: Float64[Array, "n 3 3"], min_angle_rad: float
) -> Bool[Array, "n 2"]:
    """Tell which planes meet the projecting plane and its rays at a usable angle."""
    cosines = np.abs(np.einsum("nsi,ni->ns", planes.normals, projecting))
    incidence = np.abs(np.einsum("nsi,nei->nse", planes.normals, rays)).min(axis=2)
    return np.asarray((cosines < np.cos(min_angle_rad)) & (incidence > LEAST_INCIDENCE))


def _ranges(
    planes: SidePlanes, rays: Float64[Array, "n 3 3"], centre: Vector3, variances_m2: Float64[Array, "n 2"]
) -> tuple[Float64[Array, "n 2 3"], Float64[Array, "n 2 3"]]:
    """Give where the rays meet each plane, and the standard deviation of the plane's offset there [m]."""
    towards = np.einsum("nsi,nei->nse", planes.normals, rays)
    heights = np.einsum("nsi,nsi->ns", planes.normals, planes.centroids - centre)
    safe = np.where(np.abs(towards) > 1e-9, towards, 1e-9)
    ranges = np.where(planes.exist[:, :, None], heights[:, :, None] / safe, 0.0)
    values, vectors = np.linalg.eigh(planes.scatters)
    places = centre + ranges[:, :, :, None] * rays[:, None, :, :] - planes.centroids[:, :, None, :]
    along = np.einsum("nsei,nsik->nsek", places, vectors[:, :, :, 1:])
    weights = np.einsum("nsek,nsk->nse", along**2, 1.0 / np.maximum(values[:, :, 1:], 1e-12))
    weights += 1.0 / np.maximum(planes.counts, 1.0)[:, :, None]
    return ranges, np.sqrt(variances_m2[:, :, None] * weights)


def _depth_order(
    ranges: Float64[Array, "n 2 3"], stds: Float64[Array, "n 2 3"], planes: SidePlanes, rays: Float64[Array, "n 3 3"]
) -> tuple[Array, Flags, Flags]:
    """Give the nearer side of each edge, whether both meet there, and whether they change places along it.

    Differences are judged in the direction of the normals: along the ray a grazing surface is uncertain.
    """
    cosines = np.maximum(np.abs(np.einsum("nsi,nei->nse", planes.normals, rays)), LEAST_INCIDENCE)
    steps = ranges[:, 0] - ranges[:, 1]
    limits = UNEVENNESS_M / cosines.max(axis=1) + SIGNIFICANT * np.hypot(
        stds[:, 0] / cosines[:, 0], stds[:, 1] / cosines[:, 1]
    )
    first_farther, second_farther = steps > limits, steps < -limits
    crossing = first_farther.any(axis=1) & second_farther.any(axis=1)
    meets = ~(first_farther | second_farther).any(axis=1)
    nearer = np.where(first_farther.any(axis=1), 1, 0)
    return nearer, np.asarray(meets), np.asarray(crossing)


def _united(planes: SidePlanes) -> tuple[Points, Points, Scalars]:
    """Fit one plane to both sides: normals towards the camera, centroids, sums of squared residuals [m²]."""
    counts = planes.counts
    total = np.maximum(counts.sum(axis=1), 1.0)
    means = np.einsum("ns,nsi->ni", counts, planes.centroids) / total[:, None]
    apart = planes.centroids - means[:, None, :]
    scatters = planes.scatters.sum(axis=1) + np.einsum("ns,nsi,nsj->nij", counts, apart, apart)
    values, vectors = np.linalg.eigh(scatters)
    normals = np.ascontiguousarray(vectors[:, :, 0])
    normals *= np.where(np.einsum("ni,nsi->n", normals, planes.normals) < 0.0, -1.0, 1.0)[:, None]
    return normals, means, np.maximum(values[:, 0], 0.0)


def _one_plane(
    planes: SidePlanes,
    variances_m2: Float64[Array, "n 2"],
    ranges: Float64[Array, "n 2 3"],
    rays: Float64[Array, "n 3 3"],
) -> Flags:
    """Tell where both sides lie on one plane, by the noise or within the unevenness of buildings."""
    _, _, squares = _united(planes)
    apart = np.einsum("nsi,nsij,nsj->ns", planes.normals, planes.scatters, planes.normals)
    pooled = np.einsum("ns,ns->n", planes.counts, variances_m2) / np.maximum(planes.counts.sum(axis=1), 1.0)
    excess = (squares - apart.sum(axis=1)) / np.maximum(pooled, 1e-30)
    cosine = np.einsum("ni,ni->n", planes.normals[:, 0], planes.normals[:, 1])
    towards = np.abs(np.einsum("nsi,nei->nse", planes.normals, rays)).max(axis=1)
    steps = np.abs(ranges[:, 0] - ranges[:, 1]) * towards
    even = (cosine > np.cos(SAME_ANGLE_RAD)) & (steps < SAME_STEP_M).all(axis=1)
    return np.asarray((excess < SAME_CHI_SQUARE) | even)
