"""Mounts of cameras from edges that photos and scans of the same set-ups show: no targets are needed (MATH 2.10).

Lines where two planes of a scan meet are looked for among the edges of the photos; unknowns are rotation and projection
centre of each mount, in the axes of the camera. The errors of the planes are common to all lines of a plane, those by
rounded or broken edges to all photos of a line, so that many photos of few lines do not promise too much.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from scipy import linalg, optimize

from algorithms.arrays import Array, Flags, Matrix6, Scalars
from algorithms.calibration.edge_images import (
    EdgeGaps,
    EdgePairs,
    EdgePhoto,
    StationEdges,
    edge_gaps,
    line_noise,
    near_edges,
)
from algorithms.calibration.edge_options import EdgeCalibrationOptions
from algorithms.calibration.edge_search import OUTLIER, EdgeSearch, FoundPlace, is_best, largest_agreement
from algorithms.errors import InvalidInputError
from algorithms.probabilities import chi2_isf, ncx2_sf

GON = np.pi / 200.0
ALPHA = 0.001
"""Probability that a right mount is called wrong."""
FACTOR_ALPHA = 0.01
"""Of the test by which residuals are larger than stated."""
DETERMINED = 1.0 / 3.0
"""Standard deviation, as share of the reach, below which a parameter counts as determined."""
LEAST_PAIRS = 6
"""Fewer edges do not tell a mount from chance: three determine it unchecked."""
AMBIGUOUS = 0.8
"""Rivalry from which another place is as good."""
ROUNDS = 8
SETTLED_IN_STD = 0.01
"""Steps below this share of the standard deviations end the rounds, the pairs being the same."""
MOST_FACTOR = 9.0
"""Gaps larger than stated widen the limits of pairs up to this factor on their squares: beyond it all would fit."""
POWER = 0.8
"""Probability with which an error of the detectable size is found."""


DEFAULT_OPTIONS = EdgeCalibrationOptions()
PARAMETERS = (
    *("rotation about x (right)", "rotation about y (down)", "rotation about z (forward)"),
    *("shift along x (right)", "shift along y (down)", "shift along z (forward)"),
)
"""Names of a mount's parameters, in the axes of the camera."""


