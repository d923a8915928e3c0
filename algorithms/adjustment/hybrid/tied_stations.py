"""Stations tied by targets, by what scans say of their poses, and by control, in one adjustment (MATH 6.7)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.hybrid.closed_forms import INLIERS
from algorithms.adjustment.hybrid.estimation import Estimate, estimate
from algorithms.adjustment.hybrid.gross_errors import Cleaned, GrossErrorOptions, clean
from algorithms.adjustment.hybrid.joint_poses import JointPoses
from algorithms.adjustment.hybrid.network import Network
from algorithms.adjustment.hybrid.observations import Observations
from algorithms.adjustment.hybrid.point_equations import Control
from algorithms.adjustment.hybrid.reliability import observation_tests
from algorithms.adjustment.hybrid.scanner_equations import StationCoordinates
from algorithms.adjustment.hybrid.state import SIZES, Kind, Layout, State
from algorithms.adjustment.hybrid.tied_results import PointTest, ScaleTest, ScansTest, TiedAdjustment
from algorithms.adjustment.testing import GlobalVerdict, global_test
from algorithms.arrays import Array, Flags, Indices, Matrices3, Points
from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError
from algorithms.probabilities import chi2_sf, norm_isf

ALPHA, POWER = 0.001, 0.80
MOST_REMOVED = 0.4
"""Share of the observations that may be left out."""
MAX_ITERATIONS = 50
SCALE_ROUNDS = 3
LEAST_CONTROL = 3
OPTIONS = GrossErrorOptions(
    screening_m=None, robust=False, alpha=ALPHA, power=POWER, max_removed_share=MOST_REMOVED,
    max_iterations=MAX_ITERATIONS,
)  # fmt: skip
FAR_STDS = 10.0
"""Control that misses its place by more at the start is tried without."""
NO_CONTROL = 1e-9
"""Squared whitened length below which a scale moves no control."""


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """Points in the frames of stations (MATH 6.7)."""

    stations: Indices
    """(n,) numbers of the stations."""
    points: Indices
    """(n,) numbers of the points."""
    values: Points
    """(n, 3) coordinates in the station's frame [m]."""
    covariances: Matrices3
    """(n, 3, 3) [m²]."""

    def __len__(self) -> int:
        return len(self.stations)


@dataclass(frozen=True, eq=False)
class KnownPoints:
    """Points with coordinates in the world (MATH 6.7)."""

    points: Indices
    """(m,) numbers of the points."""
    values: Points
    """(m, 3) [m], relative to an origin near them."""
    covariances: Matrices3
    """(m, 3, 3) [m²]."""

    def __len__(self) -> int:
        return len(self.points)

    @staticmethod
    def none() -> "KnownPoints":
        """Know no point (MATH 6.7)."""
        return KnownPoints(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)))


@dataclass(frozen=True, eq=False)
class TiedStations:
    """What is known of some stations and points (MATH 6.7)."""

    seen: SeenPoints
    control: KnownPoints
    """Without any the first station carries the frame."""
    scans: Sequence[JointPoses] = ()
    """What scans say of groups of stations."""

    @property
    def station_count(self) -> int:
        """Number of stations (MATH 6.7)."""
        numbers = [self.seen.stations.max(initial=-1)]
        numbers += [max(each.base, int(each.stations.max(initial=-1))) for each in self.scans]
        return int(max(numbers)) + 1


