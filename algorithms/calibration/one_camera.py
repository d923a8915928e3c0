"""Whether photos show one camera, each once: repeated photos, changed zoom, photos turned by 180° (U-09).

A calibration of photos that differ in these adjusts without complaint, and is the camera of none of them.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import lstsq
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from algorithms.adjustment.hybrid.estimation import Estimate, estimate
from algorithms.adjustment.hybrid.network import Network
from algorithms.adjustment.hybrid.state import Kind
from algorithms.arrays import Array, Flags, Indices
from algorithms.calibration.starting import start_of
from algorithms.calibration.target_field import TargetField
from algorithms.errors import AlgorithmError, InvalidInputError
from algorithms.probabilities import chi2_isf

SAME_IN_STD = 0.3
"""Photos whose image points differ by less than this share of their standard deviation are one photo: the noise of two
exposures would make it 1.4, and what both have in common tells nothing twice."""
LEAST_COMMON = 4
"""So many targets two photos show before one can be a copy."""
LEAST_KNOWN = 6
"""A photo tells its principal distance from so many known targets."""
ALPHA, ALPHA_OF_ONE = 1e-6, 1e-4
"""Probabilities that photos of one camera are told apart, and that a photo that is not turned is named among others."""
ZOOMED_SHARE = 0.01
"""Principal distances that differ by less are no matter of zoom: focusing and the lens model do that."""
UNSURE_SHARES = (0.006, 0.002)
"""Standard deviation of a photo's own principal distance for the rest of the camera, as a share: of all photos, then of
one group."""
LARGEST_STD = 0.02
"""A photo whose own principal distance is less sure, as a share of it, belongs to no group."""
CLEARER = 0.5
"""Residuals fall to this share where photos of several cameras are told apart."""
TURNS_SIGN = ("p1", "p2", "P1", "P2")
"""Parameters of lenses that change their sign when the photo is turned by 180°."""
ITERATIONS = 60
"""Limit of rounds in each adjustment."""


def repeated_photos(field: TargetField, factor: float) -> list[tuple[int, int]]:
    """Find photos whose image points are those of an earlier photo, as pairs of later and earlier, O(photos²).

    Parameters
    ----------
    field
        Targets and photos.
    factor
        On the standard deviations of image points.
    """
    photos = len(field.photo_names)
    table = np.full((photos, len(field.targets), 2), np.nan)
    table[field.photos, field.points] = field.images / (factor * field.image_stds)
    found: list[tuple[int, int]] = []
    kept = np.zeros(photos, dtype=bool)
    for later in range(photos):
        apart = np.square(table[kept] - table[later])
        common = np.isfinite(apart).sum(axis=(1, 2))
        mean = np.nansum(apart, axis=(1, 2)) / np.maximum(common, 1)
        same = (common >= 2 * LEAST_COMMON) & (mean < SAME_IN_STD**2)
        if same.any():
            found.append((later, int(np.flatnonzero(kept)[np.argmax(same)])))
        kept[later] = not same.any()
    return found


@dataclass(frozen=True)
class _Distances:
    """Principal distances photo by photo."""

    photos: Indices
    """(n,) those that tell one, by increasing distance."""
    values: Array
    """(n,) [px]."""
    stds: Array
    """(n,) [px]."""


def require_one_distance(field: TargetField, found: Estimate) -> None:
    """Refuse photos of several principal distances, by name.

    Parameters
    ----------
    field
        Targets and photos; those of a camera on a head are not looked at, for they have one pose.
    found
        Adjustment of all photos as if of one camera, converged or not.

    Raises
    ------
    InvalidInputError
        Which photos have which principal distance.
    """
    if field.mount is not None or not field.unknown[0]:
        return
    known = np.bincount(field.photos, field.known[field.points], len(field.photo_names)) >= LEAST_KNOWN
    parameters = found.state.cameras[0, : len(field.lens.names)] if found.converged else field.parameters
    for share in UNSURE_SHARES:
        told = _distances(field, np.flatnonzero(known), parameters, share)
        groups = _groups(told)
        if len(groups) < 2:
            return
        parameters = _camera_of(
            field.with_photos(_flags(field, told.photos[max(groups, key=len)].tolist())), parameters
        )
    means = [float(np.average(told.values[each], weights=told.stds[each] ** -2.0)) for each in groups]
    apart = [
        _alone(field, photo, np.concatenate([[mean], parameters[1:]]), held=True).misfit
        for mean, each in zip(means, groups, strict=True)
        for photo in told.photos[each].tolist()
    ]
    if np.sqrt(np.mean(np.square(apart))) < CLEARER * _misfit(field, found):
        listed = "; ".join(
            f"{mean:.6g} px: {_listed([field.photo_names[k] for k in np.sort(told.photos[each])])}"
            for mean, each in zip(means, groups, strict=True)
        )
        raise InvalidInputError(
            "photos", f"they have {len(groups)} principal distances, as after a change of zoom or focus ({listed})",
            "calibrate the photos of each by themselves",
        )  # fmt: skip


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:10]) + (f" and {len(names) - 10} more" if len(names) > 10 else "")


def _flags(field: TargetField, photos: list[int]) -> Flags:
    return np.isin(np.arange(len(field.photo_names)), photos)


@dataclass(frozen=True)
class _Alone:
    """One photo of known targets."""

    distance: float
    """Its principal distance [px]."""
    std: float
    """From its own residuals; 0: it was held [px]."""
    misfit: float
    """Median length of its whitened residuals."""


def _alone(field: TargetField, photo: int, parameters: Array, *, held: bool = False) -> _Alone:
    """Fit a pose, and the principal distance unless it is held, to one photo.

    Raises
    ------
    InvalidInputError
        The photo cannot be placed.
    """
    part = field.with_points((field.photos == photo) & field.known[field.points])
    part = replace(part.with_photos(_flags(field, [photo])), shapes=np.zeros((0, 0)))
    part = replace(part, parameters=parameters)
    start, targets, count = start_of(part), part.targets[part.points], 6 if held else 7
    turn, camera = start.rotations[0].T, start.cameras[0, : len(parameters)]

    def lens(x: Array) -> Array:
        return camera if held else np.concatenate([[camera[0] * np.exp(x[6])], camera[1:]])

    def residuals(x: Array) -> Array:
        seen = targets @ (Rotation.from_rotvec(x[:3]).as_matrix() @ turn).T + x[3:6]
        return np.asarray((part.lens.misfit(seen, part.images, lens(x)).residuals / part.image_stds).ravel())

    first = np.zeros(count)
    first[3:6] = -turn @ start.positions[0]
    found = least_squares(residuals, first, method="lm")
    distance, std = float(lens(found.x)[0]), 0.0
    if not held:
        variance = 2.0 * found.cost / max(len(found.fun) - count, 1)
        upper = np.asarray(np.linalg.qr(np.asarray(found.jac, dtype=np.float64)).R)
        std = distance * float(np.sqrt(variance) / max(abs(float(upper[-1, -1])), 1e-300))
    lengths = np.linalg.norm(found.fun.reshape(-1, 2), axis=1)
    return _Alone(distance, std, float(np.median(lengths)))


def _distances(field: TargetField, photos: Indices, parameters: Array, share: float) -> _Distances:
    rows = []
    for photo in photos.tolist():
        with suppress(InvalidInputError):
            found = _alone(field, photo, parameters)
            if found.std > LARGEST_STD * found.distance:  # seen from the front, a board tells none
                continue
            rows.append((found.distance, photo, float(np.hypot(found.std, share * found.distance))))
    values, numbers, stds = (np.array(each) for each in zip(*sorted(rows), strict=True)) if rows else (np.zeros(0),) * 3
    return _Distances(numbers.astype(np.int64), values, stds)


def _groups(told: _Distances) -> list[Indices]:
    """Split distances where the two sides' means differ most, until no more than noise is left."""
    waiting, groups = [np.arange(len(told.values))], []
    while waiting:
        each = waiting.pop()
        values, weights = told.values[each], told.stds[each] ** -2.0
        below, sums = np.cumsum(weights)[:-1], np.cumsum(weights * values)[:-1]
        above = weights.sum() - below
        steps = ((weights * values).sum() - sums) / above - sums / below
        at = int(np.argmax(np.square(steps) / (1.0 / below + 1.0 / above))) if len(each) > 1 else -1
        if at >= 0 and steps[at] > ZOOMED_SHARE * values.mean() and (
            steps[at] ** 2 / (1.0 / below[at] + 1.0 / above[at]) > chi2_isf(ALPHA / len(each), 1)
        ):  # fmt: skip
            waiting += [each[at + 1 :], each[: at + 1]]
        else:
            groups.append(each)
    return groups


