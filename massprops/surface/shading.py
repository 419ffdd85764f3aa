"""The surface of a plain body by how bright it is: given cameras, one still Sun, one paint.

Outlines that face the Sun hold a body only loosely: of a lumpy one, their hull was 11 % larger than its own convex hull. But
every image also shows how steeply the Sun falls on what is lit, and a body that turns is shown under many directions of it
(Horn 1970; with many known lights Woodham 1980). So the hull's surface is moved along its normals until its brightness,
a power of the cosine to the Sun, is that of the images, while its outlines stay on theirs: Gauss-Newton, whose step is
linear in the offset and its slope along the surface. The Sun's direction, its strength and the power (the camera's response)
are fitted with it. The surface is meshed again after each step, so that a crease which is dug into the hull does not fold it.

What no image shows lit is bent as little as possible, which is no measurement: it is told apart (`Shaded.shown`).

Whether that is how the body is lit is asked of images which had no part in the fit: they must be explained so well that one
paint is all there is. What they are still off by, as a slope, is what the surface may be off by over the distance from an outline.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from massprops.core.robust import MAD_TO_SIGMA
from massprops.geometry.interpolation import bilinear
from massprops.geometry.rasterise import rasterise
from massprops.surface.cloud import Cloud
from massprops.surface.meshed_again import meshed_again
from massprops.surface.outline_gaps import OUTLINE_SIGMA, SILHOUETTE_MARGIN, on_outlines
from massprops.surface.refine import mean_matrix, vertex_normals
from massprops.surface.shadow import IN_SHADOW, behind_first
from massprops.views import Views

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

    from massprops.surface.silhouette import Hull

FEWEST, ROUNDS, SETTLED = 8, 40, 0.5
"""Fewest and most rounds of the fit, and root mean square of the offsets of what is shown in one [px] from which on it has settled: meshing again
alone is .3. A body of plaster (Blender), whose hull was 31 % too large, came to that in 14 rounds, and what was shown of it was 1.8 px off."""
ONE_PAINT = 0.06
"""1-sigma of the slope by which left-out images are off [rad] from which on more than one paint is there. Nine bodies of plaster in Blender, whose creases
light each other, have .021 to .032; a drawn one of which one lump is half as bright .17."""
HELD_OUT = 5
"""One view in so many has no part in the fit."""
LEAST_FACING = 0.25
"""Cosine between surface and line of sight below which a pixel shows too much of the surface."""
WHITE = 250
"""Brightness from which on a pixel may be saturated."""
FAR_OUTLINE = 3.0
"""Distance [px] from which on an outline weighs little."""
LEAST_RESIDUAL = 0.02
"""Least scale of the residuals' weights, as a cosine."""
LONGEST_STEP, LONGEST_UNSHOWN = 0.5, 3.0
"""Of an offset in a round, in edges of the mesh, where brightness or an outline shows it, and where bending alone says where it is."""
CLEARLY_LIT = 0.3
"""Cosine to the Sun from which on a place would be seen to be lit: of the dark pixels of a body of plaster none lies on such a place."""
FEWEST_SHOW = 2
"""Views that show a place lit, from which on it is measured."""
BENDS = 0.1
"""1-sigma of the distance of a vertex from the middle of its neighbours, in edges of the mesh: creases are five times that, which
what many views show easily outweighs."""
DAMPED = 1e-6
"""What is added to the matrix's diagonal over its mean: no more than keeps what nothing was seen of in its place."""


@dataclass(frozen=True)
class Shaded:
    """A closed surface (v, 3), (f, 3) that is as bright as the images, and the `slope` that it may be off by: 1-sigma, the
    residual of left-out images as an angle [rad]; `shown`: the views that show each vertex lit, as rows (k, 2) of vertex and view."""

    vertices: np.ndarray
    faces: np.ndarray
    slope: float
    shown: np.ndarray

    def cloud(self, sigma: float) -> Cloud:
        """The places that are shown, with their views; sigma: of each [world units]."""
        order = np.lexsort((self.shown[:, 1], self.shown[:, 0]))
        vertex, view = self.shown[order].T
        count = np.bincount(vertex, minlength=len(self.vertices))
        start = np.concatenate([[0], np.cumsum(count)])
        normal = vertex_normals(self.vertices, self.faces)
        every = Cloud(self.vertices, normal, np.full(len(self.vertices), sigma), start, view)
        return every.take(np.flatnonzero(count >= FEWEST_SHOW))


