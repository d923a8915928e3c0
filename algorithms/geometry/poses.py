"""A pose with its covariance: reading it in angles, at points and in other frames (MATH 1.3, 1.4, 3.4)."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Matrix, Matrix3, Matrix6, Vector3
from algorithms.geometry.angles import angle_covariance, angles_from_rotation, phi_variance
from algorithms.geometry.rotations import cross_matrix

OptionalTriple = tuple[float | None, float | None, float | None]
"""Three standard deviations; None where the parameter is not determined or not separable."""

UNDETERMINED_SHARE = 1e-3
"""A parameter counts as undetermined when a free direction moves it by more than this share of its own motion."""


def _no_free_directions() -> Matrix:
    return np.zeros((6, 0))


@dataclass(frozen=True, eq=False)
class ErrorEllipsoid:
    """One-sigma ellipsoid of a point's position error."""

    semi_axes_m: Vector3
    """(3,) semi-axes, longest first [m]."""
    directions: Matrix3
    """(3, 3) unit directions of the semi-axes as columns, target frame."""


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """Where the source frame lies in the target frame, and how well that is known."""

    target_from_source: RigidTransform
    """x_target = R x_source + t."""
    covariance: Matrix6
    """(6, 6) covariance of (rotation vector on the left in target axes [rad], translation [m])."""
    null_space: Matrix = field(default_factory=_no_free_directions)
    """(6, k) directions (rotation vector [rad], translation [m]) that the data leave free; k = 0 for a full pose.
    The covariance speaks of the rest only and is zero along these columns."""

    @property
    def rotation(self) -> Rotation:
        """Rotation R, target from source."""
        return self.target_from_source.rotation

    @property
    def translation_m(self) -> Vector3:
        """(3,) translation t: the source origin in the target frame [m]."""
        return np.asarray(self.target_from_source.translation)

    @property
    def omega_phi_kappa_rad(self) -> Vector3:
        """(3,) ω, φ, κ with R = Rx(ω) Ry(φ) Rz(κ) [rad]."""
        return angles_from_rotation(self.rotation)

    @property
    def omega_phi_kappa_std_rad(self) -> OptionalTriple:
        """Standard deviations of ω, φ, κ [rad]; None for what the geometry or the attitude leaves open."""
        if self._undetermined[:3].any():
            return (None, None, None)
        covariance = angle_covariance(self.rotation, self.covariance[:3, :3])
        if covariance is None:
            return (None, float(np.sqrt(phi_variance(self.rotation, self.covariance[:3, :3]))), None)
        std = _std(covariance)
        return (float(std[0]), float(std[1]), float(std[2]))

    @property
    def rotation_std_rad(self) -> OptionalTriple:
        """Standard deviations of the rotation vector's components, target axes [rad]."""
        return self._masked(_std(self.covariance[:3, :3]), self._undetermined[:3])

    @property
    def translation_std_m(self) -> OptionalTriple:
        """Standard deviations of t, that is at the source frame's origin [m].

        Far from the features this is inflated by the lever arm; `position_std_m` at their centroid is not.
        """
        return self._masked(_std(self.covariance[3:, 3:]), self._undetermined[3:])

    def position_covariance_m2(self, point_in_target: Vector3) -> Matrix3:
        """Give the covariance (3, 3) of where a source point at p comes to lie, δp = δθ × (p - t) + δt [m²].

        Parameters
        ----------
        point_in_target
            (3,) point p of the target frame [m].
        """
        jacobian = self._position_jacobian(point_in_target)
        return np.asarray(jacobian @ self.covariance @ jacobian.T)

    def position_std_m(self, point_in_target: Vector3) -> OptionalTriple:
        """Give the standard deviations of the position at point p of the target frame [m] (MATH 1.4)."""
        moved = np.abs(self._position_jacobian(point_in_target) @ self.null_space)
        return self._masked(_std(self.position_covariance_m2(point_in_target)), _touched(moved))

    def error_ellipsoid(self, point_in_target: Vector3) -> ErrorEllipsoid:
        """Give the one-sigma ellipsoid of the position error at point p of the target frame."""
        values, vectors = np.linalg.eigh(self.position_covariance_m2(point_in_target))
        return ErrorEllipsoid(np.sqrt(np.maximum(values[::-1], 0.0)), vectors[:, ::-1].copy())

    @property
    def correlations(self) -> Matrix6:
        """(6, 6) correlation coefficients; zero beside the diagonal where a variance is zero."""
        std = _std(self.covariance)
        products = np.outer(std, std)
        safe = np.where(products > 0.0, products, 1.0)
        correlations = np.where(products > 0.0, self.covariance / safe, 0.0)
        np.fill_diagonal(correlations, 1.0)
        return correlations

    def inverse(self) -> "PoseEstimate":
        """Give source from target with its covariance, in source axes then."""
        return self._mapped(self.target_from_source.inv(), inversion_jacobian(self.target_from_source))

    def moved_to_origins(self, origin_target_m: Vector3, origin_source_m: Vector3) -> "PoseEstimate":
        """Give the pose between full coordinates from the pose between reduced ones (MATH 3.4).

        With x = X - o in both frames: t_full = t + o_target - R o_source, and δt_full = δt - δθ × (R o_source).

        Parameters
        ----------
        origin_target_m, origin_source_m
            (3,) local origins that had been subtracted from the full coordinates [m].
        """
        rotated = self.rotation.apply(origin_source_m)
        moved = RigidTransform.from_components(self.translation_m + (origin_target_m - rotated), self.rotation)
        jacobian = np.eye(6)
        jacobian[3:, :3] = cross_matrix(rotated)
        return self._mapped(moved, jacobian)

    def after(self, first: "PoseEstimate") -> "PoseEstimate":
        """Chain two independent poses: `c_from_b.after(b_from_a)` is c from a.

        δθ = δθ₂ + R₂ δθ₁ and δt = δθ₂ × (R₂ t₁) + R₂ δt₁ + δt₂. The errors of the two must be independent; what is
        free in either stays free.

        Parameters
        ----------
        first
            The pose applied first.
        """
        rotation = self.rotation.as_matrix()
        of_self, of_first = np.eye(6), np.zeros((6, 6))
        of_self[3:, :3] = -cross_matrix(rotation @ first.translation_m)
        of_first[:3, :3] = of_first[3:, 3:] = rotation
        covariance = of_self @ self.covariance @ of_self.T + of_first @ first.covariance @ of_first.T
        free = np.hstack([of_self @ self.null_space, of_first @ first.null_space])
        return PoseEstimate(self.target_from_source * first.target_from_source, covariance, free)

    def with_covariance_scaled(self, factor: float) -> "PoseEstimate":
        """Give the same pose with the covariance multiplied by a variance factor."""
        return PoseEstimate(self.target_from_source, self.covariance * factor, self.null_space)

    @property
    def _undetermined(self) -> Array:
        """(6,) True for parameters that a free direction moves; rotations compared in rad, shifts in metres."""
        return _touched(np.abs(self.null_space))

    def _position_jacobian(self, point_in_target: Vector3) -> Matrix:
        return np.hstack([-cross_matrix(point_in_target - self.translation_m), np.eye(3)])

    def _mapped(self, pose: RigidTransform, jacobian: Matrix6) -> "PoseEstimate":
        return PoseEstimate(pose, jacobian @ self.covariance @ jacobian.T, jacobian @ self.null_space)

    @staticmethod
    def _masked(std: Array, undetermined: Array) -> OptionalTriple:
        values = [None if open_ else float(value) for value, open_ in zip(std, undetermined, strict=True)]
        return (values[0], values[1], values[2])


def inversion_jacobian(pose: RigidTransform) -> Matrix6:
    """Give the derivatives (6, 6) of the inverse pose's changes by those of a pose, each on the left.

    From Exp(δθ) R, t + δt: δθ⁻ = -Rᵀ δθ and δt⁻ = -Rᵀ S(t) δθ - Rᵀ δt.

    Parameters
    ----------
    pose
        Target from source.
    """
    transposed = pose.rotation.as_matrix().T
    jacobian = np.zeros((6, 6))
    jacobian[:3, :3] = jacobian[3:, 3:] = -transposed
    jacobian[3:, :3] = -transposed @ cross_matrix(np.asarray(pose.translation))
    return jacobian


def _std(covariance: Matrix) -> Array:
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def _touched(motions: Array) -> Array:
    """Say which rows move under any of the free directions (columns)."""
    return np.asarray((motions > UNDETERMINED_SHARE).any(axis=1))