def _camera_of(field: TargetField, otherwise: Array) -> Array:
    """Calibrate a part of the photos; where that is not possible, keep what there is."""
    network = field.network()
    try:
        found = estimate(network, start_of(field), np.ones(len(network.stds)), ITERATIONS)
    except (AlgorithmError, np.linalg.LinAlgError):
        return otherwise
    sound = found.converged and not len(found.fictitious) and not found.defect.count
    return np.asarray(found.state.cameras[0, : len(field.lens.names)]) if sound else otherwise


def _misfit(field: TargetField, found: Estimate) -> float:
    """Return the median length of whitened residuals, photo by photo, in the mean [1]."""
    white = np.square(found.linearised.residuals[: 2 * len(field.photos)].reshape(-1, 2)).sum(axis=1)
    medians = [np.median(white[field.photos == photo]) for photo in np.unique(field.photos)]
    return float(np.sqrt(np.mean(medians)))


def turned_photos(field: TargetField, network: Network, found: Estimate) -> list[int]:
    """Find photos that fit the camera of the others when they are turned by 180°, O(photos²).

    Each photo's normal equations of the camera, its pose eliminated, are those of the turned camera after a linear
    substitution; so any choice of turned photos costs one small solution. At most half of the photos are named. Where
    targets are estimated too, no photo stands by itself, and none is looked at.

    Parameters
    ----------
    field
        Targets and photos of a camera that is not on a head.
    network, found
        Adjustment of all.
    """
    if field.mount is not None or not field.unknown[1:3].any() or not field.held[field.points].all():
        return []
    k = len(field.lens.names)
    free = np.flatnonzero(field.unknown)
    normals, rights, scales = _by_photo(field, network, found, free)
    signs = np.array([-1.0 if name in TURNS_SIGN else 1.0 for name in field.lens.names])
    signs[1:3] = -1.0
    camera = found.state.cameras[0, :k]
    offsets = np.zeros(k)
    offsets[1:3] = field.width - 1, field.height - 1
    apart = (signs * camera + offsets - camera)[free] / scales
    turn = signs[free]
    turned_normals = turn[:, None] * normals * turn
    pulled = np.einsum("nij,j->ni", normals, apart)
    turned_rights = turn * (rights - pulled)
    constants = pulled @ apart - 2.0 * rights @ apart

    def fitted(turned: Flags) -> tuple[float, Array, Array, Array]:
        normal = np.where(turned[:, None, None], turned_normals, normals)
        right = np.where(turned[:, None], turned_rights, rights)
        change = lstsq(normal.sum(axis=0), right.sum(axis=0))[0]
        return float(constants[turned].sum() - right.sum(axis=0) @ change), normal, right, change

    turned = np.zeros(len(normals), dtype=bool)
    unturned = least = fitted(turned)[0]
    while True:
        tried = []
        for photo in range(len(turned)):
            turned[photo] ^= True
            tried.append(fitted(turned)[0])
            turned[photo] ^= True
        best = int(np.argmin(tried))
        if not tried[best] < least - 1e-9 * abs(least):
            break
        turned[best] ^= True
        least = tried[best]
    # what photos differ by from their common camera anyway: noise, and what the lens model misses
    _, normal, right, change = fitted(turned)
    pulls = right - normal @ change
    spread = np.mean([pull @ lstsq(each, pull)[0] for each, pull in zip(normal, pulls, strict=True)]) / len(free)
    choices = 2.0 * np.log(2.0) * len(turned)
    if not unturned - least > spread * (chi2_isf(ALPHA, 1) + choices):
        return []
    told = np.array([each - least for each in tried]) > spread * chi2_isf(ALPHA_OF_ONE, 1)
    if 2 * turned.sum() > len(turned) or (2 * turned.sum() == len(turned) and turned[0]):
        turned = ~turned
    return np.flatnonzero(turned & told).tolist()