@dataclass(frozen=True)
class _Samples:
    """What k places on the surface look like: vertex, view (k,), brightness over the sky's (k,) from 0 to 1, its change by a unit
    outward (k,), normal in the camera (k, 3), and whether the place is lit as far as the rest of the surface lets it (k,) and
    counts as lit in the image (k,)."""

    vertex: np.ndarray
    view: np.ndarray
    light: np.ndarray
    change: np.ndarray
    normal: np.ndarray
    free: np.ndarray
    lit: np.ndarray

    def of(self, chosen: np.ndarray) -> _Samples:
        """Those that are chosen (k,) bool."""
        return _Samples(*(getattr(self, name)[chosen] for name in _Samples.__dataclass_fields__))


@dataclass(frozen=True)
class _Film:
    """n views, their silhouettes and images, as for `shaded`, their hull, the length of the mesh's edges, and the sky's brightness."""

    views: Views
    masks: list[np.ndarray]
    grey: list[np.ndarray]
    hull: Hull
    edge: float
    sky: float


def shaded(
    mesh: tuple[np.ndarray, np.ndarray],
    step: float,
    views: Views,
    masks: list[np.ndarray],
    grey: list[np.ndarray],
    towards: np.ndarray,
    hull: Hull,
) -> Shaded | None:
    """The surface that explains how bright the images are; None where images left out are not explained by it, or the fit does
    not settle.

    Args:
        mesh: vertices (v, 3) and faces (f, 3) of the hull; step: of the grid on which it is meshed again [world units], some pixels.
        views: n views of one still camera, in the body's frame.
        masks: n silhouettes (h, w), 255 lit, 0 sky, anything between no evidence; grey: n images (h, w) uint8.
        towards: (2,) direction in the image in which the body gets brighter.
        hull: of the silhouettes, which the body is within.
    """
    at, faces = meshed_again(*mesh, step)
    edge = float(np.linalg.norm(at[faces[:, 0]] - at[faces[:, 1]], axis=1).mean())
    sky = float(np.median(np.concatenate([g[m == 0][::97] for g, m in zip(grey, masks, strict=True)])))
    held = np.arange(len(views)) % HELD_OUT == HELD_OUT // 2
    used_views = np.flatnonzero(~held)
    fitted = views.take(used_views), [masks[i] for i in used_views]
    film = _Film(views, masks, grey, hull, edge, sky)
    light, power = np.append(towards, -1.0), 0.5
    moved = np.inf
    for round_ in range(ROUNDS + 1):
        seen = _samples(at, faces, film, light)
        part = seen.of(~held[seen.view])
        light, power = _light(part, light, power)
        residual, counts = _residual(seen, light, power)
        apart = np.abs(residual[counts & held[seen.view]])
        off = MAD_TO_SIGMA * float(np.median(apart)) if len(apart) else np.inf
        if round_ >= FEWEST and moved < SETTLED * hull.pixel:
            shows = counts & seen.lit
            shown = np.column_stack([seen.vertex[shows], seen.view[shows]])
            return Shaded(at, faces, off, shown) if off < ONE_PAINT else None
        offset, told = _step(at, faces, part, on_outlines(at, faces, *fitted)[:2], film, light, power)
        # a hull holds its body
        offset = np.where(hull.value(at) > 0, np.minimum(offset, 0.0), offset)
        moved = float(np.sqrt(np.mean(offset[told] ** 2))) if told.any() else np.inf
        at, faces = meshed_again(at + offset[:, None] * vertex_normals(at, faces), faces, step)
    return None


