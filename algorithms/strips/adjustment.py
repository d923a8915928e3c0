"""Adjust a block of strips: robust weights, tests one at a time, observations of zero that are wrong (MATH 12.2, 12.3).

The order is that of Haring (H-19) as in networks; what is tested is how one strip sees one patch: as a whole, and for
a shift along the normal, which a heap, high grass or another roof is, and which the test of a whole hides among tilts.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64
from scipy import linalg

from algorithms.adjustment.robust_weights import LAST_HALF_WIDTHS, weight_factor
from algorithms.adjustment.snooping import robust_variance_factor
from algorithms.adjustment.testing import (
    NOT_CONTROLLED,
    BlockTests,
    GlobalTest,
    GlobalVerdict,
    global_test,
    normal_critical_value,
)
from algorithms.arrays import Array, Flags, Matrices3, Matrix, Points, Scalars
from algorithms.errors import NotConvergedError, TooFewCorrespondencesError
from algorithms.probabilities import chi2_isf
from algorithms.progress import Progress
from algorithms.strips.block import Block, Equations, Reduced, State, positive_solution
from algorithms.strips.mixing import Mixing
from algorithms.strips.options import CorrectionOptions
from algorithms.strips.residual_blocks import BlockTest, across_strips, along_strips, block_test
from algorithms.strips.waves import WaveSizes, likeliest_sizes

MOST_ITERATIONS = 60
"""Usual are three to six; what ties hardly tell, such as the bore-sight over level ground, takes many times more."""
SETTLED_IN_STD = 0.01
"""Steps by which no function of the unknowns moves by more than this share of its standard deviation end it."""
NARROWING = 0.5
"""Robust weights narrow by this factor in each round."""
SETTLED_SHARE = 0.9
"""The usual misfit has settled where a round lowers it by less than a tenth."""
MOST_ROBUST_ROUNDS, MOST_ROUNDS = 60, 40
GLOBAL_ALPHA = 0.05
FREED = 1e-4
"""Share of the weights of observations of zero that stays when sizes of waves are estimated."""
KNOWN_BY_DATA = 0.5
"""An observation of zero is given up only where the data alone tell more than it does."""
LEAST_TIES = 4
"""Patches in common, without which nothing is adjusted."""


@dataclass(frozen=True, eq=False)
class Adjusted:
    """A block with its corrections."""

    block: Block
    state: State
    cofactors: Float64[Array, "s s"]
    """(s, s) covariance of the unknowns of strips and bore-sight, the variance factor in it."""
    whole_cofactors: Float64[Array, "u u"]
    """(u, u) the same with mount and waves."""
    data_normal: Float64[Array, "s s"]
    """(s, s) of the data alone, the variance factor in it, planes, mount and waves eliminated."""
    zero_weights: Float64[Array, "s"]
    """(s,) of the observations of zero; 0 where they were given up."""
    zero_stds: Float64[Array, "s"]
    """(s,) as stated."""
    mount_stds: Float64[Array, "common"]
    """(m,) expected of what strips without trajectories have in common; none where all have one."""
    sizes: WaveSizes
    """Of the waves."""
    along: BlockTest
    """Residuals by blocks along the strips."""
    across: BlockTest
    """The same across them."""
    block_factor: float
    """By which variances of ties and control are multiplied more, because residuals of blocks are correlated."""
    used: Bool[Array, "k"]
    """(k,) ties that take part."""
    control_used: Bool[Array, "m"]
    """(m,)."""
    residuals_m: Float64[Array, "k 3"]
    """(k, 3) of all ties, also of those that take no part."""
    gaps_before_m: Float64[Array, "k 3"]
    """(k, 3) the same without corrections, about the planes that fit best then."""
    control_m: Float64[Array, "m"]
    """(m,) distance of the control points from the planes."""
    control_before_m: Float64[Array, "m"]
    statistics: Float64[Array, "k"]
    """(k,) T of each tie."""
    lifts: Float64[Array, "k"]
    """(k,) T of a shift of each tie along its normal alone."""
    control_statistics: Float64[Array, "m"]
    """(m,)."""
    critical: float
    """Limit of T of ties, the variance factor of the tests in it."""
    lift_critical: float
    """The same of shifts along the normal."""
    control_critical: float
    test_variance_factor: float
    variance_factor: float
    """On the variances of ties and control: that of the global test where it finds them too small, else 1."""
    test: GlobalTest
    iterations: int

    @property
    def failed_by(self) -> tuple[Scalars, Scalars]:
        """T of the test that each tie (k,) fails worst, or passes by least, and its limit (k,)."""
        lifted = self.lifts / self.lift_critical > self.statistics / self.critical
        return np.where(lifted, self.lifts, self.statistics), np.where(lifted, self.lift_critical, self.critical)

    @property
    def paired(self) -> Flags:
        """(k,) ties that take part and say something, because another strip or control sees the patch too."""
        patches = self.block.ties.patches
        count = len(self.block.references_m)
        seen = np.bincount(patches[self.used], minlength=count)
        seen += np.bincount(self.block.control.patches[self.control_used], minlength=count)
        return np.asarray(self.used & (seen[patches] >= 2))


def approximate_block(block: Block, start: State, options: CorrectionOptions) -> tuple[State, Flags]:
    """Adjust with robust weights alone: where patches are then; gives the state and which ties are good (k,).

    Raises
    ------
    TooFewCorrespondencesError, NotConvergedError
        As `adjust_block`.
    """
    search = _Search(block, start, options)
    search.check()
    search.robust()
    return search.state, search.used


def adjust_block(block: Block, start: State, options: CorrectionOptions, alpha: float, progress: Progress) -> Adjusted:
    """Adjust a block.

    Parameters
    ----------
    block
        Strips, patches and control.
    start
        Where to begin.
    options
        Of the corrections: their observations of zero.
    alpha
        Probability with which a good tie fails its test.
    progress
        Hears of the rounds.

    Raises
    ------
    TooFewCorrespondencesError
        Fewer than four patches are seen by two strips, or by one and control.
    NotConvergedError
        The iteration does not settle.
    """
    search = _Search(block, start, options)
    search.check()
    progress.report(0.0, "robust adjustment")
    search.robust()
    progress.report(0.4, "sizes of waves")
    search.fit_waves()
    progress.report(0.5, "testing the patches")
    tests, factor = search.snooped(alpha)
    search.fit_waves()
    tests, factor = search.snooped(alpha)
    progress.report(0.9, "testing the observations of zero")
    search.without_wrong_zeros(alpha)
    search.block_tests()
    return search.result(tests, factor, alpha)


@dataclass(frozen=True, eq=False)
class _Tests:
    statistics: Float64[Array, "k"]
    degrees: Float64[Array, "k"]
    lifts: Float64[Array, "k"]
    """(k,) of the one way in which surfaces mostly are wrong: for one strip the whole patch stands higher or lower."""
    control: Float64[Array, "m"]


class _Search:
    """Adjusts again and again, with fewer ties or other weights."""

    def __init__(self, block: Block, start: State, options: CorrectionOptions) -> None:
        self.block, self.state = block, start
        self.zero_stds = block.zero_stds(options)
        self.zero_weights = self.zero_stds**-2
        self.mount_stds = block.mount_stds(options)
        self.sizes = WaveSizes()
        self.used = np.ones(len(block.ties), dtype=bool)
        self.control_used = np.ones(len(block.control.patches), dtype=bool)
        self.factor = self.block_factor = 1.0
        self.along = self.across = BlockTest(0.0, 0)
        self.iterations = 0

    def check(self) -> None:
        """Count the patches that tie anything."""
        count = len(self.block.references_m)
        seen = np.bincount(self.block.ties.patches, minlength=count)
        known = np.bincount(self.block.control.patches, minlength=count)
        tied = int(((seen >= 2) | ((seen >= 1) & (known >= 1))).sum())
        if tied < LEAST_TIES:
            raise TooFewCorrespondencesError(tied, LEAST_TIES, "patches that two strips see")

    def solve(
        self, weights: Array | None = None, control: Array | None = None, *, rough: bool = False
    ) -> tuple[Equations, Reduced, Matrix]:
        """Adjust until it settles, or roughly by one step; give equations there, reduced and whole normal matrix."""
        own = self.used.astype(np.float64) if weights is None else weights
        known = self.control_used.astype(np.float64) if control is None else control
        share, mixing = np.inf, Mixing()
        for _ in range(MOST_ITERATIONS):
            reduced, normal = self.linear(own, known)
            at = self.block.whole_vector(self.state)
            step = positive_solution(normal, reduced.right - (normal - reduced.normal) @ at)
            planes = self.block.plane_step(reduced, step)
            # (gᵀ step)² <= (gᵀ N⁻¹ g) (stepᵀ N step) for every g
            share = float(np.sqrt(step @ normal @ step))
            settled = rough or share < SETTLED_IN_STD
            if not settled:
                step, flat = mixing.mixed(at, step, self.state.planes.ravel(), planes.ravel(), normal)
                planes = flat.reshape(-1, 3)
            self.state = self.block.moved(self.state, step, planes)
            self.iterations += 1
            if settled:
                return self.block.equations(self.state), reduced, normal
        raise NotConvergedError("the adjustment of the strips", MOST_ITERATIONS, share)

    def linear(self, own: Array, known: Array) -> tuple[Reduced, Matrix]:
        """Form the normal equations at the state."""
        at = self.block.equations(self.state)
        reduced = self.block.reduced(
            at, own / (self.factor * self.block.ties.std_m**2), known / (self.factor * at.control_std_m**2)
        )
        return reduced, reduced.normal + self.prior()

    def prior(self) -> Matrix:
        """Return the weights of what is expected of the unknowns before any data: zero, and smooth waves."""
        known = np.diag(np.concatenate([self.zero_weights, self.mount_stds**-2.0]))
        return np.asarray(linalg.block_diag(known, *self.sizes.precisions(self.block.knots)))

    def fit_waves(self) -> None:
        """Estimate the sizes of waves, with variances as the tests find them."""
        if not self.block.knots:
            return
        at, reduced, normal = self.solve()
        factor = self.test_factor(self.tests(at, reduced, linalg.inv(normal)))
        reduced, normal = self.linear(self.used.astype(np.float64), self.control_used.astype(np.float64))
        waves = np.arange(self.block.before_waves, self.block.count)
        right = reduced.right + reduced.normal @ self.block.whole_vector(self.state)
        # what polynomials explain is no wave, however far from zero they are
        free = normal - reduced.normal
        free[: self.block.stated, : self.block.stated] *= FREED
        own, rest = eliminated(reduced.normal / factor, right / factor, free, waves)
        self.sizes = likeliest_sizes(self.sizes, self.block.knots, own, rest)

    def robust(self) -> None:
        """Mark ties and control with weights that narrow from round to round (MATH 4.6).

        Variances are those of the usual misfit of the round: far from the solution wrong patches would otherwise drive
        what is weakly determined to where the equations are not linear any more.
        """
        everything, known = np.ones(len(self.used)), np.ones(len(self.control_used))
        reduced, _ = self.linear(everything, known)
        planes = self.state.planes + self.block.plane_step(reduced, np.zeros(self.block.count))
        self.state = replace(self.state, planes=planes)
        own, known, unit = self.misfits(self.block.equations(self.state))
        width, before = max(float(own.max(initial=0.0)), float(known.max(initial=0.0)), LAST_HALF_WIDTHS[0]), np.inf
        for _ in range(MOST_ROBUST_ROUNDS):
            self.factor = unit**2
            at, _, _ = self.solve(weight_factor(own, width), weight_factor(known, width), rough=True)
            before = unit
            own, known, unit = self.misfits(at)
            if width <= LAST_HALF_WIDTHS[-1] and unit > SETTLED_SHARE * before:
                break
            narrower = max(NARROWING * width, LAST_HALF_WIDTHS[0])
            width = LAST_HALF_WIDTHS[1] if width <= LAST_HALF_WIDTHS[0] and unit > SETTLED_SHARE * before else narrower
        self.factor = 1.0
        self.used, self.control_used = own <= LAST_HALF_WIDTHS[0], known <= LAST_HALF_WIDTHS[0]

    def misfits(self, at: Equations) -> tuple[Array, Array, float]:
        """Give misfits of ties (k,) and control (m,) over the usual one, and that over the standard deviations."""
        own = np.sqrt((at.residuals**2).sum(axis=1) / 3.0) / self.block.ties.std_m
        known = np.abs(at.control) / at.control_std_m
        # half of what two strips contradict each other goes into the plane between them
        unit = max(1.0, float(np.median(own)) / np.sqrt(0.5))
        return own / unit, known / unit, unit

    def snooped(self, alpha: float) -> tuple[_Tests, float]:
        """Leave out the worst tie of each patch that fails, bring back what passes, until nothing changes."""
        limit, single = tie_limit(alpha), normal_critical_value(alpha) ** 2
        back = np.zeros(len(self.used), dtype=bool)
        control_back = np.zeros(len(self.control_used), dtype=bool)
        for _ in range(MOST_ROUNDS):
            at, reduced, normal = self.solve()
            tests = self.tests(at, reduced, linalg.inv(normal))
            factor = self.test_factor(tests)
            shares = np.maximum(tests.statistics / limit, tests.lifts / single)
            passing = ~self.used & (shares <= factor) & ~back
            known = ~self.control_used & (tests.control <= single * factor) & ~control_back
            failing = np.where(self.used, shares, 0.0)
            patches = self.block.ties.patches
            worst = np.zeros(len(self.block.references_m))
            np.maximum.at(worst, patches, failing)
            of_control = np.where(self.control_used, tests.control / single, 0.0)
            np.maximum.at(worst, self.block.control.patches, of_control)
            out = self.used & (failing > factor) & (failing >= worst[patches])
            # of two strips that contradict each other the first stands for both
            out &= _first_of(patches, out)
            control_out = self.control_used & (of_control > factor) & (of_control >= worst[self.block.control.patches])
            if not (passing.any() or known.any() or out.any() or control_out.any()):
                return tests, factor
            back |= passing
            control_back |= known
            self.used = (self.used | passing) & ~out
            self.control_used = (self.control_used | known) & ~control_out
        return tests, factor

    def tests(self, at: Equations, reduced: Reduced, cofactors: Matrix) -> _Tests:
        """Test every tie as a whole and every control point; those left out against what the others predict."""
        std = self.block.ties.std_m * np.sqrt(self.factor)
        spread = self.block.cofactors_of_ties(at, reduced, cofactors) / (std**2)[:, None, None]
        left = np.eye(3) + np.where(self.used, -1.0, 1.0)[:, None, None] * spread
        values, vectors = np.linalg.eigh(0.5 * (left + np.swapaxes(left, 1, 2)))
        turned = np.einsum("kji,kj->ki", vectors, at.residuals / std[:, None])
        seen = values > NOT_CONTROLLED
        statistics = (np.where(seen, turned**2, 0.0) / np.where(seen, values, 1.0)).sum(axis=1)
        lifts = lifts_of(left, at.residuals / std[:, None], used=self.used)
        planes = self.block.control.patches
        own = self.plane_cofactors(reduced, cofactors, planes)
        variance = np.einsum("mi,mij,mj->m", at.control_by_planes, own, at.control_by_planes)
        known = at.control_std_m**2 * self.factor + np.where(self.control_used, -1.0, 1.0) * variance
        sure = known > NOT_CONTROLLED * at.control_std_m**2
        control = np.where(sure, at.control**2 / np.where(sure, known, 1.0), 0.0)
        return _Tests(
            self.factor * statistics, seen.sum(axis=1).astype(np.float64), self.factor * lifts, self.factor * control
        )

    def plane_cofactors(self, reduced: Reduced, cofactors: Matrix, patches: Array) -> Matrices3:
        """Give the covariances (m, 3, 3) of the planes of some patches."""
        out = reduced.plane_inverses[patches].copy()
        for number, patch in enumerate(patches.tolist()):
            share = reduced.plane_shares[3 * patch : 3 * patch + 3].toarray()
            out[number] += share @ cofactors @ share.T
        return np.asarray(out)

    def test_factor(self, tests: _Tests) -> float:
        """Estimate by how much variances are larger than stated, wrong ties notwithstanding (MATH 4.8)."""
        seen = np.bincount(self.block.ties.patches[self.used], minlength=len(self.block.references_m))
        told = self.used & (seen[self.block.ties.patches] >= 2)
        blocks = BlockTests(tests.statistics[told], tests.degrees[told], np.ones(int(told.sum())))
        return robust_variance_factor(blocks, self.redundancy())

    def redundancy(self) -> int:
        """Count observations, those of zero too, over unknowns."""
        patches = np.unique(
            np.concatenate([self.block.ties.patches[self.used], self.block.control.patches[self.control_used]])
        )
        seen = 3 * int(self.used.sum()) + int(self.control_used.sum())
        return seen - 3 * len(patches) - int((self.zero_weights == 0.0).sum())

    def omega(self, at: Equations) -> float:
        """Sum the weighted squares, those of the observations of zero too."""
        ties = ((at.residuals[self.used] / self.block.ties.std_m[self.used, None]) ** 2).sum()
        known = ((at.control[self.control_used] / at.control_std_m[self.control_used]) ** 2).sum()
        values = self.block.whole_vector(self.state)
        return float(ties + known + values @ self.prior() @ values)

    def without_wrong_zeros(self, alpha: float) -> None:
        """Scale variances by the global test, then give up the observations of zero that the data contradict."""
        at, _, normal = self.solve()
        told = global_test(self.omega(at), self.redundancy(), GLOBAL_ALPHA)
        if told.verdict is GlobalVerdict.TOO_LARGE:
            self.factor = told.omega / told.redundancy
            _, _, normal = self.solve()
        critical, values = normal_critical_value(alpha), self.block.vector(self.state)
        data = self.stated_normal(normal)
        right = (data + np.diag(self.zero_weights)) @ values
        while True:
            variances = np.diag(linalg.inv(data + np.diag(self.zero_weights)))
            control = 1.0 - variances * self.zero_weights
            known = (self.zero_weights > 0.0) & (control > KNOWN_BY_DATA)
            w = np.where(known, np.abs(values) / (self.zero_stds * np.sqrt(np.where(known, control, 1.0))), 0.0)
            worst = int(np.argmax(w))
            if w[worst] <= critical:
                break
            self.zero_weights[worst] = 0.0
            values = positive_solution(data + np.diag(self.zero_weights), right)

    def block_tests(self) -> None:
        """Test whether residuals of blocks are correlated; if so, let variances be those of blocks."""
        at, _, _ = self.solve()
        weights = self.used / (self.factor * self.block.ties.std_m**2)
        known = self.control_used / (self.factor * at.control_std_m**2)
        self.along, self.across = (
            block_test(self.block, self.state, at, weights, known, self.prior(), number(self.block, self.used))
            for number in (along_strips, across_strips)
        )
        self.block_factor = max([1.0, *(test.factor for test in (self.along, self.across) if test.significant)])
        self.factor *= self.block_factor

    def stated_normal(self, normal: Matrix) -> Array:
        """Return the normal matrix of coefficients and bore-sight by the data alone, mount and waves eliminated."""
        stated, whole = np.arange(self.block.stated), normal.copy()
        whole[stated, stated] -= self.zero_weights
        own, _ = eliminated(whole, np.zeros(len(whole)), np.zeros_like(whole), stated)
        return own

    def result(self, tests: _Tests, factor: float, alpha: float) -> Adjusted:
        """Describe the last adjustment."""
        at, reduced, normal = self.solve()
        cofactors = linalg.inv(normal)
        tests = self.tests(at, reduced, cofactors)
        cofactors = 0.5 * (cofactors + cofactors.T)
        stated = self.block.stated
        before = _at_zero(self)
        return Adjusted(
            block=self.block,
            state=self.state,
            cofactors=cofactors[:stated, :stated],
            whole_cofactors=cofactors,
            data_normal=self.stated_normal(normal),
            mount_stds=self.mount_stds,
            sizes=self.sizes,
            along=self.along,
            across=self.across,
            block_factor=self.block_factor,
            zero_weights=self.zero_weights,
            zero_stds=self.zero_stds,
            used=self.used,
            control_used=self.control_used,
            residuals_m=at.residuals,
            gaps_before_m=before.residuals,
            control_m=at.control,
            control_before_m=before.control,
            statistics=tests.statistics,
            lifts=tests.lifts,
            control_statistics=tests.control,
            critical=tie_limit(alpha) * factor,
            lift_critical=normal_critical_value(alpha) ** 2 * factor,
            control_critical=normal_critical_value(alpha) ** 2 * factor,
            test_variance_factor=factor,
            variance_factor=self.factor,
            test=global_test(self.omega(at), self.redundancy(), GLOBAL_ALPHA),
            iterations=self.iterations,
        )


def eliminated(normal: Matrix, right: Array, prior: Matrix, kept: Array) -> tuple[Array, Array]:
    """Eliminate all unknowns but those kept, with what is expected of the former; return normal matrix and right."""
    others = np.setdiff1d(np.arange(len(normal)), kept)
    own, mixed = normal[np.ix_(kept, kept)], normal[np.ix_(others, kept)]
    if len(others) == 0:
        return own, right[kept]
    inner = normal[np.ix_(others, others)] + prior[np.ix_(others, others)]
    solved = positive_solution(inner, np.column_stack([mixed, right[others]]))
    reduced = own - mixed.T @ solved[:, :-1]
    return 0.5 * (reduced + reduced.T), right[kept] - mixed.T @ solved[:, -1]


def lifts_of(cofactors: Matrices3, residuals: Points, *, used: Flags) -> Array:
    """Test ties (k,) for a shift along the normal, T of MATH 4.4 with one degree of freedom (MATH 12.2).

    `cofactors` (k, 3, 3) are those of the residuals (k, 3), both over the standard deviations of the ties; ties that
    are not used are compared with what the others predict.
    """
    own, out = cofactors[:, 0, 0], np.zeros(len(residuals))
    sure = used & (own > NOT_CONTROLLED)
    out[sure] = residuals[sure, 0] ** 2 / own[sure]
    weights = np.linalg.inv(cofactors[~used])
    out[~used] = np.einsum("kj,kj->k", weights[:, 0], residuals[~used]) ** 2 / weights[:, 0, 0]
    return out


def tie_limit(alpha: float) -> float:
    """Give the limit of T of a tie, which a good one exceeds with the probability alpha: of its three observations."""
    return float(chi2_isf(alpha, 3))


def _first_of(patches: Array, flags: Flags) -> Flags:
    """Keep of the flagged ties of each patch the first."""
    numbers = np.flatnonzero(flags)
    _, first = np.unique(patches[numbers], return_index=True)
    out = np.zeros(len(flags), dtype=bool)
    out[numbers[first]] = True
    return out


def _at_zero(search: _Search) -> Equations:
    """Give the residuals without corrections, about the planes that fit the ties best, control aside."""
    block = search.block
    state = replace(block.zero_state(), planes=search.state.planes)
    for _ in range(2):
        at = block.equations(state)
        reduced = block.reduced(at, search.used / block.ties.std_m**2, np.zeros(len(search.control_used)))
        state = replace(state, planes=state.planes + block.plane_step(reduced, np.zeros(block.count)))
    return block.equations(state)