def adjust_tied_stations(
    problem: TiedStations, start: Sequence[RigidTransform], options: GrossErrorOptions = OPTIONS
) -> TiedAdjustment:
    """Adjust stations and points, leave gross errors out one at a time, and look for a scale of the control (MATH 6.7).

    Parameters
    ----------
    problem
        What is known.
    start
        World from station of all stations, near enough.
    options
        Levels and limits.

    Raises
    ------
    TooFewCorrespondencesError
        Nothing ties a station.
    DegenerateGeometryError
        The points leave a pose free.
    """
    _refuse_unseen(problem)
    network, state = _network(problem, start)
    if network.layout.count == 0 or not len(network.sizes):
        raise TooFewCorrespondencesError(0, 3, "common points")
    cleaned = _cleaned(network, state, options)
    agreed = _agreeing_control(problem, state)
    if agreed is not None:
        # one point far off bends an adjustment of all so much that good ones are blamed, or a scale is
        other = _cleaned(network, state, options, agreed)
        if _fits(other, options) and not (_fits(cleaned, options) and cleaned.used.sum() >= other.used.sum()):
            cleaned = other
    scale = scale_of_control(network, cleaned.estimate, problem.control, options.alpha)
    blamed = int((~cleaned.used).sum())
    if scale is not None and (blamed or scale.significant):
        # a scale bends all control: without it in the model good points would be blamed for it
        kept = _used_with_scale(problem, start, options)
        if kept is not None and int((~kept).sum()) < blamed:
            cleaned = _adjusted(network, cleaned.estimate.state, kept, options)
    first = len(problem.scans)
    kept_control = cleaned.used[first : first + len(problem.control)]
    if len(problem.control) and kept_control.sum() < max(LEAST_CONTROL, 0.5 * len(kept_control)):
        # control of another shape, such as a map projection's, is no set of single errors: nothing is left out
        cleaned = _adjusted(network, cleaned.estimate.state, np.ones(len(cleaned.used), dtype=bool), options)
    if not cleaned.used[: len(problem.scans)].all() and _is_free(network, cleaned.estimate):
        # targets contradict the scans, but do not hold all stations without them
        kept = cleaned.used.copy()
        kept[: len(problem.scans)] = True
        left_out = cleaned.used
        cleaned = _adjusted(network, cleaned.estimate.state, kept, options)
        return _answer(problem, network, cleaned, options, left_out[: len(problem.scans)])
    _refuse_free(network, cleaned.estimate)
    return _answer(problem, network, cleaned, options, cleaned.used[: len(problem.scans)])


def _cleaned(network: Network, state: State, options: GrossErrorOptions, used: Flags | None = None) -> Cleaned:
    blocks = len(network.sizes)
    nothing = np.zeros(blocks, dtype=bool)
    return clean(network, state, np.zeros(blocks, dtype=np.int64), nothing, options, used=used)


def _agreeing_control(problem: TiedStations, start: State) -> Flags | None:
    """Leave out control that lies far from its place at the start (MATH 6.7); None: all agrees, or most does not.

    The start lies on the control as most of its points say, with the scans' own shape and scale.
    """
    control = problem.control
    if len(control) <= LEAST_CONTROL:
        return None
    missed = np.linalg.norm(start.points[control.points] - control.values, axis=1)
    stds = np.sqrt(np.trace(control.covariances, axis1=1, axis2=2))
    far = missed > np.maximum(INLIERS * 1.4826 * float(np.median(missed)), FAR_STDS * stds)
    if not far.any() or far.sum() >= 0.5 * len(far) or len(far) - far.sum() < LEAST_CONTROL:
        return None
    used = np.ones(len(problem.scans) + len(control) + len(problem.seen), dtype=bool)
    used[len(problem.scans) : len(problem.scans) + len(control)] = ~far
    return used


def _fits(cleaned: Cleaned, options: GrossErrorOptions) -> bool:
    found = cleaned.estimate
    return global_test(found.omega, found.redundancy, options.alpha).verdict is not GlobalVerdict.TOO_LARGE


def _adjusted(network: Network, state: State, used: Flags, options: GrossErrorOptions) -> Cleaned:
    weights = used[network.block_of_row].astype(np.float64)
    found = estimate(network, state, weights, options.max_iterations)
    tests = observation_tests(network, found, np.ones(len(weights)), options.alpha, options.power)
    return Cleaned(found, tests, used, np.ones(len(used)))


def _used_with_scale(
    problem: TiedStations, start: Sequence[RigidTransform], options: GrossErrorOptions
) -> Flags | None:
    """Look for gross errors with the scale of the control taken off (MATH 6.7); None where it is not significant.

    The scale serves to find them, and is never taken off the answer.
    """
    scale = 0.0
    network, state = _network(problem, start)
    found: Estimate = estimate(network, state, np.ones(len(network.block_of_row)), options.max_iterations)
    used: Flags | None = None
    control = problem.control
    for _ in range(SCALE_ROUNDS):
        more = scale_of_control(network, found, control, options.alpha)
        if more is None:
            return None
        scale += more.scale
        control = _without_scale(problem.control, scale)
        network, state = _network(replace(problem, control=control), start)
        cleaned = _cleaned(network, state, options)
        found, used = cleaned.estimate, cleaned.used
    last = scale_of_control(network, found, control, options.alpha)
    if last is None or abs(scale + last.scale) / last.std < norm_isf(0.5 * options.alpha):
        return None
    return used


