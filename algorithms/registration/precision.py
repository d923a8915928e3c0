"""How well a pose is known, apart from whether it is the right one."""

from dataclasses import dataclass

import numpy as np

from algorithms.adjustment.principal_motions import principal_motions
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.registration.base import FinalPose, Precision, RegistrationProblem, TargetFit, Tolerance
from algorithms.registration.pair_verdict import WORST_STD_M, allowed_m

FAR_SHARE = 0.9
"""Share of a scan's surface within the far end, by distance from the centre of what both scans share."""
FAR_NOISES = 5.0
"""Standard deviations of single points that are allowed at the far end where no tolerance is stated."""


@dataclass(frozen=True)
class _Limits:
    """What is allowed [m]."""

    motion_m: float
    far_m: float
    hidden_m: float
    turn_rad: float

    @staticmethod
    def of(problem: RegistrationProblem) -> "_Limits":
        """Take the tolerance that is stated, or what the scans themselves allow.

        A stated tolerance concerns standard deviations; of undetected errors it never asks more than is usual.
        """
        usual = allowed_m(problem)
        asked = problem.tolerance or Tolerance()
        turn = np.inf if asked.std_rad is None else asked.std_rad
        if asked.std_m is None:
            noise_m = max(problem.target.noise_std_m, problem.source.noise_std_m)
            return _Limits(usual, max(WORST_STD_M, FAR_NOISES * noise_m), usual, turn)
        return _Limits(asked.std_m, asked.std_m, max(asked.std_m, usual), turn)


def precision_of(
    problem: RegistrationProblem,
    final: FinalPose,
    *,
    hidden_m: float,
    targets: TargetFit | None = None,
    found: tuple[str, ...] = (),
) -> Precision:
    """Compute how well a determined pose is known, and whether that keeps the tolerance.

    Parameters
    ----------
    problem
        Features of both scans, and the tolerance.
    final
        The pose; its covariance holds all that was found against its precision.
    hidden_m
        Shift of the pose by the largest error that no test finds [m].
    targets
        Survey targets in it; None: there are none.
    found
        What contradicts the precision already, in words: estimates that disagree, a deformation.
    """
    limits = _Limits.of(problem)
    pose, centre = final.reduced, final.centred
    far_m = _far_end_m(problem, final)
    near = principal_motions(pose, centre.centroid, centre.radius_m)
    far = principal_motions(pose, centre.centroid, far_m)[0]
    turn_rad = float(np.sqrt(max(np.linalg.eigvalsh(pose.covariance[:3, :3])[-1], 0.0)))
    findings = list(found)
    if hidden_m > limits.hidden_m:
        findings.append(
            f"an error that no test could find would shift the pose by {hidden_m * 1e3:.0f} mm "
            f"({limits.hidden_m * 1e3:.0f} mm would be allowed): too little controls it"
        )
    if targets is not None and final.without_targets is None and targets.is_controlled:
        hidden_m = max(hidden_m, targets.hidden_m)
        if targets.hidden_m > limits.hidden_m:
            findings.append(
                "an error in a target that no test could find would shift the pose by "
                f"{targets.hidden_m * 1e3:.0f} mm ({limits.hidden_m * 1e3:.0f} mm would be allowed)"
            )
    findings += [
        f"the {motion.text} is hardly determined (standard deviation {motion.std_m * 1e3:.0f} mm, "
        f"{limits.motion_m * 1e3:.0f} mm would be allowed)"
        for motion in near
        if motion.std_m > limits.motion_m
    ]
    if far.std_m > limits.far_m:
        findings.append(
            f"what the scans have in common carries the rest of them badly: {far_m:.0f} m from it the {far.text} is "
            f"known to {far.std_m * 1e3:.0f} mm (standard deviation, {limits.far_m * 1e3:.0f} mm would be allowed)"
        )
    if turn_rad > limits.turn_rad:
        findings.append(
            f"the rotation is known to {turn_rad * GON_PER_RAD * 1e3:.1f} mgon (standard deviation, "
            f"{limits.turn_rad * GON_PER_RAD * 1e3:.1f} mgon would be allowed)"
        )
    return Precision(
        allowed_m=limits.far_m,
        is_stated=problem.tolerance is not None and problem.tolerance.std_m is not None,
        centre_std_m=near[0].std_m,
        far_m=far_m,
        far_std_m=far.std_m,
        turn_std_rad=turn_rad,
        hidden_m=hidden_m,
        findings=tuple(findings),
    )


def _far_end_m(problem: RegistrationProblem, final: FinalPose) -> float:
    """Return how far the scan that reaches less far extends from the centre [m].

    The smaller of both reaches, so that the answer does not depend on which scan is the target.
    """
    source_points = final.reduced.target_from_source.apply(problem.source.index.points)
    return min(
        float(np.quantile(np.linalg.norm(points - final.centred.centroid, axis=1), FAR_SHARE))
        for points in (problem.target.index.points, source_points)
    )
