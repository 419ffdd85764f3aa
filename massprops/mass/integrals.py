"""Integrals of a closed triangle mesh: volume, first and second moments, and how they answer to a moved surface.

A body's ten integrals are kept in one row, in this order: `V, Sx, Sy, Sz, Qxx, Qyy, Qzz, Qxy, Qyz, Qzx`, with
S = int x dV and Qab = int a b dV about the origin of the mesh's axes. Each triangle and the origin span a signed
tetrahedron whose moments are polynomials of its corners (Tonon 2004, "Explicit exact formulas for the 3-D
tetrahedron inertia tensor in terms of its vertex coordinates"); the sum is exact for a closed mesh.
"""

from __future__ import annotations

import numpy as np

PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
"""Axes (a, b) of the six second moments, in the order of the row."""


def mesh_integrals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The ten integrals of a closed, outward-wound mesh.

    Args:
        vertices: (v, 3) [length].
        faces: (f, 3) int.

    Returns:
        (10,) row described in the module, about the origin of the vertices.
    """
    vertices = np.asarray(vertices, float)
    # Summed about the middle of the box: far from the origin the signed tetrahedra would cancel badly.
    middle = 0.5 * (vertices.min(0) + vertices.max(0))
    a, b, c = (vertices[faces[:, i]] - middle for i in range(3))
    six = np.einsum("ij,ij->i", a, np.cross(b, c))
    total = a + b + c
    row = np.empty(10)
    row[0] = six.sum() / 6.0
    row[1:4] = (six[:, None] * total).sum(0) / 24.0
    for k, (i, j) in enumerate(PAIRS):
        corner_products = a[:, i] * a[:, j] + b[:, i] * b[:, j] + c[:, i] * c[:, j]
        row[4 + k] = (six * (corner_products + total[:, i] * total[:, j])).sum() / 120.0
    return shift_integrals(row, middle)


def centroid(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(3,) centre of mass of a closed mesh at constant density; arguments as of `mesh_integrals`."""
    row = mesh_integrals(vertices, faces)
    return row[1:4] / row[0]


def shift_integrals(rows: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Integrals of the same bodies moved by `shift` (3,); rows (..., 10)."""
    rows = np.asarray(rows, float)
    moved = rows.copy()
    volume, first = rows[..., 0], rows[..., 1:4]
    moved[..., 1:4] = first + volume[..., None] * shift
    for k, (i, j) in enumerate(PAIRS):
        cross = first[..., i] * shift[j] + first[..., j] * shift[i]
        moved[..., 4 + k] = rows[..., 4 + k] + cross + volume * shift[i] * shift[j]
    return moved


def scale_integrals(rows: np.ndarray, factor: np.ndarray | float) -> np.ndarray:
    """Integrals (..., 10) of the same bodies with every length times `factor` (scalar or one a row): powers 3, 4 and 5."""
    factor = np.asarray(factor, float)
    powers = np.array([3.0] + [4.0] * 3 + [5.0] * 6)
    return np.asarray(rows, float) * factor[..., None] ** powers


def face_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(f,) areas of the triangles of vertices (v, 3) and faces (f, 3)."""
    corners = np.asarray(vertices, float)[faces]
    return 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)


def offset_response(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(f, 10) change of each integral when a face moves outward by one unit of length (Reynolds' theorem).

    d int g dV = int g d dA for a normal offset d; g is integrated exactly over the triangle with the three mid-edge
    points.
    """
    corners, area = np.asarray(vertices, float)[faces], face_areas(vertices, faces)
    middle = 0.5 * (corners + np.roll(corners, -1, axis=1))
    out = np.empty((len(faces), 10))
    out[:, 0] = area
    out[:, 1:4] = area[:, None] * middle.mean(1)
    for k, (i, j) in enumerate(PAIRS):
        out[:, 4 + k] = area * (middle[:, :, i] * middle[:, :, j]).mean(1)
    return out


def central_inertia(rows: np.ndarray, density: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, centre of mass and inertia about it, tensor signs (`I_xy = -int x y dm`).

    Args:
        rows: (..., 10) integrals.
        density: [mass / length^3].

    Returns:
        mass (...), centre (..., 3), inertia (..., 3, 3) in the mesh's axes.
    """
    rows = np.asarray(rows, float)
    volume = rows[..., 0]
    centre = rows[..., 1:4] / volume[..., None]
    second = np.empty(rows.shape[:-1] + (3, 3))
    for k, (i, j) in enumerate(PAIRS):
        second[..., i, j] = second[..., j, i] = rows[..., 4 + k] - volume * centre[..., i] * centre[..., j]
    trace = np.trace(second, axis1=-2, axis2=-1)
    inertia = density * (trace[..., None, None] * np.eye(3) - second)
    return density * volume, centre, inertia


def hull_corners(vertices: np.ndarray) -> np.ndarray:
    """Indices (k,) of those of places (v, 3) that are corners of their convex hull, in order; of all where they are flat."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(np.unique(ConvexHull(vertices).simplices))
    except QhullError:
        return np.arange(len(vertices))


def greatest_length(vertices: np.ndarray) -> tuple[float, int, int]:
    """The body's diameter: the largest distance between two of the vertices (v, 3), and which two they are.

    This length is the model unit of a run without a scale.
    """
    vertices = np.asarray(vertices, float)
    index = hull_corners(vertices)
    corner = vertices[index]
    away = np.linalg.norm(corner - corner.mean(axis=0), axis=1)
    reach = float(np.linalg.norm(corner - corner[np.argmax(away)], axis=1).max())
    # two that are farther apart than this lie both at least so far from the middle
    index = index[away + away.max() >= reach * (1 - 1e-9)]
    corner = vertices[index]
    x, best, top = corner - corner.mean(axis=0), (-1.0, 0, 0), 0.0
    square_away = (x**2).sum(axis=1)
    for start in range(0, len(corner), 512):
        # quickly for all that come after, and to the last digit for those that may be the farthest
        about = x[start : start + 512] @ (-2.0 * x[start:].T)
        about += square_away[start : start + 512, None]
        about += square_away[start:]
        top = max(top, float(about.max()))
        i, j = np.nonzero(about >= top * (1 - 1e-9))
        square = ((corner[start + i] - corner[start + j]) ** 2).sum(-1)
        if len(square) and square.max() > best[0]:
            k = int(np.argmax(square))
            best = (float(square[k]), int(index[start + i[k]]), int(index[start + j[k]]))
    return float(np.sqrt(best[0])), best[1], best[2]
