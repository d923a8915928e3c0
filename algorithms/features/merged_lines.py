"""One line for what a scan and its photos, or two photos, show several times.

Which record survives, and what becomes of the information:

* `best` (works with one photo for each line, and with lines that depend on planes and nothing else): a line of the scan
  survives as it is, with its planes; of two lines of photos the one of smaller standard deviation survives as it is.
  What the other one knows is not used for the line. Nothing is counted twice, and every correlation stays exact.
* `weighted`: the survivor is the weighted mean x = W₁ x₁ + W₂ x₂ with the weights P of the private covariances,
  Wₖ = (P₁ + P₂)⁻¹ Pₖ. Everything that the two depend on is carried through the weights: planes as W₁ G, mounts as
  W₁ M₁ and W₂ M₂. The rest, W₂ C₂ W₂ᵀ for a line of a photo, is private: what uses these lines must add to the
  covariance through planes and mounts the private rest `MergedLines.private_covariances`.

Either way the difference x₂ - x₁ is kept: it speaks of the mount alone, M₂ m₂ - M₁ m₁ plus private errors, and with the
weights above it is uncorrelated with the weighted mean, so nothing is lost where both are used.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int64
from scipy.stats import chi2

from algorithms.arrays import Array, Labels, Matrices4, Matrix6, Points, Scalars
from algorithms.features.projected_edges import ProjectedEdges
from algorithms.features.projection_options import MergeOptions
from algorithms.geometry.line_differences import line_differences, lines_moved, lines_overlap
from algorithms.geometry.lines import Lines, lines_from_arrays


@dataclass(frozen=True, eq=False)
class MountContradictions:
    """k differences between records of the same line: what a station tells of its cameras' mounts by itself."""

    differences: Float64[Array, "k 4"]
    """(k, 4) second minus first line, in the first one's (a1, a2, b1, b2) [rad, m]."""
    covariances: Float64[Array, "k 4 4"]
    """(k, 4, 4) of the differences, without the mounts' part."""
    photos: Int64[Array, "k 2"]
    """(k, 2) photo of the first and of the second line, -1 for lines of the scan."""
    jacobians: Float64[Array, "k 4 12"]
    """(k, 4, 12) of the differences by the mount errors of these two photos."""


@dataclass(frozen=True, eq=False)
class MergedLines:
    """n different lines of a station: those of the scan in their order, then those that only photos show."""

    lines: Lines
    """All of them; the covariances contain everything. `photos` is the first of up to two photos."""
    private_covariances: Matrices4
    """(n, 4, 4) what neither planes (`parents`) nor mounts explain of the covariances."""
    second_photos: Labels
    """(n,) the second photo that a weighted mean depends on, -1 for none."""
    second_photo_jacobians: Float64[Array, "n 4 6"]
    """(n, 4, 6) derivatives by the error of that photo's mount."""
    plane_normals: Points
    """(n, 3) unit normals, towards the camera, of the surfaces that lines of photos lie in; zero for others."""
    kinds: Labels
    """(n,) `SpaceEdgeKind` of lines of photos, -1 for others."""
    merged_counts: Int64[Array, "q"]
    """(q,) lines of each photo that were another record of a line already there."""
    contradictions: MountContradictions


@dataclass
class _Records:
    """The lines found so far. Arrays of n, changed in place."""

    lines: Lines
    by_planes: Array
    """(n, 4, 4) covariance that comes from planes."""
    private: Array
    """(n, 4, 4) the rest, without mounts."""
    photos: Array
    """(n, 2)."""
    mounts: Array
    """(n, 4, 12)."""
    normals: Array
    kinds: Array

    def alone(self, k: int) -> "_Records":
        """Give one line by itself."""
        one = [k]
        return _Records(
            self.lines[one],
            *(a[one] for a in (self.by_planes, self.private, self.photos, self.mounts, self.normals, self.kinds)),
        )

    def put(self, k: int, other: "_Records") -> None:
        """Put the only line of another set in the place of line k."""
        for name in ("anchors", "directions", "bases", "covariances", "extents", "sources", "parents"):
            getattr(self.lines, name)[k] = getattr(other.lines, name)[0]
        self.lines.parent_jacobians[k] = other.lines.parent_jacobians[0]
        for name in ("by_planes", "private", "photos", "mounts", "normals", "kinds"):
            getattr(self, name)[k] = getattr(other, name)[0]

    def mount_covariances(self, mounts: Float64[Array, "q 6 6"]) -> Array:
        """Give the covariances (n, 4, 4) that come from the mounts."""
        total = np.zeros_like(self.private)
        for slot in range(2):
            seen = np.flatnonzero(self.photos[:, slot] >= 0)
            by_mount = self.mounts[seen, :, 6 * slot : 6 * slot + 6]
            total[seen] += by_mount @ mounts[self.photos[seen, slot]] @ np.swapaxes(by_mount, 1, 2)
        return total


