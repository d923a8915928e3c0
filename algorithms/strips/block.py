"""The equations of a block of strips: patches as planes, polynomials and waves in time (MATH 12.2, 12.4)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from scipy import linalg, sparse

from algorithms.arrays import Array, Matrices3, Matrix, Points, Scalars, Vector3
from algorithms.errors import InvalidInputError
from algorithms.strips.corrections import MOUNT, Correction, Degrees
from algorithms.strips.homologous import Ties
from algorithms.strips.options import CorrectionOptions
from algorithms.strips.strip import StripPath
from algorithms.strips.waves import PER_KNOT, Knots, knots_of

GON = np.pi / 200.0
MOST_UNKNOWNS = 4000
MEAN, FIRST, SECOND = np.array([1, 1, 1, 1]), np.array([-1, 1, 1, -1]), np.array([-1, -1, 1, 1])
COMBINED = np.stack([MEAN, FIRST, SECOND]) / 4.0
"""Of the distances of four anchors from a plane: their mean, and half their differences along both main axes."""
NARROW = np.tan(np.radians(20.0))
"""Half a narrow field of view: without a trajectory the width of a strip tells how high it was flown at most."""
AT_ONCE = 1 << 22
"""Numbers of a product that are in memory at once."""


@dataclass(frozen=True, eq=False)
class Control:
    """Known points of patches."""

    patches: Int64[Array, "m"]
    points_m: Float64[Array, "m 3"]
    std_m: Float64[Array, "m 3"]


@dataclass(frozen=True, eq=False)
class State:
    """Values of all unknowns."""

    coefficients: Float64[Array, "strips c"]
    """Of each strip, in the order of `Degrees.names` [m, rad]."""
    boresight_rad: Vector3
    mount: Float64[Array, "5"]
    """(5,) in the order of `MOUNT`, common to strips without trajectories [m, rad]."""
    waves: Float64[Array, "w"]
    """(w,) six of every knot, strip by strip [m, rad]."""
    planes: Float64[Array, "patches 3"]
    """(patches, 3) height along the normal, and tilts, of each global plane in the frame of its patch [m, 1]."""


@dataclass(frozen=True, eq=False)
class Equations:
    """Residuals and derivatives at a state."""

    residuals: Float64[Array, "k 3"]
    """(k, 3) of the ties: distance of the corrected patch from its plane, and half differences at the anchors [m]."""
    jacobian: sparse.csr_array
    """(3 k, u) by the unknowns of strips, bore-sight, mount and waves."""
    by_planes: Float64[Array, "k 3 3"]
    """(k, 3, 3) by each one's plane."""
    control: Float64[Array, "m"]
    """(m,) distance of control points from their planes [m]."""
    control_by_planes: Float64[Array, "m 3"]
    """(m, 3)."""
    control_std_m: Float64[Array, "m"]
    """(m,) along the normal [m]."""


@dataclass(frozen=True, eq=False)
class Reduced:
    """Normal equations with the planes eliminated."""

    normal: Float64[Array, "u u"]
    """(u, u) of the data alone."""
    right: Float64[Array, "u"]
    """Right side: −Jᵀ P r, planes eliminated."""
    jacobian: sparse.csr_array
    """(3 k, u) of the ties, planes following."""
    plane_inverses: Float64[Array, "patches 3 3"]
    """(patches, 3, 3) inverses of the planes' own normal matrices; zero without observations."""
    plane_shares: sparse.csr_array
    """(3 patches, u): planes move by minus this times the unknowns."""
    plane_right: Float64[Array, "patches 3"]
    """(patches, 3)."""


