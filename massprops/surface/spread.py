"""Replicates of the body: what its integrals might have been, given everything that is uncertain about its surface.

A surface moved along its normals by d(s) changes the integral of g by int g d dA (Reynolds), so a replicate is a
vector of offsets, one a face, and costs one product of matrices. Each replicate adds

1. resampled views: views are drawn with replacement in blocks of neighbours (block bootstrap, Kuensch 1989), and the
   mean residual of each patch's points is recomputed with the drawn views;
2. a common offset of all measured faces, N(0, `BIAS_PIXELS` of a pixel at the object): matching windows and outlines
   err alike everywhere;
3. the focal length: a symmetric strain with entries N(0, sigma_focal), which is how an error of self-calibration deforms
   a shape whose poses were fitted with it;
4. unmeasured faces, coherent over each connected patch and half so between patches: a draw of where the patch lies between the smallest body
   that the measurements allow and the hull of the silhouettes.

The greatest length of each replicate is kept beside its integrals, since it is the model unit.
"""

from __future__ import annotations

import numpy as np

from massprops.mass.integrals import PAIRS, mesh_integrals, model_length, offset_response
from massprops.surface.reconstruct import Surface
from massprops.surface.refine import face_normals, residuals, vertex_normals

BIAS_PIXELS = 0.15
PATCHES = 400
MARGIN_PIXELS = 0.5
BULGE = 0.7
"""Farthest that an unmeasured face may lie off, over its distance from measured surface."""


def replicates(
    surface: Surface, views: int, focal_sigma: float, count: int = 400, blocks: int = 12, seed: int = 0
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
    own = mesh_integrals(vertices, faces)
    response = offset_response(vertices, faces)
    length, end_a, end_b = model_length(vertices, faces, surface.observed)
    ends = np.array([end_a, end_b])
    direction = (vertices[end_b] - vertices[end_a]) / length
    pull = np.einsum("ij,j->i", vertex_normals(vertices, faces)[ends], direction) * [-1, 1]
    end_face = np.array([np.flatnonzero((faces == e).any(1))[0] for e in ends])

    rows, lengths = np.tile(own, (count, 1)), np.full(count, length)
    common = BIAS_PIXELS * surface.hull.pixel * rng.standard_normal(count)
    rows += common[:, None] * response[surface.observed].sum(0)
    lengths += common * pull[surface.observed[end_face]].sum()

    patch = _patches(surface, rng)
    offset = _bootstrap(surface, patch, views, count, blocks, rng)
    patch_response = np.zeros((offset.shape[1], 10))
    seen = patch >= 0
    np.add.at(patch_response, patch[seen], response[seen])
    rows += offset @ patch_response
    for e in (0, 1):
        if patch[end_face[e]] >= 0:
            lengths += offset[:, patch[end_face[e]]] * pull[e]

    inward, outward = unseen_bounds(surface)
    # the same habits of filling err the same way everywhere: half of the variance is common to all parts
    shared = rng.uniform(-1, 1, count)
    for part in _unseen_parts(surface):
        draw = np.clip((shared + rng.uniform(-1, 1, count)) / np.sqrt(2.0), -1, 1)[:, None]
        low, high = (
            (response[part] * inward[part, None]).sum(0),
            (response[part] * outward[part, None]).sum(0),
        )
        rows += np.where(draw < 0, -draw * low, draw * high)
        for e in (0, 1):
            if end_face[e] in part:
                bound = np.where(draw[:, 0] < 0, inward[end_face[e]], outward[end_face[e]])
                lengths += np.abs(draw[:, 0]) * bound * pull[e]

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


def unseen_bounds(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    """How far each unmeasured face may lie inward (f,) <= 0 and outward (f,) >= 0; zero where it was measured."""
    from scipy.spatial import cKDTree

    hidden = np.flatnonzero(~surface.observed)
    inward, outward = np.zeros(len(surface.faces)), np.zeros(len(surface.faces))
    if len(hidden) == 0:
        return inward, outward
    middle = surface.vertices[surface.faces[hidden]].mean(1)
    normal = face_normals(surface.vertices, surface.faces)[hidden]
    floor = MARGIN_PIXELS * surface.hull.pixel
    depth = cKDTree(surface.smallest).query(middle)[0]
    # A nearest distance counts vertices of the same surface as far as half a spacing.
    # The smallest body has the least area, and need not have the least volume.
    # A gap in measured surface cannot bulge by more than a part of its own width.
    seen = np.flatnonzero(surface.observed)
    bulge = np.full(len(hidden), np.inf)
    if len(seen):
        bulge = BULGE * cKDTree(surface.vertices[surface.faces[seen]].mean(1)).query(middle)[0]
    # Nor is the smallest body the smallest there: lines of sight end at the rim of a crease.
    least = np.maximum(
        np.minimum(1.25 * depth - 0.25 * surface.spacing, bulge), 0.5 * np.where(np.isfinite(bulge), bulge, 0)
    )
    inward[hidden] = -np.maximum(least, floor)
    reach = np.linalg.norm(np.ptp(surface.vertices, axis=0))
    height = np.zeros(len(hidden))
    going = np.ones(len(hidden), bool)
    step = 0.25 * surface.spacing
    while going.any() and step < 0.5 * reach:
        index = np.flatnonzero(going)
        ok = surface.hull.value(middle[index] + (height[index] + step)[:, None] * normal[index]) < 0
        height[index[ok]] += step
        going[index[~ok]] = False
        step *= 1.3
    outward[hidden] = np.maximum(np.minimum(height, bulge), floor)
    return inward, outward


def _unseen_parts(surface: Surface) -> list[np.ndarray]:
    """Faces of each connected unmeasured part."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    hidden = np.flatnonzero(~surface.observed)
    if len(hidden) == 0:
        return []
    faces = surface.faces[hidden]
    size = len(surface.vertices)
    i, j = faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel()
    label = connected_components(coo_matrix((np.ones(len(i)), (i, j)), shape=(size, size)), directed=False)[1]
    own = label[faces[:, 0]]
    return [hidden[own == k] for k in np.unique(own)]


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
    seen_by = np.diff(cloud.view_start)[point]
    which = np.repeat(cloud.view_start[point] - np.concatenate([[0], np.cumsum(seen_by)[:-1]]), seen_by)
    view = cloud.view_index[which + np.arange(seen_by.sum())]
    share = 1.0 / np.repeat(seen_by, seen_by)
    code = view * patches + np.repeat(own, seen_by)
    total = np.bincount(code, share * np.repeat(distance, seen_by), views * patches).reshape(views, patches)
    weight = np.bincount(code, share, views * patches).reshape(views, patches)
    blocks = min(blocks, views)
    block = np.arange(views) * blocks // views
    drawn = np.stack([np.bincount(d, minlength=blocks) for d in rng.integers(0, blocks, (count, blocks))])
    w = drawn[:, block].astype(float)
    # A patch that a replicate lost keeps its mean: 2 points of no residual.
    middle = total.sum(0) / (weight.sum(0) + 2)
    return (w @ total) / (w @ weight + 2) - middle