def merge_lines(
    cloud: Lines, parts: Sequence[ProjectedEdges], mounts: Sequence[Matrix6], options: MergeOptions
) -> MergedLines:
    """Put together the lines of a scan and of its photos, each line once.

    Two records are the same line when their seen pieces overlap, their difference is small, and its four components
    fit their joint covariance, mounts included (chi-square with four degrees of freedom). Photo after photo, each line
    joins the record it fits best; lines of one photo are never joined with each other.

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
    notes: list[tuple[Array, Array, Array, Array]] = []
    for number, part in enumerate(parts):
        new = _of_photo(part, number)
        partner = _partners(records, new, all_mounts, options)
        for k in np.flatnonzero(partner >= 0):
            first, second = records.alone(int(partner[k])), new.alone(int(k))
            if first.photos[0, 1] < 0:  # a mean of two photos already would depend on three mounts
                notes.append(_contradiction(first, second))
            if options.combination == "weighted":
                records.put(int(partner[k]), _weighted_mean(first, second))
            else:
                records.put(int(partner[k]), _better(first, second, all_mounts))
        counts[number] = np.count_nonzero(partner >= 0)
        records = _together(records, new, np.flatnonzero(partner < 0))
    covariances = records.by_planes + records.private + records.mount_covariances(all_mounts)
    return MergedLines(
        lines=replace(
            records.lines,
            covariances=covariances,
            photos=records.photos[:, 0].astype(np.int32),
            photo_jacobians=np.ascontiguousarray(records.mounts[:, :, :6]),
        ),
        private_covariances=records.private,
        second_photos=records.photos[:, 1].astype(np.int32),
        second_photo_jacobians=np.ascontiguousarray(records.mounts[:, :, 6:]),
        plane_normals=records.normals,
        kinds=records.kinds,
        merged_counts=counts,
        contradictions=_noted(notes),
    )


def _of_cloud(lines: Lines) -> _Records:
    n = len(lines)
    on_planes = np.all(lines.parents >= 0, axis=1).reshape(-1, 1, 1)
    return _Records(
        _copied(lines),
        by_planes=np.where(on_planes, lines.covariances, 0.0),
        private=np.where(on_planes, 0.0, lines.covariances),
        photos=np.full((n, 2), -1, dtype=np.int64),
        mounts=np.zeros((n, 4, 12)),
        normals=np.zeros((n, 3)),
        kinds=np.full(n, -1, dtype=np.int32),
    )


def _of_photo(part: ProjectedEdges, number: int) -> _Records:
    n = len(part)
    return _Records(
        _copied(part.lines),
        by_planes=np.zeros((n, 4, 4)),
        private=part.lines.covariances.copy(),
        photos=np.column_stack([np.full(n, number), np.full(n, -1)]).astype(np.int64),
        mounts=np.concatenate([part.mount_jacobians, np.zeros((n, 4, 6))], axis=2),
        normals=part.plane_normals.copy(),
        kinds=part.kinds.copy(),
    )


def _copied(lines: Lines) -> Lines:
    """Copy lines, so that changes in place stay here; what is known of photos is kept apart."""
    return lines_from_arrays(
        lines.anchors.copy(),
        lines.directions.copy(),
        lines.covariances.copy(),
        lines.extents.copy(),
        bases=lines.bases.copy(),
        sources=lines.sources.copy(),
        parents=lines.parents.copy(),
        parent_jacobians=lines.parent_jacobians.copy(),
    )


def _together(first: _Records, second: _Records, chosen: Array) -> _Records:
    """Append the chosen ones of the second set to the first."""

    def join(a: Array, b: Array) -> Array:
        return np.concatenate([a, b[chosen]])

    a, b = first.lines, second.lines
    lines = lines_from_arrays(
        join(a.anchors, b.anchors),
        join(a.directions, b.directions),
        join(a.covariances, b.covariances),
        join(a.extents, b.extents),
        bases=join(a.bases, b.bases),
        sources=join(a.sources, b.sources),
        parents=join(a.parents, b.parents),
        parent_jacobians=join(a.parent_jacobians, b.parent_jacobians),
    )
    names = ("by_planes", "private", "photos", "mounts", "normals", "kinds")
    return _Records(lines, *(join(getattr(first, name), getattr(second, name)) for name in names))


def _partners(
    records: _Records, new: _Records, mounts: Float64[Array, "q 6 6"], options: MergeOptions
) -> Int64[Array, "m"]:
    """Give for each new line the record of the same line that it fits best, -1 for none."""
    cosines = np.abs(new.lines.directions @ records.lines.directions.T)
    j, i = np.nonzero(cosines > np.cos(options.max_angle_gon * np.pi / 200.0))
    first, second = records.lines[i], new.lines[j]
    differences, jacobians = line_differences(first, second)
    middles = np.einsum("ni,ni->n", _middles(second) - first.anchors, first.directions)
    apart = np.linalg.norm(differences[:, 2:] + middles[:, None] * differences[:, :2], axis=1)
    near = np.flatnonzero((apart <= options.max_distance_m) & lines_overlap(first, second, options.min_overlap))
    i, j, differences, jacobians, middles = i[near], j[near], differences[near], jacobians[near], middles[near]
    of_first = (records.by_planes + records.private + records.mount_covariances(mounts))[i]
    of_second = jacobians @ (new.private + new.mount_covariances(mounts))[j] @ np.swapaxes(jacobians, 1, 2)
    lengths = np.minimum(records.lines.lengths[i], new.lines.lengths[j])
    joint = of_first + of_second + _rounding(lengths, middles, options.rounding_std_m)
    statistics = np.einsum("ni,ni->n", differences, np.linalg.solve(joint, differences[:, :, None])[:, :, 0])
    same = np.flatnonzero(statistics <= float(chi2.ppf(1.0 - options.alpha, 4)))
    partner = np.full(len(new.lines), -1, dtype=np.int64)
    # the best fitting record is written last
    order = same[np.argsort(-statistics[same], kind="stable")]
    partner[j[order]] = i[order]
    return partner


def _middles(lines: Lines) -> Points:
    return np.asarray(lines.anchors + lines.extents.mean(axis=1)[:, None] * lines.directions)


def _rounding(lengths: Scalars, places: Scalars, std_m: float) -> Matrices4:
    """Give the covariance of what rounded edges and uneven surfaces add to differences, at places along the lines."""
    covariances = np.zeros((len(lengths), 4, 4))
    tilt = (2.0 * std_m / np.maximum(lengths, 1e-3)) ** 2
    for axis in range(2):
        covariances[:, axis, axis] = tilt
        covariances[:, axis, 2 + axis] = covariances[:, 2 + axis, axis] = -places * tilt
        covariances[:, 2 + axis, 2 + axis] = std_m**2 + places**2 * tilt
    return covariances


def _contradiction(first: _Records, second: _Records) -> tuple[Array, Array, Array, Array]:
    """Note the difference of two records of one line: difference, private covariance, photos, derivatives by mounts."""
    difference, jacobian = line_differences(first.lines, second.lines)
    covariance = first.by_planes + first.private + jacobian @ second.private @ np.swapaxes(jacobian, 1, 2)
    by_mounts = np.concatenate([-first.mounts[:, :, :6], jacobian @ second.mounts[:, :, :6]], axis=2)
    return difference[0], covariance[0], np.array([first.photos[0, 0], second.photos[0, 0]]), by_mounts[0]


def _noted(notes: list[tuple[Array, Array, Array, Array]]) -> MountContradictions:
    return MountContradictions(
        np.array([note[0] for note in notes]).reshape(-1, 4),
        np.array([note[1] for note in notes]).reshape(-1, 4, 4),
        np.array([note[2] for note in notes], dtype=np.int64).reshape(-1, 2),
        np.array([note[3] for note in notes]).reshape(-1, 4, 12),
    )


def _better(first: _Records, second: _Records, mounts: Float64[Array, "q 6 6"]) -> _Records:
    """Choose the record that survives as it is: the scan's, or of two photos the more certain one."""
    if first.photos[0, 0] < 0:
        return first
    certain = [float(np.trace((r.private + r.mount_covariances(mounts))[0, 2:, 2:])) for r in (first, second)]
    return first if certain[0] <= certain[1] else second


