"""Sky beside a body counts where the body would be lit, and nowhere else."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import trimesh
from synthetic_dense import cameras, sphere_directions

from massprops.geometry.rasterise import rasterise, silhouette
from massprops.surface import lit_sky
from massprops.surface.cloud import Cloud
from massprops.surface.lit_sky import WIDER, sky_where_lit, spare_where_unlit
from massprops.surface.unlit import sun_of_views
from massprops.views import AMBIGUOUS

VIEWS = cameras(sphere_directions(24), 4.0, 330.0)
BLOCK = trimesh.creation.box(extents=(1.0, 0.8, 0.6)).subdivide_to_size(0.03)
PLATE = trimesh.creation.box(extents=(0.9, 0.02, 0.9)).subdivide_to_size(0.03)
SUN = np.tile(np.array([0.8, 0.0, -0.6]), (len(VIEWS), 1))
"""Towards it in every view's camera: from the right, and from behind the camera."""


def lit_pixels(mesh: trimesh.Trimesh, i: int) -> np.ndarray:
    """(h, w) bool: pixels of faces that look at the Sun; what shadows the body casts on itself is left out."""
    width, height = (int(s) for s in VIEWS.size[i])
    face = rasterise(mesh.vertices, mesh.faces, VIEWS.K[i], VIEWS.R[i], VIEWS.t[i], (width, height))[1]
    lit = mesh.face_normals @ (VIEWS.R[i].T @ SUN[i]) > 0
    return (face >= 0) & lit[face]


def drawn(mesh: trimesh.Trimesh, i: int) -> np.ndarray:
    return silhouette(
        mesh.vertices, mesh.faces, VIEWS.K[i], VIEWS.R[i], VIEWS.t[i], tuple(int(s) for s in VIEWS.size[i])
    )


def test_dark_sides_are_no_sky_and_lit_ones_and_what_is_beside_the_body_are() -> None:
    import cv2

    masks = [np.where(lit_pixels(BLOCK, i), 255, 0).astype(np.uint8) for i in range(len(VIEWS))]
    out = spare_where_unlit(VIEWS, masks, (BLOCK.vertices, BLOCK.faces), SUN, 0.03)
    dark_sides = 0
    for i, (before, after) in enumerate(zip(masks, out, strict=True)):
        body = drawn(BLOCK, i)
        dark = body & (before == 0)
        dark_sides += np.count_nonzero(dark)
        assert np.count_nonzero(after[dark] != AMBIGUOUS) < 0.03 * np.count_nonzero(dark) + 10
        assert np.array_equal(after == 255, before == 255)
        far = cv2.dilate(body.astype(np.uint8), np.ones((2 * WIDER + 3,) * 2)) == 0
        assert (after[far] == 0).all()
    assert dark_sides > 20_000


def test_sky_before_a_side_that_would_be_lit_stays_sky() -> None:
    """A shape that is too large: where its sides face the Sun and images show sky, it is carved."""
    big = BLOCK.copy()
    big.apply_scale(1.3)
    masks = [np.where(lit_pixels(BLOCK, i), 255, 0).astype(np.uint8) for i in range(len(VIEWS))]
    out = spare_where_unlit(VIEWS, masks, (big.vertices, big.faces), SUN, 0.03)
    carving = [(after == 0) & lit_pixels(big, i) for i, after in enumerate(out)]
    assert sum(np.count_nonzero(c) for c in carving) > 5_000


def test_what_lies_in_a_shadow_is_unlit() -> None:
    """A plate between the Sun and a block."""
    i = 0
    sun = VIEWS.R[i].T @ SUN[i]
    shade = PLATE.copy()
    shade.apply_transform(trimesh.geometry.align_vectors([0, 1, 0], sun))
    shade.apply_translation(1.5 * sun)
    both = trimesh.util.concatenate([BLOCK, shade])
    masks = [np.zeros(tuple(int(s) for s in size[::-1]), np.uint8) for size in VIEWS.size]
    alone, shaded = (
        spare_where_unlit(VIEWS.take(np.array([i])), masks[:1], (m.vertices, m.faces), SUN[:1], 0.03)[0]
        for m in (BLOCK, both)
    )
    lit = drawn(BLOCK, i) & (alone == 0)
    assert np.count_nonzero(lit) > 500
    assert np.mean(shaded[lit] == AMBIGUOUS) > 0.5


def test_sky_counts_where_the_body_would_be_lit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lit_sky, "carved", partial(lit_sky.carved, side=56))
    normal = np.asarray(BLOCK.face_normals)
    count = len(normal)
    start = np.arange(0, 2 * count + 1, 2, dtype=np.int32)
    seen = np.tile(np.array([0, 1], np.int32), count)
    xyz = np.asarray(BLOCK.triangles_center)
    cloud = Cloud(xyz=xyz, normal=normal, sigma=np.full(count, 0.003), view_start=start, view_index=seen)
    masks = [np.where(lit_pixels(BLOCK, i), 255, 0).astype(np.uint8) for i in range(len(VIEWS))]
    grey = [(m // 255 * 150).astype(np.uint8) for m in masks]
    shown = sky_where_lit(VIEWS, masks, grey, cloud, sun_of_views(VIEWS, grey, cloud, 0))
    dark = [drawn(BLOCK, i) & (m == 0) for i, m in enumerate(masks)]
    spared = sum(np.count_nonzero(after[d] == AMBIGUOUS) for after, d in zip(shown, dark, strict=True))
    assert spared > 0.95 * sum(np.count_nonzero(d) for d in dark)
    far = [~drawn(BLOCK, i) & (m == 0) for i, m in enumerate(masks)]
    assert sum(np.count_nonzero(after[f]) for after, f in zip(shown, far, strict=True)) < 0.1 * sum(map(np.sum, far))
