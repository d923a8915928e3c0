"""What tracks tell of instruments once the poses are free: the reduced normal equations (MATH 6.8)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from scipy import linalg, sparse

from algorithms.adjustment.inverse import EnlargedInverse, Inverse
from algorithms.adjustment.unknowns import UnknownKind, Unknowns
from algorithms.arrays import Array, Scalars
from algorithms.network.instrument_responses import ALL_ERRORS, responses_of, scale_responses_by
from algorithms.network.joint_adjustment import JointAdjustment
from algorithms.network.track_observations import Track, TrackGroup, TrackLayout
from algorithms.network.tracks import StationFeatures
from algorithms.scans.instrument_errors import InstrumentError

SCALE = ALL_ERRORS.index(InstrumentError.RANGE_SCALE)


@dataclass(frozen=True, eq=False)
class InstrumentNormals:
    """Normal equations of c errors at a solution, the poses eliminated; covariances as stated, variance factor 1."""

    information: Float64[Array, "c c"]
    """(c, c) S = GᵀPG - GᵀPJ N⁻¹ JᵀPG."""
    gradient: Float64[Array, "c"]
    """(c,) S⁻¹ times it is the step to the least squares solution."""
    alone: Float64[Array, "c"]
    """(c,) diagonal of GᵀPG: what would be known of each error if the poses were known."""
    by_error: Float64[Array, "u c"]
    """(u, c) how the poses answer to a unit of each error, -N⁻¹ JᵀPG."""

    def pose_cofactors(self, inverse: Inverse, chosen: Array, covariance: Array) -> Inverse:
        """Enlarge the cofactors of the poses by what the chosen errors, with a covariance, do to them."""
        return EnlargedInverse(inverse, self.by_error[:, chosen], covariance)


def instrument_normals(
    features: Mapping[int, StationFeatures], joint: JointAdjustment, columns: Int64[Array, "stations 11"], count: int
) -> InstrumentNormals:
    """Derive all contradictions of an adjustment by the errors of its instruments, and eliminate the poses.

    dr = J dx + G dp, G = -B R with B the derivatives of contradictions by a feature's parameters and R those of the
    parameters by the errors. O(u³) once, as the adjustment itself.

    Parameters
    ----------
    features
        That were adjusted.
    joint
        The adjustment; it has no mounts of photos.
    columns
        (stations, 11) number of the error that stands for each of `ALL_ERRORS` at each station, in the order of
        `joint.stations`; -1 where there is none.
    count
        c, how many errors there are.
    """
    unknowns = joint.solution.unknowns
    layout = TrackLayout(features, joint.stations, joint.tracks)
    jacobians, residuals = [], []
    for group in layout.grouped(joint.tracks):
        tracks = [joint.tracks[k] for k in group.numbers]
        whitened, by_all = _whitened(features, tracks, group, columns, unknowns, count)
        residuals.append(whitened)
        jacobians.append(by_all)
    jacobian = sparse.vstack(jacobians, format="csr")
    residual = np.concatenate(residuals)
    u = unknowns.count
    product = (jacobian.T @ jacobian).toarray()
    right = jacobian.T @ residual
    poses, crossed, alone = product[:u, :u], product[:u, u:], product[u:, u:]
    scales = 1.0 / np.sqrt(np.diag(poses))
    factor = linalg.cho_factor(scales[:, None] * poses * scales)

    def solved(vectors: Array) -> Array:
        scaled = scales[:, None] * vectors
        return np.asarray(scales[:, None] * linalg.cho_solve(factor, scaled))

    answers = solved(crossed)
    information = alone - crossed.T @ answers
    gradient = -(right[u:] - crossed.T @ solved(right[:u, None])[:, 0])
    return InstrumentNormals(0.5 * (information + information.T), gradient, np.diag(alone).copy(), -answers)


def _whitened(
    features: Mapping[int, StationFeatures],
    tracks: Sequence[Track],
    group: TrackGroup,
    columns: Int64[Array, "stations 11"],
    unknowns: Unknowns,
    count: int,
) -> tuple[Scalars, sparse.csr_array]:
    """Give the whitened contradictions of a group and their derivatives (rows, u + c) by poses and errors."""
    observations = group.observations
    kind = tracks[0].kind
    answers = {station: responses_of(features[station], kind) for station in {s for t in tracks for s, _ in t.members}}
    equations = observations.equations(unknowns)
    n, d = equations.residuals.shape
    own = np.zeros((n, d, d))
    for by_error, covariances in zip(equations.noise_jacobians, observations.covariances, strict=True):
        own += by_error @ covariances @ np.swapaxes(by_error, 1, 2)
    whitening = np.linalg.inv(np.linalg.cholesky(own))
    rows = np.arange(n * d).reshape(n, d)
    parts: list[tuple[Array, Array, Array]] = []
    for derivative in equations.derivatives:
        first = unknowns.first_columns(UnknownKind.POSE, derivative.numbers)
        free = first >= 0
        parts.append((rows[free], first[free, None] + np.arange(6), (whitening @ derivative.jacobians)[free]))
    contradictions = np.einsum("nji,njk,nk->ni", whitening, whitening, equations.residuals)
    for member, by_feature in enumerate(equations.noise_jacobians):
        seen = [track.members[member] for track in tracks]
        answer = np.stack([answers[station][number] for station, number in seen])
        # a scale shrinks the contradictions with all else: of arms as measured, noise alone would tell that it is -1
        corrections = -np.einsum("nij,nkj,nk->ni", observations.covariances[member], by_feature, contradictions)
        answer[:, :, SCALE] += scale_responses_by(features, kind, seen, corrections)
        own_columns = columns[observations.stations[:, member]]
        by_errors = np.where(own_columns[:, None, :] >= 0, -(whitening @ by_feature @ answer), 0.0)
        parts.append((rows, unknowns.count + np.maximum(own_columns, 0), by_errors))
    entries = [
        (
            np.broadcast_to(at[:, :, None], values.shape).ravel(),
            np.broadcast_to(places[:, None, :], values.shape).ravel(),
            values.ravel(),
        )
        for at, places, values in parts
    ]
    at, places, values = (np.concatenate(column) for column in zip(*entries, strict=True))
    shape = (n * d, unknowns.count + count)
    jacobian = sparse.csr_array(sparse.coo_array((values, (at, places)), shape=shape))
    return np.einsum("nij,nj->ni", whitening, equations.residuals).ravel(), jacobian


def columns_of(stations: Sequence[int], shared: Sequence[tuple[str, Sequence[int]]]) -> Int64[Array, "stations 11"]:
    """Give (stations, 11) which of the given errors stands for each of `ALL_ERRORS` at each station, -1 for none.

    Parameters
    ----------
    stations
        In the order of their poses.
    shared
        Name of each error, and the stations that have it in common.
    """
    place = {station: k for k, station in enumerate(stations)}
    names = [str(error) for error in ALL_ERRORS]
    columns = np.full((len(stations), len(names)), -1, dtype=np.int64)
    for number, (name, members) in enumerate(shared):
        for station in members:
            if station in place:
                columns[place[station], names.index(str(name))] = number
    return columns
