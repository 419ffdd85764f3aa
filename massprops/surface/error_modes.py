"""How far a surface may be from the body: smooth modes of error, each with one sigma.

Measured faces err alike over patches of `REACH` of the body's length on one side of it: views of the front of a plate and
of its back are held together by few others, and where their attitudes differ the plate comes out too thin or too thick.

What lies next to measured surface cannot be far off, so an unmeasured face is uncertain in proportion to its distance
from measured surface; of a body whose back may be dark, from that which looks the same way, as the front of a plate does not tell
where its back is. Errors of a fill have two parts: the same habit everywhere (the hull too wide for a body with
recesses, too narrow where a side was never lit), and one that differs from place to place. The silhouettes' hull does not
bound them: of simulated bodies with truth, a third to a half of the filled area lay outside what it allows, while the
offset needed over the distance from measured surface had quartiles from -1.1 to 0.9 and medians from -0.7 to 0.6 (eight
bodies, 40 to 95 % measured).
"""

from __future__ import annotations

import numpy as np

from massprops.mass.integrals import face_areas
from massprops.surface.refine import face_normals

SIDE_PIXELS = 0.3
"""Least 1-sigma of the offset of a patch of measured faces [px]. In spacecraft of simulated footage one array was 3 to 9 mm too
thin and the other too thick, where a pixel is 11 and 17 mm."""
COMMON = 0.3
"""1-sigma of the offset common to all unmeasured faces, over their distance from measured surface."""
LOCAL = 0.4
"""1-sigma of the offset that differs from place to place, likewise."""
RECESS = 0.1
"""1-sigma of how far in a side that stands on a plane lies, over its distance from measured surface: nothing of it is below the plane, and a
recess does not show. Bottoms of a box (0), of two tins and a mug (0.02 to 0.1) lie within it; the foot of a plate does not."""
PLANE_PIXELS = 1.0
"""1-sigma of the height of that plane [px]. Of a tin, a bottle, a shoe drawn twice, a strawberry, three figures, three chairs and scissors (Blender) the
lowest place of the mesh was 0.1 to 1.8 px too low, 1.0 in the root mean square."""
OUTLINES = 0.1
"""Share of a chord that stands for the distance from measured surface where nothing but outlines is known. Over their
chords, hulls of silhouettes of ten bodies (lumps, rocks, buses with wings and dishes, 48 views) lay 0.010 to 0.059 too far
out in the mean; `COMMON` of this share is exceeded twofold once in twenty."""
RISES = 0.05
"""Slope of a line from a place on the hull, against the surface there, below which the line leaves the body at once."""
SAMPLES = 2000
"""Places on the hull between which chords are drawn."""
REACH = 0.15
"""Width of the bumps and distance between them, over the body's length."""
MOST_BUMPS = 60
"""Bumps on one surface."""


def measured_modes(
    vertices: np.ndarray, faces: np.ndarray, observed: np.ndarray, length: float, sigma: np.ndarray
) -> np.ndarray:
    """(m, f) outward offsets of the faces, one row for each patch at one sigma; zero for unmeasured faces.

    Args:
        vertices: (v, 3); faces: (f, 3); observed: (f,) bool; length: greatest length of the body.
        sigma: (f,) of each face's offset.
    """
    seen = np.flatnonzero(observed)
    if not len(seen):
        return np.zeros((0, len(faces)))
    middle, normal = vertices[faces[seen]].mean(axis=1), face_normals(vertices, faces[seen])
    reach = REACH * length
    # place and direction together, so that the two sides of a plate are different patches
    bump = _bumps(np.column_stack([middle, 2 * reach * normal]), 0, reach)
    modes = np.zeros((bump.shape[1], len(faces)))
    modes[:, seen] = sigma[seen] * bump.T
    return modes


def fill_modes(
    vertices: np.ndarray,
    faces: np.ndarray,
    observed: np.ndarray,
    length: float,
    inferred: np.ndarray | None = None,
    outlined: np.ndarray | None = None,
) -> np.ndarray:
    """(m, f) outward offsets of the faces, one row for each independent mode of error at one sigma.

    Args:
        vertices: (v, 3); faces: (f, 3); observed: (f,) bool; length: greatest length of the body.
        inferred: (f,) bool, closed at the plane of support (`underside_modes`); none by default.
        outlined: (f,) distance from where outlines lie on the mesh, which is known there, too; None of a body whose back may be dark.

    Returns:
        Zero for measured faces and inferred ones; no rows where there are no others. The first row is common to all; of a body known
        by its outlines alone it can only be inward: the hull holds the body (Laurentini 1994).
    """
    hidden = np.flatnonzero(~observed if inferred is None else ~observed & ~inferred)
    if not len(hidden):
        return np.zeros((0, len(faces)))
    away = _away(vertices, faces, observed, outlined)[hidden]
    bump = _bumps(vertices[faces[hidden]].mean(axis=1), int(np.argmax(away)), REACH * length)
    modes = np.zeros((1 + bump.shape[1], len(faces)))
    modes[0, hidden] = COMMON * away
    modes[1:, hidden] = LOCAL * away * bump.T
    return modes


