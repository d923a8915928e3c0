"""Virtual photographs: rays in, pixels out."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import UInt8
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import binary_dilation, gaussian_filter, maximum_filter
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Points, Vectors2
from algorithms.geometry.cameras import Camera
from algorithms.simulation.rendering_edges import sample_edges
from algorithms.simulation.rendering_shading import Shading
from algorithms.simulation.scene import Scene
from algorithms.simulation.sun import MORNING, Daylight
from algorithms.simulation.virtual_camera import VirtualCamera

Photo: TypeAlias = UInt8[Array, "rows columns 3"]
"""Red, green and blue of each pixel."""

CHUNK = 1 << 18
"""Rays cast at once: bounds the memory."""
NODES = 161
"""Places along each side at which the distortion is removed exactly; cubic splines between them are good to 1e-6 px."""
FAR_M = 1e9
"""Where the sky begins."""
EDGE_STEP_PX = 0.7
"""Pixels crossed by an edge are found by walking along it in such steps."""


@dataclass(frozen=True, eq=False)
class StationPhoto:
    """A photo and what is known of it without error."""

    image: Photo
    """The pixels."""
    camera: Camera
    """Interior orientation."""
    scan_from_camera: RigidTransform
    """Pose on the scanner."""


def render_photo(
    scene: Scene,
    world_from_camera: RigidTransform,
    camera: VirtualCamera,
    rng: np.random.Generator,
    daylight: Daylight = MORNING,
) -> Photo:
    """Take a photo of a scene.

    Each pixel is the mean radiance over its square. Where a square may contain an edge (of geometry, material,
    texture or shadow, half shadows included) it is sampled by a lattice of rays that is shifted at random from pixel
    to pixel, which leaves edges without bias; elsewhere one ray through its centre is enough. Rays are bent exactly as
    the camera model says. Then come vignetting, the lens's blur, exposure, noise, gamma and rounding to 8 bits.

    Parameters
    ----------
    scene
        What stands around.
    world_from_camera
        True pose: x right, y down, z forward.
    camera
        The data sheet.
    rng
        Source of all randomness; the same state gives the same photo, bit for bit.
    daylight
        Sun and sky.
    """
    return _expose(_radiances(Shading(scene, daylight), world_from_camera, camera, rng), camera, rng)


def station_photos(
    scene: Scene,
    world_from_scan: RigidTransform,
    camera: VirtualCamera,
    scan_from_cameras: Sequence[RigidTransform],
    rng: np.random.Generator,
    daylight: Daylight = MORNING,
) -> Iterator[StationPhoto]:
    """Take the photos of one station, one at a time; see `render_photo` and `VirtualCamera.scan_from_camera`."""
    shading = Shading(scene, daylight)
    for pose in scan_from_cameras:
        image = _expose(_radiances(shading, world_from_scan * pose, camera, rng), camera, rng)
        yield StationPhoto(image, camera.camera, pose)


def lattice(count: int) -> Vectors2:
    """Give `count` points (n, 2) of the unit square, of which every projection on a side is evenly spaced.

    A lattice of one generator near the golden section (a Fibonacci lattice where `count` is a Fibonacci number).
    """
    generator = _coprime(count, (np.sqrt(5.0) - 1.0) / 2.0)
    k = np.arange(count)
    return np.column_stack([(k + 0.5) / count, (k * generator % count + 0.5) / count])


def sunflower(count: int) -> Vectors2:
    """Spread `count` points (n, 2) evenly over the unit disc, in an order unlike that of `lattice`."""
    # Taken in steps, neighbours in the lattice look at distant parts of the disc.
    k = np.arange(count) * _coprime(count, 0.38) % count
    radius, angle = np.sqrt((k + 0.5) / count), k * np.pi * (3.0 - np.sqrt(5.0))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def _coprime(count: int, share: float) -> int:
    """Give a number near a share of `count` that has no divisor in common with it."""
    number = max(1, round(count * share))
    while np.gcd(number, count) > 1:
        number += 1
    return number


def _radiances(
    shading: Shading, world_from_camera: RigidTransform, camera: VirtualCamera, rng: np.random.Generator
) -> Array:
    """Give the mean radiance (h, w, 3) over each pixel's square."""
    ideal = _ideal_pixels(camera.camera)
    colors, labels, ranges, half_shadow = _one_ray_each(shading, world_from_camera, camera.camera, ideal)
    edges = _differs_from_neighbours(labels) | half_shadow
    edges |= _crossed_by_edges(shading.scene, world_from_camera, camera.camera, ranges)
    pixels = np.flatnonzero(edges.ravel())
    pattern, on_sun = lattice(camera.edge_samples), sunflower(camera.edge_samples)
    at_once = max(1, CHUNK // len(pattern))
    for start in range(0, len(pixels), at_once):
        here = pixels[start : start + at_once]
        shifts = rng.uniform(size=(len(here), 1, 2))
        offsets = np.mod(pattern + shifts, 1.0) - 0.5
        # Within half a pixel distortion is linear to 1e-4 px.
        bent = np.einsum("nij,nkj->nki", camera.camera.ideal_jacobians(ideal[here]), offsets)
        rays = _world_rays(camera.camera, world_from_camera, (ideal[here, None, :] + bent).reshape(-1, 2))
        towards_sun = None
        if shading.daylight.sun_radius_rad > 0.0:
            turns = Rotation.from_rotvec(rng.uniform(-np.pi, np.pi, size=(len(here), 1)) * np.array([0.0, 0.0, 1.0]))
            turned = np.einsum("nij,kj->nki", turns.as_matrix()[:, :2, :2], on_sun).reshape(-1, 2)
            towards_sun = shading.daylight.towards_disc(turned)
        seen = shading.look(np.asarray(world_from_camera.translation), rays, towards_sun).colors
        colors[here] = seen.reshape(len(here), -1, 3).mean(axis=1)
    return colors.reshape(camera.camera.height, camera.camera.width, 3)


def _ideal_pixels(camera: Camera) -> Vectors2:
    """Give the ideal pixels (h w, 2) of all pixel centres, row after row."""
    columns, rows = np.arange(camera.width, dtype=np.float64), np.arange(camera.height, dtype=np.float64)
    grid = np.stack(np.meshgrid(columns, rows), axis=-1)
    if not camera.distorts:
        return grid.reshape(-1, 2)
    nodes_x, nodes_y = (np.linspace(-0.5, n - 0.5, NODES) for n in (camera.width, camera.height))
    nodes = np.stack(np.meshgrid(nodes_x, nodes_y), axis=-1).reshape(-1, 2)
    ideal = camera.ideal_from_image(nodes).reshape(len(nodes_y), len(nodes_x), 2)
    for k in range(2):
        grid[..., k] = RectBivariateSpline(nodes_y, nodes_x, ideal[..., k])(rows, columns)
    return grid.reshape(-1, 2)


def _world_rays(camera: Camera, world_from_camera: RigidTransform, ideal: Vectors2) -> Points:
    return np.asarray(camera.rays_from_ideal(ideal) @ world_from_camera.rotation.as_matrix().T)


def _one_ray_each(
    shading: Shading, world_from_camera: RigidTransform, camera: Camera, ideal: Vectors2
) -> tuple[Points, Array, Array, Array]:
    """Look through all pixel centres: colours (h w, 3), labels, ranges and half shadows (h, w each)."""
    colors, labels, ranges = np.empty((len(ideal), 3)), np.empty(len(ideal), dtype=np.int64), np.empty(len(ideal))
    half_shadow = np.zeros(len(ideal), dtype=bool)
    eye = np.asarray(world_from_camera.translation)
    for start in range(0, len(ideal), CHUNK):
        here = slice(start, start + CHUNK)
        rays = _world_rays(camera, world_from_camera, ideal[here])
        sights = shading.look(eye, rays)
        colors[here], labels[here], ranges[here] = sights.colors, shading.labels(sights), sights.ranges_m
        if shading.daylight.sun_radius_rad > 0.0:
            half_shadow[here] = shading.in_half_shadow(eye, rays, sights)
    shape = (camera.height, camera.width)
    return colors, labels.reshape(shape), ranges.reshape(shape), half_shadow.reshape(shape)


def _differs_from_neighbours(labels: Array) -> Array:
    """Mark pixels (h, w) of which one of the eight neighbours bears another label."""
    differs = np.zeros(labels.shape, dtype=bool)
    rows, columns = labels.shape
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = (slice(0, rows - down), slice(max(0, -right), columns - max(0, right)))
        there = (slice(down, rows), slice(max(0, right), columns - max(0, -right)))
        unequal = labels[here] != labels[there]
        differs[here] |= unequal
        differs[there] |= unequal
    return differs


def _crossed_by_edges(scene: Scene, world_from_camera: RigidTransform, camera: Camera, ranges: Array) -> Array:
    """Mark pixels (h, w) at which an edge passes that may be seen: thin bars slip between the centres of pixels.

    Edges behind everything that the centres around them see, at `ranges` (h, w) [m], are left out.
    """
    samples = sample_edges(scene.part_edges, world_from_camera, camera, EDGE_STEP_PX)
    image = camera.image_from_ideal(samples.ideal)
    column, row = np.clip(np.rint(image), 0, np.array([camera.width, camera.height]) - 1).astype(np.int64).T
    farthest = maximum_filter(np.minimum(ranges, FAR_M), 3)[row, column]
    seen = camera.inside(image) & (np.linalg.norm(samples.points, axis=1) < farthest * (1.0 + 1e-9))
    crossed = np.zeros(ranges.shape, dtype=bool)
    crossed[row[seen], column[seen]] = True
    return np.asarray(binary_dilation(crossed, np.ones((3, 3), dtype=bool)))


def _expose(radiances: Array, camera: VirtualCamera, rng: np.random.Generator) -> Photo:
    """Turn radiances (h, w, 3) into grey levels."""
    model = camera.camera
    columns, rows = np.arange(model.width) - model.cx, np.arange(model.height) - model.cy
    corner = max(abs(columns[0]), abs(columns[-1])) ** 2 + max(abs(rows[0]), abs(rows[-1])) ** 2
    falloff = 1.0 - camera.vignetting * (columns**2 + rows[:, None] ** 2) / max(corner, 1.0)
    light = radiances * (camera.exposure * falloff)[:, :, None]
    if camera.blur_px > 0.0:
        light = gaussian_filter(light, (camera.blur_px, camera.blur_px, 0.0), mode="nearest")
    grey = 255.0 * np.maximum(light, 0.0)
    # The sensor adds its noise before anything else happens to the signal.
    if camera.read_noise > 0.0 or camera.shot_noise > 0.0:
        grey += rng.standard_normal(grey.shape) * np.sqrt(camera.read_noise**2 + camera.shot_noise * grey)
    finished = 255.0 * np.clip(grey / 255.0, 0.0, 1.0) ** (1.0 / camera.gamma)
    return np.asarray(np.rint(finished), dtype=np.uint8)