def scale_of_control(network: Network, found: Estimate, control: KnownPoints, alpha: float) -> ScaleTest | None:
    """Estimate a scale of the control beside an adjustment, and test it (MATH 6.7); None where it moves nothing.

    Parameters
    ----------
    network
        With the control as its only observation of that type.
    found
        Its adjustment.
    control
        The known points.
    alpha
        Probability with which a scale is found by chance.
    """
    k = next((k for k, each in enumerate(network.observations) if isinstance(each, Control)), None)
    if k is None or len(control) < 2:
        return None
    first = int(network.first_rows[network.first_blocks[k]])
    rows = slice(first, first + 3 * len(control))
    column = np.zeros(len(network.block_of_row))
    away = control.values - control.values.mean(axis=0)
    column[rows] = np.einsum("nij,nj->ni", network.whiteners[k], away).ravel()
    column *= found.weights > 0.0
    jacobian = found.linearised.jacobian
    reduced = column - jacobian @ found.factor.solved(jacobian.T @ (found.weights * column))
    left = float(column @ (found.weights * reduced))
    if left < NO_CONTROL * float(column @ column) or left <= 0.0:
        return None
    scale = -float(column @ (found.weights * found.linearised.residuals)) / left
    std = 1.0 / float(np.sqrt(left))
    p_value = float(chi2_sf((scale / std) ** 2, 1))
    return ScaleTest(scale, std, p_value, p_value < alpha)


def _without_scale(control: KnownPoints, scale: float) -> KnownPoints:
    centre = control.values.mean(axis=0)
    return replace(control, values=centre + (control.values - centre) / (1.0 + scale))


def _refuse_unseen(problem: TiedStations) -> None:
    """Refuse control that no station sees.

    Raises
    ------
    TooFewCorrespondencesError
        There is some.
    """
    if len(np.setdiff1d(problem.control.points, problem.seen.points)):
        raise TooFewCorrespondencesError(0, 1, "stations that see a control point")


def _network(problem: TiedStations, start: Sequence[RigidTransform]) -> tuple[Network, State]:
    seen, control = problem.seen, problem.control
    rotations = np.array([pose.rotation.as_matrix() for pose in start]).reshape(-1, 3, 3)
    positions = np.array([pose.translation for pose in start], dtype=np.float64).reshape(-1, 3)
    count = int(max(seen.points.max(initial=-1), control.points.max(initial=-1))) + 1
    world = np.einsum("nij,nj->ni", rotations[seen.stations], seen.values) + positions[seen.stations]
    points = np.zeros((count, 3))
    points[seen.points[::-1]] = world[::-1]
    state = State(
        points=points, rotations=rotations, positions=positions, cameras=np.zeros((0, 10)),
        mount_rotations=np.eye(3)[None], mount_positions=np.zeros((1, 3)), scanners=np.zeros((1, 4)),
    )  # fmt: skip
    free = {kind: np.zeros((state.count(kind), SIZES[kind]), dtype=bool) for kind in Kind}
    free[Kind.POINT][:] = True
    free[Kind.POSE][:] = True
    if not len(control):
        free[Kind.POSE][0] = False
    layout = Layout.of(free, np.full(len(positions), -1, dtype=np.int64))
    types: list[Observations] = [*problem.scans]
    if len(control):
        types.append(Control(control.covariances, control.points, control.values))
    if len(seen):
        types.append(StationCoordinates(seen.covariances, seen.stations, seen.points, seen.values))
    return Network(tuple(types), layout), state


def _is_free(network: Network, found: Estimate) -> bool:
    try:
        _refuse_free(network, found)
    except DegenerateGeometryError:
        return True
    return False


