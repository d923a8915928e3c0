"""The adjusted network in its datum: everything the documents are made of."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.adjustment.hybrid.datum import (
    Cofactors,
    DatumUnknowns,
    Defect,
    common_motions,
    defect_of,
    free_conditions,
)
from algorithms.adjustment.hybrid.estimation import Estimate, estimate, factorised
from algorithms.adjustment.hybrid.gross_errors import Cleaned
from algorithms.adjustment.hybrid.reliability import ObservationTests
from algorithms.adjustment.hybrid.state import Kind, Layout, State
from algorithms.arrays import Array
from algorithms.errors import InvalidInputError
from service.ports import Json
from service.processes.adjust.named_network import NamedNetwork

ALIGNING_ROUNDS = 50
"""Two or three suffice where approximate values are about right."""
LARGEST_TURN_RAD = 1.0
"""Turns of a round; larger ones are cut, for they come from equations that are linear."""
SETTLED = 1e-6
"""Of turns [rad] and scale in the last round."""


@dataclass(frozen=True, eq=False)
class Answer:
    """A network, cleaned and adjusted, in one datum."""

    named: NamedNetwork
    cleaned: Cleaned
    estimate: Estimate
    tests: ObservationTests
    cofactors: Cofactors
    defect: Defect
    """Motions that the observations leave free."""
    undetermined: Array
    """(u,) unknowns that only fictitious observations hold."""
    scale: float
    """Factor on all covariances."""
    datum: Json
    aligned: bool
    """Whether the frame is that of approximate values."""

    @property
    def state(self) -> State:
        """Adjusted values."""
        return self.estimate.state

    def covariances(self, columns: Array) -> Array:
        """Give (n, k, k) covariances of blocks of unknowns."""
        return self.scale * self.cofactors.blocks(columns)

    def determined(self, columns: Array) -> Array:
        """Give (n,) whether all free unknowns of blocks (n, k) are determined."""
        return np.asarray(~(self.undetermined[np.maximum(columns, 0)] & (columns >= 0)).any(axis=1))


def answer_in_datum(named: NamedNetwork, cleaned: Cleaned, inputs: Json, reference: State | None) -> Answer:
    """Put an adjusted network into its datum, and test it there.

    Parameters
    ----------
    named
        The network.
    cleaned
        Without gross errors.
    inputs
        Of the request.
    reference
        Approximate values that the frame of a free network refers to; None: that of the solution stays.
    """
    datum, found = inputs["datum"], cleaned.estimate
    if found.defect.count:
        chosen = chosen_unknowns(named, datum)
        conditions = _conditions(named, found.state, chosen, found.defect)
        if reference is not None:
            layout, free = named.network.layout, found.defect.combinations
            state = aligned(layout, found.state, reference, chosen, named.photos, free)
            found = estimate(named.network, state, found.weights, 5)
            conditions = _conditions(named, found.state, chosen, found.defect)
    else:
        conditions = np.zeros((named.network.layout.count, 0))
    cofactors = Cofactors.of(found.factor, found.defect.basis, conditions)
    variance = 1.0
    if inputs["covariance_scale"] == "a-posteriori" and found.sigma0 is not None:
        variance = found.sigma0**2
    return Answer(
        named, cleaned, found, cleaned.tests, cofactors, found.defect, found.undetermined(), variance, datum,
        reference is not None and found.defect.count > 0,
    )  # fmt: skip


def answer_in_other_datum(answer: Answer, datum: Json, reference: State | None) -> Answer:
    """Carry an answer into another datum by its S-transformation (MATH 6.2).

    Parameters
    ----------
    answer
        In its own datum.
    datum
        The other one.
    reference
        Approximate values; of a minimal datum those of its held coordinates count.
    """
    named = answer.named
    of_datum = np.array([group == "datum" for group in named.group_names])
    without = np.where(of_datum[named.groups][named.network.block_of_row], 0.0, answer.estimate.weights)
    state, layout = answer.state, named.network.layout
    defect = defect_of(named.network, answer.estimate.linearised, without, state)
    chosen = chosen_unknowns(named, datum)
    target = reference or named.start
    if datum["type"] == "minimal":
        target = held_values(named, datum, target)
    if reference is not None or datum["type"] == "minimal":
        state = aligned(layout, state, target, chosen, named.photos, defect.combinations)
    # the values are those of the answer, moved as a whole: what remains to do is the covariance
    linearised = named.network.linearised(state)
    defect = defect_of(named.network, linearised, without, state)
    found = Estimate(
        state, linearised, answer.estimate.weights, factorised(named.network, linearised, without, defect), defect,
        answer.estimate.fictitious, answer.estimate.omega, answer.estimate.iterations, answer.estimate.converged,
    )  # fmt: skip
    conditions = _conditions(named, state, chosen, defect)
    cofactors = Cofactors.of(found.factor, defect.basis, conditions)
    return Answer(
        named, answer.cleaned, found, answer.tests, cofactors, defect, answer.undetermined, answer.scale, datum,
        reference is not None,
    )  # fmt: skip


def chosen_unknowns(named: NamedNetwork, datum: Json) -> DatumUnknowns:
    """Give the unknowns that carry a datum."""
    n, p = len(named.points), len(named.stations)
    if datum["type"] == "minimal":
        points = np.zeros((n, 3), dtype=bool)
        for point, letters in datum["held"]:
            for letter in letters:
                points[named.points.index(point), "XYZ".index(letter)] = True
        return DatumUnknowns(points, np.zeros((p, 3), dtype=bool), np.zeros(p, dtype=bool))
    wanted_points, wanted_stations = datum.get("points"), datum.get("stations")
    if datum["type"] != "free":
        wanted_points = wanted_stations = None
    if wanted_points is not None or wanted_stations is not None:
        wanted_points, wanted_stations = wanted_points or [], wanted_stations or []
    of_points = np.isin(named.points, wanted_points) if wanted_points is not None else np.ones(n, dtype=bool)
    stations = np.isin(named.stations, wanted_stations) if wanted_stations is not None else np.ones(p, dtype=bool)
    angles = stations & bool(datum.get("angles", True))
    return DatumUnknowns(np.repeat(of_points[:, None], 3, axis=1), np.repeat(stations[:, None], 3, axis=1), angles)


def held_values(named: NamedNetwork, datum: Json, reference: State) -> State:
    """Put the coordinates that a minimal datum states into approximate values."""
    points = reference.points.copy()
    for key, value in datum["values"].items():
        k, place = named.points.index(key[:-1]), "XYZ".index(key[-1])
        points[k, place] = value - named.origin_m[place]
    return State(
        **{name: getattr(reference, name) for name in State.__dataclass_fields__ if name != "points"}, points=points
    )


def _conditions(named: NamedNetwork, state: State, chosen: DatumUnknowns, defect: Defect) -> Array:
    motions = common_motions(named.network.layout, state) @ defect.combinations
    return free_conditions(named.network.layout, state, chosen, named.photos, motions)


def aligned(
    layout: Layout, state: State, reference: State, chosen: DatumUnknowns, photos: Array, combinations: Array
) -> State:
    """Move everything so that the chosen unknowns are nearest to their approximate values, Fᵀ (x - x0) = 0 (MATH 6.2).

    Parameters
    ----------
    layout
        Columns.
    state
        What is moved.
    reference
        Approximate values.
    chosen
        Unknowns that carry the datum.
    photos
        (p,) stations whose angles are α, ζ, κ.
    combinations
        (7, d) free motions.

    Raises
    ------
    InvalidInputError
        They are so far from the network that it cannot be moved onto them.
    """
    step = np.full(7, np.inf)
    for _ in range(ALIGNING_ROUNDS):
        motions = common_motions(layout, state) @ combinations
        conditions = free_conditions(layout, state, chosen, photos, motions)
        differences = np.zeros(layout.count + 1)
        differences[layout.columns[Kind.POINT]] = state.points - reference.points
        differences[layout.columns[Kind.POSE][:, 3:]] = state.positions - reference.positions
        turns = np.swapaxes(reference.rotations, 1, 2) @ state.rotations
        vectors = Rotation.from_matrix(turns).as_rotvec() if len(turns) else np.zeros((0, 3))
        differences[layout.columns[Kind.POSE][:, :3]] = vectors
        crossing = conditions.T @ motions
        step = -combinations @ np.linalg.lstsq(crossing, conditions.T @ differences[:-1], rcond=None)[0]
        step *= min(1.0, LARGEST_TURN_RAD / max(float(np.linalg.norm(step[3:6])), LARGEST_TURN_RAD))
        # the motion of a scale is the coordinates themselves: the step is by how much it changes, not its logarithm
        scale = 1.0 + step[6] if step[6] > -0.5 else np.exp(step[6])
        state = state.moved_together(step[:3], step[3:6], float(scale))
        if np.abs(step).max() < 1e-13:
            break
    if not np.abs(step[3:]).max() < SETTLED:
        raise InvalidInputError(
            "approximate values",
            "the network cannot be laid onto them: some are far from where its observations place them",
            "correct them, leave them out, or choose another datum",
        )
    return state