def _samples(vertices: np.ndarray, faces: np.ndarray, film: _Film, light: np.ndarray) -> _Samples:
    """What every vertex looks like in every view that shows it."""
    normal, samples = vertex_normals(vertices, faces), []
    views, edge, sky = film.views, film.edge, film.sky
    for i, (mask, image) in enumerate(zip(film.masks, film.grey, strict=True)):
        K, R, t = views.K[i], views.R[i], views.t[i]
        h, w = mask.shape
        camera, n = vertices @ R.T + t, normal @ R.T
        ahead = (camera @ K.T)[:, :2] / camera[:, 2:]
        outward = ((camera + edge * n) @ K.T)[:, :2] / (camera + edge * n)[:, 2:]
        at = np.clip(np.rint(ahead).astype(int), 0, [w - 1, h - 1])
        depth = rasterise(vertices, faces, K, R, t, (w, h))[0][at[:, 1], at[:, 0]]
        facing = -np.einsum("vi,vi->v", n, camera) / np.linalg.norm(camera, axis=1)
        seen = np.flatnonzero((facing > LEAST_FACING) & (camera[:, 2] < depth + edge))
        here, there = (bilinear(image, uv[seen]).astype(float) for uv in (ahead, outward))
        keep = here < WHITE
        free = behind_first(vertices, faces, light @ R) < IN_SHADOW * edge
        lit = mask[at[seen, 1], at[seen, 0]] == 255
        ratio = [np.clip((x - sky) / (WHITE - sky), 0.0, None) for x in (here, there)]
        one = seen, np.full(len(seen), i), ratio[0], ratio[1] - ratio[0], n[seen], free[seen], lit
        samples.append([column[keep] for column in one])
    columns = [np.concatenate(c) for c in zip(*samples, strict=True)]
    columns[3] = columns[3] / edge
    return _Samples(*columns)


