"""Simulated pairs of stations whose coordinates are rounded, with the errors of their poses."""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.progress import NoProgress
from algorithms.registration.auto import AutoMethod
from algorithms.registration.base import PairStatus, RegistrationProblem
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scenes import SCENES

OVERLAPPING = {
    "house": ((0, 1), (1, 2), (0, 6), (2, 3)),
    "office": ((1, 2), (1, 3), (3, 4)),
    "pipe_hall": tuple(combinations(range(4), 2)),
}
"""Pairs of recommended stations that see much of the same."""
STEPS_M = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05)
NOISES_M = (0.001, 0.002, 0.004)
SIZE = 330, 760
"""Rows and columns: 250 000 points."""
SHIFT_M = 0.1
"""Largest shift of a station from its recommended place along each axis."""


@dataclass(frozen=True, eq=False)
class RoundedPair:
    """How far the pose of one pair lies from the truth."""

    scene: str
    step_m: float
    noise_m: float
    parallel: bool
    """Both clouds in the project's axes, to which walls and floors are parallel."""
    structured: bool
    status: PairStatus
    reasons: tuple[str, ...]
    error: np.ndarray
    """(6,) rotation vector (left, target axes) [rad] and translation [m], true minus estimated."""
    covariance: np.ndarray

    @property
    def nees(self) -> float:
        """Normalised estimation error squared: chi-square with 6 degrees of freedom where the covariance is honest."""
        return float(self.error @ np.linalg.solve(self.covariance, self.error))

    def in_words(self) -> str:
        """Give a line of the table."""
        z = self.error / np.sqrt(np.diag(self.covariance))
        axes = "parallel" if self.parallel else "turned"
        kind = "grid" if self.structured else "cloud"
        std_mm, error_mm = 1e3 * np.sqrt(np.diag(self.covariance)[3:]).max(), 1e3 * np.linalg.norm(self.error[3:])
        return (
            f"{self.scene:10s} {1e3 * self.step_m:4.0f} mm, noise {1e3 * self.noise_m:.0f} mm, {axes:8s} {kind:5s} "
            f"{self.status.value:10s} error {error_mm:6.2f} mm, std {std_mm:6.2f} mm, NEES {self.nees:6.2f}, "
            f"z {np.round(z, 1)}"
        )


def rounded_pair(number: int, seed: int, scenes: tuple[str, ...] = tuple(OVERLAPPING)) -> RoundedPair:
    """Simulate, round, extract and register one pair; the number decides scene, step, noise, axes and structure."""
    rng = np.random.default_rng([seed, number])
    name = scenes[number % len(scenes)]
    step = STEPS_M[number // 2 % len(STEPS_M)]
    noise = NOISES_M[rng.integers(len(NOISES_M))]
    parallel, structured = number % 2 == 0, bool(rng.integers(3) == 0)
    scene = SCENES[name]()
    chosen = OVERLAPPING[name][rng.integers(len(OVERLAPPING[name]))]
    scanner = VirtualScanner(rows=SIZE[0], columns=SIZE[1], range_noise_std_m=noise)
    features, frames = [], []
    for station in (scene.stations[k] for k in chosen):
        turn = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
        place = station.translation + rng.uniform(-SHIFT_M, SHIFT_M, 3)
        pose = RigidTransform.from_components(place, turn * station.rotation)
        scan = scan_scene(scene, pose, scanner, rng)
        rotation = pose.rotation if parallel else Rotation.identity()
        offset = rng.uniform(-0.5, 0.5, 3)
        points = np.rint((rotation.apply(scan.points) + offset) / step) * step
        scan = replace(
            scan,
            points=points,
            grid=scan.grid if structured else None,
            sensor_m=offset if structured else None,
        )
        features.append(extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0)))
        frames.append(pose * RigidTransform.from_components(offset, rotation).inv())
    result = AutoMethod().register(RegistrationProblem(*features), progress=NoProgress())
    head = name, step, noise, parallel, structured, result.status, result.reasons
    if result.final is None:
        return RoundedPair(*head, np.full(6, np.nan), np.eye(6))
    true, found = frames[0].inv() * frames[1], result.final.pose.target_from_source
    turn = (true.rotation * found.rotation.inv()).as_rotvec()
    error = np.concatenate([turn, true.translation - found.translation])
    return RoundedPair(*head, error, result.final.pose.covariance)
