"""One line for what a scan and its photos, or two photos, show several times.

What becomes of the information: one record is the base, and keeps all it is made of: planes, mounts, own errors. The
other one adds what it knows independently of the scan's points. A line of a photo is cut with a surface
which the same points measure that made the scan's planes, or the other photo's surface; by how much these errors are
common nobody can say. They move the line within its projecting plane only. So of a line of a photo tilt and offset
across the projecting plane are taken, H x₂ with H C_surface Hᵀ = 0, as observation of the base x₁:

    x = x₁ + K H (x₂ - x₁),   K = (C₁ - C₁₂) Hᵀ S⁻¹,   S = H (C₁ + C₂ - C₁₂ - C₂₁) Hᵀ

C includes the mounts' errors, C₁₂ is what both have from one mount (MATH 2.7). This is the end ω = 1 of split
covariance intersection (Julier, Uhlmann 2001), which divides the shared part of x₁ by ω and that of x₂ by 1 - ω: the
latter has no weight, no unknown correlation is left, and planes as (I - K H) G, mounts as (I - K H) M₁ + K H M₂ and the
private rest are exact, also towards all other lines that depend on them. Either record may be the base; the mean of
smaller standard deviation is kept. So the result is never worse than the better one of both.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int64
from scipy.linalg import block_diag

from algorithms.arrays import Array, Labels, Matrices4, Matrix6, Points
from algorithms.features.photo_lines.projected_edges import ProjectedEdges
from algorithms.features.photo_lines.projection_options import MergeOptions
from algorithms.features.photo_lines.same_lines import middles, near_pairs, rounding_covariances, without_shared
from algorithms.geometry.line_differences import line_differences, lines_moved
from algorithms.geometry.lines import Lines, LineSource, lines_from_arrays
from algorithms.probabilities import chi2_ppf

GON = np.pi / 200.0
PHOTOS_PER_LINE = 2
"""`Lines` can tell an adjustment of so many."""


@dataclass(frozen=True, eq=False)
class MergedLines:
    """n different lines of a station: those of the scan in their order, then those that only photos show."""

    lines: Lines
    """All of them, with photos and private covariances; the covariances contain everything."""
    plane_normals: Points
    """(n, 3) unit normals, towards the camera, of the surfaces that lines of photos lie in; zero for others."""
    kinds: Labels
    """(n,) `SpaceEdgeKind` of lines of photos, -1 for others."""
    merged_counts: Int64[Array, "q"]
    """(q,) lines of each photo that were another record of a line already there."""


@dataclass
class _Records:
    """The lines found so far. Arrays of n, changed in place."""

    lines: Lines
    by_planes: Array
    """(n, 4, 4) covariance that comes from planes."""
    by_surface: Array
    """(n, 4, 4) what comes from the surface that a photo's line was cut with."""
    own: Array
    """(n, 4, 4) the rest, without mounts: independent of all other records."""
    photos: Array
    """(n, 2)."""
    mounts: Array
    """(n, 4, 12)."""
    normals: Array
    kinds: Array

    def alone(self, k: int) -> "_Records":
        """Give one line by itself."""
        return _Records(self.lines[[k]], *(getattr(self, name)[[k]] for name in _COLUMNS))

    def put(self, k: int, other: "_Records") -> None:
        """Put the only line of another set in the place of line k."""
        for name in _OF_LINES:
            getattr(self.lines, name)[k] = getattr(other.lines, name)[0]
        for name in _COLUMNS:
            getattr(self, name)[k] = getattr(other, name)[0]

    @property
    def private(self) -> Array:
        """(n, 4, 4) what neither planes nor mounts explain."""
        return np.asarray(self.by_surface + self.own)

    def total(self, mounts: Float64[Array, "q 6 6"]) -> Array:
        """Give the covariances (n, 4, 4) with everything."""
        total = np.asarray(self.by_planes + self.private)
        for slot in range(PHOTOS_PER_LINE):
            seen = np.flatnonzero(self.photos[:, slot] >= 0)
            by_mount = self.mounts[seen, :, 6 * slot : 6 * slot + 6]
            total[seen] += by_mount @ mounts[self.photos[seen, slot]] @ np.swapaxes(by_mount, 1, 2)
        return total


_COLUMNS = ("by_planes", "by_surface", "own", "photos", "mounts", "normals", "kinds")
_OF_LINES = ("anchors", "directions", "bases", "covariances", "extents", "sources", "parents", "parent_jacobians")


