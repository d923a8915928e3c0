"""Whether a scanner is in adjustment and its tripod stood still, told from what several stations see (MATH 6.8).

The errors are unknowns beside the poses, observed as zero with the maker's tolerances; the features are corrected by
them and everything adjusted again until nothing changes, so that what seemed a gross error can come back. An error is
called significant by the observations alone, without its own observation of zero; one that contradicts this observation
loses it, as a gross error does.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64
from scipy import linalg
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.options import AdjustmentOptions
from algorithms.arrays import Array, Flags, Matrix, Scalars
from algorithms.errors import DegenerateGeometryError, InvalidInputError, TooFewCorrespondencesError
from algorithms.network.instrument_normals import InstrumentNormals, columns_of, instrument_normals
from algorithms.network.instrument_responses import (
    ALL_ERRORS,
    responses_of,
    tells_of_instruments,
    without_instrument_errors,
)
from algorithms.network.joint_adjustment import JointAdjustment, adjust_jointly
from algorithms.network.open_stations import adjust_determined
from algorithms.network.track_observations import TrackKind
from algorithms.network.tracks import StationFeatures, Tracks
from algorithms.probabilities import chi2_isf, chi2_sf, norm_isf, norm_ppf
from algorithms.scans.instrument_errors import DriftError, InstrumentError, Sweep
from algorithms.targets.common_points import TargetSet

DEFAULT_OPTIONS = AdjustmentOptions()
POWER = 0.8
"""Probability with which an error of the detectable size is found."""
FAMILY_ALPHA = 0.01
"""Probability with which of instruments in adjustment any error at all is called significant."""
MOST_ROUNDS = 8
SETTLED_IN_STD = 0.05
"""Steps below this share of the standard deviations end the rounds."""
NOTHING_SHARE = 1e-9
"""Less of the information with known poses is left by rounding alone."""
CONTRADICTED_ALPHA = 0.001
"""Probability with which an error within its tolerance loses its observation of zero."""
INSEPARABLE = 0.95
"""Correlation from which two errors, the poses free, cannot be told apart."""


@dataclass(frozen=True)
class SoughtError:
    """An error that may be there."""

    error: InstrumentError | DriftError
    stations: tuple[int, ...]
    """Stations that have it in common: those of an instrument, or one."""
    tolerance: float
    """Standard deviation of the observation that it is zero: the maker's tolerance [rad, m or 1]."""
    wanted: bool = False
    """Whether it is estimated in any case, and not only where it is significant."""


@dataclass(frozen=True)
class InstrumentSearch:
    """What is looked for in a network."""

    sought: tuple[SoughtError, ...]
    """Errors of instruments, and of the set-ups of single stations."""
    apply: bool = False
    """Whether the poses are those with the estimated errors taken off."""

    def among(self, stations: Sequence[int]) -> list[SoughtError]:
        """Keep what concerns stations that are connected."""
        known = set(stations)
        return [each for each in self.sought if known & set(each.stations)]


@dataclass(frozen=True)
class FoundError:
    """What the network tells of an error."""

    sought: SoughtError
    value: float
    """Recorded minus true; with its observation of zero [rad, m or 1]."""
    std: float
    """Standard deviation of the value; infinite where nothing tells of it."""
    statistic: float
    """Square of the value over its standard deviation, both without its observation of zero; chi-square, 1 degree."""
    critical: float
    """Limit of the statistic, all errors tested together."""
    estimated: bool
    """Whether the final solution has it as an unknown; others are as if they were added to it."""
    determined: bool
    """Whether the observations know it better than the tolerance."""
    observed_as_zero: bool
    """Whether the value rests on that observation too; False: the network contradicts it."""
    detectable: float
    """Size from which it is found with a probability of 80 %; infinite where nothing tells of it."""
    inseparable: tuple[int, ...]
    """Numbers of sought errors from which it cannot be told apart here."""

    @property
    def significant(self) -> bool:
        """Whether it is not zero."""
        return self.statistic > self.critical


