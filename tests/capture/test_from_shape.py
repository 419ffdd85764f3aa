"""Silhouettes drawn from a shape and refined by the image."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from massprops.capture.from_shape import (
    Paint,
    Trimap,
    agreement,
    far_from,
    moved,
    overlap,
    refine,
    shows_object_colours,
    shows_points,
    shows_support,
    to_stored,
    trimap,
    unsure,
)
from massprops.views import undistort

SHAPE = (240, 320)


def disc(x: float, y: float, r: float) -> np.ndarray:
    v, u = np.mgrid[0 : SHAPE[0], 0 : SHAPE[1]]
    return (u - x) ** 2 + (v - y) ** 2 < r**2


def everywhere() -> np.ndarray:
    u, v = np.meshgrid(np.arange(0, 320, 3.0), np.arange(0, 240, 3.0))
    return np.column_stack([u.ravel(), v.ravel()])


def depth_of(mask: np.ndarray, depth: float = 1.0) -> np.ndarray:
    return np.where(mask, depth, np.inf)


def test_a_gap_that_shows_nothing_is_the_object() -> None:
    ring = disc(160, 120, 60) & ~disc(160, 120, 25)
    outside = everywhere()
    outside = outside[np.hypot(outside[:, 0] - 160, outside[:, 1] - 120) > 62]
    known = trimap(depth_of(ring), outside, np.full(len(outside), 2.0), np.ones(len(outside), bool))
    assert known.drawn[120, 160], "the table shows all about the ring but not through it"
    through = everywhere()
    known = trimap(depth_of(ring), through, np.full(len(through), 2.0), np.ones(len(through), bool))
    assert not known.drawn[120, 160] and known.away[120, 160], "the table shows through it"
    assert known.surely[120, 205] and not known.away[120, 205], "points behind the shape are hidden by it"


@pytest.mark.parametrize("open_", [True, False])
def test_the_image_decides_whether_a_gap_without_points_is_the_object(open_: bool) -> None:
    """As between the rails of a chair's back before a plain wall, and within the glossy side of a jug."""
    rng = np.random.default_rng(3)
    ring, middle = disc(160, 120, 60), disc(160, 120, 25)
    body = ring & ~middle if open_ else ring
    image = np.where(body[..., None], [60, 90, 190], [120, 120, 110]) + 6.0 * rng.standard_normal((*SHAPE, 3))
    outside = everywhere()
    outside = outside[np.hypot(outside[:, 0] - 160, outside[:, 1] - 120) > 62]
    seen = np.full(len(outside), 2.0), np.ones(len(outside), bool)
    found = refine(np.clip(image, 0, 255).astype(np.uint8), trimap(depth_of(ring & ~middle), outside, *seen))
    assert overlap(found, body) > 0.96


@pytest.mark.parametrize("closed", [True, False])
def test_a_gap_of_a_closed_surface_is_open_though_nothing_shows_through_it(closed: bool) -> None:
    """As between the rails of a chair's back before a plain wall of nearly its colour."""
    rng = np.random.default_rng(6)
    ring = disc(160, 120, 60) & ~disc(160, 120, 25)
    image = np.where(ring[..., None], [60, 65, 70], [120, 150, 170]) + 0.0
    image[disc(160, 120, 25)] = [64, 70, 78]
    image = np.clip(image + 6.0 * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)
    outside = everywhere()
    outside = outside[np.hypot(outside[:, 0] - 160, outside[:, 1] - 120) > 62]
    seen = np.full(len(outside), 2.0), np.ones(len(outside), bool)
    found = refine(image, trimap(depth_of(ring), outside, *seen, closed=closed))
    assert (overlap(found, ring) > 0.95) is closed


def test_a_lump_of_a_first_shape_that_has_the_surroundings_colour_is_not_held() -> None:
    rng = np.random.default_rng(4)
    truth = disc(160, 110, 50)
    image = np.where(truth[..., None], [60, 90, 190], [120, 120, 110]) + 6.0 * rng.standard_normal((*SHAPE, 3))
    lump = truth | disc(160, 165, 20)
    points = everywhere()
    points = points[np.hypot(points[:, 0] - 160, points[:, 1] - 120) > 80]
    seen = np.full(len(points), 2.0), np.ones(len(points), bool)
    known = trimap(depth_of(lump), points, *seen)
    assert known.surely[172, 160]
    assert overlap(refine(np.clip(image, 0, 255).astype(np.uint8), known), truth) > 0.97