def merge_lines(
    cloud: Lines, parts: Sequence[ProjectedEdges], mounts: Sequence[Matrix6], options: MergeOptions
) -> MergedLines:
    """Put together the lines of a scan and of its photos, each line once.

    Two records are the same line when their seen pieces overlap, their difference is small, and its four components
    fit their joint covariance, mounts included (chi-square with four degrees of freedom). Photo after photo, each line
    joins the record it fits best; lines of one photo are never joined with each other, and axes of cylinders, which lie
    inside of what photos show, with none.

    Parameters
    ----------
    cloud
        Lines of the scan.
    parts
        Lines of each photo.
    mounts
        (6, 6) covariance of each photo's mount: rotation vector on the left of the scan axes, translation.
    options
        What counts as the same line, and what becomes of it.
    """
    all_mounts = np.array(mounts, dtype=np.float64).reshape(-1, 6, 6)
    records = _of_cloud(cloud)
    counts = np.zeros(len(parts), dtype=np.int64)
    for number, part in enumerate(parts):
        new = _of_photo(part, number)
        partner = _partners(records, new, all_mounts, options)
        for k in np.flatnonzero(partner >= 0):
            first, second = records.alone(int(partner[k])), new.alone(int(k))
            records.put(int(partner[k]), _mean(first, second, all_mounts, options))
        counts[number] = np.count_nonzero(partner >= 0)
        records = _together(records, new, np.flatnonzero(partner < 0))
    return MergedLines(
        lines=replace(
            records.lines,
            covariances=records.total(all_mounts),
            photos=records.photos[:, 0].astype(np.int32),
            photo_jacobians=np.ascontiguousarray(records.mounts[:, :, :6]),
            second_photos=records.photos[:, 1].astype(np.int32),
            second_photo_jacobians=np.ascontiguousarray(records.mounts[:, :, 6:]),
            private_covariances=records.private,
        ),
        plane_normals=records.normals,
        kinds=records.kinds,
        merged_counts=counts,
    )


def _of_cloud(lines: Lines) -> _Records:
    n = len(lines)
    on_planes = np.all(lines.parents >= 0, axis=1).reshape(-1, 1, 1)
    return _Records(
        _copied(lines),
        by_planes=np.where(on_planes, lines.covariances, 0.0),
        by_surface=np.zeros((n, 4, 4)),
        own=np.where(on_planes, 0.0, lines.covariances),
        photos=np.full((n, PHOTOS_PER_LINE), -1, dtype=np.int64),
        mounts=np.zeros((n, 4, 6 * PHOTOS_PER_LINE)),
        normals=np.zeros((n, 3)),
        kinds=np.full(n, -1, dtype=np.int32),
    )


def _of_photo(part: ProjectedEdges, number: int) -> _Records:
    n = len(part)
    return _Records(
        _copied(part.lines),
        by_planes=np.zeros((n, 4, 4)),
        by_surface=part.surface_covariances.copy(),
        own=_positive(part.lines.covariances - part.surface_covariances),
        photos=np.column_stack([np.full(n, number), np.full(n, -1)]).astype(np.int64),
        mounts=np.concatenate([part.mount_jacobians, np.zeros((n, 4, 6))], axis=2),
        normals=part.plane_normals.copy(),
        kinds=part.kinds.copy(),
    )


def _positive(covariances: Matrices4) -> Matrices4:
    """Take away what rounding leaves below zero."""
    values, vectors = np.linalg.eigh(covariances)
    return np.asarray((vectors * np.maximum(values, 0.0)[:, None, :]) @ np.swapaxes(vectors, 1, 2))


def _copied(lines: Lines) -> Lines:
    """Copy lines, so that changes in place stay here; what is known of photos is kept apart."""
    return _lines(*(getattr(lines, name).copy() for name in _OF_LINES))


def _together(first: _Records, second: _Records, chosen: Array) -> _Records:
    """Append the chosen ones of the second set to the first."""

    def join(a: Array, b: Array) -> Array:
        return np.concatenate([a, b[chosen]])

    return _Records(
        _lines(*(join(getattr(first.lines, name), getattr(second.lines, name)) for name in _OF_LINES)),
        *(join(getattr(first, name), getattr(second, name)) for name in _COLUMNS),
    )


def _lines(*columns: Array) -> Lines:
    of = dict(zip(_OF_LINES, columns, strict=True))
    return lines_from_arrays(**of)


def _partners(
    records: _Records, new: _Records, mounts: Float64[Array, "q 6 6"], options: MergeOptions
) -> Int64[Array, "m"]:
    """Give for each new line the record of the same line that it fits best, -1 for none."""
    usable = np.flatnonzero(records.lines.sources != int(LineSource.CYLINDER_AXIS))
    reach = np.full(len(new.lines), options.max_distance_m)
    near = near_pairs(records.lines[usable], new.lines, options.max_angle_gon * GON, reach, options.min_overlap)
    i, j = usable[near.first], near.second
    of_first = records.total(mounts)[i]
    of_second = near.jacobians @ new.total(mounts)[j] @ np.swapaxes(near.jacobians, 1, 2)
    lengths = np.minimum(records.lines.lengths[i], new.lines.lengths[j])
    joint = of_first + of_second + rounding_covariances(lengths, near.places, options.rounding_std_m)
    solved = np.linalg.solve(joint, near.differences[:, :, None])[:, :, 0]
    statistics = np.einsum("ni,ni->n", near.differences, solved)
    same = np.flatnonzero(statistics <= float(chi2_ppf(1.0 - options.alpha, 4)))
    partner = np.full(len(new.lines), -1, dtype=np.int64)
    # the best fitting record is written last
    order = same[np.argsort(-statistics[same], kind="stable")]
    partner[j[order]] = i[order]
    return partner


