"""The plane of support and the object on it, among dense oriented points."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.capture.support import find_support, split
from massprops.dense.region import Region, looked_at

PIXEL = 0.003


def cameras() -> np.ndarray:
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    return np.column_stack([2 * np.cos(turn), 2 * np.sin(turn), np.full(24, 1.5)])


def rectangle(rng: np.random.Generator, n: int, x: float, y: float, z: float) -> tuple[np.ndarray, np.ndarray]:
    xyz = np.column_stack([rng.uniform(-x, x, n), rng.uniform(-y, y, n), z + 0.001 * rng.standard_normal(n)])
    return xyz, np.tile([0.0, 0.0, 1.0], (n, 1))


def box(rng: np.random.Generator, n: int, half: np.ndarray, middle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points on the top and the four sides of a box."""
    side = rng.choice([0, 1, 2, 3, 5], n)
    axis, sign = side % 3, np.where(side >= 3, 1.0, -1.0)
    sign = np.where(axis == 2, 1.0, sign)
    xyz = rng.uniform(-half, half, (n, 3))
    xyz[np.arange(n), axis] = sign * half[axis]
    normal = np.zeros((n, 3))
    normal[np.arange(n), axis] = sign
    return xyz + middle, normal


def scene(*parts: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


def table(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    xyz, normal = rectangle(rng, 40_000, 1.0, 1.0, 0.0)
    free = (np.abs(xyz[:, :2]) > 0.2).any(1)
    return xyz[free], normal[free]


def test_what_the_cameras_look_at() -> None:
    centres = cameras()
    axes = np.array([0, 0, 0.2]) - centres
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    assert np.allclose(looked_at(centres, axes), [0, 0, 0.2], atol=1e-6)


def test_the_object_is_what_stands_in_the_middle() -> None:
    rng = np.random.default_rng(0)
    own = box(rng, 6000, np.array([0.15, 0.1, 0.12]), np.array([0, 0, 0.12]))
    other = box(rng, 3000, np.array([0.08, 0.08, 0.2]), np.array([0.6, 0.3, 0.2]))
    ground = table(rng)
    xyz, normal = scene(ground, own, other)
    region = Region(np.array([0.02, -0.01, 0.1]), 1.0)
    plane = find_support(xyz, normal, cameras(), region)
    assert plane is not None and plane[2] > 0.999 and abs(plane[3]) < 0.003
    found = split(xyz, normal, plane, region, PIXEL)
    n = len(ground[0])
    high = xyz[:, 2] > 0.02
    assert found.member[n : n + 6000][high[n : n + 6000]].mean() > 0.98
    assert not found.member[:n].any() and not found.member[n + 6000 :].any()
    assert found.other[:n].mean() > 0.9 and not found.other[n : n + 6000][high[n : n + 6000]].any()


def test_a_flat_object_is_not_its_own_table() -> None:
    rng = np.random.default_rng(1)
    tile = box(rng, 60_000, np.array([0.2, 0.2, 0.02]), np.array([0, 0, 0.02]))
    ground = table(rng)
    xyz, normal = scene(ground, tile)
    region = Region(np.zeros(3), 0.6)
    plane = find_support(xyz, normal, cameras(), region)
    assert plane is not None and abs(plane[3]) < 0.003, "the tile's own top lies at 0.04"
    found = split(xyz, normal, plane, region, PIXEL)
    top = xyz[:, 2] > 0.035
    assert found.member[top].mean() > 0.99


def test_a_free_object_has_no_support() -> None:
    rng = np.random.default_rng(2)
    direction = rng.standard_normal((8000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    region = Region(np.zeros(3), 0.5)
    assert find_support(0.3 * direction, direction, cameras(), region) is None
    assert split(0.3 * direction, direction, None, region, PIXEL).member.mean() > 0.99


@pytest.mark.parametrize("seed", [0, 1])
def test_wrong_points_below_the_table_are_neither(seed: int) -> None:
    """A glossy table mirrors the object: what is seen below it is no surroundings, whose sight lines would carve."""
    rng = np.random.default_rng(seed)
    own = box(rng, 6000, np.array([0.15, 0.1, 0.12]), np.array([0, 0, 0.12]))
    mirrored = own[0][:1500] * [1, 1, -1], own[1][:1500] * [1, 1, -1]
    ground = table(rng)
    xyz, normal = scene(ground, own, mirrored)
    region = Region(np.zeros(3), 1.0)
    plane = find_support(xyz, normal, cameras(), region, seed)
    assert plane is not None
    found = split(xyz, normal, plane, region, PIXEL)
    deep = xyz[:, 2] < -0.03
    assert not found.member[deep].any() and not found.other[deep].any()


@pytest.mark.parametrize("apart", [0.05, 0.3])
def test_what_hangs_in_the_air_belongs_to_the_object_beside_it(apart: float) -> None:
    """Stereo did not measure the plain middle of a thing; a thing of its own, as near, begins on the table."""
    rng = np.random.default_rng(3)
    own = box(rng, 6000, np.array([0.1, 0.1, 0.12]), np.array([0, 0, 0.12]))
    beside = np.array([0.15 + apart, 0, 0])
    above = box(rng, 2000, np.array([0.05, 0.1, 0.05]), beside + [0, 0, 0.2])
    standing = box(rng, 2000, np.array([0.05, 0.1, 0.1]), [0, -0.25, 0.1])
    ground = table(rng)
    xyz, normal = scene(ground, own, above, standing)
    region = Region(np.array([0.02, -0.01, 0.1]), 1.0)
    found = split(xyz, normal, np.array([0.0, 0.0, 1.0, 0.0]), region, PIXEL)
    n = len(ground[0]) + 6000
    held = found.member[n : n + 2000].mean()
    assert held > 0.98 if apart == 0.05 else held == 0.0
    assert not found.member[n + 2000 :].any() and found.other[n + 2000 :].mean() > 0.9
