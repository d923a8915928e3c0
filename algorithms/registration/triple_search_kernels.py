"""Loops of the search over triples of planes, compiled."""

import numba as nb
import numpy as np

from algorithms.arrays import Array

ROTATIONS_OF_THREE = np.array([[0, 1, 2], [1, 2, 0], [2, 0, 1]], dtype=np.int64)
"""The orders in which a triple may be laid on another one of the same orientation."""


@nb.njit(cache=True, nogil=True)
def agreeing(
    rotation: Array, shift: Array, target: Array, source: Array, limits: Array, least: int, partners: Array
) -> int:
    """Count the source planes that lie in a target plane once moved; -1 as soon as `least` is out of reach.

    Parameters
    ----------
    rotation, shift
        (3, 3), (3,) pose.
    target, source
        (n, 8) normal, centroid, radius and offset of each plane, the largest first.
    limits
        Cosine of the largest angle, largest distance [m].
    least
        Fewer are not worth counting.
    partners
        (m,) is given the target plane of each source plane, -1 for none.
    """
    count = 0
    for j in range(len(source)):
        partners[j] = -1
        n0 = rotation[0, 0] * source[j, 0] + rotation[0, 1] * source[j, 1] + rotation[0, 2] * source[j, 2]
        n1 = rotation[1, 0] * source[j, 0] + rotation[1, 1] * source[j, 1] + rotation[1, 2] * source[j, 2]
        n2 = rotation[2, 0] * source[j, 0] + rotation[2, 1] * source[j, 1] + rotation[2, 2] * source[j, 2]
        c0 = rotation[0, 0] * source[j, 3] + rotation[0, 1] * source[j, 4] + rotation[0, 2] * source[j, 5] + shift[0]
        c1 = rotation[1, 0] * source[j, 3] + rotation[1, 1] * source[j, 4] + rotation[1, 2] * source[j, 5] + shift[1]
        c2 = rotation[2, 0] * source[j, 3] + rotation[2, 1] * source[j, 4] + rotation[2, 2] * source[j, 5] + shift[2]
        best = limits[1]
        for i in range(len(target)):
            if n0 * target[i, 0] + n1 * target[i, 1] + n2 * target[i, 2] < limits[0]:
                continue
            d0, d1, d2 = c0 - target[i, 3], c1 - target[i, 4], c2 - target[i, 5]
            off = abs(d0 * target[i, 0] + d1 * target[i, 1] + d2 * target[i, 2])
            reach = target[i, 6] + source[j, 6]
            if off < best and d0 * d0 + d1 * d1 + d2 * d2 < reach * reach:
                best = off
                partners[j] = i
        if partners[j] >= 0:
            count += 1
        elif count + len(source) - 1 - j < least:
            return -1
    return count


@nb.njit(cache=True, nogil=True)
def search(
    target: Array,
    source: Array,
    target_triples: Array,
    source_triples: Array,
    target_products: Array,
    source_products: Array,
    limits: Array,
    budget: int,
    rotations: Array,
    shifts: Array,
    scores: Array,
) -> int:
    """Lay triples on triples, the most orthogonal ones first, and keep the poses in which most planes agree.

    Parameters
    ----------
    target, source
        (n, 8) planes as of `agreeing`.
    target_triples, source_triples
        (k, 3) numbers of the planes of each triple, by falling triple product.
    target_products, source_products
        (k, 3) cosines between the normals of each triple: first and second, second and third, third and first.
    limits
        Cosine and distance as of `agreeing`, largest difference of two cosines, largest shift [m], and the angle and
        distance within which two poses are the same one [rad, m].
    budget
        So many poses are counted at most.
    rotations, shifts, scores
        (p, 3, 3), (p, 3), (p,) filled with the best distinct poses, in no order.

    Returns
    -------
    How many poses were counted.
    """
    kept, counted, most = 0, 0, len(scores)
    lowest = 3
    rotation, shift = np.empty((3, 3)), np.empty(3)
    partners = np.empty(len(source), dtype=np.int64)
    cosine_same = np.cos(limits[4])
    for diagonal in range(len(target_triples) + len(source_triples) - 1):
        first = max(0, diagonal - len(source_triples) + 1)
        for a in range(first, min(diagonal + 1, len(target_triples))):
            b = diagonal - a
            for order in ROTATIONS_OF_THREE:
                if not _alike(target_products[a], source_products[b], order, limits[2]):
                    continue
                _lay(target, source, target_triples[a], source_triples[b], order, rotation, shift)
                if shift[0] ** 2 + shift[1] ** 2 + shift[2] ** 2 > limits[3] ** 2:
                    continue
                if not _meet(target, source, target_triples[a], source_triples[b], order, rotation, shift):
                    continue
                counted += 1
                score = agreeing(rotation, shift, target, source, limits, lowest, partners)
                if score >= lowest:
                    kept = _keep(rotation, shift, score, rotations, shifts, scores, kept, cosine_same, limits[5])
                    if kept == most:
                        lowest = int(scores.min())
                if counted >= budget:
                    return counted
    return counted