def test_the_image_decides_where_the_outline_is() -> None:
    rng = np.random.default_rng(0)
    truth = disc(160, 120, 50)
    image = np.where(truth[..., None], [60, 90, 190], [120, 120, 110]) + 6.0 * rng.standard_normal((*SHAPE, 3))
    image = np.clip(image, 0, 255).astype(np.uint8)
    rough = disc(162, 119, 49)
    points = everywhere()
    points = points[np.hypot(points[:, 0] - 160, points[:, 1] - 120) > 55]
    found = refine(image, trimap(depth_of(rough), points, np.full(len(points), 2.0), np.ones(len(points), bool)))
    assert overlap(found, truth) > 0.98 > overlap(rough, truth)


@pytest.mark.parametrize("closed", [True, False])
def test_a_shadow_of_its_colour_is_left_out_beside_a_closed_surface(closed: bool) -> None:
    rng = np.random.default_rng(5)
    truth, shadow = disc(160, 110, 50), disc(160, 150, 30)
    image = np.where((truth | shadow)[..., None], [60, 65, 70], [120, 150, 170]) + 6.0 * rng.standard_normal(
        (*SHAPE, 3)
    )
    points = everywhere()
    points = points[np.hypot(points[:, 0] - 160, points[:, 1] - 120) > 80]
    seen = np.full(len(points), 2.0), np.ones(len(points), bool)
    known = trimap(depth_of(truth), points, *seen, closed=closed)
    found = refine(np.clip(image, 0, 255).astype(np.uint8), known)
    assert (overlap(found, truth) > 0.92) is closed


def test_a_side_that_was_not_measured_is_found_by_what_it_hides() -> None:
    """The table's points lie behind it, but the image does not have their colour."""
    rng = np.random.default_rng(1)
    table = np.clip(110 + 25 * cv2.GaussianBlur(rng.standard_normal((*SHAPE, 3)), (0, 0), 3) * 6, 0, 255)
    truth = disc(160, 120, 50)
    image = np.where(truth[..., None], [40, 60, 90], table).astype(np.uint8)
    measured = depth_of(truth & (np.arange(320) < 175))
    points = everywhere()
    colours = table[points[:, 1].astype(int), points[:, 0].astype(int)]
    shows = shows_points(image, points, colours, far_from(measured))
    found = refine(image, trimap(measured, points, np.full(len(points), 2.0), shows))
    assert overlap(np.isfinite(measured), truth) < 0.75
    assert overlap(found, truth) > 0.95


def test_an_unmeasured_part_of_the_objects_colour_is_left_open() -> None:
    """A handle far from the measured body, a like thing that stands apart, and another of the table's colours."""
    rng = np.random.default_rng(2)
    body, handle, apart = disc(130, 120, 45), disc(210, 120, 40) & ~disc(210, 120, 25), disc(290, 40, 20)
    beside = disc(130, 190, 26)
    image = np.where((body | handle | apart)[..., None], [60, 90, 190], [120, 120, 110]) + 5.0 * rng.standard_normal(
        (*SHAPE, 3)
    )
    image[beside & ~body] = [150, 60, 50]
    image = np.clip(image, 0, 255).astype(np.uint8)
    painted = Paint.learn(image[body], np.concatenate([image[~(body | handle | apart)], image[beside & ~body]]))
    away = far_from(depth_of(body))
    left_open = unsure(image, body, painted, away)
    assert left_open[handle & ~body].mean() > 0.95
    assert not left_open[apart | body].any() and not left_open[beside & ~handle].any()
    assert left_open[~(handle | body)].mean() < 0.05
    # nothing is known of colours that no point has
    assert not unsure(image, body, Paint.learn(image[:0].reshape(-1, 3), image[apart]), away).any()