@dataclass(frozen=True, eq=False)
class InstrumentCalibration:
    """Errors of instruments and tripods, and poses without and with them."""

    errors: tuple[FoundError, ...]
    without: JointAdjustment
    """With instruments taken for errorless; the same tracks as `joint`, those that scans alone made."""
    joint: JointAdjustment
    """With the estimated errors taken off; its cofactors contain their uncertainty."""
    of_surfaces: JointAdjustment | None
    """The same by planes and pipes alone, for whoever adjusts the targets later; None: these leave a pose open."""
    covariance: Float64[Array, "c c"]
    """(c, c) of the estimated errors, in their order."""
    unknown_stations: tuple[int, ...]
    """Stations whose file does not tell where the instrument stood: taken for errorless."""
    sweeps: Mapping[int, Sweep | None]
    """When the instrument looked where at each station; None where the file does not tell."""
    converged: bool

    @property
    def estimated(self) -> tuple[FoundError, ...]:
        """The errors in the final solution."""
        return tuple(found for found in self.errors if found.estimated)

    def values(self, station: int) -> Scalars:
        """Give the estimated errors (11,) of a station in the order of `ALL_ERRORS`, zero where there is none."""
        return _values_of(station, [found.sought for found in self.errors], [
            found.value if found.estimated else 0.0 for found in self.errors
        ])  # fmt: skip


def calibrate_instruments(
    features: Mapping[int, StationFeatures],
    tracks: Tracks,
    stations: Sequence[int],
    start: Mapping[int, RigidTransform],
    sought: Sequence[SoughtError],
    options: AdjustmentOptions = DEFAULT_OPTIONS,
) -> InstrumentCalibration:
    """Estimate errors of instruments and tripods from planes, pipes and targets that several stations see.

    All are estimated first; of those that are not wanted in any case the ones stay that are significant, found one
    after the other, the most significant first.

    Parameters
    ----------
    features
        Of each station, in its reduced frame.
    tracks
        Objects and the features that show them.
    stations
        Stations in the adjustment; the first one is fixed. Those that the features leave open take no part.
    start
        Poses in a common frame.
    sought
        Errors that may be there.
    options
        Of the adjustment.

    Raises
    ------
    DegenerateGeometryError, TooFewCorrespondencesError
        As `adjust_determined`.
    InvalidInputError
        Nothing is sought.
    """
    if not sought:
        raise InvalidInputError("scanner", "no error is sought", "name at least one")
    tracks = tells_of_instruments(dict(features), tracks)
    determined = adjust_determined(features, tracks, stations, start, options)
    without, tracks, stations = determined.joint, determined.tracks, determined.joint.stations
    network = _Network(features, tracks, stations, start, tuple(sought), options)
    zeros = np.array([1.0 / each.tolerance**2 for each in sought])
    whole = network.estimated(np.ones(len(sought), dtype=bool), zeros, without)
    chosen = _significant(whole, sought, zeros)
    zeros[_contradicted(whole, chosen, zeros)] = 0.0
    while True:
        final = network.estimated(chosen, zeros, without)
        errors = _found(final, sought, chosen, zeros)
        # in the final solution, with gross errors looked for anew, one may have become insignificant
        gone = [k for k, found in enumerate(errors) if chosen[k] and not found.significant and not sought[k].wanted]
        if not gone:
            break
        chosen[gone] = False
    covariance = _covariance(final, chosen, zeros)
    joint = _with_errors(final.joint, final.normals, chosen, covariance)
    return InstrumentCalibration(
        errors=errors,
        without=without,
        joint=joint,
        of_surfaces=network.of_surfaces(final, chosen, covariance) if tracks.points else joint,
        covariance=covariance,
        unknown_stations=tuple(k for k in stations if features[k].plane_responses is None),
        sweeps={k: features[k].sweep for k in stations},
        converged=final.converged,
    )


@dataclass(frozen=True, eq=False)
class _Estimate:
    """A least squares solution with some of the errors."""

    values: Scalars
    """(c,) zero for those that are not estimated."""
    joint: JointAdjustment
    normals: InstrumentNormals
    """Of all errors, at the solution."""
    converged: bool


