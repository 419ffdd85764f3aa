"""A placement as it can be laid onto another: its points, and what its silhouettes and its support say."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from massprops.surface.cloud import Cloud
from massprops.surface.coherence import MOST, TOUCHES, Extent, Witnesses, extent, rim_rays
from massprops.surface.photo_consistency import Photographs
from massprops.surface.silhouette import make_hull
from massprops.surface.tangents import tangent_planes
from massprops.views import Views

RIMS = 800
"""Rim rays of each placement."""
NEED = 3
"""Silhouettes that must agree that a place is empty."""


@dataclass(frozen=True)
class Placed:
    """One placement.

    Attributes:
        cloud: its measured points; colour: (n, 3) theirs.
        extent: how far outside its silhouettes and its support every place is.
        rims: the rays along its silhouettes' rims.
        middle: (3,) of its first shape; shape: (m, 3) points all over that, the side it stood on among them.
        pixel: size of a pixel at the object [world units].
        rim_error: mean distance by which its rims miss its own silhouettes [px]: how far these can be relied on.
        photographs: where the other placement's points are looked for, or None.
        support: (4,) plane that it stood on, its normal up, or None.
        tangents: (m, 4) planes that touch the body, of `tangent_planes`.
    """

    cloud: Cloud
    colour: np.ndarray
    extent: Extent
    rims: Witnesses
    middle: np.ndarray
    shape: np.ndarray
    pixel: float
    rim_error: float
    photographs: Photographs | None = None
    support: np.ndarray | None = None
    tangents: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))


def placed(
    cloud: Cloud,
    colour: np.ndarray,
    views: Views,
    masks: list[np.ndarray],
    shape: np.ndarray,
    middle: np.ndarray,
    support: np.ndarray | None,
    seed: int = 0,
) -> Placed:
    """A placement as it can be laid onto another.

    Args:
        cloud, colour: measured points and their colours (n, 3).
        views, masks: its cameras, and (h, w) uint8 silhouettes, undistorted.
        shape: (m, 3) points all over its first shape; middle: (3,) of that.
        support: (4,) plane that it stood on, or None.
        seed: of the rays drawn.
    """
    # points beside the silhouettes must not make these say less
    hull = replace(make_hull(views, masks, cloud.xyz, support=support), need=NEED)
    shape_extent = extent(hull, shape)
    rng = np.random.default_rng([seed, 32])
    rims, every = (rim_rays(views, masks, shape_extent, RIMS, rng, touches) for touches in (TOUCHES, MOST))
    return Placed(
        cloud=cloud,
        colour=colour,
        extent=shape_extent,
        rims=rims,
        middle=middle,
        shape=shape,
        pixel=hull.pixel,
        rim_error=every.rim_error(shape_extent),
        support=support,
        tangents=tangent_planes(views, masks),
    )


def with_silhouettes(side: Placed, views: Views, masks: list[np.ndarray], seed: int = 0) -> Placed:
    """A placement as other silhouettes of its views show it, without photographs; arguments as those of `placed`."""
    return placed(side.cloud, side.colour, views, masks, side.shape, side.middle, side.support, seed)


def picked(xyz: np.ndarray, most: int, rng: np.random.Generator) -> np.ndarray:
    """(k, 3) at most so many of some points (n, 3), drawn without replacement, in their order."""
    return np.ascontiguousarray(xyz[np.sort(rng.permutation(len(xyz))[:most])])