@dataclass(frozen=True, eq=False)
class FoundMount:
    """What edges tell of a mount."""

    error: Float64[Array, "6"]
    """(6,) correction m of the stated pose, T Δ(m): rotation vector, translation in the camera's axes [rad, m]."""
    covariance: Matrix6
    """(6, 6) of it; what is not determined has the variances of the reach."""
    determined: Flags
    """(6,) which parameters the edges know better than a third of what was looked for."""
    open_directions: Float64[Array, "k 6"]
    """(k, 6) unit combinations of parameters, in units of the reach, that are not determined."""
    axes: Float64[Array, "6 d"]
    """(6, d) unit combinations of parameters, in units of the reach, that are determined."""
    estimates: Float64[Array, "d"]
    """(d,) their values, by the edges alone."""
    variances: Float64[Array, "d"]
    """(d,) of these."""
    reach: Float64[Array, "6"]
    """(6,) how far was looked [rad, m]."""
    pair_counts: Int64[Array, "photos"]
    """(photos,) edges of each photo that show a line; zero for photos of other mounts."""
    candidate_count: int
    """Edges of its photos that could have been one."""
    rivalry: float
    """How well the best other rotation explains the edges: 0 as by chance, 1 as well as this one."""
    median_before_px: float
    """Median gap of these edges from their lines with the stated mount [px]."""
    median_after_px: float
    """The same with the corrected one [px]."""

    @property
    def ambiguous(self) -> bool:
        """Whether another place explains nearly as many edges."""
        return self.rivalry > AMBIGUOUS

    @property
    def degrees_of_freedom(self) -> int:
        """Count the combinations that are determined."""
        return len(self.estimates)

    @property
    def critical(self) -> float:
        """Give the limit of T; 0 where nothing is determined."""
        return float(chi2_isf(ALPHA, self.degrees_of_freedom)) if self.degrees_of_freedom else 0.0

    @property
    def statistic(self) -> float:
        """Give T of the hypothesis that the stated mount is right; chi-square."""
        return self.statistic_if(np.zeros((6, 6)))

    def statistic_if(self, stated: Matrix6) -> float:
        """Give T of the hypothesis that the stated mount has errors of a covariance (6, 6) and no others."""
        scaled = stated / np.outer(self.reach, self.reach)
        spread = np.diag(self.variances) + self.axes.T @ scaled @ self.axes
        return float(self.estimates @ np.linalg.solve(spread, self.estimates)) if len(self.estimates) else 0.0

    @property
    def wrong(self) -> bool:
        """Whether the stated mount is not the one that the edges show."""
        return self.statistic > self.critical and not self.ambiguous

    @property
    def detectable(self) -> Float64[Array, "6"]:
        """Give the sizes (6,) from which an error of one parameter alone is found with 80 %; infinite where none is."""
        found = np.full(6, np.inf)
        if self.degrees_of_freedom:
            alone = np.einsum("id,d,id->i", self.axes, 1.0 / self.variances, self.axes) / self.reach**2
            found[alone > 0.0] = np.sqrt(_noncentrality(self.degrees_of_freedom) / alone[alone > 0.0])
        return found

    @property
    def stds(self) -> Float64[Array, "6"]:
        """Give the standard deviations (6,) [rad, m]."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, eq=False)
class EdgeCalibration:
    """Mounts of all cameras."""

    mounts: tuple[FoundMount, ...]
    pairs: EdgePairs
    """Lines and edges that were used."""
    residuals: Float64[Array, "n 2"]
    """(n, 2) their gaps after the correction [px]."""
    variance_factor: float
    """How much larger squared gaps are than stated, at least 1; covariances contain it."""
    redundancy: int
    converged: bool


def mounts_from_edges(
    stations: Sequence[StationEdges],
    photos: Sequence[EdgePhoto],
    options: EdgeCalibrationOptions = DEFAULT_OPTIONS,
) -> EdgeCalibration:
    """Find the mounts with which the photos show the edges of the scans.

    Parameters
    ----------
    stations
        Scans.
    photos
        Of these stations; mounts count from 0.
    options
        How far stated mounts may be off.

    Raises
    ------
    InvalidInputError
        Without photos.
    """
    if not photos:
        raise InvalidInputError("photos", "there is none", "give photos that were taken from the stations")
    count = 1 + max(photo.mount for photo in photos)
    reach = np.array([options.max_rotation_gon * GON] * 3 + [options.max_translation_m] * 3)
    network = _Edges(tuple(stations), tuple(photos), tuple(line_noise(stations, options.rounding_std_m)), reach, count)
    candidates = network.candidates()
    errors = np.zeros((count, 6))
    places: list[FoundPlace | None] = [None] * count
    stated = edge_gaps(network.stations, network.photos, candidates, errors)
    alone = network.alone(candidates, stated)
    mounts, edges = network.mounts_of(candidates), network.edges_of(candidates)
    shown = network.shown_lines(candidates)
    for k in range(count):
        own = mounts == k
        if own.any():
            search = EdgeSearch(stated.values[own], stated.by_mount[own], alone[own], edges[own], shown[own], reach)
            places[k] = found = search.best()
            errors[k] = found.error
    return network.solved(candidates, errors, places)


@dataclass(frozen=True, eq=False)
class _System:
    """Normal equations of the mounts, everything else eliminated."""

    normal: Float64[Array, "u u"]
    right: Float64[Array, "u"]
    omega: float
    """Weighted squares of the gaps as they are."""
    whole: Float64[Array, "w w"]
    """Normal equations with the planes, which come after the mounts."""
    lines: tuple[tuple[Array, Array], ...]
    """Of each line, what it adds to them: derivatives (2 k, w) and gaps (2 k,) of its pairs, whitened."""


@dataclass(frozen=True, eq=False)
class _Edges:
    stations: tuple[StationEdges, ...]
    photos: tuple[EdgePhoto, ...]
    rounding: tuple[Array, ...]
    reach: Float64[Array, "6"]
    mounts: int

    def candidates(self) -> EdgePairs:
        """Collect all pairs within reach of the stated mounts."""
        parts = []
        for number, photo in enumerate(self.photos):
            edges = self.stations[photo.station]
            middles = photo.scan_from_camera.inv().apply(
                edges.lines.anchors + edges.lines.extents.mean(axis=1)[:, None] * edges.lines.directions
            )
            focal = max(photo.camera.fx, photo.camera.fy)
            # twice the turn about the axis: it moves the corners, whose distance is about the focal length
            turns = focal * np.sqrt(2.0) * float(self.reach[:3].max())
            shifts = focal * float(self.reach[3:].max()) / np.maximum(np.linalg.norm(middles, axis=1), 0.5)
            parts.append(near_edges(edges, photo, number, turns + shifts))
        return EdgePairs(*(
            np.concatenate([getattr(part, name) for part in parts]) for name in ("photos", "lines", "segments")
        ))  # fmt: skip

    def mounts_of(self, pairs: EdgePairs) -> Int64[Array, "n"]:
        """Say whose mount each pair tells of."""
        return np.asarray(np.array([photo.mount for photo in self.photos], dtype=np.int64)[pairs.photos])

    def edges_of(self, pairs: EdgePairs) -> Int64[Array, "n"]:
        """Give the numbers of the photos' edges, all photos together."""
        first = np.cumsum([0, *(len(photo.segments) for photo in self.photos)])
        return np.asarray(first[pairs.photos] + pairs.segments, dtype=np.int64)

    def shown_lines(self, pairs: EdgePairs) -> Int64[Array, "n"]:
        """Give the numbers of the lines as each photo shows them."""
        first = np.cumsum([0, *(len(self.stations[photo.station].lines) for photo in self.photos)])
        return np.asarray(first[pairs.photos] + pairs.lines, dtype=np.int64)

    def _by_line(self, pairs: EdgePairs, rows: Int64[Array, "n"]) -> list[Int64[Array, "k"]]:
        """Part rows of the pairs by the lines of the scans, whatever the photo."""
        first = np.cumsum([0, *(len(each.lines) for each in self.stations)])
        stations = np.array([photo.station for photo in self.photos], dtype=np.int64)[pairs.photos[rows]]
        numbers = first[stations] + pairs.lines[rows]
        order = np.argsort(numbers, kind="stable")
        starts = np.unique(numbers[order], return_index=True)[1]
        return np.split(rows[order], starts[1:]) if len(rows) else []

    def own_noise(self, pairs: EdgePairs) -> Float64[Array, "n 2 2"]:
        """Give the covariance of the photos' edges at their ends [px²]."""
        found = np.zeros((len(pairs), 2, 2))
        for number, photo in enumerate(self.photos):
            rows = pairs.photos == number
            found[rows] = photo.segments.end_covariances[pairs.segments[rows]]
        return found

    def _of_lines(self, pairs: EdgePairs) -> tuple[Array, Array, Array]:
        """Give covariances, planes and derivatives by planes of the pairs' lines: (n, 4, 4), (n, 2), (n, 4, 6)."""
        covariances, parents = np.zeros((len(pairs), 4, 4)), np.zeros((len(pairs), 2), dtype=np.int64)
        first = np.cumsum([0, *(len(each.plane_covariances) for each in self.stations)])
        jacobians = np.zeros((len(pairs), 4, 6))
        station = np.array([photo.station for photo in self.photos])[pairs.photos]
        for k, each in enumerate(self.stations):
            rows = np.flatnonzero(station == k)
            lines = each.lines[pairs.lines[rows]]
            covariances[rows] = lines.covariances + self.rounding[k][pairs.lines[rows]]
            parents[rows] = lines.parents + first[k]
            jacobians[rows] = lines.parent_jacobians
        return covariances, parents, jacobians

    def alone(self, pairs: EdgePairs, gaps: EdgeGaps) -> Float64[Array, "n 2 2"]:
        """Give the covariance of each pair's gaps by itself [px²]."""
        covariances = self._of_lines(pairs)[0]
        return np.asarray(self.own_noise(pairs) + gaps.by_line @ covariances @ np.swapaxes(gaps.by_line, 1, 2))

    def solved(self, candidates: EdgePairs, errors: Array, places: Sequence[FoundPlace | None]) -> EdgeCalibration:
        """Adjust all mounts to the pairs that fit, choosing these anew until nothing changes."""
        factor, converged, used = 1.0, False, np.zeros(len(candidates), dtype=bool)
        prior = np.diag(np.tile(self.reach**-2.0, self.mounts))
        information: Array | None = None
        for number in range(ROUNDS):
            gaps = edge_gaps(self.stations, self.photos, candidates, errors)
            chosen = self._fitting(candidates, gaps, factor, information)
            pairs, of_pairs = candidates[chosen], _some(gaps, chosen)
            system = self._system(pairs, of_pairs)
            information = system.normal / factor + prior
            step = np.linalg.solve(information, system.right / factor - prior @ errors.ravel())
            settled = np.abs(step * np.sqrt(np.diag(information))).max() < SETTLED_IN_STD
            same = bool((chosen == used).all())
            errors, used = errors + step.reshape(self.mounts, 6), chosen
            if number > 0 and settled and same:
                converged = True
                break
            redundancy = 2 * len(pairs) - 6 * self.mounts
            left = system.omega - float(step @ system.right)
            factor = _factor(left, redundancy)
        gaps = edge_gaps(self.stations, self.photos, candidates, errors)
        return self._described(candidates, used, errors, places, factor, gaps, converged)

    def _fitting(self, candidates: EdgePairs, gaps: EdgeGaps, factor: float, information: Array | None) -> Flags:
        """Choose pairs that fit by themselves, and of one line those that agree as well as the mounts are known.

        Before the mounts were adjusted this is what the pairs would tell if each had a line of its own.
        """
        weights = np.linalg.inv(self.alone(candidates, gaps))
        squares = np.einsum("ni,nij,nj->n", gaps.values, weights, gaps.values)
        limit = min(factor, MOST_FACTOR) * OUTLIER
        chosen = is_best(self.edges_of(candidates), squares) & (squares < limit)
        mounts = self.mounts_of(candidates)
        by_mounts = np.zeros((len(candidates), 2, self.mounts, 6))
        by_mounts[np.arange(len(candidates)), :, mounts] = gaps.by_mount
        designs = by_mounts.reshape(len(candidates), 2, 6 * self.mounts)
        if information is None:
            information = np.diag(np.tile(self.reach**-2.0, self.mounts)) + np.einsum(
                "nij,nik,nkl->jl", designs[chosen], weights[chosen], designs[chosen]
            )
        root = linalg.cho_factor(information)
        covariances, own = self._of_lines(candidates)[0], self.own_noise(candidates)
        for rows in self._by_line(candidates, np.flatnonzero(chosen)):
            if len(rows) == 1:
                continue
            by_line, design = gaps.by_line[rows].reshape(-1, 4), designs[rows].reshape(2 * len(rows), -1)
            joint = by_line @ covariances[rows[0]] @ by_line.T + design @ linalg.cho_solve(root, design.T)
            chosen[rows] = largest_agreement(gaps.values[rows], joint + linalg.block_diag(*own[rows]), limit)
        enough = np.bincount(mounts[chosen], minlength=self.mounts) >= LEAST_PAIRS
        return np.asarray(chosen & enough[mounts])

    def _system(self, pairs: EdgePairs, gaps: EdgeGaps) -> _System:
        """Whiten line by line, with the planes as unknowns that are observed, and eliminate these."""
        _, parents, by_planes = self._of_lines(pairs)
        station = np.array([photo.station for photo in self.photos])[pairs.photos]
        planes, places = np.unique(parents, return_inverse=True)
        places = places.reshape(-1, 2)
        roots = self._plane_roots(planes)
        mounts, own = self.mounts_of(pairs), self.own_noise(pairs)
        u, p = 6 * self.mounts, 3 * len(planes)
        normal, right, omega = np.zeros((u + p, u + p)), np.zeros(u + p), 0.0
        normal[u:, u:] = np.eye(p)
        lines = []
        for rows in self._by_line(pairs, np.arange(len(pairs))):
            k = len(rows)
            by_line = gaps.by_line[rows].reshape(2 * k, 4)
            rounding = self.rounding[station[rows[0]]][pairs.lines[rows[0]]]
            noise = linalg.block_diag(*own[rows]) + by_line @ rounding @ by_line.T
            whitening = linalg.cholesky(noise, lower=True)
            design = np.zeros((2 * k, u + p))
            for row, at in enumerate(rows):
                design[2 * row : 2 * row + 2, 6 * mounts[at] : 6 * mounts[at] + 6] = gaps.by_mount[at]
            through = by_line @ by_planes[rows[0]]
            for slot in range(2):
                place = places[rows[0], slot]
                design[:, u + 3 * place : u + 3 * place + 3] += through[:, 3 * slot : 3 * slot + 3] @ roots[place]
            solved = linalg.solve_triangular(
                whitening, np.column_stack([design, gaps.values[rows].ravel()]), lower=True
            )
            design, values = solved[:, :-1], solved[:, -1]
            normal += design.T @ design
            right -= design.T @ values
            omega += float(values @ values)
            lines.append((design, values))
        whole = normal.copy()
        if p == 0:
            return _System(normal, right, omega, whole, tuple(lines))
        factor = linalg.cho_factor(normal[u:, u:])
        eliminated = linalg.cho_solve(factor, np.column_stack([normal[u:, :u], right[u:]]))
        omega -= float(right[u:] @ eliminated[:, -1])
        return _System(
            normal[:u, :u] - normal[:u, u:] @ eliminated[:, :-1],
            right[:u] - normal[:u, u:] @ eliminated[:, -1],
            omega,
            whole,
            tuple(lines),
        )

    def _plane_roots(self, planes: Array) -> Float64[Array, "p 3 3"]:
        """Give square roots of the planes' covariances, which may be singular."""
        all_planes = np.concatenate([each.plane_covariances for each in self.stations])[planes]
        values, vectors = np.linalg.eigh(all_planes)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])

    def _described(
        self,
        candidates: EdgePairs,
        used: Flags,
        errors: Array,
        places: Sequence[FoundPlace | None],
        factor: float,
        gaps: EdgeGaps,
        converged: bool,
    ) -> EdgeCalibration:
        pairs, of_pairs = candidates[used], _some(gaps, used)
        system = self._system(pairs, of_pairs)
        prior = np.diag(np.tile(self.reach**-2.0, self.mounts))
        covariance = np.linalg.inv(system.normal / factor + prior)
        moved = _moved_by_single_lines(system, factor, prior)
        before = edge_gaps(self.stations, self.photos, pairs, np.zeros_like(errors)).values
        counts = np.bincount(pairs.photos, minlength=len(self.photos))
        all_edges, mounts = self.edges_of(candidates), self.mounts_of(candidates)
        found = []
        for k in range(self.mounts):
            own = slice(6 * k, 6 * k + 6)
            of_mount = self.mounts_of(pairs) == k
            found.append(
                _found(
                    errors[k], _with_most_moved(covariance[own, own], moved[:, own]), self.reach, places[k],
                    np.where([photo.mount == k for photo in self.photos], counts, 0),
                    len(np.unique(all_edges[mounts == k])), before[of_mount], of_pairs.values[of_mount],
                )
            )  # fmt: skip
        redundancy = max(2 * len(pairs) - 6 * self.mounts, 0)
        return EdgeCalibration(tuple(found), pairs, of_pairs.values, factor, redundancy, converged)


