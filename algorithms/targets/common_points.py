"""Which points two stations have in common: by their names, else by their distances."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, IndexPairs
from algorithms.geometry.point_sets import PointSet
from algorithms.targets.naming import match_points


@dataclass(frozen=True, eq=False)
class TargetSet:
    """Targets of one station, or points with known coordinates."""

    names: tuple[str | None, ...]
    """What each is called, each name once; None: nobody said."""
    points: PointSet
    """In the station's reduced frame."""

    def __len__(self) -> int:
        return len(self.names)

    def selected(self, which: Array) -> "TargetSet":
        """Keep some of them, by their numbers."""
        return TargetSet(tuple(self.names[k] for k in which.tolist()), self.points[which])

    @staticmethod
    def none() -> "TargetSet":
        """Give no target."""
        return TargetSet((), PointSet(np.zeros((0, 3)), np.zeros((0, 3, 3))))


@dataclass(frozen=True, eq=False)
class CommonPoints:
    """Points that two sets have in common."""

    pairs: IndexPairs
    """(n, 2) numbers in the first and in the second set."""
    by_name: int
    """How many of them were known by their names; the others by their distances."""
    reason: str
    """How clear that is, or why no more were found, in words."""

    def __len__(self) -> int:
        return len(self.pairs)


def common_points(first: TargetSet, second: TargetSet) -> CommonPoints:
    """Find the points that two sets have in common.

    Equal names are the same point. The others are recognised by the distances between all of them (`match_points`);
    two different names that both sets know are never the same point.

    Parameters
    ----------
    first, second
        Points, each set in a frame of its own.
    """
    theirs = {name: k for k, name in enumerate(second.names) if name is not None}
    named = [(k, theirs[name]) for k, name in enumerate(first.names) if name is not None and name in theirs]
    if all(name is not None for name in (*first.names, *second.names)) and len(named) >= min(len(first), len(second)):
        return CommonPoints(_pairs(named), len(named), f"{len(named)} names in common")
    found = match_points(first.points, second.points)
    taken = {i for i, _ in named}, {k for _, k in named}
    ours = set(first.names) - {None}
    more = [
        (i, k)
        for i, k in found.pairs.tolist()
        if i not in taken[0] and k not in taken[1] and not (first.names[i] in theirs or second.names[k] in ours)
    ]
    words = f"{len(named)} names in common; by distances: {found.reason}" if named else found.reason
    return CommonPoints(_pairs([*named, *more]), len(named), words)


def _pairs(pairs: list[tuple[int, int]]) -> IndexPairs:
    return np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)
