"""A picture of the plane that carries the object, put together from all images.

Each place of the support is seen by many images, and hidden by the object in some of them only. Its colour is the median
over those that see it, each image's light divided out; how far they differ there says how sure it is. What differs from
the picture in an image stands on the support, however dark, thin or plain it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from massprops.capture.support import axes
from massprops.views import Views

Array = np.ndarray

LEAST_SEEN = 5
"""Images that must see a place before its colour is known."""
LEAST_SCATTER = 2.0
"""Least scatter of a place's colour [grey levels]: eight bits and a lens's noise leave no less."""
ROUNDS = 2
COARSER = 2
"""Every second place along each side is enough to learn the light."""
SAMPLE = 5_000
"""Places from which the light of an image is learned."""


@dataclass(frozen=True)
class Grid:
    """Places of a plane, a square of n by n: origin (3,) the first, first and second (3,) the steps along rows and columns."""

    origin: np.ndarray
    first: np.ndarray
    second: np.ndarray
    count: int

    @property
    def step(self) -> float:
        """Between places."""
        return float(np.linalg.norm(self.first))

    def moved(self, R: np.ndarray, t: np.ndarray) -> Grid:
        """The same after x -> R x + t."""
        return Grid(R @ self.origin + t, R @ self.first, R @ self.second, self.count)

    def homography(self, views: Views, i: int) -> np.ndarray:
        """(3, 3) from a place (column, row, 1) to the homogeneous pixel of view i."""
        frame = np.column_stack([self.second, self.first, self.origin])
        return views.K[i] @ (views.R[i] @ frame + np.outer(views.t[i], [0.0, 0.0, 1.0]))

    def ahead(self, views: Views, i: int, shape: tuple[int, int]) -> np.ndarray:
        """(h, w) bool: pixels of view i that look at the plane, and not over its horizon."""
        normal = np.cross(self.first, self.second)
        height = normal @ (views.centres[i] - self.origin)
        row = np.linalg.solve(views.K[i].T, views.R[i] @ normal)
        y, x = np.mgrid[0 : shape[0], 0 : shape[1]]
        return (row[0] * x + row[1] * y + row[2]) * height < 0


def grid_about(plane: np.ndarray, middle: np.ndarray, reach: float, step: float, most: int) -> Grid:
    """Places of a support.

    Args:
        plane: (4,); middle: (3,) above the grid's middle; reach: half its side.
        step: between places, longer where more than `most` along a side would be needed.
    """
    first, second = axes(plane)
    foot = middle - (middle @ plane[:3] + plane[3]) * plane[:3]
    count = min(most, int(np.ceil(2 * reach / step)) + 1)
    step = 2 * reach / (count - 1)
    return Grid(foot - reach * (first + second), step * first, step * second, count)


@dataclass(frozen=True)
class SupportPicture:
    """The support as all images together show it.

    Attributes:
        grid: its places.
        colour: (c, c, 3) float32 BGR, NaN where it is not known.
        scatter: (c, c) float32, median distance in colour of the images from it [grey levels].
        light: (n, 6, 3) logarithm of each image's light over the picture's, as a polynomial of second order in the place.
    """

    grid: Grid
    colour: np.ndarray
    scatter: np.ndarray
    light: np.ndarray

    def of_image(self, i: int) -> SupportPicture:
        """The picture for image i alone."""
        return replace(self, light=self.light[i : i + 1])

    def arrays(self) -> dict[str, np.ndarray]:
        """All of it, by name."""
        grid = {k: np.asarray(getattr(self.grid, k)) for k in ("origin", "first", "second", "count")}
        return grid | {"colour": self.colour, "scatter": self.scatter, "light": self.light}

    @staticmethod
    def of_arrays(held: Mapping[str, np.ndarray], suffix: str = "") -> SupportPicture:
        """From what `arrays` gave, under names with a suffix."""
        origin, first, second, colour, scatter, light = (
            held[k + suffix] for k in ("origin", "first", "second", "colour", "scatter", "light")
        )
        return SupportPicture(Grid(origin, first, second, int(held["count" + suffix])), colour, scatter, light)

    def off(self, views: Views, i: int, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(h, w) float32: how far each pixel of view i is from the support's colour behind it, in its scatters, and that
        scatter [grey levels]; NaN where nothing is known.

        Args:
            views: those the picture was made of; image: (h, w, 3) uint8, undistorted.
        """
        import cv2

        h, w = image.shape[:2]
        H = self.grid.homography(views, i)
        flags = cv2.INTER_LINEAR
        known = np.isfinite(self.colour[..., 0]) & np.isfinite(self.scatter)
        lit = np.where(known[..., None], self.colour, 0.0) * _light(self.light[i], self.grid.count)
        drawn = cv2.warpPerspective(lit.astype(np.float32), H, (w, h), flags=flags)
        scatter = cv2.warpPerspective(np.where(known, self.scatter, 0.0).astype(np.float32), H, (w, h), flags=flags)
        whole = cv2.warpPerspective(known.astype(np.float32), H, (w, h), flags=flags)
        ahead = self.grid.ahead(views, i, (h, w))
        scatter = np.where((whole > 0.99) & ahead, np.maximum(scatter, LEAST_SCATTER), np.nan)
        return np.linalg.norm(_smooth(image) - drawn, axis=2) / scatter, scatter


