"""From registered images and silhouettes to one cloud of measured points."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from massprops.core.parts import Arrays, Parts
from massprops.dense.depthmap import LEAST_WIDTH, DepthMap, Matching, depth_map
from massprops.dense.fusion import Cameras, DensePoints, Maps, fuse
from massprops.dense.noise import denoised
from massprops.dense.patchmatch import UNIQUE
from massprops.dense.select import Sparse, seen_points, select_views
from massprops.errors import NotPossible
from massprops.geometry.facing import facing_points
from massprops.geometry.pixels import box_about
from massprops.geometry.projection import intrinsics, on_pixels, project
from massprops.geometry.vectors import angles_deg
from massprops.views import Views

MOST_PIXELS = 40_000
"""Pixels of the object per reference view; larger images are reduced. Bounds time and memory."""

PARTNERS, FURTHER_PARTNERS = 8, 6
WIDEST_PARTNER, APART = 35.0, 4.0
"""Maps that confirm a map, of the whole ones and of the others: nearest in direction, within the first angle [deg] and farther than the second from it and
from each other: neighbours see the same shadows and err alike."""

MUCH = 0.05
"""Part of a view's object on which nothing agrees, from which on it is looked at in wider windows."""

Image = Callable[[int], tuple[np.ndarray, np.ndarray]]
"""`image(i)`: colour (h, w, 3) uint8 BGR and mask (h, w) uint8 of view i, both undistorted."""


@dataclass(frozen=True)
class Cropped:
    """One view cut to the object: grey (h, w) float32, colour (h, w, 3), mask (h, w) uint8, K (3, 3), noise [grey levels]."""

    grey: np.ndarray
    colour: np.ndarray
    mask: np.ndarray
    K: np.ndarray
    noise: float


def crop(colour: np.ndarray, mask: np.ndarray, K: np.ndarray, factor: float, pad: int = 8) -> Cropped:
    """The part of a view that holds the object, reduced by `factor` (at most 1).

    Raises:
        NotPossible: the mask is empty.
    """
    import cv2

    if not mask.any():
        raise NotPossible("the silhouette of an image is empty: give silhouettes with --masks, or leave that image out")
    about = rows, columns = box_about(mask, pad)
    colour, mask = colour[about], mask[about]
    K = K.copy()
    K[:2, 2] -= columns.start, rows.start
    if factor < 1.0:
        size = (max(8, round(mask.shape[1] * factor)), max(8, round(mask.shape[0] * factor)))
        ratio = np.array([size[0] / mask.shape[1], size[1] / mask.shape[0]])
        colour = cv2.resize(colour, size, interpolation=cv2.INTER_AREA)
        mask = cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST)
        K[0] *= ratio[0]
        K[1] *= ratio[1]
        K[:2, 2] += 0.5 * ratio - 0.5
    grey = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY).astype(np.float32)
    grey, noise = denoised(grey, mask)
    return Cropped(grey, colour, mask, K, noise)


@dataclass(frozen=True)
class DenseOptions:
    """How dense points are made.

    Attributes:
        most_references: largest number of depth maps; 0 for the default.
        seed: of the random steps.
        threads: processor threads; the result does not depend on them.
        pixels: of the object per view, at most.
        tentative: for a first shape, which wrong depths do less harm to than missing ones: those that fit as well elsewhere stay,
            and what nothing agrees on is not looked at again.
    """

    most_references: int = 0
    seed: int = 0
    threads: int = 2
    pixels: int = MOST_PIXELS
    tentative: bool = False


