"""Rendered photos with known straight edges, and how found ones compare with them."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from algorithms.geometry.cameras import Camera
from algorithms.photos.detector import detect_edges
from algorithms.photos.options import EdgeOptions
from algorithms.progress import NoProgress

PIXEL_STD = 1.0 / np.sqrt(12.0)
"""A pixel averages over its area: to second order a Gaussian of this width [px]."""


@dataclass(frozen=True)
class EdgePhoto:
    """A rendered photo and its true edges."""

    image: np.ndarray
    edges: np.ndarray
    """(n, 4) x, y of both ends in ideal pixels; the darker side lies on the left seen on the screen, y down."""
    contrasts: np.ndarray


def rectangles(
    rng, *, size=(640, 480), across=3, contrast=(40.0, 40.0), blur=1.0, noise=4.0, camera: Camera | None = None
) -> EdgePhoto:
    """Render blurred, turned rectangles on a regular grid, brighter or darker than their ground, with white noise."""
    width, height = size
    values = np.full((height, width), 120.0)
    edges, contrasts = [], []
    std = np.hypot(blur, PIXEL_STD)
    cell = np.array([width, height]) / across
    for i in range(across):
        for j in range(across):
            middle = (np.array([i, j]) + 0.5) * cell
            centre = middle if camera is None else camera.ideal_from_image(middle[None])[0]
            a, b = rng.uniform(0.25, 0.33, 2) * cell.min()
            angle, step = rng.uniform(0.0, np.pi), rng.uniform(*contrast) * rng.choice([-1.0, 1.0])
            u, v = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
            reach = 1.1 * np.hypot(a, b) + 6.0 * std
            left, top = np.maximum(0, np.floor(middle - reach)).astype(int)
            right, bottom = np.ceil(middle + reach).astype(int)
            window = np.s_[top : min(bottom, height), left : min(right, width)]
            ideal = np.stack(np.mgrid[window][::-1], axis=-1).astype(np.float64)
            if camera is not None:
                ideal = camera.ideal_from_image(ideal.reshape(-1, 2)).reshape(ideal.shape)
            p, q = (ideal - centre) @ u, (ideal - centre) @ v
            inside = (ndtr((p + a) / std) - ndtr((p - a) / std)) * (ndtr((q + b) / std) - ndtr((q - b) / std))
            values[window] += step * inside
            corners = [centre + s * a * u + t * b * v for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            for k in range(4):
                ends = (corners[k], corners[(k + 1) % 4])
                # the normal (-d_y, d_x) of this order points into the rectangle
                edges.append(np.concatenate(ends if step > 0.0 else ends[::-1]))
                contrasts.append(abs(step))
    image = values + rng.normal(0.0, noise, values.shape) if noise > 0.0 else values
    grey = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    return EdgePhoto(grey, np.array(edges), np.array(contrasts))


def find(image, camera=None, **options):
    """Find edges with the default options but those given."""
    return detect_edges(image, camera, EdgeOptions(**options), progress=NoProgress())


@dataclass(frozen=True)
class Comparison:
    """Found edges that belong to true ones: errors, stated standard deviations, and what was found."""

    offsets: np.ndarray
    """Signed distance of the found edge from the true one, positive to the brighter side [px]."""
    angles: np.ndarray
    offset_stds: np.ndarray
    angle_stds: np.ndarray
    found: np.ndarray
    """(n,) part of each true edge's length that was found."""
    false: int
    """Found edges that belong to no true one."""

    @property
    def nees(self):
        """Normalised estimation error squared of each edge, chi-square with two degrees of freedom."""
        return (self.offsets / self.offset_stds) ** 2 + (self.angles / self.angle_stds) ** 2


def compare(segments, photo: EdgePhoto) -> Comparison:
    """Assign every found edge to the true one within 2 px and 2 degrees, if there is one."""
    start, end = photo.edges[:, :2], photo.edges[:, 2:]
    lengths = np.linalg.norm(end - start, axis=1)
    along = (end - start) / lengths[:, None]
    normals = np.column_stack([-along[:, 1], along[:, 0]])
    found = np.zeros(len(photo.edges))
    rows, false = [], 0
    for k in range(len(segments)):
        c, d = segments.centres[k], segments.directions[k]
        offset = np.sum((c - start) * normals, axis=1)
        place = np.sum((c - start) * along, axis=1)
        turn = np.arctan2(along[:, 0] * d[1] - along[:, 1] * d[0], along @ d)
        fits = (np.abs(offset) < 2.0) & (np.abs(turn) < np.deg2rad(2.0)) & (place > 0.0) & (place < lengths)
        if not fits.any():
            false += 1
            continue
        edge = int(np.argmax(fits))
        found[edge] += segments.lengths[k] / lengths[edge]
        angle_std, offset_std = np.sqrt(np.diag(segments.covariances[k]))
        rows.append((offset[edge], turn[edge], offset_std, angle_std))
    columns = np.array(rows).reshape(-1, 4).T
    return Comparison(*columns, found=found, false=false)


def together(comparisons) -> Comparison:
    """Join comparisons of several photos."""
    parts = list(comparisons)
    names = ("offsets", "angles", "offset_stds", "angle_stds", "found")
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return Comparison(**joined, false=sum(part.false for part in parts))
