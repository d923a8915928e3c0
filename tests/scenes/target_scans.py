"""Windows of simulated scans with targets of all kinds in built-in scenes, and with what may be taken for one."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Generator
from algorithms.scans.scan import Scan
from algorithms.simulation.parts import Part
from algorithms.simulation.ray_casting import RayCaster
from algorithms.simulation.scanner import VirtualScanner, directions_of
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scene import Scene, scene_from_parts
from algorithms.simulation.scenes import SCENES
from algorithms.simulation.symmetric_scenes import SYMMETRIC_SCENES
from algorithms.simulation.target_parts import BOARD_WHITE, checker_board, facing, plate, retro_cylinder, sphere
from algorithms.targets.options import BoardKind, RetroKind, SoughtKind, SphereKind, TargetKind

RADIUS_M, BOARD_M, RETRO_M = 0.0725, 0.15, 0.05
KINDS: tuple[SoughtKind, ...] = (
    SphereKind(RADIUS_M),
    BoardKind(BOARD_M),
    RetroKind(RETRO_M),
    RetroKind(RETRO_M, TargetKind.RETRO_CYLINDER),
)
ROOMS = ("house", "pipe_hall", "office", "corridor", "bridge", "street_square", "holzmarkt", *SYMMETRIC_SCENES)
HALF_FIELD_RAD, STEP_RAD = 0.16, 0.0006
NEAREST_M, FARTHEST_M = 3.0, 12.0
APART_RAD, CLEAR_M = 0.05, 0.12
STEEPEST_RAD = float(np.deg2rad(60.0))
MOST_LEAN_RAD = float(np.deg2rad(2.0))
"""Of the instrument against the upright cylinders."""


@dataclass(frozen=True, eq=False)
class PlacedTarget:
    """A target and its truth in the scanner's frame."""

    kind: TargetKind
    centre_m: Array
    """(3,)."""


def window_of(number: int, *, with_targets: bool) -> tuple[Scan, list[PlacedTarget], str]:
    """Scan a part of what is around a station, in one scene after the other.

    Parameters
    ----------
    number
        Of the scan; it determines everything.
    with_targets
        Whether one target of each kind is put where there is room; otherwise signs, number plates and white plates.

    Returns
    -------
    The scan, the targets in it, and the name of the scene.
    """
    rng = np.random.default_rng(number + (0 if with_targets else 1_000_000))
    name = ROOMS[number % len(ROOMS)]
    room = SCENES[name]() if name in SCENES else SYMMETRIC_SCENES[name](rng, 2)
    level = [pose for pose in room.stations if pose.rotation.as_matrix()[2, 2] > np.cos(MOST_LEAN_RAD)]
    pose = level[(number // len(ROOMS)) % len(level)]
    azimuth = float(rng.uniform(-np.pi + HALF_FIELD_RAD, np.pi - HALF_FIELD_RAD))
    elevation = float(rng.uniform(-0.25, 0.25))
    scanner = VirtualScanner(
        rows=round(2.0 * HALF_FIELD_RAD / STEP_RAD),
        columns=round(2.0 * HALF_FIELD_RAD / STEP_RAD),
        lowest_rad=elevation - HALF_FIELD_RAD,
        highest_rad=elevation + HALF_FIELD_RAD,
        leftmost_rad=azimuth - HALF_FIELD_RAD,
        rightmost_rad=azimuth + HALF_FIELD_RAD,
        range_noise_std_m=0.001,
        mixed_intensities=True,
    )
    kinds = list(TargetKind) if with_targets else [None, None, None]
    places = _free_places(room, pose, azimuth, elevation, len(kinds), rng)
    parts, placed = [], []
    for kind, place in zip(kinds, places, strict=False):
        world = pose.apply(place)
        towards = pose.rotation.apply(-place / np.linalg.norm(place))
        if kind is None:
            parts.append(_decoy(world, towards, rng))
        else:
            parts += _target(kind, world, towards, rng)
            placed.append(PlacedTarget(kind, place))
    return scan_scene(_with(room, parts), pose, scanner, rng), placed, name


def _free_places(
    room: Scene, pose: RigidTransform, azimuth: float, elevation: float, count: int, rng: Generator
) -> list[Array]:
    """Draw places in the scanner's frame that nothing hides or touches, apart from each other as the scanner sees."""
    caster, origin = RayCaster(room), np.asarray(pose.translation)
    around = 2.0 * np.pi * np.arange(12) / 12
    found: list[Array] = []
    for _ in range(400):
        if len(found) == count:
            break
        free = HALF_FIELD_RAD - 0.04
        a, e = azimuth + rng.uniform(-free, free), elevation + rng.uniform(-free, free)
        direction = directions_of(np.array([a]), np.array([e]))[0]
        if any(
            np.arccos(min(1.0, float(direction @ each) / float(np.linalg.norm(each)))) < APART_RAD for each in found
        ):
            continue
        wide = 0.035
        ring = directions_of(a + wide * np.cos(around) / np.cos(e), e + wide * np.sin(around))
        hits = caster.cast(origin, np.asarray(pose.rotation.apply(np.vstack([direction, ring]))))
        room_m = float(np.min(hits.ranges_m)) - CLEAR_M
        if room_m > NEAREST_M:
            found.append(direction * rng.uniform(NEAREST_M, min(room_m, FARTHEST_M)))
    return found


def _target(kind: TargetKind, centre: Array, towards: Array, rng: Generator) -> list[Part]:
    if kind is TargetKind.SPHERE:
        return [sphere(centre.tolist(), RADIUS_M)]
    if kind is TargetKind.RETRO_CYLINDER:
        return retro_cylinder(centre, RETRO_M)
    side = np.cross(towards, rng.normal(size=3))
    incidence = rng.uniform(0.0, STEEPEST_RAD)
    normal = np.cos(incidence) * towards + np.sin(incidence) * side / np.linalg.norm(side)
    board = facing(centre, normal, float(rng.uniform(0.0, np.pi)))
    return checker_board(board, BOARD_M) if kind is TargetKind.BOARD else [plate(board, RETRO_M, RETRO_M)]


def _decoy(centre: Array, towards: Array, rng: Generator) -> Part:
    """Give a number plate, a retro-reflective sign, or a white plate."""
    pose = facing(centre, towards, float(rng.uniform(0.0, np.pi)))
    which = int(rng.integers(3))
    if which == 0:
        return plate(pose, 0.52, 0.11)
    if which == 1:
        side = float(rng.uniform(0.2, 0.6))
        return plate(pose, side, side)
    return plate(pose, 0.2, 0.2, BOARD_WHITE)


def _with(room: Scene, parts: list[Part]) -> Scene:
    """Put parts into a scene."""
    edges = np.empty((0, 2, 3))
    own = [
        Part(room.vertices, room.triangles[room.material_ids == k], edges, material)
        for k, material in enumerate(room.materials)
    ]
    return scene_from_parts(room.name, [*own, *parts], room.stations)
