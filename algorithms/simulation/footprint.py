"""What a beam of finite width returns at a depth edge: mixed pixels."""

import numpy as np
from scipy import ndimage

from algorithms.arrays import Array, Points, Scalars, Vector3
from algorithms.geometry.lines import bases_of
from algorithms.simulation.ray_casting import MIN_COSINE, Hits, RayCaster
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scene import Scene

SUB_RAYS = 12
"""Rays per footprint besides the centre."""
RAYS_OF_A_PICTURE = 144
"""Rays per footprint where reflectances meet: a step across the beam is drawn smooth."""
MIN_JUMP_M = 0.005
"""Neighbours on different faces that differ by less are not worth a closer look."""
MIN_SIGNAL = 0.25
"""A beam of which less than this share meets anything is not recorded."""


def footprint_offsets() -> tuple[Array, Scalars]:
    """Give sub-rays of a footprint: (13, 2) offsets in footprint radii and their (13,) Gaussian weights, sum 1.

    The centre and a sunflower pattern of equal areas, about their common centre of gravity; the radius is where the
    intensity has fallen to 1/e^2.
    """
    k = np.arange(SUB_RAYS + 1)
    radius = np.sqrt(k / SUB_RAYS)
    angle = k * np.pi * (3.0 - np.sqrt(5.0))
    weights = np.exp(-2.0 * radius**2)
    weights /= weights.sum()
    offsets = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    return offsets - weights @ offsets, weights


def near_depth_edges(hits: Hits, scene: Scene, scanner: VirtualScanner) -> Array:
    """Find beams with a neighbour (of 8) on another face and at another depth, or without any return.

    Parameters
    ----------
    hits
        Of all beams in recording order.

    Returns
    -------
    (n,) bool.
    """
    shape = (scanner.columns, scanner.rows)
    ranges = np.minimum(hits.ranges_m, 1e6).reshape(shape)
    faces = np.where(hits.found, scene.plane_ids[hits.triangles], -1).astype(np.int32).reshape(shape)
    flags = np.zeros(shape, dtype=bool)
    for column_shift in (0, 1):
        for row_shift in (-1, 0, 1):
            if column_shift == 0 and row_shift < 1:
                continue
            # The horizontal circle closes; the vertical one ends at the first and last row.
            here = slice(max(0, -row_shift), scanner.rows - max(0, row_shift))
            there = slice(max(0, row_shift), scanner.rows - max(0, -row_shift))
            other_ranges, other_faces = np.roll(ranges, -column_shift, axis=0), np.roll(faces, -column_shift, axis=0)
            differs = (faces[:, here] != other_faces[:, there]) & (
                np.abs(ranges[:, here] - other_ranges[:, there]) > MIN_JUMP_M
            )
            flags[:, here] |= differs
            flags[:, there] |= np.roll(differs, column_shift, axis=0)
    return flags.ravel()


def near_reflectance_edges(hits: Hits, scene: Scene, scanner: VirtualScanner) -> Array:
    """Find beams with something of another reflectance within their footprint and its tail, as far as neighbours show.

    Parameters
    ----------
    hits
        Of all beams in recording order.

    Returns
    -------
    (n,) bool.
    """
    values = np.where(hits.found, scene.reflectances[hits.triangles], 0.0).reshape(scanner.columns, scanner.rows)
    nearest = float(np.min(hits.ranges_m, initial=np.inf))
    width = scanner.beam_divergence_rad + (scanner.beam_exit_diameter_m / nearest if nearest > 0.0 else 0.0)
    reach = 0.5 * width + (abs(scanner.tail_offset_rad) if scanner.tail_share > 0.0 else 0.0)
    size = tuple(2 * int(np.ceil(reach / step)) + 1 for step in (scanner.column_step_rad, scanner.row_step_rad))
    return np.asarray(ndimage.maximum_filter(values, size) > ndimage.minimum_filter(values, size)).ravel()


def mean_reflectances(
    caster: RayCaster, scene: Scene, scanner: VirtualScanner, origin: Vector3, directions: Points, centre: Hits
) -> Scalars:
    """Give the reflectance (n,) that beams see: the signal of the whole footprint over the cosine at its centre.

    The footprint is a Gaussian beam, the same on both sides of its centre, so that no side of an edge weighs more; each
    ray counts with the reflectance and the cosine of what it meets, and nothing where that lies beyond the echo that is
    returned: a target that the beam meets in part is weaker. The tail is the same beam once more, beside.

    Parameters
    ----------
    caster, scene, scanner
        Where the rays go and how wide they are.
    origin
        Instrument centre in the scene's frame [m].
    directions
        (n, 3) true unit directions of the beams in the scene's frame.
    centre
        What their centres met: rays that meet something farther away than the echo separation do not count.
    """
    offsets = _gaussian_rays()
    signal = np.zeros(len(directions))
    parts = [(1.0 - scanner.tail_share, 0.0), (scanner.tail_share, scanner.tail_offset_rad)]
    for share, turn in parts:
        if share <= 0.0:
            continue
        cosine, sine = np.cos(turn), np.sin(turn)
        turned = directions @ np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        across = np.einsum("nij,kj->nki", bases_of(turned), offsets)
        origins = origin + 0.5 * scanner.beam_exit_diameter_m * across
        fans = turned[:, None, :] + 0.5 * scanner.beam_divergence_rad * across
        fans /= np.linalg.norm(fans, axis=2, keepdims=True)
        hits = caster.cast(origins.reshape(-1, 3), fans.reshape(-1, 3))
        ranges = hits.ranges_m.reshape(len(directions), -1)
        same = np.abs(ranges - centre.ranges_m[:, None]) < scanner.echo_separation_m
        seen = (scene.reflectances[hits.triangles] * hits.cosines).reshape(len(directions), -1)
        signal += share * np.where(same, seen, 0.0).mean(axis=1)
    return np.asarray(signal / np.maximum(centre.cosines, MIN_COSINE))


