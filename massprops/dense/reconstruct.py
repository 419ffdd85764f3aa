"""From registered images and silhouettes to one cloud of measured points."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

from massprops.core.parts import Arrays, Parts
from massprops.dense.fusion import DensePoints, fuse
from massprops.dense.select import select_views
from massprops.errors import NotPossible
from massprops.views import Views

MOST_PIXELS = 40_000
"""Pixels of the object per reference view; larger images are reduced. Bounds time and memory."""

PARTNERS, FURTHER_PARTNERS = 8, 6
WIDEST_PARTNER, APART = 35.0, 4.0
"""Maps that confirm a map, of the whole ones and of the others: nearest in direction, within the first angle [deg] and farther than the second from it and
from each other: neighbours see the same shadows and err alike."""

Image = Callable[[int], tuple[np.ndarray, np.ndarray]]
"""`image(i)`: colour (h, w, 3) uint8 BGR and mask (h, w) uint8 of view i, both undistorted."""


@dataclass(frozen=True)
class Cropped:
    """One view cut to the object: grey (h, w) float32, colour (h, w, 3), mask (h, w) uint8, K (3, 3)."""

    grey: np.ndarray
    colour: np.ndarray
    mask: np.ndarray
    K: np.ndarray


def crop(colour: np.ndarray, mask: np.ndarray, K: np.ndarray, factor: float, pad: int = 8) -> Cropped:
    """The part of a view that holds the object, reduced by `factor` (at most 1).

    Raises:
        NotPossible: the mask is empty.
    """
    import cv2

    rows, columns = np.flatnonzero((mask > 0).any(1)), np.flatnonzero((mask > 0).any(0))
    if len(rows) == 0:
        raise NotPossible("a silhouette is empty")
    top, left = max(rows[0] - pad, 0), max(columns[0] - pad, 0)
    bottom, right = min(rows[-1] + pad + 1, mask.shape[0]), min(columns[-1] + pad + 1, mask.shape[1])
    colour, mask = colour[top:bottom, left:right], mask[top:bottom, left:right]
    K = K.copy()
    K[0, 2] -= left
    K[1, 2] -= top
    if factor < 1.0:
        size = (max(8, round(mask.shape[1] * factor)), max(8, round(mask.shape[0] * factor)))
        ratio = np.array([size[0] / mask.shape[1], size[1] / mask.shape[0]])
        colour = cv2.resize(colour, size, interpolation=cv2.INTER_AREA)
        mask = cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST)
        K[0] *= ratio[0]
        K[1] *= ratio[1]
        K[:2, 2] += 0.5 * ratio - 0.5
    grey = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY).astype(np.float32)
    return Cropped(grey, colour, mask, K)


def grey_noise(grey: np.ndarray, mask: np.ndarray) -> float:
    """1-sigma of pixel noise on the object (Immerkaer 1996): median of a second-difference filter, grey levels."""
    import cv2

    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
    response = np.abs(cv2.filter2D(grey, cv2.CV_32F, kernel))[mask > 0]
    # texture widens the response; the lower quartile of |N(0, 6 sigma)| lies at 0.3186 * 6 sigma
    return float(np.clip(np.percentile(response, 25) / (0.3186 * 6.0), 0.5, 8.0)) if len(response) else 1.0


def dense_points(
    views: Views,
    image: Image,
    xyz: np.ndarray,
    obs_view: np.ndarray,
    obs_point: np.ndarray,
    most_references: int = 0,
    seed: int = 0,
    threads: int = 2,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
    pixels: int = MOST_PIXELS,
    parts: Parts | None = None,
):  # type: ignore[no-untyped-def]
    """Dense points of everything that two confirming depth maps agree on.

    Args:
        views: registered views.
        image: gives the images.
        xyz: (m, 3) sparse points with their observations obs_view, obs_point (k,).
        most_references: largest number of depth maps; 0 for the default.
        seed: of the random steps.
        threads: processor threads; the result does not depend on them.
        pixels: of the object per view, at most.
        parts: keep each depth map as soon as it is made.

    Returns:
        (DensePoints, facts): facts holds counts and medians.

    Raises:
        NotPossible: no view has two partners at a useful angle, or nothing agrees.
    """
    parts = parts or Parts()
    choice = select_views(views, xyz, obs_view, obs_point, most_references)
    if len(choice.reference) < 3:
        raise NotPossible(
            "too few views share points at angles of 3 to 26 degrees: take more, overlapping images all round"
        )
    needed = sorted({*choice.reference.tolist(), *(int(s) for group in choice.sources for s in group)})
    raw = {i: image(i) for i in needed}
    area = float(np.median([np.count_nonzero(raw[i][1]) for i in choice.reference]))
    factor = float(min(1.0, np.sqrt(pixels / max(area, 1.0))))
    cut = {i: crop(*raw[i], views.K[i], factor) for i in needed if (raw[i][1] > 0).any()}
    del raw
    keep = np.array([k for k, i in enumerate(choice.reference) if i in cut], np.int64)
    reference, whole = choice.reference[keep], choice.whole[keep]
    h = max(c.grey.shape[0] for c in cut.values())
    w = max(c.grey.shape[1] for c in cut.values())
    r = len(keep)
    depth, sigma = np.zeros((r, h, w), np.float32), np.zeros((r, h, w), np.float32)
    normal = np.zeros((r, h, w, 3), np.float32)
    K = np.array([[cut[i].K[0, 0], cut[i].K[1, 1], cut[i].K[0, 2], cut[i].K[1, 2]] for i in reference])
    R, t = views.R[reference], views.t[reference]
    colour = [_padded(cut[i].colour, h, w) for i in reference]
    partners = _partners(views.centres[reference] - np.median(xyz, axis=0), whole)
    measured, wanted, done = 0, 0, 0

    def fused(use: np.ndarray) -> DensePoints:
        among = [p[use[p]] if use[n] else p[:0] for n, p in enumerate(partners)]
        return fuse(depth, normal, sigma, colour, K, R, t, among, reference)

    points = None
    with ThreadPoolExecutor(max(1, threads)) as pool:
        for turn in (whole, ~whole):
            for n in np.flatnonzero(turn):
                i, mine = int(reference[n]), cut[int(reference[n])]
                group = [int(s) for s in choice.sources[keep[n]] if int(s) in cut]
                R_rel = np.stack([views.R[s] @ views.R[i].T for s in group])
                t_rel = np.stack([views.t[s] - views.R[s] @ views.R[i].T @ views.t[i] for s in group])
                mask, seen = mine.mask, xyz[obs_point[obs_view == i]]
                if points is not None:
                    facing = np.einsum("ij,ij->i", points.normal, views.centres[i] - points.xyz) > 0
                    seen = points.xyz[facing].astype(float)
                seen = seen @ views.R[i].T + views.t[i]
                seen = seen[seen[:, 2] > 0]
                uv = seen[:, :2] / seen[:, 2:] @ mine.K[:2, :2].T + mine.K[:2, 2]
                if points is not None:
                    mask = _unexplained(mask, uv)
                sources = np.stack([_padded(cut[s].grey, h, w) for s in group])
                asked = (
                    _padded(mine.grey, h, w), _padded(mask, h, w), mine.K, sources,
                    np.stack([cut[s].K for s in group]), R_rel, t_rel, np.column_stack([uv, seen[:, 2]]),
                    tuple(choice.depths[keep[n]]), grey_noise(mine.grey, mine.mask), seed + 7919 * i, pool,
                )  # fmt: skip
                part = parts.made(f"depth map {i}", partial(_map, _padded(mine.mask, h, w), mine.K, asked))
                depth[n], normal[n], sigma[n] = part["depth"], part["normal"], part["sigma"]
                measured += int(np.count_nonzero(depth[n]))
                wanted += int(np.count_nonzero(mask > 1))
                done += 1
                progress(done, r, "depth maps")
            if turn.any():
                points = fused(turn | whole)
    if points is None or len(points.xyz) < 500:
        raise NotPossible(
            f"only {0 if points is None else len(points.xyz)} surface points agree between views: more texture, light or overlap is needed"
        )
    facts = {
        "references": r,
        "image_factor": round(factor, 4),
        "object_pixels": wanted,
        "measured_pixels": measured,
        "points": len(points.xyz),
        "median_sigma": float(np.median(points.sigma)),
        "median_views": float(np.median(np.diff(points.view_start))),
    }
    return points, facts


def _map(mask: np.ndarray, K: np.ndarray, asked: tuple) -> Arrays:
    """Depths worth checking, normals and sigmas of one view; `asked` as `depth_map` takes it."""
    from massprops.dense.depthmap import depth_map

    result = depth_map(*asked)
    return {"depth": _trusted(result, mask, K), "normal": result.normal, "sigma": result.sigma}


def _partners(sight: np.ndarray, whole: np.ndarray) -> list[np.ndarray]:
    """Per map, the maps that may confirm it; sight (r, 3) from the object to the cameras, whole (r,) bool."""
    sight = sight / np.linalg.norm(sight, axis=1, keepdims=True)
    angle = np.degrees(np.arccos(np.clip(sight @ sight.T, -1, 1)))
    out = []
    for n in range(len(sight)):
        both: list[int] = []
        for kind, most in ((whole, PARTNERS), (~whole, FURTHER_PARTNERS)):
            chosen: list[int] = []
            for p in np.argsort(angle[n], kind="stable"):
                if angle[n, p] >= WIDEST_PARTNER or len(chosen) == most:
                    break
                if kind[p] and all(angle[p, q] > APART for q in (n, *chosen)):
                    chosen.append(int(p))
            both += chosen
        out.append(np.array(both, dtype=np.int64))
    return out


def _unexplained(mask: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """The mask with 1 where measured points project already and 2 where a depth is still wanted."""
    import cv2

    h, w = mask.shape
    j, i = np.rint(uv).astype(np.int64).T
    inside = (i >= 0) & (j >= 0) & (i < h) & (j < w)
    dots = np.zeros((h, w), np.uint8)
    dots[i[inside], j[inside]] = 1
    known = cv2.morphologyEx(dots, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)) > 0
    want = cv2.morphologyEx(((mask > 0) & ~known).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return np.where(mask > 0, 1 + want, 0).astype(np.uint8)


def _padded(a: np.ndarray, h: int, w: int) -> np.ndarray:
    return np.ascontiguousarray(np.pad(a, [(0, h - a.shape[0]), (0, w - a.shape[1])] + [(0, 0)] * (a.ndim - 2)))


COST, SLANT = 0.35, 0.17
"""Largest 1 - NCC; least cosine between normal and line of sight (80 deg)."""


def _trusted(result, mask: np.ndarray, K: np.ndarray) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Depths worth checking against other maps: matched well, not grazing, not at the silhouette's very rim."""
    import cv2

    h, w = mask.shape
    x, y = (np.arange(w) - K[0, 2]) / K[0, 0], (np.arange(h) - K[1, 2]) / K[1, 1]
    n = result.normal
    facing = -(n[..., 0] * x + n[..., 1] * y[:, None] + n[..., 2]) / np.sqrt(1 + x**2 + y[:, None] ** 2)
    good = (result.depth > 0) & (result.cost < COST) & (facing > SLANT)
    inner = cv2.erode((mask > 0).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return np.where(good & inner, result.depth, 0.0).astype(np.float32)
