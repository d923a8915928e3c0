"""Find the targets of a scan, kind by kind."""

from collections.abc import Sequence
from dataclasses import dataclass

from algorithms.errors import InvalidInputError
from algorithms.progress import NoProgress, Progress, ProgressSection
from algorithms.scans.scan import Scan
from algorithms.targets.boards import find_boards
from algorithms.targets.found import Candidate, FoundTarget, RejectedCandidate, distinct, one_of_both
from algorithms.targets.options import BoardKind, RetroKind, SoughtKind, SphereKind
from algorithms.targets.retro import BrightSpot, bright_spots, find_retro_targets
from algorithms.targets.seen_cloud import SeenCloud, seen_cloud
from algorithms.targets.spheres import find_spheres


@dataclass(frozen=True, eq=False)
class TargetsOfScan:
    """What was found in one scan."""

    found: tuple[FoundTarget, ...]
    """In the order of the kinds, the best first."""
    rejected: tuple[RejectedCandidate, ...]
    """What looked like one at first, and why it is none."""


def find_targets(scan: Scan, kinds: Sequence[SoughtKind], *, progress: Progress | None = None) -> TargetsOfScan:
    """Find targets of given kinds and sizes in a scan.

    Parameters
    ----------
    scan
        Spheres are found in any, boards where there are intensities, retro-reflective targets in the intensities of
        structured scans.
    kinds
        What is looked for; one entry for each size.
    progress
        Is told the kinds.

    Raises
    ------
    InvalidInputError
        When a kind cannot be seen in this scan, or nothing is looked for.
    """
    if not kinds:
        raise InvalidInputError("kinds", "there are none", "name at least one kind of target with its size")
    listener = progress or NoProgress()
    cloud = seen_cloud(scan)
    spots = bright_spots(cloud) if any(isinstance(kind, RetroKind) for kind in kinds) else []
    found: list[FoundTarget] = []
    rejected: list[RejectedCandidate] = []
    for number, kind in enumerate(kinds):
        part = ProgressSection(listener, number / len(kinds), (number + 1) / len(kinds))
        candidates, apart_m = _of_kind(cloud, spots, kind, part)
        good, bad = distinct(candidates, apart_m)
        found += good
        rejected += bad
    return TargetsOfScan(tuple(one_of_both(found)), tuple(rejected))


def _of_kind(
    cloud: SeenCloud, spots: Sequence[BrightSpot], kind: SoughtKind, progress: Progress
) -> tuple[list[Candidate], float]:
    """Give the candidates of a kind, and how near to each other two of them are the same."""
    if isinstance(kind, SphereKind):
        return find_spheres(cloud, kind.radius_m, progress=progress), kind.radius_m
    if isinstance(kind, BoardKind):
        return find_boards(cloud, kind.size_m, progress=progress), 0.75 * kind.size_m
    return find_retro_targets(cloud, spots, kind.size_m, kind.kind, progress=progress), 0.75 * kind.size_m
