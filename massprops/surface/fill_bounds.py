"""How far an unmeasured side can be from where it was put: not past the middle of the part behind it, nor past the silhouettes.

Replicates move the faces of a mesh along their normals by what `error_modes` draws. To first order nothing stops a side
from passing through the one behind it: of a thin plate whose back was never lit many replicates then enclosed less than
nothing. A part has two sides, and either may be off: each goes inward by half of the thickness at most. Outward the silhouettes
end it.
"""

from __future__ import annotations

import numpy as np

from massprops.surface.outline_gaps import SILHOUETTE_MARGIN
from massprops.surface.refine import face_normals
from massprops.surface.silhouette import Hull

INWARD = 0.5
"""Of the thickness, by which a side may be further in. It is geometry, not set on anything: two sides that each go further meet."""
ASIDE = 1e-4
"""Of the mesh's extent, from which a ray starts below its face."""
AT_ONCE = 4_000_000
"""Offsets that are worked out at a time, replicates times faces."""


def beyond_bounds(
    mesh: tuple[np.ndarray, np.ndarray], hull: Hull, modes: np.ndarray, drawn: np.ndarray, response: np.ndarray
) -> np.ndarray:
    """(count, 10) what the offsets of replicates beyond their bounds added to the integrals: it is to be taken off.

    Args:
        mesh: vertices (v, 3), faces (f, 3); hull: of the silhouettes.
        modes: (m, f) outward offsets of the faces, one row a mode [world units]; faces that no mode moves are left.
        drawn: (count, m) of each replicate, in sigmas.
        response: (f, 10) change of the integrals for an outward offset of each face.
    """
    moved = np.flatnonzero(modes.any(axis=0))
    out = np.zeros((len(drawn), response.shape[1]))
    if not len(moved):
        return out
    middle, normal = mesh[0][mesh[1][moved]].mean(axis=1), face_normals(*mesh)[moved]
    most_in = INWARD * thickness(mesh, moved)
    # where silhouettes do not end within reach of what is drawn they bound nothing
    reach = float(np.abs(modes[:, moved]).sum(axis=0).max())
    room = hull.room(middle, normal, reach)
    most_out = np.where(room > 0.0, room + SILHOUETTE_MARGIN * hull.pixel, np.inf)
    step = max(AT_ONCE // len(moved), 1)
    for first in range(0, len(drawn), step):
        part = slice(first, first + step)
        offset = drawn[part] @ modes[:, moved]
        out[part] = (offset - np.clip(offset, -most_in, most_out)) @ response[moved]
    return out


def thickness(mesh: tuple[np.ndarray, np.ndarray], which: np.ndarray) -> np.ndarray:
    """(k,) how thick the body is under each of the faces `which` (k,) int, against the normal; infinite where nothing is behind."""
    from massprops.native import ray_scene

    vertices, faces = mesh
    inward = -face_normals(vertices, faces[which])
    start = vertices[faces[which]].mean(axis=1) + ASIDE * float(np.ptp(vertices, axis=0).max()) * inward
    rays = np.concatenate([start, inward], axis=1).astype(np.float32)
    return np.asarray(ray_scene(mesh).cast_rays(rays)["t_hit"].numpy(), float)