@nb.njit(cache=True, nogil=True)
def _alike(target_products: Array, source_products: Array, order: Array, largest: float) -> bool:
    """Say whether two triples have the same angles between their planes, in an order."""
    worst = 0.0
    for k in range(3):
        worst = max(worst, abs(target_products[k] - source_products[order[k]]))
    return worst <= largest


@nb.njit(cache=True, nogil=True)
def _lay(
    target: Array,
    source: Array,
    target_triple: Array,
    source_triple: Array,
    order: Array,
    rotation: Array,
    shift: Array,
) -> None:
    """Write the pose that lays three planes on three planes: with N the normals as rows, R = N_t^-1 N_s.

    R is a rotation as far as the angles between the planes are the same; the shift is N_t^-1 (h_t - h_s).
    """
    ours, theirs, right = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for k in range(3):
        i, j = target_triple[k], source_triple[order[k]]
        for axis in range(3):
            ours[k, axis] = target[i, axis]
            theirs[k, axis] = source[j, axis]
        right[k] = target[i, 7] - source[j, 7]
    inverse = np.linalg.inv(ours)
    for r in range(3):
        shift[r] = inverse[r, 0] * right[0] + inverse[r, 1] * right[1] + inverse[r, 2] * right[2]
        for c in range(3):
            rotation[r, c] = inverse[r, 0] * theirs[0, c] + inverse[r, 1] * theirs[1, c] + inverse[r, 2] * theirs[2, c]


@nb.njit(cache=True, nogil=True)
def _meet(
    target: Array,
    source: Array,
    target_triple: Array,
    source_triple: Array,
    order: Array,
    rotation: Array,
    shift: Array,
) -> bool:
    """Say whether the planes of two triples come near each other in a pose."""
    for k in range(3):
        i, j = target_triple[k], source_triple[order[k]]
        gap = 0.0
        for axis in range(3):
            moved = shift[axis] - target[i, 3 + axis]
            for c in range(3):
                moved += rotation[axis, c] * source[j, 3 + c]
            gap += moved * moved
        if gap > (target[i, 6] + source[j, 6]) ** 2:
            return False
    return True


@nb.njit(cache=True, nogil=True)
def _keep(
    rotation: Array,
    shift: Array,
    score: int,
    rotations: Array,
    shifts: Array,
    scores: Array,
    kept: int,
    cosine_same: float,
    same_m: float,
) -> int:
    """Put a pose among the best ones; of poses that are the same one the better stays. Give how many there are."""
    place = -1
    for k in range(kept):
        trace = 0.0
        for r in range(3):
            for c in range(3):
                trace += rotation[r, c] * rotations[k, r, c]
        apart = (shift[0] - shifts[k, 0]) ** 2 + (shift[1] - shifts[k, 1]) ** 2 + (shift[2] - shifts[k, 2]) ** 2
        if 0.5 * (trace - 1.0) > cosine_same and apart < same_m**2:
            if scores[k] >= score:
                return kept
            place = k
            break
    if place < 0:
        if kept < len(scores):
            place = kept
            kept += 1
        else:
            place = int(np.argmin(scores))
            if scores[place] >= score:
                return kept
    rotations[place] = rotation
    shifts[place] = shift
    scores[place] = score
    return kept
