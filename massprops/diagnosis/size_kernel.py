"""The search of `evidence.solve` compiled, for one noise factor and blocks whose sizes stay or are one number each, and its step of a
sparse block's sizes; import it late.

The passes of a diagnosis ask for it some thousands of times with a dozen unknowns, where each step in numpy is mostly calls.
"""

from __future__ import annotations

from math import lgamma

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy")
def searched(
    X: np.ndarray,
    y: np.ndarray,
    G: np.ndarray,
    by: np.ndarray,
    block: np.ndarray,
    begun: np.ndarray,
    believed: float,
    steps: int,
    enough: float,
) -> tuple[bool, float, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Steps of expectation maximisation until one gains less than `enough`.

    Args:
        X: (r, k) columns; y: (r,); G: (k, k) and by: (k,) inner products of the columns with themselves and with y.
        block: (k,) number of the block of one size that an unknown is of, -1 where its size stays; begun: (k + 1,) prior sd where the
            search begins, and the noise factor. believed: as how many rows the noise given counts.

    Returns:
        Whether all stayed finite and every precision positive definite; of the last step the evidence, mean (k,), sizes
        (k + 1,), those that it leads to (k + 1,), and the Cholesky factor (k, k) of the precision over the prior's.
    """
    r, k = X.shape
    at, moved, last = begun.copy(), begun.copy(), 0.0
    mean, second, first, across = np.zeros(k), np.zeros(k), np.zeros(k), np.zeros(k)
    factor, inverse = np.zeros((k, k)), np.zeros((k, k))
    square, evidence = 0.0, 0.0
    for step in range(steps):
        at[:] = moved
        noise = at[k]
        if not _factored(G, at, factor, inverse):
            return False, evidence, mean, at, moved, factor
        _solved(inverse, by, at, mean)
        if step == 0:
            first[:] = mean
            square = _left(X, y, mean, across)
        residual_square, size, gone, taken = square, 0.0, 0.0, 0.0
        for i in range(k):
            gram_change = 0.0
            for j in range(k):
                gram_change += G[i, j] * (mean[j] - first[j])
            residual_square += (gram_change - 2.0 * across[i]) * (mean[i] - first[i])
            size += np.log(factor[i, i])
            gone += (mean[i] / at[i]) ** 2
            share = 0.0
            for j in range(i, k):
                share += inverse[j, i] ** 2
            second[i] = mean[i] ** 2 + at[i] ** 2 * share
            taken += 1.0 - share
        residual_square = max(residual_square, 0.0)
        evidence = -0.5 * gone - size - (r + believed) * np.log(noise)
        evidence -= 0.5 * (residual_square + believed) / noise**2 - 0.5 * believed
        _moved(second, block, moved)
        moved[k] = np.sqrt((residual_square + noise**2 * taken + believed) / (r + believed))
        if not np.isfinite(evidence + moved.sum()):
            return False, evidence, mean, at, moved, factor
        if step > 0 and abs(evidence - last) < enough:
            break
        last = evidence
    return True, evidence, mean, at, moved, factor


@numba.njit(cache=True, error_model="numpy")
def _factored(G: np.ndarray, at: np.ndarray, factor: np.ndarray, inverse: np.ndarray) -> bool:
    """The Cholesky factor (k, k) of the unknowns' precision over their prior's at sizes (k + 1,), and its inverse (k, k), from the
    columns' inner products G (k, k); False where there is none."""
    k = len(G)
    over = at[k] ** -2
    for i in range(k):
        for j in range(i + 1):
            value = over * at[i] * G[i, j] * at[j] + (1.0 if i == j else 0.0)
            for m in range(j):
                value -= factor[i, m] * factor[j, m]
            if i != j:
                factor[i, j] = value / factor[j, j]
            elif value > 0.0:
                factor[i, i] = np.sqrt(value)
            else:
                return False
    for j in range(k):
        inverse[j, j] = 1.0 / factor[j, j]
        for i in range(j + 1, k):
            value = 0.0
            for m in range(j, i):
                value -= factor[i, m] * inverse[m, j]
            inverse[i, j] = value / factor[i, i]
    return True


@numba.njit(cache=True, error_model="numpy")
def _solved(inverse: np.ndarray, by: np.ndarray, at: np.ndarray, mean: np.ndarray) -> None:
    """The likeliest unknowns into `mean` (k,); inverse: (k, k) as of `_factored`; by: (k,); at: (k + 1,) sizes and noise."""
    k = len(by)
    over, half = at[k] ** -2, np.zeros(k)
    for i in range(k):
        for j in range(i + 1):
            half[i] += inverse[i, j] * over * at[j] * by[j]
    for i in range(k):
        mean[i] = 0.0
        for j in range(i, k):
            mean[i] += inverse[j, i] * half[j]
        mean[i] *= at[i]


@numba.njit(cache=True, error_model="numpy")
def _left(X: np.ndarray, y: np.ndarray, mean: np.ndarray, across: np.ndarray) -> float:
    """Squared residuals of y (r,) about unknowns mean (k,) of columns X (r, k), and the columns' inner products with them into `across`
    (k,)."""
    square = 0.0
    across[:] = 0.0
    for i in range(len(y)):
        residual = y[i]
        for j in range(len(mean)):
            residual -= X[i, j] * mean[j]
        square += residual * residual
        for j in range(len(mean)):
            across[j] += X[i, j] * residual
    return square


@numba.njit(cache=True, error_model="numpy")
def _moved(second: np.ndarray, block: np.ndarray, moved: np.ndarray) -> None:
    """Sizes into `moved` (k or more,), of each block the root of its unknowns' mean second moment (k,); block: (k,) as of `searched`."""
    for number in range(block.max() + 1):
        total, count = 0.0, 0
        for i in range(len(block)):
            if block[i] == number:
                total, count = total + second[i], count + 1
        for i in range(len(block)):
            if block[i] == number:
                moved[i] = np.sqrt(max(total / count, 1e-24))


@numba.njit(cache=True, error_model="numpy")
def sparse_moved(
    sd: np.ndarray, second: np.ndarray, fixed: np.ndarray, scale: float, degrees: float
) -> tuple[float, float]:
    """Sizes sd (k,) of a sparse block, in place, to what the unknowns' second moments (k,) say, the first with scales `fixed` (own,) that
    stay.

    Returns:
        What the bound gains over normal unknowns of the sizes before, from the mixture's own law of their precisions; the scale that
        the others lead to.
    """
    gained, total, a = 0.0, 0.0, 0.5 * degrees
    for i in range(len(sd)):
        scale_of_unknown = fixed[i] if i < len(fixed) else scale
        b = a * scale_of_unknown**2
        gained += np.log(sd[i]) + 0.5 * second[i] / sd[i] ** 2
        gained += a * np.log(b) - lgamma(a) - (a + 0.5) * np.log(b + 0.5 * second[i]) + lgamma(a + 0.5)
        precision = (degrees + 1.0) / (degrees * scale_of_unknown**2 + second[i])
        sd[i] = 1.0 / np.sqrt(precision)
        total += precision if i >= len(fixed) else 0.0
    return gained, 1.0 / np.sqrt(total / (len(sd) - len(fixed)))