def _gaussian_rays() -> Array:
    """Give rays of equal power (k, 2) in footprint radii: a sunflower pattern and its mirror image."""
    half = RAYS_OF_A_PICTURE // 2
    share = (np.arange(half) + 0.5) / half
    radius = np.sqrt(-0.5 * np.log(1.0 - share))
    angle = np.arange(half) * np.pi * (3.0 - np.sqrt(5.0))
    offsets = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    return np.vstack([offsets, -offsets])


def mixed_hits(
    caster: RayCaster,
    scene: Scene,
    scanner: VirtualScanner,
    origin: Vector3,
    directions: Points,
    centre: Hits,
    rng: np.random.Generator,
) -> Hits:
    """Find what whole footprints return.

    Each beam is split into 13 rays. Ranges that lie apart by more than the scanner's echo separation form separate
    echoes; the strongest is returned as the signal-weighted mean of its rays (Gaussian beam, reflectance, cosine of
    incidence, inverse square of the range). Beams whose rays all lie on one face keep the exact range of their centre.
    Of the others the scanner's share of unmixed ones return one face only, drawn by its part of the whole signal (VGI
    4/2003, laser physics, section on the detection of echoes: a leading edge and a centroid give different ranges).

    Parameters
    ----------
    caster, scene, scanner
        Where the rays go and how wide they are.
    origin
        Instrument centre in the scene's frame [m].
    directions
        (n, 3) true unit directions of the beams in the scene's frame.
    centre
        What their centres met.
    rng
        Draws which beams return one face, and which; not asked where the share is 0.
    """
    offsets, weights = footprint_offsets()
    count, rays = len(directions), len(weights)
    across = np.einsum("nij,kj->nki", bases_of(directions), offsets)
    origins = origin + 0.5 * scanner.beam_exit_diameter_m * across
    fans = directions[:, None, :] + 0.5 * scanner.beam_divergence_rad * across
    fans /= np.linalg.norm(fans, axis=2, keepdims=True)
    hits = caster.cast(origins.reshape(-1, 3), fans.reshape(-1, 3))
    solid = (hits.found & ~scene.is_glass[hits.triangles]).reshape(count, rays)
    ranges = np.where(solid, hits.ranges_m.reshape(count, rays), np.inf)
    cosines = hits.cosines.reshape(count, rays)
    triangles = hits.triangles.reshape(count, rays)
    signal = weights * scene.reflectances[triangles] * cosines
    signal = np.where(solid, signal / np.where(solid, ranges, 1.0) ** 2, 0.0)
    faces = np.where(solid, scene.plane_ids[triangles], -1)
    one_face = (faces == faces[:, :1]).all(axis=1)
    recorded = echo = _strongest_echo(ranges, signal, scanner.echo_separation_m)
    if scanner.unmixed_share > 0.0:
        unmixed = (rng.uniform(size=count) < scanner.unmixed_share)[:, None]
        echo = np.where(unmixed, _drawn_face(faces, signal, rng.uniform(size=count)), echo)
        recorded = np.where(unmixed, solid, recorded)
    power = np.where(echo, signal, 0.0)
    total = power.sum(axis=1)
    # of foil that throws back many times what white paper does, a smaller share is seen
    heard = weights * np.maximum(scene.reflectances[triangles], 1.0)
    enough = (np.where(recorded, heard, 0.0).sum(axis=1) >= MIN_SIGNAL) & (total > 0.0)
    share = power / np.where(enough, total, 1.0)[:, None]
    mean_range = np.where(echo, share * np.where(echo, ranges, 0.0), 0.0).sum(axis=1)
    leading = triangles[np.arange(count), np.argmax(power, axis=1)]
    mean_cosine = (share * cosines).sum(axis=1)
    lost = ~enough & ~one_face
    return Hits(
        ranges_m=np.where(one_face, centre.ranges_m, np.where(lost, np.inf, mean_range)),
        triangles=np.where(one_face, centre.triangles, np.where(lost, -1, leading)),
        cosines=np.where(one_face, centre.cosines, np.where(lost, 0.0, mean_cosine)),
    )


def _drawn_face(faces: Array, signal: Array, draws: Scalars) -> Array:
    """Mark in each row (beam) the rays on one face, drawn (n,) in 0..1 by its part of the row's signal; (n, k) bool."""
    shares = np.cumsum(signal, axis=1)
    ray = np.argmax(shares > draws[:, None] * shares[:, -1:], axis=1)
    return np.asarray((faces == faces[np.arange(len(faces)), ray][:, None]) & (signal > 0.0))


def _strongest_echo(ranges: Array, signal: Array, separation_m: float) -> Array:
    """Mark in each row (beam) the rays of the echo with the most signal; (n, k) bool."""
    order = np.argsort(ranges, axis=1)
    ascending = np.take_along_axis(ranges, order, axis=1)
    finite = np.isfinite(ascending)
    steps = np.diff(np.where(finite, ascending, 0.0), axis=1)
    breaks = np.where(finite[:, 1:], steps > separation_m, finite[:, :-1])
    echo_sorted = np.concatenate([np.zeros((len(ranges), 1), dtype=np.int64), np.cumsum(breaks, axis=1)], axis=1)
    echo = np.empty_like(echo_sorted)
    np.put_along_axis(echo, order, echo_sorted, axis=1)
    power = np.stack([np.where(echo == k, signal, 0.0).sum(axis=1) for k in range(echo.max(initial=0) + 1)], axis=1)
    return np.asarray((echo == np.argmax(power, axis=1)[:, None]) & np.isfinite(ranges))
