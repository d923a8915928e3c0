"""Many stations and points at once: datum, gross errors, variance components, tests (MATH 4, 6)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64, Int64

from algorithms.adjustment.datum import DatumSelection, free_network_conditions, free_unknowns, held_columns
from algorithms.adjustment.options import NetworkOptions
from algorithms.adjustment.problem import LinearSystem, Problem
from algorithms.adjustment.robust_weights import robust_adjustment
from algorithms.adjustment.snooping import SnoopingResult, SnoopingRules, adjust_and_snoop, adjusted
from algorithms.adjustment.solver import Solution, solve
from algorithms.adjustment.testing import ComponentTests, GlobalTest, component_tests, global_test
from algorithms.adjustment.unknowns import Unknowns
from algorithms.adjustment.variance_components import (
    GroupFigures,
    VarianceComponents,
    estimate_variance_components,
    group_figures,
)
from algorithms.adjustment.weights import whitening_of
from algorithms.arrays import Array, Flags, Indices
from algorithms.errors import DegenerateGeometryError

DEFAULT_OPTIONS = NetworkOptions()

Datum: TypeAlias = DatumSelection | Indices | None
"""A free network over selected unknowns; columns of unknowns held at their start values; or given by fixed ones."""


@dataclass(frozen=True, eq=False)
class NetworkAdjustment:
    """Adjusted network with its tests."""

    solution: Solution
    """Unknowns, cofactors (their covariance for sigma0 = 1) and residuals of the used observations."""
    snooping: SnoopingResult
    """Which observations were used, removed and reinstated, with their tests."""
    marked: Flags
    """(number of blocks,) True for those that the robust weights had marked; tests may have brought them back."""
    components: ComponentTests
    """Tests and reliability of each used residual."""
    global_test: GlobalTest
    groups: GroupFigures
    """Redundancy and S_gr of each group."""
    variance_components: VarianceComponents | None
    """Factors on the a-priori standard deviations; None where they were not asked for."""
    std_scales: Float64[Array, "blocks"]
    """Factors on the a-priori standard deviations of each block that the result rests on."""


def adjust_network(
    problem: Problem,
    start: Unknowns,
    datum: Datum,
    *,
    groups: Int64[Array, "blocks"] | None = None,
    options: NetworkOptions = DEFAULT_OPTIONS,
) -> NetworkAdjustment:
    """Adjust in the order robust weights, single tests, variance components, single tests once more (MATH 4.6).

    Parameters
    ----------
    problem
        Observations.
    start
        Start values.
    datum
        What defines the frame.
    groups
        (number of blocks,) group of each observation, from 0, for the table of groups and variance components; all one
        group where left out.
    options
        What to do, and significance levels.

    Raises
    ------
    DegenerateGeometryError
        When the observations and the datum leave unknowns undetermined.
    """
    adjust = partial(_adjusted, conditions=conditions_of(datum), max_iterations=options.max_iterations)
    of_block = np.zeros(len(problem), dtype=np.int64) if groups is None else groups
    count = int(of_block.max(initial=0)) + 1
    marked, values = np.zeros(len(problem), dtype=bool), start
    if options.robust:
        sorted_out = robust_adjustment(problem, start, adjust)
        marked, values = sorted_out.marked, sorted_out.solution.unknowns
    rules = SnoopingRules(options.alpha_single, options.max_removed_share if options.snooping else 0.0)
    # Without single tests nothing brings a marked observation back, so nothing is left out either.
    result = adjust_and_snoop(problem, values, rules, adjust, marked if options.snooping else None)
    scales, components = np.ones(len(problem)), None
    if options.variance_components:
        kept = problem.selected(result.used)
        components = estimate_variance_components(kept, of_block[result.used], result.solution.unknowns, adjust)
        factors = np.ones(count)
        factors[: len(components.factors)] = components.factors
        scales = factors[of_block]
        problem = problem.scaled(scales)
        result = adjust_and_snoop(problem, components.solution.unknowns, rules, adjust, ~result.used)
    # The datum of a free network refers to the values at which it is linearised: the adjusted ones.
    used = problem.selected(result.used)
    solution = adjusted(used, result.solution.unknowns, adjust)
    result = replace(result, solution=solution)
    return NetworkAdjustment(
        solution=solution,
        snooping=result,
        marked=marked,
        components=component_tests(solution, options.alpha_single, options.power),
        global_test=global_test(solution.omega, solution.redundancy, options.alpha_global),
        groups=group_figures(solution, of_block[result.used], count),
        variance_components=components,
        std_scales=scales,
    )


def conditions_of(datum: Datum) -> Callable[[Unknowns], Array]:
    """Give the function that writes a datum as conditions on steps from given values (MATH 6.2)."""
    if datum is None:
        return lambda unknowns: np.zeros((unknowns.count, 0))
    if isinstance(datum, DatumSelection):
        return lambda unknowns: free_network_conditions(unknowns, datum)
    return lambda unknowns: held_columns(unknowns, datum)


def _adjusted(
    problem: Problem,
    start: Unknowns,
    system: LinearSystem,
    rough: bool,
    *,
    conditions: Callable[[Unknowns], Array],
    max_iterations: int,
) -> Solution:
    linearised = (system, whitening_of(system))
    try:
        return solve(problem, start, conditions(start), max_iterations, linearised=linearised, rough=rough)
    except DegenerateGeometryError as error:
        if error.null_space is None:
            raise
        named = free_unknowns(start, error.null_space)
        raise DegenerateGeometryError(
            error.rank, named, error.null_space, error.advice, parameters=start.count
        ) from error
