"""What is known of two stations before the search: levelled instruments and approximate poses.

It narrows the search and decides between poses that the scans cannot tell apart; it never speaks for a pose that the
scans speak against.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Flags, Matrices3, Points, Scalars
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.poses import PoseEstimate
from algorithms.geometry.rotations import cross_matrices
from algorithms.matching.votes import Motions, joined
from algorithms.probabilities import chi2_isf

ALPHA = 1e-5
"""Significance with which a pose contradicts the approximate poses: so low because their accuracies are guesses."""
DECIDING_ALPHA = 0.01
"""Where several poses are possible, one is chosen only if it fits the approximate poses at this significance: wrong
ones come near to one of many equal bays by chance, but seldom so near."""
TILT_SIGMAS = 4.0
"""Two levelled instruments are not tilted against each other by more standard deviations."""
ROUGH_TURN_RAD, ROUGH_SHIFT_M = 0.07, 0.35
"""How far a hypothesis may be off before it is polished: the radii within which votes count together."""
POLISHED_TURN_RAD, POLISHED_SHIFT_M = 0.01, 0.1
"""How far a pose may be off that was laid surface on surface."""
FLOOR_TURN_RAD = 0.05 / GON_PER_RAD
"""A tilt of an adjusted pose that is too small to contradict anybody."""


@dataclass(frozen=True, eq=False)
class StationPrior:
    """What is known of one station."""

    name: str
    """For reports."""
    levelled_std_rad: float | None = None
    """Standard deviation of each tilt of the scan's z axis against the vertical; None: not levelled."""
    world_from_scan: PoseEstimate | None = None
    """Approximate pose of the reduced scan frame, with the covariance at the origin of that frame; None: unknown."""


