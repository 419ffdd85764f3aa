"""Boxes about parts of images."""

from __future__ import annotations

import cv2
import numpy as np

from massprops.capture.silhouette import _solid
from massprops.geometry.pixels import box_about


def test_a_box_leaves_a_margin_as_far_as_the_image_goes() -> None:
    region = np.zeros((20, 30), np.uint8)
    region[0:5, 10:12] = 7
    assert box_about(region) == (slice(0, 6), slice(9, 13))
    assert region[box_about(region, 3)].shape == (8, 8)


def test_distances_within_a_region_are_those_of_its_box() -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        region = np.zeros((60, 80), np.uint8)
        for x, y, r in rng.integers([-10, -10, 2], [90, 70, 30], (4, 3)):
            cv2.circle(region, (int(x), int(y)), int(r), 1, -1)
        region[rng.integers(0, 60, 9), rng.integers(0, 80, 9)] = 0
        whole, about = cv2.distanceTransform(region, cv2.DIST_L2, 5), box_about(region)
        assert (cv2.distanceTransform(region[about], cv2.DIST_L2, 5) == whole[about]).all()


def test_silhouettes_do_not_depend_on_the_sky_about_them() -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        weak = np.zeros((90, 120), np.uint8)
        for x, y, r in rng.integers([20, 20, 2], [100, 70, 18], (5, 3)):
            cv2.circle(weak, (int(x), int(y)), int(r), int(rng.random() < 0.8), -1)
        weak[rng.integers(0, 90, 200), rng.integers(0, 120, 200)] ^= 1
        strong = cv2.erode(weak, np.ones((3, 3), np.uint8)) > 0
        wide = [np.pad(a, ((11, 7), (5, 23))) for a in (weak, strong)]
        assert (_solid(*wide)[11:-7, 5:-23] == _solid(weak, strong)).all()
