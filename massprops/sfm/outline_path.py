"""Where a body of known attitudes is in each image, by its outlines.

A plane through two camera centres that touches the body leaves a tangent of its outline in both images: the point of touch is
on both outlines (Rieger 1986, "Three-dimensional motion from fixed points of a deforming profile curve"; Wong and Cipolla
2001). With the attitudes given, what is left to find is the path of the centre of mass, on which a free body moves evenly and
straight: five numbers, which some hundreds of such pairs of tangents hold. No feature is needed, and no shape.

What is unlit is no outline. A tangent that faces the Sun in the image is the body's own whatever its shape (see
`massprops.surface.unlit.spare_behind_light`); of the others nothing is asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from massprops.errors import NotPossible
from massprops.geometry.vectors import unit
from massprops.surface.unlit import brighter
from massprops.views import Views

LEAST_TURN, MOST_TURN = 15.0, 140.0
"""Turn between two images of a pair [degree]: nearer ones leave no baseline, and opposite ones look along it."""
PAIRS = 12
"""Pairs an image."""
FACING = 0.2
"""Cosine in the image between a tangent's outward normal and the Sun from which on what is there is lit."""
HELD_OUT = 5
"""One pair in so many has no part in the fit."""
OUTLINE_PX = 1.0
"""1-sigma of a tangent by the pixels of an outline. A path-traced CubeSat with its true attitudes is off by 0.6, a body of plaster with
attitudes known to 0.1 degrees by 0.3."""
FAR = 4.0
"""Error of the held-out tangents over what outlines and attitudes explain from which on the path is not believed. Of a made-up lump it is
0.4 px, and 73 px with the attitudes' axes the wrong way round."""
FEWEST = 30
"""Pairs of tangents without which there is nothing to fit to."""


@dataclass(frozen=True)
class OutlinePath:
    """Places of the body's centre of mass.

    Attributes:
        position: (n, 3) in the camera of each image; the middle of the film is at depth 1.
        error_px: robust standard deviation of the held-out tangents [px].
        tangents: how many had a part in the fit.
    """

    position: np.ndarray
    error_px: float
    tangents: int


@dataclass(frozen=True)
class _Outlines:
    """Convex outlines of n images, filled up to the longest: lines of sight (n, h, 3) in the camera with z = 1, and the direction (2,)
    towards the Sun in the image, or None."""

    sight: np.ndarray
    towards: np.ndarray | None


def outline_path(
    views: Views, masks: Sequence[np.ndarray], grey: Sequence[np.ndarray], time: np.ndarray, sigma: float, seed: int
) -> OutlinePath:
    """The path of a body's centre of mass before a still camera.

    Args:
        views: n images with their attitudes; their places are not read.
        masks: n undistorted silhouettes (h, w), 255 object; grey: the images.
        time: (n,) of each image, in any unit.
        sigma: 1-sigma of the attitudes [rad].
        seed: of the draw of pairs.

    Raises:
        NotPossible: too few outlines, or no such path explains them.
    """
    from scipy.optimize import least_squares

    seen = _outlines(views, masks, grey)
    first, second = _pairs(views.R, seed)
    clock = (time - time.mean()) / max(float(np.ptp(time)), 1e-9)
    middle = np.array([np.argwhere(m == 255)[:, ::-1].mean(axis=0) for m in masks]).mean(axis=0)
    start = np.zeros(5)
    start[:2] = (np.linalg.inv(views.K[0]) @ [*middle, 1.0])[:2]

    def off(p: np.ndarray) -> np.ndarray:
        return _tangent_errors(seen, views, _path(p, clock), first, second)

    used = np.isfinite(off(start))
    fitted = used & (np.arange(len(first)) % HELD_OUT != 0)[:, None]
    if np.count_nonzero(fitted) < FEWEST:
        raise NotPossible(
            f"the outlines of the object's images touch too few common planes ({np.count_nonzero(fitted)}) to tell where it "
            "is; give images from more sides"
        )

    def residual(p: np.ndarray) -> np.ndarray:
        # a tangent that leaves the side of the Sun during the fit pulls no more
        return np.nan_to_num(off(p)[fitted] / OUTLINE_PX)

    fit = least_squares(residual, start, loss="cauchy", x_scale=0.1)
    held = off(fit.x)[used & ~fitted]
    error = float(np.nanmedian(np.abs(held)) / 0.6745)
    size = float(np.median([np.sqrt(np.count_nonzero(m == 255)) for m in masks]))
    explained = float(np.hypot(OUTLINE_PX, sigma * size))
    if not error < FAR * explained:
        raise NotPossible(
            f"the attitudes do not fit the outlines: tangents of two images that should meet are {error:.1f} px apart, where "
            f"outlines and attitudes explain {explained:.1f} px; check that attitude0 turns body axes into the camera's (x right, y "
            "down, z forward), its clock, and that the body moves freely before a still camera"
        )
    return OutlinePath(_path(fit.x, clock), error, int(np.count_nonzero(fitted)))


