"""Compiled loops of a sparse LDLᵀ factorisation and its selected inverse (Davis 2005; Takahashi 1973)."""

from typing import Any

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def elimination_tree(n: int, starts: Array, rows: Array) -> Any:  # pragma: no cover - compiled
    """Give parents and column counts of L for the upper triangle of a symmetric matrix, by columns (MATH 3.1)."""
    parents = np.full(n, -1, np.int64)
    counts = np.zeros(n, np.int64)
    seen = np.full(n, -1, np.int64)
    for j in range(n):
        seen[j] = j
        for p in range(starts[j], starts[j + 1]):
            i = rows[p]
            while i < j and seen[i] != j:
                if parents[i] == -1:
                    parents[i] = j
                counts[i] += 1
                seen[i] = j
                i = parents[i]
    return parents, counts


@njit(cache=True, nogil=True)
def assembly_places(
    upper_starts: Array, upper_rows: Array, places: Array, starts: Array, columns: Array
) -> Any:  # pragma: no cover - compiled
    """Find where the product of each pair of elements of each row goes in the permuted upper triangle (MATH 3.1).

    Pairs are those of `assemble`, in its order.
    """
    count = 0
    for m in range(len(starts) - 1):
        d = starts[m + 1] - starts[m]
        count += d * (d + 1) // 2
    found = np.empty(count, np.int32)
    k = 0
    for m in range(len(starts) - 1):
        for p in range(starts[m], starts[m + 1]):
            for q in range(p, starts[m + 1]):
                i, j = places[columns[p]], places[columns[q]]
                if j < i:
                    i, j = j, i
                low, high = upper_starts[j], upper_starts[j + 1]
                while low < high:
                    middle = (low + high) // 2
                    if upper_rows[middle] < i:
                        low = middle + 1
                    else:
                        high = middle
                found[k] = low
                k += 1
    return found


@njit(cache=True, nogil=True)
def assemble(
    size: int, where: Array, starts: Array, values: Array, weights: Array
) -> Any:  # pragma: no cover - compiled
    """Add wᵢ aᵢᵀ aᵢ of all rows into the `size` elements of the permuted normal matrix's triangle (MATH 3.1)."""
    total = np.zeros(size)
    k = 0
    for m in range(len(starts) - 1):
        w = weights[m]
        for p in range(starts[m], starts[m + 1]):
            wa = w * values[p]
            for q in range(p, starts[m + 1]):
                if w != 0.0:
                    total[where[k]] += wa * values[q]
                k += 1
    return total


@njit(cache=True, nogil=True)
def scale_to_unit_diagonal(
    upper_starts: Array, upper_rows: Array, total: Array, added: Array
) -> Any:  # pragma: no cover - compiled
    """Scale a symmetric matrix to a unit diagonal, in place, then add to the diagonal; gives the scales (MATH 3.1)."""
    n = len(upper_starts) - 1
    scale = np.ones(n)
    for j in range(n):
        d = total[upper_starts[j + 1] - 1]
        if d > 0.0:
            scale[j] = 1.0 / np.sqrt(d)
    for j in range(n):
        for p in range(upper_starts[j], upper_starts[j + 1]):
            total[p] *= scale[j] * scale[upper_rows[p]]
        total[upper_starts[j + 1] - 1] += added[j]
    return scale


@njit(cache=True, nogil=True)
def factorise(
    n: int, starts: Array, rows: Array, values: Array, parents: Array, l_starts: Array, least: float
) -> Any:  # pragma: no cover - compiled
    """Factorise the upper triangle of a symmetric matrix with unit diagonal, row by row, as L D Lᵀ (MATH 3.1).

    A pivot below `least` gets 1 added: a fictitious observation of its unknown. Returns row numbers and values of L by
    columns, the pivots, and which of them were helped.
    """
    l_rows = np.empty(l_starts[n], np.int64)
    l_values = np.empty(l_starts[n])
    filled = l_starts[:n].copy()
    pivots = np.empty(n)
    helped = np.zeros(n, np.bool_)
    y = np.zeros(n)
    seen = np.full(n, -1, np.int64)
    pattern = np.empty(n, np.int64)
    stack = np.empty(n, np.int64)
    for j in range(n):
        top = n
        seen[j] = j
        pivot = 0.0
        for p in range(starts[j], starts[j + 1]):
            i = rows[p]
            if i == j:
                pivot += values[p]
                continue
            y[i] += values[p]
            length = 0
            while seen[i] != j:
                stack[length] = i
                length += 1
                seen[i] = j
                i = parents[i]
            while length > 0:
                length -= 1
                top -= 1
                pattern[top] = stack[length]
        for k in range(top, n):
            i = pattern[k]
            yi = y[i]
            y[i] = 0.0
            for p in range(l_starts[i], filled[i]):
                y[l_rows[p]] -= l_values[p] * yi
            lji = yi / pivots[i]
            pivot -= lji * yi
            l_rows[filled[i]] = j
            l_values[filled[i]] = lji
            filled[i] += 1
        if not pivot > least:
            pivot = max(pivot, 0.0) + 1.0
            helped[j] = True
        pivots[j] = pivot
    return l_rows, l_values, pivots, helped