def underside_modes(
    vertices: np.ndarray,
    faces: np.ndarray,
    observed: np.ndarray,
    inferred: np.ndarray,
    pixel: float,
    outlined: np.ndarray | None = None,
) -> np.ndarray:
    """(2, f) outward offsets of the faces that were closed at the plane of support, zero for all others, at one sigma; no rows where there
    are none. By the first, a recess, they can only be inward; the second is the plane's own height.

    Args:
        pixel: size of a pixel at the object [world units]; all others as those of `fill_modes`.
    """
    if not inferred.any():
        return np.zeros((0, len(faces)))
    away = _away(vertices, faces, observed, outlined)
    return np.stack([np.where(inferred, RECESS * away, 0.0), np.where(inferred, PLANE_PIXELS * pixel, 0.0)])


def _away(vertices: np.ndarray, faces: np.ndarray, observed: np.ndarray, outlined: np.ndarray | None) -> np.ndarray:
    """(f,) distance of each face that was not measured from what tells where it is, 0 for the others; arguments as those of `fill_modes`."""
    hidden = np.flatnonzero(~observed)
    middle, out = vertices[faces].mean(axis=1), np.zeros(len(faces))
    if observed.any():
        if outlined is None:
            away = away_from_measured(middle, observed, face_normals(vertices, faces))
        else:
            away = np.minimum(away_from_measured(middle, observed), outlined[hidden])
    else:
        # what no image shows in outline lies as far in as a side that nothing was measured on, beside what outlines cannot show
        away = np.zeros(len(hidden)) if outlined is None else outlined[hidden]
        away = away + hidden_depth(vertices, faces)[hidden]
    out[hidden] = away
    return out


def away_from_measured(middle: np.ndarray, observed: np.ndarray, normal: np.ndarray | None = None) -> np.ndarray:
    """(k,) distance of each unmeasured face from the nearest of those `observed` (f,) bool; middle: (f, 3) of all faces.

    Args:
        normal: (f, 3); then of those that look to the same side along the axis to which the face looks nearest, if there are any: the
            measured front of a plate does not tell where its back is, however thin it is.
    """
    from scipy.spatial import cKDTree

    seen, hidden = np.flatnonzero(observed), np.flatnonzero(~observed)
    if normal is None:
        return np.asarray(cKDTree(middle[seen]).query(middle[hidden])[0])
    out = np.full(len(hidden), np.inf)
    for axis in np.concatenate([np.eye(3), -np.eye(3)]):
        # a face looks to within 55 degrees of one of the six directions
        facing = np.flatnonzero(normal[hidden] @ axis > np.sqrt(1 / 3) - 1e-9)
        there = seen[normal[seen] @ axis > 0.0]
        if len(facing) and len(there):
            out[facing] = np.minimum(out[facing], cKDTree(middle[there]).query(middle[hidden[facing]])[0])
    nearest = cKDTree(middle[seen]).query(middle[hidden])[0]
    return np.where(np.isfinite(out), out, nearest)


def hidden_depth(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(f,) depth that a recess may have in the hull of silhouettes, on the scale of `fill_modes`.

    Outlines show all of a body but what no line of sight grazes: a recess is spanned by lines that touch the body on
    both sides of it, and lie in its hull (Laurentini 1994). So where the hull bends away on all sides it is the body,
    and where a long line can be drawn in its surface, or out of it again, much may be hidden.
    """
    from scipy.spatial import cKDTree

    middle, normal = vertices[faces].mean(axis=1), face_normals(vertices, faces)
    area = face_areas(vertices, faces)
    pick = np.random.default_rng(18).choice(len(faces), min(SAMPLES, len(faces)), replace=False, p=area / area.sum())
    near = cKDTree(middle).query(middle[pick], min(16, len(faces)))[1]
    up = np.einsum("pk,pki->pi", area[near], normal[near])
    up /= np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-300)
    x, depth = middle[pick], np.zeros(len(pick))
    for i in range(len(pick)):
        line = x - x[i]
        far = np.linalg.norm(line, axis=1)
        chord = far[line @ up[i] >= -RISES * far].max()
        behind = far[(up @ up[i] < -0.3) & (line @ up[i] < 0)]
        # no deeper than the part is thick, at twice the deviation
        depth[i] = min(OUTLINES * chord, behind.min(initial=np.inf) / (2 * COMMON))
    return np.asarray(depth[cKDTree(x).query(middle)[1]])


def _bumps(x: np.ndarray, first: int, reach: float) -> np.ndarray:
    """(n, m) bumps about points chosen farthest from one another, their squares adding up to 1 everywhere."""
    chosen = [first]
    away = np.linalg.norm(x - x[first], axis=1)
    while away.max() > reach and len(chosen) < MOST_BUMPS:
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(x - x[chosen[-1]], axis=1))
    square = np.stack([np.sum((x - x[k]) ** 2, axis=1) for k in chosen], axis=1)
    # the nearest counts one: far from all of them nothing underflows
    bump = np.exp(-0.5 * (square - square.min(axis=1, keepdims=True)) / reach**2)
    return bump / np.linalg.norm(bump, axis=1, keepdims=True)
