"""The scenes for photos have what photos need."""

import numpy as np
import pytest

from algorithms.simulation.bridge import bridge_parts, bridge_scene
from algorithms.simulation.house import house_front_scene, house_scene
from algorithms.simulation.ray_casting import RayCaster
from algorithms.simulation.rendering_truth import EdgeKind, visible_edges
from algorithms.simulation.scanner import directions_of
from algorithms.simulation.scene import Scene, scene_edges, scene_from_parts
from algorithms.simulation.virtual_camera import VirtualCamera, head_angle_towards, scanner_camera

CAMERA = VirtualCamera(camera=scanner_camera(0.4))


def _seen_edges(scene: Scene, station: int, target_m: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """World directions and kinds of the true edges longer than 30 px in a photo that looks at a point."""
    pose = scene.stations[station]
    photo = pose * CAMERA.scan_from_camera(head_angle_towards(pose, np.array(target_m)))
    edges = visible_edges(scene, photo, CAMERA, min_length_px=30.0, min_contrast=8.0)
    runs = edges.world[:, 1] - edges.world[:, 0]
    return runs / np.linalg.norm(runs, axis=1, keepdims=True), edges.kinds


@pytest.mark.parametrize("angle", [np.pi, 0.0], ids=["half a turn", "mirrored"])
def test_the_bridge_is_symmetric_about_its_middle(angle: float) -> None:
    scene = scene_from_parts("bridge alone", bridge_parts(), [])
    # Edges, because the facets of a pillar need not be laid symmetrically.
    edges = scene_edges(scene)
    moved = edges * ((-1.0, -1.0, 1.0) if angle else (-1.0, 1.0, 1.0))

    def rounded(e: np.ndarray) -> set[tuple[tuple[float, ...], ...]]:
        return {tuple(sorted(tuple(float(x) + 0.0 for x in p) for p in ends)) for ends in np.round(e, 6) + 0.0}

    assert rounded(moved) == rounded(edges)
    axes = {(round(abs(c.start_m[0]), 6), c.radius_m) for c in scene.cylinders}
    assert len(scene.cylinders) == 2
    assert len(axes) == 1


def test_the_long_edges_of_the_bridge_are_parallel() -> None:
    edges = scene_edges(bridge_scene())
    runs = edges[:, 1] - edges[:, 0]
    lengths = np.linalg.norm(runs, axis=1)
    bridge = runs[(lengths > 30.0) & (np.abs(edges[:, 0, 1]) < 3.0)]
    assert len(bridge) > 30
    np.testing.assert_allclose(np.abs(bridge[:, 0]) / np.linalg.norm(bridge, axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize("station", [0, 1])
def test_photos_of_the_bridge_show_its_long_edges_and_both_pillars(station: int) -> None:
    directions, kinds = _seen_edges(bridge_scene(), station, (0.0, 0.0, 4.0))
    assert np.count_nonzero((np.abs(directions[:, 0]) > 0.999) & (kinds == EdgeKind.GEOMETRY)) >= 15
    assert np.count_nonzero(kinds == EdgeKind.OUTLINE) >= 4


@pytest.mark.parametrize("station", [0, 1])
def test_photos_of_the_front_show_its_windows_along_both_directions(station: int) -> None:
    directions, kinds = _seen_edges(house_front_scene(), station, (5.5, 0.0, 4.0))
    lines = np.isin(kinds, (EdgeKind.GEOMETRY, EdgeKind.MATERIAL))
    assert np.count_nonzero(lines & (np.abs(directions[:, 0]) > 0.999)) >= 12
    assert np.count_nonzero(lines & (np.abs(directions[:, 2]) > 0.999)) >= 12
    assert EdgeKind.MATERIAL in kinds


@pytest.mark.parametrize("station", [0, 1])
def test_a_scan_of_the_front_holds_the_shift_along_it_by_few_points(station: int) -> None:
    scene = house_front_scene()
    pose = scene.stations[station]
    azimuths, elevations = np.meshgrid(
        np.deg2rad(np.arange(0.0, 360.0, 0.25)), np.deg2rad(np.arange(-60.0, 60.0, 0.25))
    )
    rays = pose.rotation.apply(directions_of(azimuths.ravel(), elevations.ravel()))
    hits = RayCaster(scene).cast(np.asarray(pose.translation), rays)
    building = hits.found & (np.array([m.name for m in scene.materials])[scene.material_ids][hits.triangles] != "lawn")
    across = np.abs(scene.normals[hits.triangles[building], 0]) > 0.1
    # Reveals of windows, the ends of sills and the downpipe.
    assert 0.001 < np.mean(across) < 0.03


def test_the_house_itself_is_as_it_was() -> None:
    """Other tests and figures rest on its geometry."""
    scene = house_scene()
    assert (len(scene.vertices), len(scene.triangles), len(scene.stations)) == (4730, 5498, 7)
