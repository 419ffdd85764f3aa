"""What is seen of a body in its own flat sides, as in a mirror.

Foil and cells reflect a panel that stands before them, and stereo measures the reflection as well as the panel: as far behind the side as the
panel is before it. No line of sight passes a side that was measured, so a point behind one, seen through it, whose mirror image was measured,
too, is no place of the body. Taken for one, it empties the space between.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massprops.surface.cloud import Thinned
from massprops.surface.flat_side import Plane
from massprops.views import Views

BEHIND, NEAR = 2.0, 3.0
"""How far behind a side a point must lie, and how near to its mirror image another was measured [spacings]."""
FACING = 0.0
"""Of a point's mirrored normal with that of its image, at least: those of what crinkled foil reflects scatter by 30 to 60 degrees."""
THROUGH = 0.8
"""Share of a point's lines of sight that must pass the side. Set on one body in foil (Blender, 69)."""


def reflections(thinned: Thinned, views: Views, found: Sequence[tuple[np.ndarray, Plane]]) -> np.ndarray:
    """(m,) bool: points that are reflections of others in a measured flat side.

    Args:
        found: indices of the points of each such side, and its plane.
    """
    from scipy.spatial import Delaunay, cKDTree

    out, tree = np.zeros(len(thinned.xyz), bool), cKDTree(thinned.xyz)
    for own, (normal, offset) in found:
        height = thinned.xyz @ normal - offset
        behind = np.flatnonzero(height < -BEHIND * thinned.spacing)
        image = thinned.xyz[behind] - 2 * height[behind, None] * normal
        facing = thinned.normal[behind] - 2 * (thinned.normal[behind] @ normal)[:, None] * normal
        distance, other = tree.query(image, distance_upper_bound=NEAR * thinned.spacing)
        alike = np.isfinite(distance)
        alike[alike] = (thinned.normal[other[alike]] * facing[alike]).sum(axis=1) > FACING
        behind = behind[alike]
        if not len(behind):
            continue
        base = np.linalg.svd(normal[None])[2][1:]
        outline = Delaunay(thinned.xyz[own] @ base.T)
        point, slot = np.nonzero(thinned.views[behind] >= 0)
        centre = views.centres[thinned.views[behind[point], slot]]
        above, below = centre @ normal - offset, -height[behind[point]]
        share = below / np.where(above > 0, above + below, 1.0)
        at = thinned.xyz[behind[point]] + share[:, None] * (centre - thinned.xyz[behind[point]])
        passes = (above > 0) & (outline.find_simplex(at @ base.T) >= 0)
        count = np.bincount(point, minlength=len(behind))
        out[behind] |= np.bincount(point, passes, len(behind)) >= THROUGH * np.maximum(count, 1)
    return out
