"""Simulated pairs of stations through extraction, matching and adjustment, with the errors of their poses."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import stats
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.progress import NoProgress
from algorithms.registration.base import PairStatus, RegistrationProblem
from algorithms.registration.lines import LinesMethod
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scenes import SCENES

OVERLAPPING = {
    "house": ((0, 1), (1, 2), (0, 6), (2, 3)),
    "pipe_hall": tuple(combinations(range(4), 2)),
    "office": ((1, 2), (1, 3), (3, 4)),
}
"""Pairs of recommended stations that see much of the same."""
NOISES_M = (0.002, 0.003, 0.004, 0.005, 0.006)
SIZES = ((450, 1000), (360, 800), (300, 667))
"""Rows and columns of the scans."""
SHIFT_M = 0.1
"""Largest shift of a station from its recommended place along each axis."""
LARGEST_TILT_RAD = np.radians(35.0)
"""Every third pair has both instruments tilted, each about an axis of its own."""


@dataclass(frozen=True, eq=False)
class PairError:
    """How far the pose of one pair lies from the truth."""

    scene: str
    noise_m: float
    tilted: bool
    status: PairStatus
    error: np.ndarray
    """(6,) rotation vector (left, target axes) [rad] and translation [m], true minus estimated."""
    covariance: np.ndarray

    @property
    def accepted(self):
        return self.status is PairStatus.ACCEPTED

    @property
    def nees(self):
        """Normalised estimation error squared: chi-square with 6 degrees of freedom where the covariance is honest."""
        return float(self.error @ np.linalg.solve(self.covariance, self.error))

    @property
    def z(self):
        """(6,) errors over their standard deviations."""
        return self.error / np.sqrt(np.diag(self.covariance))


def pair_error(number, seed, scene_names=tuple(OVERLAPPING), sizes=SIZES, method=LinesMethod):
    """Simulate, extract and register one pair; the number decides scene, noise, resolution and tilt."""
    rng = np.random.default_rng([seed, number])
    name = scene_names[number % len(scene_names)]
    noise = NOISES_M[number // len(scene_names) % len(NOISES_M)]
    rows, columns = sizes[rng.integers(len(sizes))]
    tilted = number % 3 == (number // 3) % 3
    scene = SCENES[name]()
    chosen = OVERLAPPING[name][rng.integers(len(OVERLAPPING[name]))]
    scanner = VirtualScanner(rows=rows, columns=columns, range_noise_std_m=noise)
    poses = [_set_up(scene.stations[k], rng, LARGEST_TILT_RAD if tilted else 0.0) for k in chosen]
    target, source = (
        extract_features(
            scan_scene(scene, pose, scanner, rng), FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0)
        )
        for pose in poses
    )
    result = method().register(RegistrationProblem(target, source), progress=NoProgress())
    answer = result.final or result.fine
    if answer is None:
        return PairError(name, noise, tilted, result.status, np.full(6, np.nan), np.eye(6))
    true, found = poses[0].inv() * poses[1], answer.pose.target_from_source
    turn = (true.rotation * found.rotation.inv()).as_rotvec()
    error = np.concatenate([turn, true.translation - found.translation])
    return PairError(name, noise, tilted, result.status, error, answer.pose.covariance)


def band_of_mean(count, probability=0.95):
    """Give the band in which the mean of `count` chi-square values with 6 degrees of freedom lies."""
    tail = 0.5 * (1.0 - probability)
    return stats.chi2.ppf([tail, 1.0 - tail], 6 * count) / count


def table(pairs):
    """Say per scene, noise and altogether what was found, as lines of text."""
    lines = []
    groups = [(name, [p for p in pairs if p.scene == name]) for name in OVERLAPPING]
    groups += [(f"{1e3 * noise:.0f} mm", [p for p in pairs if p.noise_m == noise]) for noise in NOISES_M]
    groups += [("tilted", [p for p in pairs if p.tilted]), ("all", pairs)]
    for title, group in groups:
        good = [p for p in group if p.accepted]
        if not good:
            continue
        nees, z = np.array([p.nees for p in good]), np.array([p.z for p in good])
        low, high = band_of_mean(len(good))
        inside = float(np.mean(np.abs(z) < stats.norm.ppf(0.975)))
        covered = float(np.mean(nees < stats.chi2.ppf(0.95, 6)))
        lines.append(
            f"{title:10s} {len(good):3d} of {len(group):3d} accepted, NEES mean {nees.mean():5.2f} "
            f"(band {low:.2f}-{high:.2f}) median {np.median(nees):5.2f} max {nees.max():5.1f}; 95 % "
            f"ellipsoid {covered:.3f}, intervals {inside:.3f}; "
            f"mean z x sqrt(n) {np.round(z.mean(axis=0) * len(good) ** 0.5, 1)}, std z {np.round(z.std(axis=0), 2)}"
        )
    return lines


def _set_up(station, rng, tilt_rad):
    """Put an instrument near a station, turned about the vertical and tilted by up to the given angle."""
    axis = np.append(rng.normal(size=2), 0.0)
    tilt = Rotation.from_rotvec(rng.uniform(0.0, tilt_rad) * axis / np.linalg.norm(axis))
    turn = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
    place = station.translation + rng.uniform(-SHIFT_M, SHIFT_M, 3)
    return RigidTransform.from_components(place, turn * tilt * station.rotation)
