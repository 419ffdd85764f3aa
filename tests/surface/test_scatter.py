"""How far measured points scatter about a smooth surface."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.surface.cloud import Cloud
from massprops.surface.scatter import face_scatter


def bowl(noise: np.ndarray) -> Cloud:
    """Points of a paraboloid, off it by noise (n,)."""
    n = len(noise)
    xy = np.random.default_rng(1).uniform(-1, 1, (n, 2))
    xyz = np.column_stack([xy, 0.3 * (xy**2).sum(axis=1) + noise])
    normal = np.column_stack([-0.6 * xy, np.ones(n)])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return Cloud(xyz, normal, np.full(n, 0.01), np.arange(n + 1), np.zeros(n, int))


def scatter(cloud: Cloud, observed: bool = True) -> np.ndarray:
    middle = cloud.xyz[(np.abs(cloud.xyz[:, :2]) < 0.7).all(axis=1)]
    return face_scatter(middle, np.full(len(middle), observed), cloud, 0.2, np.random.default_rng(0))


def test_a_curved_surface_without_noise_does_not_scatter() -> None:
    assert scatter(bowl(np.zeros(6000))).max() < 1e-4


def test_noise_is_found_and_only_where_it_was_measured() -> None:
    cloud = bowl(0.01 * np.random.default_rng(2).standard_normal(6000))
    assert scatter(cloud).mean() == pytest.approx(0.6745 * 0.01, rel=0.1)
    assert not scatter(cloud, observed=False).any()


def test_noise_that_neighbours_share_is_found_beyond_them() -> None:
    """Depths of one window err alike: steps of half the radius."""
    cloud = bowl(np.zeros(6000))
    cell = np.floor(cloud.xyz[:, :2] / 0.1).astype(int) + 20
    step = 0.01 * np.random.default_rng(3).standard_normal((40, 40))[cell[:, 0], cell[:, 1]]
    assert scatter(bowl(step)).mean() > 0.003


def test_too_few_points_say_nothing() -> None:
    assert not scatter(bowl(np.zeros(30))).any()
