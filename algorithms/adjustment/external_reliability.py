"""What an error that stays undetected does to the result: external reliability (MATH 4.3)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.solver import Solution
from algorithms.adjustment.testing import ComponentTests
from algorithms.arrays import Array, Matrix, Vector, Vector3
from algorithms.geometry.pose_parameters import effects_on_parameters, shift_of_origin


@dataclass(frozen=True, eq=False)
class ComponentEffects:
    """Effects of an error of the smallest detectable size in single components, stacked as in the adjustment."""

    motions: Matrix
    """(m, 6) change of the pose: rotation vector on the left [rad], shift at the lines' centroid [m]. Told at the
    centroid it is the same whatever the origins of the frames are. 0 where not controlled (there it is unbounded)."""
    global_: Vector
    """(m,) δ̄ = sqrt(dxᵀ N dx): the shift of the pose in units of its own standard deviations; 0 where not
    controlled."""


@dataclass(frozen=True, eq=False)
class LargestEffect:
    """The largest effects among some components, each parameter by itself."""

    parameters: Float64[Array, "6"]
    """|effect| on ω, φ, κ [rad] and tx, ty, tz [m]."""
    separable: Bool[Array, "6"]
    """False for ω and κ where they are not separable."""
    centroid_m: float
    """Largest shift at the centroid, its length [m]."""
    global_: float
    """Largest δ̄."""


def component_effects(
    solution: Solution, components: ComponentTests, centroid_m: Vector3, variance_factor: float
) -> ComponentEffects:
    """Give dx = Q a ∇ for every component, ∇ its smallest detectable error, and δ̄ = sqrt(dxᵀ N dx) (MATH 4.3).

    Parameters
    ----------
    solution, components
        Solution, and the tests of its components with sigma0 = 1.
    centroid_m
        (3,) centroid of the used features in the frame of the solution [m].
    variance_factor
        What the tests allow for: detectable errors grow by its root, and so do their effects; δ̄ stays.
    """
    effects = components.external[:, :6]
    quadratic = np.einsum("mi,ij,mj->m", effects, solution.normal_matrix, effects)
    lever = centroid_m - np.asarray(solution.pose.translation)
    at_centroid = shift_of_origin(effects[:, :3], effects[:, 3:], lever)
    return ComponentEffects(
        motions=np.hstack([effects[:, :3], at_centroid]) * np.sqrt(variance_factor),
        global_=np.sqrt(np.maximum(quadratic, 0.0)),
    )


def largest_effect(motions: Matrix, global_: Vector, pose: RigidTransform, centroid_m: Vector3) -> LargestEffect:
    """Find the largest effect on each transformation parameter, read at the origins of the given pose (MATH 4.3).

    Parameters
    ----------
    motions, global_
        Of the components in question, as in `ComponentEffects`; at least one.
    pose
        Target from source in the frames of the reader, full coordinates for instance.
    centroid_m
        (3,) the lines' centroid in that target frame [m].
    """
    parameters, separable = effects_on_parameters(motions, pose, centroid_m)
    return LargestEffect(
        parameters=np.abs(parameters).max(axis=0),
        separable=separable,
        centroid_m=float(np.linalg.norm(motions[:, 3:], axis=1).max()),
        global_=float(global_.max()),
    )