@dataclass(frozen=True, eq=False)
class _Network:
    """What is adjusted again and again."""

    features: Mapping[int, StationFeatures]
    tracks: Tracks
    stations: tuple[int, ...]
    start: Mapping[int, RigidTransform]
    sought: tuple[SoughtError, ...]
    options: AdjustmentOptions

    @property
    def columns(self) -> Array:
        """Say which error stands for which at each station."""
        return columns_of(self.stations, [(each.error, each.stations) for each in self.sought])

    @property
    def scales_of_everything(self) -> Flags:
        """Say which errors are a scale of the ranges of all stations: the whole network grows with it, and all fits."""
        known = {k for k in self.stations if self.features[k].plane_responses is not None}
        return np.array([
            each.error is InstrumentError.RANGE_SCALE and known == set(self.stations) <= set(each.stations)
            for each in self.sought
        ])  # fmt: skip

    def estimated(self, chosen: Array, zeros: Array, without: JointAdjustment) -> _Estimate:
        """Estimate the chosen errors, correct the features and adjust again until nothing changes.

        Errors are observed as zero with weights `zeros` (c,).
        """
        count = len(self.sought)
        values, joint, features = np.zeros(count), without, self.features
        prior = np.diag(zeros[chosen])
        for _ in range(MOST_ROUNDS):
            normals = instrument_normals(features, joint, self.columns, count)
            # what noise leaves of the information on a scale that is in all ranges is none
            normals = replace(normals, alone=np.where(self.scales_of_everything, np.inf, normals.alone))
            if not chosen.any():
                return _Estimate(values, joint, normals, converged=True)
            of_chosen = normals.information[np.ix_(chosen, chosen)]
            factor = joint.variance_factor
            normal = of_chosen / factor + prior
            wanted = (of_chosen @ values[chosen] + normals.gradient[chosen]) / factor
            step = linalg.solve(normal, wanted, assume_a="pos") - values[chosen]
            values[chosen] += step
            if np.abs(step * np.sqrt(np.diag(normal))).max() < SETTLED_IN_STD:
                return _Estimate(values, joint, normals, converged=True)
            features = {
                k: without_instrument_errors(each, _values_of(k, self.sought, values))
                for k, each in self.features.items()
            }
            start = {**self.start, **{k: joint.pose(k) for k in self.stations}}
            joint = adjust_jointly(features, self.tracks, self.stations, start, self.options)
        return _Estimate(values, joint, normals, converged=False)

    def of_surfaces(self, final: _Estimate, chosen: Array, covariance: Matrix) -> JointAdjustment | None:
        """Adjust the poses to planes and pipes alone, the errors taken off that targets helped to estimate."""
        features = {
            k: without_instrument_errors(each, _values_of(k, self.sought, final.values))
            for k, each in self.features.items()
        }
        start = {**self.start, **{k: final.joint.pose(k) for k in self.stations}}
        try:
            joint = adjust_jointly(features, replace(self.tracks, points=()), self.stations, start, self.options)
        except (DegenerateGeometryError, TooFewCorrespondencesError):
            return None
        return _with_errors(
            joint, instrument_normals(features, joint, self.columns, len(self.sought)), chosen, covariance
        )


def _with_errors(
    joint: JointAdjustment, normals: InstrumentNormals, chosen: Array, covariance: Matrix
) -> JointAdjustment:
    """Enlarge the cofactors of the poses by the uncertainty of the chosen errors."""
    if not chosen.any():
        return joint
    inverse = normals.pose_cofactors(joint.solution.inverse, chosen, covariance / joint.variance_factor)
    return replace(joint, solution=replace(joint.solution, inverse=inverse))


def widened_by_tolerances(
    features: Mapping[int, StationFeatures], sought: Sequence[SoughtError]
) -> dict[int, TargetSet]:
    """Give the targets of all stations with covariances that allow for errors as large as the makers' tolerances.

    Parameters
    ----------
    features
        Of each station.
    sought
        Errors that may be there.
    """
    tolerances = [each.tolerance for each in sought]
    found = {}
    for station, each in features.items():
        reached = responses_of(each, TrackKind.POINT) * _values_of(station, sought, tolerances)
        points = each.targets.points
        wide = replace(points, covariances=points.covariances + reached @ np.swapaxes(reached, 1, 2))
        found[station] = replace(each.targets, points=wide)
    return found


def _values_of(station: int, sought: Sequence[SoughtError], values: Sequence[float] | Array) -> Scalars:
    found = np.zeros(len(ALL_ERRORS))
    for each, value in zip(sought, values, strict=True):
        if station in each.stations:
            found[ALL_ERRORS.index(each.error)] = value
    return found


def _significant(whole: _Estimate, sought: Sequence[SoughtError], zeros: Array) -> Array:
    """Choose errors one after the other, each by what it lowers the weighted squares beside those already chosen."""
    system = _System.of(whole, zeros)
    chosen = np.array([each.wanted for each in sought])
    critical = _critical(len(sought))
    while True:
        best, number = critical, -1
        for k in np.flatnonzero(~chosen).tolist():
            known, value = system.beside(k, np.flatnonzero(chosen))
            if value**2 * known > best:
                best, number = value**2 * known, k
        if number < 0:
            return chosen
        chosen[number] = True


