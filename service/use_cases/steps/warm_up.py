"""What computations need loaded before they begin: libraries, and compiled kernels."""

from typing import get_args

import numpy as np

from algorithms.arrays import Array, Points, Scalars
from algorithms.scans.scan import Scan, ScanGrid

ROWS, COLUMNS = 180, 360
HALF_ROOM_M = np.array([3.0, 2.2, 1.4])
COLUMN_M, RADIUS_M = np.array([-1.2, 0.8]), 0.35
"""A round column, for what is computed of cylinders."""
WAVES_M = 0.003
"""Unevenness of two walls, for what is computed of it."""
NOISE_M = 0.002


def load_for_reading() -> None:
    """Load what reading a file needs."""
    import service.formats
    import service.use_cases.steps.run_features  # noqa: F401 - loaded for the computations


def load_for_registration() -> None:
    """Load the libraries that a registration needs; starts no threads."""
    import algorithms.features.extraction
    import algorithms.registration.auto_registration
    import algorithms.registration.line_registration  # noqa: F401 - loaded for the computations
    from service.use_cases.documents import line_counts, pair_documents  # noqa: F401
    from service.use_cases.steps import link_store, run_pair, station_priors  # noqa: F401

    load_for_reading()


def load_for_reports() -> None:
    """Load what networks and reports need."""
    import ezdxf  # noqa: F401 - loaded for the computations
    import networkx as nx  # noqa: F401

    from service.use_cases.steps import run_network, run_network_growth, run_registration_report  # noqa: F401


def practise() -> None:
    """Register two scans of a tiny room, which loads compiled kernels, or compiles them where nobody did before.

    What is not called here is compiled by each computation that calls it, for itself alone.
    """
    from algorithms.features.extraction import extract_features
    from algorithms.features.options import FeatureOptions
    from algorithms.progress import NoProgress
    from algorithms.registration import DEFAULT_METHOD
    from algorithms.registration.base import RegistrationProblem

    features = [
        extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))
        for scan in (tiny_room(structured=True), tiny_room(structured=False))
    ]
    problem = RegistrationProblem(features[0], features[1])
    DEFAULT_METHOD().register(problem, progress=NoProgress())
    _practise_on_deviations()


def _practise_on_deviations() -> None:
    """Compare the tiny room with itself in both ways of averaging."""
    from algorithms.deviations.joint_poses import exact_poses
    from algorithms.deviations.m3c2 import m3c2
    from algorithms.deviations.options import Average, M3C2Options, WavesOf

    points = tiny_room(structured=False).points
    for average, waves in zip(Average, WavesOf, strict=True):
        options = M3C2Options(0.3, 0.5, (0.5,), average, waves=waves)
        m3c2(points, points, points[::20], exact_poses(), options, rng=np.random.default_rng(0))


def practise_on_networks() -> None:
    """Factorise and invert tiny normal equations, for the same reason."""
    from scipy import sparse

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
    factor.row_gains(jacobian, every, columns.reshape(8, 2)[:4].astype(np.int64))


def practise_on_photos() -> None:
    """Find the edges of a tiny photo in all ways, as `practise`; starts threads."""
    from algorithms.photos.detector import detect_edges
    from algorithms.photos.options import EdgeDetector, EdgeLocalisation, EdgeOptions
    from algorithms.progress import NoProgress

    image = np.full((120, 160), 40, np.uint8)
    image[30:90, 40:120], image[:, 60:62] = 200, 255
    for detector in get_args(EdgeDetector):
        for localisation in get_args(EdgeLocalisation):
            options = EdgeOptions(detector=detector, localisation=localisation)
            detect_edges(image, None, options, progress=NoProgress())


def tiny_room(*, structured: bool) -> Scan:
    """Scan a box with a column from inside, from a place off its middle."""
    zenith = np.linspace(0.3, np.pi - 0.3, ROWS)
    azimuth = np.linspace(0.0, 2.0 * np.pi, COLUMNS, endpoint=False)
    theta, phi = np.meshgrid(zenith, azimuth, indexing="ij")
    rays = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1).reshape(-1, 3)
    place = np.array([0.7, -0.4, 0.2])
    with np.errstate(divide="ignore"):
        ranges = ((np.copysign(HALF_ROOM_M, rays) - place) / rays).min(axis=1)
    ranges = np.minimum(ranges, _ranges_of_column(rays, COLUMN_M - place[:2]))
    ranges += np.random.default_rng(0).normal(0.0, NOISE_M, len(ranges))
    index = np.arange(len(rays), dtype=np.int32).reshape(ROWS, COLUMNS)
    points = rays * ranges[:, None]
    on_wall = np.abs(points[:, 0] + place[0]) > HALF_ROOM_M[0] - 0.1
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
