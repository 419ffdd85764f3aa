"""Thin parts of a still object go to their edges in the images."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import cast

import cv2
import numpy as np
import pytest
from surface.synthetic_dense import cameras, sphere_directions
from surface.synthetic_ellipsoid import mesh_off, seen

from massprops.surface.edges import moved_to_edges
from massprops.surface.reconstruct import Surface
from massprops.surface.silhouette import Hull
from massprops.views import Views

ROD = np.array([1.0, 0.05, 0.05])
SIZE, PIXEL, WIDE = (320, 240), 1 / 80, 1.5
"""Of an image; of a pixel at the body; by how many the surface is too far out."""
BODY = 200.0


@cache
def filmed(surroundings: float = 30.0) -> tuple[Views, list[np.ndarray], list[np.ndarray]]:
    """Cameras above a bright rod, their images and silhouettes; surroundings: 1-sigma of the pattern behind [grey levels], of a mean of 80."""
    views, grey, masks = cameras(sphere_directions(48), 5.0, 400.0, SIZE), [], []
    above = np.flatnonzero(views.centres[:, 2] > 1.5)
    views = views.take(above)
    for i in range(len(views)):
        rng = np.random.default_rng([5, i])
        share = seen(views, i, ROD, SIZE, finer=4)[0].reshape(SIZE[1], 4, SIZE[0], 4).mean(axis=(1, 3))
        behind = np.repeat(np.repeat(rng.standard_normal((SIZE[1] // 8, SIZE[0] // 8)), 8, 0), 8, 1)
        grey.append((share * BODY + (1 - share) * (80 + surroundings * behind)).astype(np.float32))
        masks.append(np.where(share > 0.5, 255, 0).astype(np.uint8))
    return views, grey, masks


def too_wide(axes: np.ndarray = ROD, support: np.ndarray | None = None) -> Surface:
    vertices, faces, cloud = mesh_off(axes, WIDE * PIXEL, PIXEL)
    every = np.ones(len(faces), bool)
    hull = cast(Hull, SimpleNamespace(pixel=PIXEL, support=support))
    return Surface(vertices, faces, every, ~every, hull, cloud, 0.03)


def outside(vertices: np.ndarray) -> np.ndarray:
    """(k,) how far the vertices between the rod's tips lie outside it [px]."""
    x, y, z = vertices[np.abs(vertices[:, 0]) < 0.8].T
    return (np.hypot(y, z) - ROD[1] * np.sqrt(1 - x**2)) / PIXEL


def test_a_rod_that_is_too_wide_comes_in_to_its_edges() -> None:
    surface = too_wide()
    assert np.median(outside(surface.vertices)) == pytest.approx(WIDE, abs=0.15)
    moved = moved_to_edges(surface, *filmed())
    side = np.abs(moved.vertices[:, 2]) < 0.03
    assert np.median(outside(moved.vertices[side])) == pytest.approx(0.0, abs=0.3)
    np.testing.assert_allclose(moved.cloud.xyz, moved.vertices, atol=1e-9)


def test_edges_that_differ_from_image_to_image_move_nothing() -> None:
    views, _, masks = filmed()
    rng = np.random.default_rng(6)
    grey = [rng.normal(100, 30, m.shape).astype(np.float32) for m in masks]
    surface = too_wide()
    moved = moved_to_edges(surface, views, grey, masks)
    assert np.median(np.abs(moved.vertices - surface.vertices).max(axis=1)) < 0.3 * PIXEL


def test_where_the_support_lies_close_behind_nothing_is_asked() -> None:
    surface = too_wide(support=np.array([0.0, 0.0, 1.0, 0.07]))
    views, grey, masks = filmed()
    steep = np.flatnonzero(views.centres[:, 2] > 3.6)
    assert len(steep) > 4
    moved = moved_to_edges(surface, views.take(steep), [grey[i] for i in steep], [masks[i] for i in steep])
    np.testing.assert_allclose(moved.vertices, surface.vertices, atol=1e-9)


def test_what_a_window_of_stereo_fits_on_is_left_as_it_was_measured() -> None:
    thick = too_wide(np.array([1.0, 0.5, 0.5]))
    moved = moved_to_edges(thick, *filmed())
    middle = np.abs(thick.vertices[:, 0]) < 0.6
    np.testing.assert_allclose(moved.vertices[middle], thick.vertices[middle], atol=1e-6)


def test_a_move_off_the_outlines_is_not_made() -> None:
    views, grey, masks = filmed()
    wide = [cv2.dilate(mask, np.ones((5, 5), np.uint8)) for mask in masks]
    surface = too_wide()
    assert moved_to_edges(surface, views, grey, wide) is surface
