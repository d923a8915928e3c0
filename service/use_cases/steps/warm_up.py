"""What computations need loaded before they begin: libraries, and compiled kernels."""

import numpy as np

from algorithms.scans.scan import Scan, ScanGrid

ROWS, COLUMNS = 60, 120
HALF_ROOM_M = np.array([3.0, 2.2, 1.4])
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

    load_for_reading()


def load_for_reports() -> None:
    """Load what networks and reports need."""
    import ezdxf  # noqa: F401 - loaded for the computations
    import networkx as nx  # noqa: F401

    from service.use_cases.steps import run_network, run_network_growth, run_registration_report  # noqa: F401


def practise() -> None:
    """Register two scans of a tiny room, which loads compiled kernels, or compiles them where nobody did before."""
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
    DEFAULT_METHOD().register(problem, progress=NoProgress(), rng=np.random.default_rng(0))
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


def tiny_room(*, structured: bool) -> Scan:
    """Scan a box from inside, from a place off its middle."""
    zenith = np.linspace(0.3, np.pi - 0.3, ROWS)
    azimuth = np.linspace(0.0, 2.0 * np.pi, COLUMNS, endpoint=False)
    theta, phi = np.meshgrid(zenith, azimuth, indexing="ij")
    rays = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1).reshape(-1, 3)
    place = np.array([0.7, -0.4, 0.2])
    with np.errstate(divide="ignore"):
        ranges = ((np.copysign(HALF_ROOM_M, rays) - place) / rays).min(axis=1)
    ranges += np.random.default_rng(0).normal(0.0, NOISE_M, len(ranges))
    index = np.arange(len(rays), dtype=np.int32).reshape(ROWS, COLUMNS)
    return Scan(
        points=rays * ranges[:, None],
        origin_m=np.zeros(3),
        grid=ScanGrid(index) if structured else None,
        sensor_m=np.zeros(3) if structured else None,
    )