def _moved_by_single_lines(system: _System, factor: float, prior: Array) -> Float64[Array, "l u"]:
    """Give how far the mounts would move without each line in turn (external reliability, MATH 4)."""
    normal = system.whole / factor
    normal[: len(prior), : len(prior)] += prior
    root = linalg.cho_factor(normal)
    right = sum((design.T @ values for design, values in system.lines), np.zeros(len(normal)))
    solution = linalg.cho_solve(root, right / factor)
    moved = np.zeros((len(system.lines), len(prior)))
    for k, (design, values) in enumerate(system.lines):
        gain = linalg.cho_solve(root, design.T)
        own = np.eye(len(values)) - design @ gain / factor
        moved[k] = (gain @ np.linalg.lstsq(own, values - design @ solution, rcond=1e-9)[0])[: len(prior)] / factor
    return moved


def _with_most_moved(covariance: Matrix6, moved: Float64[Array, "l 6"]) -> Matrix6:
    """Add to a mount's covariance what the line of most influence moves it by.

    An edge that is not the line's, and lies no farther from it than rounded edges may, is not found by its gap where it
    has great weight. So a mount is never more certain than it would be moved by any single line.
    """
    if len(moved) == 0:
        return covariance
    influence = np.einsum("ki,ki->k", moved, np.linalg.solve(covariance, moved.T).T)
    most = moved[np.argmax(influence)]
    return np.asarray(covariance + np.outer(most, most))


