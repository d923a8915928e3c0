"""By how much each photo seems to be turned against the others: a wrong mount shows as colours that do not fit."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float64, Int64
from scipy import stats

from algorithms.arrays import Array, Points, Vector3, Vectors2
from algorithms.colouring.balance import BRIGHTEST, DARKEST, LEAST_COMMON, Balance
from algorithms.colouring.photo_views import PlacedPhoto, View, sampled

BLURS_PX = (6.0, 3.0, 1.5)
"""Standard deviations of the blur of the photos, one round each: shifts of about as many pixels are found."""
PRIOR_STD_RAD = 0.02
"""Photos are turned by no more than about this [rad]."""
ROBUST = 1.345
SIGNIFICANCE = 0.001
LARGEST_SHARE = 0.3
"""A difference of logarithms beyond this is something else: glints, moved things, wrong depth."""
CELL_BLURS = 3.0
"""Samples within a square of so many standard deviations of the blur are no independent observations."""


@dataclass(frozen=True, eq=False)
class PhotoMisfit:
    """A photo against the others."""

    rotation_rad: Vector3
    """Rotation vector in camera axes that would make it fit best: x turns it up, y right, z clockwise [rad]."""
    std_rad: Vector3
    """Standard deviations; `PRIOR_STD_RAD` where nothing is shared with other photos."""
    statistic: float
    """Squared rotation in standard deviations: chi-square with three degrees of freedom where the mount is right."""
    points: int
    """Points that other photos show as well."""

    @property
    def significant(self) -> bool:
        """Tell whether the mount is surely wrong."""
        return bool(self.points > 0 and stats.chi2.sf(self.statistic, 3) < SIGNIFICANCE)


@dataclass(frozen=True, eq=False)
class _Look:
    """One photo at points that it shows: brightness as logarithm, and how that changes when the camera turns."""

    values: Float64[Array, "n"]
    slopes: Float64[Array, "n 3"]
    pixels: Vectors2


def photo_misfits(
    points: Points,
    views: Sequence[View],
    photos: Sequence[PlacedPhoto],
    place: Int64[Array, "all"],
    balance: Balance,
) -> list[PhotoMisfit]:
    """Estimate small rotations of all photos that make the brightness of common points equal.

    The differences of log brightness of two photos are linear in the rotations of both through the gradients of the
    photos (B. Lucas, T. Kanade, An iterative image registration technique, 1981); all rotations are solved together,
    with the prior that mounts are right within `PRIOR_STD_RAD`.

    Parameters
    ----------
    points
        (n, 3) sample of the cloud.
    views, photos
        What each photo shows of the whole cloud.
    place
        For every point of the cloud its row in the sample, or -1.
    balance
        Of the photos.
    """
    count = len(photos)
    turns = np.zeros((count, 3))
    covariance = np.eye(3 * count) * PRIOR_STD_RAD**2
    shared = np.zeros(count, dtype=np.int64)
    for blur in BLURS_PX:
        looks = [
            _look(points, view, photo, place, balance.log_gains[k], balance.log_fall_off, turns[k], blur)
            for k, (view, photo) in enumerate(zip(views, photos, strict=True))
        ]
        step, covariance, shared = _solved(looks, turns, blur)
        turns = turns + step
    out = []
    for k in range(count):
        own = covariance[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
        statistic = float(turns[k] @ np.linalg.solve(own, turns[k]))
        out.append(PhotoMisfit(turns[k], np.sqrt(np.diag(own)), statistic, int(shared[k])))
    return out


def _look(
    points: Points,
    view: View,
    photo: PlacedPhoto,
    place: Array,
    log_gains: Vector3,
    log_fall_off: Vector3,
    turn: Vector3,
    blur_px: float,
) -> _Look:
    """Sample a photo, turned by what is known already."""
    values, slopes, places = np.full(len(points), np.nan), np.zeros((len(points), 3)), np.zeros((len(points), 2))
    drawn = place[view.numbers] >= 0
    rows = place[view.numbers[drawn]]
    if len(rows) == 0:
        return _Look(values, slopes, places)
    camera = photo.camera
    in_camera = photo.common_from_camera.inv().apply(points[rows])
    in_camera = in_camera + np.cross(turn, in_camera)
    good = camera.projectable(in_camera)
    rows, in_camera, radius = rows[good], in_camera[good], view.radius[drawn][good]
    ideal = camera.ideal_from_camera(in_camera)
    pixels = camera.image_from_ideal(ideal)
    # brightness alone: colours add little, and gains are taken out of each
    weights = np.exp(-log_gains) / 3.0
    grey = np.asarray(photo.read(), dtype=np.float32) @ weights.astype(np.float32)
    low = cv2.GaussianBlur(np.log(np.maximum(grey, DARKEST)), (0, 0), blur_px)
    across, down = cv2.Sobel(low, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(low, cv2.CV_32F, 0, 1, scale=0.125)
    looked = sampled(np.stack([low, across, down], axis=2).astype(np.float64), pixels)
    bright = (looked[:, 0] > np.log(DARKEST) + 1e-3) & (looked[:, 0] < np.log(BRIGHTEST))
    # d pixel / d turn, as the point moves by turn x point
    turning = np.stack([np.cross(axis, in_camera) for axis in np.eye(3)], axis=2)
    moved = np.einsum(
        "nij,njk,nkl->nil", camera.image_jacobians(ideal), camera.projection_jacobians(in_camera), turning
    )
    places[rows] = pixels
    slopes[rows] = np.einsum("ni,nil->nl", looked[:, 1:], moved)
    values[rows] = np.where(bright, looked[:, 0] - radius**2 * log_fall_off.mean(), np.nan)
    return _Look(values, slopes, places)


def _solved(looks: Sequence[_Look], turns: Array, blur_px: float) -> tuple[Array, Array, Array]:
    """Solve for the next step of all rotations: (photos, 3), covariance of all, and shared points (photos,)."""
    count = len(looks)
    normal, right = np.eye(3 * count) / PRIOR_STD_RAD**2, -turns.ravel() / PRIOR_STD_RAD**2
    shared = np.zeros(count, dtype=np.int64)
    for i in range(count):
        for j in range(i + 1, count):
            difference = looks[i].values - looks[j].values
            both = np.flatnonzero(np.isfinite(difference))
            if len(both) < LEAST_COMMON:
                continue
            difference = difference[both] - np.median(difference[both])
            scale = max(1.4826 * float(np.median(np.abs(difference))), 1e-4)
            near = np.abs(difference) < max(LARGEST_SHARE, 3.0 * scale)
            both, difference = both[near], difference[near]
            shared[[i, j]] += len(both)
            weight = np.minimum(1.0, ROBUST * scale / np.maximum(np.abs(difference), 1e-12)) / scale**2
            # samples nearer than the blur repeat each other
            weight /= _repeats(looks[i].pixels[both], blur_px)
            design = np.hstack([looks[i].slopes[both], -looks[j].slopes[both]])
            own = np.r_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
            normal[np.ix_(own, own)] += design.T @ (weight[:, None] * design)
            right[own] -= design.T @ (weight * difference)
    covariance = np.linalg.inv(normal)
    return (covariance @ right).reshape(count, 3), covariance, shared


def _repeats(pixels: Vectors2, blur_px: float) -> float:
    """Give how many samples on average lie in one square as wide as the blur: these repeat each other."""
    squares = np.unique(np.floor(pixels / (CELL_BLURS * blur_px)), axis=0)
    return len(pixels) / max(len(squares), 1)
