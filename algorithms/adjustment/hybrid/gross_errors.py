"""Gross errors and variance components of a hybrid network, in Haring's order (H-19 to H-22; MATH 4.5 to 4.7)."""

from dataclasses import dataclass, field

import numpy as np

from algorithms.adjustment.hybrid.estimation import Estimate, estimate
from algorithms.adjustment.hybrid.network import Network
from algorithms.adjustment.hybrid.reliability import ObservationTests, observation_tests
from algorithms.adjustment.hybrid.state import State
from algorithms.adjustment.robust_weights import LAST_HALF_WIDTHS, SLOWEST_NARROWING, weight_factor
from algorithms.adjustment.variance_components import LEAST_REDUNDANCY, UNIT
from algorithms.arrays import Array, Flags, Indices
from algorithms.progress import NoProgress, Progress

ONE_AT_A_TIME = 20_000
"""Networks of more observations leave out all that are worst among those of the same points, in one round."""
FASTEST_NARROWING = 0.7
"""Robust weights of such networks narrow at least by this factor in each round."""
MOST_ROUNDS = 30
"""Of variance components."""
MOST_ROBUST_ROUNDS = 200
MOST_TURNS = 5
"""Of variance components and single tests."""


@dataclass(frozen=True)
class GrossErrorOptions:
    """What to do about gross errors."""

    screening_m: float | None = 0.5
    """Observations that miss by more at the object are left out first [m]."""
    robust: bool = True
    """Mark with ORIENT's weight function."""
    snooping: bool = True
    """Leave out what fails its test."""
    variance_components: bool = False
    """Estimate standard deviations of groups, then test once more."""
    alpha: float = 0.001
    """Probability that a good observation fails its test."""
    power: float = 0.80
    """Probability with which an error of the smallest detectable size is found."""
    max_removed_share: float = 0.3
    """Largest share of the observations that may be left out."""
    max_iterations: int = 50
    """Limit of rounds in each adjustment."""


@dataclass(frozen=True)
class Removal:
    """An observation that was left out."""

    block: int
    stage: str
    """screening, robust or snooping."""
    step: int
    """Round of its stage."""
    statistic: float
    """|v| at the object [m] of screening, |v|/sigma of robust weights, T of single tests."""


@dataclass(frozen=True, eq=False)
class Components:
    """Factors on the standard deviations of groups (MATH 4.7)."""

    factors: Array
    """(groups,) 1 where the group's redundancy does not tell it."""
    factor_stds: Array
    """(groups,) sigma(s) = s / sqrt(2 r); inf without redundancy."""
    estimated: Flags
    rounds: int
    converged: bool


@dataclass(eq=False)
class Cleaned:
    """A network after the search for gross errors."""

    estimate: Estimate
    tests: ObservationTests
    used: Flags
    """(blocks,)."""
    scales: Array
    """(blocks,) factors on the a-priori standard deviations."""
    removals: list[Removal] = field(default_factory=list)
    """What was left out and stayed out, in order."""
    reinstated: list[int] = field(default_factory=list)
    """Blocks that were brought back in the end."""
    half_widths: list[float] = field(default_factory=list)
    """h of the rounds of robust weights."""
    components: Components | None = None


def most_left_out(share: float, observations: int) -> int:
    """Return how many of so many observations may be left out (MATH 4.6)."""
    return int(share * observations + 1e-9)


