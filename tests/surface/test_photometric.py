"""A surface that is too deep in all images alike goes to where they agree."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from surface.synthetic_dense import cameras, sphere_directions
from surface.synthetic_ellipsoid import height_over, mesh_off, seen

from massprops.geometry.rasterise import silhouette
from massprops.surface.photometric import moved_to_images
from massprops.surface.reconstruct import Surface
from massprops.surface.silhouette import Hull
from massprops.views import Views

AXES = np.array([1.0, 0.8, 0.7])
SIZE, PIXEL, DEEP = (320, 240), 1 / 80, 1.5
"""Of an image; of a pixel at the body; by how many the surface is too deep."""


@cache
def filmed(paint_of: int = 0) -> tuple[Views, list[np.ndarray], list[np.ndarray]]:
    """Cameras about a painted ellipsoid, their images and silhouettes; paint_of: each image has its own paint from the second on."""
    views, grey, masks = cameras(sphere_directions(24), 5.0, 400.0, SIZE), [], []
    for i in range(len(views)):
        rng = np.random.default_rng([4, i * paint_of])
        wave, phase = rng.standard_normal((20, 3)) / (2.5 * PIXEL), rng.uniform(0, 2 * np.pi, 20)
        hit, place = seen(views, i, AXES, SIZE)
        paint = 128 + 8 * np.cos(place @ wave.T + phase).sum(-1)
        grey.append(np.where(hit, paint, 20).astype(np.float32))
        masks.append(np.where(hit, 255, 0).astype(np.uint8))
    return views, grey, masks


def too_deep() -> Surface:
    vertices, faces, cloud = mesh_off(AXES, -DEEP * PIXEL, PIXEL)
    every = np.ones(len(faces), bool)
    return Surface(vertices, faces, every, ~every, cast(Hull, SimpleNamespace(pixel=PIXEL, support=None)), cloud, 0.03)


def depth_of(vertices: np.ndarray) -> np.ndarray:
    """(v,) how deep places lie below the ellipsoid, to first order [px]."""
    return -height_over(vertices, AXES) / PIXEL


def test_a_surface_that_is_too_deep_comes_out_to_where_images_agree() -> None:
    views, grey, masks = filmed()
    surface = too_deep()
    assert np.median(depth_of(surface.vertices)) == pytest.approx(DEEP, abs=0.1)
    moved = moved_to_images(surface, views, grey, masks, np.zeros(len(views), int))
    assert abs(np.mean(depth_of(moved.vertices))) < 0.15
    assert np.quantile(np.abs(depth_of(moved.vertices)), 0.9) < 0.4
    np.testing.assert_allclose(moved.cloud.xyz, moved.vertices, atol=1e-9)


def test_images_that_do_not_agree_move_nothing() -> None:
    views, grey, masks = filmed(paint_of=1)
    surface = too_deep()
    moved = moved_to_images(surface, views, grey, masks, np.zeros(len(views), int))
    assert np.median(np.abs(depth_of(moved.vertices) - depth_of(surface.vertices))) < 0.3


def test_a_move_that_takes_the_surface_off_its_outlines_is_not_made() -> None:
    views, grey, _ = filmed()
    surface = too_deep()
    drawn = [
        silhouette(surface.vertices, surface.faces, views.K[i], views.R[i], views.t[i], SIZE) for i in range(len(views))
    ]
    smaller = [np.where(d, 255, 0).astype(np.uint8) for d in drawn]
    assert moved_to_images(surface, views, grey, smaller, np.zeros(len(views), int)) is surface


def test_what_is_closed_at_the_support_stays() -> None:
    views, grey, masks = filmed()
    surface = too_deep()
    low = surface.vertices[surface.faces][:, :, 2].max(axis=1) < -0.5
    held = Surface(surface.vertices, surface.faces, ~low, low, surface.hull, surface.cloud, surface.spacing)
    moved = moved_to_images(held, views, grey, masks, np.zeros(len(views), int))
    at = np.unique(surface.faces[low])
    assert np.abs(moved.vertices[at] - surface.vertices[at]).max() < 0.1 * PIXEL
