"""Straight lines with uncertainty: the record of MATH 2.1."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from algorithms.arrays import Array, Bases, IndexPairs, Labels, Matrices4, Points, Vectors2


class LineSource(IntEnum):
    """Where a line comes from."""

    PLANE_INTERSECTION = 0
    CYLINDER_AXIS = 1
    PHOTO_EDGE = 2

    @property
    def label(self) -> str:
        """Give the name used in results, e.g. ``plane-intersection``."""
        return self.name.lower().replace("_", "-")


@dataclass(frozen=True, eq=False)
class Lines:
    """n straight lines in one frame, column by column."""

    anchors: Points
    """(n, 3) a point of each line near its data [m]."""
    directions: Points
    """(n, 3) unit directions; the sign has no meaning."""
    bases: Bases
    """(n, 3, 2) columns E1, E2 with (E1, E2, d) right-handed."""
    covariances: Matrices4
    """(n, 4, 4) covariance of (a1, a2, b1, b2): d -> d + E a, c -> c + E b [rad, m]."""
    extents: Vectors2
    """(n, 2) seen piece [s_min, s_max] along d from the anchor [m]."""
    sources: Labels
    """(n,) `LineSource` values."""
    parents: IndexPairs
    """(n, 2) plane numbers for intersections, (cylinder number, -1) for axes, -1 where there is none."""
    parent_jacobians: Array
    """(n, 4, 6) for intersections: (a1, a2, b1, b2) = G (plane i: a1, a2, b; plane j: a1, a2, b). Zero otherwise.
    Lines that share a plane are correlated through it."""
    photos: Labels | None = None
    """(n,) number of the station's photo that the line depends on, -1 for lines of the scan alone; None: no photos."""
    photo_jacobians: Array | None = None
    """(n, 4, 6): (a1, a2, b1, b2) from the error of that photo's mount (rotation vector on the left of the scan axes,
    translation), which all its lines share; zero for lines of the scan. The covariances contain it already."""
    second_photos: Labels | None = None
    """(n,) a second photo that merged lines depend on, -1 for none."""
    second_photo_jacobians: Array | None = None
    """(n, 4, 6) the same for that photo's mount."""
    private_covariances: Matrices4 | None = None
    """(n, 4, 4) what neither parent planes nor mounts explain of the covariances. None: nothing where a line has parent
    planes, elsewhere all but the mounts' part."""

    def __len__(self) -> int:
        return len(self.anchors)

    def __getitem__(self, which: "Array | slice | list[int]") -> "Lines":
        """Select lines by an index array, mask or slice (not by one number)."""
        return Lines(
            self.anchors[which],
            self.directions[which],
            self.bases[which],
            self.covariances[which],
            self.extents[which],
            self.sources[which],
            self.parents[which],
            self.parent_jacobians[which],
            *(None if part is None else part[which] for part in self._optional),
        )

    @property
    def _optional(self) -> tuple[Array | None, ...]:
        return (
            self.photos,
            self.photo_jacobians,
            self.second_photos,
            self.second_photo_jacobians,
            self.private_covariances,
        )

    @property
    def lengths(self) -> Array:
        """(n,) length of the seen pieces [m]."""
        return np.asarray(self.extents[:, 1] - self.extents[:, 0])

    @property
    def end_points(self) -> tuple[Array, Array]:
        """Give start and end of the seen pieces, each (n, 3) [m]."""
        return (
            self.anchors + self.extents[:, :1] * self.directions,
            self.anchors + self.extents[:, 1:] * self.directions,
        )

    @staticmethod
    def empty() -> "Lines":
        """Give no lines."""
        return lines_from_arrays(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 4, 4)), np.empty((0, 2)))


def bases_of(directions: Points) -> Bases:
    """Build for each direction d a basis E so that (E1, E2, d) is right-handed and orthonormal.

    Parameters
    ----------
    directions
        (n, 3) unit vectors.

    Returns
    -------
    (n, 3, 2) columns E1, E2; a continuous choice except where the smallest component of d changes.
    """
    helper = np.zeros_like(directions)
    if len(directions):
        helper[np.arange(len(directions)), np.argmin(np.abs(directions), axis=1)] = 1.0
    e1 = np.cross(helper, directions)
    e1 /= np.linalg.norm(e1, axis=1, keepdims=True)
    e2 = np.cross(directions, e1)
    return np.stack([e1, e2], axis=2)


def lines_from_arrays(
    anchors: Points,
    directions: Points,
    covariances: Matrices4,
    extents: Vectors2,
    *,
    bases: Bases | None = None,
    sources: Labels | None = None,
    parents: IndexPairs | None = None,
    parent_jacobians: Array | None = None,
) -> Lines:
    """Build a `Lines` record; directions are normalised, what is left out gets its neutral value."""
    n = len(anchors)
    norms = np.linalg.norm(directions, axis=1, keepdims=True)
    unit = directions / norms if n else directions
    return Lines(
        anchors=anchors,
        directions=unit,
        bases=bases_of(unit) if bases is None else bases,
        covariances=covariances,
        extents=extents,
        sources=np.zeros(n, dtype=np.int32) if sources is None else sources,
        parents=np.full((n, 2), -1, dtype=np.int64) if parents is None else parents,
        parent_jacobians=np.zeros((n, 4, 6)) if parent_jacobians is None else parent_jacobians,
    )


def concatenated_lines(parts: Sequence[Lines]) -> Lines:
    """Put lines of one frame together, without what is known of photos and private errors."""
    names = ("anchors", "directions", "covariances", "extents", "bases", "sources", "parents", "parent_jacobians")
    whole = [Lines.empty(), *parts]
    columns = {name: np.concatenate([getattr(part, name) for part in whole]) for name in names}
    return lines_from_arrays(**columns)
