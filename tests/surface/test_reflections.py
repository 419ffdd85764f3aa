"""What a flat side of a body reflects is no place of it."""

from __future__ import annotations

import numpy as np
from surface.synthetic_dense import cameras

from massprops.surface.cloud import Thinned
from massprops.surface.flat_side import Plane
from massprops.surface.reflections import reflections
from massprops.views import Views

STEP = 0.02
SIDE: Plane = (np.array([1.0, 0.0, 0.0]), 0.0)
"""Of a mirror at x = 0, before which a panel stands."""


def before_the_mirror() -> Views:
    directions = np.array([[1.0, 0.2 * a, 0.2 + 0.1 * b] for a in (-1, 0, 1) for b in (0, 1)])
    return cameras(directions / np.linalg.norm(directions, axis=1, keepdims=True), 3.0, 400.0)


def grid(x: tuple[float, float], y: tuple[float, float], z: float) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(*x, STEP), np.arange(*y, STEP), [z], indexing="ij"), -1).reshape(-1, 3)


def scene(behind: np.ndarray) -> tuple[Thinned, np.ndarray]:
    """A mirror, a panel before it, and points behind it that face up: all, and the numbers of the mirror's."""
    mirror = grid((-0.5, 0.5), (-0.5, 0.5), 0.0)[:, [2, 0, 1]]
    panel = grid((0.1, 0.4), (-0.2, 0.2), 0.0)
    xyz = np.concatenate([mirror, panel, behind])
    up = np.repeat([[0.0, 0.0, 1.0]], len(panel) + len(behind), axis=0)
    normal = np.concatenate([np.repeat([[1.0, 0.0, 0.0]], len(mirror), axis=0), up])
    seen = np.tile(np.arange(6), (len(xyz), 1))
    return Thinned(xyz, normal, np.full(len(xyz), 0.1 * STEP), seen, STEP), np.arange(len(mirror))


def test_the_image_of_a_panel_behind_a_side_is_found() -> None:
    image = grid((-0.38, -0.1), (-0.2, 0.2), 0.0)
    thinned, own = scene(image)
    found = reflections(thinned, before_the_mirror(), [(own, SIDE)])
    assert found[-len(image) :].mean() > 0.95
    assert not found[: -len(image)].any()


def test_what_stands_behind_a_side_and_mirrors_nothing_stays() -> None:
    """As the bottom of a box seen through its mouth."""
    thinned, own = scene(grid((-0.4, -0.1), (-0.2, 0.2), -0.2))
    assert not reflections(thinned, before_the_mirror(), [(own, SIDE)]).any()


def test_what_is_seen_past_a_side_stays() -> None:
    """As a panel on the other side of a body, which has its like before this one."""
    image = grid((-0.4, -0.1), (-0.2, 0.2), 0.0)
    thinned, own = scene(image)
    low = own[thinned.xyz[own, 2] < -0.3]
    assert not reflections(thinned, before_the_mirror(), [(low, SIDE)]).any()
