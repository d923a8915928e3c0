"""A plane or line that many stations see: it is the same for all of them (MATH 3.1, 6.4).

The feature itself would be an unknown with one observation from each station. It is eliminated in advance: of k
stations the first one's observation stands for it, which leaves k - 1 differences that have the error of the first one
in common. With the covariance of all of them together this gives the same poses, covariances and tests as the unknown
would, while blocks of different features stay independent of each other.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int64

from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.observations.linearised import Derivative, Equations, FeatureNoise
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.adjustment.unknowns import UnknownKind, Unknowns
from algorithms.arrays import Array, Indices


@dataclass(frozen=True, eq=False)
class TrackPart:
    """Those differences of tracks that relate the same two stations (MATH 6.4)."""

    differences: LineLine | PlanePlane
    """From the first member's station (target) to another's (source)."""
    tracks: Indices
    """(q,) number of each difference's track."""
    members: Int64[Array, "q"]
    """(q,) place of the source among the track's members, from 1."""

    def of_tracks(self, kept: Array) -> "TrackPart":
        """Keep the differences of some tracks, which are numbered anew.

        Parameters
        ----------
        kept
            (n,) True for tracks to keep.
        """
        rows = kept[self.tracks]
        renumbered = np.cumsum(kept) - 1
        return TrackPart(
            self.differences.selected(rows), renumbered[self.tracks[rows]].astype(np.int64), self.members[rows]
        )


@dataclass(frozen=True, eq=False)
class FeatureTracks:
    """n planes, or n lines, each seen from k stations (MATH 3.1, 6.4); a block has k - 1 differences of 3 or 4 rows."""

    stations: Int64[Array, "n k"]
    """(n, k) whose feature each member is; no station occurs twice in a track."""
    parts: Sequence[TrackPart]
    """All differences, each once."""
    covariances: tuple[Array, ...]
    """For each of the k members (n, s, s): covariance of its error parameters."""

    def __len__(self) -> int:
        return len(self.stations)

    @property
    def size(self) -> int:
        """Number of rows of one difference: 3 of planes, 4 of lines."""
        return int(self.covariances[0].shape[1])

    def selected(self, which: Array) -> "FeatureTracks":
        """Keep some of the tracks, by mask."""
        parts = [part.of_tracks(which) for part in self.parts]
        return replace(
            self,
            stations=self.stations[which],
            parts=tuple(part for part in parts if len(part.tracks)),
            covariances=tuple(blocks[which] for blocks in self.covariances),
        )

    def noises(self) -> tuple[FeatureNoise, ...]:
        """Say how the errors come about: each member by itself."""
        return tuple(FeatureNoise.independent(blocks) for blocks in self.covariances)

    def extent_m(self) -> float:
        """Give the largest coordinate that takes part [m]."""
        return max([0.0, *(part.differences.extent_m() for part in self.parts)])

    def equations(self, unknowns: Unknowns) -> Equations:
        """Stack the differences of each track: those of `LineLine` or `PlanePlane` between its first member and others.

        The first member's error is in all of them, every other member's in its own only.
        """
        n, k = self.stations.shape
        s = self.size
        residuals = np.zeros((n, k - 1, s))
        by_pose = np.zeros((k, n, k - 1, s, 6))
        by_error = np.zeros((k, n, k - 1, s, s))
        for part in self.parts:
            of_part = part.differences.equations(unknowns)
            at = (part.tracks, part.members - 1)
            residuals[at] = of_part.residuals
            by_first, by_other = of_part.derivatives
            by_pose[(0, *at)], by_pose[(part.members, *at)] = by_first.jacobians, by_other.jacobians
            by_error[(0, *at)], by_error[(part.members, *at)] = of_part.noise_jacobians
        rows = (k - 1) * s
        return Equations(
            residuals.reshape(n, rows),
            tuple(
                Derivative(UnknownKind.POSE, self.stations[:, member], by_pose[member].reshape(n, rows, 6))
                for member in range(k)
            ),
            tuple(by_error[member].reshape(n, rows, s) for member in range(k)),
        )