def _by_photo(field: TargetField, network: Network, found: Estimate, free: Indices) -> tuple[Array, Array, Array]:
    """Return normals (photos, q, q) and right sides (photos, q) without poses, and scales of the unknowns (q,)."""
    many = 2 * len(field.photos)
    roots = np.sqrt(found.weights[:many])  # what was left out of the adjustment pulls nothing
    jacobian = found.linearised.jacobian[:many].multiply(roots[:, None]).tocsr()
    columns = network.layout.columns
    by_camera = jacobian[:, columns[Kind.CAMERA][0, free]].toarray()
    scales = 1.0 / np.linalg.norm(by_camera, axis=0)
    system = np.column_stack([scales * by_camera, -roots * found.linearised.residuals[:many]])
    normals = np.empty((len(field.photo_names), len(free) + 1, len(free)))
    for photo, poses in enumerate(columns[Kind.POSE]):
        rows = np.repeat(field.photos == photo, 2)
        basis = np.linalg.qr(jacobian[rows][:, poses].toarray())[0]
        rest = system[rows] - basis @ (basis.T @ system[rows])
        normals[photo] = rest.T @ rest[:, :-1]
    return normals[:, :-1], normals[:, -1], scales


def with_turned(field: TargetField, turned: Sequence[int]) -> TargetField:
    """Turn the image points of some photos by 180° about the middle of the format."""
    rows = np.isin(field.photos, turned)[:, None]
    corner = np.array([field.width - 1.0, field.height - 1.0])
    return replace(field, images=np.where(rows, corner - field.images, field.images))