def _weighted_mean(first: _Records, second: _Records) -> _Records:
    """Give the mean of two records weighted by their private covariances, in the place of the first.

    If the first already depends on two other photos, it stays as it is: what is left out is not counted twice.
    """
    photo = second.photos[0, 0]
    slots = np.flatnonzero((first.photos[0] == photo) | (first.photos[0] < 0))
    if len(slots) == 0:
        return first
    slot = int(slots[0])
    difference, jacobian = line_differences(first.lines, second.lines)
    own = first.by_planes + first.private
    other = jacobian @ second.private @ np.swapaxes(jacobian, 1, 2)
    of_second = np.swapaxes(np.linalg.solve(own + other, own), 1, 2)  # W₂ = C₁ (C₁ + C₂)⁻¹
    of_first = np.eye(4) - of_second
    mounts = of_first @ first.mounts
    mounts[:, :, 6 * slot : 6 * slot + 6] += of_second @ jacobian @ second.mounts[:, :, :6]
    photos = first.photos.copy()
    photos[0, slot] = photo
    moved = lines_moved(first.lines, np.einsum("nij,nj->ni", of_second, difference))
    ends = np.einsum("nei,ni->ne", np.stack(second.lines.end_points, axis=1) - moved.anchors[:, None], moved.directions)
    both = np.concatenate([moved.extents, ends], axis=1)
    lines = replace(
        moved,
        extents=np.column_stack([both.min(axis=1), both.max(axis=1)]),
        parent_jacobians=of_first @ moved.parent_jacobians,
    )
    return _Records(
        lines,
        by_planes=of_first @ first.by_planes @ np.swapaxes(of_first, 1, 2),
        private=of_first @ first.private @ np.swapaxes(of_first, 1, 2)
        + of_second @ other @ np.swapaxes(of_second, 1, 2),
        photos=photos,
        mounts=mounts,
        normals=first.normals,
        kinds=first.kinds,
    )
