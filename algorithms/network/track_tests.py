"""Tests of tracks and of their members, each by the poses it touches (MATH 4.4, 4.5, 6.4)."""

from dataclasses import dataclass

import numpy as np

from algorithms.adjustment.gross_errors import log_probability, quadratic_forms
from algorithms.adjustment.inverse import Inverse
from algorithms.adjustment.observations.feature_tracks import FeatureTracks
from algorithms.adjustment.unknowns import UnknownKind, Unknowns
from algorithms.arrays import Array, Scalars


@dataclass(frozen=True, eq=False)
class HypothesisTests:
    """Tests of n tracks or members."""

    statistics: Scalars
    """(n,) T."""
    degrees: Scalars
    """(n,) degrees of freedom; 0 where nothing controls it."""

    def log_p(self, variance_factor: float) -> Scalars:
        """Give ln of the probability of a larger T without error, covariances enlarged by a factor."""
        return log_probability(self.statistics / variance_factor, self.degrees)


class TrackTests:
    """Residuals of n tracks with k members at a solution, and how they vary (MATH 4.4).

    The errors of different tracks are independent, so the test of one needs its own covariance C and the cofactors Q of
    its k poses only. Tracks in the solution: residuals have the covariance S = C - J Q Jᵀ. A member that is not in the
    solution, tested together with those of its track that are: the statistic takes up only what the member adds, which
    is independent of the solution, so there S = C + J Q Jᵀ holds exactly. O(n k³).

    Parameters
    ----------
    tracks
        The tracks.
    unknowns
        Adjusted values.
    inverse
        Q of the free unknowns.
    in_solution
        Whether the solution rests on all members; else on all but the tested ones.
    """

    def __init__(self, tracks: FeatureTracks, unknowns: Unknowns, inverse: Inverse, *, in_solution: bool) -> None:
        equations = tracks.equations(unknowns)
        n, d = equations.residuals.shape
        self._residuals = equations.residuals
        self._by_error = equations.noise_jacobians
        own = np.zeros((n, d, d))
        for by_error, covariances in zip(equations.noise_jacobians, tracks.covariances, strict=True):
            own += by_error @ covariances @ np.swapaxes(by_error, 1, 2)
        jacobian = np.concatenate([part.jacobians for part in equations.derivatives], axis=2)
        columns = np.concatenate(
            [
                unknowns.first_columns(UnknownKind.POSE, part.numbers)[:, None] + np.arange(6)
                for part in equations.derivatives
            ],
            axis=1,
        )
        fixed = np.repeat(
            np.stack(
                [unknowns.first_columns(UnknownKind.POSE, part.numbers) < 0 for part in equations.derivatives], axis=1
            ),
            6,
            axis=1,
        )
        jacobian[np.broadcast_to(fixed[:, None, :], jacobian.shape)] = 0.0
        # in place of a fixed pose stands a free one of the same track, whose cofactors are known, with derivatives zero
        columns = np.where(fixed, columns.max(axis=1, keepdims=True), columns)
        of_poses = inverse.blocks(columns)
        through_poses = jacobian @ of_poses @ np.swapaxes(jacobian, 1, 2)
        self._weights = np.linalg.inv(own)
        self._varying = own - through_poses if in_solution else own + through_poses

    def of_tracks(self) -> HypothesisTests:
        """Test every track as a whole."""
        n, d = self._residuals.shape
        return self._test(np.broadcast_to(np.eye(d), (n, d, d)))

    def of_members(self, slot: int) -> HypothesisTests:
        """Test in every track whether one member is another object, or has moved.

        Parameters
        ----------
        slot
            Place of the member in the tracks.
        """
        return self._test(self._by_error[slot])

    def _test(self, designs: Array) -> HypothesisTests:
        """Test r = J x + G d + noise for d = 0, G (n, d, s): T = uᵀ N⁺ u, u = Gᵀ P r, N = Gᵀ P S P G."""
        weighted = self._weights @ designs
        transposed = np.swapaxes(weighted, 1, 2)
        own = transposed @ self._varying @ weighted
        scales = np.einsum("nij,nij->nj", designs, weighted)
        vectors = np.einsum("nij,ni->nj", weighted, self._residuals)
        statistics, degrees = quadratic_forms(own, vectors, scales)
        return HypothesisTests(statistics, degrees)