def picture_of_support(
    views: Views, image: Callable[[int], np.ndarray], grid: Grid, hidden: Callable[[int], np.ndarray]
) -> SupportPicture:
    """The picture from the images in which a place is not known to be hidden.

    Args:
        views: n views; image: `image(i)` is (h, w, 3) uint8, undistorted.
        hidden: `hidden(i)` is (h, w) bool, where the object is known to hide the support in view i.
    """
    count = grid.count
    level = np.zeros((len(views), count, count, 3), np.uint8)
    seen = np.zeros((len(views), count, count), bool)
    for i in range(len(views)):
        level[i], seen[i] = _laid_flat(grid, views, i, image(i), hidden(i))
    light, few = np.zeros((len(views), 6, 3)), (level[:, ::COARSER, ::COARSER], seen[:, ::COARSER, ::COARSER])
    for _ in range(ROUNDS):
        light = _lights(*few, *_medians(*few, light))
    return SupportPicture(grid, *_medians(level, seen, light), light)


def _smooth(image: np.ndarray) -> np.ndarray:
    """The image as float32, a pixel's noise taken out."""
    import cv2

    return cv2.GaussianBlur(image, (0, 0), 0.8).astype(np.float32)


def _laid_flat(
    grid: Grid, views: Views, i: int, image: np.ndarray, hidden: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Colours (c, c, 3) uint8 of the grid's places in view i, and (c, c) bool where it sees them."""
    import cv2

    H, size = grid.homography(views, i), (grid.count, grid.count)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    level = cv2.warpPerspective(cv2.GaussianBlur(image, (0, 0), 0.8), H, size, flags=flags)
    free = cv2.warpPerspective((~hidden).astype(np.float32), H, size, flags=flags)
    x, y = np.meshgrid(np.arange(grid.count), np.arange(grid.count))
    return level, (free > 0.99) & (H[2, 0] * x + H[2, 1] * y + H[2, 2] > 0)


def _terms(count: int) -> np.ndarray:
    """(c, c, 6) terms of second order in the place, from -1 to 1."""
    flat = np.linspace(-1.0, 1.0, count)
    x, y = np.meshgrid(flat, flat)
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)


def _light(light: np.ndarray, count: int) -> np.ndarray:
    """(c, c, 3) factor of one image's light (6, 3)."""
    return np.asarray(np.exp(np.clip(_terms(count) @ light, -1.0, 1.0)))


def _lights(level: np.ndarray, seen: np.ndarray, colour: np.ndarray, scatter: np.ndarray) -> np.ndarray:
    """(n, 6, 3) light of each image, fitted to the places that it shows as the picture has them."""
    n, count = len(level), colour.shape[0]
    terms, out = _terms(count).reshape(-1, 6), np.zeros((n, 6, 3))
    colour_of_place, noise = colour.reshape(-1, 3), scatter.ravel()
    for i in range(n):
        there = np.flatnonzero(seen[i].ravel() & np.isfinite(colour_of_place[:, 0]))
        there = there[:: max(1, len(there) // SAMPLE)]
        if len(there) < 100:
            continue
        ratio = np.log(np.maximum(level[i].reshape(-1, 3)[there], 4.0) / np.maximum(colour_of_place[there], 4.0))
        ratio_noise = np.maximum(noise[there], LEAST_SCATTER) / np.maximum(colour_of_place[there].mean(1), 4.0)
        middle = np.median(ratio, axis=0)
        calm = np.abs(ratio - middle).max(1) < 3.0 * np.median(np.abs(ratio - middle).max(1)) + 0.02
        fit = np.zeros((6, 3))
        fit[0] = middle
        for _ in range(3):
            weight = (calm / ratio_noise)[:, None]
            # a trace of its own size keeps a light that few places show from running away beyond them
            rows = np.concatenate([weight * terms[there], 0.01 * np.sqrt((weight**2).sum()) * np.eye(6)[1:]])
            aim = np.concatenate([weight * ratio, np.zeros((5, 3))])
            fit = np.linalg.lstsq(rows, aim, rcond=None)[0]
            rest = np.abs(ratio - terms[there] @ fit).max(1) / ratio_noise
            calm = rest < 3.0 * max(float(np.median(rest)), 1.0)
        out[i] = fit
    return out


def _medians(level: np.ndarray, seen: np.ndarray, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Colour (c, c, 3) of each place and its scatter (c, c), NaN where fewer than `LEAST_SEEN` images see it."""
    count = level.shape[1]
    colour = np.full((count, count, 3), np.nan, np.float32)
    scatter = np.full((count, count), np.nan, np.float32)
    _places(level, seen, light, LEAST_SEEN, colour, scatter)
    return colour, scatter


@njit(cache=True, error_model="numpy")
def _middle(values: Array, count: int) -> float:
    part = np.sort(values[:count])
    half = count // 2
    if count % 2:
        return float(part[half])
    return 0.5 * float(part[half - 1] + part[half])


@njit(cache=True, error_model="numpy")
def _places(level: Array, seen: Array, light: Array, least: int, colour: Array, scatter: Array) -> None:
    n, rows, columns = seen.shape
    kept = np.empty((3, n), np.float32)
    off = np.empty(n, np.float32)
    for i in range(rows):
        y = 2.0 * i / (rows - 1) - 1.0
        for j in range(columns):
            x = 2.0 * j / (columns - 1) - 1.0
            count = 0
            for v in range(n):
                if seen[v, i, j]:
                    for c in range(3):
                        p = light[v, :, c]
                        e = p[0] + p[1] * x + p[2] * y + p[3] * x * x + p[4] * x * y + p[5] * y * y
                        kept[c, count] = level[v, i, j, c] * np.exp(-min(max(e, -1.0), 1.0))
                    count += 1
            if count < least:
                continue
            for c in range(3):
                colour[i, j, c] = _middle(kept[c], count)
            for k in range(count):
                square = 0.0
                for c in range(3):
                    square += (kept[c, k] - colour[i, j, c]) ** 2
                off[k] = np.sqrt(square)
            scatter[i, j] = _middle(off, count)
