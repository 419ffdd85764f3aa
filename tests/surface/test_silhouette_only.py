"""A thin part that all silhouettes show and nothing measured is kept, and only that."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh
from synthetic_dense import cameras, observe, sphere_directions

from massprops.geometry.rasterise import silhouette
from massprops.mass.integrals import mesh_integrals
from massprops.surface import silhouette_only
from massprops.surface.cloud import Cloud
from massprops.surface.reconstruct import reconstruct_surface
from massprops.surface.silhouette import make_hull
from massprops.surface.silhouette_only import SilhouetteOnly, silhouette_only_space
from massprops.views import Views

VIEWS = cameras(sphere_directions(30), 4.0, 330.0)
BLOCK = trimesh.creation.box(extents=(1.0, 0.8, 0.6))
BAR = trimesh.creation.cylinder(0.06, 0.7)
BAR.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
BAR.apply_translation([0.8, 0.1, 0.1])
WHOLE = trimesh.boolean.union([BLOCK, BAR], engine="manifold")


@cache
def footage() -> tuple[Views, Cloud, tuple[np.ndarray, ...]]:
    """Silhouettes of block and bar, points of the block alone."""
    cloud, masks = observe(WHOLE, VIEWS, 0.003, 0, outliers=0.0, most=75_000)
    return VIEWS, cloud.take(np.flatnonzero(cloud.xyz[:, 0] < 0.51)), tuple(masks)


@pytest.mark.parametrize("moving", [False, True])
def test_a_bar_that_only_silhouettes_show_is_kept(moving: bool) -> None:
    views, cloud, masks = footage()
    kept = reconstruct_surface(views, list(masks), cloud, 5000, moving=moving)
    assert 1.1 < kept.vertices[:, 0].max() < 1.2
    # the bar is 1.5 % of it
    assert mesh_integrals(kept.vertices, kept.faces)[0] == pytest.approx(WHOLE.volume, rel=0.01)
    mesh = trimesh.Trimesh(kept.vertices, kept.faces, process=False)
    assert mesh.is_volume


def test_before_black_sky_a_thin_bar_is_a_part_and_a_wide_outline_none() -> None:
    """A bar of three pixels has no place two pixels within its silhouette; what lies beside a block that came out
    too small does not protrude."""
    views, _, _ = footage()
    bar = trimesh.creation.cylinder(0.02, 0.7)
    bar.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    bar.apply_translation([0.8, 0.1, 0.1])
    cloud, masks = observe(trimesh.boolean.union([BLOCK, bar], engine="manifold"), views, 0.003, 0, outliers=0.0)
    hull = make_hull(views, masks, cloud.xyz)
    block = np.asarray(BLOCK.vertices), np.asarray(BLOCK.faces)
    assert silhouette_only_space(block, views, masks, hull, 0.02, 0) is None
    found = silhouette_only_space(block, views, masks, hull, 0.02, 0, sharp=True)
    assert found is not None and found.inside[:, 0].max() > 1.0
    cloud, masks = observe(BLOCK, views, 0.003, 0, outliers=0.0)
    hull = make_hull(views, masks, cloud.xyz)
    fine = BLOCK.subdivide_to_size(0.03)
    smaller = 0.95 * np.asarray(fine.vertices), np.asarray(fine.faces)
    assert silhouette_only_space(smaller, views, masks, hull, 0.02, 0, sharp=True) is None


@pytest.mark.parametrize(
    ("shown", "sky", "expected"), [(30, 0, 1.0), (8, 0, 0.8), (2, 0, 0.2), (12, 8, 0.6), (4, 4, 0.0)]
)
def test_views_in_which_a_place_lies_on_the_mesh_tell_nothing_of_it(shown: int, sky: int, expected: float) -> None:
    """A boom that stands before the body in most images is as much a part as one that stands out in all."""

    def full(count: int, first: int = 0) -> list[np.ndarray]:
        return [np.full((h, w), first <= i < first + count) for i, (w, h) in enumerate(VIEWS.size)]

    found = SilhouetteOnly(VIEWS, full(shown), full(sky, shown), np.zeros((0, 3)), np.zeros((0, 3)))
    assert found.share(np.zeros((1, 3)))[0] == pytest.approx(expected)


def test_a_bar_of_which_only_the_end_was_measured_is_kept() -> None:
    """It stands beside the block as another piece would, and all silhouettes show the two as one thing."""
    cloud, masks = observe(WHOLE, VIEWS, 0.003, 0, outliers=0.0, most=75_000)
    cloud = cloud.take(np.flatnonzero((cloud.xyz[:, 0] < 0.51) | (cloud.xyz[:, 0] > 0.8)))
    found = reconstruct_surface(VIEWS, masks, cloud, 5000, moving=False)
    assert 1.1 < found.vertices[:, 0].max() < 1.2
    assert mesh_integrals(found.vertices, found.faces)[0] == pytest.approx(WHOLE.volume, rel=0.01)


def test_nothing_is_missing_of_a_mesh_that_fills_its_silhouettes() -> None:
    views, cloud, masks = footage()
    hull = make_hull(views, list(masks), cloud.xyz)
    whole = np.asarray(WHOLE.vertices), np.asarray(WHOLE.faces)
    assert silhouette_only_space(whole, views, list(masks), hull, 0.02, 0) is None
    block = np.asarray(BLOCK.vertices), np.asarray(BLOCK.faces)
    found = silhouette_only_space(block, views, list(masks), hull, 0.02, 0)
    assert found is not None
    assert np.percentile(np.abs(found.inside[:, 0] - 0.85), 98) < 0.4
    axis = np.hypot(found.outline[:, 1] - 0.1, found.outline[:, 2] - 0.1)
    assert np.median(axis) == pytest.approx(0.06, abs=0.02)


def test_one_wrong_silhouette_is_no_part() -> None:
    views, cloud, masks = footage()
    only, true = observe(BLOCK, views, 0.003, 0, outliers=0.0)
    wrong = [masks[0], *true[1:]]
    hull = make_hull(views, wrong, only.xyz)
    block = np.asarray(BLOCK.vertices), np.asarray(BLOCK.faces)
    assert silhouette_only_space(block, views, wrong, hull, 0.02, 0) is None


def test_what_more_views_show_as_sky_is_no_part() -> None:
    """However many views must agree that a place is empty, as where an unlit side looks like sky."""
    views, _, _ = footage()
    ball = trimesh.creation.icosphere(3, 0.12)
    ball.apply_translation([1.0, 0.5, 0.4])
    only, masks = observe(BLOCK, views, 0.003, 0, outliers=0.0)
    other = observe(trimesh.util.concatenate([BLOCK, ball]), views, 0.003, 0, outliers=0.0)[1]
    block = np.asarray(BLOCK.vertices), np.asarray(BLOCK.faces)
    for shown, kept in ((6, False), (26, True)):
        mixed = [*other[:shown], *masks[shown:]]
        hull = replace(make_hull(views, mixed, only.xyz), need=len(masks) - 2)
        found = silhouette_only_space(block, views, mixed, hull, 0.02, 0, sharp=True)
        assert (found is not None) == kept


def test_what_a_mesh_misses_nearly_all_of_is_asked_on_fewer_rays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where images were placed wrongly, rays through all that is missing took gigabytes."""
    asked = []
    along = silhouette_only._along
    monkeypatch.setattr(silhouette_only, "_along", lambda *given: asked.append(along(*given)) or asked[-1])
    views, cloud, masks = footage()
    hull, block = make_hull(views, list(masks), cloud.xyz), (np.asarray(BLOCK.vertices), np.asarray(BLOCK.faces))
    silhouette_only_space(block, views, list(masks), hull, 0.01, 0)
    every = sum(map(len, asked))
    asked.clear()
    monkeypatch.setattr(silhouette_only, "MOST_LOOKED_AT", every // 4)
    found = silhouette_only_space(block, views, list(masks), hull, 0.01, 0)
    assert sum(map(len, asked)) < every / 3
    assert found is not None and found.inside[:, 0].max() > 1.0


def test_a_boom_that_was_not_lit_in_many_images_is_shown_by_the_others() -> None:
    views, _, masks = footage()
    hull, block = make_hull(views, list(masks), np.zeros((1, 3))), (np.asarray(BLOCK.vertices), np.asarray(BLOCK.faces))
    dark = range(0, len(views), 3)
    seen = list(masks)
    for i in dark:
        drawn = silhouette(*block, views.K[i], views.R[i], views.t[i], masks[i].shape[::-1])
        seen[i] = np.where(drawn, masks[i], 0).astype(np.uint8)
    lit = silhouette_only.lit_at_times(block, views, seen, hull, 0.02)
    middle = np.array([0.8, 0.1, 0.1])
    assert len(lit) > 30 and np.abs(lit - middle).max() < 0.5
    assert np.linalg.norm((lit - middle)[:, 1:], axis=1).max() < 0.12
    spared = silhouette_only.spare_where_dark(views, seen, lit)
    missed = [
        np.mean(s[(m == 255) & (b == 0)] == 0) for s, m, b in zip(spared, masks, seen, strict=True) if (m != b).any()
    ]
    assert missed and np.median(missed) < 0.2
    for i in set(range(len(views))) - set(dark):
        np.testing.assert_array_equal(spared[i], seen[i])
    whole = np.asarray(WHOLE.vertices), np.asarray(WHOLE.faces)
    assert not len(silhouette_only.lit_at_times(whole, views, seen, hull, 0.02))


def test_what_few_images_show_is_no_part() -> None:
    views, _, masks = footage()
    hull, block = make_hull(views, list(masks), np.zeros((1, 3))), (np.asarray(BLOCK.vertices), np.asarray(BLOCK.faces))
    seen = [
        np.where(silhouette(*block, views.K[i], views.R[i], views.t[i], m.shape[::-1]), m, 0).astype(np.uint8)
        if i % 6
        else m
        for i, m in enumerate(masks)
    ]
    assert not len(silhouette_only.lit_at_times(block, views, seen, hull, 0.02))


def test_of_too_many_places_those_that_most_views_show_are_kept() -> None:
    """A boom that 50 views show has a hundredth of the volume of a corner that 10 leave open."""
    shown = np.concatenate([np.full(600, 50), np.full(60_000, 10)])
    kept = silhouette_only._sample(shown, np.random.default_rng(0))
    assert len(kept) == silhouette_only.MOST and np.array_equal(kept, np.unique(kept))
    assert np.count_nonzero(kept < 600) > 500
    few = silhouette_only._sample(shown[:700], np.random.default_rng(0))
    assert np.array_equal(few, np.arange(700))


@pytest.mark.parametrize("holed", [False, True])
def test_a_hole_in_a_plate_is_filled_where_silhouettes_do_not_show_it(holed: bool) -> None:
    """Stereo measures nothing on the plain paint of a wing; the hole that is left there protrudes nowhere."""
    views, _, _ = footage()
    plate = trimesh.creation.box(extents=(1.6, 1.0, 0.04))
    with_hole = trimesh.boolean.difference(
        [plate, trimesh.creation.box(extents=(0.3, 0.2, 0.2))], engine="manifold"
    ).subdivide_to_size(0.05)
    cloud, masks = observe(with_hole if holed else plate, views, 0.003, 0, outliers=0.0)
    hull = make_hull(views, masks, cloud.xyz)
    mesh = np.asarray(with_hole.vertices), np.asarray(with_hole.faces)
    found = silhouette_only_space(mesh, views, masks, hull, 0.02, 0, sharp=True)
    if holed:
        assert found is None
    else:
        assert found is not None and (np.abs(found.inside) < [0.17, 0.12, 0.2]).all()