@dataclass(frozen=True, eq=False)
class Block:
    """Strips, patches and control, and how they hang together."""

    paths: Sequence[StripPath]
    degrees: Degrees
    references_m: Float64[Array, "patches 3"]
    """(patches, 3) kept fixed [m]."""
    frames: Float64[Array, "patches 3 3"]
    """(patches, 3, 3) columns e1, e2, normal."""
    ties: Ties
    control: Control
    with_boresight: bool
    with_mount: bool = False
    """Whether strips without trajectories have an error in common."""
    knots: Sequence[Knots] = ()
    """Of each strip; none: no waves."""

    @staticmethod
    def of(
        paths: Sequence[StripPath],
        references_m: Points,
        frames: Matrices3,
        ties: Ties,
        control: Control,
        options: CorrectionOptions,
    ) -> "Block":
        """Put a block together.

        Raises
        ------
        InvalidInputError
            Too many unknowns.
        """
        degrees = Degrees.of(options)
        if degrees.count * len(paths) > MOST_UNKNOWNS:
            raise InvalidInputError(
                "strips", f"{len(paths)} strips with {degrees.count} coefficients each are too many unknowns",
                f"at most {MOST_UNKNOWNS}: lower `shift_degree` or `tilt_degree`, or divide the block",
            )  # fmt: skip
        seen = [path.bodies is not None for path in paths]
        knots = knots_of([(path.first_s, path.last_s) for path in paths]) if options.waves else []
        return Block(
            paths, degrees, references_m, frames, ties, control, options.boresight and any(seen),
            options.boresight and not all(seen), tuple(knots),
        )  # fmt: skip

    @property
    def stated(self) -> int:
        """Number of coefficients and of turns of the bore-sight."""
        return self.degrees.count * len(self.paths) + 3 * self.with_boresight

    @property
    def before_waves(self) -> int:
        """Number of unknowns before those of waves."""
        return self.stated + len(MOUNT) * self.with_mount

    @property
    def wave_starts(self) -> Int64[Array, "n"]:
        """Number of the first unknown of the waves of each strip, and of all unknowns."""
        counts = [PER_KNOT * len(each) for each in self.knots] if self.knots else [0] * len(self.paths)
        return self.before_waves + np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)

    @property
    def count(self) -> int:
        """Number of unknowns but for the planes: coefficients, bore-sight, mount, waves."""
        return int(self.wave_starts[-1])

    def zero_state(self) -> State:
        """Give the state without any correction."""
        planes = np.zeros((len(self.references_m), 3))
        waves = np.zeros(self.count - self.before_waves)
        return State(
            np.zeros((len(self.paths), self.degrees.count)), np.zeros(3), np.zeros(len(MOUNT)), waves, planes
        )  # fmt: skip

    def correction(self, state: State, strip: int) -> Correction:
        """Give what corrects a strip."""
        first, last = self.wave_starts[strip : strip + 2] - self.before_waves
        knots = self.knots[strip] if self.knots else None
        waves = state.waves[first:last].reshape(-1, PER_KNOT) if self.knots else None
        return Correction(
            self.paths[strip], self.degrees, state.coefficients[strip], state.boresight_rad, state.mount, knots, waves
        )

    def vector(self, state: State) -> Float64[Array, "s"]:
        """Give the unknowns of strips, then the bore-sight, as one vector."""
        own = state.coefficients.ravel()
        return np.concatenate([own, state.boresight_rad]) if self.with_boresight else own

    def whole_vector(self, state: State) -> Float64[Array, "u"]:
        """Return all unknowns but for the planes as one vector."""
        mount = state.mount if self.with_mount else np.zeros(0)
        return np.concatenate([self.vector(state), mount, state.waves])

    def moved(self, state: State, step: Float64[Array, "u"], planes: Points) -> State:
        """Add a step."""
        own, stated, before = self.degrees.count * len(self.paths), self.stated, self.before_waves
        return State(
            state.coefficients + step[:own].reshape(-1, self.degrees.count),
            state.boresight_rad + step[own:stated] if self.with_boresight else state.boresight_rad,
            state.mount + step[stated:before] if self.with_mount else state.mount,
            state.waves + step[before:],
            state.planes + planes,
        )

    def columns_of(self, strip: int) -> Int64[Array, "c"]:
        """Return the numbers of the unknowns that move a strip, in the order of `design`."""
        own, starts = self.degrees.count, self.wave_starts
        return np.concatenate(
            [
                np.arange(strip * own, (strip + 1) * own),
                np.arange(len(self.paths) * own, self.before_waves),
                np.arange(starts[strip], starts[strip + 1]),
            ]
        )

    def design(self, state: State, strip: int, points: Points, times_s: Scalars) -> Float64[Array, "n 3 c"]:
        """Return how points of a strip move along the axes with the unknowns of `columns_of`."""
        correction, parts = self.correction(state, strip), []
        for axis in np.eye(3):
            fields, turns = correction.fields(points, times_s, np.tile(axis, (len(points), 1)))
            rows = [correction.by_coefficients(fields, times_s)]
            rows += [turns] * self.with_boresight + [correction.by_mount(fields)] * self.with_mount
            if self.knots:
                numbers, values = self.knots[strip].spread(fields, times_s)
                dense = np.zeros((len(points), PER_KNOT * len(self.knots[strip])))
                np.add.at(dense, (np.arange(len(points))[:, None], numbers), values)
                rows.append(dense)
            parts.append(np.hstack(rows))
        return np.stack(parts, axis=1)

    def mount_stds(self, options: CorrectionOptions) -> Float64[Array, "n"]:
        """Return standard deviations of the mount: turns as the bore-sight, shifts by what these move the ground."""
        if not self.with_mount:
            return np.zeros(0)
        turn = options.boresight_std_gon * GON
        height = max(path.reach_m for path in self.paths) / NARROW
        return np.array([height * turn] * 2 + [turn] * 3)

    def zero_stds(self, options: CorrectionOptions) -> Float64[Array, "s"]:
        """Give the standard deviations of the observations of zero."""
        own = []
        for name, power in self.degrees.names():
            if name.startswith("shift"):
                own.append(options.shift_std_m if power == 0 else options.drift_std_m)
            else:
                own.append(GON * (options.tilt_std_gon if power == 0 else options.tilt_drift_std_gon))
        every = own * len(self.paths) + ([options.boresight_std_gon * GON] * 3 if self.with_boresight else [])
        return np.array(every)

    def local(self, patches: Array, points: Points) -> Points:
        """Give coordinates (n, 3) of points in the frames of their patches."""
        return np.asarray(np.einsum("nij,ni->nj", self.frames[patches], points - self.references_m[patches]))

    def equations(self, state: State) -> Equations:
        """Linearise at a state."""
        ties, c = self.ties, self.degrees.count
        k = len(ties)
        distances, by_planes = np.empty((k, 4)), np.empty((k, 4, 3))
        own, shared = np.zeros((k, 4, c)), np.zeros((k, 4, self.before_waves - len(self.paths) * c))
        waves = np.zeros((k, 3, 2 * PER_KNOT * bool(self.knots)))
        wave_columns = np.zeros((k, waves.shape[2]), dtype=np.int64)
        for strip in np.unique(ties.strips).tolist():
            rows = np.flatnonzero(ties.strips == strip)
            correction = self.correction(state, strip)
            points, times = ties.anchors_m[rows].reshape(-1, 3), ties.times_s[rows].ravel()
            patches = np.repeat(ties.patches[rows], 4)
            distance, normal, planes = self._distances(state, patches, correction.applied(points, times))
            fields, turns = correction.fields(points, times, normal)
            distances[rows], by_planes[rows] = distance.reshape(-1, 4), planes.reshape(-1, 4, 3)
            own[rows] = correction.by_coefficients(fields, times).reshape(-1, 4, c)
            common = [turns] * self.with_boresight + [correction.by_mount(fields)] * self.with_mount
            if common:
                shared[rows] = np.hstack(common).reshape(-1, 4, shared.shape[2])
            if self.knots:
                # a patch is seen within a fraction of the time between knots
                middles = np.repeat(ties.times_s[rows].mean(axis=1), 3)
                combined = (COMBINED @ fields.reshape(-1, 4, PER_KNOT)).reshape(-1, PER_KNOT)
                numbers, values = self.knots[strip].spread(combined, middles)
                waves[rows] = values.reshape(-1, 3, 2 * PER_KNOT)
                wave_columns[rows] = self.wave_starts[strip] + numbers[::3]
        common_columns = np.broadcast_to(len(self.paths) * c + np.arange(shared.shape[2]), (k, shared.shape[2]))
        columns = np.hstack([(ties.strips * c)[:, None] + np.arange(c), common_columns, wave_columns])
        values = np.concatenate([COMBINED @ own, COMBINED @ shared, waves], axis=2)
        width = columns.shape[1]
        jacobian = sparse.csr_array(
            (values.ravel(), np.repeat(columns, 3, axis=0).ravel(), np.arange(3 * k + 1) * width),
            shape=(3 * k, self.count),
        )
        known = self.control
        missed, normal, planes = self._distances(state, known.patches, known.points_m)
        std = np.sqrt(((normal * known.std_m) ** 2).sum(axis=1))
        return Equations(distances @ COMBINED.T, jacobian, COMBINED @ by_planes, missed, planes, std)

    def _distances(self, state: State, patches: Array, points: Points) -> tuple[Scalars, Points, Points]:
        """Give distances of points from the planes, their derivatives by the points, and those by the planes."""
        u, v, w = self.local(patches, points).T
        height, tilt_u, tilt_v = state.planes[patches].T
        e1, e2, n = np.moveaxis(self.frames[patches], 2, 0)
        normal = n - tilt_u[:, None] * e1 - tilt_v[:, None] * e2
        by_planes = -np.column_stack([np.ones_like(u), u, v])
        return w - height - tilt_u * u - tilt_v * v, normal, by_planes

    def reduced(self, at: Equations, weights: Array, control_weights: Array) -> Reduced:
        """Form normal equations and eliminate the planes; weights (k,) of ties and (m,) of control points."""
        patches, k, count = self.ties.patches, len(self.ties), len(self.references_m)
        own = np.zeros((count, 3, 3))
        np.add.at(own, patches, weights[:, None, None] * np.swapaxes(at.by_planes, 1, 2) @ at.by_planes)
        known = at.control_by_planes
        np.add.at(own, self.control.patches, control_weights[:, None, None] * known[:, :, None] * known[:, None, :])
        right = np.zeros((count, 3))
        np.add.at(right, patches, -weights[:, None] * np.einsum("kij,ki->kj", at.by_planes, at.residuals))
        np.add.at(right, self.control.patches, -(control_weights * at.control)[:, None] * known)
        inverses = np.zeros_like(own)
        alive = np.flatnonzero(own[:, 0, 0] > 0.0)
        # a single control point tells nothing of tilts: they stay where the strips say, or as they are
        own[alive] += np.eye(3) * 1e-12 * own[alive][:, :1, :1]
        inverses[alive] = np.linalg.inv(own[alive])
        rows = np.repeat(np.arange(3 * k).reshape(k, 3), 3, axis=0).reshape(k, 3, 3)
        columns = (3 * patches[:, None] + np.arange(3))[:, :, None]
        spread = sparse.csr_array(
            (np.swapaxes(at.by_planes, 1, 2).ravel(), (np.broadcast_to(columns, (k, 3, 3)).ravel(), rows.ravel())),
            shape=(3 * count, 3 * k),
        )
        weighted = sparse.diags_array(np.repeat(weights, 3)) @ at.jacobian
        mixed = sparse.csr_array(spread @ weighted)
        blocks = sparse.bsr_array((inverses, np.arange(count), np.arange(count + 1)), shape=(3 * count, 3 * count))
        shares = sparse.csr_array(blocks @ mixed)
        following = sparse.csr_array(at.jacobian - spread.T @ shares)
        normal = (at.jacobian.T @ weighted - mixed.T @ shares).toarray()
        total = -(weighted.T @ at.residuals.ravel()) - shares.T @ right.ravel()
        return Reduced(0.5 * (normal + normal.T), np.asarray(total), following, inverses, shares, right)

    def plane_step(self, reduced: Reduced, step: Float64[Array, "u"]) -> Points:
        """Give the steps of the planes (patches, 3) that belong to a step of the other unknowns."""
        own = np.einsum("pij,pj->pi", reduced.plane_inverses, reduced.plane_right)
        return np.asarray(own - (reduced.plane_shares @ step).reshape(-1, 3))

    def cofactors_of_ties(self, at: Equations, reduced: Reduced, cofactors: Matrix) -> Matrices3:
        """Give J Q Jᵀ of each tie (k, 3, 3), planes included."""
        k = len(self.ties)
        out = at.by_planes @ reduced.plane_inverses[self.ties.patches] @ np.swapaxes(at.by_planes, 1, 2)
        step = max(1, AT_ONCE // (3 * max(self.count, 1)))
        for start in range(0, k, step):
            rows = reduced.jacobian[3 * start : 3 * min(start + step, k)]
            part = rows.toarray().reshape(-1, 3, self.count)
            out[start : start + step] += (rows @ cofactors).reshape(part.shape) @ np.swapaxes(part, 1, 2)
        return np.asarray(out)


def positive_solution(normal: Matrix, right: Array) -> Array:
    """Solve symmetric positive definite equations, scaled to a unit diagonal."""
    scale = 1.0 / np.sqrt(np.diag(normal))
    scaled = linalg.cho_factor(normal * scale * scale[:, None], lower=True)
    solved = linalg.cho_solve(scaled, right * (scale if right.ndim == 1 else scale[:, None]))
    return np.asarray(solved * (scale if right.ndim == 1 else scale[:, None]))
