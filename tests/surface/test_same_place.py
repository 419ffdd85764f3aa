"""Two parts of the footage that show an object in one place, or in two."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from massprops.surface.cloud import Cloud
from massprops.surface.same_place import SAME_PAINT, colour_correlation, groups_in_place


def painted_ball(seed: int, part: float, turn: Rotation) -> tuple[Cloud, np.ndarray]:
    """Points of a painted ball whose height is over `part` of its radius, after a turn of the ball."""
    rng = np.random.default_rng(seed)
    xyz = trimesh.creation.icosphere(6, radius=1.0).vertices + 0.001 * rng.standard_normal((40962, 3))
    paint = 120 + 60 * np.sin(9 * xyz[:, [0]] + 4 * np.sin(7 * xyz[:, [1]])) + 5 * rng.standard_normal((len(xyz), 1))
    here = turn.apply(xyz)
    keep = here[:, 2] > part
    start = 3 * np.arange(keep.sum() + 1)
    normal = here[keep] / np.linalg.norm(here[keep], axis=1, keepdims=True)
    cloud = Cloud(here[keep], normal, np.full(keep.sum(), 0.001), start, np.tile([0, 1, 2], keep.sum()))
    return cloud, np.repeat(paint[keep], 3, axis=1).clip(0, 255).astype(np.uint8)


def test_what_stood_has_its_paint_in_common_and_what_was_turned_has_not() -> None:
    first, one = painted_ball(0, -0.3, Rotation.identity())
    second, other = painted_ball(1, 0.2, Rotation.identity())
    assert colour_correlation(first, second, (one, other), 0.01) > 0.8
    turned, third = painted_ball(1, 0.2, Rotation.from_euler("x", 120, degrees=True))
    assert abs(colour_correlation(first, turned, (one, third), 0.01)) < 0.5 * SAME_PAINT


def test_parts_that_do_not_touch_say_nothing() -> None:
    first, one = painted_ball(0, 0.5, Rotation.identity())
    second, other = painted_ball(1, -2.0, Rotation.from_euler("x", 180, degrees=True))
    far = Cloud(second.xyz + 3.0, second.normal, second.sigma, second.view_start, second.view_index)
    assert colour_correlation(first, far, (one, other), 0.01) == 0.0


def test_parts_alike_are_one_group_by_way_of_a_third() -> None:
    alike = np.zeros((4, 4))
    alike[2, 0], alike[3, 2] = 0.8, 0.7
    assert groups_in_place(alike).tolist() == [0, 1, 0, 0]
