"""Silhouettes are cut where lit edges are, and dark sides stay unknown."""

from __future__ import annotations

import cv2
import numpy as np
import trimesh
from synthetic_dense import cameras, sphere_directions

from massprops.geometry.rasterise import rasterise
from massprops.surface.cloud import Cloud
from massprops.surface.sharp_outlines import BESIDE, BRIGHT, RIM, sharp_outlines
from massprops.views import AMBIGUOUS

VIEWS = cameras(sphere_directions(12), 4.0, 330.0)
SUN = np.tile(np.array([0.8, 0.0, -0.6]), (len(VIEWS), 1))
"""Towards it in every view's camera: from the right, and from behind the camera."""
BLOCK = trimesh.creation.box(extents=(1.0, 0.8, 0.6)).subdivide_to_size(0.02)
BALL = trimesh.creation.icosphere(subdivisions=5, radius=0.5)
BLUR = 1.0
"""1-sigma of the spread of edges [px]."""


def cloud_of(mesh: trimesh.Trimesh) -> Cloud:
    count = len(mesh.faces)
    start = np.arange(0, 2 * count + 1, 2, dtype=np.int32)
    seen = np.tile(np.array([0, 1], np.int32), count)
    normal, sigma = np.asarray(mesh.face_normals), np.full(count, 0.003)
    return Cloud(np.asarray(mesh.triangles_center), normal, sigma, start, seen)


def shone_on(mesh: trimesh.Trimesh, i: int) -> tuple[np.ndarray, np.ndarray]:
    """(h, w) bool, the body in a view, and (h, w), how bright it is in sunlight before it is blurred, of 255."""
    size = tuple(int(s) for s in VIEWS.size[i])
    face = rasterise(mesh.vertices, mesh.faces, VIEWS.K[i], VIEWS.R[i], VIEWS.t[i], size)[1]
    light = 230 * np.clip(mesh.face_normals @ (VIEWS.R[i].T @ SUN[i]), 0, 1)
    return face >= 0, np.where(face >= 0, light[face], 0.0)


def filmed(mesh: trimesh.Trimesh) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """Whole bodies (h, w) bool, their brightness before the blur, images (h, w) uint8, and silhouettes with a rim of doubt about all that is the body's."""
    whole, light, grey, masks = [], [], [], []
    for i in range(len(VIEWS)):
        body, level = shone_on(mesh, i)
        image = np.uint8(cv2.GaussianBlur(level, (0, 0), BLUR))
        near = cv2.dilate(np.uint8(body), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9))) > 0
        whole.append(body)
        light.append(level)
        grey.append(image)
        masks.append(np.where(image > 6, 255, np.where(near, AMBIGUOUS, 0)).astype(np.uint8))
    return whole, light, grey, masks


def sky_of(grey: list[np.ndarray]) -> list[np.ndarray]:
    return [image <= 6 for image in grey]


def test_a_lit_edge_is_where_its_brightness_falls_to_half() -> None:
    whole, light, grey, masks = filmed(BLOCK)
    cut = sharp_outlines(VIEWS, masks, sky_of(grey), grey, cloud_of(BLOCK), SUN)
    wide, sharp, beside = 0, 0, 0
    for body, level, before, after in zip(whole, light, masks, cut, strict=True):
        # towards the Sun from lit sides, which is to the right, and farther than the widest rim from all that is dark
        behind = np.any([np.roll(body, -k, axis=1) for k in range(1, RIM + 3)], axis=0)
        dark = behind | (cv2.dilate(np.uint8(body & (level < 2 * BRIGHT)), np.ones((4 * RIM + 1,) * 2)) > 0)
        edge = cv2.dilate(np.uint8(body), np.ones((3, 3))) == 0
        assert not ((after == 255) & edge).any()
        wide += np.count_nonzero((before != 0) & edge & ~dark)
        sharp += np.count_nonzero((after != 0) & edge & ~dark)
        beside += np.count_nonzero((before == 0) & edge & ~dark)
        # a corner's outermost pixel is no more than a quarter as bright
        inner = cv2.erode(np.uint8(body), np.ones((3, 3))) > 0
        assert not ((after == 0) & inner).any()
    assert wide > 500 and beside > 1000
    assert sharp < 0.02 * wide


def test_a_side_that_turns_away_from_the_sun_stays_unknown() -> None:
    whole, light, grey, masks = filmed(BLOCK)
    cut = sharp_outlines(VIEWS, masks, sky_of(grey), grey, cloud_of(BLOCK), SUN)
    for body, level, before, after in zip(whole, light, masks, cut, strict=True):
        dark = body & (level == 0)
        assert not (after[dark] == 0).any()
        # and next to it
        inner = cv2.erode(np.uint8(dark), np.ones((5, 5)))
        about = cv2.dilate(inner, np.ones((2 * BESIDE + 1,) * 2)) > 0
        assert not ((after == 0) & about & (before != 0)).any()
    assert sum(np.count_nonzero(b & (v == 0)) for b, v in zip(whole, light, strict=True)) > 5000


def test_light_that_fades_over_a_ball_is_no_edge() -> None:
    whole, _, grey, masks = filmed(BALL)
    cut = sharp_outlines(VIEWS, masks, sky_of(grey), grey, cloud_of(BALL), SUN)
    lost = sum(np.count_nonzero((after == 0) & body) for body, after in zip(whole, cut, strict=True))
    assert lost < 0.001 * sum(map(np.count_nonzero, whole))


def test_a_silhouette_that_shows_nothing_stays() -> None:
    nothing = [np.zeros(VIEWS.size[i, ::-1], np.uint8) for i in range(len(VIEWS))]
    cut = sharp_outlines(VIEWS, nothing, [n == 0 for n in nothing], nothing, cloud_of(BLOCK), SUN)
    assert all((mask == 0).all() for mask in cut)