def test_a_black_cloth_that_no_stereo_measured_is_not_the_objects() -> None:
    """A body with dark holes on a cloth as dark, which has no points: the image shows it wherever the object surely is not."""
    rng = np.random.default_rng(3)
    body, hole, cloth = disc(160, 120, 45), disc(150, 120, 18), np.zeros(SHAPE, bool)
    cloth[100:] = True
    image = np.where((body & ~hole)[..., None], [60, 90, 190], [120, 120, 110])
    image[(cloth & ~body) | hole] = 12
    image = np.clip(image + 3.0 * rng.standard_normal((*SHAPE, 3)), 0, 255).astype(np.uint8)
    painted = Paint.learn(image[body], image[~(body | cloth)])
    assert unsure(image, body, painted, np.zeros(SHAPE, bool))[cloth & ~body].mean() > 0.5
    assert not unsure(image, body, painted, far_from(depth_of(body))).any()


def test_views_that_show_the_object_elsewhere() -> None:
    agreement = np.array([0.97, 0.98, 0.96, 0.97, 0.3, 0.98, 0.97, 0.72])
    none = np.zeros(8, bool)
    assert np.flatnonzero(moved(agreement, none)).tolist() == [4, 7]
    assert not moved(np.array([0.93, 0.95, 0.91, 0.88, 0.94]), none[:5]).any()


def test_a_view_of_the_bare_support_shows_the_object_elsewhere() -> None:
    drawn, support = np.zeros((20, 30), bool), np.full((20, 30), -2.0, np.float32)
    drawn[5:15, 5:20] = True
    nothing = Trimap(drawn, drawn, ~drawn, np.zeros_like(drawn))
    here, bare = (replace(nothing, evidence=e, own_coloured=c) for e, c in ((-support, drawn), (support, ~drawn)))
    assert [shows_support(known) for known in (nothing, here, bare)] == [False, False, True]
    assert not shows_support(replace(bare, own_coloured=drawn)), "another thing of its colours lies on the support"
    assert shows_support(replace(nothing, drawn=np.zeros_like(drawn))), "the object is beside the frame"
    odd = np.arange(9) == 3
    assert np.array_equal(moved(np.full(9, 0.95), odd), odd)
    assert not moved(np.full(9, 0.95), ~odd).any(), "the object looks like its support"


def test_a_silhouette_returns_to_the_distorted_frame() -> None:
    K = np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]])
    distortion = np.array([-0.2, 0.05, 0.001, -0.002])
    truth = disc(200, 100, 40)
    stored = to_stored(truth, K, distortion)
    again = undistort(stored, K, distortion, nearest=True) > 127
    assert stored.dtype == np.uint8 and set(np.unique(stored)) == {0, 255}
    assert overlap(again, truth) > 0.97
    assert cv2.countNonZero(stored) != np.count_nonzero(truth)


def test_a_side_that_stereo_missed_is_found_by_its_colours_where_no_support_shows() -> None:
    """Bananas of which the first shape lacks the lower ones; a thing of their colour lies where the support's picture shows."""
    rng = np.random.default_rng(6)
    truth, painted = disc(150, 120, 60), disc(280, 120, 18)
    image = np.where((truth | painted)[..., None], [40, 170, 190], [110, 110, 110]) + 6.0 * rng.standard_normal(
        (*SHAPE, 3)
    )
    image = np.clip(image, 0, 255).astype(np.uint8)
    measured = truth & (np.mgrid[0 : SHAPE[0], 0 : SHAPE[1]][0] < 128)
    paint = Paint.learn(image[measured], image[~truth & ~painted])
    evidence = np.where(painted, -1.0, np.where(truth, 0.0, -2.0)).astype(np.float32)
    like = shows_object_colours(image, paint, evidence)
    assert like[truth].mean() > 0.97 and not like[painted].any()
    points = everywhere()
    points = points[~(truth | painted)[points[:, 1].astype(int), points[:, 0].astype(int)]]
    seen = depth_of(measured), points, np.full(len(points), 2.0), np.ones(len(points), bool)
    known = trimap(*seen, own_coloured=like)
    found = refine(image, known)
    assert overlap(refine(image, trimap(*seen)), truth) < 0.8
    assert overlap(found, truth) > 0.95
    # the shape is where the image shows the object, though it lacks most of it
    assert overlap(found, measured) < 0.65 and agreement(found, known) > 0.9
    elsewhere = trimap(depth_of(disc(185, 120, 60)), *seen[1:], own_coloured=like)
    assert agreement(refine(image, elsewhere), elsewhere) < 0.8