def _light(seen: _Samples, light: np.ndarray, power: float) -> tuple[np.ndarray, float]:
    """Light (3,) and power at which lit places are as bright as the images."""
    from scipy.optimize import least_squares

    use = np.flatnonzero(seen.free & seen.lit)
    use = use[:: max(1, len(use) // 20_000)]
    normal, bright = seen.normal[use], seen.light[use]

    def residual(p: np.ndarray) -> np.ndarray:
        return np.asarray(np.maximum(normal @ p[:3], 1e-3) ** np.exp(p[3]) - bright)

    solution = least_squares(residual, [*light, np.log(power)], loss="soft_l1", f_scale=0.02).x
    return solution[:3], float(np.exp(solution[3]))


def _residual(seen: _Samples, light: np.ndarray, power: float) -> tuple[np.ndarray, np.ndarray]:
    """(k,) cosine to the Sun by the image less that of the surface, and (k,) bool which count.

    A dark place that turns away from the Sun is as it should be; what lies in the shadow of the rest says nothing.
    """
    strength = float(np.linalg.norm(light))
    cosine = seen.normal @ light / strength
    apart = seen.light ** (1 / power) / strength - cosine
    return np.where(~seen.lit & (cosine < 0), 0.0, apart), seen.free & (seen.lit | (cosine > 0))


def _step(
    vertices: np.ndarray,
    faces: np.ndarray,
    seen: _Samples,
    outlines: tuple[np.ndarray, np.ndarray],
    film: _Film,
    light: np.ndarray,
    power: float,
) -> tuple[np.ndarray, np.ndarray]:
    """(v,) offsets of the vertices along their normals, by Gauss-Newton, and (v,) bool where brightness or an outline tells them;
    outlines: of `on_outlines`."""
    from scipy.sparse import diags, identity
    from scipy.sparse.linalg import splu

    edge, pixel = film.edge, film.hull.pixel
    size = len(vertices)
    system, wanted = _by_brightness(vertices, faces, seen, film, light, power)
    # outlines
    face, gap = outlines
    certain = np.repeat(1 / (3 * (1 + (gap / FAR_OUTLINE) ** 2) * (OUTLINE_SIGMA * pixel) ** 2), 3)
    corner, out = faces[face].ravel(), np.repeat((gap - SILHOUETTE_MARGIN) * pixel, 3)
    by_outline = np.bincount(corner, certain, size)
    told = (system.diagonal() > 0) | (by_outline > 0)
    system = system + diags(by_outline)
    wanted = wanted + np.bincount(corner, certain * out, size)
    # what is dark where it would be lit is not there
    empty = _empty(seen, light, size) / pixel**2
    system = system + diags(empty)
    wanted = wanted - empty * LONGEST_STEP * edge
    # bending
    mean, normal = mean_matrix(faces, size), vertex_normals(vertices, faces)
    laplacian, drawn = identity(size) - mean, mean @ vertices - vertices
    inward = np.einsum("vi,vi->v", drawn, normal)
    system = system + (laplacian.T @ laplacian) / (BENDS * edge) ** 2
    wanted = wanted + (laplacian.T @ inward) / (BENDS * edge) ** 2
    system = system + DAMPED * system.diagonal().mean() * identity(size)
    # symmetric and positive definite: no pivots are looked for
    factor = splu(system.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    longest = np.where(told, LONGEST_STEP, LONGEST_UNSHOWN) * edge
    return np.clip(factor.solve(wanted), -longest, longest), told


def _empty(seen: _Samples, light: np.ndarray, size: int) -> np.ndarray:
    """(size,) bool: vertices that most views which should show them lit show dark: the hull is open there, or too large."""
    cosine = seen.normal @ light / np.linalg.norm(light)
    should = seen.free & (cosine > CLEARLY_LIT)
    lit, dark = (np.bincount(seen.vertex[should & of], minlength=size) for of in (seen.lit, ~seen.lit))
    return np.asarray(dark > lit)


def _by_brightness(
    vertices: np.ndarray, faces: np.ndarray, seen: _Samples, film: _Film, light: np.ndarray, power: float
) -> tuple[csr_matrix, np.ndarray]:
    """Matrix (v, v) and right side (v,) of the offsets by brightness alone.

    The normal of a surface moved outward by d turns by -grad d, so its cosine to the Sun changes by -sun . grad d.
    """
    from scipy.sparse import bsr_matrix, identity, vstack

    size, strength = len(vertices), float(np.linalg.norm(light))
    residual, counts = _residual(seen, light, power)
    scale = max(MAD_TO_SIGMA * float(np.median(np.abs(residual[counts]))), LEAST_RESIDUAL)
    weight = counts / (1 + (residual / (2.5 * scale)) ** 2) / scale**2
    again = np.clip(seen.light + film.edge * seen.change, 0.0, None)
    change = (again ** (1 / power) - seen.light ** (1 / power)) / (strength * film.edge)
    change = np.clip(change, -0.05 / film.edge, 0.05 / film.edge)
    sun = np.einsum("kji,j->ki", film.views.R[seen.view], light / strength)
    slope = np.column_stack([change, sun])
    normal_matrix, right = np.zeros((size, 4, 4)), np.zeros((size, 4))
    for i in range(4):
        right[:, i] = np.bincount(seen.vertex, weight * slope[:, i] * residual, size)
        for j in range(4):
            normal_matrix[:, i, j] = np.bincount(seen.vertex, weight * slope[:, i] * slope[:, j], size)
    each = bsr_matrix((normal_matrix, np.arange(size), np.arange(size + 1)), shape=(4 * size, 4 * size))
    order = np.column_stack([np.arange(size), size + 3 * np.arange(size)[:, None] + np.arange(3)]).ravel()
    effect = vstack([identity(size), _gradient(vertices, faces)]).tocsr()[order]
    return effect.T @ each @ effect, -(effect.T @ right.ravel())


def _gradient(vertices: np.ndarray, faces: np.ndarray) -> csr_matrix:
    """(3v, v) gradient along the surface of a function on its vertices: the mean of the faces' by area."""
    from scipy.sparse import csr_matrix

    x = vertices[faces]
    side = np.stack([x[:, 2] - x[:, 1], x[:, 0] - x[:, 2], x[:, 1] - x[:, 0]], axis=1)
    normal = np.cross(side[:, 0], side[:, 1])
    twice = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    hat = np.cross((normal / twice[:, None])[:, None], side)
    share = 1 / np.maximum(np.bincount(faces.ravel(), np.repeat(twice, 3), len(vertices)), 1e-300)
    row = 3 * faces[:, :, None, None] + np.arange(3)
    value = share[faces][:, :, None, None] * hat[:, None]
    row, column, value = np.broadcast_arrays(row, faces[:, None, :, None], value)
    shape = 3 * len(vertices), len(vertices)
    return csr_matrix((value.ravel(), (row.ravel(), column.ravel())), shape=shape)
