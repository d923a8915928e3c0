"""Points of a LAS file that a job uses: their flags, classes and returns say so."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from algorithms.arrays import Array, Flags

LOW_NOISE, HIGH_NOISE = 7, 18
"""Classes of points that are no surface (LAS 1.4 R15, table 17)."""
OVERLAP_CLASS = 12
"""Class of overlap points in point formats 0 to 5, which have no flag for it (LAS 1.4 R15, table 9)."""
OLD_FORMATS = 6
"""Point formats below keep flags in the byte of the class."""
NOISE = f"noise (classes {LOW_NOISE} and {HIGH_NOISE})"
WITHHELD = "withheld"
OVERLAP = "overlap"
OTHER_RETURN = "of other returns"


@dataclass(frozen=True)
class PointSelection:
    """Flags, classes and returns of the points that are used; formats without them keep all points."""

    classes: tuple[int, ...] | None = None
    """Classes that are used; None: all but noise."""
    returns: str = "all"
    """`all`, `first` or `last` returns of each pulse."""
    withheld: bool = False
    """Use points that the file marks as withheld too."""
    overlap: bool = True
    """Use points that the file marks as overlap."""

    @staticmethod
    def of(stated: Mapping[str, Any] | None) -> "PointSelection":
        """Return what the members of a request state; None: the usual points."""
        if stated is None:
            return USUAL_POINTS
        classes = stated["classes"]
        return PointSelection(**{**stated, "classes": None if classes is None else tuple(classes)})

    @property
    def asks(self) -> bool:
        """Whether it chooses by what only files with classes and returns tell."""
        return self.classes is not None or self.returns != "all" or not self.overlap

    def chosen(self, chunk: Any, left_out: Counter[str]) -> Flags | None:
        """Return (n,) points of a chunk that are used, None for all; count the others by reason.

        Parameters
        ----------
        chunk
            Point record of laspy.
        left_out
            Counts by reason, which grow; each point counts once.
        """
        classes = np.asarray(chunk["classification"])
        keep = np.ones(len(chunk), dtype=np.bool_)

        def leave_out(unwanted: Flags, reason: str) -> None:
            found = int(np.count_nonzero(unwanted & keep))
            if found:
                left_out[reason] += found
                np.logical_and(keep, ~unwanted, out=keep)

        if not self.withheld:
            leave_out(np.asarray(chunk["withheld"]) != 0, WITHHELD)
        if self.classes is None:
            leave_out((classes == LOW_NOISE) | (classes == HIGH_NOISE), NOISE)
        else:
            for other in np.flatnonzero(np.bincount(classes[keep], minlength=256)).tolist():
                if other not in self.classes:
                    leave_out(classes == other, f"of class {other}")
        if not self.overlap:
            leave_out(overlapping(chunk, classes), OVERLAP)
        if self.returns != "all":
            number, count = np.asarray(chunk["return_number"]), np.asarray(chunk["number_of_returns"])
            # a writer that leaves both zero means single returns
            leave_out((number < count) if self.returns == "last" else (number > 1), OTHER_RETURN)
        return None if bool(keep.all()) else keep


USUAL_POINTS = PointSelection()
"""All points but withheld ones and noise."""
ALL_POINTS = PointSelection(classes=tuple(range(256)), withheld=True)
"""Every point, also withheld ones and noise."""


def overlapping(chunk: Any, classes: Array) -> Flags:
    """Return (n,) points of a chunk that are marked as overlap."""
    if chunk.point_format.id < OLD_FORMATS:
        return np.asarray(classes == OVERLAP_CLASS)
    return np.asarray(chunk["overlap"], dtype=np.bool_)


def left_out_in_words(left_out: Mapping[str, int]) -> str:
    """Return how many points were left out for which reason; empty where none was."""
    if not left_out:
        return ""
    counts = ", ".join(f"{count} {reason}" for reason, count in left_out.items())
    return f"points left out as the file marks them: {counts}"


def unselected_in_words(selection: PointSelection) -> str:
    """Return that a file tells nothing of what a selection asks for; empty where it asks for nothing."""
    return "the file tells no classes, returns or overlap: all its points are used" if selection.asks else ""
