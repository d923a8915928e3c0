"""How sure a calibrated camera projects, over its format and at chosen distances (as mrcal does: D. Kogan)."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.adjustment.hybrid.state import Kind
from algorithms.arrays import Array
from algorithms.calibration.lenses import Lens
from algorithms.calibration.solution import Calibration
from algorithms.geometry.rotations import cross_matrices

FITTED_ROUNDS = 20


@dataclass(frozen=True, eq=False)
class ProjectionMap:
    """Figures at points of the format."""

    image: Array
    """(g, 2) columns and rows [px]."""
    distance_m: float
    """From the camera."""
    stds: Array
    """(g,) standard deviation of the image of a fixed point in the worst direction [px]."""
    object_stds: Array
    """(g,) the same across the ray at the object [m]."""


def format_grid(width: int, height: int, columns: int = 9, rows: int = 7) -> Array:
    """Give (g, 2) points of the format, half a cell from its rims."""
    across = (np.arange(columns) + 0.5) * width / columns - 0.5
    down = (np.arange(rows) + 0.5) * height / rows - 0.5
    return np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)


def projection_map(done: Calibration, image: Array, distance_m: float) -> ProjectionMap:
    """Propagate the covariance of camera and poses to the image of points that are fixed to the targets (MATH 5.1).

    A point on the ray of each image point is fixed in the frame of the targets as each photo's pose sees it; errors of
    the poses carry it along, their mean over all photos counts. What camera and poses can exchange without changing
    any observation therefore does not count, and nothing has to be fitted.

    Parameters
    ----------
    done
        A calibration.
    image
        (g, 2) columns and rows [px].
    distance_m
        Of the points from the camera [m].
    """
    lens, state = done.field.lens, done.state
    columns = done.network.layout.columns
    parameters = done.parameters
    seen = on_sphere(lens, image, parameters, distance_m)
    found = lens.misfit(seen, image, parameters)
    u = done.network.layout.count
    gradients = np.zeros((len(image), 2, u + 1))  # the last column takes what is constant
    # a backward lens corrects the measured point: the image moves by the inverse of that
    by_image = _image_derivatives(lens, image, parameters)
    to_image = -np.linalg.inv(by_image)
    gradients[:, :, columns[Kind.CAMERA][0, : len(parameters)]] = to_image @ found.by_parameters
    by_seen = to_image @ found.by_seen
    photos = len(state.positions)
    if done.field.mount is None:
        for k in range(photos):
            _add(gradients, columns[Kind.POSE][k, :3], by_seen @ cross_matrices(seen) / photos)
            _add(gradients, columns[Kind.POSE][k, 3:], -by_seen @ state.rotations[k].T / photos)
    else:
        turn, place = state.mount_rotations[1], state.mount_positions[1]
        in_head = seen @ turn.T + place
        by_head = by_seen @ turn.T
        _add(gradients, columns[Kind.MOUNT][1, :3], by_seen @ cross_matrices(seen))
        _add(gradients, columns[Kind.MOUNT][1, 3:], -by_head)
        for k in range(photos):
            _add(gradients, columns[Kind.POSE][k, :3], by_head @ cross_matrices(in_head) / photos)
    rows = gradients[:, :, :u].reshape(-1, u)
    solved = done.estimate.factor.solved(np.ascontiguousarray(rows.T)).T
    covariances = rows.reshape(-1, 2, u) @ np.swapaxes(solved.reshape(-1, 2, u), 1, 2)
    stds = np.sqrt(np.maximum(np.linalg.eigvalsh(covariances)[:, -1], 0.0))
    return ProjectionMap(image, distance_m, stds, object_stds(lens, image, parameters, distance_m, covariances))


def object_stds(lens: Lens, image: Array, parameters: Array, distance_m: float, covariances: Array) -> Array:
    """Carry covariances of image points (g, 2, 2) [px²] to the sphere of that radius: worst std (g,) [m] (MATH 5.1)."""
    step = 0.5
    here = on_sphere(lens, image, parameters, distance_m)
    columns = [(on_sphere(lens, image + step * unit, parameters, distance_m) - here) / step for unit in np.eye(2)]
    across = np.stack(columns, axis=2)
    spread = across @ covariances @ np.swapaxes(across, 1, 2)
    return np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[:, -1], 0.0))


def _add(gradients: Array, columns: Array, values: Array) -> None:
    for place, column in enumerate(columns):
        gradients[:, :, column] += values[:, :, place]


def _image_derivatives(lens: Lens, image: Array, parameters: Array) -> Array:
    """Differentiate the contradictions by the measured image point, (g, 2, 2)."""
    rays, step = lens.rays(image, parameters), 1e-3
    columns = [
        (lens.misfit(rays, image + step * unit, parameters).residuals
         - lens.misfit(rays, image - step * unit, parameters).residuals) / (2.0 * step)
        for unit in np.eye(2)
    ]  # fmt: skip
    return np.stack(columns, axis=2)


def by_lens(lens: Lens, image: Array, parameters: Array) -> Array:
    """Differentiate the image of fixed rays by the parameters of the lens, (g, 2, k) (MATH 5.1)."""
    found = lens.misfit(lens.rays(image, parameters), image, parameters)
    return np.asarray(-np.linalg.solve(_image_derivatives(lens, image, parameters), found.by_parameters))


def on_sphere(lens: Lens, image: Array, parameters: Array, distance_m: float) -> Array:
    """Give the points (g, 3) at a distance that have these images."""
    rays = lens.rays(image, parameters)
    return np.asarray(distance_m * rays / np.linalg.norm(rays, axis=1, keepdims=True))


def by_turn(lens: Lens, rays: Array, image: Array, parameters: Array) -> Array:
    """Differentiate the images of rays (g, 3) by a turn of them, (g, 2, 3) [px/rad] (MATH 5.1)."""
    found = lens.misfit(rays, image, parameters)
    by_seen = -np.linalg.solve(_image_derivatives(lens, image, parameters), found.by_seen)
    return np.asarray(-by_seen @ cross_matrices(rays))


def differences(first: tuple[Lens, Array], second: tuple[Lens, Array], image: Array) -> Array:
    """Project the rays of one camera with another, after the turn between their frames that brings both nearest.

    Points are taken as far away: a nearer frame would hide what differs in principal distance.

    Parameters
    ----------
    first, second
        Lenses and parameters.
    image
        (g, 2) of the first camera.

    Returns
    -------
    (g, 2) second minus first [px].
    """
    (lens, parameters), (other, others) = first, second
    rays = on_sphere(lens, image, parameters, 1.0)
    for _ in range(FITTED_ROUNDS):
        moved = other.image(rays, others, image)
        design = by_turn(other, rays, moved, others).reshape(-1, 3)
        step = -np.linalg.lstsq(design, (moved - image).ravel(), rcond=None)[0]
        rays = rays @ Rotation.from_rotvec(step).as_matrix().T
        if np.abs(step).max() < 1e-12:
            break
    return np.asarray(other.image(rays, others, image) - image)


def expected_differences(lens: Lens, parameters: Array, covariance: Array, image: Array) -> Array:
    """Give the covariances (g, 2, 2) of what `differences` leaves of errors of the lens (MATH 5.1).

    Parameters
    ----------
    lens, parameters
        Of either camera.
    covariance
        (k, k) of the difference of their parameters.
    image
        (g, 2).
    """
    rays = on_sphere(lens, image, parameters, 1.0)
    turns = np.linalg.qr(by_turn(lens, rays, image, parameters).reshape(-1, 3))[0]
    effects = by_lens(lens, image, parameters).reshape(-1, len(parameters))
    effects = (effects - turns @ (turns.T @ effects)).reshape(len(image), 2, -1)
    return np.asarray(effects @ covariance @ np.swapaxes(effects, 1, 2))
