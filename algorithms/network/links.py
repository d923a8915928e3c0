"""What a registered pair contributes to a network of many stations."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import IndexPairs, OtherIndexPairs, Vector3
from algorithms.geometry.poses import PoseEstimate
from algorithms.geometry.rotations import cross_matrix


@dataclass(frozen=True, eq=False)
class StationLink:
    """An accepted registration of two stations, in their reduced frames."""

    target: int
    """Number of the target station."""
    source: int
    """Number of the source station."""
    target_from_source: PoseEstimate
    """Pose with its covariance a posteriori."""
    lines: IndexPairs
    """(n, 2) numbers of target and source lines that the pose rests on."""
    planes: OtherIndexPairs
    """(m, 2) numbers of target and source planes that it rests on."""
    centroid_m: Vector3
    """(3,) centroid of these features in the target frame [m]."""
    radius_m: float
    """Rms distance of these features from it [m]."""
    noise_m: float
    """Larger standard deviation of single points of the two scans [m]."""
    feature_share: float = 1.0
    """Share of the pose's information that lines and planes give, 0..1; the rest comes from surfaces."""
    of_targets: bool = False
    """Whether survey targets alone gave it: it tells nothing that the targets themselves do not tell."""

    @property
    def stations(self) -> tuple[int, int]:
        """Target and source."""
        return self.target, self.source

    @property
    def weakness_m2(self) -> float:
        """Rate the link for choosing a tree: variance of the position where its features are [m²]; small is good."""
        return float(np.trace(self.target_from_source.position_covariance_m2(self.centroid_m)))

    def from_station(self, station: int) -> PoseEstimate:
        """Give the pose of the other station in the frame of this one."""
        return self.target_from_source if station == self.target else self.target_from_source.inverse()

    def with_covariance_scaled(self, factor: float) -> "StationLink":
        """Give the link with a covariance that is larger by a factor."""
        return replace(self, target_from_source=self.target_from_source.with_covariance_scaled(factor))

    def with_floor(self, noises: float) -> "StationLink":
        """Give the link with a covariance to which errors of the size of the scans' noise are added (MATH 6.5).

        A shift of so many noises at the centroid of the features, and a turn that shifts them by as much at their rms
        distance: what walls that are not flat do to poses, and what the covariance from their fit does not know.

        Parameters
        ----------
        noises
            How many standard deviations of single points.
        """
        pose = self.target_from_source
        size = noises * self.noise_m
        turn = np.square(size / max(self.radius_m, 1e-3)) * np.eye(3)
        lever = cross_matrix(self.centroid_m - pose.translation_m)  # δt = δp - δθ × (c - t) = δp + S(c - t) δθ
        added = np.zeros((6, 6))
        added[:3, :3] = turn
        added[3:, :3] = lever @ turn
        added[:3, 3:] = added[3:, :3].T
        added[3:, 3:] = lever @ turn @ lever.T + size**2 * np.eye(3)
        enlarged = PoseEstimate(pose.target_from_source, pose.covariance + added, pose.null_space)
        return replace(self, target_from_source=enlarged)

    def seen_from(self, station: int, base_from_station: RigidTransform) -> RigidTransform:
        """Carry a known station's pose on to the other one.

        Parameters
        ----------
        station
            The known one.
        base_from_station
            Its pose in some frame.
        """
        return base_from_station * self.from_station(station).target_from_source
