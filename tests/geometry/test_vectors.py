"""Vectors of space."""

import numpy as np
import pytest

from massprops.geometry.vectors import skew, sphere, unit


@pytest.mark.parametrize("kind", [float, complex])
def test_skew_is_the_cross_product(kind):
    a, b = np.random.default_rng(0).standard_normal((2, 4, 3)).astype(kind) * (1j if kind is complex else 1)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", skew(a), b), np.cross(a, b), atol=1e-15)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_unit_keeps_directions_and_zero(kind):
    v = np.array([[3, 0, 4], [0, 0, 0]], kind)
    out = unit(v)
    assert out.dtype == kind
    np.testing.assert_allclose(out, [[0.6, 0, 0.8], [0, 0, 0]], rtol=1e-6)


def test_sphere_is_even():
    d = sphere(1000)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1.0)
    np.testing.assert_allclose(d.T @ d / len(d), np.eye(3) / 3, atol=2e-3)