def _contradicted(whole: _Estimate, chosen: Array, zeros: Array) -> list[int]:
    """Find the chosen errors that are larger than their tolerance allows."""
    system, critical = _System.of(whole, zeros), chi2_isf(CONTRADICTED_ALPHA, 1)
    found = []
    for k in np.flatnonzero(chosen).tolist():
        known, value = system.beside(k, np.flatnonzero(chosen))
        if known > 0.0 and value**2 > critical * (1.0 / known + 1.0 / zeros[k]):
            found.append(k)
    return found


@dataclass(frozen=True, eq=False)
class _System:
    """Normal equations of the errors about zero, the variance factor in them."""

    information: Array
    """(c, c)."""
    total: Array
    """(c,) right side: the least squares solution without observations of zero solves S p = it."""
    zeros: Array
    """(c,) weights of the observations of zero."""
    told: Array
    """(c,) whether anything at all tells of each error."""

    @staticmethod
    def of(estimate: _Estimate, zeros: Array) -> "_System":
        """Take the errors of an estimate together with what is left of their gradient."""
        normals, factor = estimate.normals, estimate.joint.variance_factor
        return _System(
            normals.information / factor,
            (normals.information @ estimate.values + normals.gradient) / factor,
            zeros,
            normals.information.diagonal() > NOTHING_SHARE * normals.alone,
        )

    def beside(self, k: int, others: Array) -> tuple[float, float]:
        """Give information on error k without its observation of zero, and its value; others keep theirs."""
        if not self.told[k]:
            return 0.0, 0.0
        others = others[others != k]
        own, right = float(self.information[k, k]), float(self.total[k])
        if len(others):
            among = self.information[np.ix_(others, others)] + np.diag(self.zeros[others])
            answer = linalg.solve(
                among, np.column_stack([self.information[others, k], self.total[others]]), assume_a="pos"
            )
            own -= float(self.information[k, others] @ answer[:, 0])
            right -= float(self.information[k, others] @ answer[:, 1])
        return (own, right / own) if own > NOTHING_SHARE * self.information[k, k] else (0.0, 0.0)


def _found(final: _Estimate, sought: Sequence[SoughtError], chosen: Array, zeros: Array) -> tuple[FoundError, ...]:
    """Describe every error: the chosen ones in the solution, others as if each were added to it."""
    system, critical, among = _System.of(final, zeros), _critical(len(sought)), np.flatnonzero(chosen)
    scales = np.sqrt(np.where(system.told, system.information.diagonal(), 1.0))
    alike = (np.abs(system.information / scales / scales[:, None]) > INSEPARABLE) & system.told
    noncentral = float(norm_isf(0.5 * chi2_sf(critical, 1)) + norm_ppf(POWER))
    found = []
    for k, each in enumerate(sought):
        known, plain = system.beside(k, among)
        tells = known > 0.0
        found.append(
            FoundError(
                sought=each,
                value=plain * known / (known + zeros[k]) if tells else 0.0,
                std=float(1.0 / np.sqrt(known + zeros[k])) if tells else np.inf,
                statistic=plain**2 * known,
                critical=critical,
                estimated=bool(chosen[k]),
                determined=bool(known * each.tolerance**2 > 1.0),
                observed_as_zero=bool(zeros[k] > 0.0),
                detectable=noncentral / float(np.sqrt(known)) if tells else np.inf,
                inseparable=tuple(j for j in np.flatnonzero(alike[k]).tolist() if j != k and system.told[k]),
            )
        )
    return tuple(found)


def _critical(count: int) -> float:
    """Give the limit of the tests of so many errors together (Šidák)."""
    return float(chi2_isf(1.0 - (1.0 - FAMILY_ALPHA) ** (1.0 / count), 1))


def _covariance(final: _Estimate, chosen: Array, zeros: Array) -> Matrix:
    """Give the covariance of the chosen errors, observations of zero included."""
    if not chosen.any():
        return np.zeros((0, 0))
    information = final.normals.information[np.ix_(chosen, chosen)] / final.joint.variance_factor
    return np.asarray(linalg.inv(information + np.diag(zeros[chosen])))
