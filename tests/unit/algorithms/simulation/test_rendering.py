"""Virtual photos show what geometry, light and lens say, and their truth says what they show."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.errors import InvalidInputError
from algorithms.geometry.cameras import Camera
from algorithms.simulation.curved_parts import tube
from algorithms.simulation.house import house_scene
from algorithms.simulation.materials import PAINT, PLASTER, STEEL, Material
from algorithms.simulation.parts import Part, box, moved, polygons
from algorithms.simulation.rendering import _ideal_pixels, lattice, render_photo, station_photos
from algorithms.simulation.rendering_shading import Shading
from algorithms.simulation.rendering_truth import EdgeKind, TrueEdges, visible_edges
from algorithms.simulation.scene import Scene, scene_from_parts
from algorithms.simulation.stations import station_pose
from algorithms.simulation.sun import Daylight
from algorithms.simulation.textures import Courses, Stripes
from algorithms.simulation.virtual_camera import VirtualCamera, head_angle_towards, scanner_camera, top_mount

SMALL = Camera(320, 240, 260.0, 261.0, 158.0, 121.0)
BENT = replace(SMALL, k1=-0.12, k2=0.05, p1=1e-3, p2=-8e-4)
QUIET = VirtualCamera(camera=SMALL, read_noise=0.0, shot_noise=0.0, vignetting=0.0)
BENT_QUIET = replace(QUIET, camera=BENT)
BEHIND = Daylight(azimuth_rad=np.deg2rad(-120.0), elevation_rad=np.deg2rad(35.0))
"""The sun stands behind the photographer, who looks along y, and to the left."""
CLOUDY = Daylight(sun_share=0.0)


def _looking_north(x: float = 0.0, y: float = 0.0, z: float = 1.5, turn_rad: float = 0.0) -> RigidTransform:
    """A level camera: its right is the world's x, its forward the world's y; then turned about its axis."""
    level = Rotation.from_matrix([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    return RigidTransform.from_components([x, y, z], level * Rotation.from_rotvec([0.0, 0.0, turn_rad]))


def _scene(*parts: Part) -> Scene:
    return scene_from_parts("test", parts, [])


def _wall(material: Material = PLASTER, y: float = 10.0, low_x: float = -8.0, high_x: float = 8.0) -> Part:
    return polygons([np.array([(low_x, y, -5.0), (high_x, y, -5.0), (high_x, y, 8.0), (low_x, y, 8.0)])], material)


def _photo(scene: Scene, camera: VirtualCamera, daylight: Daylight = BEHIND, turn_rad: float = 0.0) -> np.ndarray:
    pose = _looking_north(turn_rad=turn_rad)
    return render_photo(scene, pose, camera, np.random.default_rng(1), daylight)


def _truth(scene: Scene, camera: VirtualCamera, daylight: Daylight = BEHIND, turn_rad: float = 0.0) -> TrueEdges:
    return visible_edges(scene, _looking_north(turn_rad=turn_rad), camera, daylight)


def _measured_offsets(photo: np.ndarray, camera: Camera, ends: np.ndarray, reach_px: int = 6) -> np.ndarray:
    """Where the photo shows an edge with ideal ends (2, 2), minus where it should be, across rows or columns [px].

    In each row (column) the pixels across the edge are added up: what is missing to the level on one side tells the
    place of the edge, whatever the symmetric blur. Rows near the ends are left out.
    """
    grey = photo.astype(np.float64).mean(axis=2)
    line = ends[0] + np.linspace(0.0, 1.0, 400)[:, None] * (ends[1] - ends[0])
    image = camera.image_from_ideal(line)
    span = np.ptp(image, axis=0)
    axis = int(np.argmax(span))
    if axis == 0:
        grey, image = grey.T, image[:, ::-1]
    image = image[np.argsort(image[:, 1])]
    offsets = []
    for row in range(int(image[0, 1]) + 5, int(image[-1, 1]) - 4):
        expected = float(np.interp(row, image[:, 1], image[:, 0]))
        first = round(expected) - reach_px
        if first < 0 or first + 2 * reach_px >= grey.shape[1] or not 0 <= row < grey.shape[0]:
            continue
        profile = grey[row, first : first + 2 * reach_px + 1]
        width = max(1, reach_px // 3)
        left, right = profile[:width].mean(), profile[-width:].mean()
        offsets.append(first - 0.5 + (profile - right).sum() / (left - right) - expected)
    return np.array(offsets)


def _edge_near(edges: TrueEdges, kind: EdgeKind, x_or_y: int, value: float) -> np.ndarray:
    """The longest edge of a kind whose world ends both have a coordinate."""
    for ends, world, its_kind in zip(edges.ideal, edges.world, edges.kinds, strict=True):
        if its_kind == kind and np.allclose(world[:, x_or_y], value, atol=1e-6):
            return np.asarray(ends)
    raise AssertionError(f"no {kind.name} at {value}")


# --- edges lie where they should -------------------------------------------------------------------------------------


@pytest.mark.parametrize("camera", [QUIET, BENT_QUIET], ids=["pinhole", "distorted"])
@pytest.mark.parametrize("turn_rad", [0.0, 0.03, 0.4], ids=["upright", "slightly turned", "slanting"])
def test_projected_edges_of_a_body_fall_on_rendered_ones(camera: VirtualCamera, turn_rad: float) -> None:
    scene = _scene(_wall(), box((-2.0, 7.0, 0.4), (1.4, 7.5, 2.5), STEEL))
    photo = _photo(scene, camera, CLOUDY, turn_rad)
    edges = _truth(scene, camera, CLOUDY, turn_rad)
    front = [ends for ends, world in zip(edges.ideal, edges.world, strict=True) if np.allclose(world[:, 1], 7.0)]
    assert len(front) == 4
    offsets = [np.mean(_measured_offsets(photo, camera.camera, ends)) for ends in front]
    # Rounding to 8 bits and the random lattice leave 0.03 px a row, averaged over some hundred rows.
    np.testing.assert_allclose(offsets, 0.0, atol=0.02)


@pytest.mark.parametrize("column_m", [-1.0, -0.99, -0.983])
def test_a_painted_stripe_begins_where_the_paint_begins(column_m: float) -> None:
    paint = replace(PLASTER, texture=Stripes((0.1, 0.1, 0.4), columns_m=((column_m, column_m + 2.0),)))
    scene = _scene(_wall(paint))
    photo = _photo(scene, QUIET)
    # On a wall along x, seen from the south, u runs along -x.
    ends = _edge_near(_truth(scene, QUIET), EdgeKind.MATERIAL, 0, -column_m)
    assert abs(np.mean(_measured_offsets(photo, SMALL, ends))) < 0.02


def test_distortion_bends_straight_edges_as_the_model_says() -> None:
    scene = _scene(_wall(high_x=-4.5))
    ends = _edge_near(_truth(scene, BENT_QUIET, CLOUDY), EdgeKind.GEOMETRY, 0, -4.5)
    offsets = _measured_offsets(_photo(scene, BENT_QUIET, CLOUDY), BENT, ends)
    image = BENT.image_from_ideal(ends[0] + np.linspace(0.0, 1.0, 50)[:, None] * (ends[1] - ends[0]))
    assert np.ptp(image[:, 0]) > 2.0
    # Of single rows: the lattice's spacing of 1/34 px and 8 bits.
    assert np.abs(offsets).max() < 0.05


def test_shadows_lie_where_geometry_says() -> None:
    # A bar before the wall; its lower front edge at y = 7.8, z = 2.5 throws its shadow along the sun onto y = 10.
    scene = _scene(_wall(), box((-20.0, 7.8, 2.5), (20.0, 8.0, 3.3), STEEL))
    towards = BEHIND.towards_sun
    height = 2.5 - (10.0 - 7.8) * towards[2] / -towards[1]
    ends = _edge_near(_truth(scene, QUIET), EdgeKind.SHADOW, 2, height)
    assert abs(np.mean(_measured_offsets(_photo(scene, QUIET), SMALL, ends))) < 0.02


@pytest.mark.parametrize("height_m", [0.0005, 0.002, 3.0])
def test_a_shadow_reaches_from_the_foot_of_a_wall_to_where_the_sun_passes_over_it(height_m: float) -> None:
    """A lit thread along the foot would move the edge that a photo shows there."""
    wall = polygons(
        [np.array([(-8.0, 10.0, 0.0), (8.0, 10.0, 0.0), (8.0, 10.0, height_m), (-8.0, 10.0, height_m)])], PLASTER
    )
    ground = polygons([np.array([(-8.0, 0.0, 0.0), (8.0, 0.0, 0.0), (8.0, 20.0, 0.0), (-8.0, 20.0, 0.0)])], PLASTER)
    sun = Daylight(azimuth_rad=np.deg2rad(90.0), elevation_rad=np.deg2rad(45.0))
    before_wall_m = height_m * np.array([0.02, 0.3, 0.6, 0.8, 1.2, 1.5])
    points = np.column_stack([np.full(6, 0.1), 10.0 - before_wall_m, np.zeros(6)])
    eye = np.array([0.0, 2.0, 1.5])
    rays = (points - eye) / np.linalg.norm(points - eye, axis=1)[:, None]
    assert Shading(_scene(wall, ground), sun).look(eye, rays).lit.tolist() == [False] * 4 + [True] * 2


def test_a_sun_with_a_disc_throws_half_shadows_around_the_sharp_edge() -> None:
    scene = _scene(_wall(), box((-20.0, 7.8, 2.5), (20.0, 8.0, 3.3), STEEL))
    disc = replace(BEHIND, sun_radius_rad=0.05)
    camera = replace(QUIET, blur_px=0.0)
    sharp, soft = (_photo(scene, camera, light)[127:175, 100:220].astype(np.float64) for light in (BEHIND, disc))
    # Down the columns from the shadow of the bar to the wall below it in the sun.
    sharp_rise, soft_rise = (np.diff(photo.mean(axis=(1, 2))) for photo in (sharp, soft))
    rows = np.arange(len(soft_rise))
    np.testing.assert_allclose(np.average(rows, weights=soft_rise), np.average(rows, weights=sharp_rise), atol=0.1)
    # Seen from the wall, the bar crosses a disc of radius 0.05 rad: a quarter of it is the standard deviation of what
    # appears; the shadow moves by dz = 2.2 m d(tan of the sun's height over the wall) and a pixel is 10 m / 261.
    towards = disc.towards_disc(np.array([(np.cos(a), np.sin(a)) for a in np.linspace(0.0, 2.0 * np.pi, 721)]))
    half_m = 2.2 * np.ptp(towards[:, 2] / -towards[:, 1]) / 2.0
    spread = np.sqrt(np.average((rows - np.average(rows, weights=soft_rise)) ** 2, weights=soft_rise))
    np.testing.assert_allclose(spread, 0.5 * half_m * 26.1, rtol=0.1)


def test_outlines_of_a_pillar_lie_where_its_radius_says() -> None:
    scene = _scene(_wall(PAINT), tube((0.3, 6.0, -5.0), (0.3, 6.0, 8.0), 0.5, STEEL))
    edges = _truth(scene, QUIET, CLOUDY)
    outlines = edges.ideal[edges.kinds == EdgeKind.OUTLINE]
    assert len(outlines) == 2
    photo = _photo(scene, replace(QUIET, blur_px=0.0), CLOUDY)
    # The facets of the mesh lie within 0.1 mm of the cylinder, 0.005 px here. A narrow profile, because the brightness
    # of the pillar changes beside its outline.
    offsets = [np.mean(_measured_offsets(photo, SMALL, ends, reach_px=2)) for ends in outlines]
    np.testing.assert_allclose(offsets, 0.0, atol=0.02)


def test_facets_of_a_pillar_cannot_be_seen() -> None:
    scene = _scene(_wall(PAINT), tube((0.0, 4.0, -5.0), (0.0, 4.0, 8.0), 1.0, PAINT))
    camera = replace(QUIET, blur_px=0.0, camera=replace(SMALL, fx=500.0, fy=500.0))
    row = _photo(scene, camera, Daylight(azimuth_rad=np.deg2rad(-170.0)))[120].astype(np.float64).mean(axis=1)
    # Inside the outline, at columns 158 ± 129, brightness changes by a level or so from pixel to pixel.
    assert np.abs(np.diff(row[60:250])).max() < 3.0


def test_rays_through_pixels_are_those_of_the_camera_model() -> None:
    camera = scanner_camera(0.3)
    ideal = _ideal_pixels(camera).reshape(camera.height, camera.width, 2)
    which = np.random.default_rng(0).integers((0, 0), (camera.width, camera.height), size=(5000, 2))
    expected = camera.ideal_from_image(which.astype(np.float64))
    np.testing.assert_allclose(ideal[which[:, 1], which[:, 0]], expected, atol=2e-6)


def test_far_from_the_worlds_origin_the_photo_is_the_same() -> None:
    parts = [
        _wall(),
        box((-2.0, 7.0, 0.4), (1.4, 7.5, 2.5), STEEL),
        tube((2.0, 6.0, -5.0), (2.0, 6.0, 8.0), 0.5, STEEL),
    ]
    shift = RigidTransform.from_translation([500_000.0, 5_300_000.0, 400.0])
    near, far = (
        render_photo(_scene(*placed), motion * _looking_north(), QUIET, np.random.default_rng(2), BEHIND).astype(int)
        for placed, motion in ((parts, RigidTransform.identity()), (moved(parts, shift), shift))
    )
    # A few of the 34 rays of a pixel may fall to the other side of an edge.
    assert np.mean(near != far) < 1e-3
    assert np.abs(near - far).max() <= 8


# --- what is seen ----------------------------------------------------------------------------------------------------


def test_what_stands_behind_the_camera_is_not_drawn() -> None:
    wall = _wall()
    behind = box((-3.0, -6.0, 0.0), (3.0, -4.0, 4.0), STEEL)
    np.testing.assert_array_equal(_photo(_scene(wall), QUIET, CLOUDY), _photo(_scene(wall, behind), QUIET, CLOUDY))


def test_a_bar_thinner_than_a_pixel_leaves_no_gaps() -> None:
    # 1 cm at 10 m is a quarter of a pixel; it slants over the pixels' rows.
    ring = np.array([(-3.0, 9.9, 1.00), (3.0, 9.9, 1.30), (3.0, 9.9, 1.31), (-3.0, 9.9, 1.01)])
    photo = _photo(_scene(_wall(PAINT), polygons([ring], STEEL)), replace(QUIET, blur_px=0.0), CLOUDY)
    darkest = photo[100:160, 90:230].mean(axis=2).sum(axis=0) - 60.0 * photo[10, 10].mean()
    # In every column the same light is missing, a quarter pixel of the difference.
    np.testing.assert_allclose(darkest, np.median(darkest), rtol=0.35)


def test_a_hidden_edge_is_not_among_the_true_ones() -> None:
    scene = _scene(_wall(), box((-1.0, 12.0, 0.0), (1.0, 13.0, 2.0), STEEL))
    assert not np.any(_truth(scene, QUIET).world[:, :, 1] > 10.5)


def test_a_partly_hidden_edge_ends_at_what_hides_it() -> None:
    scene = _scene(
        _wall(), box((-2.0, 8.0, 1.0), (2.0, 8.2, 2.0), STEEL), box((0.5, 5.0, -3.0), (0.9, 5.2, 6.0), PAINT)
    )
    edges = _truth(scene, QUIET, CLOUDY)
    top = edges.world[np.all(np.abs(edges.world[:, :, 1:] - (8.0, 2.0)) < 1e-9, axis=(1, 2))]
    # From the eye the post hides x = 0.8 to 1.44 at a distance of 8 m; the walk along the edge has steps of a pixel.
    cuts = np.sort(top[:, :, 0].ravel())
    np.testing.assert_allclose(cuts, [-2.0, 0.5 * 8.0 / 5.0, 0.9 * 8.0 / 5.0, 2.0], atol=0.08)


def test_a_view_of_nothing_has_no_edges() -> None:
    # All of it stands behind the camera.
    assert len(_truth(_scene(_wall(y=-10.0)), QUIET)) == 0


def test_an_edge_with_another_closely_beside_does_not_stand_alone() -> None:
    # At 10 m a pixel is 38 mm wide: a strip of 20 mm is narrower, one of 1 m is not.
    paint = replace(PLASTER, texture=Stripes((0.1, 0.1, 0.4), levels_m=((0.5, 0.52), (2.0, 3.0))))
    edges = _truth(_scene(_wall(paint)), QUIET, CLOUDY)
    material = edges[edges.kinds == EdgeKind.MATERIAL]
    wide = material.world[:, 0, 2] > 1.0
    assert np.count_nonzero(wide) == 2
    np.testing.assert_array_equal(material.alone[wide], 1.0)
    np.testing.assert_array_equal(material.alone[~wide], 0.0)


def test_a_shadow_edge_needs_the_sun() -> None:
    scene = _scene(_wall(), box((-20.0, 7.8, 2.5), (20.0, 8.0, 3.3), STEEL))
    night = replace(BEHIND, elevation_rad=-0.1)
    assert EdgeKind.SHADOW in _truth(scene, QUIET).kinds
    assert EdgeKind.SHADOW not in _truth(scene, QUIET, night).kinds


def test_brick_courses_are_edges_that_geometry_does_not_have() -> None:
    bricks = replace(PLASTER, texture=Courses(course_m=0.5, length_m=1.5, joint_m=0.1))
    edges = _truth(_scene(_wall(bricks)), QUIET, CLOUDY)
    beds = edges.world[edges.kinds == EdgeKind.MATERIAL]
    heights = np.unique(np.round(beds[:, 0, 2], 6))
    # The photo shows about 9 m of the wall: 18 courses with two edges each.
    assert len(heights) >= 34
    courses = np.minimum(
        np.abs(heights - np.rint(2.0 * heights) / 2.0), np.abs(heights - 0.1 - np.rint(2.0 * heights - 0.2) / 2.0)
    )
    np.testing.assert_allclose(courses, 0.0, atol=1e-6)


def test_a_horizon_is_an_edge() -> None:
    ground = np.array([(-90.0, -5.0, 0.0), (90.0, -5.0, 0.0), (90.0, 60.0, 0.0), (-90.0, 60.0, 0.0)])
    edges = _truth(_scene(polygons([ground], STEEL, with_edges=False)), QUIET)
    assert len(edges) == 1
    np.testing.assert_allclose(edges.world[0, :, 1:], [(60.0, 0.0)] * 2, atol=1e-9)


@pytest.mark.slow
def test_true_edges_of_a_house_are_where_its_photo_changes() -> None:
    scene, camera = (
        house_scene(),
        VirtualCamera(camera=scanner_camera(0.15), read_noise=0.0, shot_noise=0.0, blur_px=0.0),
    )
    pose = scene.stations[0] * camera.scan_from_camera(np.deg2rad(20.0))
    grey = render_photo(scene, pose, camera, np.random.default_rng(0)).astype(np.float64).mean(axis=2)
    edges = visible_edges(scene, pose, camera, min_length_px=20.0, min_contrast=15.0)
    assert len(edges) > 40
    slope = np.hypot(*np.gradient(grey))
    for ends in edges.ideal:
        points = camera.camera.image_from_ideal(ends[0] + np.linspace(0.1, 0.9, 9)[:, None] * (ends[1] - ends[0]))
        column, row = np.rint(points[camera.camera.inside(points)]).astype(int).T
        near = [slope[max(0, r - 1) : r + 2, max(0, c - 1) : c + 2].max() for r, c in zip(row, column, strict=True)]
        assert np.median(near) > 4.0


# --- light and sensor ------------------------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_photo() -> None:
    scene = _scene(_wall(), box((-2.0, 7.0, 0.4), (1.4, 7.5, 2.5), STEEL))
    noisy = replace(QUIET, read_noise=1.0)
    np.testing.assert_array_equal(_photo(scene, noisy), _photo(scene, noisy))


def test_noise_has_the_stated_standard_deviation() -> None:
    scene, noisy = _scene(_wall()), replace(QUIET, read_noise=2.0, shot_noise=0.03)
    still, moving = (_photo(scene, camera).astype(np.float64) for camera in (QUIET, noisy))
    level = still[100, 100]
    measured = (moving - still)[20:-20, 20:-20].std(axis=(0, 1))
    # Rounding adds a twelfth; 56 000 pixels tell a standard deviation to 0.3 %.
    np.testing.assert_allclose(measured, np.sqrt(4.0 + 0.03 * level + 1.0 / 12.0), rtol=0.02)


def test_a_white_face_turned_to_the_sun_has_the_stated_exposure() -> None:
    white = Material("white", 1.0)
    ring = np.array([(-9.0, -9.0, 0.0), (9.0, -9.0, 0.0), (9.0, 9.0, 0.0), (-9.0, 9.0, 0.0)])
    down = RigidTransform.from_components([0.0, 0.0, 4.0], Rotation.from_rotvec([np.pi, 0.0, 0.0]))
    noon = Daylight(elevation_rad=np.pi / 2, sun_share=0.8)
    camera = replace(QUIET, exposure=0.9)
    photo = render_photo(_scene(polygons([ring], white)), down, camera, np.random.default_rng(0), noon)
    # All of the sun, and of the sky what comes from above and from no side: 1 - 0.1, tinted.
    expected = 255.0 * 0.9 * (0.8 + 0.2 * 0.9 * np.array([0.93, 0.97, 1.0]))
    np.testing.assert_allclose(photo[120, 160], expected, atol=0.51)


def test_corners_are_darker_by_the_vignetting() -> None:
    photo = _photo(_scene(_wall()), replace(QUIET, vignetting=0.3), CLOUDY).astype(np.float64)
    even = _photo(_scene(_wall()), QUIET, CLOUDY).astype(np.float64)
    # The corner farthest from the principal point is the lower left or right one; rounding is half a level.
    corner = max(((r, c) for r in (0, 239) for c in (0, 319)), key=lambda p: np.hypot(p[0] - SMALL.cy, p[1] - SMALL.cx))
    np.testing.assert_allclose(photo[corner] / even[corner], 0.7, atol=0.01)
    np.testing.assert_allclose(photo[121, 158], even[121, 158], atol=1.0)


def test_rays_of_the_lattice_are_evenly_spaced_on_both_sides() -> None:
    for count in (1, 8, 16, 34):
        expected = (np.arange(count) + 0.5) / count
        np.testing.assert_allclose(np.sort(lattice(count), axis=0), np.column_stack([expected, expected]), atol=1e-12)


@pytest.mark.parametrize("changes", [{"blur_px": -1.0}, {"exposure": 0.0}, {"vignetting": 1.0}, {"edge_samples": 0}])
def test_a_camera_that_cannot_be_is_refused(changes: dict[str, float]) -> None:
    with pytest.raises(InvalidInputError, match="virtual camera"):
        replace(QUIET, **changes)


# --- the camera on the scanner ---------------------------------------------------------------------------------------


def test_the_camera_on_top_looks_where_the_head_points() -> None:
    camera = VirtualCamera(mount=top_mount(0.05, 0.0, 0.24, down_rad=0.1))
    pose = camera.scan_from_camera(np.pi / 2)
    np.testing.assert_allclose(pose.translation, [0.0, 0.05, 0.24], atol=1e-15)
    forward, right = pose.rotation.apply([(0.0, 0.0, 1.0), (1.0, 0.0, 0.0)])
    np.testing.assert_allclose(forward, [0.0, np.cos(0.1), -np.sin(0.1)], atol=1e-15)
    np.testing.assert_allclose(right, [1.0, 0.0, 0.0], atol=1e-15)


def test_the_head_turns_the_camera_to_a_point() -> None:
    station, camera = station_pose((3.0, -2.0, 1.6), 2.1, 0.05, -0.08), VirtualCamera()
    point = np.array([-6.0, 9.0, 4.0])
    pose = station * camera.scan_from_camera(head_angle_towards(station, point))
    # The projection centre lies before the head's axis and above it: only upright the point is off the middle.
    assert abs(pose.inv().apply(point)[0]) < 1e-12


def test_photos_of_a_station_look_from_the_scanner_around_it() -> None:
    wall = _scene(_wall(PAINT, low_x=-30.0, high_x=30.0))
    station = station_pose((0.0, 0.0, 1.5), np.deg2rad(30.0))
    # The wall is in the north: 60 degrees from the scanner's x axis. Photo sides are 63 degrees apart.
    poses = [QUIET.scan_from_camera(np.deg2rad(angle)) for angle in (60.0, -120.0)]
    photos = list(station_photos(wall, station, QUIET, poses, np.random.default_rng(0), CLOUDY))
    assert [p.scan_from_camera for p in photos] == poses
    sky = np.rint(255.0 * QUIET.exposure * np.array(CLOUDY.sky_color))
    assert not np.allclose(photos[0].image[120, 160], sky, atol=1.0)
    np.testing.assert_allclose(photos[1].image[120, 160], sky, atol=1.0)