@dataclass(frozen=True)
class _Scene:
    """What the depth maps are made of.

    Attributes:
        views, sparse: as given.
        cut: views cut to the object and reduced by `factor`, by their index.
        reference: (r,) indices of the views that get a depth map; whole: (r,) bool, which of them a whole one.
        sources: per reference, the views that it is matched with.
        depths: (r, 2) nearest, farthest.
        unique: how much worse other depths must fit, over the cost.
    """

    views: Views
    sparse: Sparse
    cut: dict[int, Cropped]
    factor: float
    reference: np.ndarray
    whole: np.ndarray
    sources: tuple[np.ndarray, ...]
    depths: np.ndarray
    unique: float

    @cached_property
    def size(self) -> tuple[int, int]:
        """Rows and columns that hold every cut view."""
        shapes = [c.grey.shape for c in self.cut.values()]
        return max(s[0] for s in shapes), max(s[1] for s in shapes)

    def padded(self, a: np.ndarray) -> np.ndarray:
        """A cut image, filled up with zeros to the common size."""
        pad = [(0, self.size[k] - a.shape[k]) for k in (0, 1)]
        return np.ascontiguousarray(np.pad(a, pad + [(0, 0)] * (a.ndim - 2)))

    @property
    def cameras(self) -> Cameras:
        """Of the references, cut and reduced."""
        K = np.stack([self.cut[i].K for i in self.reference])
        return Cameras(intrinsics(K), self.views.R[self.reference], self.views.t[self.reference])

    def matching(self, n: int, mask: np.ndarray, wide: bool) -> Matching:
        """The n-th reference and its sources; mask: what of it is wanted.

        Weights by brightness keep a window off other surfaces and moving shadows, but also off the surface's own pattern: of a
        solar cell, blue in a white frame, they leave windows of plain blue. Wide ones are as wide as the object's contrast. With
        true cameras, of three images of each body and without a check against other images, the narrow and the wide ones measure
        7 and 60 % of a CubeSat rightly, 37 and 49 % of a printed box, 46 and 60 % of a tin, 34 and 52 % of crinkled foil.
        """
        i = int(self.reference[n])
        mine, group = self.cut[i], [int(s) for s in self.sources[n] if int(s) in self.cut]
        R, t = self.views.R, self.views.t
        return Matching(
            image=self.padded(mine.grey),
            mask=self.padded(mask),
            K=mine.K,
            sources=np.stack([self.padded(self.cut[s].grey) for s in group]),
            Ks=np.stack([self.cut[s].K for s in group]),
            R=np.stack([R[s] @ R[i].T for s in group]),
            t=np.stack([t[s] - R[s] @ R[i].T @ t[i] for s in group]),
            noise=mine.noise,
            width=max(LEAST_WIDTH, float(mine.grey[mine.mask > 0].std())) if wide else LEAST_WIDTH,
            unique=self.unique,
        )

    def wanted(self, n: int, known: DensePoints | None) -> tuple[np.ndarray, np.ndarray]:
        """The n-th reference's mask of what is wanted, and u, v, depth (m, 3) of the points seen there, of the dense
        ones once there are any."""
        i = int(self.reference[n])
        mine = self.cut[i]
        R, t = self.views.R[i], self.views.t[i]
        if known is None:
            uv, depth = project(seen_points(self.sparse, i), mine.K, R, t)
            return mine.mask, np.column_stack([uv, depth])[depth > 0]
        seen = facing_points(known.xyz, known.normal, mine.K, R, t)
        return _unexplained(mine.mask, seen[:, :2]), seen


def _scene(views: Views, image: Image, sparse: Sparse, options: DenseOptions) -> _Scene:
    """Chooses the references, reads their images and cuts them to the object."""
    choice = select_views(views, sparse, options.most_references)
    if len(choice.reference) < 3:
        raise NotPossible(
            "too few views share points at angles of 3 to 26 degrees: take more, overlapping images all round"
        )
    needed = sorted({*choice.reference.tolist(), *(int(s) for group in choice.sources for s in group)})
    raw = {i: image(i) for i in needed}
    area = float(np.median([np.count_nonzero(raw[i][1]) for i in choice.reference]))
    factor = float(min(1.0, np.sqrt(options.pixels / max(area, 1.0))))
    cut = {i: crop(*raw[i], views.K[i], factor) for i in needed if (raw[i][1] > 0).any()}
    keep = np.array([k for k, i in enumerate(choice.reference) if i in cut], np.int64)
    sources = tuple(choice.sources[k] for k in keep)
    unique = 0.0 if options.tentative else UNIQUE
    whole, depths = choice.whole[keep], choice.depths[keep]
    return _Scene(
        views=views,
        sparse=sparse,
        cut=cut,
        factor=factor,
        reference=choice.reference[keep],
        whole=whole,
        sources=sources,
        depths=depths,
        unique=unique,
    )


