"""Poses that the building's own symmetry makes possible: half turns, bays, equal storeys.

In a building that looks like itself shifted by a bay, the wrong pose may lay more surface on surface than the right
one: two stations at corresponding places see nearly the same picture. How much fits decides nothing there. What gives
such an alternative away is that nothing speaks against it (hardly any surface stands where the other scan looked
through), and that the motion between both poses lays a scan onto itself without contradiction either.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Flags, Matrices3
from algorithms.geometry.rotations import rotation_matrix, turn_between
from algorithms.scans.pose_scores import FINAL_POINTS, score_poses, strict_limits
from algorithms.scans.surface_index import SurfaceIndex

LEAST_SUPPORT = 0.05
"""An alternative that lays less surface on surface could be anywhere."""
SPOTLESS, LEAST_RELATIVE_SUPPORT = 0.003, 1.0 / 3.0
"""Where less than the first share speaks against the best pose, an alternative must lay at least the second part of its
surface on surface: that the next house looks the same is always possible, but then nothing could ever be known."""
LEAST_TURN_RAD, TURNED_RELATIVE_SUPPORT = np.radians(20.0), 0.1
TURNED_SUPPORT, TURNED_SHARE = 0.08, 0.005
"""Unless it is turned: two storeys alike, or a bridge seen from corresponding places on both sides, lay nearly all of
the surface on surface in the wrong pose, and the right one has little in common. Then a turn makes the other pose
possible from this part of the surface on, if it is spotless itself; or if it lays so much of both scans on themselves
with less than `CONTRADICTED` against it, and if hardly more speaks against the other pose than against the best. Of
the wrong poses that lay `LEAST_SUPPORT` of the surface on surface none came below 0.007 in 164 pairs, real or not."""
FAINT_SUPPORT, FAINT_RELATIVE_SUPPORT, FAINT_LIKENESS, FAINT_CONTRADICTED = 0.02, 0.06, 0.03, 0.03
"""A spotless turned pose with still less in common could be anywhere: from the first value of support on, and the
second of support relative to the best pose's, it is possible only if the turn lays the third value, a share of the
surface, of both scans on themselves, with less than the fourth against it. Coarse scans of the two sides of a bridge
show hardly more in common than the sides of its pillars."""
KEPT_RAD, KEPT_DENSITY, KEPT_SHARE, KEPT_SAMPLES = np.radians(5.0), 0.1, 0.9, 1000
CERTAIN_SUPPORT = 0.3
"""A turn that lays a building on itself lays its directions on themselves: it turns so large a share of the normals of
a scan, up to their signs, to where within the angle there are at least so many, relative to where they came from, as
samples of so many show. In 16 pairs of symmetric rooms, corridors, car parks and storeys 0.93 and more were kept; turns
that lay a wall on a wall elsewhere by chance kept 0.70 to 0.84 (two pairs of a house). Chance lays less surface on
surface than the last value, so beside a spotless pose of that support other turns count only if they lay as much of
both scans on themselves as above, as where houses alike stand askew to each other."""
NEAR_RAD, NEAR_RELATIVE_SUPPORT = 0.15, 0.8
"""Two poses whose motion is seen under a smaller angle than the first value show nearly the same picture: were one by a
repetition of the building as good as the other, it would lay as much surface on surface but for the rims."""
CONTRADICTED, CONTRADICTED_PER_SUPPORT, CONTRADICTED_AS_BEST = 0.02, 0.08, 2.0
"""An alternative is possible while the share that speaks against it is below the first value, or below the second times
its support relative to the best pose's (at most once), or below the third times what speaks against the best pose. The
second does not count for a mere shift beside a spotless pose: both scans look at what they share in the same direction
then, and the right pose would be nearly as spotless."""
CLEANER, CLEAN_SUPPORT = 0.25, 0.1
"""Where more than `CONTRADICTED` speaks against the best pose and less than the first part of it against an
alternative, no symmetry needs to be shown; nor where the best pose is not spotless and an alternative is that lays at
least the second value, a share of the surface, on surface. Where more than `CONTRADICTED` speaks against the best pose
a spotless one needs no more than `FAINT_SUPPORT`: landings of a stairwell are alike, and what two stations on different
ones have in common are the windows. Of 15 right poses with so much against them, 13 of them among trees, one had such
a pose beside it, and that was doubtful anyhow."""
SELF_SUPPORT, SELF_CONTRADICTED = 0.05, 0.05
"""A scan is like itself when so much of it lies on itself, and less than this share of that speaks against it."""


@dataclass(frozen=True)
class Contradiction:
    """How much of the surface fits, and which share of what can be judged speaks against a pose."""

    support: float
    """Share that fits, a geometric mean over directions of normals, 0..1."""
    share: float
    """Share of what fits or stands in free space that stands in free space, 0..1."""

    @staticmethod
    def of(support: float, violation: float) -> "Contradiction":
        """Build from the shares that fit and that stand in free space."""
        return Contradiction(support, violation / max(support + violation, 1e-9))


def is_possible_alternative(
    pose: RigidTransform,
    other: RigidTransform,
    *,
    best: Contradiction,
    alternative: Contradiction,
    target: SurfaceIndex,
    source: SurfaceIndex,
    noise_m: float,
) -> bool:
    """Say whether a symmetry of the building makes another pose possible beside the best one.

    Parameters
    ----------
    pose, other
        The best pose and another, target from source.
    best, alternative
        What speaks for and against them.
    target, source
        The two scans.
    noise_m
        Standard deviation of single points [m].
    """

    def likenesses() -> tuple[Contradiction, Contradiction]:
        return (
            self_likeness(target, other * pose.inv(), noise_m),
            self_likeness(source, pose.inv() * other, noise_m),
        )

    def both_are_like_themselves(support: float, share: float) -> bool:
        return all(like.support >= support and like.share <= share for like in likenesses())

    def turn_may_be_symmetry() -> bool:
        here, there = rotation_matrix(pose), rotation_matrix(other)
        return (
            best.support < CERTAIN_SUPPORT
            or keeps_directions(target, (there @ here.T)[None]).item()
            or keeps_directions(source, (here.T @ there)[None]).item()
            or both_are_like_themselves(TURNED_SUPPORT, CONTRADICTED)
        )

    relative = alternative.support / max(best.support, 1e-9)
    near = relative < NEAR_RELATIVE_SUPPORT and are_near(pose, other, target, source)
    if near or alternative.support < FAINT_SUPPORT:
        return False
    if alternative.share <= SPOTLESS and best.share > CONTRADICTED:
        return True
    turned = bool(turn_between(other, pose) >= LEAST_TURN_RAD)
    lone = best.share <= SPOTLESS and relative < LEAST_RELATIVE_SUPPORT
    if alternative.support < LEAST_SUPPORT or (lone and relative < TURNED_RELATIVE_SUPPORT):
        spotless = turned and alternative.share <= SPOTLESS and relative >= FAINT_RELATIVE_SUPPORT
        return spotless and turn_may_be_symmetry() and both_are_like_themselves(FAINT_LIKENESS, FAINT_CONTRADICTED)
    if lone:
        clean = turned and alternative.share <= TURNED_SHARE and turn_may_be_symmetry()
        return clean and (alternative.share <= SPOTLESS or both_are_like_themselves(TURNED_SUPPORT, CONTRADICTED))
    limit = max(CONTRADICTED, CONTRADICTED_AS_BEST * best.share)
    if turned or best.share > SPOTLESS:
        limit = max(limit, CONTRADICTED_PER_SUPPORT * min(relative, 1.0))
    if alternative.share > limit:
        return False
    cleaner = alternative.share < CLEANER * best.share and best.share > CONTRADICTED
    cleaner |= alternative.share <= SPOTLESS < best.share and alternative.support >= CLEAN_SUPPORT
    return cleaner or any(like.support >= SELF_SUPPORT and like.share <= SELF_CONTRADICTED for like in likenesses())


def are_near(pose: RigidTransform, other: RigidTransform, target: SurfaceIndex, source: SurfaceIndex) -> bool:
    """Say whether the instruments would see nearly the same picture in both poses; False where they are unknown.

    Parameters
    ----------
    pose, other
        Target from source.
    target, source
        The two scans.
    """
    if not (target.knows_free_space and source.knows_free_space):
        return False
    if turn_between(other, pose) > NEAR_RAD:
        return False
    distance = min(target.median_range_m, source.median_range_m)
    places = np.vstack([source.centre_m, source.sensor_m])
    return float(np.linalg.norm(other.apply(places) - pose.apply(places), axis=1).max()) <= NEAR_RAD * distance


def keeps_directions(scan: SurfaceIndex, turns: Matrices3) -> Flags:
    """Say which turns lay the directions of a scan's surfaces on each other, as every turn of a symmetry does.

    Parameters
    ----------
    scan
        The scan.
    turns
        (k, 3, 3) rotations in its frame.
    """
    normals = scan.normals[:KEPT_SAMPLES]
    before = _as_steep(normals, normals)
    kept = [np.mean(_as_steep(normals @ turn.T, normals) >= KEPT_DENSITY * before) >= KEPT_SHARE for turn in turns]
    return np.array(kept, dtype=bool)


def _as_steep(directions: Array, normals: Array) -> Array:
    """Count, for each direction (k, 3), the normals (n, 3) along it or against it, but for `KEPT_RAD`."""
    along = directions @ normals.T
    # in place: a new million of numbers takes longer than what is done with it
    np.abs(along, out=along)
    return np.asarray(np.count_nonzero(along >= np.cos(KEPT_RAD), axis=1))


def self_likeness(scan: SurfaceIndex, motion: RigidTransform, noise_m: float) -> Contradiction:
    """Lay a moved scan onto itself.

    Parameters
    ----------
    scan
        The scan.
    motion
        How it is moved, in its own frame.
    noise_m
        Standard deviation of single points [m].
    """
    scores = score_poses(
        rotation_matrix(motion)[None],
        np.asarray(motion.translation, dtype=np.float64)[None],
        scan,
        scan,
        points=FINAL_POINTS,
        limits=strict_limits(noise_m, scan.spacing_m),
    )
    return Contradiction.of(float(scores.support[0]), float(scores.violation[0]))