@dataclass(frozen=True, eq=False)
class PairPriors:
    """What is known of two stations. Only what is known of both says something of the pose between them."""

    target: StationPrior
    source: StationPrior
    chosen_by: str | None = None
    """Who chose the pose between them for the search to start from; None: nobody did, the approximate poses of the
    stations tell it."""

    @property
    def in_words(self) -> str:
        """What tells the approximate pose of the pair."""
        return "the approximate poses" if self.chosen_by is None else f"the start that {self.chosen_by} chose"

    @property
    def tilt_std_rad(self) -> float | None:
        """Standard deviation of each tilt of one instrument against the other; None unless both are levelled."""
        if self.target.levelled_std_rad is None or self.source.levelled_std_rad is None:
            return None
        return float(np.hypot(self.target.levelled_std_rad, self.source.levelled_std_rad))

    @property
    def target_from_source(self) -> RigidTransform | None:
        """Pose that the approximate poses make of the pair; None unless both are known."""
        if self.target.world_from_scan is None or self.source.world_from_scan is None:
            return None
        return self.target.world_from_scan.target_from_source.inv() * self.source.world_from_scan.target_from_source

    def exchanged(self) -> "PairPriors":
        """Give the same with target and source exchanged."""
        return PairPriors(self.source, self.target, self.chosen_by)

    def proposed(self, found: Motions) -> Motions:
        """Leave out hypotheses that tilt levelled instruments, and add the approximate pose as one more.

        Parameters
        ----------
        found
            Hypotheses target from source.
        """
        kept = found
        if self.tilt_std_rad is not None:
            kept = found[_tilts(found.rotations) <= TILT_SIGMAS * self.tilt_std_rad + ROUGH_TURN_RAD]
        own = self.target_from_source
        if own is None:
            return kept
        votes = np.full(1, kept.votes.max(initial=1.0))
        own_motion = Motions(own.rotation.as_matrix()[None], np.asarray(own.translation)[None], votes)
        return joined([own_motion, kept])

    def near(self, found: Motions) -> Motions:
        """Give the hypotheses that do not contradict the approximate poses; none where these are not known.

        Parameters
        ----------
        found
            Hypotheses target from source.
        """
        if self.target_from_source is None:
            return Motions.empty()
        return found[self._agreeing(found.rotations, found.translations_m, ROUGH_TURN_RAD, ROUGH_SHIFT_M)]

    def agree_with(self, poses: tuple[RigidTransform, ...], alpha: float = ALPHA) -> Flags:
        """Say which poses, laid surface on surface, contradict nothing that is known: (n,).

        Parameters
        ----------
        poses
            Target from source.
        alpha
            Significance of the test against the approximate poses.
        """
        rotations = np.array([pose.rotation.as_matrix() for pose in poses]).reshape(-1, 3, 3)
        translations = np.array([pose.translation for pose in poses]).reshape(-1, 3)
        agree = np.ones(len(poses), dtype=np.bool_)
        if self.tilt_std_rad is not None:
            agree &= _tilts(rotations) <= TILT_SIGMAS * self.tilt_std_rad + POLISHED_TURN_RAD
        if self.target_from_source is not None:
            agree &= self._agreeing(rotations, translations, POLISHED_TURN_RAD, POLISHED_SHIFT_M, alpha)
        return agree

    def contradictions(self, estimate: PoseEstimate) -> tuple[str, ...]:
        """Say in words with figures what an adjusted pose contradicts.

        Parameters
        ----------
        estimate
            Target from source, between the reduced frames.
        """
        said = []
        names = f"{self.source.name} and {self.target.name}"
        pose = estimate.target_from_source
        rotations, translations = pose.rotation.as_matrix()[None], np.asarray(pose.translation)[None]
        if self.tilt_std_rad is not None:
            tilt = float(_tilts(rotations)[0])
            own = np.linalg.eigvalsh(estimate.covariance[:3, :3])[-1]
            if tilt > TILT_SIGMAS * np.sqrt(self.tilt_std_rad**2 + own) + FLOOR_TURN_RAD:
                said.append(
                    f"{names} are said to be levelled, but this pose tilts them against each other by "
                    f"{tilt * GON_PER_RAD:.2f} gon (standard deviation {self.tilt_std_rad * GON_PER_RAD:.2g} gon)"
                )
        if self.target_from_source is not None:
            slack = (
                float(np.sqrt(np.trace(estimate.covariance[:3, :3]))),
                float(np.sqrt(np.trace(estimate.covariance[3:, 3:]))),
            )
            turn, shift = self._discrepancies(rotations, translations)
            tests = self._statistics(rotations, translations, *slack)
            if max(float(test[0]) for test in tests) > _critical():
                said.append(
                    f"this pose contradicts {self.in_words} of {names}: it is turned by "
                    f"{np.linalg.norm(turn[0]) * GON_PER_RAD:.1f} gon and shifted by {np.linalg.norm(shift[0]):.2f} m "
                    f"(statistics {float(tests[0][0]):.3g} and {float(tests[1][0]):.3g}, limit {_critical():.1f})"
                )
        return tuple(said)

    def _agreeing(
        self, rotations: Array, translations: Array, turn_rad: float, shift_m: float, alpha: float = ALPHA
    ) -> Flags:
        turned, shifted = self._statistics(rotations, translations, turn_rad, shift_m)
        return np.asarray((turned <= _critical(alpha)) & (shifted <= _critical(alpha)))

    def _statistics(
        self, rotations: Array, translations: Array, turn_rad: float, shift_m: float
    ) -> tuple[Scalars, Scalars]:
        """Test turns and shifts of n poses against the approximate ones, each chi-square with 3 degrees of freedom.

        Parameters
        ----------
        rotations, translations
            (n, 3, 3), (n, 3) target from source [m].
        turn_rad, shift_m
            How far the poses themselves may be off at the source's origin.
        """
        target, source = self._stations()
        turns, shifts = self._discrepancies(rotations, translations)
        turn_covariance = target.covariance[:3, :3] + source.covariance[:3, :3] + turn_rad**2 * np.eye(3)
        turned = np.einsum("ni,ij,nj->n", turns, np.linalg.inv(turn_covariance), turns)
        moved = translations @ target.rotation.as_matrix().T  # from the target to the source, in the world's axes
        weights = np.linalg.inv(_shift_covariances(target, source, moved, shift_m))
        shifted = np.einsum("ni,nij,nj->n", shifts, weights, shifts)
        return turned, shifted

    def _discrepancies(self, rotations: Array, translations: Array) -> tuple[Array, Array]:
        """Give (n, 3) rotation vectors and (n, 3) shifts in the world between n poses and the approximate one."""
        target, source = self._stations()
        frame = target.rotation.as_matrix()
        turns = Rotation.from_matrix(frame @ rotations @ source.rotation.as_matrix().T).as_rotvec()
        shifts = translations @ frame.T - (source.translation_m - target.translation_m)
        return turns.reshape(-1, 3), shifts

    def _stations(self) -> tuple[PoseEstimate, PoseEstimate]:
        target, source = self.target.world_from_scan, self.source.world_from_scan
        if target is None or source is None:  # pragma: no cover - asked for only where both are known
            raise ValueError("an approximate pose is missing")
        return target, source


def _shift_covariances(target: PoseEstimate, source: PoseEstimate, arms: Points, shift_m: float) -> Matrices3:
    """Give the covariances of the source's place seen from the target, in the world's axes, (n, 3, 3).

    δp = δp_s - δp_t - δθ_t × a to first order. A turn by a large angle also shortens what it moves: the second order,
    a |δθ|²/2, is added in every direction, so that an unknown orientation contradicts no place at the same distance.
    """
    levers = cross_matrices(arms)
    turn = target.covariance[:3, :3]
    across = levers @ target.covariance[:3, 3:]
    second = np.einsum("ni,ni->n", arms, arms) * float(np.linalg.eigvalsh(turn)[-1]) ** 2
    return np.asarray(
        source.covariance[3:, 3:]
        + target.covariance[3:, 3:]
        - across
        - np.swapaxes(across, 1, 2)
        + levers @ turn @ np.swapaxes(levers, 1, 2)
        + (second + shift_m**2)[:, None, None] * np.eye(3)
    )


def _tilts(rotations: Array) -> Scalars:
    """Give the angles between the z axes of target and moved source, (n,) [rad]."""
    return np.asarray(np.arctan2(np.hypot(rotations[:, 0, 2], rotations[:, 1, 2]), rotations[:, 2, 2]))


def _critical(alpha: float = ALPHA) -> float:
    """Give the limit of the two tests together."""
    return float(chi2_isf(0.5 * alpha, 3))
