"""The fast form of the benchmark of the same name: a noisy near scan, and a few pairs through all of registration."""

import numpy as np
import pytest
from scipy import stats

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.progress import NoProgress
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scenes import SCENES
from tests.scenes.buildings.simulated_pairs import pair_error

pytestmark = pytest.mark.slow

SMALL = ((240, 540),)
"""Rows and columns of scans that take a second."""
NUMBERS = (3, 8, 9)
"""Two pairs of the house (3 mm; 6 mm and tilted) and one of the office (6 mm, tilted)."""
SAME_RAD, SAME_M = np.radians(3.0), 0.03
"""A plane within these of a true one is taken for it."""


@pytest.fixture(scope="module")
def pairs():
    return [pair_error(number, 1, ("office", "house"), SMALL) for number in NUMBERS]


def test_simulated_pairs_are_accepted(pairs):
    assert all(pair.accepted for pair in pairs)


def test_their_normalised_errors_are_no_larger_than_chance_allows(pairs):
    low, high = stats.chi2.ppf([0.0005, 0.9995], 6 * len(pairs))
    assert low < sum(pair.nees for pair in pairs) < high


def test_planes_of_a_noisy_near_scan_are_honest():
    """Points lie 6 to 25 mm apart at 6 mm noise: where only a part of the noise is expected, walls break into pieces
    fitted to what is left of their points, and the median is 14.
    """
    scene = SCENES["office"]()
    pose, scanner = scene.stations[1], VirtualScanner(rows=450, columns=1000, range_noise_std_m=0.006)
    scan = scan_scene(scene, pose, scanner, np.random.default_rng(1))
    planes = extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0)).planes
    _, first = np.unique(scene.plane_ids, return_index=True)
    true_normals = pose.rotation.inv().apply(scene.normals[first])
    true_offsets = scene.offsets_m[first] - scene.normals[first] @ pose.translation
    normalised = []
    for n, c, basis, covariance in zip(planes.normals, planes.centroids, planes.bases, planes.covariances, strict=True):
        cosines = true_normals @ n
        gaps = (true_offsets - true_normals @ c) / np.where(np.abs(cosines) > 0.5, cosines, np.inf)
        gaps = np.where(np.abs(cosines) > np.cos(SAME_RAD), gaps, np.inf)
        same = int(np.argmin(np.abs(gaps)))
        if abs(gaps[same]) < SAME_M:
            error = np.array([*(basis.T @ true_normals[same] / cosines[same]), gaps[same]])
            normalised.append(error @ np.linalg.solve(covariance, error))
    assert len(normalised) > 30
    # median of chi-square with 3 degrees: 2.37; +- 0.3 from 60 planes, and some hold points of neighbours
    assert np.median(normalised) < 3.7