def _mean(first: _Records, second: _Records, mounts: Float64[Array, "q 6 6"], options: MergeOptions) -> _Records:
    """Give the better one of both means, with the first or the second record as the base."""
    means = [_extended(first, second, mounts, options), _extended(second, first, mounts, options)]
    variances = [_mean_variance_m2(mean, mounts) for mean in means]
    return means[0] if variances[0] <= variances[1] else means[1]


def _mean_variance_m2(record: _Records, mounts: Float64[Array, "q 6 6"]) -> float:
    """Give the mean of the variances across the line at both ends of the seen piece."""
    c, s = record.total(mounts)[0], record.lines.extents[0]
    return float(np.trace(c[2:, 2:]) + 2.0 * s.mean() * np.trace(c[:2, 2:]) + np.square(s).mean() * np.trace(c[:2, :2]))


def _extended(base: _Records, other: _Records, mounts: Float64[Array, "q 6 6"], options: MergeOptions) -> _Records:
    """Give the base with what the other record adds that is independent of surfaces and planes.

    Where the two depend on more photos than a line may, the base stays as it is: what is left out is not counted twice.
    """
    numbers = [q for q in dict.fromkeys([*base.photos[0].tolist(), *other.photos[0].tolist()]) if q >= 0]
    if len(numbers) > PHOTOS_PER_LINE:
        return base
    difference, jacobian = line_differences(base.lines, other.lines)
    shared = (other.by_planes + other.by_surface)[0]
    select = without_shared(shared, 0.5 * float(other.lines.lengths[0])) @ np.linalg.inv(jacobian[0])
    place = np.einsum("ni,ni->n", middles(other.lines) - base.lines.anchors, base.lines.directions)
    length = np.minimum(base.lines.lengths, other.lines.lengths)
    rounding = rounding_covariances(length, place, options.rounding_std_m)[0]
    added = select @ (jacobian[0] @ other.own[0] @ jacobian[0].T + rounding) @ select.T
    by_base, by_other = _by_photos(base, numbers), select @ jacobian[0] @ _by_photos(other, numbers)
    common = block_diag(*mounts[numbers]) if numbers else np.zeros((0, 0))
    before, cross = base.total(mounts)[0], by_base @ common @ by_other.T
    joint = select @ before @ select.T + added + by_other @ common @ by_other.T - select @ cross - (select @ cross).T
    gain = np.linalg.solve(joint, (before @ select.T - cross).T).T
    keep = np.eye(4) - gain @ select
    own = keep @ base.own[0] @ keep.T + gain @ added @ gain.T
    moved = lines_moved(base.lines, (gain @ select @ difference[0])[None])
    lines = replace(
        moved, extents=_joint_extents(moved, other.lines), parent_jacobians=keep @ base.lines.parent_jacobians
    )
    by_mounts, photos = np.zeros((1, 4, 6 * PHOTOS_PER_LINE)), np.full((1, PHOTOS_PER_LINE), -1, dtype=np.int64)
    by_mounts[0, :, : 6 * len(numbers)] = keep @ by_base + gain @ by_other
    photos[0, : len(numbers)] = numbers
    return _Records(
        lines,
        by_planes=keep @ base.by_planes @ keep.T,
        by_surface=keep @ base.by_surface @ keep.T,
        own=0.5 * (own + own.T)[None],
        photos=photos,
        mounts=by_mounts,
        normals=base.normals,
        kinds=base.kinds,
    )


def _by_photos(record: _Records, numbers: Sequence[int]) -> Float64[Array, "4 columns"]:
    """Give the derivatives (4, 6 k) of a single line by the mounts of k photos."""
    by_mounts = np.zeros((4, 6 * len(numbers)))
    for slot, photo in enumerate(record.photos[0].tolist()):
        if photo >= 0:
            at = 6 * numbers.index(photo)
            by_mounts[:, at : at + 6] = record.mounts[0, :, 6 * slot : 6 * slot + 6]
    return by_mounts


def _joint_extents(line: Lines, other: Lines) -> Float64[Array, "1 2"]:
    """Give the piece of a single line that covers another's too."""
    ends = (np.concatenate(other.end_points) - line.anchors) @ line.directions[0]
    both = np.concatenate([line.extents[0], ends])
    return np.array([[both.min(), both.max()]])
