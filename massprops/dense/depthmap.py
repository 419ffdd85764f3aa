"""Depth map of one reference view: start from sparse points, coarse then fine."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from massprops.dense import patchmatch as pm

NOISE_PX = 0.25
"""One sigma of a match [px], as measured on rendered bodies of known shape."""

COARSE = (0.20, 0.06, 0.02)
FINE = (0.010, 0.003)
"""Relative sizes of the random steps, one entry an iteration, at half and at full size."""


BANDS = 16
"""Bands of rows that threads work on; any number of threads gives the same result."""


@dataclass(frozen=True)
class DepthMap:
    """Reference view's depth (h, w) [units], 0 where none; normal (h, w, 3) towards the camera, in its axes;
    cost (h, w), 1 - NCC; sigma (h, w) of depth along the ray's z. float32."""

    depth: np.ndarray
    normal: np.ndarray
    cost: np.ndarray
    sigma: np.ndarray


def depth_map(
    image: np.ndarray,
    mask: np.ndarray,
    K: np.ndarray,
    sources: np.ndarray,
    Ks: np.ndarray,
    Rs: np.ndarray,
    ts: np.ndarray,
    sparse: np.ndarray,
    depths: tuple[float, float],
    noise: float,
    seed: int,
    pool: Executor,
) -> DepthMap:
    """Depth and normal of every pixel of the mask that is wanted.

    Args:
        image: (h, w) float32 grey, reference; mask: (h, w) uint8, 0 not the object, 1 the object but no depth wanted
            (windows may reach into it), 2 and above wanted.
        K: (3, 3) of the reference.
        sources: (s, h', w') float32 grey; Ks: (s, 3, 3); Rs (s, 3, 3), ts (s, 3): from the reference's camera.
        sparse: (m, 3) u, v, depth of sparse points seen here.
        depths: nearest and farthest.
        noise: 1-sigma of the grey levels: windows with less contrast than twice this are not matched.
        seed: of the random steps.
        pool: threads.
    """
    half_mask = mask[: mask.shape[0] // 2 * 2 : 2, : mask.shape[1] // 2 * 2 : 2].copy()
    half_image = pm.grey_pyramid_half(image)
    half_sources = np.stack([pm.grey_pyramid_half(s) for s in sources])
    half_K, half_Ks = _halved(K), np.stack([_halved(k) for k in Ks])
    half_sparse = np.column_stack([(sparse[:, :2] - 0.5) / 2, sparse[:, 2]])
    depth, normal = _start(half_mask, half_K, half_sparse, depths, seed)
    cost = np.full(half_mask.shape, -1.0, np.float32)
    _iterate(
        half_image,
        half_mask,
        depth,
        normal,
        cost,
        half_K,
        half_sources,
        half_Ks,
        Rs,
        ts,
        depths,
        noise / 2,
        seed,
        COARSE,
        2,
        pool,
    )
    depth, normal = _doubled(depth, mask.shape), _doubled(normal, mask.shape)
    _shift_to_pixel(depth, normal, half_K, K)
    cost = np.full(mask.shape, -1.0, np.float32)
    _iterate(image, mask, depth, normal, cost, K, sources, Ks, Rs, ts, depths, noise, seed + 1, FINE, 1, pool)
    sigma = np.zeros_like(depth)
    inverse, each = _arguments(K, Ks)
    level, least = thresholds(noise)
    count, sh, sw = sources.shape
    flat = sources.reshape(count, -1)
    _by_rows(
        pool, pm.polish,
        image, mask, depth, normal, cost, sigma, flat, sh, sw, inverse, each, Rs, ts, level, least, NOISE_PX,
    )  # fmt: skip
    lost = (mask < 2) | (cost >= 1.0) | (cost < 0) | (sigma <= 0)
    depth[lost] = 0.0
    return DepthMap(depth, normal, cost, sigma)


def _halved(K: np.ndarray) -> np.ndarray:
    """Camera matrix at half size, centres of pixels at whole numbers."""
    out = K.copy()
    out[:2] *= 0.5
    out[:2, 2] -= 0.25
    return out


def _arguments(K: np.ndarray, Ks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    inverse = np.array([1 / K[0, 0], -K[0, 2] / K[0, 0], 1 / K[1, 1], -K[1, 2] / K[1, 1]])
    each = np.stack([[k[0, 0], k[1, 1], k[0, 2], k[1, 2]] for k in Ks])
    return inverse, each


def thresholds(noise: float) -> tuple[float, float]:
    """Grey-level width of the bilateral weights, and the variance below which there is no texture, by the noise."""
    return max(12.0, 6.0 * noise), max((1.6 * noise) ** 2, 0.3)


def _iterate(image, mask, depth, normal, cost, K, sources, Ks, Rs, ts, depths, noise, seed, steps, reach, pool):  # type: ignore[no-untyped-def]
    inverse, each = _arguments(K, Ks)
    level, least = thresholds(noise)
    count, sh, sw = sources.shape
    flat = sources.reshape(count, -1)
    for iteration, scale in enumerate(steps):
        for colour in (0, 1):
            _by_rows(
                pool, pm.sweep,
                image, mask, depth, normal, cost, flat, sh, sw, inverse, each, Rs, ts,
                depths[0], depths[1], colour, iteration, scale, 3, reach, seed, level, least,
            )  # fmt: skip


def _by_rows(pool: Executor, kernel: Any, image: np.ndarray, *rest: Any) -> None:
    """A kernel on all rows, band by band: within one colour no pixel reads what another writes."""
    edges = np.linspace(0, len(image), BANDS + 1).astype(int).tolist()
    list(pool.map(lambda band: kernel(image, *rest, *band), pairwise(edges)))


def _start(
    mask: np.ndarray, K: np.ndarray, sparse: np.ndarray, depths: tuple[float, float], seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Depth of the nearest sparse point, with a spread; normals towards the camera, with a spread."""
    rng = np.random.default_rng(seed)
    h, w = mask.shape
    v, u = np.nonzero(mask)
    depth = np.zeros((h, w), np.float32)
    if len(sparse) >= 3:
        from scipy.spatial import cKDTree

        near = cKDTree(sparse[:, :2]).query(np.column_stack([u, v]), k=min(4, len(sparse)))[1]
        pick = near[np.arange(len(u)), rng.integers(0, near.shape[1], len(u))]
        start = sparse[pick, 2] + 0.03 * (depths[1] - depths[0]) * rng.standard_normal(len(u))
    else:
        start = rng.uniform(*depths, len(u))
    depth[v, u] = np.clip(start, *depths)
    ray = np.stack(
        [
            (np.arange(w) - K[0, 2]) / K[0, 0] + np.zeros((h, 1)),
            (np.arange(h)[:, None] - K[1, 2]) / K[1, 1] + np.zeros(w),
            np.ones((h, w)),
        ],
        -1,
    )
    normal = -ray / np.linalg.norm(ray, axis=-1, keepdims=True) + 0.5 * rng.standard_normal((h, w, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    away = np.einsum("hwi,hwi->hw", normal, ray) > -0.1
    normal[away] = -ray[away] / np.linalg.norm(ray[away], axis=-1, keepdims=True)
    return depth, normal.astype(np.float32)


def _doubled(field: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    big = field.repeat(2, axis=0).repeat(2, axis=1)
    pad = [(0, shape[0] - big.shape[0]), (0, shape[1] - big.shape[1])] + [(0, 0)] * (field.ndim - 2)
    return np.ascontiguousarray(np.pad(big, pad, mode="edge"))


def _shift_to_pixel(depth: np.ndarray, normal: np.ndarray, half_K: np.ndarray, K: np.ndarray) -> None:
    """Depth of the coarse pixel's plane on each fine pixel's own ray, in place."""
    h, w = depth.shape
    v, u = np.mgrid[0:h, 0:w]

    def rays(x: np.ndarray, y: np.ndarray, k: np.ndarray) -> np.ndarray:
        return np.stack([(x - k[0, 2]) / k[0, 0], (y - k[1, 2]) / k[1, 1], np.ones_like(x, float)], axis=-1)

    before = np.einsum("hwi,hwi->hw", normal, rays(u // 2, v // 2, half_K))
    after = np.einsum("hwi,hwi->hw", normal, rays(u, v, K))
    factor = np.clip(np.where(np.abs(after) > 0.05, before / np.where(after == 0, 1, after), 1.0), 0.97, 1.03)
    depth *= factor.astype(np.float32)
