"""The work of the method `planes-triples`: a pose from triples of planes, estimated from there on."""

from algorithms.adjustment.line_estimate import EstimatorStep
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.progress import Progress
from algorithms.registration.base import PairResult, RegistrationProblem
from algorithms.registration.planes_triples import PlanesTriplesMethod, TripleOptions
from algorithms.registration.proposals import PoseProposal, ProposingProcedure, register_by_proposal
from algorithms.registration.triple_search import match_by_triples

LABEL = "Symbolic matching of planes (Dold, Ripperda and Brenner 2007): triples, quaternion, least squares"


def register_by_triples(problem: RegistrationProblem, method: PlanesTriplesMethod, progress: Progress) -> PairResult:
    """Register two scans by triples of planes; every failure becomes a result with its status and reasons.

    Parameters
    ----------
    problem
        Features of both scans.
    method
        Options.
    progress
        Is told the steps.
    """

    def propose(problem: RegistrationProblem, _search: CoarseRegistration) -> PoseProposal:
        return proposed_by_triples(problem, method.triples)

    procedure = ProposingProcedure(LABEL, method.matching, method.adjustment, method.surfaces, propose)
    return register_by_proposal(problem, procedure, progress)


def proposed_by_triples(problem: RegistrationProblem, options: TripleOptions) -> PoseProposal:
    """Find the pose in which most planes agree.

    Parameters
    ----------
    problem
        Features of both scans.
    options
        Of the search.

    Raises
    ------
    TooFewCorrespondencesError
        When too few planes agree in any pose.
    """
    match = match_by_triples(problem.target, problem.source, options)
    estimate = match.estimate
    pairs = len(estimate.pairs)
    step = EstimatorStep("rotation and translation", 3 * pairs, 6, estimate.sigma0, 1, 0.0, converged=True)
    found = (
        f"{match.agreeing} planes agree to {1e3 * estimate.offset_rms_m:.0f} mm and "
        f"{1e3 * estimate.angle_rms_rad:.2f} mrad (rms), in the best clearly different pose {match.runner_up}; "
        f"{match.poses} poses of three planes were counted"
    )
    return PoseProposal(estimate.pose, (step,), (found,))
