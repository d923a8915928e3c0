"""The pose against which nothing speaks, where something speaks against every other.

How much surface fits decides little where two scans share little: rooms alike laid on each other fit better than the
right pose. But in the right pose hardly any surface stands where the other instrument looked through, and after a
search of all shifts (`surface_correlation`) it can be said that this is so nowhere else (MATH 5.4).
"""

from collections.abc import Callable, Sequence

from scipy.spatial.transform import RigidTransform

from algorithms.matching.self_likeness import Contradiction, are_near
from algorithms.scans.surface_index import SurfaceIndex

LEAST_SUPPORT = 0.025
"""A pose that lays less surface on surface may be spotless anywhere."""
SPOTLESS = 0.02
"""Largest share of what can be judged that speaks against it: right poses show 0.000 in simulated buildings, 0.001 to
0.009 in a garage and a hall, up to 0.04 in a street and 0.09 among trees, where the instrument is not known well."""
STAINED, STAINED_FACTOR = 0.03, 4.0
"""Least share that speaks against the others, by itself and as a multiple of what speaks against the pose."""
CLEARLY_STAINED = 0.1
"""Least share that speaks against those that lay more of the surface on surface than the pose: beside twelve right
ones, in real scans and simulated ones, 0.115 and more; in three pairs of stairwells, where landings are alike, 0.03
to 0.07 beside wrong ones."""
RIVAL_SUPPORT, RIVAL_RELATIVE_SUPPORT = 0.02, 0.4
"""Others count from this support on, by itself and relative to that of the pose."""
CHANCE_SUPPORT, LEAST_COMMON, COMMON_FACTOR = 0.06, 8, 4
"""Below the first value of support another pose does not count either where so many lines and planes lie on each other
in the best one, and so many times as many as in that: what fits by chance has no lines in common."""
OUTWEIGHED = 0.25
"""A pose with a smaller part of the support of the one of best score does not displace it."""


def lone_spotless_pose(
    poses: Sequence[RigidTransform],
    judged: Sequence[Contradiction],
    target: SurfaceIndex,
    source: SurfaceIndex,
    common: Callable[[int], int] = lambda _: 0,
) -> int | None:
    """Find the number of the only pose that hardly anything speaks against; None when there is none, or are several.

    None also where the position of an instrument is unknown: then nothing can speak against any pose on that side.

    In 164 pairs of scans, real ones and simulated offices, houses, halls and squares, all shifts searched, the pose
    given was right in 113 and never wrong; but poses with nothing against them at all exist beside the right one up to
    a support of 0.056, and of 61 pairs of scans of different places one gave such a pose, of support 0.048: so low this
    tells where to look first and proves nothing.

    Parameters
    ----------
    poses, judged
        Distinct poses target from source, the one of best score first, and what speaks for and against each.
    target, source
        The two scans.
    common
        Tells how many lines and planes of both scans lie on each other in the pose of a number; asked where it matters.
    """
    if not (target.knows_free_space and source.knows_free_space):
        return None
    spotless = [k for k, each in enumerate(judged) if each.support >= LEAST_SUPPORT and each.share <= SPOTLESS]
    if not spotless:
        return None
    best = max(spotless, key=lambda k: judged[k].support)
    own = judged[best]
    if own.support < OUTWEIGHED * judged[0].support:
        return None
    stained = max(STAINED, STAINED_FACTOR * own.share)
    counting = max(RIVAL_SUPPORT, RIVAL_RELATIVE_SUPPORT * own.support)

    def chance(k: int) -> bool:
        """Say whether another pose has nothing but a little surface for it."""
        found = common(best) if judged[k].support < CHANCE_SUPPORT else 0
        return found >= LEAST_COMMON and COMMON_FACTOR * common(k) <= found

    def is_stained(k: int) -> bool:
        least = max(stained, CLEARLY_STAINED) if judged[k].support > own.support else stained
        return judged[k].share >= least

    rivals = (k for k, each in enumerate(judged) if k != best and each.support >= counting and not is_stained(k))
    return best if all(are_near(poses[best], poses[k], target, source) or chance(k) for k in rivals) else None
