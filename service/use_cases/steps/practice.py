"""Practice on a tiny room, which loads compiled kernels, or compiles them where nobody did before.

What is not called here is compiled by each computation that calls it, for itself alone: a test compares what is called
here with all kernels that there are.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, get_args

import numpy as np
from jaxtyping import UInt8
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Points, Scalars
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.cameras import Camera
from algorithms.registration import RegistrationMethod
from algorithms.registration.method import ProposingMethod
from algorithms.scans.scan import Scan, ScanGrid

if TYPE_CHECKING:
    # loaded where it is needed: this module is loaded by every computation
    from algorithms.cleaning.cleaned_stations import PlacedScan

ROWS, COLUMNS = 180, 360
HALF_ROOM_M = np.array([3.0, 2.2, 1.4])
COLUMN_M, RADIUS_M = np.array([-1.2, 0.8]), 0.35
"""A round column, for what is computed of cylinders."""
WAVES_M = 0.003
"""Unevenness of two walls, for what is computed of it."""
PLACE_M = np.array([0.7, -0.4, 0.2])
"""Where the instrument stands."""
CAMERA = Camera(width=400, height=300, fx=260.0, fy=260.0, cx=199.5, cy=149.5)
CORNER = RigidTransform.from_rotation(Rotation.from_euler("ZX", [30.0, -90.0], degrees=True))
"""scan_from_camera of a camera in the instrument that looks at a corner of the room."""
NOISE_M = 0.002


def practise() -> None:
    """Register two scans by the default method, whose kernels most others share; starts no threads."""
    from algorithms.progress import NoProgress
    from algorithms.registration import DEFAULT_METHOD
    from algorithms.registration.base import RegistrationProblem
    from algorithms.scans.range_image import visibility
    from algorithms.scans.voxel_grid_kernels import first_of_each

    first_of_each(np.zeros(2, dtype=np.int64))  # as points are ordered for the viewer
    first, second = (_features_of(tiny_room(structured=structured)) for structured in (True, False))
    DEFAULT_METHOD().register(RegistrationProblem(first, second), progress=NoProgress())
    if first.seen is not None:
        visibility(first.surface.points, first.seen)


def practise_on_methods() -> None:
    """Register two scans by all methods that propose a pose in a way of their own; whatever comes of it."""
    from algorithms.progress import NoProgress
    from algorithms.registration.base import RegistrationProblem

    first, second = (_features_of(tiny_room(structured=structured)) for structured in (True, False))
    problem = RegistrationProblem(first, second)
    for method in proposing_methods().values():
        method().register(problem, progress=NoProgress())


def proposing_methods() -> Mapping[str, type[ProposingMethod]]:
    """Give the methods that need more than the default one, by name."""
    return {method.name: method for method in get_args(RegistrationMethod) if issubclass(method, ProposingMethod)}


def practise_on_clouds() -> None:
    """Clean, colour and compare two scans in all ways."""
    from algorithms.cleaning.cleaned_stations import placed

    scans = [tiny_room(structured=True), tiny_room(structured=False)]
    stations = [placed(scan, RigidTransform.identity(), np.zeros(3)) for scan in scans]
    _clean(stations)
    _colour(stations[0])
    _compare(stations[1].scan.points)


def _features_of(scan: Scan) -> ScanFeatures:
    from algorithms.features.extraction import extract_features
    from algorithms.features.options import FeatureOptions
    from algorithms.progress import NoProgress

    return extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))


def _clean(stations: "Sequence[PlacedScan]") -> None:
    from algorithms.cleaning import options
    from algorithms.cleaning.cleaned_stations import clean_stations
    from algorithms.progress import NoProgress

    for filter_ in options.SmoothingFilter:
        wanted = options.CleaningOptions(
            box=options.BoxCrop((-9.0, -9.0, -9.0), (9.0, 9.0, 9.0)),
            polygon=options.PolygonCrop(((-9.0, -9.0), (9.0, -9.0), (0.0, 9.0))),
            moved_objects=options.MovedObjects(),
            best_view=options.BestView(),
            voxel=options.VoxelThinning(0.2),
            smoothing=options.Smoothing(filter_, passes=1),
            curvature=options.CurvatureThinning(),
        )
        clean_stations(stations, np.zeros(3), wanted, NoProgress())


def _colour(station: "PlacedScan") -> None:
    from algorithms.cleaning.best_view import point_normals
    from algorithms.colouring.coloured_cloud import coloured_cloud
    from algorithms.colouring.options import ColouringOptions
    from algorithms.colouring.photo_views import PlacedPhoto
    from algorithms.progress import NoProgress

    points, normals = station.scan.points, point_normals(station.scan)
    normals[np.einsum("ij,ij->i", normals, points) > 0.0] *= -1.0
    photos = [PlacedPhoto(name, "room", CAMERA, CORNER, tiny_photo) for name in ("first", "second")]
    coloured_cloud(points, normals, photos, ColouringOptions(), NoProgress())


def _compare(points: Points) -> None:
    """Compare the tiny room with itself in both ways of averaging."""
    from algorithms.deviations.joint_poses import exact_poses
    from algorithms.deviations.m3c2 import m3c2
    from algorithms.deviations.options import Average, M3C2Options, WavesOf

    for average, waves in zip(Average, WavesOf, strict=True):
        options = M3C2Options(0.3, 0.5, (0.5,), average, waves=waves)
        m3c2(points, points, points[::20], exact_poses(), options, rng=np.random.default_rng(0))


def practise_on_networks() -> None:
    """Factorise and invert tiny normal equations, for the same reason."""
    from scipy import sparse

    from algorithms.adjustment.hybrid.factor_kernels import normal_of_blocks
    from algorithms.adjustment.hybrid.sparse_factor import Factor, Ordering

    rows = np.repeat(np.arange(8, dtype=np.int32), 2)
    columns = np.stack([np.arange(8) % 4, (np.arange(8) + 1) % 4], axis=1).ravel().astype(np.int32)
    values = 1.0 + np.arange(16.0)
    jacobian = sparse.csr_array(sparse.coo_array((values, (rows, columns)), shape=(8, 4)))
    factor = Factor(jacobian, np.ones(8), Ordering.of(jacobian), np.zeros(4))
    factor.solved(np.ones(4))
    every = np.arange(4, dtype=np.int64)
    factor.elements(every, every)
    factor.row_products(jacobian, every, every)
    factor.row_products(jacobian, every, every.copy())  # of pairs of rows, not of each with itself
    factor.row_gains(jacobian, every, columns.reshape(8, 2)[:4].astype(np.int64))
    ones = np.ones(8, dtype=np.int64)
    normal_of_blocks(ones, np.ones(8), jacobian.indptr, jacobian.indices, jacobian.data, 4)


def practise_on_terrain() -> None:
    """Find the ground of a tiny slope by all filters, learn from it, predict it, and let it rain there."""
    from algorithms.progress import NoProgress
    from algorithms.terrain.drainage.rain import rain_on, runoff_of_rounds
    from algorithms.terrain.ground import ground_of
    from algorithms.terrain.learned_slope import LabelledTerrain, learned_slope
    from algorithms.terrain.linear_prediction import Covariance
    from algorithms.terrain.models import terrain_models
    from algorithms.terrain.options import EVERY_FILTER, SlopeFilter

    points = np.random.default_rng(0).uniform(0.0, 30.0, (900, 3)) * [1.0, 1.0, 0.01]
    grounds = [ground_of(points, chosen(), 1.0, NoProgress()).ground for chosen in EVERY_FILTER.values()]
    learned_slope([LabelledTerrain(points, np.arange(900) < 450)], SlopeFilter(), 1.0, NoProgress())
    models = terrain_models(points, grounds[0], 1.0, Covariance(5.0, 1.0, 0.1), NoProgress())
    runoff_of_rounds(rain_on(models.dtm_m), 1)


def practise_on_strips() -> None:
    """Tie two tiny strips of level ground, then by their roofs, whatever comes of it."""
    from algorithms.errors import AlgorithmError
    from algorithms.progress import NoProgress
    from algorithms.strips.options import PatchOptions, StripOptions
    from algorithms.strips.strip import Strip
    from algorithms.strips.strip_block import adjust_strips

    rng = np.random.default_rng(0)
    times = np.linspace(0.0, 1.0, 4000)
    points = np.column_stack([40.0 * times, 20.0 * (np.linspace(0.0, 40.0, 4000) % 1.0), rng.normal(0.0, 0.01, 4000)])
    swinging = (np.arange(4000) // 100 % 2).astype(np.int8)
    strips = [Strip("first", points, times), Strip("second", points, times, None, swinging)]
    for options in (StripOptions(), StripOptions(patches=PatchOptions(least_rise_m=1.0))):
        with suppress(AlgorithmError):
            adjust_strips(strips, [], options, NoProgress())


def practise_on_triangles() -> None:
    """Look from a point at one triangle, and for the triangle nearest to it."""
    from algorithms.scans.triangle_tree import TriangleTree

    tree = TriangleTree(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.array([[0, 1, 2]]))
    eyes = np.zeros((1, 3))
    tree.first_hits(eyes, eyes + 1.0)
    tree.meets_any(eyes, eyes + 1.0)
    tree.crossings(eyes, eyes + 1.0)
    tree.nearest(eyes)


def practise_on_edges() -> None:
    """Find the edges of a tiny photo in all ways; starts threads."""
    from algorithms.photos.detector import detect_edges
    from algorithms.photos.options import EdgeDetector, EdgeLocalisation, EdgeOptions
    from algorithms.progress import NoProgress

    image = tiny_photo()
    for detector in get_args(EdgeDetector):
        for localisation in get_args(EdgeLocalisation):
            options = EdgeOptions(detector=detector, localisation=localisation)
            detect_edges(image, CAMERA, options, progress=NoProgress())


def practise_on_photos() -> None:
    """Add the lines of a photo to those of its scan; starts threads."""
    from algorithms.features.photo_lines.photo_line_options import PhotoLineOptions
    from algorithms.features.photo_lines.photo_lines import add_photo_lines
    from algorithms.photos.station_photo import StationPhoto, mount_covariance
    from algorithms.progress import NoProgress

    photos = [StationPhoto(tiny_photo(), CAMERA, CORNER, mount_covariance(1e-4, 1e-3))]
    for structured in (True, False):
        scan = tiny_room(structured=structured)
        options = PhotoLineOptions()
        add_photo_lines(_features_of(scan), scan, photos, options, count=len(photos), progress=NoProgress())


def tiny_room(*, structured: bool) -> Scan:
    """Scan a box with a column from inside, from a place off its middle."""
    zenith = np.linspace(0.3, np.pi - 0.3, ROWS)
    azimuth = np.linspace(0.0, 2.0 * np.pi, COLUMNS, endpoint=False)
    theta, phi = np.meshgrid(zenith, azimuth, indexing="ij")
    rays = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1).reshape(-1, 3)
    ranges = np.minimum(_ranges_of_faces(rays).min(axis=1), _ranges_of_column(rays, COLUMN_M - PLACE_M[:2]))
    ranges += np.random.default_rng(0).normal(0.0, NOISE_M, len(ranges))
    index = np.arange(len(rays), dtype=np.int32).reshape(ROWS, COLUMNS)
    points = rays * ranges[:, None]
    on_wall = np.abs(points[:, 0] + PLACE_M[0]) > HALF_ROOM_M[0] - 0.1
    points[:, 0] += np.where(on_wall, WAVES_M * np.sin(4.0 * points[:, 1]) * np.sin(4.0 * points[:, 2]), 0.0)
    return Scan(
        points=points,
        origin_m=np.zeros(3),
        grid=ScanGrid(index) if structured else None,
        sensor_m=np.zeros(3) if structured else None,
    )


def _ranges_of_column(rays: Points, centre_m: Array) -> Scalars:
    """Give how far the column is along each ray; infinity where it is not met."""
    a, b = (rays[:, :2] ** 2).sum(axis=1), rays[:, :2] @ centre_m
    d = b * b - a * (centre_m @ centre_m - RADIUS_M**2)
    met = (d > 0.0) & (b > 0.0)
    return np.where(met, (b - np.sqrt(np.where(met, d, 0.0))) / a, np.inf)


def tiny_photo() -> UInt8[Array, "h w 3"]:
    """Take a photo of that box from the same place: each of its faces has a grey of its own."""
    columns, rows = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    rays = np.stack(
        [(columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy, np.ones(columns.shape)], axis=-1
    )
    rays = CORNER.rotation.apply(rays.reshape(-1, 3))
    face = _ranges_of_faces(rays).argmin(axis=1)
    grey = 60 + 35 * face + 17 * (rays[np.arange(len(rays)), face] > 0.0)
    return np.repeat(grey.astype(np.uint8).reshape(columns.shape)[:, :, None], 3, axis=2)


def _ranges_of_faces(rays: Points) -> Points:
    """Give how far the walls and the floor or ceiling that each ray runs to are along it, one column an axis."""
    with np.errstate(divide="ignore"):
        return np.asarray((np.copysign(HALF_ROOM_M, rays) - PLACE_M) / rays)
