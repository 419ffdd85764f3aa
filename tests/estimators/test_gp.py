"""The process against a dense Gaussian process, its gradients, and its foresight on a tumbling body."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.errors import NotPossible
from massprops.estimators.gp import fit_process
from massprops.estimators.gp.coregionalised import _nll
from massprops.estimators.gp.kernel import feature_jacobian, feature_rates, features, lattice, line_weights, per_column
from massprops.estimators.gp.periods import candidate_pairs


def two_tone(t: np.ndarray, seed: int, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Three outputs of one motion with two fundamental frequencies, seen through a perspective division."""
    a, b = 2 * np.pi * t / 31.7, 2 * np.pi * t / 8.93
    x, z = np.cos(b) + 0.4 * np.cos(a + b), np.sin(b) + 0.3 * np.sin(a)
    depth = 9.0 + 0.8 * np.sin(a - b)
    y = np.column_stack([x / depth, z / depth, (x + 1.0) / depth])
    return y, y + sigma * np.random.default_rng(seed).normal(size=y.shape)


def test_kernel_is_the_sum_of_its_lines() -> None:
    z, f, d = np.array([0.6, 0.2]), np.array([0.03, 0.011]), np.linspace(0, 90, 37)
    orders = lattice(14)
    weight, _ = line_weights(orders, z)
    series = np.cos(2 * np.pi * np.outer(d, orders @ f)) @ weight
    closed = np.exp(-2 * np.sin(np.pi * d[:, None] * f) ** 2 @ z)
    assert np.allclose(series, closed, atol=1e-12)


def test_feature_derivatives() -> None:
    t, f, orders, e = np.linspace(0, 50, 30), np.array([0.03, 0.011]), lattice(2), 1e-6
    phi = features(t, orders, f)
    rate = (features(t + e, orders, f) - features(t - e, orders, f)) / (2 * e)
    assert np.allclose(feature_rates(phi, orders, f), rate, atol=1e-7)
    slope = feature_jacobian(phi, t, orders)
    for k, h in enumerate(1e-8 * np.eye(2)):
        assert np.allclose(
            slope[k], (features(t, orders, f + h) - features(t, orders, f - h)) / 2e-8, rtol=1e-4, atol=1e-3
        )


def test_likelihood_and_gradients_agree_with_a_dense_process() -> None:
    rng = np.random.default_rng(0)
    t, orders, f = np.arange(60.0), lattice(2), np.array([0.03, 0.011])
    y, chol = rng.normal(size=(60, 3)), np.tril(rng.normal(size=(3, 3))) + 2 * np.eye(3)
    z, noise = np.array([0.3, 0.7]), 0.2
    phi = features(t, orders, f)
    gram = (phi.T @ phi, phi.T @ y, y.T @ y, 60, orders)
    value, by_chol, by_z, by_noise = _nll(*gram, chol, z, noise)

    weight, _ = line_weights(orders, z)
    K = np.kron(chol @ chol.T, phi @ np.diag(per_column(weight)) @ phi.T) + noise * np.eye(180)
    flat = y.T.ravel()
    dense = 0.5 * (np.linalg.slogdet(K)[1] + flat @ np.linalg.solve(K, flat) + 180 * np.log(2 * np.pi))
    assert value == pytest.approx(dense, rel=1e-10)

    e = 1e-6
    for k in range(2):
        up, down = (_nll(*gram, chol, z * np.exp(s * e * np.eye(2)[k]), noise)[0] for s in (1, -1))
        assert by_z[k] == pytest.approx((up - down) / (2 * e), rel=1e-5)
    up, down = (_nll(*gram, chol, z, noise * np.exp(s * e))[0] for s in (1, -1))
    assert by_noise == pytest.approx((up - down) / (2 * e), rel=1e-5)
    for i, j in zip(*np.tril_indices(3), strict=True):
        step = np.zeros((3, 3))
        step[i, j] = e
        up, down = (_nll(*gram, chol + s * step, z, noise)[0] for s in (1, -1))
        assert by_chol[i, j] == pytest.approx((up - down) / (2 * e), rel=1e-5)


def test_periods_are_found_between_bins() -> None:
    t = np.arange(160.0)
    _, noisy = two_tone(t, 1, 1e-4)
    pairs = candidate_pairs(t, noisy)
    found = np.array([[np.min(np.abs(pair - target)) for target in (1 / 31.7, 1 / 8.93)] for pair in pairs])
    basis = np.array([[1 / 31.7, 1 / 8.93]])
    combined = [
        np.min(np.abs(pair[:, None] - np.abs((np.array([[1, 0], [0, 1], [1, 1], [1, -1]]) @ basis.T).T)), axis=1)
        for pair in pairs
    ]
    assert min(found.max(axis=1).min(), min(c.max() for c in combined)) < 1e-4, "far inside a bin of 1/160 Hz"


@pytest.mark.parametrize("missing", [False, True])
def test_foresight_is_at_the_noise_and_its_variance_is_honest(missing: bool) -> None:
    t = np.arange(900.0)
    truth, noisy = two_tone(t, 2, 1e-4)
    learn = t < 400
    if missing:
        learn &= np.random.default_rng(3).random(len(t)) > 0.2
    process = fit_process(t[learn], noisy[learn])
    value, rate, cov = process.predict(t[400:])
    error = value - truth[400:]
    assert np.sqrt(np.mean(error**2)) < 1e-4
    assert process.noise_sigma == pytest.approx(1e-4, rel=0.15)
    z = error / np.sqrt(np.einsum("nii->ni", cov)[:, :3])
    assert 0.4 < np.sqrt(np.mean(z**2)) < 2.0
    e = 1e-4
    slope = (two_tone(t[400:] + e, 0, 0)[0] - two_tone(t[400:] - e, 0, 0)[0]) / (2 * e)
    z = (rate - slope) / np.sqrt(np.einsum("nii->ni", cov)[:, 3:])
    assert 0.4 < np.sqrt(np.mean(z**2)) < 2.0


def test_what_cannot_be_learned_is_refused() -> None:
    with pytest.raises(NotPossible, match="too few"):
        fit_process(np.arange(10.0), np.zeros((10, 3)))
    with pytest.raises(NotPossible, match="do not vary"):
        fit_process(np.arange(100.0), np.ones((100, 3)))