@njit(cache=True, nogil=True)
def solve_in_place(
    n: int, l_starts: Array, l_rows: Array, l_values: Array, pivots: Array, right: Array
) -> None:  # pragma: no cover - compiled
    """Solve L D Lᵀ x = b for the columns of b (n, k), in place (MATH 3.1)."""
    width = right.shape[1]
    for j in range(n):
        for p in range(l_starts[j], l_starts[j + 1]):
            i, v = l_rows[p], l_values[p]
            for k in range(width):
                right[i, k] -= v * right[j, k]
    for j in range(n):
        for k in range(width):
            right[j, k] /= pivots[j]
    for j in range(n - 1, -1, -1):
        for p in range(l_starts[j], l_starts[j + 1]):
            i, v = l_rows[p], l_values[p]
            for k in range(width):
                right[j, k] -= v * right[i, k]


@njit(cache=True, nogil=True)
def selected_inverse(
    n: int, l_starts: Array, l_rows: Array, l_values: Array, pivots: Array
) -> Any:  # pragma: no cover - compiled
    """Compute the elements of the inverse in the pattern of L and its diagonal (MATH 3.1).

    Z_ij = -Σ_k Z_ik L_kj for i > j, and Z_jj = 1/d_j - Σ_k Z_kj L_kj, k over the pattern of column j (Takahashi).
    """
    inverse = np.empty(l_starts[n])
    diagonal = np.empty(n)
    sums = np.zeros(n)
    for j in range(n - 1, -1, -1):
        first, last = l_starts[j], l_starts[j + 1]
        for p in range(first, last):
            sums[l_rows[p]] = 0.0
        for p in range(first, last):
            k, lkj = l_rows[p], l_values[p]
            sums[k] += diagonal[k] * lkj
            # rows of column j below k are in the pattern of column k, both sorted: walk along both
            q, end = l_starts[k], l_starts[k + 1]
            for t in range(p + 1, last):
                i = l_rows[t]
                while q < end and l_rows[q] < i:
                    q += 1
                z = inverse[q]
                sums[i] += z * lkj
                sums[k] += z * l_values[t]
        total = 0.0
        for p in range(first, last):
            z = -sums[l_rows[p]]
            inverse[p] = z
            total += z * l_values[p]
        diagonal[j] = 1.0 / pivots[j] - total
    return inverse, diagonal


@njit(cache=True, nogil=True)
def inverse_elements(
    places: Array, l_starts: Array, l_rows: Array, inverse: Array, diagonal: Array, first: Array, second: Array
) -> Any:  # pragma: no cover - compiled
    """Look elements of the selected inverse up; NaN where they are outside the pattern (MATH 3.1)."""
    found = np.empty(len(first))
    for m in range(len(first)):
        i, j = places[first[m]], places[second[m]]
        found[m] = _element(i, j, l_starts, l_rows, inverse, diagonal)
    return found


@njit(cache=True, nogil=True)
def _element(
    i: int, j: int, l_starts: Array, l_rows: Array, inverse: Array, diagonal: Array
) -> float:  # pragma: no cover - compiled
    if i == j:
        return float(diagonal[i])
    if i < j:
        i, j = j, i
    low, high = l_starts[j], l_starts[j + 1]
    while low < high:
        middle = (low + high) // 2
        if l_rows[middle] < i:
            low = middle + 1
        else:
            high = middle
    if low < l_starts[j + 1] and l_rows[low] == i:
        return float(inverse[low])
    return np.nan


