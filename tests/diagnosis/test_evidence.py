"""Variances and what the unknowns take up of the residual, without the covariance where one noise factor is all."""

from __future__ import annotations

import numpy as np

from massprops.diagnosis.evidence import Block, _covariance, _rows, _unknowns, solve


def test_variances_of_one_group_are_those_of_the_covariance() -> None:
    rng = np.random.default_rng(3)
    X, y, sd = rng.standard_normal((40, 6)), rng.standard_normal(40), rng.uniform(0.2, 2.0, 6)
    rows = _rows([Block(name="a", columns=X, sd=1.0)], y, None)
    _, variance, taken, factor = _unknowns(rows, sd, np.array([1.3]))
    covariance = np.linalg.inv(X.T @ X / 1.3**2 + np.diag(sd**-2.0))
    assert np.allclose(variance, np.diag(covariance))
    assert np.allclose(taken, np.sum(covariance * rows.G[0]))
    assert np.allclose(_covariance(factor, sd), covariance)


def test_one_noise_factor_and_three_alike_agree() -> None:
    """Rows that are the same three times over have the same factor in each group."""
    rng = np.random.default_rng(4)
    X, y = rng.standard_normal((50, 4)), 2.0 * rng.standard_normal(50)
    blocks = [Block(name="a", columns=np.repeat(X, 3, axis=0), sd=1.0, kind="common")]
    rows = np.repeat(y, 3)
    one = solve(blocks, rows, 3.0)
    three = solve(blocks, rows, 1.0, np.tile([0, 1, 2], 50))
    assert np.allclose(one.noise, three.noise, rtol=1e-3) and np.allclose(one.mean["a"], three.mean["a"], rtol=1e-3)