def _refuse_free(network: Network, found: Estimate) -> None:
    """Refuse an adjustment that leaves a pose free.

    Raises
    ------
    DegenerateGeometryError
        A common motion, or one of a station, is determined by nothing.
    """
    u = network.layout.count
    if found.defect.count:
        raise DegenerateGeometryError(
            u - found.defect.count, found.defect.named(), advice="add control points that do not lie on one line",
            parameters=u,
        )  # fmt: skip
    free = found.undetermined()
    of_poses = network.layout.columns[Kind.POSE]
    stations = np.flatnonzero((free[of_poses] & (of_poses >= 0)).any(axis=1))
    if len(stations):
        words = tuple(f"a motion of station {k + 1}" for k in stations.tolist())
        raise DegenerateGeometryError(
            u - len(found.fictitious), words,
            advice="common points that lie on one line leave the turn about it free: add one beside that line",
            parameters=u,
        )  # fmt: skip


def _answer(
    problem: TiedStations, network: Network, cleaned: Cleaned, options: GrossErrorOptions, agreeing: Flags
) -> TiedAdjustment:
    found, layout = cleaned.estimate, network.layout
    state = found.state
    p = len(state.positions)
    columns = layout.columns[Kind.POSE].reshape(-1)
    known = columns >= 0
    right = np.zeros((layout.count, int(known.sum())))
    right[columns[known], np.arange(int(known.sum()))] = 1.0
    own = np.zeros((6 * p, 6 * p))
    own[np.ix_(known, known)] = found.factor.solved(right)[columns[known]]
    to_left = np.zeros((6 * p, 6 * p))
    for k in range(p):
        to_left[6 * k : 6 * k + 3, 6 * k : 6 * k + 3] = state.rotations[k]
        to_left[6 * k + 3 : 6 * k + 6, 6 * k + 3 : 6 * k + 6] = np.eye(3)
    covariance = to_left @ own @ to_left.T
    of_points = layout.columns[Kind.POINT]
    first = np.broadcast_to(of_points[:, :, None], (len(of_points), 3, 3))
    point_covariances = (
        found.factor.elements(first, np.swapaxes(first, 1, 2)) if len(of_points) else np.zeros((0, 3, 3))
    )
    tests = cleaned.tests
    scans = tuple(
        ScansTest(float(tests.statistics[k]), int(tests.degrees[k]), float(tests.p_values[k]), bool(agreeing[k]))
        for k in range(len(problem.scans))
    )
    return TiedAdjustment(
        poses=tuple(
            RigidTransform.from_components(t, Rotation.from_matrix(r))
            for r, t in zip(state.rotations, state.positions, strict=True)
        ),
        covariance=0.5 * (covariance + covariance.T),
        points=state.points,
        point_covariances=np.asarray(point_covariances),
        seen=_tests_of(network, cleaned, StationCoordinates),
        control=_tests_of(network, cleaned, Control),
        scans=scans,
        scale=scale_of_control(network, found, problem.control, options.alpha),
        omega=found.omega,
        redundancy=found.redundancy,
        converged=found.converged,
    )


def _tests_of(network: Network, cleaned: Cleaned, kind: type[Observations]) -> PointTest:
    k = next((k for k, each in enumerate(network.observations) if isinstance(each, kind)), None)
    if k is None:
        nothing, none = np.zeros((0, 3)), np.zeros(0)
        return PointTest(nothing, nothing, nothing, nothing, none, none, none, np.zeros(0, dtype=bool))
    blocks = slice(int(network.first_blocks[k]), int(network.first_blocks[k + 1]))
    rows = slice(int(network.first_rows[blocks.start]), int(network.first_rows[blocks.stop]))
    tests = cleaned.tests

    def threes(values: Array) -> Points:
        return np.asarray(values[rows], dtype=np.float64).reshape(-1, 3)

    return PointTest(
        residuals=threes(cleaned.estimate.linearised.raw_residuals),
        w=threes(tests.w),
        redundancy=threes(tests.redundancy),
        detectable_m=threes(tests.detectable),
        statistics=tests.statistics[blocks],
        degrees=tests.degrees[blocks],
        p_values=tests.p_values[blocks],
        used=cleaned.used[blocks],
    )