def _factor(omega: float, redundancy: int) -> float:
    if redundancy <= 0 or omega <= chi2_isf(FACTOR_ALPHA, redundancy):
        return 1.0
    return omega / redundancy


def _noncentrality(degrees: int) -> float:
    """Give the noncentrality at which a chi-square test at `ALPHA` has the power `POWER`."""
    critical = chi2_isf(ALPHA, degrees)
    return float(optimize.brentq(lambda size: ncx2_sf(critical, degrees, size) - POWER, 1.0, 200.0))


def _some(gaps: EdgeGaps, which: Array) -> EdgeGaps:
    return EdgeGaps(gaps.values[which], gaps.by_mount[which], gaps.by_line[which])


def _found(
    error: Array, covariance: Array, reach: Scalars, place: FoundPlace | None, counts: Array, candidates: int,
    before: Array, after: Array,
) -> FoundMount:  # fmt: skip
    """Describe a mount; what its edges know hardly better than its reach is not determined."""
    shares = covariance / np.outer(reach, reach)
    values, vectors = np.linalg.eigh(shares)
    known = values < DETERMINED**2
    # that the mount is within reach is no evidence that it is right: this observation is taken off again
    freed = np.maximum(1.0 - values[known], 1e-12)
    return FoundMount(
        error=error,
        covariance=covariance,
        determined=np.sqrt(np.diag(shares)) < DETERMINED,
        open_directions=vectors[:, ~known].T,
        axes=vectors[:, known],
        estimates=vectors[:, known].T @ (error / reach) / freed,
        variances=values[known] / freed,
        reach=reach,
        pair_counts=counts.astype(np.int64),
        candidate_count=candidates,
        rivalry=0.0 if place is None else place.rivalry,
        median_before_px=float(np.median(np.abs(before))) if len(before) else float("nan"),
        median_after_px=float(np.median(np.abs(after))) if len(after) else float("nan"),
    )
