"""Virtual scanning: rays in, a structured scan out."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Points, Scalars
from algorithms.scans.scan import Scan, ScanGrid
from algorithms.simulation.beam_physics import relative_power, transmission
from algorithms.simulation.footprint import mean_reflectances, mixed_hits, near_depth_edges, near_reflectance_edges
from algorithms.simulation.ray_casting import Hits, RayCaster
from algorithms.simulation.scanner import VirtualScanner, directions_of
from algorithms.simulation.scene import Scene
from algorithms.simulation.unevenness import Unevenness

CHUNK = 1 << 18
"""Rays cast at once: bounds the memory, and fixes the order of random numbers."""


@dataclass(frozen=True, eq=False)
class _Casters:
    """Search trees of one scene, built once for all stations."""

    everything: RayCaster
    without_glass: RayCaster | None
    """None where the scene has no panes."""


@dataclass(frozen=True, eq=False)
class _Readings:
    """True beams and what they met, in recording order (column after column, each from the top down)."""

    azimuth_errors_rad: Scalars
    elevation_errors_rad: Scalars
    hits: Hits
    through_glass: Array
    """(n,) bool, True where the beam went through a pane."""
    reflectances: Scalars
    """(n,) reflectance that the beam sees; nan: that of the face its centre met."""


def scan_scene(
    scene: Scene, world_from_scan: RigidTransform, scanner: VirtualScanner, rng: np.random.Generator
) -> Scan:
    """Scan a scene from one station.

    The beam leaves in the nominal direction of its row and column plus the errors of the two circles; the range it
    measures, plus the range errors, is recorded at the nominal direction, as an instrument does that does not know its
    errors.

    Parameters
    ----------
    scene
        What stands around the scanner.
    world_from_scan
        True pose; not written into the scan.
    scanner
        The data sheet.
    rng
        Source of all randomness; the same state gives the same scan, bit for bit.

    Returns
    -------
    A structured scan in the scanner's frame: origin and sensor at zero, no pose. Points are in recording order.
    """
    return next(simulate_stations(scene, [world_from_scan], scanner, rng))


def simulate_stations(
    scene: Scene, poses: Sequence[RigidTransform], scanner: VirtualScanner, rng: np.random.Generator
) -> Iterator[Scan]:
    """Scan a scene from several stations, one scan at a time (see `scan_scene`)."""
    glass = scene.is_glass
    casters = _Casters(RayCaster(scene), RayCaster(scene, np.flatnonzero(~glass)) if glass.any() else None)
    for number, pose in enumerate(poses, start=1):
        yield _scan(scene, casters, pose, scanner, rng, f"{scene.name}-{number}")


def _scan(
    scene: Scene, casters: _Casters, pose: RigidTransform, scanner: VirtualScanner, rng: np.random.Generator, name: str
) -> Scan:
    readings = _cast_beams(scene, casters, pose, scanner, rng)
    # what the centres met tells where reflectances meet; mixed, a beam that just missed foil counts as on it
    meeting = near_reflectance_edges(readings.hits, scene, scanner) if scanner.mixed_intensities else None
    if scanner.mixed_pixels:
        _mix_at_depth_edges(scene, casters, pose, scanner, readings, rng)
    if meeting is not None:
        _mix_reflectances(scene, casters, pose, scanner, readings, np.flatnonzero(meeting & readings.hits.found))
    if scene.unevenness is not None:
        _make_uneven(scene, scene.unevenness, pose, scanner, readings)
    count = scanner.rows * scanner.columns
    kept = np.zeros(count, dtype=bool)
    points, intensities = [], []
    for start in range(0, count, CHUNK):
        beams = np.arange(start, min(start + CHUNK, count))
        seen, ranges, intensity = _measure(scene, scanner, readings, beams, rng)
        kept[beams] = seen
        points.append(_nominal_directions(scanner, beams[seen]) * ranges[:, None])
        intensities.append(intensity.astype(np.float32))
    index = np.full(count, -1, dtype=np.int32)
    index[kept] = np.arange(np.count_nonzero(kept), dtype=np.int32)
    return Scan(
        points=np.concatenate(points),
        origin_m=np.zeros(3),
        name=name,
        grid=ScanGrid(np.ascontiguousarray(index.reshape(scanner.columns, scanner.rows).T)),
        intensity=np.concatenate(intensities),
        sensor_m=np.zeros(3),
    )


def _nominal_directions(scanner: VirtualScanner, beams: Array) -> Points:
    return directions_of(scanner.azimuths(beams // scanner.rows), scanner.elevations(beams % scanner.rows))


def _true_directions(scanner: VirtualScanner, pose: RigidTransform, readings: _Readings, beams: Array) -> Points:
    """Give the directions in which the beams really left, in the world."""
    azimuths = scanner.azimuths(beams // scanner.rows) + readings.azimuth_errors_rad[beams]
    elevations = scanner.elevations(beams % scanner.rows) + readings.elevation_errors_rad[beams]
    times = (beams // scanner.rows + 0.5) / scanner.columns
    return np.asarray(pose.rotation.apply(scanner.systematic.true_directions(azimuths, elevations, times)))


def _cast_beams(
    scene: Scene, casters: _Casters, pose: RigidTransform, scanner: VirtualScanner, rng: np.random.Generator
) -> _Readings:
    """Draw the circle errors and find what the centre of each beam meets."""
    count = scanner.rows * scanner.columns
    readings = _Readings(
        azimuth_errors_rad=np.zeros(count),
        elevation_errors_rad=np.zeros(count),
        hits=Hits(np.empty(count), np.empty(count, dtype=np.int64), np.empty(count)),
        through_glass=np.zeros(count, dtype=bool),
        reflectances=np.full(count, np.nan),
    )
    origin = np.asarray(pose.translation)
    for start in range(0, count, CHUNK):
        beams = np.arange(start, min(start + CHUNK, count))
        if scanner.angle_noise_std_rad > 0.0:
            readings.azimuth_errors_rad[beams] = rng.normal(0.0, scanner.angle_noise_std_rad, len(beams))
            readings.elevation_errors_rad[beams] = rng.normal(0.0, scanner.angle_noise_std_rad, len(beams))
        directions = _true_directions(scanner, pose, readings, beams)
        _store(readings.hits, beams, casters.everything.cast(origin, directions))
        if casters.without_glass is not None:
            passed = rng.uniform(size=len(beams)) < scanner.glass_pass_probability
            on_pane = readings.hits.found[beams] & scene.is_glass[readings.hits.triangles[beams]]
            on_pane &= readings.hits.cosines[beams] < np.cos(scanner.glass_return_incidence_rad)
            through = on_pane & passed
            readings.through_glass[beams] = through
            _store(readings.hits, beams[through], casters.without_glass.cast(origin, directions[through]))
            _lose(readings.hits, beams[on_pane & ~passed])
    return readings


def _store(all_hits: Hits, beams: Array, hits: Hits) -> None:
    all_hits.ranges_m[beams] = hits.ranges_m
    all_hits.triangles[beams] = hits.triangles
    all_hits.cosines[beams] = hits.cosines


def _lose(all_hits: Hits, beams: Array) -> None:
    all_hits.ranges_m[beams] = np.inf
    all_hits.triangles[beams] = -1
    all_hits.cosines[beams] = 0.0


def _mix_at_depth_edges(
    scene: Scene,
    casters: _Casters,
    pose: RigidTransform,
    scanner: VirtualScanner,
    readings: _Readings,
    rng: np.random.Generator,
) -> None:
    """Replace the ranges of beams that straddle a depth edge by what the whole footprint returns."""
    flagged = np.flatnonzero(near_depth_edges(readings.hits, scene, scanner))
    origin = np.asarray(pose.translation)
    for caster, through in ((casters.everything, False), (casters.without_glass, True)):
        if caster is None:
            continue
        chosen = flagged[readings.through_glass[flagged] == through]
        for start in range(0, len(chosen), CHUNK // 16):
            beams = chosen[start : start + CHUNK // 16]
            directions = _true_directions(scanner, pose, readings, beams)
            centre = Hits(readings.hits.ranges_m[beams], readings.hits.triangles[beams], readings.hits.cosines[beams])
            _store(readings.hits, beams, mixed_hits(caster, scene, scanner, origin, directions, centre, rng))


def _mix_reflectances(
    scene: Scene,
    casters: _Casters,
    pose: RigidTransform,
    scanner: VirtualScanner,
    readings: _Readings,
    flagged: Array,
) -> None:
    """Give beams that straddle an edge between reflectances, numbers (k,), the mean of their footprint."""
    origin = np.asarray(pose.translation)
    for start in range(0, len(flagged), CHUNK // 64):
        beams = flagged[start : start + CHUNK // 64]
        centre = Hits(readings.hits.ranges_m[beams], readings.hits.triangles[beams], readings.hits.cosines[beams])
        directions = _true_directions(scanner, pose, readings, beams)
        readings.reflectances[beams] = mean_reflectances(casters.everything, scene, scanner, origin, directions, centre)


def _make_uneven(
    scene: Scene, unevenness: Unevenness, pose: RigidTransform, scanner: VirtualScanner, readings: _Readings
) -> None:
    """Move the ranges to where the beams meet the uneven surfaces; what hides what remains as in the mesh."""
    found = np.flatnonzero(readings.hits.found)
    origin = np.asarray(pose.translation)
    for start in range(0, len(found), CHUNK):
        beams = found[start : start + CHUNK]
        # Beams that meet a surface flatter than this do not come back.
        beams = beams[readings.hits.cosines[beams] > np.cos(scanner.max_incidence_rad)]
        directions = _true_directions(scanner, pose, readings, beams)
        points = origin + readings.hits.ranges_m[beams, None] * directions
        normals = scene.normals[readings.hits.triangles[beams]]
        readings.hits.ranges_m[beams] += unevenness.range_changes_m(
            points, directions, normals, readings.hits.cosines[beams]
        )


def _measure(
    scene: Scene, scanner: VirtualScanner, readings: _Readings, beams: Array, rng: np.random.Generator
) -> tuple[Array, Scalars, Scalars]:
    """Decide which beams come back, and add noise to their ranges and intensities.

    Returns
    -------
    seen (n,) bool; ranges [m] and intensities (0..about 1) of the seen beams.
    """
    unit_noise = rng.standard_normal(len(beams))
    speckle = rng.standard_normal(len(beams))
    lost = rng.uniform(size=len(beams)) < scanner.dropout_probability
    ranges, cosines = readings.hits.ranges_m[beams], readings.hits.cosines[beams]
    mixed = readings.reflectances[beams]
    reflectances = np.where(np.isnan(mixed), scene.reflectances[readings.hits.triangles[beams]], mixed)
    bright = reflectances * cosines
    if scanner.attenuation_db_per_km > 0.0:
        bright = bright * transmission(ranges, scanner.attenuation_db_per_km)
    reach = scanner.max_range_m * np.sqrt(np.minimum(1.0, bright / scanner.reach_reflectance))
    seen = readings.hits.found[beams] & ~lost & (cosines > np.cos(scanner.max_incidence_rad))
    seen &= (ranges >= scanner.min_range_m) & (ranges <= reach)
    ranges, cosines, reflectances = ranges[seen], cosines[seen], reflectances[seen]
    noisy = ranges + range_std_m(scanner, ranges, cosines, reflectances) * unit_noise[seen]
    noisy += scanner.systematic.range_errors_m(ranges, cosines)
    signal = reflectances * cosines
    if scanner.intensity_reference_m > 0.0:
        reference, attenuation = scanner.intensity_reference_m, scanner.attenuation_db_per_km
        signal = relative_power(reflectances, ranges, cosines, reference, attenuation)
    intensity = signal * (1.0 + scanner.intensity_noise * speckle[seen])
    return seen, np.asarray(noisy), np.asarray(np.maximum(intensity, 0.0))


def range_std_m(scanner: VirtualScanner, ranges_m: Scalars, cosines: Scalars, reflectances: Scalars) -> Scalars:
    """Give the standard deviation of ranges (n,) [m] by distance, incidence and reflectance."""
    footprint_radius = 0.5 * (scanner.beam_exit_diameter_m + scanner.beam_divergence_rad * ranges_m)
    tangent = np.sqrt(np.maximum(0.0, 1.0 - cosines**2)) / cosines
    variance = (
        scanner.range_noise_std_m**2
        + (scanner.range_noise_per_m * ranges_m) ** 2
        + (scanner.range_noise_footprint * footprint_radius * tangent) ** 2
    )
    return np.asarray(np.sqrt(variance) * (reflectances / 0.5) ** -scanner.range_noise_reflectance_exponent)
