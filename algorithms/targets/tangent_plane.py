"""The plane of a flat target, and where beams meet it."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Matrix3, Points, Scalars, Vector3, Vectors2
from algorithms.geometry.lines import bases_of

CLIPPING_SIGMAS = 3.0
LEAST_POINTS = 6


@dataclass(frozen=True, eq=False)
class TangentPlane:
    """A plane seen from the origin."""

    centre_m: Vector3
    """(3,) a point of it [m]."""
    normal: Vector3
    """(3,) unit normal towards the instrument."""
    basis: Array
    """(3, 2) two unit directions in it; the first is horizontal where the plane is not."""
    offset_std_m: float
    """Standard deviation of its distance from the origin at the centre [m]."""
    noise_m: float
    """Standard deviation of single points across it [m]."""
    told: bool = True
    """Whether points tell its normal."""

    @property
    def incidence_rad(self) -> float:
        """Angle between the beam to the centre and the normal."""
        cosine = abs(float(self.normal @ self.centre_m)) / float(np.linalg.norm(self.centre_m))
        return float(np.arccos(min(cosine, 1.0)))

    def met_by(self, points: Points) -> tuple[Vectors2, Scalars]:
        """Give where the beams to points meet the plane, (n, 2) about its centre, and how far the points are from
        there, (n,) [m].

        The noise of the ranges leaves the places in the plane untouched: only the beam's direction tells them.
        """
        height = float(self.normal @ self.centre_m)
        towards = points @ self.normal
        safe = np.where(np.abs(towards) > 1e-9, towards, 1e-9)
        met = points * (height / safe)[:, None]
        return (met - self.centre_m) @ self.basis, np.asarray(np.linalg.norm(met - points, axis=1))

    def in_space(self, place: Array) -> Vector3:
        """Give a place (2,) of the plane in space, (3,) [m]."""
        return np.asarray(self.centre_m + self.basis @ place)

    def covariance_of(self, place: Array, covariance: Array) -> Matrix3:
        """Give the covariance (3, 3) of a place (2,) that is known by its direction: its own (2, 2), and along the beam
        what the plane's distance is worth there [m²].
        """
        beam = self.in_space(place)
        beam = beam / np.linalg.norm(beam)
        along = self.offset_std_m / abs(float(self.normal @ beam))
        return np.asarray(self.basis @ covariance @ self.basis.T + along**2 * np.outer(beam, beam))


def plane_across(centre_m: Vector3, offset_std_m: float) -> TangentPlane:
    """Give the plane through a place, across the beam to it."""
    normal = -centre_m / np.linalg.norm(centre_m)
    return TangentPlane(centre_m, normal, plane_basis(normal), offset_std_m, offset_std_m, told=False)


def plane_through(points: Points) -> TangentPlane | None:
    """Fit a plane to points, those beyond three standard deviations left out; None where they do not span one."""
    kept = points
    centre = normal = np.zeros(3)
    noise = 0.0
    for _ in range(5):
        if len(kept) < LEAST_POINTS:
            return None
        centre = kept.mean(axis=0)
        values, axes = np.linalg.eigh((kept - centre).T @ (kept - centre))
        if values[1] < 1e-3 * values[2] or values[1] <= 2.0 * values[0]:
            return None
        normal = axes[:, 0]
        across = (points - centre) @ normal
        noise = float(np.sqrt(max(float(values[0]), 0.0) / (len(kept) - 3)))
        near = np.abs(across) <= max(CLIPPING_SIGMAS * noise, 1e-9)
        if np.count_nonzero(near) == len(kept):
            break
        kept = points[near]
    normal = -normal if normal @ centre > 0.0 else normal
    return TangentPlane(centre, normal, plane_basis(normal), noise / float(np.sqrt(len(kept))), noise)


def plane_basis(normal: Vector3) -> Array:
    """Give two unit directions (3, 2) across a normal, the first horizontal where that is one direction."""
    horizontal = np.array([-normal[1], normal[0], 0.0])
    length = float(np.linalg.norm(horizontal))
    if length < 1e-3:
        return np.asarray(bases_of(normal[None, :])[0])
    horizontal = horizontal / length
    return np.column_stack([horizontal, np.cross(normal, horizontal)])
