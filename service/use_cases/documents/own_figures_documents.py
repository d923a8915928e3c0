"""The figures of a method with an estimator of its own, as clients read them."""

from algorithms.adjustment.line_estimate import EstimatorStep
from algorithms.arrays import IndexPairs
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.poses import OptionalTriple
from algorithms.registration.base import PairResult
from schemas.results.own_figures import OwnFigures, OwnIteration, OwnStep
from service.use_cases.documents.feature_names import line_name
from service.use_cases.documents.pose_documents import pose_document


def own_figures_document(result: PairResult, *, target: str, source: str) -> OwnFigures | None:
    """Describe what the method says of itself; None for the rigorous method, which has nothing else to say.

    Parameters
    ----------
    result
        Of the registration method.
    target, source
        Names of the stations.
    """
    own = result.own_figures
    if own is None:
        return None
    rotation, shift = _mean(own.pose.omega_phi_kappa_std_rad), _mean(own.pose.translation_std_m)
    centroid_m = None if result.fine is None else result.fine.centroid_m
    return OwnFigures(
        label=own.label,
        claimed=pose_document(own.pose, target=target, source=source, centroid_m=None, a_posteriori=True),
        rigorous=None
        if result.rigorous is None
        else pose_document(
            result.rigorous,
            target=target,
            source=source,
            centroid_m=centroid_m,
            a_posteriori=result.fine is None or result.fine.adjustment.variance_factor > 1.0,
        ),
        steps=[_step(step) for step in own.steps],
        lines=_names(own.lines, target, source),
        declared_outliers=_names(own.declared_outliers, target, source),
        mean_std_rotation_gon=None if rotation is None else rotation * GON_PER_RAD,
        mean_std_translation_m=shift,
        max_angle_gon=None if own.max_angle_rad is None else own.max_angle_rad * GON_PER_RAD,
        max_distance_m=own.max_distance_m,
        convergence=[
            OwnIteration(misfit_m=each.misfit_m, step_m=each.step_m, correspondences=each.correspondences)
            for each in own.convergence
        ],
        convergence_rate=own.rate,
        convergence_order=own.order,
        remarks=list(own.remarks),
    )


def _step(step: EstimatorStep) -> OwnStep:
    return OwnStep(
        name=step.name,
        equations=step.equations,
        unknowns=step.unknowns,
        redundancy=step.redundancy,
        sigma0=step.sigma0,
        iterations=step.iterations,
        last_step=step.last_step,
        converged=step.converged,
    )


def _names(lines: IndexPairs, target: str, source: str) -> list[str]:
    return [f"{target}/{line_name(int(i))} – {source}/{line_name(int(j))}" for i, j in lines]


def _mean(std: OptionalTriple) -> float | None:
    known = [value for value in std if value is not None]
    return sum(known) / 3.0 if len(known) == 3 else None
