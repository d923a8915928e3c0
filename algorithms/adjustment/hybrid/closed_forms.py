"""Poses and points without approximate values: similarity, resection, intersection, relative orientation (H-17, H-18).

Gross errors are expected: every form is solved from many smallest samples, and the one with the smallest median
misfit is taken (Rousseeuw 1984), then fitted to all that agree with it.
"""

from itertools import combinations

import numpy as np

from algorithms.arrays import Array, Matrix3, Points, Vector3
from algorithms.geometry.rotations import rotation_between_directions

MOST_SAMPLES = 200
INLIERS = 3.0
"""Misfits within so many robust standard deviations (1.4826 times the median) agree."""
LEAST_ANGLE_RAD = 0.03
"""Rays that meet at less say little of the distance."""
DOUBTFUL_RAD = 0.005
"""Rays that miss their common point by more are looked at once more, robustly."""
MANY_TIMES = 5.0
MOST_DOUBTFUL = 300
SEED = 7
PHOTO_AXES = np.diag([1.0, -1.0, -1.0])
"""From camera axes of the network (y up, looking along -z) to those of OpenCV (y down, looking along z)."""
FLAT = 1e-3
"""Points whose second extent is below this share of the first lie on a line."""


def samples(n: int, size: int) -> Array:
    """Give all smallest samples of n things, or many of them (MATH 1.8)."""
    possible = 1
    for k in range(size):
        possible = possible * (n - k) // (k + 1)
    if possible <= MOST_SAMPLES:
        return np.array(list(combinations(range(n), size)), dtype=np.int64)
    rng = np.random.default_rng(SEED)
    return np.array([rng.choice(n, size, replace=False) for _ in range(MOST_SAMPLES)], dtype=np.int64)


def similarity(source: Points, target: Points, *, with_scale: bool = False) -> tuple[float, Matrix3, Vector3]:
    """Fit target = s R source + t by least squares (Horn 1987; Umeyama 1991) (MATH 1.8)."""
    centre, other = source.mean(axis=0), target.mean(axis=0)
    rotation = rotation_between_directions(source - centre, target - other).as_matrix()
    turned = (source - centre) @ rotation.T
    scale = 1.0
    if with_scale:
        scale = float(np.vdot(turned, target - other) / max(float(np.vdot(turned, turned)), 1e-300))
    return scale, rotation, other - scale * rotation @ centre


def upright_motion(source: Points, target: Points) -> tuple[float, Matrix3, Vector3]:
    """Fit a turn about Z and a shift: what is left to find of a levelled station, from two points (MATH 1.8)."""
    centre, other = source.mean(axis=0), target.mean(axis=0)
    a, b = (source - centre)[:, :2], (target - other)[:, :2]
    angle = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return 1.0, rotation, other - rotation @ centre


def robust_similarity(
    source: Points, target: Points, *, with_scale: bool = False, upright: bool = False
) -> tuple[float, Matrix3, Vector3]:
    """Fit a similarity to what most points agree on (MATH 1.8)."""

    def fit(rows: Array) -> tuple[float, Matrix3, Vector3]:
        if upright:
            return upright_motion(source[rows], target[rows])
        return similarity(source[rows], target[rows], with_scale=with_scale)

    def misfits(found: tuple[float, Matrix3, Vector3]) -> Array:
        scale, rotation, shift = found
        return np.asarray(np.linalg.norm(scale * source @ rotation.T + shift - target, axis=1))

    size = 2 if upright else 3
    everything = np.arange(len(source))
    if len(source) <= size:
        return fit(everything)
    best, least = fit(everything), np.inf
    for rows in samples(len(source), size):
        if size == 3 and not spread_in_plane(source[rows]):
            continue
        found = fit(rows)
        middle = float(np.median(misfits(found)))
        if middle < least:
            best, least = found, middle
    agreeing = misfits(best) <= max(INLIERS * 1.4826 * least, 1e-9)
    return fit(np.flatnonzero(agreeing)) if agreeing.sum() >= size else best


def spread_in_plane(points: Points) -> bool:
    """Tell whether points are not on one line (MATH 1.8)."""
    sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(len(sizes) > 1 and sizes[1] > FLAT * max(sizes[0], 1e-300))


def resection(ideal: Array, points: Points) -> tuple[Matrix3, Vector3, float] | None:
    """Find the pose of a photo from points in it (Grunert; Gao et al. 2003, in OpenCV's form) (MATH 1.8).

    Parameters
    ----------
    ideal
        (n, 2) image points without distortion divided by the principal distance; n at least 4.
    points
        (n, 3) object points.

    Returns
    -------
    (3, 3) world from camera, (3,) position, median misfit [rad]; None where no pose shows the points in front.
    """
    import cv2

    flipped = ideal * np.array([1.0, -1.0])
    centre = points.mean(axis=0)
    best: tuple[Matrix3, Vector3, float] | None = None
    for rows in samples(len(points), 3):
        if not spread_in_plane(points[rows]):
            continue
        count, turns, shifts = cv2.solveP3P(
            (points[rows] - centre)[:, None, :], flipped[rows][:, None, :], np.eye(3), None, flags=cv2.SOLVEPNP_P3P
        )
        for k in range(count):
            rotation, shift = cv2.Rodrigues(turns[k])[0], shifts[k].ravel()
            misfit = _image_misfits(rotation, shift, points - centre, flipped)
            # the three fit whatever they are: the others decide
            middle = float(np.median(np.delete(misfit, rows)))
            if np.isfinite(middle) and (best is None or middle < best[2]):
                best = (rotation, shift, middle)
    if best is None:
        return None
    rotation, shift, middle = best
    misfit = _image_misfits(rotation, shift, points - centre, flipped)
    agreeing = misfit <= max(INLIERS * 1.4826 * middle, 1e-9)
    if agreeing.sum() >= 4:
        vector, better = cv2.solvePnPRefineLM(
            points[agreeing] - centre,
            flipped[agreeing],
            np.eye(3),
            None,
            cv2.Rodrigues(rotation)[0],
            shift[:, None].copy(),
        )
        refined = cv2.Rodrigues(vector)[0], better.ravel()
        if float(np.median(_image_misfits(*refined, points - centre, flipped))) <= 2.0 * middle + 1e-9:
            rotation, shift = refined
    return rotation.T @ PHOTO_AXES, centre - rotation.T @ shift, middle


