"""Small dense algebra as plain loops, rows in blocks of four and eight so that numba makes wide instructions of them."""

from __future__ import annotations

import numpy as np

LOST = 1e-13
"""A pivot below this share of its diagonal is rounding, and is held there."""


def add_rows(
    T: np.ndarray,
    row: int,
    first: int,
    width: int,
    A: np.ndarray,
    k: int,
    place: int,
    f: tuple[float, float, float, float],
) -> None:
    """T[row, first : first + width] += f[0] A[k, place :] + f[1] A[k + 1, ...] + f[2] ... + f[3] ..., in one pass.

    T: (a, b); A: (c, d). Indices are unsigned, and rows are not sliced: a check for negative ones, or the counting of references to a
    view, would cost as much as the sum.
    """
    r, a, b = np.uint64(row), np.uint64(first), np.uint64(place)
    k0, k1, k2, k3 = np.uint64(k), np.uint64(k + 1), np.uint64(k + 2), np.uint64(k + 3)
    f0, f1, f2, f3 = f
    for i in range(np.uint64(width)):
        T[r, a + i] += f0 * A[k0, b + i] + f1 * A[k1, b + i] + f2 * A[k2, b + i] + f3 * A[k3, b + i]


def take_rows(T: np.ndarray, row: int, first: int, width: int, A: np.ndarray, k: int, place: int, column: int) -> None:
    """T[row, first : first + width] -= sum over eight rows j from k of A[j, column] A[j, place :]; T: (a, b); A: (c, d)."""
    r, a, b = np.uint64(row), np.uint64(first), np.uint64(place)
    k0, k1, k2, k3 = np.uint64(k), np.uint64(k + 1), np.uint64(k + 2), np.uint64(k + 3)
    k4, k5, k6, k7 = np.uint64(k + 4), np.uint64(k + 5), np.uint64(k + 6), np.uint64(k + 7)
    f0, f1, f2, f3 = A[k0, column], A[k1, column], A[k2, column], A[k3, column]
    f4, f5, f6, f7 = A[k4, column], A[k5, column], A[k6, column], A[k7, column]
    for i in range(np.uint64(width)):
        c = b + i
        one = f0 * A[k0, c] + f1 * A[k1, c] + f2 * A[k2, c] + f3 * A[k3, c]
        two = f4 * A[k4, c] + f5 * A[k5, c] + f6 * A[k6, c] + f7 * A[k7, c]
        T[r, a + i] -= one + two


def add_pairs(T: np.ndarray, row: int, width: int, A: np.ndarray, B: np.ndarray, k: int) -> None:
    """T[row, row : row + width] += sum over four rows j from k of A[j, row] A[j, row :] + B[j, row] B[j, row :]; T: (a, b);
    A, B: (c, d)."""
    r = np.uint64(row)
    k0, k1, k2, k3 = np.uint64(k), np.uint64(k + 1), np.uint64(k + 2), np.uint64(k + 3)
    f0, f1, f2, f3 = A[k0, r], A[k1, r], A[k2, r], A[k3, r]
    g0, g1, g2, g3 = B[k0, r], B[k1, r], B[k2, r], B[k3, r]
    for i in range(np.uint64(width)):
        c = r + i
        one = f0 * A[k0, c] + f1 * A[k1, c] + f2 * A[k2, c] + f3 * A[k3, c]
        two = g0 * B[k0, c] + g1 * B[k1, c] + g2 * B[k2, c] + g3 * B[k3, c]
        T[r, c] += one + two


def upper_factor(T: np.ndarray, rows: int) -> None:
    """First `rows` rows of U with A = U^T U, written over T = [A, B] with zeros below the diagonal; never fails.

    T: (rows or more, rows + b), A its first square; columns beyond the square become U^-T B.
    """
    for i in range(rows):
        original = T[i, i]
        width = T.shape[1] - i
        r = np.uint64(i)
        k = 0
        while k + 8 <= i:
            take_rows(T, i, i, width, T, k, i, i)
            k += 8
        if k + 4 <= i:
            add_rows(T, i, i, width, T, k, i, (-T[k, i], -T[k + 1, i], -T[k + 2, i], -T[k + 3, i]))
            k += 4
        while k < i:
            f, j = T[k, i], np.uint64(k)
            for c in range(np.uint64(width)):
                T[r, r + c] -= f * T[j, r + c]
            k += 1
        pivot = np.sqrt(max(T[i, i], LOST * original, 1e-290))
        inverse = 1.0 / pivot
        for c in range(np.uint64(width)):
            T[r, r + c] *= inverse
        T[i, i] = pivot
        for c in range(i):
            T[i, c] = 0.0


def difference(
    odd: np.ndarray,
    even: np.ndarray,
    row: int,
    first: int,
    last: int,
    plus: np.ndarray,
    minus: np.ndarray,
    middle_point: np.ndarray,
    half: float,
) -> None:
    """Half difference and half sum of a pair of sigma points' measurements, scaled, into columns first to last of a row.

    odd, even: (N + 3, ny); plus, minus, middle_point: (ny,) of the two and of the mean.
    """
    r, a = np.uint64(row), np.uint64(first)
    for i in range(np.uint64(last - first)):
        c = a + i
        odd[r, c] = half * (plus[c] - minus[c])
        even[r, c] = half * (plus[c] + minus[c] - 2.0 * middle_point[c])


def add_to_mean(
    mean: np.ndarray, spread: np.ndarray, odd: np.ndarray, even: np.ndarray, row: int, spreads: bool
) -> None:
    """mean += even[row]; and spread += odd[row]^2 + even[row]^2 when it is wanted; mean, spread: (nu,); odd, even: (N + 3, nu)."""
    r = np.uint64(row)
    for c in range(np.uint64(mean.shape[0])):
        mean[c] += even[r, c]
    if spreads:
        for c in range(np.uint64(mean.shape[0])):
            spread[c] += odd[r, c] * odd[r, c] + even[r, c] * even[r, c]


def middle(values: np.ndarray) -> float:
    """The median of values (n,), for short arrays."""
    n = values.shape[0]
    sorted_values = values.copy()
    for i in range(1, n):
        x = sorted_values[i]
        j = i - 1
        while j >= 0 and sorted_values[j] > x:
            sorted_values[j + 1] = sorted_values[j]
            j -= 1
        sorted_values[j + 1] = x
    return float(0.5 * (sorted_values[(n - 1) // 2] + sorted_values[n // 2]))
