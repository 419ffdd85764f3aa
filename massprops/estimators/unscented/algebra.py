"""Small dense algebra as plain loops, rows in blocks of four and eight so that numba makes wide instructions of them."""

from __future__ import annotations

import numpy as np

LOST = 1e-13
"""A pivot below this share of its diagonal is rounding, and is held there."""


def add_rows(t, A, k, begin, f0, f1, f2, f3):  # type: ignore[no-untyped-def]
    """t += f0 A[k, begin:] + f1 A[k + 1, begin:] + f2 ... + f3 ..., as long as t: four rows in one pass."""
    n = t.shape[0]
    a, b = A[k, begin : begin + n], A[k + 1, begin : begin + n]
    c, d = A[k + 2, begin : begin + n], A[k + 3, begin : begin + n]
    for i in range(n):
        t[i] += f0 * a[i] + f1 * b[i] + f2 * c[i] + f3 * d[i]


def take_rows(t, A, k, begin, column):  # type: ignore[no-untyped-def]
    """t -= sum over eight rows j from k of A[j, column] A[j, begin:], as long as t."""
    n = t.shape[0]
    a, b, c, d = (
        A[k, begin : begin + n],
        A[k + 1, begin : begin + n],
        A[k + 2, begin : begin + n],
        A[k + 3, begin : begin + n],
    )
    e, f, g, h = (
        A[k + 4, begin : begin + n],
        A[k + 5, begin : begin + n],
        A[k + 6, begin : begin + n],
        A[k + 7, begin : begin + n],
    )
    f0, f1, f2, f3 = A[k, column], A[k + 1, column], A[k + 2, column], A[k + 3, column]
    g0, g1, g2, g3 = A[k + 4, column], A[k + 5, column], A[k + 6, column], A[k + 7, column]
    for i in range(n):
        t[i] -= f0 * a[i] + f1 * b[i] + f2 * c[i] + f3 * d[i] + g0 * e[i] + g1 * f[i] + g2 * g[i] + g3 * h[i]


def add_pairs(t, A, B, k, begin, column):  # type: ignore[no-untyped-def]
    """t += sum over four rows j from k of A[j, column] A[j, begin:] + B[j, column] B[j, begin:]."""
    n = t.shape[0]
    a, b = A[k, begin : begin + n], A[k + 1, begin : begin + n]
    c, d = A[k + 2, begin : begin + n], A[k + 3, begin : begin + n]
    e, f = B[k, begin : begin + n], B[k + 1, begin : begin + n]
    g, h = B[k + 2, begin : begin + n], B[k + 3, begin : begin + n]
    f0, f1, f2, f3 = A[k, column], A[k + 1, column], A[k + 2, column], A[k + 3, column]
    g0, g1, g2, g3 = B[k, column], B[k + 1, column], B[k + 2, column], B[k + 3, column]
    for i in range(n):
        t[i] += f0 * a[i] + f1 * b[i] + f2 * c[i] + f3 * d[i] + g0 * e[i] + g1 * f[i] + g2 * g[i] + g3 * h[i]


def upper_factor(T, rows):  # type: ignore[no-untyped-def]
    """First `rows` rows of U with A = U^T U, written over T = [A, B] with zeros below the diagonal; never fails.

    Columns beyond the square become U^-T B.
    """
    for i in range(rows):
        original = T[i, i]
        row = T[i, i:]
        k = 0
        while k + 8 <= i:
            take_rows(row, T, k, i, i)
            k += 8
        if k + 4 <= i:
            add_rows(row, T, k, i, -T[k, i], -T[k + 1, i], -T[k + 2, i], -T[k + 3, i])
            k += 4
        while k < i:
            f, other = T[k, i], T[k, i:]
            for c in range(row.shape[0]):
                row[c] -= f * other[c]
            k += 1
        pivot = np.sqrt(max(T[i, i], LOST * original, 1e-290))
        inverse = 1.0 / pivot
        for c in range(row.shape[0]):
            row[c] *= inverse
        T[i, i] = pivot
        for c in range(i):
            T[i, c] = 0.0


def difference(odd, even, plus, minus, middle, half):  # type: ignore[no-untyped-def]
    """Half difference and half sum of a pair of sigma points' measurements, scaled."""
    for i in range(odd.shape[0]):
        odd[i] = half * (plus[i] - minus[i])
        even[i] = half * (plus[i] + minus[i] - 2.0 * middle[i])


def middle(values):  # type: ignore[no-untyped-def]
    """The median, for short arrays."""
    n = values.shape[0]
    sorted_values = values.copy()
    for i in range(1, n):
        x = sorted_values[i]
        j = i - 1
        while j >= 0 and sorted_values[j] > x:
            sorted_values[j + 1] = sorted_values[j]
            j -= 1
        sorted_values[j + 1] = x
    return 0.5 * (sorted_values[(n - 1) // 2] + sorted_values[n // 2])
