"""Planes and heights that are known: control patches (Kager 2003, 2.1)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from algorithms.arrays import Array, Matrix3, Points, Vector3
from algorithms.errors import InvalidInputError
from algorithms.strips.candidates import frames_of
from algorithms.strips.homologous import PointCells
from algorithms.strips.strip import Strip

FLAT = 0.02
"""Least ratio of the middle to the largest extent of control points that make a plane."""
LEAST_NEAR = 6
LEAST_FOR_BEND, BEND_FITS, FAR = 20, 5, 3.0
"""Points that tell how a surface bends; fits of it, each without what is further off than so many deviations."""
LEAST_SHARE = 0.4
"""Of the radius of other patches, to which small control planes are enlarged: their points are measured inside."""


@dataclass(frozen=True, eq=False)
class ControlPatch:
    """Points on one plane, or one point on a surface that is smooth around it."""

    name: str
    points_m: Points
    """(k, 3) in the reduced common frame [m]; four on the source's advice, the fourth as a check."""
    std_m: Points
    """(k, 3) standard deviations of the coordinates [m]."""

    @property
    def middle_m(self) -> Vector3:
        """Mean of its points [m]."""
        return np.asarray(self.points_m.mean(axis=0))

    def radius_m(self, most_m: float) -> float:
        """Give how far points of strips around its middle are on its plane: to the nearest side of its outline [m].

        Of single points, and points on a line, that is `most_m`.
        """
        if _normal(self.points_m) is None:
            return most_m
        corners = self.points_m[ConvexHull(self.points_m[:, :2]).vertices, :2]
        sides = np.roll(corners, -1, axis=0) - corners
        to_middle = self.middle_m[:2] - corners
        nearest = np.abs(sides[:, 0] * to_middle[:, 1] - sides[:, 1] * to_middle[:, 0]) / np.hypot(*sides.T)
        return float(np.clip(nearest.min(), LEAST_SHARE * most_m, most_m))

    def frame(self, strips: Sequence[Strip], cells: Sequence[PointCells], radius_m: float) -> Matrix3 | None:
        """Give columns e1, e2, normal of its plane; None where too few points tell it.

        The normal is that of the control points, or where these are fewer than three, or on a line, that of the
        points of all strips around.

        Raises
        ------
        InvalidInputError
            A plane of control points that is a wall.
        """
        normal = _normal(self.points_m)
        if normal is None:
            # of each strip about its own middle: gaps between strips say nothing of the slope
            centred = [points - points.mean(axis=0) for points in self._near(strips, cells, radius_m)]
            normal = _normal(np.concatenate(centred)) if centred else None
        if normal is None:
            return None
        if abs(normal[2]) < 0.1:
            raise InvalidInputError(
                f"control {self.name}", "its points lie on a wall", "give roofs, banks or level ground, seen from above"
            )
        return np.asarray(frames_of(normal[None] * np.sign(normal[2]))[0])

    def on_plane(
        self, frame: Matrix3, strips: Sequence[Strip], cells: Sequence[PointCells], radius_m: float
    ) -> tuple[Points, Points]:
        """Give its points and their standard deviations (k, 3) as a plane of the patch has them [m].

        Single points, and points on a line, lie on a surface that is smooth but may bend; the plane through a bowl lies
        above its middle. With q = a u² + b u v + c v², fitted to the points of all strips around, a known point is
        moved along the normal by the mean (a + c) r² / 4 of q over the patch less q at the point.
        """
        near = self._near(strips, cells, radius_m)
        if _normal(self.points_m) is not None or sum(len(points) for points in near) < LEAST_FOR_BEND:
            return self.points_m, self.std_m
        local = [(points - self.middle_m) @ frame for points in near]
        own = (self.points_m - self.middle_m) @ frame
        mean = np.array([0.25, 0.0, 0.25]) * radius_m**2
        rows = mean - np.column_stack([own[:, 0] ** 2, own[:, 0] * own[:, 1], own[:, 1] ** 2])
        bend, covariance = _bend(local)
        variance = np.einsum("ki,ij,kj->k", rows, covariance, rows)
        return (
            self.points_m + (rows @ bend)[:, None] * frame[:, 2],
            np.sqrt(self.std_m**2 + variance[:, None]),
        )

    def _near(self, strips: Sequence[Strip], cells: Sequence[PointCells], radius_m: float) -> list[Array]:
        """Give the points of each strip that has enough of them around."""
        near = [_around(strip.points, cell, self.middle_m, radius_m) for strip, cell in zip(strips, cells, strict=True)]
        return [points for points in near if len(points) >= LEAST_NEAR]


def _bend(local: Sequence[Array]) -> tuple[Vector3, Matrix3]:
    """Fit a u² + b u v + c v² to points u, v, w of strips, each with its own height; give (a, b, c), covariance."""
    u, v, w = np.concatenate(local).T
    strips = np.repeat(np.arange(len(local)), [len(points) for points in local])
    design = np.column_stack([u * u, u * v, v * v, u, v, strips[:, None] == np.arange(len(local))])
    used = np.ones(len(w), dtype=np.bool_)
    for _ in range(BEND_FITS):
        unknowns = np.linalg.lstsq(design[used], w[used], rcond=None)[0]
        off = np.abs(w - design @ unknowns)
        used = off <= FAR * 1.4826 * np.median(off)
    unknowns = np.linalg.lstsq(design[used], w[used], rcond=None)[0]
    variance = float(((w - design @ unknowns)[used] ** 2).sum()) / max(int(used.sum()) - design.shape[1], 1)
    cofactors = np.linalg.pinv(design[used].T @ design[used])
    return unknowns[:3], variance * cofactors[:3, :3]


def _normal(points: Points) -> Vector3 | None:
    if len(points) < 3:
        return None
    _, values, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    return np.asarray(axes[2]) if values[1] > FLAT * max(values[0], 1e-9) else None


def _around(points: Points, cells: PointCells, place: Vector3, radius_m: float) -> Array:
    """Give the points within a radius in plan."""
    reach = int(np.ceil(radius_m / cells.edge_m))
    column, row = (int(np.floor((place[k] - low) / cells.edge_m)) for k, low in ((0, cells.x0), (1, cells.y0)))
    first, last = max(column - reach, 0), min(column + reach, cells.columns - 1)
    found = [
        cells.order[cells.starts[r * cells.columns + first] : cells.starts[r * cells.columns + last + 1]]
        for r in range(max(row - reach, 0), min(row + reach, cells.rows - 1) + 1)
        if first <= last
    ]
    if not found:
        return np.zeros((0, 3))
    near = points[np.concatenate(found)]
    return np.asarray(near[np.hypot(*(near[:, :2] - place[:2]).T) <= radius_m])