def _path(p: np.ndarray, clock: np.ndarray) -> np.ndarray:
    """(n, 3) places at the times (n,), which run from -1/2 to 1/2; p: the middle's direction (2,), and what it moves by (3,)."""
    return np.array([p[0], p[1], 1.0]) + np.outer(clock, p[2:])


def _outlines(views: Views, masks: Sequence[np.ndarray], grey: Sequence[np.ndarray]) -> _Outlines:
    import cv2

    corners = []
    for mask in masks:
        parts = cv2.findContours(np.uint8(mask == 255), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
        if not parts:
            raise NotPossible("nothing of the object is lit in one of its images")
        corners.append(cv2.convexHull(max(parts, key=cv2.contourArea))[:, 0].astype(float))
    longest = max(len(c) for c in corners)
    sight = np.ones((len(corners), longest, 3))
    for i, c in enumerate(corners):
        sight[i, :, :2] = np.vstack([c, np.repeat(c[:1], longest - len(c), axis=0)])
    return _Outlines(np.einsum("nij,nhj->nhi", np.linalg.inv(views.K), sight), brighter(list(masks), list(grey)))


def _pairs(R: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (k,) and (k,) of the images of each pair."""
    axis = R[:, 2]
    turn = np.degrees(np.arccos(np.clip(axis @ axis.T, -1, 1)))
    first, second = np.nonzero(np.triu((turn > LEAST_TURN) & (turn < MOST_TURN)))
    kept = np.random.default_rng([seed, 31]).permutation(len(first))[: PAIRS * len(R)]
    return first[kept], second[kept]


def _tangent_errors(
    seen: _Outlines, views: Views, position: np.ndarray, first: np.ndarray, second: np.ndarray
) -> np.ndarray:
    """(k, 2) by how much the two common tangents of each pair miss each other [px]; not a number where nothing is asked.

    Args:
        position: (n, 3) of the body in each camera; first, second: (k,) numbers of the images.
    """
    centre = -np.einsum("nij,ni->nj", views.R, position)
    base = unit(centre[second] - centre[first])
    side = unit(np.cross(base, np.eye(3)[np.abs(base).argmin(axis=1)]))
    other = np.cross(base, side)
    touched = []
    for image in (first, second):
        sight = np.einsum("kji,khj->khi", views.R[image], seen.sight[image])
        around = np.stack([np.einsum("khi,ki->kh", sight, a) for a in (side, other)], axis=-1)
        ahead = np.arctan2(*around.mean(axis=1).T[::-1])
        angle = np.arctan2(around[..., 1], around[..., 0]) - ahead[:, None]
        angle = (angle + np.pi) % (2 * np.pi) - np.pi
        touched.append((angle, ahead))
    out = np.full((len(first), 2), np.nan)
    rows = np.arange(len(first))
    for s, most in enumerate((np.argmin, np.argmax)):
        planes, points, asked = [], [], np.ones(len(first), bool)
        for image, (angle, ahead) in zip((first, second), touched, strict=True):
            corner = most(angle, axis=1)
            at = angle[rows, corner] + ahead
            # of a plane through the baseline, outward from the body
            normal = (-np.sin(at)[:, None] * side + np.cos(at)[:, None] * other) * (1 if s else -1)
            planes.append(normal)
            points.append(seen.sight[image, corner])
            # a baseline that meets the body has no tangents
            asked &= np.ptp(angle, axis=1) < 0.8 * np.pi
            asked &= _faces_the_sun(seen, np.einsum("kij,kj->ki", views.R[image], normal))
        misses = []
        for image, point, plane in zip((first, second), points, planes[::-1], strict=True):
            line = np.einsum("kij,kj->ki", views.R[image], plane)
            focal = views.K[image, 0, 0]
            misses.append(focal * np.einsum("ki,ki->k", line, point) / np.linalg.norm(line[:, :2], axis=1))
        out[:, s] = np.where(asked, 0.5 * (misses[0] - misses[1]), np.nan)
    return out


def _faces_the_sun(seen: _Outlines, normal: np.ndarray) -> np.ndarray:
    """(k,) bool: a tangent whose plane has this outward normal (k, 3) in the camera is lit."""
    if seen.towards is None:
        return np.ones(len(normal), bool)
    flat = normal[:, :2] / np.linalg.norm(normal[:, :2], axis=1)[:, None]
    return np.asarray(flat @ seen.towards > FACING)
