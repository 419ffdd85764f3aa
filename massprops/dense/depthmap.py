"""Depth map of one reference view: start from sparse points, coarse then fine."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from massprops.dense import patchmatch as pm
from massprops.dense.curvature import fit_curvature
from massprops.geometry.projection import camera_rows

LEAST_WIDTH = 12.0
"""Grey-level width of the bilateral weights at which windows keep off shadows that move, and off other surfaces."""

NOISE_PX = 0.25
"""One sigma of a match [px], as measured on rendered bodies of known shape."""

COARSE = (0.20, 0.06, 0.02)
FINE = (0.010, 0.003)
"""Relative sizes of the random steps, one entry an iteration, at half and at full size."""


BENT_COST = 0.35
"""Largest 1 - NCC of a depth that tells how the surface bends: that of the depths which are trusted."""

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


@dataclass(frozen=True)
class Matching:
    """A reference view and the views that it is matched with.

    Attributes:
        image: (h, w) float32 grey, reference.
        mask: (h, w) uint8, 0 not the object, 1 the object but no depth wanted (windows may reach into it), 2 and above
            wanted.
        K: (3, 3) of the reference.
        sources: (s, h', w') float32 grey.
        Ks: (s, 3, 3); R: (s, 3, 3), t: (s, 3): from the reference's camera.
        noise: 1-sigma of the grey levels: windows with less contrast than twice this are not matched.
        width: grey levels by which a window's pixels may differ from its middle and still count, at least.
        unique: how much worse other depths must fit, over the cost.
    """

    image: np.ndarray
    mask: np.ndarray
    K: np.ndarray
    sources: np.ndarray
    Ks: np.ndarray
    R: np.ndarray
    t: np.ndarray
    noise: float
    width: float = LEAST_WIDTH
    unique: float = pm.UNIQUE

    def halved(self) -> Matching:
        """The same at half the size."""
        h, w = (n // 2 * 2 for n in self.mask.shape)
        return Matching(
            image=pm.grey_pyramid_half(self.image),
            mask=self.mask[:h:2, :w:2].copy(),
            K=_halved(self.K),
            sources=np.stack([pm.grey_pyramid_half(s) for s in self.sources]),
            Ks=np.stack([_halved(k) for k in self.Ks]),
            R=self.R,
            t=self.t,
            noise=self.noise / 2,
            width=self.width,
            unique=self.unique,
        )

    def of_kernel(self) -> tuple[pm.Reference, pm.Sources, pm.Frame]:
        """The same as the kernels take it."""
        rows, columns = self.sources.shape[1:]
        cameras, K = camera_rows(self.Ks, self.R, self.t), self.K
        ray = (1 / K[0, 0], -K[0, 2] / K[0, 0], 1 / K[1, 1], -K[1, 2] / K[1, 1])
        frame = pm.Frame(ray, rows, columns, *thresholds(self.noise, self.width), self.unique)
        return pm.Reference(self.image, self.mask), pm.Sources(pm.paired(self.sources), cameras), frame


def depth_map(
    matching: Matching, sparse: np.ndarray, depths: tuple[float, float], seed: int, pool: Executor
) -> DepthMap:
    """Depth and normal of every pixel of the mask that is wanted.

    Args:
        matching: the images and their cameras.
        sparse: (m, 3) u, v, depth of sparse points seen here.
        depths: nearest and farthest.
        seed: of the random steps.
        pool: threads.
    """
    half = matching.halved()
    half_sparse = np.column_stack([(sparse[:, :2] - 0.5) / 2, sparse[:, 2]])
    depth, normal = _start(half.mask, half.K, half_sparse, depths, seed)
    planes = pm.Planes(depth, normal, np.full(half.mask.shape, -1.0, np.float32))
    _iterate(half.of_kernel(), planes, depths, seed, COARSE, 2, pool)
    shape = matching.mask.shape
    depth, normal = _doubled(depth, shape), _doubled(normal, shape)
    _shift_to_pixel(depth, normal, half.K, matching.K)
    planes = pm.Planes(depth, normal, np.full(shape, -1.0, np.float32))
    reference, sources, frame = given = matching.of_kernel()
    _iterate(given, planes, depths, seed + 1, FINE, 1, pool)
    sigma = np.zeros_like(depth)
    bent = np.zeros((*shape, 3), np.float32)
    known = np.where(planes.cost < BENT_COST, depth, 0).astype(np.float32)
    _by_rows(pool, fit_curvature, shape[0], known, matching.mask > 1, bent)
    _by_rows(pool, pm.polish, shape[0], reference, planes, bent, sources, frame, sigma, NOISE_PX)
    lost = (matching.mask < 2) | (planes.cost >= 1.0) | (planes.cost < 0) | (sigma <= 0)
    depth[lost] = 0.0
    return DepthMap(depth, normal, planes.cost, sigma)


def _halved(K: np.ndarray) -> np.ndarray:
    """Camera matrix at half size, centres of pixels at whole numbers."""
    out = K.copy()
    out[:2] *= 0.5
    out[:2, 2] -= 0.25
    return out


def thresholds(noise: float, least: float = LEAST_WIDTH) -> tuple[float, float]:
    """Grey-level width of the bilateral weights, at least `least`, and the variance below which there is no texture, by the
    noise."""
    return max(least, 6.0 * noise), max((1.6 * noise) ** 2, 0.3)


def _iterate(
    given: tuple[pm.Reference, pm.Sources, pm.Frame],
    planes: pm.Planes,
    depths: tuple[float, float],
    seed: int,
    scales: tuple[float, ...],
    reach: int,
    pool: Executor,
) -> None:
    """PatchMatch in place, an iteration for each size of random step."""
    reference, sources, frame = given
    for iteration, scale in enumerate(scales):
        steps = pm.Steps(*depths, iteration, seed, scale, 3, reach)
        for colour in (0, 1):
            _by_rows(pool, pm.sweep, len(reference.image), reference, planes, sources, frame, steps, colour)


def _by_rows(pool: Executor, kernel: Any, rows: int, *rest: Any) -> None:
    """A kernel on all rows, band by band: within one colour no pixel reads what another writes."""
    edges = np.linspace(0, rows, BANDS + 1).astype(int).tolist()
    list(pool.map(lambda band: kernel(*rest, *band), pairwise(edges)))


def _start(
    mask: np.ndarray, K: np.ndarray, sparse: np.ndarray, depths: tuple[float, float], seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Depth of the nearest sparse point, with a spread; normals towards the camera, with a spread; 0 off the mask."""
    rng = np.random.default_rng(seed)
    h, w = mask.shape
    v, u = np.nonzero(mask)
    depth = np.zeros((h, w), np.float32)
    if len(sparse) >= 3:
        near = _nearest(mask, sparse[:, :2])[v // 2, u // 2]
        pick = near[np.arange(len(u)), rng.integers(0, near.shape[1], len(u))]
        start = sparse[pick, 2] + 0.03 * (depths[1] - depths[0]) * rng.standard_normal(len(u))
    else:
        start = rng.uniform(*depths, len(u))
    depth[v, u] = np.clip(start, *depths)
    ray = _rays(u, v, K)
    toward = -ray / np.linalg.norm(ray, axis=-1, keepdims=True)
    drawn = toward + 0.5 * rng.standard_normal((h, w, 3))[v, u]
    drawn /= np.linalg.norm(drawn, axis=-1, keepdims=True)
    away = np.einsum("mi,mi->m", drawn, ray) > -0.1
    drawn[away] = toward[away]
    normal = np.zeros((h, w, 3), np.float32)
    normal[v, u] = drawn
    return depth, normal


def _nearest(mask: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Numbers (r, c, k) of the up to four places uv (m, 2) nearest to each 2x2 pixels that the mask (h, w) touches."""
    from scipy.spatial import cKDTree

    touched = np.zeros([(n + 1) // 2 for n in mask.shape], bool)
    v, u = np.nonzero(mask)
    touched[v // 2, u // 2] = True
    y, x = np.nonzero(touched)
    out = np.zeros((*touched.shape, min(4, len(uv))), int)
    out[touched] = cKDTree(uv).query(np.column_stack([2 * x + 0.5, 2 * y + 0.5]), k=out.shape[2])[1]
    return out


def _rays(x: np.ndarray, y: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Lines of sight (m, 3) of pixels (m,), of depth 1."""
    return np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones(len(x))], axis=-1)


def _doubled(field: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    big = field.repeat(2, axis=0).repeat(2, axis=1)
    pad = [(0, shape[0] - big.shape[0]), (0, shape[1] - big.shape[1])] + [(0, 0)] * (field.ndim - 2)
    return np.ascontiguousarray(np.pad(big, pad, mode="edge"))


def _shift_to_pixel(depth: np.ndarray, normal: np.ndarray, half_K: np.ndarray, K: np.ndarray) -> None:
    """Depth of the coarse pixel's plane on each fine pixel's own ray, in place."""
    v, u = np.nonzero(depth)
    pixel_normals = normal[v, u]
    before = np.einsum("mi,mi->m", pixel_normals, _rays(u // 2, v // 2, half_K))
    after = np.einsum("mi,mi->m", pixel_normals, _rays(u, v, K))
    factor = np.clip(np.where(np.abs(after) > 0.05, before / np.where(after == 0, 1, after), 1.0), 0.97, 1.03)
    depth[v, u] *= factor.astype(np.float32)