@njit(cache=True, nogil=True)
def row_products(
    places: Array,
    l_starts: Array,
    l_rows: Array,
    inverse: Array,
    diagonal: Array,
    scale: Array,
    starts: Array,
    columns: Array,
    values: Array,
    first: Array,
    second: Array,
) -> Any:  # pragma: no cover - compiled
    """Compute a_i Q a_jᵀ for pairs of rows of a sparse matrix whose columns meet in the pattern (MATH 3.1)."""
    found = np.empty(len(first))
    for m in range(len(first)):
        total = 0.0
        for p in range(starts[first[m]], starts[first[m] + 1]):
            i = places[columns[p]]
            part = 0.0
            for q in range(starts[second[m]], starts[second[m] + 1]):
                j = places[columns[q]]
                z = _element(i, j, l_starts, l_rows, inverse, diagonal)
                part += z * values[q] * scale[columns[q]]
            total += part * values[p] * scale[columns[p]]
        found[m] = total
    return found


@njit(cache=True, nogil=True)
def row_squares(
    places: Array,
    l_starts: Array,
    l_rows: Array,
    inverse: Array,
    diagonal: Array,
    scale: Array,
    starts: Array,
    columns: Array,
    values: Array,
    rows: Array,
) -> Any:  # pragma: no cover - compiled
    """Compute a_i Q a_iᵀ for rows of a sparse matrix whose columns meet in the pattern (MATH 3.1)."""
    found = np.empty(len(rows))
    for m in range(len(rows)):
        total = 0.0
        for p in range(starts[rows[m]], starts[rows[m] + 1]):
            i = places[columns[p]]
            part = 0.0
            for q in range(starts[rows[m]], p):
                z = _element(i, places[columns[q]], l_starts, l_rows, inverse, diagonal)
                part += z * values[q] * scale[columns[q]]
            own = values[p] * scale[columns[p]]
            total += (2.0 * part + diagonal[i] * own) * own
        found[m] = total
    return found


@njit(cache=True, nogil=True)
def row_gains(
    places: Array,
    l_starts: Array,
    l_rows: Array,
    inverse: Array,
    diagonal: Array,
    scale: Array,
    starts: Array,
    columns: Array,
    values: Array,
    rows: Array,
    targets: Array,
) -> Any:  # pragma: no cover - compiled
    """Compute elements of Q a_iᵀ at unknowns that meet in row i, (k, t) (MATH 3.1)."""
    found = np.zeros(targets.shape)
    for m in range(len(rows)):
        for t in range(targets.shape[1]):
            target = targets[m, t]
            total = 0.0
            for p in range(starts[rows[m]], starts[rows[m] + 1]):
                z = _element(places[target], places[columns[p]], l_starts, l_rows, inverse, diagonal)
                total += z * values[p] * scale[columns[p]]
            found[m, t] = total * scale[target]
    return found


@njit(cache=True, nogil=True)
def normal_of_blocks(
    sizes: Array, roots: Array, starts: Array, columns: Array, values: Array, count: int
) -> Any:  # pragma: no cover - compiled
    """Sum (F A)ᵀ (F A) of blocks of rows, each as a dense matrix in the columns that it has: (count, count) (MATH 3.1).

    Of each block the number d of its rows, `sizes`, and the d d elements of F, one block after the other, `roots`;
    A is sparse by rows, with its `starts`, `columns` and `values`.
    """
    total = np.zeros((count, count))
    place = np.full(count, -1, np.int64)
    own = np.empty(count, np.int64)
    first, at = 0, 0
    for d in sizes:
        width = 0
        for p in range(starts[first], starts[first + d]):
            if place[columns[p]] < 0:
                place[columns[p]] = width
                own[width] = columns[p]
                width += 1
        derivatives = np.zeros((d, width))
        for row in range(d):
            for p in range(starts[first + row], starts[first + row + 1]):
                derivatives[row, place[columns[p]]] += values[p]
        white = np.dot(roots[at : at + d * d].reshape(d, d), derivatives)
        product = np.dot(white.T, white)
        for i in range(width):
            for j in range(width):
                total[own[i], own[j]] += product[i, j]
        for i in range(width):
            place[own[i]] = -1
        first += d
        at += d * d
    return total