class Search:
    """Adjusts a network again and again, with fewer observations or other weights."""

    def __init__(
        self,
        network: Network,
        start: State,
        groups: Indices,
        fictitious: Flags,
        options: GrossErrorOptions,
        progress: Progress | None = None,
        used: Flags | None = None,
    ) -> None:
        """Take a network.

        Parameters
        ----------
        network
            Observations.
        start
            Start values.
        groups
            (blocks,) group of each.
        fictitious
            (blocks,) what was not measured: it is never left out.
        options
            What to do.
        progress
            Hears of every round.
        used
            (blocks,) what the search begins with; what passes its test returns. None: everything.
        """
        self.network, self.groups, self.fictitious, self.options = network, groups, fictitious, options
        self.progress = progress or NoProgress()
        blocks = len(network.sizes)
        self.used = np.ones(blocks, dtype=bool) if used is None else used.copy()
        self.scales = np.ones(blocks)
        self.state = start
        self.removals: list[Removal] = []
        self.reinstated: list[int] = []
        self.widths: list[float] = []
        self.rows_are_many = len(network.block_of_row) > ONE_AT_A_TIME

    def run(self) -> Cleaned:
        """Do the steps in Haring's order: screening, robust weights, tests, variance components and tests by turns."""
        options = self.options
        if options.robust:
            self._robust()
        if options.screening_m is not None:
            self._screen(options.screening_m)
        components = None
        if options.snooping:
            self.progress.report(0.4, "testing single observations")
            self._snoop()
        if options.variance_components:
            self.progress.report(0.7, "estimating variance components")
            before = np.zeros_like(self.used)
            for _ in range(MOST_TURNS):  # what is left out tells the components, and they tell what is left out
                if (before == self.used).all():
                    break
                before = self.used.copy()
                components = self._components()
                if options.snooping:
                    self._snoop()
        self.progress.report(0.9, "last adjustment")
        found = self._adjusted(rough=False)
        return Cleaned(
            found, self._tests(found), self.used, self.scales, self.removals, self.reinstated, self.widths, components
        )

    def _row_weights(self, factors: Array | None = None) -> Array:
        weights = self.used / np.square(self.scales)
        if factors is not None:
            weights = weights * factors
        return np.asarray(weights[self.network.block_of_row])

    def _adjusted(self, *, rough: bool, factors: Array | None = None, rounds: int | None = None) -> Estimate:
        limit = self.options.max_iterations if rounds is None else rounds
        found = estimate(self.network, self.state, self._row_weights(factors), limit, rough=rough)
        self.state = found.state
        return found

    def _tests(self, found: Estimate) -> ObservationTests:
        scales = self.scales[self.network.block_of_row]
        return observation_tests(self.network, found, scales, self.options.alpha, self.options.power)

    def _distances(self, found: Estimate) -> Array:
        """Give d = |v|/sigma of every block, of several components sqrt(vᵀ C⁻¹ v / d)."""
        squares = np.bincount(self.network.block_of_row, np.square(found.linearised.residuals), len(self.network.sizes))
        return np.asarray(np.sqrt(squares / self.network.sizes) / self.scales)

    def _robust(self) -> None:
        """Narrow ORIENT's weight function from round to round (H-20); what lies beyond h is marked, and may return."""
        self.progress.report(0.1, "robust weights")
        found = self._adjusted(rough=True)
        distances = self._distances(found)
        distances[self.fictitious] = 0.0
        marked = np.zeros(len(distances), dtype=bool)
        steps = np.zeros(len(distances), dtype=np.int64)
        while len(self.widths) < MOST_ROBUST_ROUNDS and (not self.widths or self.widths[-1] > LAST_HALF_WIDTHS[-1]):
            self.progress.report(0.1, f"robust weights, round {len(self.widths) + 1}")
            self.widths.append(self._next_width(distances[~marked]))
            newly = (distances > self.widths[-1]) & ~marked
            marked = distances > self.widths[-1]
            steps[newly] = len(self.widths)
            factors = np.where(marked, 0.0, weight_factor(distances, self.widths[-1]))
            factors[self.fictitious] = 1.0
            found = self._adjusted(rough=True, factors=factors, rounds=6)
            distances = self._distances(found)
            distances[self.fictitious] = 0.0
        marked = self._worst_of(distances > LAST_HALF_WIDTHS[-1], distances)
        for block in sorted(np.flatnonzero(marked), key=lambda b: (steps[b], -distances[b])):
            self.removals.append(Removal(int(block), "robust", int(steps[block]), float(distances[block])))
        self.used &= ~marked
        self._adjusted(rough=True)

    def _worst_of(self, marked: Flags, distances: Array) -> Flags:
        """Keep of what is marked no more than may be left out, the worst."""
        blocks = np.flatnonzero(marked)
        kept = np.zeros_like(marked)
        kept[blocks[np.argsort(-distances[blocks], kind="stable")[: self._allowance()]]] = True
        return kept

    def _next_width(self, unmarked: Array) -> float:
        narrowing = FASTEST_NARROWING if self.rows_are_many else SLOWEST_NARROWING
        between = float(np.mean(np.sort(unmarked)[-2:])) if len(unmarked) else 0.0
        if self.widths:
            between = min(between, narrowing * self.widths[-1])
        if between > LAST_HALF_WIDTHS[0]:
            return between
        return LAST_HALF_WIDTHS[1] if self.widths and self.widths[-1] <= LAST_HALF_WIDTHS[0] else LAST_HALF_WIDTHS[0]

    def _screen(self, limit_m: float) -> None:
        """Leave out what misses by more than a limit at the object (H-19), after the robust weights or a first fit."""
        self.progress.report(0.3, "screening")
        found = self._adjusted(rough=True)
        missed = np.abs(found.linearised.raw_residuals) * self.network.metres(found.state)
        largest = np.zeros(len(self.network.sizes))
        np.maximum.at(largest, self.network.block_of_row, missed)
        beyond = (largest > limit_m) & ~self.fictitious
        already = {each.block: k for k, each in enumerate(self.removals)}
        for block in np.flatnonzero(beyond):
            removal = Removal(int(block), "screening", 1, float(largest[block]))
            if int(block) in already:
                self.removals[already[int(block)]] = removal
            elif self._allowance():
                self.used[block] = False
                self.removals.append(removal)

    def _allowance(self) -> int:
        """Return how many observations more may be left out."""
        measured = ~self.fictitious
        most = most_left_out(self.options.max_removed_share, int(measured.sum()))
        return max(0, most - int((measured & ~self.used).sum()))

    def _snoop(self) -> None:
        """Leave out the worst, adjust, and so on; then bring back what passes the test of its prediction (H-21)."""
        step = max((each.step for each in self.removals if each.stage == "snooping"), default=0)
        while allowance := self._allowance():
            found = self._adjusted(rough=True)
            tests = self._tests(found)
            worst = self._worst(tests)[:allowance]
            if not len(worst):
                break
            step += 1
            self.progress.report(0.5, f"single tests, round {step}")
            for block in worst:
                self.removals.append(Removal(int(block), "snooping", step, float(tests.statistics[block])))
                self.used[block] = False
        self._bring_back()

    def _worst(self, tests: ObservationTests) -> Indices:
        candidates = np.flatnonzero(self.used & ~self.fictitious & (tests.p_values < self.options.alpha))
        # below the smallest numbers p-values are all zero: the statistics themselves decide
        order = np.lexsort((-tests.statistics[candidates], tests.p_values[candidates]))
        candidates = candidates[order]
        if not self.rows_are_many:
            return candidates[:1]
        taken: set[tuple[int, int]] = set()
        chosen = []
        for block in candidates:
            concerned = self._points_of(int(block))
            if not taken & concerned:
                chosen.append(block)
                taken |= concerned
        return np.array(chosen, dtype=np.int64)

    def _points_of(self, block: int) -> set[tuple[int, int]]:
        k = int(np.searchsorted(self.network.first_blocks, block, side="right")) - 1
        each = self.network.observations[k]
        number = block - int(self.network.first_blocks[k])
        places = [(int(kind), int(numbers[number])) for kind, numbers in each.places]
        points = {place for place in places if place[0] == 0}
        return points or set(places[:1])

    def _bring_back(self) -> None:
        while True:
            out = np.flatnonzero(~self.used)
            if not len(out):
                return
            found = self._adjusted(rough=True)
            tests = self._tests(found)
            screened = {each.block for each in self.removals if each.stage == "screening"}
            good = [b for b in out if tests.p_values[b] > self.options.alpha and b not in screened]
            if not good:
                return
            good.sort(key=lambda b: tests.statistics[b])
            returning = good if self.rows_are_many else good[:1]
            back = {int(b) for b in returning} - set(self.reinstated)
            if not back:  # what fails among the others and passes alone would go on for ever
                return
            self.used[list(back)] = True
            self.reinstated += sorted(back)
            self.removals = [each for each in self.removals if each.block not in back]

    def _components(self) -> Components:
        """Multiply the standard deviations of each group by sqrt(Omega_g / r_g) until all are 1 (Foerstner 1979)."""
        count = int(self.groups.max(initial=-1)) + 1
        total = np.ones(count)
        estimable = np.ones(count, dtype=bool)
        estimable[np.unique(self.groups[self.fictitious])] = False
        converged, rounds = False, 0
        change, redundancy = np.ones(count), np.zeros(count)
        while not converged and rounds < MOST_ROUNDS:
            rounds += 1
            found = self._adjusted(rough=False)
            omega, redundancy = self.group_sums(found, self._tests(found))
            estimated = estimable & (redundancy >= LEAST_REDUNDANCY)
            change = np.where(estimated, np.sqrt(np.where(estimated, omega / np.maximum(redundancy, 1e-12), 1.0)), 1.0)
            total *= change
            self.scales = total[self.groups]
            converged = bool((np.abs(change - 1.0) < UNIT).all())
        estimated = estimable & (redundancy >= LEAST_REDUNDANCY)
        spread = np.where(redundancy > 0.0, total / np.sqrt(2.0 * np.maximum(redundancy, 1e-12)), np.inf)
        return Components(total, spread, estimated, rounds, converged)

    def group_sums(self, found: Estimate, tests: ObservationTests) -> tuple[Array, Array]:
        """Give Omega and redundancy of each group (MATH 4.6)."""
        return group_sums(self.network, self.groups, found, tests)


def group_sums(network: Network, groups: Indices, found: Estimate, tests: ObservationTests) -> tuple[Array, Array]:
    """Sum weighted squared residuals and redundancy numbers over groups (MATH 4.7)."""
    count = int(groups.max(initial=-1)) + 1
    of_row = groups[network.block_of_row]
    omega = np.bincount(of_row, found.weights * np.square(found.linearised.residuals), count)
    return omega, np.bincount(of_row, tests.redundancy, count)


def clean(
    network: Network,
    start: State,
    groups: Indices,
    fictitious: Flags,
    options: GrossErrorOptions,
    progress: Progress | None = None,
    used: Flags | None = None,
) -> Cleaned:
    """Adjust a network and sort its gross errors out (H-19 to H-22); see `Search` (MATH 4.6)."""
    return Search(network, start, groups, fictitious, options, progress, used).run()
