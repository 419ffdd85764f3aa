"""Algebra of symmetric matrices that numbers of several units make up, and where parts of a vector lie."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import accumulate, pairwise

import numpy as np

LARGEST_INVERSE = 1e9
"""Element of an inverse, in units of the diagonal, up to which the plain inverse is as good as any."""


def consecutive(counts: Iterable[int], first: int = 0) -> list[slice]:
    """Slices of so many numbers each, one after the other, from the number `first` on."""
    return [slice(begin, end) for begin, end in pairwise(accumulate(counts, initial=first))]


def inverse_of(normal: np.ndarray) -> np.ndarray:
    """Inverse of symmetric matrices (..., k, k) of mixed units; a direction without information gets none."""
    size = np.einsum("...ii->...i", normal)
    scale = np.sqrt(np.maximum(size, 1e-300))
    both = scale[..., :, None] * scale[..., None, :]
    unit = normal / both
    idle = size <= 0
    unit[..., np.arange(size.shape[-1]), np.arange(size.shape[-1])] += idle
    try:
        done: np.ndarray = np.linalg.inv(unit)
    except np.linalg.LinAlgError:
        done = np.full(unit.shape, np.nan)
    # the pseudo-inverse costs ten times as much, and only nearly singular matrices need it
    poor = ~(np.abs(done).max(axis=(-1, -2), initial=0.0) < LARGEST_INVERSE)
    if poor.any():
        done[poor] = np.linalg.pinv(unit[poor], rcond=1e-12, hermitian=True)
    done[..., np.arange(size.shape[-1]), np.arange(size.shape[-1])] -= idle
    return 0.5 * (done + np.swapaxes(done, -1, -2)) / both


def normalised_square(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """e^T P^-1 e (...) of errors e (..., k) of any units and covariances P (..., k, k)."""
    scale = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 1e-200))
    e = error / scale
    solved = np.linalg.solve(covariance / (scale[..., :, None] * scale[..., None, :]), e[..., None])[..., 0]
    return np.asarray(np.sum(e * solved, axis=-1))


def at_least(covariance: np.ndarray, floor: np.ndarray) -> np.ndarray:
    """`covariance` (p, p), of any units, widened in the directions in which the symmetric `floor` (p, p) is wider."""
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    both = size[:, None] * size
    L = np.linalg.cholesky(covariance / both + 1e-12 * np.eye(len(covariance)))
    half = np.linalg.solve(L, np.linalg.solve(L, floor / both).T)
    value, vector = np.linalg.eigh(0.5 * (half + half.T))
    return np.asarray(L @ (vector * np.maximum(value, 1.0)) @ vector.T @ L.T * both)
