"""Replicates of the body: what its integrals might have been, given everything that is uncertain about its surface.

A surface moved along its normals by d(s) changes the integral of g by int g d dA (Reynolds), so a replicate is a
vector of offsets, one a face, and costs one product of matrices. Each replicate adds

1. resampled views: views are drawn with replacement in blocks of neighbours (block bootstrap, Kuensch 1989), and the
   mean residual of each patch's points is recomputed with the drawn views;
2. a common offset of all measured faces, N(0, `BIAS_PIXELS` of a pixel at the object): matching windows and outlines
   err alike everywhere (of all faces where there are only outlines);
3. the focal length: a symmetric strain with entries N(0, sigma_focal), which is how an error of self-calibration deforms
   a shape whose poses were fitted with it;
4. patches of one side, and unmeasured faces in proportion to their distance from measured surface (`error_modes`).

The greatest length of each replicate is kept beside its integrals, since it is the model unit.
"""

from __future__ import annotations

import numpy as np

from massprops.mass.integrals import PAIRS, mesh_integrals, offset_response
from massprops.surface.error_modes import fill_modes, measured_modes
from massprops.surface.length import model_length
from massprops.surface.reconstruct import Surface
from massprops.surface.refine import face_normals, residuals, vertex_normals
from massprops.views import entries

BIAS_PIXELS = 0.15
PATCHES = 400


def replicates(
    surface: Surface, views: int, focal_sigma: float, count: int = 1000, blocks: int = 12, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Integrals and greatest lengths of `count` bodies that the data allow.

    Args:
        surface: the estimate, with its cloud and hull.
        views: number of views the cloud's lists refer to.
        focal_sigma: relative 1-sigma of the focal length.
        count: replicates.
        blocks: blocks of neighbouring views that are drawn together.
        seed: of the draws.

    Returns:
        rows (count, 10) about the world origin, lengths (count,); units of the reconstruction.
    """
    rng = np.random.default_rng([seed, 14])
    vertices, faces = surface.vertices, surface.faces
    response = offset_response(vertices, faces)
    length, end_a, end_b = model_length(vertices, faces, surface.observed)
    ends = np.array([end_a, end_b])
    direction = (vertices[end_b] - vertices[end_a]) / np.linalg.norm(vertices[end_b] - vertices[end_a])
    pull = np.einsum("ij,j->i", vertex_normals(vertices, faces)[ends], direction) * [-1, 1]
    end_face = np.array([np.flatnonzero((faces == e).any(1))[0] for e in ends])

    rows, lengths = np.tile(mesh_integrals(vertices, faces), (count, 1)), np.full(count, length)
    common = BIAS_PIXELS * surface.hull.pixel * rng.standard_normal(count)
    shown = surface.observed if surface.observed.any() else np.ones(len(faces), bool)
    rows += common[:, None] * response[shown].sum(0)
    lengths += common * pull[shown[end_face]].sum()

    patch = _patches(surface, rng)
    offset = _bootstrap(surface, patch, views, count, blocks, rng)
    patch_response = np.zeros((offset.shape[1], 10))
    seen = patch >= 0
    np.add.at(patch_response, patch[seen], response[seen])
    rows += offset @ patch_response
    for e in (0, 1):
        if patch[end_face[e]] >= 0:
            lengths += offset[:, patch[end_face[e]]] * pull[e]

    of_measured = measured_modes(vertices, faces, surface.observed, length, surface.hull.pixel)
    modes = np.concatenate([of_measured, fill_modes(vertices, faces, surface.observed, length, surface.inferred)])
    drawn = rng.standard_normal((count, len(modes)))
    if not surface.observed.any():
        # a hull holds its body: what it hides is inward
        drawn[:, len(of_measured)] = -np.abs(drawn[:, len(of_measured)])
        drawn[:, len(of_measured) + 1 :] *= 0.5
    rows += drawn @ (modes @ response)
    for e in (0, 1):
        lengths += drawn @ modes[:, end_face[e]] * pull[e]

    # each end is one vertex, as uncertain as the points about it
    lengths += float(np.median(surface.cloud.sigma)) * np.sqrt(2.0) * rng.standard_normal(count)

    strain = focal_sigma * rng.standard_normal((count, 3, 3))
    strain = 0.5 * (strain + strain.transpose(0, 2, 1))
    rows = deform(rows, strain)
    lengths = lengths * (1 + np.einsum("rij,i,j->r", strain, direction, direction))
    return rows, np.maximum(lengths, 0.1 * length)


def deform(rows: np.ndarray, strain: np.ndarray) -> np.ndarray:
    """Integrals (r, 10) of bodies deformed about their centres by x -> (1 + strain) x; strain (r, 3, 3)."""
    matrix = np.eye(3) + strain
    det = np.linalg.det(matrix)
    volume = rows[:, 0]
    centre = rows[:, 1:4] / volume[:, None]
    second = np.empty((len(rows), 3, 3))
    for k, (i, j) in enumerate(PAIRS):
        second[:, i, j] = second[:, j, i] = rows[:, 4 + k] - volume * centre[:, i] * centre[:, j]
    second = det[:, None, None] * (matrix @ second @ matrix.transpose(0, 2, 1))
    out = np.empty_like(rows)
    out[:, 0] = det * volume
    out[:, 1:4] = out[:, :1] * centre
    for k, (i, j) in enumerate(PAIRS):
        out[:, 4 + k] = second[:, i, j] + out[:, 0] * centre[:, i] * centre[:, j]
    return out


def _patches(surface: Surface, rng: np.random.Generator) -> np.ndarray:
    """(f,) which of at most PATCHES patches each measured face belongs to, -1 for the others."""
    from scipy.spatial import cKDTree

    out = np.full(len(surface.faces), -1)
    seen = np.flatnonzero(surface.observed)
    if len(seen):
        middle = surface.vertices[surface.faces[seen]].mean(1)
        # Position and direction together, so that the two sides of a plate are different patches.
        feature = np.column_stack([middle, 10 * surface.spacing * face_normals(surface.vertices, surface.faces)[seen]])
        seeds = feature[rng.permutation(len(seen))[:PATCHES]]
        out[seen] = cKDTree(seeds).query(feature)[1]
    return out


def _bootstrap(
    surface: Surface, patch: np.ndarray, views: int, count: int, blocks: int, rng: np.random.Generator
) -> np.ndarray:
    """(count, patches) change of each patch's mean residual when views are resampled."""
    patches = int(patch.max()) + 1 if (patch >= 0).any() else 0
    if patches == 0:
        return np.zeros((count, 0))
    cloud = surface.cloud
    point, face, distance = residuals(surface.vertices, surface.faces, cloud, 2 * surface.spacing)
    own = patch[face]
    point, distance, own = point[own >= 0], distance[own >= 0], own[own >= 0]
    which, place = entries(cloud.view_start, point)
    share = 1.0 / np.bincount(which, minlength=len(point))[which]
    code = cloud.view_index[place] * patches + own[which]
    total = np.bincount(code, share * distance[which], views * patches).reshape(views, patches)
    weight = np.bincount(code, share, views * patches).reshape(views, patches)
    blocks = min(blocks, views)
    block = np.arange(views) * blocks // views
    drawn = np.stack([np.bincount(d, minlength=blocks) for d in rng.integers(0, blocks, (count, blocks))])
    w = drawn[:, block].astype(float)
    # A patch that a replicate lost keeps its mean: 2 points of no residual.
    middle = total.sum(0) / (weight.sum(0) + 2)
    return (w @ total) / (w @ weight + 2) - middle