def dense_points(
    views: Views,
    image: Image,
    sparse: Sparse,
    options: DenseOptions = DenseOptions(),  # noqa: B008
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
    parts: Parts | None = None,
) -> tuple[DensePoints, dict[str, Any]]:
    """Dense points of everything that two confirming depth maps agree on.

    Args:
        views: registered views.
        image: gives the images.
        sparse: points with their observations.
        options: number of depth maps, pixels, seed and threads.
        parts: keep each depth map as soon as it is made.

    Returns:
        (points, facts): facts holds counts and medians.

    Raises:
        NotPossible: no view has two partners at a useful angle, or nothing agrees.
    """
    parts = parts or Parts()
    scene = _scene(views, image, sparse, options)
    reference, whole, r = scene.reference, scene.whole, len(scene.reference)
    shape = (r, *scene.size)
    maps = Maps(np.zeros(shape, np.float32), np.zeros((*shape, 3), np.float32), np.zeros(shape, np.float32))
    colour = [scene.padded(scene.cut[i].colour) for i in reference]
    partners = _partners(views.centres[reference] - np.median(sparse.xyz, axis=0), whole)
    points: DensePoints | None = None
    wanted = done = 0
    turns = [(whole, False), (~whole, False), *([] if options.tentative else [(np.ones(r, bool), True)])]
    with ThreadPoolExecutor(max(1, options.threads)) as pool:
        for turn, wide in turns:
            fresh = False
            for n in np.flatnonzero(turn).tolist():
                i = int(reference[n])
                mask, seen = scene.wanted(n, points)
                if wide and np.count_nonzero(mask > 1) < MUCH * np.count_nonzero(mask):
                    continue
                make = partial(_map, scene, n, mask, seen, options.seed + 7919 * i, pool, wide)
                part = parts.made(f"depth map {i}" + (", wide" if wide else ""), make)
                maps.enter(n, part, scene.padded(mask) > 1 if wide else None)
                wanted += 0 if wide else int(np.count_nonzero(mask > 1))
                fresh = True
                done += not wide
                progress(done, r, "depth maps")
            if fresh:
                use = turn | whole
                among = [p[use[p]] if use[n] else p[:0] for n, p in enumerate(partners)]
                points = fuse(maps, scene.cameras, colour, among, reference)
    cloud = _enough(points)
    return cloud, _facts(scene, maps, cloud, wanted)


def _facts(scene: _Scene, maps: Maps, cloud: DensePoints, wanted: int) -> dict[str, Any]:
    """Counts and medians; wanted: pixels of which a depth was asked for."""
    return {
        "references": len(scene.reference),
        "image_factor": round(scene.factor, 4),
        "object_pixels": wanted,
        "measured_pixels": int(np.count_nonzero(maps.depth)),
        "points": len(cloud.xyz),
        "median_sigma": float(np.median(cloud.sigma)),
        "median_views": float(np.median(np.diff(cloud.view_start))),
    }


def _enough(points: DensePoints | None) -> DensePoints:
    """The points.

    Raises:
        NotPossible: too few agree.
    """
    count = 0 if points is None else len(points.xyz)
    if points is None or count < 500:
        raise NotPossible(f"only {count} surface points agree between views: more texture, light or overlap is needed")
    return points


def _map(
    scene: _Scene, n: int, mask: np.ndarray, seen: np.ndarray, seed: int, pool: ThreadPoolExecutor, wide: bool
) -> Arrays:
    """Depths worth checking, normals and sigmas of the n-th reference."""
    mine, depths = scene.cut[int(scene.reference[n])], tuple(scene.depths[n])
    result = depth_map(scene.matching(n, mask, wide), seen, depths, seed, pool)
    return {"depth": _trusted(result, scene.padded(mine.mask), mine.K), "normal": result.normal, "sigma": result.sigma}


def _partners(sight: np.ndarray, whole: np.ndarray) -> list[np.ndarray]:
    """Per map, the maps that may confirm it; sight (r, 3) from the object to the cameras, whole (r,) bool."""
    angle = angles_deg(sight)
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

    _, rows, columns = on_pixels(uv, mask.shape)
    dots = np.zeros(mask.shape, np.uint8)
    dots[rows, columns] = 1
    known = cv2.morphologyEx(dots, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)) > 0
    want = cv2.morphologyEx(((mask > 0) & ~known).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return np.where(mask > 0, 1 + want, 0).astype(np.uint8)


COST, SLANT = 0.35, 0.17
"""Largest 1 - NCC; least cosine between normal and line of sight (80 deg)."""


def _trusted(result: DepthMap, mask: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Depths worth checking against other maps: matched well, not grazing, not at the silhouette's very rim."""
    import cv2

    h, w = mask.shape
    x, y = (np.arange(w) - K[0, 2]) / K[0, 0], (np.arange(h) - K[1, 2]) / K[1, 1]
    n = result.normal
    facing = -(n[..., 0] * x + n[..., 1] * y[:, None] + n[..., 2]) / np.sqrt(1 + x**2 + y[:, None] ** 2)
    good = (result.depth > 0) & (result.cost < COST) & (facing > SLANT)
    inner = cv2.erode((mask > 0).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return np.where(good & inner, result.depth, 0.0).astype(np.float32)
