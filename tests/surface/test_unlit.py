"""Sky behind the terminator of a rounded body is no evidence; a body of facets keeps its silhouettes."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from synthetic_dense import cameras, sphere_directions

from massprops.surface.cloud import Cloud
from massprops.surface.unlit import brighter, spare_behind_light, spare_unlit, sun_direction, sun_of_views
from massprops.views import Views

SUN = np.array([0.6, -0.3, -0.74]) / np.linalg.norm([0.6, -0.3, -0.74])
RADIUS = 0.5


def ball(origin: np.ndarray, ray: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which rays (m, 3), of unit length, hit a ball, and its normals there (m, 3)."""
    b = ray @ origin
    inner = b * b - origin @ origin + RADIUS**2
    point = origin + (-b - np.sqrt(np.maximum(inner, 0)))[:, None] * ray
    return inner > 0, point / RADIUS


def box(origin: np.ndarray, ray: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same for a box."""
    enter = (-np.sign(ray) * [0.5, 0.35, 0.3] - origin) / ray
    leave = (np.sign(ray) * [0.5, 0.35, 0.3] - origin) / ray
    axis = enter.argmax(1)
    return enter.max(1) < leave.min(1), -np.sign(ray) * np.eye(3)[axis]


def footage(body):
    """Views of a turning body, silhouettes of its lit side, images, the cloud of its lit points, and whole discs."""
    views = cameras(sphere_directions(16), 4.0, 400.0, (160, 120))
    rng = np.random.default_rng(3)
    u, v = np.meshgrid(np.arange(160), np.arange(120))
    pixel = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    masks, grey, whole, points = [], [], [], []
    for i in range(len(views)):
        ray = pixel @ np.linalg.inv(views.K[i]).T @ views.R[i]
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        hit, normal = body(views.centres[i], ray)
        light = 180 * np.maximum(normal @ (views.R[i].T @ SUN), 0) * (1 + 0.15 * rng.standard_normal(len(ray))) * hit
        grey.append(np.clip(light, 0, 255).astype(np.uint8).reshape(u.shape))
        masks.append(np.where(grey[-1] > 5, 255, 0).astype(np.uint8))
        whole.append(hit.reshape(u.shape))
        lit = np.flatnonzero(hit & (light > 20))[::7]
        # where the ray meets the plane through the centre is near enough to find the pixel again
        depth = views.t[i][2] / (ray[lit] @ views.R[i][2])
        points.append((views.centres[i] + depth[:, None] * ray[lit], normal[lit], np.full(len(lit), i)))
    xyz, normal, view = (np.concatenate(part) for part in zip(*points, strict=True))
    cloud = Cloud(xyz, normal, np.full(len(xyz), 0.01), np.arange(len(xyz) + 1), view)
    return views, masks, grey, cloud, whole


@pytest.fixture(scope="module")
def rounded():
    return footage(ball)


def test_the_sun_is_found(rounded):
    views, _, grey, cloud, _ = rounded
    assert np.degrees(np.arccos(sun_direction(views, grey, cloud) @ SUN)) < 5


def test_the_unlit_side_of_a_ball_is_no_sky(rounded):
    views, masks, grey, cloud, whole = rounded
    spared = spare_unlit(views, masks, grey, cloud, sun_of_views(views, grey, cloud, 0))
    for old, new, disc in zip(masks, spared, whole, strict=True):
        np.testing.assert_array_equal(new == 255, old == 255)
        unlit = disc & (old == 0)
        assert unlit.sum() > 150
        assert (new[unlit] == 128).mean() > 0.8
        about = cv2.dilate(np.uint8(disc), np.ones((7, 7))) > 0
        assert not (new[~about] == 128).any()


def test_two_cameras_of_a_rig_have_a_sun_each(rounded):
    views, masks, grey, cloud, _ = rounded
    # the second camera is turned by 90 degrees about its axis: its images are, and so is the Sun in them
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    K = views.K.copy()
    K[:, 0, 2], K[:, 1, 2] = 119 - views.K[:, 1, 2], views.K[:, 0, 2]
    second = replace(
        views,
        names=tuple(f"cam1/{n}" for n in views.names),
        R=turn @ views.R,
        t=views.t @ turn.T,
        K=K,
        size=views.size[:, ::-1],
    )
    first = replace(views, names=tuple(f"cam0/{n}" for n in views.names))
    both = Views.joined([first, second])
    seen_by_both = Cloud.joined([cloud, cloud.moved(np.eye(3), np.zeros(3), len(views))])
    turned = [[np.rot90(x, -1).copy() for x in y] for y in (masks, grey)]
    grey_of_both = grey + turned[1]
    suns = sun_of_views(both, grey_of_both, seen_by_both, 0)
    spared = spare_unlit(both, masks + turned[0], grey_of_both, seen_by_both, suns)
    alone = spare_unlit(views, masks, grey, cloud, sun_of_views(views, grey, cloud, 0))
    for i, mask in enumerate(alone):
        assert ((mask == 128) == (spared[i] == 128)).mean() > 0.99
        there = np.rot90(spared[len(views) + i], 1)
        assert ((mask == 128) == (there == 128)).mean() > 0.99


def test_facets_end_where_their_light_does():
    views, masks, grey, cloud, _ = footage(box)
    assert spare_unlit(views, masks, grey, cloud, sun_of_views(views, grey, cloud, 0)) is masks


def test_black_images_say_nothing(rounded):
    views, _, grey, cloud, _ = rounded
    assert sun_of_views(views, [np.zeros_like(g) for g in grey], cloud, 0) is None


def test_outlines_that_face_the_sun_are_the_bodys_own() -> None:
    for body in (ball, box):
        views, masks, grey, _, whole = footage(body)
        towards = brighter(masks, grey)
        assert towards is not None and towards @ SUN[:2] / np.linalg.norm(SUN[:2]) > 0.95
        spared = spare_behind_light(views, masks, grey)
        for mask, disc in zip(spared, whole, strict=True):
            # next to nothing of the body counts as sky, and the side towards the Sun still carves
            assert np.mean(mask[disc] == 0) < 0.02
            assert np.mean(mask[~disc] == 0) > 0.5


def test_brightness_that_goes_any_way_tells_no_sun() -> None:
    rng = np.random.default_rng(2)
    masks = [np.full((40, 50), 255, np.uint8)] * 30
    assert brighter(masks, [rng.integers(0, 255, (40, 50)).astype(np.uint8) for _ in masks]) is None