def _image_misfits(rotation: Matrix3, shift: Vector3, points: Points, ideal: Array) -> Array:
    seen = points @ rotation.T + shift
    in_front = seen[:, 2] > 1e-9
    depth = np.where(in_front, seen[:, 2], 1.0)
    return np.where(in_front, np.linalg.norm(seen[:, :2] / depth[:, None] - ideal, axis=1), np.inf)


def intersection(origins: Points, directions: Points) -> Vector3 | None:
    """Intersect rays, from the pair that most of the others agree with; None where they are nearly parallel (MATH 1.8).

    Parameters
    ----------
    origins
        (n, 3) starts of the rays.
    directions
        (n, 3) unit vectors.
    """
    best, least = None, np.inf
    for i, j in samples(len(origins), 2):
        if np.linalg.norm(np.cross(directions[i], directions[j])) < LEAST_ANGLE_RAD:
            continue
        point = _nearest(origins[[i, j]], directions[[i, j]])
        arms = point - origins
        lengths = np.einsum("ni,ni->n", arms, directions)
        across = np.linalg.norm(arms - lengths[:, None] * directions, axis=1)
        angles = np.where(lengths > 0.0, across / np.maximum(np.abs(lengths), 1e-12), np.pi)
        middle = float(np.median(angles))
        if middle < least and lengths[i] > 0.0 and lengths[j] > 0.0:
            best, least = point, middle
    return best


def intersections(numbers: Array, origins: Array, directions: Array) -> tuple[Array, Array]:
    """Intersect the rays of many points: by least squares, and robustly where single rays disagree (MATH 1.8).

    Parameters
    ----------
    numbers
        (n,) point of each ray.
    origins, directions
        (n, 3) of the rays.

    Returns
    -------
    (k,) points that have an intersection, (k, 3) where it is.
    """
    found, of, counts = np.unique(numbers, return_inverse=True, return_counts=True)
    projectors = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    sums, right = np.zeros((len(found), 3, 3)), np.zeros((len(found), 3))
    np.add.at(sums, of, projectors)
    np.add.at(right, of, np.einsum("nij,nj->ni", projectors, origins))
    # with one direction the smallest eigenvalue is zero; with two that meet at an angle a it is about a²/2
    good = (counts > 1) & (np.linalg.eigvalsh(sums)[:, 0] > 0.5 * LEAST_ANGLE_RAD**2)
    places = np.zeros((len(found), 3))
    places[good] = np.linalg.solve(sums[good], right[good][:, :, None])[:, :, 0]
    arms = places[of] - origins
    lengths = np.einsum("ni,ni->n", arms, directions)
    across = np.linalg.norm(arms - lengths[:, None] * directions, axis=1)
    angles = np.where(lengths > 0.0, across / np.maximum(np.abs(lengths), 1e-12), np.pi)
    worst = np.zeros(len(found))
    np.maximum.at(worst, of, angles)
    # with rough poses all rays miss: only what misses by much more than usual is worth a second look
    usual = float(np.median(worst[good])) if good.any() else 0.0
    doubtful = np.flatnonzero(good & (worst > max(DOUBTFUL_RAD, MANY_TIMES * usual)) & (counts > 2))
    for k in doubtful[np.argsort(-worst[doubtful])][:MOST_DOUBTFUL]:
        rays = of == k
        place = intersection(origins[rays], directions[rays])
        if place is not None:
            places[k] = place
    return found[good], places[good]


def _nearest(origins: Points, directions: Points) -> Vector3:
    projectors = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    right = np.einsum("nij,nj->i", projectors, origins)
    return np.asarray(np.linalg.solve(projectors.sum(axis=0), right))


def relative_orientation(first: Array, second: Array) -> tuple[Matrix3, Vector3] | None:
    """Find the pose of a second photo in the frame of the first, base length 1 (Nistér 2004; MATH 1.8).

    Parameters
    ----------
    first, second
        (n, 2) image points without distortion divided by the principal distance; n at least 6.
    """
    import cv2

    cv2.setRNGSeed(SEED)
    flip = np.array([1.0, -1.0])
    essential, mask = cv2.findEssentialMat(first * flip, second * flip, np.eye(3), cv2.RANSAC, 0.9999, 2e-3)
    if essential is None or essential.shape != (3, 3):
        return None
    seen, rotation, shift, _ = cv2.recoverPose(essential, first * flip, second * flip, np.eye(3), mask=mask)
    if seen < 5:
        return None
    return PHOTO_AXES @ rotation.T @ PHOTO_AXES, PHOTO_AXES @ (-rotation.T @ shift.ravel())
